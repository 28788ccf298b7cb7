"""Share and evaluate: the two stages that a strategy replaces. The paper's four, and a place for a user's own."""

import math
from collections.abc import Callable
from typing import NamedTuple

import networkx as nx
import numpy as np
import torch

from mannbv import geometry, information, messages, network, objective
from mannbv.team.robots import Mission, Robot


def serve(robot: Robot, mission: Mission) -> np.ndarray:
    """F_i: gains (N, M) of every announced robot's view in this robot's map, Eqs. (23), (24); 0 for the unheard."""
    rows = np.zeros((len(mission.network), mission.config.n_yaws))
    known = sorted(robot.plans)
    positions = [np.asarray(robot.plans[k].position) for k in known]
    paths = [np.asarray(robot.plans[k].path) for k in known]
    rows[known] = objective.local(robot.belief(mission.config), mission.camera, positions, paths, mission.config)
    return rows


def serve_own(robot: Robot, mission: Mission) -> np.ndarray:
    """Only this robot's own view in what it holds: all of the objective that it can weigh alone."""
    return serve(robot.replace(plans={k: v for k, v in robot.plans.items() if k == robot.index}), mission)


def stay_silent(robots: list[Robot], mission: Mission, post: messages.Mailbox, cycle: int) -> list[Robot]:
    """single: nothing is sent."""
    return robots


def share_plans(robots: list[Robot], mission: Mission, post: messages.Mailbox, cycle: int) -> list[Robot]:
    """distributed: (T_i, P_i) to every teammate, relayed where the graph is not complete (Algorithm 1, line 5)."""
    return _flood(robots, [robot.plans.get(robot.index) for robot in robots], mission, post, cycle)


def share_guests(robots: list[Robot], mission: Mission, post: messages.Mailbox, cycle: int) -> list[Robot]:
    """limited: plans as above, then every robot sends each teammate the splats in the view it suggests to it."""
    robots = share_plans(robots, mission, post, cycle)
    for robot in robots:
        gains = serve(robot, mission)
        for k in sorted(set(robot.plans) - {robot.index}):
            guests = view_cone(robot, mission, robot.plans[k].position, best_yaw(gains[k]), cycle)
            post.relay(way(mission, robot.index, k), guests, cycle)
    return [_receive(robot, post) for robot in robots]


def share_maps(robots: list[Robot], mission: Mission, post: messages.Mailbox, cycle: int) -> list[Robot]:
    """centralized: plans, maps and grids to every teammate, so that each holds ⊔ G_i, Eq. (16); in 3-D but for what is
    too wide to be worth it."""
    robots = share_plans(robots, mission, post, cycle)
    fit = [r.local.select(worth_sharing(r, mission)) for r in robots]
    whole = [
        messages.Splats(r.index, cycle, m.splats, m.ids, m.prior, whole=1) for r, m in zip(robots, fit, strict=True)
    ]
    robots = _flood(robots, whole, mission, post, cycle)
    return _flood(robots, [messages.Grid.of(r.index, cycle, r.ground) for r in robots], mission, post, cycle)


def worth_sharing(robot: Robot, mission: Mission) -> torch.Tensor:
    """Which of its splats (n,) a robot sends: no wider than `share_scale`.

    What was seen from afar is wide. On the robot's own map it is all there is of a place; merged with a teammate's map,
    which may know that place better, it hangs like a haze before everything (measured in notebook 15).
    """
    widest = mission.config.share_scale or math.inf
    return robot.local.splats.scales.amax(1) <= widest


def view_cone(robot: Robot, mission: Mission, position: np.ndarray, yaw: float, cycle: int) -> messages.Splats:
    """This robot's splats in the view cone of a pose, the nearest first, at most `guest_splats`, with their prior."""
    camera, local = mission.camera, robot.local
    seen = geometry.yaw_pose(position, yaw).to(local.splats.means).local(local.splats.means)
    half = torch.tensor(camera.size) / 2 / camera.focal
    inside = (seen[:, -1] > 0) & (seen[:, :-1].abs() <= half * seen[:, -1:]).all(1) & worth_sharing(robot, mission)
    rows = torch.nonzero(inside)[:, 0]
    order = torch.argsort(torch.linalg.norm(seen[rows], dim=1), stable=True)
    rows = rows[order[: mission.config.guest_splats]]
    part = local.splats.select(rows)
    return messages.Splats(robot.index, cycle, part, local.ids[rows], local.prior[rows])


def best_yaw(gains: np.ndarray) -> float:
    """argmax f over uniform yaws [rad]."""
    return float(information.uniform_yaws(len(gains))[int(np.argmax(gains))])


def _flood(robots: list[Robot], notes: list, mission: Mission, post: messages.Mailbox, cycle: int) -> list[Robot]:
    """Every robot's note to all others, hop by hop; None where a robot has nothing to say."""
    for hop in network.hops(mission.network):
        for sender, receiver, origin in hop:
            if notes[origin] is not None:
                post.send(sender, receiver, notes[origin], cycle)
        robots = [_receive(robot, post) for robot in robots]
    return robots


def way(mission: Mission, sender: int, receiver: int) -> list[int]:
    """The robots that a message for one teammate passes, both ends included."""
    return nx.shortest_path(mission.network, sender, receiver)


def _receive(robot: Robot, post: messages.Mailbox) -> Robot:
    for _, message in post.collect(robot.index):
        if isinstance(message, messages.Plan):
            robot = robot.replace(plans={**robot.plans, message.robot: message})
        elif isinstance(message, messages.Splats):
            robot = robot.replace(guests=robot.guests.received(message))
        elif isinstance(message, messages.Grid):
            robot = robot.replace(heard={**robot.heard, message.robot: message.occupancy})
    return robot


class Strategy(NamedTuple):
    """share(robots, mission, post, cycle) → robots; evaluate(robot, mission) → gains (N, M); solver None: config's."""

    share: Callable
    evaluate: Callable
    solver: str | None


REGISTRY: dict[str, Strategy] = {
    "centralized": Strategy(share_maps, serve_own, "own"),  # (18) is separable: each takes its own best on ⊔ G_i
    "distributed": Strategy(share_plans, serve, None),
    "limited": Strategy(share_guests, serve, None),
    "single": Strategy(stay_silent, serve_own, "own"),
}
STRATEGIES = tuple(REGISTRY)


def register(name: str, share: Callable, evaluate: Callable, solver: str | None = None) -> None:
    """Add a strategy under a name that `episode.run` and the command line then understand (see `Strategy`).

    Raises ValueError if the name is one of the paper's four.
    """
    if name in STRATEGIES:
        raise ValueError(f"team: '{name}' is one of the paper's strategies; choose another name")
    REGISTRY[name] = Strategy(share, evaluate, solver)
