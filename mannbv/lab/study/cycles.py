"""One episode cycle by cycle: how its maps grew, what was sent, and how long each stage took."""

import numpy as np

from mannbv.episode import Record
from mannbv.messages import Ledger

_EACH_ROBOT = ("splats", "guests")  # (cycles, robots)
_EACH_CYCLE = ("bytes_by_cycle", "bytes_paper_by_cycle")  # (cycles,)


def episode_of(record: Record) -> dict:
    """An entry of "episodes" in `results.json`, as plain lists.

    splats, guests: each robot's own splats and those that it was sent, after the share stage of each cycle.
    bytes_by_cycle: what the team really sent [B]; bytes_paper_by_cycle: by the paper's count (see
    `Ledger.paper_total`). messages: kind → [messages, bytes]. seconds: stage → seconds in all, of the whole team.
    """
    count = len(record.cycles)
    parts = [Ledger({key: row for key, row in record.ledger.rows.items() if key[4] == c}) for c in range(count)]
    kinds, seconds = {}, {}
    for key, (n_messages, n_bytes) in sorted(record.ledger.rows.items()):
        before = kinds.get(key[3], (0, 0))
        kinds[key[3]] = [before[0] + n_messages, before[1] + n_bytes]
    for log in record.cycles:
        for stage, spent in log.seconds.to_json().items():
            seconds[stage] = seconds.get(stage, 0.0) + spent
    return {
        "strategy": record.strategy,
        "seed": record.seed,
        "cycles": count,
        **{key: [[getattr(robot, key) for robot in log.robots] for log in record.cycles] for key in _EACH_ROBOT},
        "bytes_by_cycle": [part.total() for part in parts],
        "bytes_paper_by_cycle": [part.paper_total(record.strategy) for part in parts],
        "messages": kinds,
        "seconds": seconds,
    }


def picked(count: int, most: int = 5) -> list[int]:
    """At most `most` of `count` cycles, evenly spread, the first and the last among them."""
    return np.unique(np.linspace(0, count - 1, most).round().astype(int)).tolist() if count else []


def is_episode(entry, n_robots: int) -> bool:
    """Whether something read from a file has the form of `episode_of`."""
    if not isinstance(entry, dict) or not isinstance(entry.get("strategy"), str):
        return False
    if not (_is_count(entry.get("seed")) and _is_count(entry.get("cycles"))):
        return False
    count, seconds, kinds = entry["cycles"], entry.get("seconds"), entry.get("messages")
    return (
        all(_are(entry.get(key), count, lambda row: _are(row, n_robots, _is_count)) for key in _EACH_ROBOT)
        and all(_are(entry.get(key), count, _is_count) for key in _EACH_CYCLE)
        and isinstance(seconds, dict)
        and all(isinstance(s, (int, float)) and 0 <= s < 1e12 for s in seconds.values())
        and isinstance(kinds, dict)
        and all(_are(pair, 2, _is_count) and pair[0] for pair in kinds.values())
    )


def _are(values, count: int, good) -> bool:
    return isinstance(values, list) and len(values) == count and all(map(good, values))


def _is_count(value) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 10**15
