"""Exercises of notebook 08: where to face, what was seen, what a detour cost, a paired comparison, a policy."""

import functools
import math
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from mannbv import geometry, grid, metrics, network, objective, team, world
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.course.check.verdict import AGREES, ask, exercise, judged, plain
from mannbv.lab import study

_rng = np.random.default_rng(3)


def _yaw(a, b):
    return math.atan2(b[1] - a[1], b[0] - a[0])


@exercise(cases=[(_rng.uniform(-5, 5, 2), _rng.uniform(-5, 5, 2)) for _ in range(12)])
def facing(a, b):
    """my_facing(position (2,), target (2,)) → the yaw [rad] from one to the other."""
    return {
        AGREES: _yaw(a, b),
        "x and y: a yaw of 0 looks along x": math.atan2(b[0] - a[0], b[1] - a[1]),
        "the sign: this turns its back on the target": _yaw(b, a),
        "the unit: this is in degrees": math.degrees(_yaw(a, b)),
        "the right direction, but yaws here run from −π to π": _yaw(a, b) % (2 * math.pi),
        "a slope does not tell ahead from behind": math.atan((b[1] - a[1]) / (b[0] - a[0])),
        "seen from the origin: and where is the robot?": math.atan2(b[1], b[0]),
    }


def _state(shape: tuple[int, int]) -> tuple:
    kinds = [grid.UNKNOWN, grid.FREE, grid.OCCUPIED]
    return _rng.choice(kinds, size=shape, p=[0.4, 0.45, 0.15]), _rng.random(shape) < 0.6


def _coverage(state, reachable):
    lattice = grid.Lattice((0.0, 0.0), 0.05, state.shape)
    evidence = np.select([state == grid.FREE, state == grid.OCCUPIED], [-1.0, 1.0], 0.0)
    return metrics.coverage(grid.Occupancy(lattice, evidence.astype(np.float32)), reachable, lattice)


@exercise(cases=[_state((9, 7)), _state((14, 20))])
def coverage(state, reachable):
    """my_coverage(state (nx, ny), reachable (nx, ny) bool) → the share seen, as `metrics.coverage` counts it."""
    seen = state != grid.UNKNOWN
    return {
        AGREES: _coverage(state, reachable),
        "of all cells: but what lies behind the walls nobody can ever see": [seen.mean(), (seen & reachable).mean()],
        "this is the share that is still unknown": 1 - seen[reachable].mean(),
        "divided by what was seen: of which cells do we want the share?": reachable[seen].mean(),
        "a cell that was taken for occupied has been seen, too": (state == grid.FREE)[reachable].mean(),
        "this is a number of cells, not a share": (seen & reachable).sum(),
    }


@functools.cache
def _flat() -> world.World:
    return world.load("flat")


def _trail() -> tuple:
    trail = 1 + np.cumsum(_rng.uniform(0.0, 0.3, (20, 2)), axis=0)
    goal = trail[-1] + [0.1, 0.15]
    return trail, goal, np.stack([trail[0], goal])


@exercise(cases=[_trail() for _ in range(3)])
def overhead(trail, goal, shortest):
    """my_overhead(trail (k, 2), goal (2,), shortest (j, 2)) → the path overhead, as `metrics` counts it."""
    gone, least = (float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) for path in (trail, shortest))
    way = gone + float(np.linalg.norm(trail[-1] - goal))
    return {
        AGREES: metrics.travel_scores(_flat(), trail, goal, shortest, True, 0)["path_overhead"],
        "the robot stops a little before its goal: count the rest": gone / least - 1,
        "no detour at all should give 0": [way / least, gone / least],
        "these are metres: it should be a share of the shortest": way - least,
        "a share of what? of the shortest way": 1 - least / way,
        "upside down: a longer trail should give more": least / way - 1,
        "the unit: a share, not per cent": 100 * (way / least - 1),
    }


def _runs(n: int) -> tuple:
    common = _rng.normal(10, 3, n)
    return common + _rng.normal(0.5, 0.4, n), common + _rng.normal(0.0, 0.4, n)


@exercise(cases=[_runs(5), _runs(12)])
def paired(a, b):
    """my_paired(a (n,), b (n,)) → (mean, half width of the 95 % interval) of the differences a − b."""
    mean, ends = study.interval(a - b)
    assert ends is not None  # of several runs
    n, half, root, std = len(a), (ends[1] - ends[0]) / 2, math.sqrt(len(a)), np.std(a - b, ddof=1)
    return {
        AGREES: (mean, half),
        "the sign: a minus b": (-mean, half),
        "so few runs: Student's t is wider than the normal's 1.96": (mean, 1.96 * std / root),
        "so few runs: Student's t is wider than 2": (mean, 2 * std / root),
        "that is the standard error: an interval is a few of them wide": (mean, std / root),
        "that is how much one run varies, not the mean of n": (mean, std),
        "one run's spread: means vary less, by √n": (mean, half * root),
        "paired: what both runs share must cancel first":
            (mean, half / std * math.hypot(np.std(a, ddof=1), np.std(b, ddof=1))),
        "the spread of a sample: divide by n − 1": (mean, half * math.sqrt((n - 1) / n)),
        "the half width is wanted": (mean, 2 * half),
    }  # fmt: skip


def _own_view(robot, mission):
    plan = robot.plans[0]
    return objective.local(robot.belief(), mission.camera, [plan.position], [plan.path], mission.config)


@judged(
    truth=_own_view,
    mistakes=[
        (lambda robot, mission: robot.yaw,
         "shape {shape} where {wanted} is wanted: a row for one robot, a value for each yaw",
         lambda seen: seen.shape != seen.wanted),
        (lambda robot, mission: np.full((1, mission.config.n_yaws), np.nan), "a gain must be finite",
         lambda seen: not np.isfinite(seen.gains).all()),
        (lambda robot, mission: np.zeros((1, mission.config.n_yaws)),
         "all yaws are worth the same to it, so it looks wherever the first yaw points",
         lambda seen: np.ptp(seen.gains) == 0),
    ],
    praise="a policy: {end}, {share:.0%} of the floor seen",
)  # fmt: skip
def policy(mine: Callable) -> SimpleNamespace:
    """my_policy(robot, mission) → gains (1, n_yaws): a policy of your own, for a small episode in `flat`."""
    config = Config(image_width=32, fit_steps=6, stride=1.6, max_cycles=20)
    flat = _flat()
    camera = Camera.of_dim(2, config.image_width, config.image_height, config.fov)
    mission = team.Mission(flat, camera, config, network.build("complete", 1), "single", seed=0)
    robot = team.start(0, flat.starts[0, :2], float(flat.starts[0, 2]), flat.goals[0], mission)
    seen, number = SimpleNamespace(wanted=(1, config.n_yaws)), 0
    for number in range(config.max_cycles):
        robot = team.plan(team.observe(robot, mission, number), mission)
        seen.gains = plain(ask(mine, robot, mission))
        seen.shape = seen.gains.shape
        if seen.shape != seen.wanted or not np.isfinite(seen.gains).all() or np.ptp(seen.gains) == 0:
            return seen  # nothing to choose by
        yaw = geometry.wrap(-math.pi + 2 * math.pi * int(np.argmax(seen.gains)) / config.n_yaws)
        robot = team.move(robot, mission, yaw)
        if robot.status == "reached":
            break
    reachable = flat.ground.reachable_free(config.cell, config.robot_radius, flat.starts[0])
    seen.share = metrics.coverage(robot.ground, reachable, flat.ground.lattice(config.cell))
    seen.end = f"at its goal after {number + 1} cycles" if robot.status == "reached" else "not at its goal"
    return seen
