"""Sides: what is timed side by side, how much of it, and that their answers agree."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from mannbv.lab.bench.timing import Result, interleave, load, most_threads, rounds_for, threads


@dataclass(frozen=True)
class Scale:
    """How much is measured. Pairs are splats and pixels along an image's side, or splats and points."""

    budget: float = 10.0  # [s] of rounds for a group, within the two numbers that follow
    least: int = 5
    most: int = 50
    large: tuple[int, int] = (100_000, 800)
    small: tuple[int, int] = (20_000, 128)
    dense: tuple[int, int] = (1_000, 64)
    gram: tuple[int, int] = (500, 64)
    loop: tuple[int, int] = (100, 16)
    flat: tuple[int, int] = (400, 64)
    profile: tuple[int, int] = (20_000, 256)
    field: tuple[int, int] = (100_000, 10_000)
    memory: tuple[int, int] = (200_000, 800)
    splats: tuple[int, ...] = (1_000, 3_000, 10_000, 30_000, 100_000, 300_000)
    sides: tuple[int, ...] = (50, 100, 200, 400, 800, 1600)
    fresh: int = 5  # processes for the first image
    cold: bool = True
    job: bool = True

    def rounds(self, calls: Sequence[Callable]) -> int:
        return rounds_for(calls, self.budget, self.least, self.most)


FULL = Scale()
QUICK = Scale(
    budget=0.3, least=3, most=20, loop=(30, 8), field=(20_000, 10_000), splats=(1_000, 10_000, 100_000),
    sides=(100, 300, 800), fresh=1, cold=False, job=False,
)  # fmt: skip


@dataclass(frozen=True)
class Side:
    """One of a group: what is called, and how often the thing it stands for would call it."""

    key: str
    title: str
    call: Callable[[], object]
    times: int = 1
    facts: dict = field(default_factory=dict)


def compare(
    sides: Sequence[Side], scale: Scale, count: int | None = None, beside: str = "ours", **facts: float
) -> Iterator[Result]:
    """Time sides in turns on `count` threads (None: all); ratios are to the first, of CPU time if on one thread."""
    with threads(count or most_threads()) as used:
        calls = [side.call for side in sides]
        rounds = scale.rounds(calls)
        busy = load()
        wall, cpu = interleave(calls, rounds)
    # on one thread its CPU time tells, which other processes hardly touch
    counted = np.array(cpu if used == 1 else wall) * np.array([[side.times] for side in sides])
    for k, side in enumerate(sides):
        samples, own = ((side.times * np.array(times[k])).tolist() for times in (wall, cpu))
        ratio = (counted[k] / counted[0]).tolist() if k else ()
        yield Result(
            side.key, side.title, "s", tuple(samples), tuple(own), tuple(ratio), used, busy, beside, facts | side.facts
        )


def agree(what: str, ours: Tensor, theirs: Tensor, bound: float = 0.1) -> float:
    """‖ours − theirs‖ / ‖theirs‖. Raises ValueError beyond the bound: what differs must not be timed side by side."""
    apart = float(torch.linalg.norm(ours - theirs) / torch.linalg.norm(theirs).clamp_min(1e-30))
    if not apart <= bound:
        raise ValueError(f"bench: {what} differ by {apart:.2g}, more than {bound:g}; run the tests of this checkout")
    return apart
