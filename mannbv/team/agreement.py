"""Agree: from every robot's F_i to the team's yaws, by messages (Section V-C), and the views that robots suggest."""

from collections.abc import Iterable

import numpy as np
import torch

from mannbv import consensus, geometry, messages, network, objective
from mannbv.messages import Letter, Mailbox
from mannbv.team.exchange import each, exchange
from mannbv.team.robots import Choice, Mission, Robot
from mannbv.team.strategies import Evaluate, best_yaw, solver_of

# the solvers whose messages are really sent round by round
_ROUNDS = {  # primal, circle
    "cadmm": ("exact", True), "cadmm-gradient": ("gradient", True), "cadmm-stochastic": ("stochastic", True),
    "cadmm-literal": ("exact", False),
}  # fmt: skip


def evaluate(robot: Robot, mission: Mission, by: Evaluate) -> Robot:
    """With its F_i: Π_k of every trajectory that it heard of, on its own map, and their gains (Algorithm 1, line 6)."""
    return robot.replace(choice=Choice(by(robot, mission)))


def suggest(robot: Robot, mission: Mission) -> Iterable[Letter]:
    """To every teammate its best view by this robot's map, argmax f_ik (Fig. 2b).

    With it goes this robot's largest gain: the largest of all scales the team's objectives. Where the solver needs that
    scale, it also goes to those of whose view this robot's map says nothing, with a gain of 0.
    """
    gains, to_all = robot.deciding.gains, solver_of(mission) in _ROUNDS
    for k, row in enumerate(gains):
        if k != robot.index and (to_all or row.max() > 0):
            told = consensus.interpolate(row, [robot.plans[k].yaw])[0] if k in robot.plans else 0.0
            best = best_yaw(row), float(row.max())
            more = gradient(robot, mission, k) if mission.config.answers == "gradient" and k in robot.plans else ()
            yield k, messages.Suggestion(robot.index, robot.cycle, k, *best, float(told), float(gains.max()), more)


def gradient(robot: Robot, mission: Mission, k: int) -> np.ndarray:
    """Of the gain of robot k's announced view on this robot's map, by its pose (Section V-B)."""
    plan = robot.plans[k]
    pose = geometry.yaw_pose(torch.from_numpy(plan.position), plan.yaw)
    return objective.gradient(robot.belief(mission.config), mission.camera, pose, plan.path, mission.config).numpy()


def send_copies(robot: Robot, mission: Mission) -> Iterable[Letter]:
    """T^(i) to the neighbours (Algorithm 1, line 11)."""
    for sent in robot.deciding.state.outbox:
        yield sent.receiver, messages.Copies(robot.index, robot.cycle, sent.round, sent.offsets)


def send_profiles(robot: Robot, mission: Mission) -> Iterable[Letter]:
    """f_ik over all yaws, quantised, to every robot k."""
    for k, row in enumerate(robot.deciding.gains):
        if k != robot.index:
            levels, height = consensus.quantise(row)
            yield k, messages.Profile(robot.index, robot.cycle, k, height, levels)


def start(robot: Robot, mission: Mission, solver: consensus.CADMM) -> Robot:
    """Before the first round of C-ADMM: its own copies and the first primal update (27)."""
    choice, neighbours = robot.deciding, network.neighbours(mission.network, robot.index)
    announced = np.array([robot.plans[k].yaw if k in robot.plans else 0.0 for k in range(len(mission.network))])
    announced[robot.index] = robot.announced
    state = solver.start(robot.index, neighbours, announced, choice.gains, scale=choice.scale)
    return robot.replace(choice=choice.replace(agreement=state, yaw=state.yaw))


def step(robot: Robot, solver: consensus.CADMM) -> Robot:
    """z (28), dual (29) and the next primal update from the copies that came in this round."""
    choice = robot.deciding
    state = solver.step(choice.state, choice.copies)
    return robot.replace(choice=choice.replace(agreement=state, copies={}, yaw=state.yaw))


def take_best(robot: Robot) -> Robot:
    """The yaw with the largest sum of its own gain and the profiles that came."""
    choice, row = robot.deciding, robot.deciding.gains[robot.index].copy()
    for said in choice.profiles:
        row += consensus.restore(said.levels, said.height, len(row))
    yaw = consensus.best_yaws(row[None], [robot.announced])[0]
    return robot.replace(choice=choice.replace(yaw=float(yaw)))


def agree(
    robots: list[Robot], mission: Mission, mailbox: Mailbox, solver: str | None = None
) -> tuple[list[Robot], list[float]]:
    """Every robot with the yaw that it takes, `choice.yaw`, and the largest residual of each round.

    solver: a name in `consensus.SOLVERS`; None: the one of the mission's strategy.

    C-ADMM and the profile exchange really send their messages; a solver of another kind, such as the oracle, is handed
    the tables of all. A real team would run all T_ADMM rounds or spend one bit a message on stopping; here the rounds
    end when every robot's residuals are below the tolerance.
    """
    config, residuals, solver = mission.config, [], solver or solver_of(mission)
    numbers = consensus.Numbers(
        penalty=config.penalty, growth=config.penalty_growth, steps=config.primal_steps, rate=config.primal_rate
    )
    if solver in _ROUNDS:
        primal, circle = _ROUNDS[solver]
        seed = mission.seed, robots[0].cycle  # so that a resumed run draws the same numbers
        rule = consensus.CADMM(primal=primal, circle=circle, seed=seed, **numbers)
        robots = each(robots, start, mission, rule)
        while len(residuals) < config.rounds and not (residuals and residuals[-1] < config.tolerance):
            robots = each(exchange(robots, send_copies, mission, mailbox), step, rule)
            states = [robot.deciding.state for robot in robots]
            residuals.append(max(max(state.primal_residual, state.dual_residual) for state in states))
        return robots, residuals
    if solver == "profile":
        return each(exchange(robots, send_profiles, mission, mailbox), take_best), residuals
    gains, announced = np.stack([r.deciding.gains for r in robots]), [r.announced for r in robots]
    trace = consensus.solve(
        gains, mission.network, announced, solver, rounds=config.rounds, tolerance=config.tolerance,
        scale=consensus.scale_of(gains), **numbers,
    )  # fmt: skip
    taken = zip(robots, trace[-1].yaws, strict=True)
    return [robot.replace(choice=robot.deciding.replace(yaw=float(yaw))) for robot, yaw in taken], residuals
