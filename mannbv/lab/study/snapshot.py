"""What one cycle of an episode looked like from each robot's own map: the values that pictures show."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike

from mannbv import grid, objective, planner, risk
from mannbv.belief import Belief
from mannbv.config import Config
from mannbv.episode import Record
from mannbv.objective import Zone
from mannbv.team import CycleLog, Robot


@dataclass(frozen=True)
class RobotSnapshot:
    """One robot: what it believes, and what it planned and chose in a cycle.

    risk (nx, ny): α [m] over its known free ground, nan elsewhere. position (d,), path (k, d), view (d,) [m];
    announced, chosen: the yaw that it would take alone and the agreed one [rad]; zone: the mask of the path.
    suggestions: (teammate, yaw [rad], gain) of the teammates' best views for it. A robot at its goal plans nothing:
    path and suggestions are empty, view and zone None.
    """

    index: int
    belief: Belief
    risk: np.ndarray
    position: np.ndarray
    path: np.ndarray
    view: np.ndarray | None
    announced: float
    chosen: float
    zone: Zone | None
    suggestions: tuple[tuple[int, float, float], ...]


@dataclass(frozen=True)
class Snapshot:
    """A team in one cycle, numbered from 0."""

    cycle: int
    robots: tuple[RobotSnapshot, ...]


def midway(record: Record) -> int:
    """A telling cycle: two thirds through those in which the most robots were still on their way."""
    moving = np.array([sum(robot.status == "moving" for robot in log.robots) for log in record.cycles])
    if not len(moving):
        raise ValueError(f"study: the record of {record.scene} has no cycle yet; run it further")
    busiest = np.flatnonzero(moving == moving.max())
    return int(busiest[2 * (len(busiest) - 1) // 3])


def snapshot(record: Record, cycle: int | None = None) -> Snapshot:
    """Every robot's snapshot in a cycle (`midway` by default).

    A record keeps plans and choices of each cycle, but maps only as they are now: paths, masks and risk are those of
    that cycle's plan on today's maps. Raises ValueError for a cycle that the record does not have.
    """
    cycle = midway(record) if cycle is None else cycle
    if not 0 <= cycle < len(record.cycles):
        raise ValueError(f"study: the record has cycles 0 to {len(record.cycles) - 1}, not {cycle}")
    log = record.cycles[cycle]
    return Snapshot(cycle, tuple(_robot_snapshot(robot, log, record.config) for robot in record.robots))


def _robot_snapshot(robot: Robot, log: CycleLog, config: Config) -> RobotSnapshot:
    belief, own = robot.belief(config), log.robots[robot.index]
    path = np.array(own.path, float).reshape(-1, len(robot.position))
    suggestions = tuple((i, yaw, gain) for i, k, yaw, gain in log.suggestions if k == robot.index)
    return RobotSnapshot(
        index=robot.index,
        belief=belief,
        risk=ground_risk(belief, config, robot.position[2:]),
        position=np.array(own.position),
        path=path,
        view=None if own.view is None else np.array(own.view),
        announced=own.announced,
        chosen=own.chosen,
        zone=objective.zone(belief, path, config) if len(path) else None,
        suggestions=suggestions,
    )


def ground_risk(belief: Belief, config: Config, rest: ArrayLike = ()) -> np.ndarray:
    """α (nx, ny) [m] of the known free cells, Eq. (9), nan elsewhere; rest: the coordinates above the ground."""
    occupancy = belief.known
    free = occupancy.state == grid.FREE
    points = planner.raised(occupancy.lattice.centers(np.argwhere(free)), rest)
    alpha = np.full(free.shape, np.nan)
    alpha[free] = risk.along(belief.splats, torch.from_numpy(points), config).double().numpy()
    return alpha
