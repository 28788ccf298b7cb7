"""The receding-horizon loop until every robot is at its goal, resumed from a file, and its scores (Section VI-A)."""

import dataclasses
import math
import numbers
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from mannbv import archive, metrics, network, team, world
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.episode.record import Record, RecordError, load
from mannbv.messages import Ledger, Mailbox
from mannbv.metrics import Row
from mannbv.team import Mission, Robot


def run(
    scene: world.World | str | Path,
    strategy: str,
    config: Config | None = None,
    seed: int = 0,
    n_robots: int = 5,
    path: str | Path | None = None,
    progress: Callable[[Record], None] | None = None,
) -> Record:
    """Run a team until every robot reached its goal, is stuck for good, or `max_cycles` are over; then score it.

    scene: a `world.World`, or what `world.load` takes. seed: which of the scene's start–goal pairs are used, the first
    yaws, the sensor noise. path: save the record there after each cycle, and resume from it if it is there.
    progress(record) is called after each cycle. Raises ValueError for an unknown strategy, too many robots, a start
    in a wall or a goal out of reach; RecordError if `path` holds another run.
    """
    config = config or Config()
    if strategy not in team.REGISTRY:
        raise ValueError(f"no strategy is called '{strategy}'; choose one of {', '.join(team.REGISTRY)}")
    for name, value, least in (("seed", seed, 0), ("number of robots", n_robots, 1)):
        if isinstance(value, bool) or not isinstance(value, numbers.Integral) or value < least:
            raise ValueError(f"episode: the {name} must be a whole number from {least}, got {value!r}")
    seed, n_robots = int(seed), int(n_robots)
    place = scene if isinstance(scene, world.World) else world.load(scene)
    place = draw_team(place, n_robots, seed, config)
    camera = Camera.of_dim(place.dim, config.image_width, config.image_height, config.fov)
    mission = Mission(place, camera, config, network.build(config.network, n_robots), strategy, seed)
    network.check(mission.network, n_robots)

    asked = (place.name, strategy, seed, config, n_robots)
    if path is not None and Path(path).exists():
        record = load(path)
        if (record.scene, record.strategy, record.seed, record.config, record.n_robots) != asked:
            raise RecordError(f"{path}: holds another run; choose another folder, or delete it to start afresh")
    else:
        robots = tuple(
            team.start(k, place.starts[k, :-1], float(place.starts[k, -1]), place.goals[k], mission)
            for k in range(n_robots)
        )
        record = Record(place.name, strategy, seed, config, (), robots, Ledger())
    while not record.finished:
        record = _advance(record, mission)
        if path is not None:
            record.save(path)
        if progress is not None:
            progress(record)
    return record


def draw_team(place: world.World, n_robots: int, seed: int, config: Config) -> world.World:
    """The scene with `n_robots` of its start–goal pairs, drawn by the seed, and random first yaws (in whole turns).

    Seed 0 takes the first pairs. Raises ValueError where the team cannot start or a goal is out of reach.
    """
    place = place.suited(config)
    rng = np.random.default_rng([seed, 2_147_483_647])  # a stream that no robot draws from
    pairs = min(len(place.starts), len(place.goals))
    order = np.arange(pairs) if seed == 0 else rng.permutation(pairs)
    starts, goals = place.starts[order].copy(), place.goals[order]
    turns = round(2 * math.pi / config.turn)
    if seed:
        starts[:, -1] += rng.integers(0, turns, len(starts)) * config.turn
    drawn = dataclasses.replace(place, starts=starts, goals=goals)
    drawn.check_team(n_robots, config.robot_radius, config.cell)
    return drawn


def _advance(record: Record, mission: Mission) -> Record:
    """One more cycle, or the end."""
    config, number = mission.config, len(record.cycles)
    settled = all(robot.status == "reached" or robot.stuck >= config.patience for robot in record.robots)
    if settled or number >= config.max_cycles:
        robots = tuple(team.observe(robot, mission, number) for robot in record.robots)
        record = dataclasses.replace(record, robots=robots)
        return dataclasses.replace(record, rows=score(record, mission), finished=True)
    mailbox = Mailbox(config.codec, record.ledger, mission.network)
    robots, log = team.cycle(list(record.robots), mission, mailbox, number)
    return dataclasses.replace(record, cycles=(*record.cycles, log), robots=tuple(robots), ledger=mailbox.ledger)


def score(record: Record, mission: Mission) -> tuple[Row, ...]:
    """A row of `results.json` for each robot; maps are scored as the strategy holds them, guests included."""
    place, config = mission.world, mission.config
    surfaces = metrics.true_surfaces(place)
    began = time.perf_counter()
    spent = sum(log.seconds.total for log in record.cycles)
    rows = []
    for robot in record.robots:
        belief = robot.belief(config)
        start, reached = robot.trail[0], robot.status == "reached"
        shortest = place.ground.shortest_path(start, robot.goal, config.robot_radius, config.cell)
        reachable = place.ground.reachable_free(config.cell, config.robot_radius, start)
        psnr, mae = metrics.view_quality(belief.splats, place, mission.camera, robot.trail, config)
        scores = {
            **metrics.travel_scores(place, robot.trail, robot.goal, shortest, reached, robot.collisions),
            **metrics.path_scores(belief, place, surfaces, start, robot.goal, shortest, config),
            **metrics.traffic(record.ledger, robot.index, record.strategy),
            "psnr_db": psnr, "depth_mae_m": mae,
            "coverage": metrics.coverage(belief.known, reachable, place.ground.lattice(config.cell)),
        }  # fmt: skip
        rows.append(Row(
            record.strategy, record.seed, robot.index, reached, **archive.plain(scores),
            cycles=sum(log.status != "reached" for log in record.logs(robot.index)),
            fate="reached" if reached else why_not(robot, config),
        ))  # fmt: skip
    seconds = spent + time.perf_counter() - began
    return tuple(dataclasses.replace(row, seconds=seconds) for row in rows)


def why_not(robot: Robot, config: Config) -> str:
    """What kept a robot from its goal."""
    if robot.stuck:
        return "no frontier left to go to"
    return f"{config.max_cycles} cycles were not enough, {np.linalg.norm(robot.goal - robot.position):.1f} m to go"
