"""The checkers of notebook 05: the stored answers pass, plausible wrong ones get the right hint."""

import math

import numpy as np
import pytest
import torch
from scipy import ndimage
from scipy.sparse.csgraph import dijkstra

from mannbv import grid, mask
from mannbv.course.check import masks as check

AGREES = "agrees with the library"
KEEPS = "a mask radius"
HOLDS = "Proposition 2 holds"


def solved(radius, r_min, beta1, beta2):
    return math.log(beta1 / (radius - r_min)) / beta2


def zone(reach):
    def select(splat_map, path, radii):
        away = torch.linalg.norm(splat_map.means[:, None] - path, dim=-1)
        return (away <= radii + reach(splat_map)[:, None]).any(1)

    return select


def in_all(splat_map, path, radii):
    away = torch.linalg.norm(splat_map.means[:, None] - path, dim=-1)
    return (away <= radii + 2 * splat_map.scales.amax(1)[:, None]).all(1)


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


def around(free, source, cell):
    """With indices modulo the shape: the nearest of nine copies of each cell."""
    nx, ny = free.shape
    tiled = walk(np.tile(free, (3, 3)), (source[0] + nx, source[1] + ny), cell)
    return np.min([tiled[i : i + nx, j : j + ny] for i in (0, nx, 2 * nx) for j in (0, ny, 2 * ny)], axis=0)


def diagonals(free, source, cell):
    """Over corners too, each such step its true length, even between two walls."""
    cells = np.argwhere(free)
    away = np.linalg.norm(cells[:, None] - cells, axis=-1)
    ways = dijkstra(np.where(away < 1.5, away, 0.0), indices=int((cells == source).all(1).argmax()))
    distance = np.full(free.shape, np.inf)
    distance[tuple(cells.T)] = cell * ways
    return distance


def corners(free, source, cell):
    return grid.geodesic(np.where(free, cell, np.inf), np.array([source]))


CASES = [
    (check.risk_of, solved, AGREES),
    (check.risk_of, lambda *case: -solved(*case), "a sign"),
    (check.risk_of, lambda r, r_min, b1, b2: solved(r, 0.0, b1, b2), "left at α = ∞"),
    (check.risk_of, lambda r, r_min, b1, b2: solved(r, r_min, 1.0, b2), "β₁"),
    (check.risk_of, lambda r, r_min, b1, b2: solved(r, r_min, b1, 1.0), "β₂"),
    (check.risk_of, lambda r, r_min, b1, b2: solved(r, r_min, b2, b1), "the rate"),
    (check.risk_of, lambda r, r_min, b1, b2: b2**2 * solved(r, r_min, b1, b2), "times, or over"),
    (check.risk_of, lambda r, r_min, b1, b2: math.log10(b1 / (r - r_min)) / b2, "natural logarithm"),
    (check.risk_of, lambda *case: max(0, solved(*case)), "may be negative"),
    (check.risk_of, lambda *case: solved(*case) + 1, "too large for 0.9, 0.5, 1, 2"),
    (check.body, zone(lambda m: 2 * m.scales.amax(1)), AGREES),
    (check.body, mask.zone, "Eq. (11) itself"),
    (check.body, zone(lambda m: m.scales.amax(1)), "not one"),
    (check.body, zone(lambda m: 2 * m.scales.amin(1)), "narrow side"),
    (check.body, zone(lambda m: -2 * m.scales.amax(1)), "a sign"),
    (check.body, zone(lambda m: 2 * m.log_scales.amax(1)), "logarithms"),
    (check.body, zone(lambda m: 2 * m.scales.amax(1) ** 2), "not a variance"),
    (check.body, zone(lambda m: 2 * m.scales.mean(1)), "the mean of"),
    (
        check.body,
        lambda m, path, radii: zone(lambda m: 2 * m.scales.amax(1))(m, path[:1], radii[:1]),
        "the first alone",
    ),
    (check.body, in_all, "one ball is enough"),
    (check.body, zone(lambda m: 9 * m.scales.amax(1)), "though it reaches into no ball"),
    (check.body, zone(lambda m: 1.2 * m.scales.amax(1)), "is missing in case 1"),
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
    (check.walk, lambda *case: walk(*case, structure=np.ones((3, 3))), "a diagonal step"),
    (check.walk, lambda free, source, cell: walk(free, source, cell) + cell, "away from itself"),
    (check.walk, lambda free, source, cell: walk(free, source, cell**2), "not m²"),
    (check.walk, diagonals, "a diagonal step led to the cell (1, 1)"),
    (check.walk, around, "over the opposite one"),
    (
        check.walk,
        lambda free, source, cell: walk(free, source, cell / 2),
        "too small at the cell (0, 1), seen from (0, 0)",
    ),
    (
        check.walk,
        lambda *case: np.nan_to_num(walk(*case), posinf=-1.0),
        "too near: no way leads from (0, 0) to the cell",
    ),
    (
        check.walk,
        lambda free, *rest: walk(free & (np.arange(len(free)) < 3)[:, None], *rest),
        "not infinitely far: a way",
    ),
    (check.walk, lambda free, source, cell: np.where(free, np.nan, np.inf), "not finite"),
    (check.bounded, lambda alpha: 0.5 + 1.5 / (1 + math.exp(2 * alpha)), KEEPS),
    (check.bounded, lambda alpha: min(2.0, float(mask.radius(alpha))), KEEPS),
    (check.bounded, lambda alpha: mask.radius(alpha), "larger than 2 m"),
    (check.bounded, lambda alpha: 0.5 + 1.5 / (1 + math.exp(-2 * alpha)), "a safer waypoint"),
    (check.bounded, lambda alpha: 2.0 if alpha < 0 else 0.5, HOLDS),
    (check.bounded, lambda alpha: [alpha, alpha], "one number"),
    (check.bounded, lambda alpha: 2.0 / (1 + math.exp(2 * alpha)), "smaller than 0.5 m"),
    (check.bounded, lambda alpha: 1.0, "hardly"),
    (check.bounded, lambda alpha: float("nan"), "not finite"),
    (check.bounded, lambda alpha: 1 / 0, "it stops with ZeroDivisionError"),
]


@pytest.mark.parametrize(("checker", "mine", "words"), CASES)
def test_answers_get_the_verdict_that_they_deserve(capsys, checker, mine, words):
    agrees = checker(mine)
    assert words in capsys.readouterr().out
    assert agrees is (words in (AGREES, KEEPS, HOLDS))


@pytest.mark.parametrize("checker", [check.risk_of, check.body, check.ahead, check.walk, check.bounded])
@pytest.mark.parametrize("nothing", [None, ...])
def test_an_empty_answer_is_still_to_do(capsys, checker, nothing):
    assert not checker(lambda *case: nothing)
    assert capsys.readouterr().out.strip() == "to do"
