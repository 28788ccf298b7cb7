"""Statistics over robots and seeds."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from mannbv.metrics import SCORES, Row
from mannbv.plain import Plain


@dataclass(frozen=True)
class Mean(Plain):
    """A mean over seeds, and its interval; None of a single seed."""

    mean: float
    interval: tuple[float, float] | None = None


def summarise(rows: Iterable[Row], confidence: float = 0.95) -> dict[str, dict[str, Mean]]:
    """Per strategy and score the mean and its interval.

    Robots of one team are not independent, so a seed is the unit: the mean over its robots, then Student's t across
    seeds. One seed gives no interval. Scores that do not exist (None) are left out.
    """
    summary = {}
    for strategy, seeds in per_seed(rows).items():
        values = {key: [score for scores in seeds.values() if (score := scores[key]) is not None] for key in SCORES}
        summary[strategy] = {key: Mean(*interval(known, confidence)) for key, known in values.items() if known}
    return summary


def interval(values: ArrayLike, confidence: float = 0.95) -> tuple[float, tuple[float, float] | None]:
    """Mean of independent values (k,), and the interval of Student's t around it; None for a single value."""
    each = np.asarray(values, float)
    mean, k = float(each.mean()), len(each)
    if k < 2:
        return mean, None
    half = float(special.stdtrit(k - 1, (1 + confidence) / 2) * each.std(ddof=1) / math.sqrt(k))
    return mean, (mean - half, mean + half)


def per_seed(rows: Iterable[Row]) -> dict[str, dict[int, dict[str, float | None]]]:
    """Strategy → seed → score → mean over the robots, for all of `SCORES`; None for what does not exist.

    Some are ratios of the team's own. risk_gain_share, risk_gain_true_share: the team's risk gain over the risk of its
    shortest paths (a mean of the robots' own ratios would explode where one shortest path has a risk near 0).
    sent_per_cycle_b, received_per_cycle_b, paper_per_cycle_b: bytes a planning cycle [B], of one robot, and of the
    whole team by the paper's count.
    """
    teams = {}
    for row in rows:
        teams.setdefault(row.strategy, {}).setdefault(row.seed, []).append(row)
    return {s: {seed: _team(members) for seed, members in sorted(seeds.items())} for s, seeds in teams.items()}


def _team(rows: Sequence[Row]) -> dict[str, float | None]:
    def known(key: str) -> list:
        return [getattr(row, key) for row in rows if getattr(row, key) is not None]

    cycles = max(known("cycles"), default=0)

    def each_cycle(key: str, share: float) -> float | None:
        return sum(known(key)) * share / cycles if cycles and len(known(key)) == len(rows) else None

    means = {key: known(key) for key, score in SCORES.items() if not score.of_team}
    return {key: float(np.mean(values)) if values else None for key, values in means.items()} | {
        "risk_gain_share": _gain_share([(row.risk_gain_m, row.total_risk_m) for row in rows]),
        "risk_gain_true_share": _gain_share([(row.risk_gain_true_m, row.total_risk_true_m) for row in rows]),
        "sent_per_cycle_b": each_cycle("bytes_sent", 1 / len(rows)),
        "received_per_cycle_b": each_cycle("bytes_received", 1 / len(rows)),
        "paper_per_cycle_b": each_cycle("bytes_paper", 1.0),
    }


def _gain_share(pairs: list[tuple[float | None, float | None]]) -> float | None:
    known = [(gain, total) for gain, total in pairs if gain is not None and total is not None]
    shortest = sum(total - gain for gain, total in known)
    return sum(gain for gain, _ in known) / shortest if known and shortest > 0 else None
