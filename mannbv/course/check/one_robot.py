"""Checks of notebook 08: where to face, what was seen, what a detour cost, a paired comparison, a policy."""

import math
from collections.abc import Callable

import numpy as np

from mannbv import geometry, grid, metrics, network, team, world
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.course.check.verdict import Fault, ask, compare, say
from mannbv.lab import study


def facing(mine: Callable) -> bool:
    """Your yaw [rad] from a position (2,) to a target (2,), against the library's way to turn."""
    rng = np.random.default_rng(3)
    cases = [(rng.uniform(-5, 5, 2), rng.uniform(-5, 5, 2)) for _ in range(12)]

    def truth(a, b):
        return math.atan2(b[1] - a[1], b[0] - a[0])

    mistakes = [
        (lambda a, b: math.atan2(b[0] - a[0], b[1] - a[1]), "x and y: a yaw of 0 looks along x"),
        (lambda a, b: truth(b, a), "the sign: this turns its back on the target"),
        (lambda a, b: math.degrees(truth(a, b)), "the unit: this is in degrees"),
        (lambda a, b: truth(a, b) % (2 * math.pi), "the right direction, but yaws here run from −π to π"),
        (lambda a, b: math.atan((b[1] - a[1]) / (b[0] - a[0])), "a slope does not tell ahead from behind"),
        (lambda a, b: math.atan2(b[1], b[0]), "seen from the origin: and where is the robot?"),
    ]
    return compare(mine, truth, cases, mistakes)


def coverage(mine: Callable) -> bool:
    """Your share seen, a function of state (nx, ny) and reachable (nx, ny) bool, against `metrics.coverage`."""
    rng = np.random.default_rng(4)
    cases = []
    for shape in ((9, 7), (14, 20)):
        state = rng.choice([grid.UNKNOWN, grid.FREE, grid.OCCUPIED], size=shape, p=[0.4, 0.45, 0.15])
        cases.append((state, rng.random(shape) < 0.6))

    def truth(state, reachable):
        lattice = grid.Lattice((0.0, 0.0), 0.05, state.shape)
        evidence = np.select([state == grid.FREE, state == grid.OCCUPIED], [-1.0, 1.0], 0.0)
        return metrics.coverage(grid.Occupancy(lattice, evidence.astype(np.float32)), reachable, lattice)

    seen = lambda state: state != grid.UNKNOWN  # noqa: E731
    mistakes = [
        (lambda s, r: seen(s).mean(), "of all cells: but what lies behind the walls nobody can ever see"),
        (lambda s, r: (~seen(s))[r].mean(), "this is the share that is still unknown"),
        (lambda s, r: r[seen(s)].mean(), "divided by what was seen: of which cells do we want the share?"),
        (lambda s, r: (s == grid.FREE)[r].mean(), "a cell that was taken for occupied has been seen, too"),
        (lambda s, r: (seen(s) & r).sum(), "this is a number of cells, not a share"),
        (lambda s, r: (seen(s) & r).mean(), "of all cells: but what lies behind the walls nobody can ever see"),
    ]
    return compare(mine, truth, cases, mistakes)


def overhead(mine: Callable) -> bool:
    """Your path overhead, a function of trail (k, 2), goal (2,) and shortest (j, 2), against `metrics`."""
    rng = np.random.default_rng(5)
    cases, flat = [], world.load("flat")
    for _ in range(3):
        trail = 1 + np.cumsum(rng.uniform(0.0, 0.3, (20, 2)), axis=0)
        goal = trail[-1] + [0.1, 0.15]
        cases.append((trail, goal, np.stack([trail[0], goal])))

    def truth(trail, goal, shortest):
        return metrics.travel_scores(flat, trail, goal, shortest, True, 0)["path_overhead"]

    def length(path):
        return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())

    def rest(trail, goal):
        return float(np.linalg.norm(trail[-1] - goal))

    mistakes = [
        (lambda t, g, s: length(t) / length(s) - 1, "the robot stops a little before its goal: count the rest"),
        (lambda t, g, s: (length(t) + rest(t, g)) / length(s), "no detour at all should give 0"),
        (lambda t, g, s: length(t) / length(s), "no detour at all should give 0"),
        (lambda t, g, s: length(t) + rest(t, g) - length(s), "these are metres: it should be a share of the shortest"),
        (lambda t, g, s: 1 - length(s) / (length(t) + rest(t, g)), "a share of what? of the shortest way"),
        (lambda t, g, s: length(s) / (length(t) + rest(t, g)) - 1, "upside down: a longer trail should give more"),
        (lambda t, g, s: 100 * truth(t, g, s), "the unit: a share, not per cent"),
    ]
    return compare(mine, truth, cases, mistakes)


