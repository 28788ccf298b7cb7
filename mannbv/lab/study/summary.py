"""Statistics over robots and seeds."""

import math
from collections.abc import Iterable

import numpy as np
from scipy import special

_NOT_METRICS = ("strategy", "seed", "robot", "fate")


def summarise(rows: Iterable[dict], confidence=0.95) -> dict[str, dict[str, dict]]:
    """Per strategy and metric {"mean": …, "interval": [low, high] or None}, from rows of `results.json`.

    Robots of one team are not independent, so a seed is the unit: the mean over its robots, then Student's t across
    seeds. One seed gives no interval. Values that do not exist (None) are left out.
    """
    summary = {}
    for strategy, seeds in per_seed(rows).items():
        names = list(dict.fromkeys(name for values in seeds.values() for name in values))
        summary[strategy] = {}
        for name in names:
            values = [v[name] for v in seeds.values() if v.get(name) is not None]
            if values:
                mean, bounds = interval(values, confidence)
                summary[strategy][name] = {"mean": mean, "interval": bounds}
    return summary


def interval(values, confidence=0.95) -> tuple[float, list[float] | None]:
    """Mean of independent values (k,), and the interval of Student's t around it; None for a single value."""
    values = np.asarray(values, float)
    mean = float(values.mean())
    if len(values) < 2:
        return mean, None
    half = float(special.stdtrit(len(values) - 1, (1 + confidence) / 2) * values.std(ddof=1) / math.sqrt(len(values)))
    return mean, [mean - half, mean + half]


def per_seed(rows: Iterable[dict]) -> dict[str, dict[int, dict[str, float | None]]]:
    """Strategy → seed → metric → mean over the robots, with some ratios of the team's own.

    risk_gain_share, risk_gain_true_share: the team's risk gain over the risk of its shortest paths (a mean of the
    robots' own ratios would explode where one shortest path has a risk near 0). sent_per_cycle_b,
    received_per_cycle_b, paper_per_cycle_b: bytes a planning cycle [B], of one robot, and of the whole team by the
    paper's count.
    """
    teams = {}
    for row in rows:
        teams.setdefault(row["strategy"], {}).setdefault(row["seed"], []).append(row)
    return {s: {seed: _team(members) for seed, members in sorted(seeds.items())} for s, seeds in teams.items()}


def _team(rows: list[dict]) -> dict[str, float | None]:
    names = [name for name in dict.fromkeys(key for row in rows for key in row) if name not in _NOT_METRICS]
    means = {}
    for name in names:
        values = [row[name] for row in rows if row.get(name) is not None]
        means[name] = float(np.mean(values)) if values else None
    cycles = max((row.get("cycles") or 0 for row in rows), default=0)
    ratios = {
        "risk_gain_share": _gain_share(rows, "risk_gain_m", "total_risk_m"),
        "risk_gain_true_share": _gain_share(rows, "risk_gain_true_m", "total_risk_true_m"),
    }
    for ratio, name, share in (
        ("sent_per_cycle_b", "bytes_sent", 1 / len(rows)),
        ("received_per_cycle_b", "bytes_received", 1 / len(rows)),
        ("paper_per_cycle_b", "bytes_paper", 1.0),
    ):
        if cycles and all(row.get(name) is not None for row in rows):
            ratios[ratio] = sum(row[name] for row in rows) * share / cycles
    return means | ratios


def _gain_share(rows: list[dict], gain: str, total: str) -> float | None:
    known = [row for row in rows if row.get(gain) is not None and row.get(total) is not None]
    shortest = sum(row[total] - row[gain] for row in known)
    return sum(row[gain] for row in known) / shortest if known and shortest > 0 else None
