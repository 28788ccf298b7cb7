"""Algorithm 1, top to bottom: one planning cycle of the whole team.

Observe → fit → plan → share → evaluate → agree → move. Each stage takes a robot's earlier values and what it received,
and returns a new record; after evaluate a map is only carried forward. Only share and agree communicate.
"""

import math
import time

import numpy as np
import torch

from mannbv import information, messages, objective, risk, splats
from mannbv.config import Config
from mannbv.team.agreement import agree, suggest
from mannbv.team.log import CycleLog, RobotLog, Seconds
from mannbv.team.robots import Mission, Robot
from mannbv.team.stages import move, observe, plan
from mannbv.team.strategies import REGISTRY


def cycle(robots: list[Robot], mission: Mission, post: messages.Mailbox, number: int) -> tuple[list[Robot], CycleLog]:
    """One planning cycle of the whole team (Algorithm 1): the robots after it, and the log of what happened."""
    strategy, clock = REGISTRY[mission.strategy], _Clock()
    robots = [observe(robot, mission, number) for robot in robots]  # "update G_i" of the cycle before, line 20
    clock.mark("map")
    robots = [plan(robot, mission, number) for robot in robots]  # T_i, P_i: the input, line 1
    forecasts = [_forecast(robot, mission.config) for robot in robots]
    clock.mark("plan")
    robots = strategy.share(robots, mission, post, number)  # lines 4-5
    clock.mark("share")
    gains = np.stack([strategy.evaluate(robot, mission) for robot in robots])  # Π_k on G_i, line 6, and with it F_i
    clock.mark("evaluate")
    suggestions = suggest(robots, gains, mission, post, number)
    solver = strategy.solver or mission.config.solver
    yaws, residuals = agree(robots, gains, mission, post, number, solver)  # lines 3 and 8-17, T_i*, line 19
    clock.mark("agree")
    moved = [move(robot, float(yaw), mission, number) for robot, yaw in zip(robots, yaws, strict=True)]  # line 20
    clock.mark("move")
    return moved, CycleLog(
        cycle=number,
        robots=tuple(map(_describe, robots, yaws, forecasts)),
        suggestions=tuple(suggestions),
        residuals=tuple(residuals),
        team_gain=objective.team(gains, yaws),
        best_gain=objective.best(gains),
        own_gain=objective.team(gains, np.array([robot.announced for robot in robots])),
        seconds=Seconds(**clock.spent),
    )


def _describe(robot: Robot, yaw: float, forecast: tuple) -> RobotLog:
    view = robot.plans.get(robot.index)
    return RobotLog(
        position=tuple(robot.position.tolist()),
        yaw=robot.yaw,
        status=robot.status,
        splats=robot.local.splats.n_splats,
        guests=robot.guests.splats.n_splats,
        view=None if view is None else tuple(view.position.tolist()),
        announced=robot.announced,
        chosen=float(yaw),
        path=() if view is None else tuple(map(tuple, view.path.tolist())),
        subgoals=() if robot.route is None else tuple(map(tuple, robot.route.candidates.tolist())),
        risk=forecast[0],
        risk_inflated=forecast[1],
    )


def _forecast(robot: Robot, config: Config) -> tuple[tuple, tuple]:
    """`RobotLog.risk` and `.risk_inflated`: of the announced waypoints on what the robot believed when it planned."""
    if robot.index not in robot.plans:
        return (), ()
    both = splats.union(robot.local.splats, robot.guests.splats)
    prior = torch.cat([robot.local.prior, robot.guests.prior])
    path = torch.from_numpy(np.asarray(robot.plans[robot.index].path))
    posterior = information.mean_variances(prior, information.damping(both.dim, config))
    own, inflated = risk.along(both, path, config), risk.along(both, path, config, posterior)
    return _known(own), _known(inflated)


def _known(values: torch.Tensor) -> tuple[float | None, ...]:
    """None where no splat counts."""
    return tuple(value if math.isfinite(value) else None for value in values.tolist())


class _Clock:
    """Seconds spent in each stage."""

    def __init__(self):
        self.spent, self._last = {}, time.perf_counter()

    def mark(self, stage: str) -> None:
        now = time.perf_counter()
        self.spent[stage], self._last = now - self._last, now
