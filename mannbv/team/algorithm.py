"""Algorithm 1, top to bottom: one planning cycle of the whole team.

Observe → fit → plan → share → evaluate → agree → move. A robot goes through each stage alone, from its own values to a
new record, and in `share` and `agree` through phases of messages, which the cycle alone delivers; after evaluate a map
is only carried forward.
"""

import math
import time

import numpy as np
import torch

from mannbv import information, objective, risk
from mannbv.config import Config
from mannbv.messages import Mailbox
from mannbv.team.agreement import agree, evaluate, suggest
from mannbv.team.exchange import each, exchange
from mannbv.team.log import CycleLog, RobotLog, Seconds, SuggestionLog
from mannbv.team.robots import Mission, Robot
from mannbv.team.stages import meet, move, observe, plan
from mannbv.team.strategies import REGISTRY, share


def cycle(robots: list[Robot], mission: Mission, mailbox: Mailbox, number: int) -> tuple[list[Robot], CycleLog]:
    """One planning cycle of the whole team (Algorithm 1): the robots after it, and the log of what happened."""
    strategy, clock = REGISTRY[mission.strategy], _Clock()
    robots = each(robots, observe, mission, number)  # "update G_i" of the cycle before, line 20
    clock.mark("map")
    robots = each(robots, plan, mission)  # T_i, P_i: the input, line 1
    forecasts = [_forecast(robot, mission.config) for robot in robots]
    clock.mark("plan")
    robots = each(share(robots, mission, mailbox, strategy), meet, mission)  # lines 4-5
    clock.mark("share")
    robots = each(robots, evaluate, mission, strategy.evaluate)  # Π_k on G_i, line 6, and with it F_i
    clock.mark("evaluate")
    robots = exchange(robots, suggest, mission, mailbox)
    robots, residuals = agree(robots, mission, mailbox)  # lines 3 and 8-17, T_i*, line 19
    clock.mark("agree")
    moved = each(robots, move, mission)  # line 20
    clock.mark("move")
    gains = np.stack([robot.deciding.gains for robot in robots])
    return moved, CycleLog(
        cycle=number,
        robots=tuple(map(_describe, robots, forecasts)),
        suggestions=_suggested(robots),
        residuals=tuple(residuals),
        team_gain=objective.team(gains, np.array([robot.deciding.yaw for robot in robots])),
        best_gain=objective.best(gains),
        own_gain=objective.team(gains, np.array([robot.announced for robot in robots])),
        seconds=Seconds(**clock.spent),
    )


def _describe(robot: Robot, forecast: tuple) -> RobotLog:
    view = robot.plans.get(robot.index)
    return RobotLog(
        position=tuple(robot.position.tolist()),
        yaw=robot.yaw,
        status=robot.status,
        splats=robot.local.splats.n_splats,
        guests=robot.guests.splats.n_splats,
        view=None if view is None else tuple(view.position.tolist()),
        announced=robot.announced,
        chosen=robot.deciding.yaw,
        path=() if view is None else tuple(map(tuple, view.path.tolist())),
        subgoals=() if robot.route is None else tuple(map(tuple, robot.route.candidates.tolist())),
        risk=forecast[0],
        risk_inflated=forecast[1],
    )


def _suggested(robots: list[Robot]) -> tuple[SuggestionLog, ...]:
    said = [note for robot in robots for note in robot.deciding.suggestions if note.gain > 0]
    return tuple(sorted(SuggestionLog(note.robot, note.target, note.yaw, note.gain) for note in said))


def _forecast(robot: Robot, config: Config) -> tuple[tuple, tuple]:
    """`RobotLog.risk` and `.risk_inflated`: of the announced waypoints on what the robot believed when it planned."""
    if robot.index not in robot.plans:
        return (), ()
    belief = robot.belief()
    path = torch.from_numpy(np.asarray(robot.plans[robot.index].path))
    times = belief.views if config.damped == "views" else 1
    posterior = information.mean_variances(belief.prior, times * information.damping(belief.splats.dim, config))
    own, inflated = (risk.along(belief.splats, path, config, wider) for wider in (None, posterior))
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
