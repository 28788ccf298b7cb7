"""What a strategy decides: the phases in which robots share, and how each evaluates; the paper's four and your own."""

import inspect
import math
import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from mannbv import consensus, geometry, information, messages, objective
from mannbv.config import Config
from mannbv.mapping import LocalMap
from mannbv.messages import Letter, Mailbox
from mannbv.team.exchange import Hear, Phase, exchange, hear
from mannbv.team.robots import Mission, Robot

Evaluate = Callable[[Robot, Mission], np.ndarray]


def serve(robot: Robot, mission: Mission) -> Float[np.ndarray, "robots yaws"]:
    """F_i: gains (N, M) of every announced robot's view in this robot's map, Eqs. (23), (24); 0 for the unheard."""
    rows = np.zeros((len(mission.network), mission.config.n_yaws))
    known = sorted(robot.plans)
    positions = [np.asarray(robot.plans[k].position) for k in known]
    paths = [np.asarray(robot.plans[k].path) for k in known]
    rows[known] = objective.local(robot.belief(mission.config), mission.camera, positions, paths, mission.config)
    return rows


def serve_own(robot: Robot, mission: Mission) -> Float[np.ndarray, "robots yaws"]:
    """Only this robot's own view in what it holds: all of the objective that it can weigh alone."""
    return serve(robot.replace(plans={k: v for k, v in robot.plans.items() if k == robot.index}), mission)


def announce(robot: Robot, mission: Mission) -> Iterable[Letter]:
    """(T_i, P_i) to every teammate, relayed where the graph is not complete (Algorithm 1, line 5)."""
    if robot.index in robot.plans:
        yield None, robot.plans[robot.index]


def send_guests(robot: Robot, mission: Mission) -> Iterable[Letter]:
    """limited: to each teammate the splats in the view that it suggests to it."""
    others = {k: plan for k, plan in sorted(robot.plans.items()) if k != robot.index}
    gains = serve(robot.replace(plans=others), mission)
    for k, plan in others.items():
        yield k, view_cone(robot, mission, plan.position, best_yaw(gains[k]))


def send_map(robot: Robot, mission: Mission) -> Iterable[Letter]:
    """centralized: its map, so that everyone holds ⊔ G_i, Eq. (16); in 3-D but for what is too wide to be worth it."""
    fit = robot.local.select(worth_sharing(robot, mission))
    yield None, messages.Splats(robot.index, robot.cycle, fit.splats, fit.ids, known(fit, mission.config), whole=1)


def send_grid(robot: Robot, mission: Mission) -> Iterable[Letter]:
    """centralized: what it knows of the ground."""
    yield None, messages.Grid.of(robot.index, robot.cycle, robot.ground)


def known(local: LocalMap, config: Config) -> Float[Tensor, "n p"]:
    """What a robot's views tell of its splats, as it is sent: where "+λI" belongs to every view, with that."""
    if config.damped == "prior":
        return local.prior
    return local.prior + len(local.keyframes) * information.damping(local.splats.dim, config)


def worth_sharing(robot: Robot, mission: Mission) -> Bool[Tensor, " n"]:
    """Which of its splats (n,) a robot sends: no wider than `share_scale`.

    What was seen from afar is wide. On the robot's own map it is all there is of a place; merged with a teammate's map,
    which may know that place better, it hangs like a haze before everything (measured in notebook 15).
    """
    widest = mission.config.share_scale or math.inf
    return robot.local.splats.scales.amax(1) <= widest


def view_cone(robot: Robot, mission: Mission, position: np.ndarray, yaw: float) -> messages.Splats:
    """This robot's splats in the view cone of a pose, the nearest first, at most `guest_splats`, with their prior."""
    camera, local = mission.camera, robot.local
    seen = geometry.yaw_pose(position, yaw).to(local.splats.means).local(local.splats.means)
    half = torch.tensor(camera.size) / 2 / camera.focal
    inside = (seen[:, -1] > 0) & (seen[:, :-1].abs() <= half * seen[:, -1:]).all(1) & worth_sharing(robot, mission)
    rows = torch.nonzero(inside)[:, 0]
    order = torch.argsort(torch.linalg.norm(seen[rows], dim=1), stable=True)
    rows = rows[order[: mission.config.guest_splats]]
    part = local.splats.select(rows)
    return messages.Splats(robot.index, robot.cycle, part, local.ids[rows], known(local, mission.config)[rows])


def best_yaw(gains: Float[np.ndarray, " yaws"]) -> float:
    """argmax f over uniform yaws [rad]."""
    return float(consensus.grid(len(gains))[int(np.argmax(gains))])


class Strategy(NamedTuple):
    """phases: what is shared, in turn; evaluate(robot, mission) → gains (N, M); solver None: the config's."""

    phases: tuple[Phase, ...]
    evaluate: Evaluate
    solver: str | None
    hear: Hear = hear
    all_at_once: Callable | None = None  # the form before there were phases: (robots, mission, mailbox, cycle) → robots


def share(robots: list[Robot], mission: Mission, mailbox: Mailbox, strategy: Strategy) -> list[Robot]:
    """Every robot after the phases of a strategy (Algorithm 1, lines 4-5)."""
    if strategy.all_at_once:
        robots = strategy.all_at_once(robots, mission, mailbox, robots[0].cycle)
    for phase in strategy.phases:
        robots = exchange(robots, phase, mission, mailbox, strategy.hear)
    return robots


REGISTRY: dict[str, Strategy] = {
    # (18) is separable: each takes its own best on ⊔ G_i
    "centralized": Strategy((announce, send_map, send_grid), serve_own, "own"),
    "distributed": Strategy((announce,), serve, None),
    "limited": Strategy((announce, send_guests), serve, None),
    "single": Strategy((), serve_own, "own"),
}
STRATEGIES = tuple(REGISTRY)


def solver_of(mission: Mission) -> str:
    """By which solver its robots agree."""
    return REGISTRY[mission.strategy].solver or mission.config.solver


def register(
    name: str, phases: Phase | Sequence[Phase], evaluate: Evaluate, solver: str | None = None, hear: Hear = hear
) -> None:
    """Add a strategy under a name that `episode.run` and the command line then understand.

    phases: one function or several, phase(robot, mission) → pairs of a receiver's number, or None for everybody, and a
    message. evaluate(robot, mission) → gains (N, M) of every robot's view on the M uniform yaws, such as `serve`.
    solver: a name in `consensus.SOLVERS`; None: the config's. hear(robot, message) → robot: what a robot makes of a
    message, by default as the paper's strategies do. Raises ValueError if the name is one of the paper's four.
    """
    if name in STRATEGIES:
        raise ValueError(f"team: '{name}' is one of the paper's strategies; choose another name")
    if callable(phases) and len(inspect.signature(phases).parameters) == 4:
        text = f"team: '{name}' shares in the old form, which sees all robots; write it as phases (see register)"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        REGISTRY[name] = Strategy((), evaluate, solver, hear, phases)
        return
    REGISTRY[name] = Strategy((phases,) if callable(phases) else tuple(phases), evaluate, solver, hear)
