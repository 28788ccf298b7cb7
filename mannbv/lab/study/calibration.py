"""Does the predicted risk tell the true clearance? α of every announced waypoint, against what the world says of it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from mannbv.episode import Record
from mannbv.lab.study.resampling import Estimate, bootstrap, pearson, ranks, weighted_mean
from mannbv.lab.study.results import StudyError
from mannbv.world import World

KINDS = ("risk", "risk_inflated")  # of α in a `RobotLog`: σ of the splat alone, and widened by its mean's posterior


@dataclass(frozen=True)
class Forecasts:
    """Waypoints as they were announced: α (2, k) [m], by `KINDS`; true clearance (k,) [m]; robot (k,), its number.

    unknown: how many more have no α, for no splat counted yet.
    """

    alpha: Float[np.ndarray, "2 k"]
    clearance: Float[np.ndarray, " k"]
    robot: Int[np.ndarray, " k"]
    unknown: int = 0


@dataclass(frozen=True)
class Calibration:
    """Predicted α beside true clearance, for both kinds of α; every `Estimate` has an interval over robots.

    alpha, clearance, overconfident (2, b): in bins of as many waypoints each, ascending in that α: its mean [m], the
    mean true clearance [m], the share whose clearance is below α (of one Gaussian splat, 0.04 at the level 0.1).
    overall (2,): that share of all waypoints; bias (2,): the mean of α − clearance [m].
    rank (2,): Spearman's correlation of α with clearance. auc (t, 2): how often a waypoint with less than `thresholds`
    (t,) [m] of clearance has a smaller α than one with more, 0.5 by chance; dangerous (t,): how many there are.
    rank_gained (), auc_gained (t,): the second kind's less the first's.
    """

    forecasts: Forecasts
    alpha: Estimate
    clearance: Estimate
    overconfident: Estimate
    overall: Estimate
    bias: Estimate
    rank: Estimate
    rank_gained: Estimate
    thresholds: tuple[float, ...]
    dangerous: tuple[int, ...]
    auc: Estimate
    auc_gained: Estimate

    @property
    def n_robots(self) -> int:
        """How many robots, the units of the intervals; fewer than about twenty make these too short."""
        return len(np.unique(self.forecasts.robot))

    @property
    def better(self) -> str | None:
        """The kind of α that ranks clearances better, be it by ever so little (`rank_gained` says by how much); None
        where the interval of the difference holds 0."""
        if self.rank_gained.low > 0:
            return KINDS[1]
        return KINDS[0] if self.rank_gained.high < 0 else None


def calibration(
    records: Iterable[Record],
    world: World,
    rng: np.random.Generator | None = None,
    n_bins: int = 8,
    thresholds: Sequence[float] = (0.25, 0.35),
    draws: int = 1000,
) -> Calibration:
    """α against clearance for all announced waypoints of all robots and cycles of some records in one world.

    Paths avoid what looks dangerous, so this tells of waypoints that a planner chose, not of all places. rng: of the
    resampling, seeded with 0 if none is given. Raises StudyError for records of another scene, without forecasts, or
    without a waypoint.
    """
    return calibrate(forecasts(records, world), rng or np.random.default_rng(0), n_bins, thresholds, draws)


def forecasts(records: Iterable[Record], world: World) -> Forecasts:
    """What records foretold, and what the world says. One robot of one seed is one in all strategies: it has the same
    start and goal."""
    alpha, paths, robot, keys = [], [], [], {}
    for record in records:
        about = f"{record.scene}, {record.strategy}, seed {record.seed}"
        if record.scene != world.name:
            raise StudyError(f"calibration: {about}, is no episode in {world.name}; give the world that it ran in")
        for number, log in (pair for cycle in record.cycles for pair in enumerate(cycle.robots)):
            if log.risk is None or log.risk_inflated is None:
                raise StudyError(f"calibration: {about}, is an older record without forecasts; run it again")
            alpha += zip(log.risk, log.risk_inflated, strict=True)
            paths += log.path
            robot += [keys.setdefault((record.seed, number), len(keys))] * len(log.path)
    if not paths:
        raise StudyError("calibration: no waypoint was announced; give records of at least one cycle")
    values, robots = np.array(alpha, float), np.array(robot)
    known = np.isfinite(values).all(1)
    clearance = world.ground.clearance(np.array(paths, float)[known])
    return Forecasts(values[known].T, clearance, robots[known], int((~known).sum()))


def calibrate(
    waypoints: Forecasts,
    rng: np.random.Generator,
    n_bins: int = 8,
    thresholds: Sequence[float] = (0.25, 0.35),
    draws: int = 1000,
) -> Calibration:
    """`calibration` of forecasts from anywhere. Raises StudyError for fewer waypoints than bins."""
    k = waypoints.alpha.shape[1]
    if k < n_bins:
        raise StudyError(f"calibration: {k} waypoints cannot fill {n_bins} bins; give more records or fewer bins")
    limits = tuple(map(float, thresholds))
    # bins by order: all have as many, but for one
    place = np.argsort(np.argsort(waypoints.alpha, axis=1, kind="stable"), axis=1) * n_bins // k
    member = (place[:, None] == np.arange(n_bins)[:, None]).astype(float)  # (2, b, k)
    over = (waypoints.clearance < waypoints.alpha).astype(float)
    ranked, true_rank = [ranks(alpha) for alpha in waypoints.alpha], ranks(waypoints.clearance)
    danger = np.array([waypoints.clearance < limit for limit in limits]).reshape(-1, k)

    def binned(weights):
        shares = member * weights
        seen = waypoints.alpha[:, None], waypoints.clearance, over[:, None]
        return np.stack([weighted_mean(values, shares) for values in seen])

    def overall(weights):
        return np.stack([weighted_mean(over, weights), weighted_mean(waypoints.alpha - waypoints.clearance, weights)])

    def ranking(weights):
        true, low = true_rank(weights), [rank(weights) for rank in ranked]
        order = np.array([pearson(rank, true, weights) for rank in low])
        areas = np.array([[_auc(rank, bad, weights) for rank in low] for bad in danger]).reshape(-1, 2)
        return np.concatenate([_with_difference(order)[None], _with_difference(areas)])

    parts, whole, order = (bootstrap(f, waypoints.robot, rng, draws) for f in (binned, overall, ranking))
    return Calibration(
        waypoints, *_rows(parts), *_rows(whole),
        rank=_cut(order, np.s_[0, :2]), rank_gained=_cut(order, np.s_[0, 2]),
        thresholds=limits, dangerous=tuple(int(bad.sum()) for bad in danger),
        auc=_cut(order, np.s_[1:, :2]), auc_gained=_cut(order, np.s_[1:, 2]),
    )  # fmt: skip


def _auc(rank: np.ndarray, bad: np.ndarray, weights: np.ndarray) -> float:
    """Mann and Whitney's share of pairs, one bad and one not, in which the bad one ranks lower; ties count half."""
    safe = weights[~bad]
    pairs = safe.sum() * weights[bad].sum()
    return float((safe @ rank[~bad] - safe.sum() ** 2 / 2) / pairs) if pairs > 0 else np.nan


def _with_difference(pair: np.ndarray) -> np.ndarray:
    return np.concatenate([pair, pair[..., 1:] - pair[..., :1]], -1)


def _cut(estimate: Estimate, where) -> Estimate:
    return Estimate(*(part[where] for part in estimate))


def _rows(estimate: Estimate) -> list[Estimate]:
    return [_cut(estimate, k) for k in range(len(estimate.value))]
