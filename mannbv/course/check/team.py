"""Exercises of notebook 12: messages in a round, the bytes of an ideal exchange, a strategy for weak radios."""

import functools
import math
from collections.abc import Callable
from types import SimpleNamespace

import networkx as nx
import numpy as np

from mannbv import grid, information, mapping, messages, network, team, world
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.course.check.verdict import AGREES, Fault, ask, exercise, judged


@functools.cache
def _flat() -> world.World:
    return world.load("flat")


def _mission(graph: nx.Graph) -> team.Mission:
    config = Config(rounds=2)  # every round sends the same
    camera = Camera.of_dim(2, config.image_width, config.image_height, config.fov)
    return team.Mission(_flat(), camera, config, graph, "distributed", seed=0)


def _robots(places: np.ndarray, views: np.ndarray) -> list[team.Robot]:
    """Robots with empty maps at places (n, 2) [m]; the first ones have plans, for views (m, 2)."""
    ground = grid.Occupancy.unknown(grid.Lattice((0.0, 0.0), 0.1, (4, 4)))
    local = mapping.LocalMap.empty(2, information.n_parameters(2))
    robots = []
    for k, place in enumerate(places):
        robot = team.Robot(k, place, 0.0, place + 1.0, local, ground, team.Guests.none(2), place[None])
        if k < len(views):
            path = np.stack([place, views[k]]).astype(np.float32)
            robot = robot.replace(plans={k: messages.Plan(k, 0, views[k], 0.1 * k, path)})
        robots.append(robot)
    return robots


@functools.cache
def _sent(graph: nx.Graph) -> int:
    n, mailbox = len(graph), messages.Mailbox(network=graph)
    gains = np.random.default_rng(0).random((n, n, 72))
    robots = _robots(np.zeros((n, 2)), np.zeros((0, 2)))
    robots = [robot.replace(choice=team.Choice(gains[robot.index])) for robot in robots]
    _, rounds = team.agree(robots, _mission(graph), mailbox, "cadmm")
    return mailbox.ledger.messages() // len(rounds)


@exercise(cases=[(network.build(name, n),) for name, n in (("complete", 3), ("line", 3), ("ring", 10), ("star", 5))])
def count(graph):
    """my_messages(graph): how many `Copies` cross the links of a graph in one round of C-ADMM, as a real team sends."""
    return {
        AGREES: _sent(graph),
        "one message a link: who answers?": graph.number_of_edges(),
        "as if everyone could hear everyone": len(graph) * (len(graph) - 1),
        "one message a robot: how many must hear it?": len(graph),
        "these are the teammates of one robot": len(graph) - 1,
        "on a ring everyone has two neighbours; on other graphs?": 2 * len(graph),
        "on a line; on other graphs?": 2 * (len(graph) - 1),
        "nobody passes copies on: they go to neighbours only": 2 * graph.number_of_edges() * len(graph),
        "these are all rounds; one is asked for": 2 * graph.number_of_edges() * Config().rounds,
    }


@exercise(cases=[()])
def exchange():
    """my_exchange(): the bytes of a view, as a 4 × 4 matrix, and one gain, in double precision [B]."""
    return {
        AGREES: messages.ideal_exchange_bytes(),
        "that is the view alone; what does the teammate answer?": 128,
        "these are numbers; how many bytes has each?": 17,
        "that is single precision": 68,
        "these are bits": 1088,
        "the matrix travels whole, its last row too": 104,
        "a view in space is 4 × 4, not 3 × 3": 80,
        "one view and one gain: that is two views": 256,
        "one exchange: that is one each way": 272,
    }


_RADIO = 5.0  # [m] how far a weak radio reaches
# where five robots stand [m]: a chain 0-1-2, robot 3 out of reach, robot 4 at its goal near the chain; and their views
_PLACES = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 4.5], [9.0, 0.0], [1.0, 1.0]])
_VIEWS = np.array([[1.0, 1.0], [4.5, 0.0], [3.0, 3.5], [8.0, 0.0]])
_PAIRS = {(i, j) for i in range(4) for j in range(5) if i != j}  # robot 4 plans nothing


def _within(places: np.ndarray, reach: float = _RADIO) -> set[tuple[int, int]]:
    """Pairs (sender, receiver) of places less than a reach apart."""
    return {(i, j) for i, j in _PAIRS if max(i, j) < len(places) and math.dist(places[i], places[j]) < reach}


_WANTED = _within(_PLACES)
_HEARD = [{k} & {0, 1, 2, 3} | {i for i, j in _WANTED if j == k} for k in range(5)]


def _radio(hears: Callable | None = None, times=1, keep: Callable = lambda robot, told: robot.plans | told) -> Callable:
    """A share stage: who hears whom (two robots), how often, and what becomes of the plans."""
    hears = hears or (lambda a, b: (a.index, b.index) in _WANTED)

    def share(robots, mission, mailbox, cycle):
        heard = {robot.index: {} for robot in robots}
        for robot in (robot for robot in robots if robot.plans):
            for mate in robots:
                if mate is not robot and hears(robot, mate):
                    heard[mate.index] |= robot.plans
                    for _ in range(times):
                        mailbox.send(robot.index, mate.index, robot.plans[robot.index])
        return [robot.replace(plans=keep(robot, heard[robot.index])) for robot in robots]

    return share


def _among(pairs: set) -> Callable:
    return _radio(lambda a, b: (a.index, b.index) in pairs)


