"""Does flatland foretell 3-D? The same buildings, teams and strategies in both: their scores, and single views."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from mannbv import geometry, grid, information, mapping, objective
from mannbv.belief import Belief
from mannbv.camera import Camera, Frame
from mannbv.config import Config
from mannbv.episode import Record
from mannbv.lab.study.resampling import Estimate, bootstrap, pearson, ranks, weighted_mean
from mannbv.lab.study.results import Results, StudyError
from mannbv.lab.study.summary import per_seed
from mannbv.mapping import LocalMap
from mannbv.team import RobotLog
from mannbv.world import World

METRICS = (
    "total_risk_m", "total_risk_true_m", "psnr_db", "depth_mae_m", "path_overhead", "bytes_sent", "coverage",
)  # fmt: skip


@dataclass(frozen=True)
class Agreement:
    """How one score in flatland goes with the same score in 3-D.

    spearman, pearson (): over the n_cells cells (building, strategy, seed). order (): Kendall's τ-b of the strategies,
    by their means in a building, averaged over buildings; 1 where flatland ranks them as 3-D does. Intervals are over
    the n_units pairs of building and seed.
    """

    n_cells: int
    n_units: int
    spearman: Estimate
    pearson: Estimate
    order: Estimate


def reduced(
    flat_results: Results | Iterable[Results],
    space_results: Results | Iterable[Results],
    rng: np.random.Generator | None = None,
    draws: int = 1000,
) -> dict[str, Agreement]:
    """For every metric of `METRICS` that both have: does flatland foretell it?

    Contents of results.json, one or several, in the plane and in space; a building is a scene with a team size. Over
    cells much is owed to the buildings being different, `order` is free of that. rng: of the resampling, seeded with 0
    if none is given. Raises StudyError where both are of one dimension, results overlap, or nothing is shared.
    """
    flat, space = _cells(flat_results), _cells(space_results)
    if {dim for dim, _ in flat.values()} & {dim for dim, _ in space.values()}:
        raise StudyError("reduced: both results are of one dimension; give those of --dim 2 and of --dim 3")
    shared = [key for key in flat if key in space]
    if not shared:
        raise StudyError("reduced: no building, strategy and seed is in both; run the same compare with --dim 2 and 3")
    rng = rng or np.random.default_rng(0)
    units = list(dict.fromkeys((building, seed) for building, _, seed in shared))
    names = list(dict.fromkeys(strategy for _, strategy, _ in shared))
    found = {}
    for metric in METRICS:
        table = np.full((2, len(units), len(names)), np.nan)
        for building, strategy, seed in shared:
            both = [side[building, strategy, seed][1][metric] for side in (flat, space)]
            if None not in both:
                table[:, units.index((building, seed)), names.index(strategy)] = both
        if np.isfinite(table).any():
            found[metric] = _agreement(table, [building for building, _ in units], rng, draws)
    return found


def _cells(several: Results | Iterable[Results]) -> dict[tuple, tuple[int, dict]]:
    """(building, strategy, seed) → (dim, metric → mean over the team)."""
    cells = {}
    for results in [several] if isinstance(several, Results) else several:
        for strategy, seeds in per_seed(results.rows).items():
            for seed, means in seeds.items():
                key = (results.scene, results.robots), strategy, seed
                if key in cells:
                    about = f"{results.scene}, {strategy}, seed {seed}"
                    raise StudyError(f"reduced: {about}, is there twice; give results of one set of constants only")
                cells[key] = results.dim, means
    return cells


def _agreement(table: Float[np.ndarray, "2 u s"], buildings: list, rng, draws: int) -> Agreement:
    """Of a score of u units and s strategies in both worlds, nan where a cell is missing."""
    known = np.all(np.isfinite(table), axis=0)
    unit, _ = np.nonzero(known)
    a, b = table[:, known]
    ranked = ranks(a), ranks(b)
    groups = [np.flatnonzero([other == one for other in buildings]) for one in dict.fromkeys(buildings)]

    def statistics(weights):
        each = np.zeros(len(known))
        each[unit] = weights
        taus = np.array([_order(table[:, rows], each[rows]) for rows in groups])
        taus = taus[np.isfinite(taus)]
        return [
            pearson(ranked[0](weights), ranked[1](weights), weights),
            pearson(a, b, weights),
            taus.mean() if len(taus) else np.nan,
        ]

    found = bootstrap(statistics, unit, rng, draws)
    parts = [Estimate(*(part[k] for part in found)) for k in range(3)]
    return Agreement(len(a), len(np.unique(unit)), *parts)


def _order(table: np.ndarray, weights: np.ndarray) -> float:
    """Kendall's τ-b of the strategies' means in one building, over the seeds that know all of them."""
    table = table[:, :, np.isfinite(table).all(0).any(0)]
    weights = weights * np.isfinite(table).all((0, 2))
    if table.shape[2] < 2 or not weights.any():
        return np.nan
    means = weighted_mean(np.where(weights, np.nan_to_num(table).transpose(0, 2, 1), 0.0), weights)
    a, b = np.sign(means[:, :, None] - means[:, None])
    pairs = math.sqrt((a * a).sum() * (b * b).sum())
    return float((a * b).sum() / pairs) if pairs else np.nan


# ---- single views ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SameViews:
    """Views of 3-D episodes, weighed in 3-D and in flatland on maps from the same keyframe poses; one entry a view.

    robot, cycle (v,): whose, one number for a robot of one seed in all strategies, and when. correlation (v,):
    Pearson's, of both gains over all yaws. turn (v,): between the two best yaws [rad], π/2 in the mean by chance.
    share (v,): what flatland's best yaw gains in 3-D, of the best there; chance (v,): what a yaw drawn at random gains.
    mean (4,): of correlation, turn, share, and share − chance, with intervals over robots.
    """

    robot: Int[np.ndarray, " v"]
    cycle: Int[np.ndarray, " v"]
    correlation: Float[np.ndarray, " v"]
    turn: Float[np.ndarray, " v"]
    share: Float[np.ndarray, " v"]
    chance: Float[np.ndarray, " v"]
    mean: Estimate


def same_views(
    records: Record | Iterable[Record],
    flat_world: World,
    flat_config: Config | None = None,
    every: int = 3,
    rng: np.random.Generator | None = None,
    draws: int = 1000,
) -> SameViews:
    """The announced views of every third (`every`) cycle of 3-D records, and what flatland would have chosen there.

    Both maps grow again from a robot's keyframe poses up to that cycle: one from the record's frames, one from what a
    row of pixels sees of `flat_world`, the plan (or a space's `ground`). Guests take no part; masks are weighed on the
    ground as the robot knew it last. Raises StudyError for records without a view, or in another building.
    """
    found, numbers, flat_config = [], {}, flat_config or Config()
    for record in [records] if isinstance(records, Record) else records:
        if record.scene != flat_world.name:
            raise StudyError(
                f"same_views: the record is of {record.scene}, the plan is {flat_world.name}; give its own"
            )
        for robot in record.robots:
            number = numbers.setdefault((record.seed, robot.index), len(numbers))
            views = _Replay.of(record, robot.index, flat_world, flat_config).views(every)
            found += [(number, *view) for view in views]
    if not found:
        raise StudyError("same_views: no view has a gain in both worlds; give records of more cycles")
    robot, cycle, correlation, turn, share, chance = (np.array(column) for column in zip(*found, strict=True))
    columns = np.stack([correlation, turn, share, share - chance])
    mean = bootstrap(lambda w: weighted_mean(columns, w), robot, rng or np.random.default_rng(0), draws)
    return SameViews(robot, cycle, correlation, turn, share, chance, mean)


class _Mapper:
    """A map that grows by frames, and the gains of views in it."""

    def __init__(self, dim: int, config: Config):
        self.config = config
        self.camera = Camera.of_dim(dim, config.image_width, config.image_height, config.fov)
        self.local = LocalMap.empty(dim, information.n_parameters(dim))

    def observe(self, frame: Frame, rng: np.random.Generator) -> None:
        self.local = mapping.observe(self.local, self.camera, frame, self.config, rng)

    def gains(self, place, path, ground) -> np.ndarray | None:
        """Of all yaws at a place, within the mask of a path; None where the map has nothing there."""
        poses = [frame.pose for frame in self.local.keyframes]
        prior = information.prior(self.local.splats, self.camera, poses, **self.config.noise)
        belief = Belief(self.local.splats, prior, ground, len(poses))
        profile = objective.served(belief, self.camera, place, path, self.config)
        return None if profile is None or not profile.gains.any() else profile.gains


@dataclass
class _Replay:
    """One robot's episode once more, in 3-D and in flatland."""

    logs: tuple[RobotLog, ...]
    frames: list[Frame]  # not yet mapped
    ground: grid.Occupancy
    seed: list[int]  # of what `Mission.rng` draws
    flat_world: World
    space: _Mapper
    flat: _Mapper

    @staticmethod
    def of(record: Record, number: int, flat_world: World, flat_config: Config) -> "_Replay":
        robot = record.robots[number]
        return _Replay(
            record.logs(number), list(robot.local.keyframes), robot.belief().known, [record.seed, number],
            flat_world,
            _Mapper(robot.local.splats.dim, record.config),
            _Mapper(flat_world.dim, flat_config.replace(n_yaws=record.config.n_yaws)),
        )  # fmt: skip

    def views(self, every: int):
        """(cycle, correlation, turn, share, chance) of its views."""
        for cycle, log in enumerate(self.logs):
            if log.view is None:
                return
            self._observe(cycle)
            if cycle % every == 0:
                place, path = np.array(log.view), np.array(log.path)
                space = self.space.gains(place, path, self.ground)
                flat = self.flat.gains(place[:2], path[:, :2], self.ground)
                if space is not None and flat is not None:
                    yield cycle, *_compared(space, flat)

    def _observe(self, cycle: int) -> None:
        """Map what was taken before a cycle: at the start, or on the move of the cycle before."""
        config, seed = self.flat.config, (self.seed[0], cycle, self.seed[1])
        own, other = np.random.default_rng(seed), np.random.default_rng(seed)
        for _ in range(self._taken(cycle)):
            frame = self.frames.pop(0)
            self.space.observe(frame, own)
            pose = geometry.yaw_pose(frame.pose.position[:2], frame.pose.yaw)
            noise = config.depth_noise, config.color_noise
            self.flat.observe(self.flat_world.sense(self.flat.camera, pose, config.max_depth, *noise, other), other)

    def _taken(self, cycle: int) -> int:
        """How many frames: a look around, then the chosen view, and before it often one on arrival."""
        if cycle == 0:
            config = self.space.config
            return len(range(0, round(2 * math.pi / config.turn), max(1, int(config.fov / config.turn))))
        log = self.logs[cycle]
        for count in (2, 1):
            if len(self.frames) >= count:
                pose = self.frames[count - 1].pose
                turned = abs(geometry.wrap(pose.yaw - log.yaw))
                if np.allclose(pose.position.numpy(), log.position, atol=1e-6) and turned < 1e-6:
                    return count
        return 0


def _compared(space: np.ndarray, flat: np.ndarray) -> tuple[float, float, float, float]:
    """(correlation, turn, share, chance) of gains (M,) on the same yaws."""
    best, choice = int(np.argmax(space)), int(np.argmax(flat))
    turn = abs(geometry.wrap(2 * math.pi * (best - choice) / len(space)))
    top = space[best]
    return pearson(space, flat, np.ones(len(space))), turn, float(space[choice] / top), float(space.mean() / top)
