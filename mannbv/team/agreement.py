"""Agree: from every robot's F_i to the team's yaws, by messages (Section V-C), and the views robots suggest."""

import numpy as np

from mannbv import consensus, messages, network
from mannbv.team.log import SuggestionLog
from mannbv.team.robots import Mission, Robot
from mannbv.team.strategies import best_yaw, way

# how `consensus.start` spells the solvers whose messages are really sent round by round
_ROUNDS = {"cadmm": {}, "cadmm-gradient": {"primal": "gradient"}, "cadmm-literal": {"circle": False}}


def agree(robots: list[Robot], gains: np.ndarray, mission: Mission, post: messages.Mailbox, cycle: int, solver: str):
    """Everyone's yaw (N,) [rad] from the stacked F_i (N, N, M), and the largest residual of each round.

    C-ADMM and the profile exchange really send their messages; any other solver is handed the tables.
    The scale of the gains is agreed first (one number a robot, in its suggestions). A real team would run all T_ADMM
    rounds or spend one bit a message on stopping; here the rounds end when every robot's residuals are below the
    tolerance.
    """
    config = mission.config
    announced = np.array([robot.announced for robot in robots])
    scale = consensus.scale_of(gains)
    settings = {"penalty": config.penalty, "growth": config.penalty_growth, "scale": scale}
    if solver not in _ROUNDS:
        if solver == "profile":
            _send_profiles(gains, mission, post, cycle)
        settings |= {"rounds": config.rounds, "tolerance": config.tolerance}
        return consensus.solve(gains, mission.network, announced, solver, **settings)[-1].yaws, []
    states = [
        consensus.start(i, network.neighbours(mission.network, i), announced, gains[i], **settings, **_ROUNDS[solver])
        for i in range(len(robots))
    ]
    residuals = []
    for turn in range(config.rounds):
        for state in states:
            for j in state.neighbours:
                post.send(state.robot, j, messages.Copies(state.robot, cycle, turn, state.copies), cycle)
        inboxes = [{sender: m.offsets for sender, m in post.collect(state.robot)} for state in states]
        states = [consensus.step(state, inbox) for state, inbox in zip(states, inboxes, strict=True)]
        residuals.append(max(max(state.primal_residual, state.dual_residual) for state in states))
        if residuals[-1] < config.tolerance:
            break
    return np.array([state.yaw for state in states]), residuals


def _send_profiles(gains: np.ndarray, mission: Mission, post: messages.Mailbox, cycle: int) -> None:
    for i, row in enumerate(gains):
        for k in range(len(gains)):
            if k != i:
                levels, height = consensus.quantise(row[k])
                post.relay(way(mission, i, k), messages.Profile(i, cycle, k, height, levels), cycle)
                post.collect(k)


def suggest(robots: list[Robot], gains: np.ndarray, mission: Mission, post: messages.Mailbox, cycle: int):
    """Everyone's best view for every teammate, argmax f_ik, sent to it (Fig. 2b); a list of `SuggestionLog`."""
    rows = []
    for robot in robots:
        largest = float(gains[robot.index].max())
        for k in sorted(set(robot.plans) - {robot.index}):
            row, yaw = gains[robot.index, k], best_yaw(gains[robot.index, k])
            if row.max() > 0:
                at_announced = consensus.interpolate(row, [robot.plans[k].yaw])[0]
                note = messages.Suggestion(robot.index, cycle, k, yaw, float(row.max()), float(at_announced), largest)
                post.relay(way(mission, robot.index, k), note, cycle)
                rows.append(SuggestionLog(robot.index, k, yaw, float(row.max())))
    for robot in robots:
        post.collect(robot.index)
    return rows
