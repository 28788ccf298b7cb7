"""A progress bar over the robots that are at their goals, with an estimate of the time left."""

import math
import os
import sys
import time
from typing import TextIO

from tqdm import tqdm

from mannbv.lab.study.comparison import Progress

_LINES = 20


def _is_terminal(stream: TextIO) -> bool:
    """Whether a bar can be redrawn there; tqdm shows nothing on a terminal that does not know its height."""
    if not getattr(stream, "isatty", lambda: False)():
        return False
    try:
        return os.get_terminal_size(stream.fileno()).lines > 1
    except (OSError, ValueError):
        return True


class ProgressBar:
    """Shows a study's progress on a stream (standard error): a bar on a terminal, elsewhere a line an episode.

    Use as `with ProgressBar() as bar: compare(…, progress=bar)`.
    """

    def __init__(self, stream: TextIO | None = None):
        self.stream = sys.stderr if stream is None else stream
        self._bar: tqdm | None = None
        self._began, self._first, self._printed = time.monotonic(), math.nan, set()

    def __enter__(self) -> "ProgressBar":
        return self

    def __exit__(self, *_) -> None:
        if self._bar is not None:
            self._bar.close()

    def __call__(self, progress: Progress) -> None:
        if math.isnan(self._first):
            self._first = progress.share
        if _is_terminal(self.stream):
            self._draw(progress)
        else:
            self._print(progress)

    def left(self, progress: Progress) -> str:
        """The time left as text, from the share done since the start; "" as long as there is nothing to go by."""
        done = progress.share - self._first
        if done < 0.02 or progress.share >= 1:
            return ""
        return "about " + tqdm.format_interval((time.monotonic() - self._began) * (1 - progress.share) / done) + " left"

    def _draw(self, progress: Progress) -> None:
        episodes = progress.episodes.values()
        if self._bar is None:
            self._bar = tqdm(
                total=progress.n_robots * len(episodes), file=self.stream, dynamic_ncols=True,
                unit="", bar_format="robots at their goals {n_fmt}/{total_fmt} |{bar}| {unit}",
            )  # fmt: skip
        self._bar.n = sum(each.at_goal for each in episodes)
        over = sum(each.finished or each.fault is not None for each in episodes)
        cycles = sum(each.cycles for each in episodes)
        words = [f"{cycles} cycles", f"{over}/{len(episodes)} episodes"]
        words += [tqdm.format_interval(time.monotonic() - self._began), self.left(progress)]
        self._bar.unit = ", ".join(filter(None, words))
        self._bar.refresh()

    def _print(self, progress: Progress) -> None:
        for key, each in progress.episodes.items():
            if key in self._printed or not (each.finished or each.fault is not None):
                continue
            self._printed.add(key)
            words = [f"{each.at_goal}/{progress.n_robots} robots at their goals, {each.cycles} cycles"]
            count, every = len(progress.episodes), max(1, len(progress.episodes) // _LINES)
            if each.fault is None and len(self._printed) % every and len(self._printed) < count:
                continue  # of many episodes only some are printed, and all that fail
            words = ["failed"] if each.fault is not None else words
            words += [f"{len(self._printed)}/{count} episodes", self.left(progress)]
            print(f"{each.strategy}, seed {each.seed}: {', '.join(filter(None, words))}", file=self.stream, flush=True)
