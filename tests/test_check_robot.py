"""The checker of notebook 08: the stored answers agree, and each likely mistake hears the hint it deserves."""

import math

import numpy as np
import pytest
from scipy import stats

from mannbv import grid, objective
from mannbv.course.check import one_robot as check

AGREES = "agrees with the library"


def right_facing(position, target):
    return math.atan2(target[1] - position[1], target[0] - position[0])


def right_coverage(state, reachable):
    return (state[reachable] != grid.UNKNOWN).mean()


def length(path):
    return np.linalg.norm(np.diff(path, axis=0), axis=1).sum()


def right_overhead(trail, goal, shortest):
    return (length(trail) + np.linalg.norm(trail[-1] - goal)) / length(shortest) - 1


def right_paired(a, b):
    gap, n = a - b, len(a)
    return gap.mean(), stats.t.ppf(0.975, n - 1) * gap.std(ddof=1) / math.sqrt(n)


def unpaired(a, b):
    n = len(a)
    return (a - b).mean(), stats.t.ppf(0.975, n - 1) * math.sqrt((a.var(ddof=1) + b.var(ddof=1)) / n)


def chosen(robot, mission):
    belief, plan = robot.belief(), robot.plans[0]
    return objective.local(belief, mission.camera, [plan.position], [plan.path], mission.config)


CASES = [
    (check.facing, right_facing, AGREES),
    (check.facing, lambda position, target: None, "to do"),
    (check.facing, lambda p, t: math.atan2(t[0] - p[0], t[1] - p[1]), "x and y"),
    (check.facing, lambda p, t: math.degrees(right_facing(p, t)), "degrees"),
    (check.facing, lambda p, t: right_facing(t, p), "turns its back"),
    (check.coverage, right_coverage, AGREES),
    (check.coverage, lambda state, reachable: ..., "to do"),
    (check.coverage, lambda state, reachable: (state != grid.UNKNOWN).mean(), "of all cells"),
    (check.coverage, lambda state, reachable: (state[reachable] == grid.UNKNOWN).mean(), "still unknown"),
    (check.coverage, lambda state, reachable: reachable[state != grid.UNKNOWN].mean(), "divided by what was seen"),
    (check.overhead, right_overhead, AGREES),
    (check.overhead, lambda trail, goal, shortest: None, "to do"),
    (check.overhead, lambda trail, goal, shortest: length(trail) / length(shortest) - 1, "count the rest"),
    (check.overhead, lambda trail, goal, shortest: 1 + right_overhead(trail, goal, shortest), "should give 0"),
    (check.overhead, lambda trail, goal, shortest: 100 * right_overhead(trail, goal, shortest), "not per cent"),
    (check.paired, right_paired, AGREES),
    (check.paired, lambda a, b: None, "to do"),
    (check.paired, unpaired, "must cancel first"),
    (check.paired, lambda a, b: ((a - b).mean(), 1.96 * (a - b).std(ddof=1) / math.sqrt(len(a))), "Student's t"),
    (check.paired, lambda a, b: ((a - b).mean(), (a - b).std(ddof=1)), "how much one run varies"),
    (check.policy, chosen, "a policy: at its goal"),
    (check.policy, lambda robot, mission: None, "to do"),
    (check.policy, lambda robot, mission: np.zeros((1, mission.config.n_yaws)), "worth the same"),
    (check.policy, lambda robot, mission: robot.yaw, "a value for each yaw"),
    (check.policy, lambda robot, mission: np.full((1, mission.config.n_yaws), np.nan), "must be finite"),
]
RIGHT = (right_facing, right_coverage, right_overhead, right_paired, chosen)


@pytest.mark.parametrize(("checker", "answer", "words"), CASES)
def test_an_answer_hears_what_it_deserves(capsys, checker, answer, words):
    agrees = checker(answer)
    said = capsys.readouterr().out.strip()
    assert words in said and len(said.splitlines()) == 1
    assert agrees is (answer in RIGHT)
