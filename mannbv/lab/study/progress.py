"""A progress bar over the robots that are at their goals, with an estimate of the time left."""

import os
import sys
import time

from tqdm import tqdm

from mannbv.lab.study.comparison import Progress

_LINES = 20


def _is_terminal(stream) -> bool:
    """Whether a bar can be redrawn there; tqdm shows nothing on a terminal that does not know its height."""
    if not getattr(stream, "isatty", lambda: False)():
        return False
    try:
        return os.get_terminal_size(stream.fileno()).lines > 1
    except (OSError, ValueError):
        return True


class ProgressBar:
    """Shows a study's progress on a stream (standard error): a bar on a terminal, elsewhere a line an episode.

    Use as `with ProgressBar() as meter: compare(…, progress=meter)`.
    """

    def __init__(self, stream=None):
        self.stream = sys.stderr if stream is None else stream
        self._bar, self._began, self._first, self._told = None, time.monotonic(), None, set()

    def __enter__(self) -> "ProgressBar":
        return self

    def __exit__(self, *_) -> None:
        if self._bar is not None:
            self._bar.close()

    def __call__(self, progress: Progress) -> None:
        if self._first is None:
            self._first = progress.share
        if _is_terminal(self.stream):
            self._draw(progress)
        else:
            self._tell(progress)

    def left(self, progress: Progress) -> str:
        """The time left as text, from the share done since the start; "" as long as there is nothing to go by."""
        done = progress.share - self._first
        if done < 0.02 or progress.share >= 1:
            return ""
        return "about " + tqdm.format_interval((time.monotonic() - self._began) * (1 - progress.share) / done) + " left"

    def _draw(self, progress: Progress) -> None:
        ticks = progress.ticks.values()
        if self._bar is None:
            self._bar = tqdm(
                total=progress.n_robots * len(ticks), file=self.stream, dynamic_ncols=True,
                unit="", bar_format="robots at their goals {n_fmt}/{total_fmt} |{bar}| {unit}",
            )  # fmt: skip
        self._bar.n = sum(tick.at_goal for tick in ticks)
        over = sum(tick.finished or tick.fault is not None for tick in ticks)
        cycles = sum(tick.cycles for tick in ticks)
        words = [f"{cycles} cycles", f"{over}/{len(ticks)} episodes"]
        words += [tqdm.format_interval(time.monotonic() - self._began), self.left(progress)]
        self._bar.unit = ", ".join(filter(None, words))
        self._bar.refresh()

    def _tell(self, progress: Progress) -> None:
        for key, tick in progress.ticks.items():
            if key in self._told or not (tick.finished or tick.fault is not None):
                continue
            self._told.add(key)
            words = [f"{tick.at_goal}/{progress.n_robots} robots at their goals, {tick.cycles} cycles"]
            count, every = len(progress.ticks), max(1, len(progress.ticks) // _LINES)
            if tick.fault is None and len(self._told) % every and len(self._told) < count:
                continue  # of many episodes only some are told, and all that fail
            words = ["failed"] if tick.fault is not None else words
            words += [f"{len(self._told)}/{count} episodes", self.left(progress)]
            print(f"{tick.strategy}, seed {tick.seed}: {', '.join(filter(None, words))}", file=self.stream, flush=True)
