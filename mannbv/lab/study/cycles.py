"""One episode cycle by cycle: how its maps grew, what was sent, and how long each stage took."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain

import numpy as np

from mannbv.episode import Record
from mannbv.messages import Ledger
from mannbv.plain import Plain


@dataclass(frozen=True)
class EpisodeLog(Plain):
    """An entry of "episodes" in `results.json`, with c cycles of n robots.

    splats, guests (c, n): each robot's own splats and those that it was sent, after the share stage. bytes_by_cycle
    (c,): what the team really sent [B]; bytes_paper_by_cycle (c,): by the paper's count (see `Ledger.paper_total`).
    messages: kind → messages, bytes [B]. seconds: stage → seconds in all, of the whole team.
    """

    strategy: str
    seed: int
    cycles: int
    splats: tuple[tuple[int, ...], ...]
    guests: tuple[tuple[int, ...], ...]
    bytes_by_cycle: tuple[int, ...]
    bytes_paper_by_cycle: tuple[int, ...]
    messages: Mapping[str, tuple[int, int]]
    seconds: Mapping[str, float]

    def fits(self, n_robots: int) -> bool:
        """Whether it can be of a team of that size: a number for every cycle and robot, and none below 0."""
        tables, rows = (self.splats, self.guests), (self.bytes_by_cycle, self.bytes_paper_by_cycle)
        counts = chain(*self.splats, *self.guests, *rows, *self.messages.values())
        return (
            min(self.seed, *counts, *self.seconds.values()) >= 0
            and all(len(part) == self.cycles for part in (*tables, *rows))
            and all(len(row) == n_robots for table in tables for row in table)
            and all(count for count, _ in self.messages.values())
        )


def episode_of(record: Record) -> EpisodeLog:
    """How an episode went, cycle by cycle."""
    count, kinds, seconds = len(record.cycles), {}, Counter()
    parts = [Ledger({key: row for key, row in record.ledger.rows.items() if key[4] == c}) for c in range(count)]
    for key, (n_messages, n_bytes) in sorted(record.ledger.rows.items()):
        before = kinds.get(key[3], (0, 0))
        kinds[key[3]] = before[0] + n_messages, before[1] + n_bytes
    for log in record.cycles:
        seconds.update(log.seconds.to_json())
    return EpisodeLog(
        strategy=record.strategy,
        seed=record.seed,
        cycles=count,
        splats=tuple(tuple(robot.splats for robot in log.robots) for log in record.cycles),
        guests=tuple(tuple(robot.guests for robot in log.robots) for log in record.cycles),
        bytes_by_cycle=tuple(part.total() for part in parts),
        bytes_paper_by_cycle=tuple(part.paper_total(record.strategy) for part in parts),
        messages=kinds,
        seconds=dict(seconds),
    )


def picked(count: int, most: int = 5) -> list[int]:
    """At most `most` of `count` cycles, evenly spread, the first and the last among them."""
    return np.unique(np.linspace(0, count - 1, most).round().astype(int)).tolist() if count else []