def paired(mine: Callable) -> bool:
    """Your (mean, half width of the 95 % interval) of the differences a − b (n,), against `study.interval`."""
    rng = np.random.default_rng(6)
    cases = []
    for n in (5, 12):
        common = rng.normal(10, 3, n)
        cases.append((common + rng.normal(0.5, 0.4, n), common + rng.normal(0.0, 0.4, n)))

    def truth(a, b):
        mean, (low, high) = study.interval(a - b)
        return mean, (high - low) / 2

    def factor(a, b):
        return truth(a, b)[1] / ((a - b).std(ddof=1) / math.sqrt(len(a)))

    def error(a, b, ddof=1):
        return (a - b).std(ddof=ddof) / math.sqrt(len(a))

    def apart(a, b):
        return math.sqrt((a.var(ddof=1) + b.var(ddof=1)) / len(a))

    def middle(a, b):
        return (a - b).mean()

    mistakes = [
        (lambda a, b: (-middle(a, b), truth(a, b)[1]), "the sign: a minus b"),
        (lambda a, b: (middle(a, b), 1.96 * error(a, b)), "so few runs: Student's t is wider than the normal's 1.96"),
        (lambda a, b: (middle(a, b), 2 * error(a, b)), "so few runs: Student's t is wider than 2"),
        (lambda a, b: (middle(a, b), error(a, b)), "that is the standard error: an interval is a few of them wide"),
        (lambda a, b: (middle(a, b), (a - b).std(ddof=1)), "that is how much one run varies, not the mean of n"),
        (lambda a, b: (middle(a, b), factor(a, b) * (a - b).std(ddof=1)), "one run's spread: means vary less, by √n"),
        (lambda a, b: (middle(a, b), factor(a, b) * apart(a, b)), "paired: what both runs share must cancel first"),
        (lambda a, b: (middle(a, b), factor(a, b) * error(a, b, 0)), "the spread of a sample: divide by n − 1"),
        (lambda a, b: (middle(a, b), 2 * truth(a, b)[1]), "the half width is wanted"),
    ]
    return compare(mine, truth, cases, mistakes)


def policy(mine: Callable) -> bool:
    """A policy of your own, robot and mission in, gains (1, n_yaws) out: one small episode in `flat` with it."""
    config = Config(image_width=32, fit_steps=6, stride=1.6, max_cycles=20)
    flat = world.load("flat")
    camera = Camera.of_dim(2, config.image_width, config.image_height, config.fov)
    mission = team.Mission(flat, camera, config, network.build("complete", 1), "single", seed=0)
    robot = team.start(0, flat.starts[0, :2], float(flat.starts[0, 2]), flat.goals[0], mission)
    for number in range(config.max_cycles):
        robot = team.plan(team.observe(robot, mission, number), mission, number)
        try:
            gains = _judged(ask(mine, robot, mission), config)
        except Fault as fault:
            return say(str(fault))
        yaw = geometry.wrap(-math.pi + 2 * math.pi * int(np.argmax(gains)) / config.n_yaws)
        robot = team.move(robot, yaw, mission, number)
        if robot.status == "reached":
            break
    reachable = flat.ground.reachable_free(config.cell, config.robot_radius, flat.starts[0])
    seen = metrics.coverage(robot.ground, reachable, flat.ground.lattice(config.cell))
    end = f"at its goal after {number + 1} cycles" if robot.status == "reached" else "not at its goal"
    return say(f"a policy: {end}, {seen:.0%} of the floor seen", True)


def _judged(gains, config: Config) -> np.ndarray:
    """The gains of a policy, (1, n_yaws). Raises Fault where they are none."""
    gains = np.asarray(gains, float)
    if gains.shape != (1, config.n_yaws):
        wanted = (1, config.n_yaws)
        raise Fault(f"shape {gains.shape} where {wanted} is wanted: a row for one robot, a value for each yaw")
    if not np.isfinite(gains).all():
        raise Fault("a gain must be finite")
    if np.ptp(gains) == 0:
        raise Fault("all yaws are worth the same to it, so it looks wherever the first yaw points")
    return gains
