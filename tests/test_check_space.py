"""The checkers of notebook 13: the stored answers pass, plausible wrong ones get the right hint."""

import math

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from mannbv.course.check import into_3d as check

AGREES = "agrees with the library"


def by_scipy(yaw):
    x, y, z, w = Rotation.from_euler("z", yaw).as_quat()
    return w, x, y, z


def about(axis):
    def answer(yaw):
        x, y, z, w = Rotation.from_euler(axis, yaw).as_quat()
        return w, x, y, z

    return answer


def body(m, low, high, cut):
    return [
        low <= z <= high and 1 / (1 + math.exp(-o)) > cut
        for (_, _, z), o in zip(m.means, m.opacity_logits, strict=True)
    ]


def band(column=2, low=None, high=None):
    def answer(m, lower, upper, cut):
        height = m.means[:, column]
        lower, upper = lower if low is None else low, upper if high is None else high
        return (height >= lower) & (height <= upper) & (m.opacities > cut)

    return answer


def splat(dim, turns=lambda d: d * (d - 1) / 2, opacity=1, color=3):
    return dim + dim + turns(dim) + opacity + color


CASES = [
    (check.quaternion, by_scipy, AGREES),
    (check.quaternion, lambda yaw: -np.array(by_scipy(yaw)), AGREES),  # the same rotation
    (check.quaternion, lambda yaw: torch.tensor([math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)]), AGREES),
    (check.quaternion, lambda yaw: (math.cos(yaw), 0, 0, math.sin(yaw)), "half of the angle"),
    (check.quaternion, lambda yaw: by_scipy(-yaw), "the wrong way"),
    (check.quaternion, lambda yaw: Rotation.from_euler("z", yaw).as_quat(), "the order here"),
    (check.quaternion, about("x"), "about x"),
    (check.quaternion, about("y"), "about y"),
    (check.quaternion, lambda yaw: by_scipy(math.radians(yaw)), "in radians already"),
    (check.quaternion, lambda yaw: by_scipy(math.degrees(yaw)), "of radians"),
    (check.quaternion, lambda yaw: (math.cos(yaw), math.sin(yaw)), "shape (2,) where (4,) is wanted"),
    (check.quaternion, lambda yaw: 2 * np.array(by_scipy(yaw)), "is too large for yaw = 0.4"),  # not of length 1
    (check.quaternion, lambda yaw: yaw, "shape () where (4,) is wanted"),
    (check.quaternion, lambda yaw: 1 / 0, "it stops with ZeroDivisionError"),
    (check.body, body, AGREES),
    (check.body, band(), AGREES),
    (check.body, band(1), "that is y"),
    (check.body, band(0), "that is x"),
    (check.body, band(low=-math.inf), "the floor still counts"),
    (check.body, band(high=math.inf), "the ceiling still counts"),
    (check.body, lambda m, low, high, cut: band()(m, low, high, -1), "hardly there"),
    (check.body, lambda m, low, high, cut: body(m, low, high, torch.sigmoid(torch.tensor(cut))), "logits"),
    (check.body, lambda m, low, high, cut: band()(m, low, high, -1) & (m.opacities < cut), "the faint ones"),
    (check.body, lambda m, low, high, cut: ~band()(m, low, high, -1) & (m.opacities > cut), "inside out"),
    (check.body, lambda m, low, high, cut: band()(m, low, high, cut).nonzero()[:, 0], "shape"),
    (check.body, lambda m, low, high, cut: band()(m, low + 0.4, high, cut), "should be chosen"),
    (check.body, lambda m, low, high, cut: band()(m, low, high + 0.5, cut), "should not be chosen"),
    (check.parameters, splat, AGREES),
    (check.parameters, lambda d: len(np.triu_indices(d)[0]) + d + 4, AGREES),  # Σ counted as a symmetric matrix
    (check.parameters, lambda d: splat(d, lambda d: {2: 2, 3: 4, 4: 7}[d]), "stored with a number more"),
    (check.parameters, lambda d: splat(d, color=0), "has it no colour"),
    (check.parameters, lambda d: splat(d, color=1), "a colour has three"),
    (check.parameters, lambda d: splat(d, opacity=0), "how opaque"),
    (check.parameters, lambda d: splat(d, lambda d: 0), "also be turned"),
    (check.parameters, lambda d: splat(d, lambda d: d), "right in space only"),
    (check.parameters, lambda d: splat(d, lambda d: d * (d + 1) / 2), "no plane with itself"),
    (check.parameters, lambda d: splat(d, lambda d: d * (d - 1)), "not two"),
    (check.parameters, lambda d: d + d**2 + 4, "symmetric"),
    (check.parameters, lambda d: {2: 9, 3: 13}[d], "it stops with KeyError"),
]


@pytest.mark.parametrize(("checker", "mine", "words"), CASES)
def test_answers_get_the_verdict_that_they_deserve(capsys, checker, mine, words):
    agrees = checker(mine)
    assert words in capsys.readouterr().out
    assert agrees is (words == AGREES)


@pytest.mark.parametrize("checker", [check.quaternion, check.body, check.parameters])
@pytest.mark.parametrize("nothing", [None, ...])
def test_an_empty_answer_is_still_to_do(capsys, checker, nothing):
    assert not checker(lambda *case: nothing)
    assert capsys.readouterr().out.strip() == "to do"
