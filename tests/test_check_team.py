"""The checkers of notebook 12: right answers pass, and each plausible mistake hears the hint it deserves."""

import math

import numpy as np
import pytest

from mannbv import messages
from mannbv.course.check import team as check

AGREES = "agrees with the library"
DONE = "a weak radio: plans go as far"


def near(a, b):
    return math.dist(a.position, b.position) < 5


def viewpoints_near(a, b):
    return {a.index, b.index} <= {0, 1, 2, 3} and math.dist(place(a), place(b)) < 5


def place(robot):
    return robot.plans[robot.index].position


def radio(hears=near, times=1, keep=lambda robot, told: robot.plans | told, through_post=True):
    """A share stage: who hears whom, how often, what becomes of the plans."""

    def my_share(robots, mission, post, cycle):
        heard = {robot.index: {} for robot in robots}
        for robot in robots:
            for mate in robots:
                if robot.plans and mate is not robot and hears(robot, mate):
                    heard[mate.index] |= robot.plans
                    for _ in range(times * through_post):
                        post.send(robot.index, mate.index, robot.plans[robot.index])
        return [robot.replace(plans=keep(robot, heard[robot.index])) for robot in robots]

    return my_share


def misfiled(robot, told):
    plans = robot.plans | told
    return dict(zip(plans, reversed(plans.values()), strict=True))


def passed_on(robots, mission, post, cycle):
    robots = radio()(robots, mission, post, cycle)
    post.send(0, 1, robots[0].plans[1])
    return robots


def talkative(robots, mission, post, cycle):
    post.send(0, 1, messages.Copies(0, cycle, 0, np.zeros(len(robots))))
    post.collect(1)
    return radio()(robots, mission, post, cycle)


def plans_without_looking(robots, mission, post, cycle):
    return [robot.replace(plans={robot.index: robot.plans[robot.index]}) for robot in robots]


CASES = [
    (check.count, lambda graph: sum(degree for _, degree in graph.degree), AGREES),
    (check.count, lambda graph: graph.number_of_edges(), "who answers"),
    (check.count, lambda graph: len(graph) * (len(graph) - 1), "everyone could hear everyone"),
    (check.count, lambda graph: len(graph), "how many must hear it"),
    (check.count, lambda graph: len(graph) - 1, "teammates of one robot"),
    (check.count, lambda graph: 2 * len(graph), "on a ring"),
    (check.count, lambda graph: 2 * (len(graph) - 1), "on a line"),
    (check.count, lambda graph: 2 * graph.number_of_edges() * len(graph), "neighbours only"),
    (check.count, lambda graph: 60 * graph.number_of_edges(), "these are all rounds"),
    (check.exchange, lambda: 136, AGREES),
    (check.exchange, lambda: 4 * 4 * 8, "the view alone"),
    (check.exchange, lambda: 4 * 4 + 1, "how many bytes has each"),
    (check.exchange, lambda: (4 * 4 + 1) * 4, "single precision"),
    (check.exchange, lambda: (4 * 4 + 1) * 64, "these are bits"),
    (check.exchange, lambda: (3 * 4 + 1) * 8, "its last row"),
    (check.exchange, lambda: (3 * 3 + 1) * 8, "not 3 × 3"),
    (check.exchange, lambda: 2 * 4 * 4 * 8, "two views"),
    (check.exchange, lambda: 2 * (4 * 4 + 1) * 8, "one each way"),
    (check.share, radio(), DONE),
    (check.share, lambda robots, mission, post, cycle: robots, "nothing was sent"),
    (check.share, radio(through_post=False), "nothing was sent"),
    (check.share, radio(lambda a, b: True), "everyone hears everyone"),
    (check.share, radio(lambda a, b: not near(a, b)), "the wrong way round"),
    (check.share, radio(lambda a, b: near(a, b) and bool(b.plans)), "its map can still judge"),
    (check.share, radio(viewpoints_near), "their viewpoints are elsewhere"),
    (check.share, radio(lambda a, b: near(a, b) if b.index == 4 else viewpoints_near(a, b)), "not their viewpoints"),
    (check.share, radio(lambda a, b: near(a, b) and a.index < b.index), "one way only"),
    (check.share, radio(lambda a, b: near(a, b) and a.index > b.index), "one way only"),
    (check.share, radio(lambda a, b: math.dist(a.position, b.position) < 5.5), "cannot reach robot"),
    (check.share, radio(lambda a, b: math.dist(a.position, b.position) < 4.2), "does not write to robot"),
    (check.share, radio(times=2), "more than once"),
    (check.share, radio(keep=lambda robot, told: robot.plans), "who collects it"),
    (check.share, radio(keep=lambda robot, told: told), "forgets its own plan"),
    (check.share, radio(keep=misfiled), "filed under"),
    (check.share, passed_on, "passed on"),
    (check.share, talkative, "nothing else"),
    (check.share, plans_without_looking, "it stops with KeyError"),
    (check.share, lambda robots, mission, post, cycle: robots[::-1], "in their order"),
    (check.share, lambda robots, mission, post, cycle: 3, "a list of all 5 robots"),
]


@pytest.mark.parametrize(("checker", "mine", "words"), CASES)
def test_answers_get_the_verdict_that_they_deserve(capsys, checker, mine, words):
    agrees = checker(mine)
    said = capsys.readouterr().out.strip()
    assert words in said and len(said.splitlines()) == 1
    assert agrees is (words in (AGREES, DONE))


@pytest.mark.parametrize("checker", [check.count, check.exchange, check.share])
@pytest.mark.parametrize("nothing", [None, ...])
def test_an_empty_answer_is_still_to_do(capsys, checker, nothing):
    assert not checker(lambda *case: nothing)
    assert capsys.readouterr().out.strip() == "to do"
