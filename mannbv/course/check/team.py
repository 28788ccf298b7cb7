"""Exercises of notebook 12: messages in a round, the bytes of an ideal exchange, a strategy for weak radios."""

from collections.abc import Callable

import networkx as nx
import numpy as np

from mannbv import grid, information, mapping, messages, network, team, world
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.course.check.verdict import Fault, ask, compare, say

RADIO = 5.0  # [m] how far a weak radio reaches
# where five robots stand [m]: a chain 0-1-2, robot 3 out of reach, robot 4 at its goal near the chain; and their views
_PLACES = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 4.5], [9.0, 0.0], [1.0, 1.0]])
_VIEWS = np.array([[1.0, 1.0], [4.5, 0.0], [3.0, 3.5], [8.0, 0.0]])


def count(mine: Callable) -> bool:
    """my_messages(graph): how many `Copies` cross the links of a graph in one round of C-ADMM, as a real team sends."""

    def truth(graph):
        n, post = len(graph), messages.Mailbox(network=graph)
        gains = np.random.default_rng(0).random((n, n, 72))
        _, rounds = team.agree(_crew(np.zeros((n, 2))), gains, _mission(graph), post, 0, "cadmm")
        return post.ledger.messages() // len(rounds)

    mistakes = [
        (lambda graph: graph.number_of_edges(), "one message a link: who answers?"),
        (lambda graph: len(graph) * (len(graph) - 1), "as if everyone could hear everyone"),
        (lambda graph: len(graph), "one message a robot: how many must hear it?"),
        (lambda graph: len(graph) - 1, "these are the teammates of one robot"),
        (lambda graph: 2 * len(graph), "on a ring everyone has two neighbours; on other graphs?"),
        (lambda graph: 2 * (len(graph) - 1), "on a line; on other graphs?"),
        (lambda graph: 2 * graph.number_of_edges() * len(graph), "nobody passes copies on: they go to neighbours only"),
        (lambda graph: 2 * graph.number_of_edges() * Config().rounds, "these are all rounds; one is asked for"),
    ]
    graphs = [network.build(name, n) for name, n in (("complete", 3), ("line", 3), ("ring", 10), ("star", 5))]
    return compare(mine, truth, [(graph,) for graph in graphs], mistakes)


def exchange(mine: Callable) -> bool:
    """my_exchange(): the bytes of a view, as a 4 × 4 matrix, and one gain, in double precision [B]."""
    mistakes = [
        (lambda: 128, "that is the view alone; what does the teammate answer?"),
        (lambda: 17, "these are numbers; how many bytes has each?"),
        (lambda: 68, "that is single precision"),
        (lambda: 1088, "these are bits"),
        (lambda: 104, "the matrix travels whole, its last row too"),
        (lambda: 80, "a view in space is 4 × 4, not 3 × 3"),
        (lambda: 256, "one view and one gain: that is two views"),
        (lambda: 272, "one exchange: that is one each way"),
    ]
    return compare(mine, messages.ideal_exchange_bytes, [()], mistakes)


def share(mine: Callable) -> bool:
    """my_share(robots, mission, post, cycle): the share stage of weak radios; robots with the plans that they heard."""
    robots, post, mission = (
        _crew(_PLACES, len(_VIEWS)),
        messages.Mailbox(),
        _mission(network.build("complete", len(_PLACES))),
    )
    try:
        after = ask(mine, robots, mission, post, 0)
    except Fault as fault:
        return say(str(fault))
    if not isinstance(after, list) or [getattr(robot, "index", None) for robot in after] != list(range(len(robots))):
        return say(f"a list of all {len(robots)} robots is wanted back, in their order")
    fault = _sent_wrong(post.ledger) or _heard_wrong(after)
    return say(fault or "a weak radio: plans go as far as they are heard, and no farther", not fault)


