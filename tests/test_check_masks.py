"""The checkers of notebook 05: the stored answers pass, plausible wrong ones get the right hint."""

import math

import numpy as np
import pytest
import torch
from scipy import ndimage

from mannbv import grid, mask
from mannbv.check import masks as check

AGREES = "agrees with the library"
KEEPS = "a mask radius"


def alpha(radius, r_min, beta1, beta2):
    return math.log(beta1 / (radius - r_min)) / beta2


def zone(reach):
    def select(splat_map, path, radii):
        away = torch.linalg.norm(splat_map.means[:, None] - path, dim=-1)
        return (away <= radii + reach(splat_map)[:, None]).any(1)

    return select


def walk(free, source, cell, structure=None):
    """Grown ring by ring."""
    distance, reached, step = np.full(free.shape, np.inf), np.zeros(free.shape, bool), 0.0
    reached[tuple(source)] = True
    while reached.any() and step <= free.size:
        distance[reached & np.isinf(distance)] = step * cell
        reached, step = reached | (ndimage.binary_dilation(reached, structure) & free), step + 1
    return distance


def straight(free, source, cell):
    x, y = np.indices(free.shape)
    return np.where(free, cell * np.hypot(x - source[0], y - source[1]), np.inf)


def corners(free, source, cell):
    return grid.geodesic(np.where(free, cell, np.inf), np.array([source]))


CASES = [
    (check.risk_of, alpha, AGREES),
    (check.risk_of, lambda *case: -alpha(*case), "a sign"),
    (check.risk_of, lambda r, r_min, b1, b2: alpha(r, 0.0, b1, b2), "left at α = ∞"),
    (check.risk_of, lambda r, r_min, b1, b2: alpha(r, r_min, 1.0, b2), "β₁"),
    (check.risk_of, lambda r, r_min, b1, b2: alpha(r, r_min, b1, 1.0), "β₂"),
    (check.risk_of, lambda r, r_min, b1, b2: alpha(r, r_min, b2, b1), "the rate"),
    (check.body, zone(lambda m: 2 * m.scales.amax(1)), AGREES),
    (check.body, mask.zone, "Eq. (11) itself"),
    (check.body, zone(lambda m: m.scales.amax(1)), "not one"),
    (check.body, zone(lambda m: 2 * m.scales.amin(1)), "narrow side"),
    (check.body, zone(lambda m: -2 * m.scales.amax(1)), "a sign"),
    (check.body, zone(lambda m: 2 * m.log_scales.amax(1)), "logarithms"),
    (check.body, zone(lambda m: 2 * m.scales.amax(1) ** 2), "not a variance"),
    (check.ahead, lambda m, path, ground: mask.proximity(m, path[:1], ground), AGREES),
    (check.ahead, lambda m, path, ground: mask.proximity(m, path, ground), "nearest of all"),
    (check.ahead, lambda m, path, ground: mask.proximity(m, path[-1:], ground), "at last"),
    (check.ahead, lambda m, path, ground: mask.proximity(m, path[:1]), "straight through"),
    (check.ahead, lambda m, path, ground: mask.proximity(m, path.mean(0)[None], ground), "no waypoint"),
    (check.walk, walk, AGREES),
    (check.walk, lambda free, source, cell: walk(free, source, 1), "counts cells"),
    (check.walk, corners, "over corners"),
    (check.walk, straight, "straight distance"),
    (check.walk, lambda free, source, cell: walk(np.ones_like(free), source, cell), "through walls"),
    (check.walk, lambda *case: np.where(case[0], walk(case[0] | True, *case[1:]), np.inf), "through walls"),
    (check.walk, lambda *case: np.nan_to_num(walk(*case), posinf=0.0), "infinitely far"),
    (check.bounded, lambda risk: 0.5 + 1.5 / (1 + math.exp(2 * risk)), KEEPS),
    (check.bounded, lambda risk: min(2.0, float(mask.radius(risk))), KEEPS),
    (check.bounded, lambda risk: mask.radius(risk), "larger than 2 m"),
    (check.bounded, lambda risk: 0.5 + 1.5 / (1 + math.exp(-2 * risk)), "a safer waypoint"),
    (check.bounded, lambda risk: 2.0 / (1 + math.exp(2 * risk)), "smaller than 0.5 m"),
    (check.bounded, lambda risk: 1.0, "hardly"),
    (check.bounded, lambda risk: float("nan"), "not finite"),
    (check.bounded, lambda risk: 1 / 0, "it stops with ZeroDivisionError"),
]


@pytest.mark.parametrize(("checker", "mine", "words"), CASES)
def test_answers_get_the_verdict_that_they_deserve(capsys, checker, mine, words):
    agrees = checker(mine)
    assert words in capsys.readouterr().out
    assert agrees is (words in (AGREES, KEEPS))


@pytest.mark.parametrize("checker", [check.risk_of, check.body, check.ahead, check.walk, check.bounded])
@pytest.mark.parametrize("nothing", [None, ...])
def test_an_empty_answer_is_still_to_do(capsys, checker, nothing):
    assert not checker(lambda *case: nothing)
    assert capsys.readouterr().out.strip() == "to do"
