"""Timing side by side: in turns, with equal samples, so that what else the machine does falls on all sides alike."""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field

import numba
import numpy as np
import torch


@dataclass(frozen=True)
class Result:
    """One thing measured. samples and cpu: of each round, in `unit` (s, ns, B); cpu is the process's own time, if any.

    ratio: of each round, how many times the first of its group, called `beside`, this took; empty for the first itself.
    load: the machine's load average as the rounds began. facts: what was measured, as plain numbers and words.
    """

    key: str
    title: str
    unit: str
    samples: tuple[float, ...]
    cpu: tuple[float, ...] = ()
    ratio: tuple[float, ...] = ()
    threads: int = 0
    load: float | None = None
    beside: str = "ours"
    facts: dict = field(default_factory=dict)

    @property
    def median(self) -> float:
        return float(np.median(self.samples))

    def row(self) -> dict:
        """For JSON: the fields, with median and quartiles."""
        spread = {}
        for name in ("samples", "cpu", "ratio"):
            values = getattr(self, name)
            low, median, high = np.percentile(values, [25, 50, 75]).tolist() if values else (None, None, None)
            spread[name] = {"median": median, "quartiles": [low, high], "each": list(values)}
        return asdict(self) | spread

    def __str__(self) -> str:
        low, high = np.percentile(self.samples, [25, 75])
        count = len(self.samples)
        text = f"{self.title}: {with_unit(self.median, self.unit)}"
        if count > 1:
            text += f" ({with_unit(low, self.unit)} to {with_unit(high, self.unit)} in half of {count} rounds)"
        if self.cpu:
            text += f", CPU {with_unit(float(np.median(self.cpu)), self.unit)}"
        if self.ratio:
            text += f", {with_unit(np.median(self.ratio), 'times')} {self.beside}"
        return text


_PREFIXES = {
    "s": ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")),
    "B": ((1e9, "GB"), (1e6, "MB"), (1.0, "B")),
}


def with_unit(value: float, unit: str) -> str:
    """A number in words: seconds and bytes with the prefix that suits them."""
    sizes = _PREFIXES.get(unit, ((1.0, unit),))
    size, name = next((pair for pair in sizes if value >= pair[0]), sizes[-1])
    scaled = value / size
    return f"{scaled:,.0f} {name}" if scaled >= 1000 else f"{scaled:.3g} {name}"


def interleave(
    calls: Sequence[Callable[[], object]],
    rounds: int,
    clock: Callable[[], float] = time.perf_counter,
    cpu: Callable[[], float] = time.process_time,
) -> tuple[list[list[float]], list[list[float]]]:
    """Wall and CPU time [s] of each call in each round, (calls, rounds); rounds begin with each call in turn."""
    wall, own = [[] for _ in calls], [[] for _ in calls]
    for turn in range(rounds):
        for place in range(len(calls)):
            k = (turn + place) % len(calls)
            began, spent = clock(), cpu()
            calls[k]()
            own[k].append(cpu() - spent)
            wall[k].append(clock() - began)
    return wall, own


def rounds_for(calls: Sequence[Callable[[], object]], budget: float, least: int, most: int) -> int:
    """How many rounds fill `budget` [s], at least `least` and at most `most`; calls each once to see."""
    began = time.perf_counter()
    for call in calls:
        call()
    return int(min(max(budget / max(time.perf_counter() - began, 1e-6), least), most))


def most_threads() -> int:
    """How many threads compiled kernels may use here."""
    return numba.config.NUMBA_NUM_THREADS  # pyright: ignore[reportPrivateImportUsage, reportAttributeAccessIssue]


@contextmanager
def threads(count: int) -> Iterator[int]:
    """Inside, kernels and torch share `count` threads, or as many as there are; yields how many."""
    before = numba.get_num_threads(), torch.get_num_threads()
    count = min(count, most_threads())
    numba.set_num_threads(count)
    torch.set_num_threads(count)
    try:
        yield count
    finally:
        numba.set_num_threads(before[0])
        torch.set_num_threads(before[1])


def load() -> float | None:
    """The load average of the last minute; None where the system does not tell."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None