def _also(change: Callable) -> Callable:
    """A right share stage that does one thing more before."""

    def share(robots, mission, mailbox, cycle):
        change(robots, mailbox, cycle)
        return _radio()(robots, mission, mailbox, cycle)

    return share


def _misfiled(robot, told):
    plans = robot.plans | told
    return dict(zip(plans, reversed(plans.values()), strict=True))


_ONE_WAY = "each letter goes one way only: both robots of a pair have a plan"
_CHATTER = messages.Copies(0, 0, 0, np.zeros(5))


@judged(
    truth=_radio(),
    mistakes=[
        (_also(lambda robots, mailbox, cycle: mailbox.send(0, 1, _CHATTER)),
         "plans are to be shared, and nothing else", lambda seen: seen.other),
        (_also(lambda robots, mailbox, cycle: mailbox.send(0, 1, robots[1].plans[1])),
         "a plan is passed on: a weak radio speaks for its own robot only", lambda seen: seen.passed_on),
        (_radio(times=2), "a plan is sent to the same teammate more than once", lambda seen: seen.twice),
        (_radio(times=0), "nothing was sent: whatever does not go through the mailbox is not counted either",
         lambda seen: not seen.sent),
        (_among(_PAIRS), "everyone hears everyone: how far does a weak radio reach?",
         lambda seen: seen.sent == _PAIRS),
        (_among(_PAIRS - _WANTED), "the wrong way round: only far teammates hear it",
         lambda seen: seen.sent == _PAIRS - _WANTED),
        (_among({(i, j) for i, j in _WANTED if j < 4}),
         "a robot at its goal plans nothing, but its map can still judge",
         lambda seen: seen.sent == {(i, j) for i, j in _WANTED if j < 4}),
        (_among(_within(_VIEWS)), "how far apart do the robots stand? their viewpoints are elsewhere",
         lambda seen: seen.sent == _within(_VIEWS)),
        (_among(_within(_VIEWS) | {(i, j) for i, j in _WANTED if j == 4}),
         "the robots' own places count, not their viewpoints",
         lambda seen: seen.sent == _within(_VIEWS) | {(i, j) for i, j in _WANTED if j == 4}),
        (_among({(i, j) for i, j in _WANTED if i < j}), _ONE_WAY,
         lambda seen: seen.sent == {(i, j) for i, j in _WANTED if i < j}),
        (_among({(i, j) for i, j in _WANTED if i > j}), _ONE_WAY,
         lambda seen: seen.sent == {(i, j) for i, j in _WANTED if i > j}),
        (_among(_within(_PLACES, 5.5)), "robot {i} cannot reach robot {j}, {away:.1f} m away, but writes to it",
         lambda seen: seen.sent - _WANTED),
        (_among(_within(_PLACES, 4.2)), "robot {i} does not write to robot {j}, {away:.1f} m away",
         lambda seen: _WANTED - seen.sent),
        (_radio(keep=lambda robot, told: robot.plans), "plans were sent, but nobody keeps what came: who collects it?",
         lambda seen: all(plans <= {k} for k, plans in enumerate(seen.known))),
        (_radio(keep=lambda robot, told: told), "a robot forgets its own plan when it hears others",
         lambda seen: any(k not in seen.known[k] for k in range(4))),
        (_radio(keep=_misfiled), "plans are filed under the robot that made them",
         lambda seen: seen.k == "" and any(plan.robot != k for r in seen.after for k, plan in r.plans.items())),
        (_radio(keep=lambda robot, told: robot.plans | dict([*told.items()][:1])),
         "robot {k} has lost a plan that it was sent",
         lambda seen: seen.k != "" and seen.known[seen.k] < _HEARD[seen.k]),
        (_radio(keep=lambda robot, told: robot.plans | told | _robots(_PLACES, _VIEWS)[2].plans),
         "robot {k} knows a plan that it never heard", lambda seen: seen.k != ""),
        (lambda robots, mission, mailbox, cycle: robots[::-1],
         "a list of all 5 robots is wanted back, in their order"),
    ],
    praise="a weak radio: plans go as far as they are heard, and no farther",
)  # fmt: skip
def share(mine: Callable) -> SimpleNamespace:
    """my_share(robots, mission, mailbox, cycle): the share stage of weak radios; robots with the plans that they heard.

    Who sent what to whom in one share stage, and who holds which plans afterwards.
    """
    robots, mailbox = _robots(_PLACES, _VIEWS), messages.Mailbox()
    after = ask(mine, robots, _mission(network.build("complete", len(robots))), mailbox, 0)
    if not isinstance(after, list) or [getattr(robot, "index", None) for robot in after] != list(range(len(robots))):
        raise Fault(f"a list of all {len(robots)} robots is wanted back, in their order")
    rows, sent = mailbox.ledger.rows, {key[:2] for key in mailbox.ledger.rows}
    seen = SimpleNamespace(sent=sent, known=[set(robot.plans) for robot in after], after=after)
    seen.other = set(mailbox.ledger.by_kind()) - {"Plan"}
    seen.passed_on = any(sender != origin for sender, _, origin, *_ in rows)
    seen.twice = mailbox.ledger.messages() > len(sent)
    seen.i, seen.j = min((sent - _WANTED) or (_WANTED - sent) or {(0, 0)})
    seen.k = next((k for k in range(5) if seen.known[k] != _HEARD[k]), "")
    seen.away = math.dist(_PLACES[seen.i], _PLACES[seen.j])
    return seen