def _sent_wrong(ledger: messages.Ledger) -> str:
    """What is wrong with the letters that were sent; "" for nothing."""
    sent = {key[:2] for key in ledger.rows}
    pairs = {(i, j) for i in range(len(_VIEWS)) for j in range(len(_PLACES)) if i != j}  # robot 4 plans nothing

    def near(places):
        return {(i, j) for i, j in pairs if max(i, j) < len(places) and np.linalg.norm(places[i] - places[j]) < RADIO}

    wanted = near(_PLACES)
    if set(ledger.by_kind()) - {"Plan"}:
        return "plans are to be shared, and nothing else"
    if any(sender != origin for sender, _, origin, *_ in ledger.rows):
        return "a plan is passed on: a weak radio speaks for its own robot only"
    if sent == wanted:
        return "" if ledger.messages() == len(wanted) else "a plan is sent to the same teammate more than once"
    for pattern, hint in [
        (set(), "nothing was sent: whatever does not go through the post is not counted either"),
        (pairs, "everyone hears everyone: how far does a weak radio reach?"),
        (pairs - wanted, "the wrong way round: only far teammates hear it"),
        (
            {(i, j) for i, j in wanted if j < len(_VIEWS)},
            "a robot at its goal plans nothing, but its map can still judge",
        ),
        (near(_VIEWS), "how far apart do the robots stand? their viewpoints are elsewhere"),
        (near(_VIEWS) | {(i, j) for i, j in wanted if j == 4}, "the robots' own places count, not their viewpoints"),
        ({(i, j) for i, j in wanted if i < j}, "each letter goes one way only: both robots of a pair have a plan"),
        ({(i, j) for i, j in wanted if i > j}, "each letter goes one way only: both robots of a pair have a plan"),
    ]:
        if sent == pattern:
            return hint
    if sent - wanted:
        i, j = min(sent - wanted)
        return (
            f"robot {i} cannot reach robot {j}, {np.linalg.norm(_PLACES[i] - _PLACES[j]):.1f} m away, but writes to it"
        )
    i, j = min(wanted - sent)
    return f"robot {i} does not write to robot {j}, {np.linalg.norm(_PLACES[i] - _PLACES[j]):.1f} m away"


def _heard_wrong(after: list[team.Robot]) -> str:
    """What is wrong with the plans that the robots hold after sharing; "" for nothing."""
    heard = [{j for j in range(len(_VIEWS)) if np.linalg.norm(_PLACES[i] - _PLACES[j]) < RADIO} for i in range(5)]
    known = [set(robot.plans) for robot in after]
    if known == heard:
        right = all(getattr(plan, "robot", None) == k for robot in after for k, plan in robot.plans.items())
        return "" if right else "plans are filed under the robot that made them"
    if all(plans <= {k} for k, plans in enumerate(known)):
        return "plans were sent, but nobody keeps what came: who collects it?"
    if any(k in wanted and k not in plans for k, (plans, wanted) in enumerate(zip(known, heard, strict=True))):
        return "a robot forgets its own plan when it hears others"
    k = next(k for k in range(5) if known[k] != heard[k])
    return (
        f"robot {k} {'knows a plan that it never heard' if known[k] - heard[k] else 'has lost a plan that it was sent'}"
    )


def _mission(graph: nx.Graph) -> team.Mission:
    config = Config(rounds=2)  # every round sends the same
    camera = Camera.of_dim(2, config.image_width, config.image_height, config.fov)
    return team.Mission(world.load("flat"), camera, config, graph, "distributed", seed=0)


def _crew(places: np.ndarray, planning: int = 0) -> list[team.Robot]:
    """Robots with empty maps at places (n, 2) [m]; the first `planning` of them have plans, for _VIEWS."""
    ground = grid.Occupancy.unknown(grid.Lattice((0.0, 0.0), 0.1, (4, 4)))
    local = mapping.LocalMap.empty(2, information.n_parameters(2))
    crew = []
    for k, place in enumerate(places):
        robot = team.Robot(k, place, 0.0, place + 1.0, local, ground, team.Guests.none(2), place[None])
        if k < planning:
            path = np.stack([place, _VIEWS[k]]).astype(np.float32)
            robot = robot.replace(plans={k: messages.Plan(k, 0, _VIEWS[k], 0.1 * k, path)})
        crew.append(robot)
    return crew
