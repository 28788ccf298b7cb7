"""Exercises of notebook 12: messages in a round, the bytes of an ideal exchange, a strategy for weak radios."""

import functools
from collections.abc import Callable, Collection
from types import SimpleNamespace

import networkx as nx
import numpy as np

from mannbv import grid, information, mapping, messages, network, team, world
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.course.check.verdict import AGREES, Fault, ask, exercise, judged


def _robots(n: int, planning: int = 0) -> list[team.Robot]:
    """Robots with empty maps, the first `planning` of them with plans; robot 1 has heard of robot 0's already."""
    ground = grid.Occupancy.unknown(grid.Lattice((0.0, 0.0), 0.1, (4, 4)))
    local, nobody = mapping.LocalMap.empty(2, information.n_parameters(2)), team.Guests.none(2)
    places = np.stack([np.arange(float(n)), np.zeros(n)], 1)
    plans = [messages.Plan(k, 0, places[k] + 1.0, 0.1, places[k : k + 1].astype(np.float32)) for k in range(planning)]
    known = [{k: plans[k], **({0: plans[0]} if k == 1 else {})} if k < planning else {} for k in range(n)]
    return [
        team.Robot(k, places[k], 0.0, places[k], local, ground, nobody, places[:1], plans=known[k]) for k in range(n)
    ]


@functools.cache
def _mission(graph: nx.Graph) -> team.Mission:
    config = Config(rounds=2)  # every round sends the same
    camera = Camera.of_dim(2, config.image_width, config.image_height, config.fov)
    return team.Mission(world.load("flat"), camera, config, graph, "distributed", seed=0)


@functools.cache
def _sent(graph: nx.Graph) -> int:
    n, mailbox = len(graph), messages.Mailbox(network=graph)
    gains = np.random.default_rng(0).random((n, n, 72))
    robots = [robot.replace(choice=team.Choice(gains[robot.index])) for robot in _robots(n)]
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


_LINKS: nx.Graph = nx.Graph([(0, 1), (1, 2), (2, 3), (1, 4)])  # robot 4 is at its goal
_PAIRS = {(i, j) for i in range(4) for j in range(5) if i != j}
_WANTED = {(i, j) for i, j in _PAIRS if _LINKS.has_edge(i, j)}


def _among(pairs: Collection[tuple[int, int]], times: int = 1) -> Callable:
    """A phase in which the plans of these senders go to these receivers."""
    return lambda robot, mission: times * [(j, robot.plans[i]) for i, j in sorted(pairs) if i == robot.index]


def _own(robot):
    return {k: plan for k, plan in robot.plans.items() if k == robot.index}


def _letters(mine: Callable) -> Callable:
    """A phase whose letters are a list, also where it yields them."""

    def said(robot, mission):
        letters = mine(robot, mission)
        return letters if letters is None or letters is ... else [(receiver, message) for receiver, message in letters]

    return said


@judged(
    truth=_among(_WANTED),
    mistakes=[
        (lambda robot, mission: [(j, robot.plans[robot.index]) for j in _LINKS[robot.index]],
         "robot 4 is at its goal and has no plan of its own: then nothing is sent, and the list is empty",
         lambda seen: seen.stopped),
        (lambda robot, mission: [("all", plan) for plan in _own(robot).values()],
         "a receiver is a robot's number, or None for everybody", lambda seen: seen.strange),
        (lambda robot, mission: [(j, messages.Copies(robot.index, 0, 0, np.zeros(5))) for j in _LINKS[robot.index]],
         "plans are to be shared, and nothing else", lambda seen: seen.other),
        (lambda robot, mission: [(j, plan) for j in _LINKS[robot.index] for plan in robot.plans.values()],
         "a plan is passed on: a weak radio speaks for its own robot only", lambda seen: seen.passed_on),
        (_among(_WANTED, times=2), "a plan is sent to the same teammate more than once", lambda seen: seen.twice),
        (lambda robot, mission: [],
         "nothing was sent: a phase gives all that it sends, pairs of a receiver and a message",
         lambda seen: not seen.sent),
        (team.announce, "None is everybody, and the others pass it on: a weak radio reaches its neighbours only",
         lambda seen: any(j is None for _, j in seen.sent)),
        (_among(_PAIRS), "everyone hears everyone: how far does a weak radio reach?", lambda seen: seen.sent >= _PAIRS),
        (_among(_PAIRS - _WANTED), "the wrong way round: only those hear it to whom there is no link",
         lambda seen: seen.sent == _PAIRS - _WANTED),
        (_among({(i, j) for i, j in _WANTED if j < 4}),
         "a robot at its goal plans nothing, but its map can still judge",
         lambda seen: seen.sent == {(i, j) for i, j in _WANTED if j < 4}),
        (_among({(i, j) for i, j in _WANTED if i < j}),
         "each letter goes one way only: both robots of a pair have a plan",
         lambda seen: seen.sent == {(i, j) for i, j in _WANTED if i < j}),
        (_among({(i, i + 1) for i in range(4)} | {(i, i - 1) for i in range(1, 4)}),
         "robot {i} has no link to robot {j}, but writes to it", lambda seen: seen.sent - _WANTED),
        (_among(_WANTED - {(1, 2), (2, 3)}), "robot {i} does not write to robot {j}, a neighbour of it",
         lambda seen: _WANTED - seen.sent),
    ],
    praise="a weak radio: plans go one link far, and no farther",
)  # fmt: skip
def share(mine: Callable) -> SimpleNamespace:
    """my_share(robot, mission): the phase of weak radios: what a robot sends, pairs of a receiver and a message."""
    seen, letters = SimpleNamespace(stopped=False), []
    for robot in _robots(5, planning=4):
        try:
            letters += [(robot.index, *letter) for letter in ask(_letters(mine), robot, _mission(_LINKS))]
        except Fault:
            if robot.index < 4:
                raise
            seen.stopped = True
    seen.strange = [j for _, j, _ in letters if not (j is None or isinstance(j, int | np.integer))]
    seen.sent = set() if seen.strange else {(i, j) for i, j, _ in letters}
    seen.other = [message for *_, message in letters if not isinstance(message, messages.Plan)]
    seen.passed_on = not seen.other and any(i != plan.robot for i, _, plan in letters)
    seen.twice = len(letters) > len(seen.sent)
    if not any(j is None for _, j in seen.sent):
        seen.i, seen.j = min((seen.sent - _WANTED) or (_WANTED - seen.sent) or {(0, 0)})
    return seen
