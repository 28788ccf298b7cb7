"""Checks of notebook 07: frontiers, the price of a metre, the cost of a way, A*'s guess."""

import math
from collections.abc import Callable

import numpy as np
import torch

from mannbv import geometry, grid, planner, risk
from mannbv.config import Config
from mannbv.course.check.verdict import Fault, ask, compare, say
from mannbv.splats import SplatMap

_U, _F, _O = grid.UNKNOWN, grid.FREE, grid.OCCUPIED
_SIDES = ((1, 0), (-1, 0), (0, 1), (0, -1))
_CORNERS = ((1, 1), (1, -1), (-1, 1), (-1, -1))


def frontier(mine: Callable) -> bool:
    """Your frontier cells (nx, ny) bool of a state (nx, ny), against `grid.frontiers`."""
    rng = np.random.default_rng(7)
    states = [rng.choice([_U, _F, _O], size=shape, p=[0.3, 0.5, 0.2]) for shape in ((6, 9), (12, 5))]

    def truth(state):
        marks = np.zeros(state.shape, bool)
        for cells in grid.frontiers(state):
            marks[tuple(cells.T)] = True
        return marks

    mistakes = [
        (lambda s: (s == _U) & _beside(s == _F), "these are the unknown cells: a frontier is floor to stand on"),
        (lambda s: (s == _F) & _beside(s == _U, _SIDES + _CORNERS), "a corner is not enough: it must be beside it"),
        (lambda s: (s != _U) & _beside(s == _U), "walls too? nobody can stand there"),
        (lambda s: (s == _F) & _beside(s == _O), "beside a wall is where floor ends, not where knowledge does"),
        (lambda s: s == _F, "all the floor: and where does what is known end?"),
    ]
    return compare(mine, truth, [(state,) for state in states], mistakes)


def _beside(marked: np.ndarray, moves=_SIDES) -> np.ndarray:
    around = np.pad(marked, 1)
    nx, ny = marked.shape
    return np.any([around[1 + dx : 1 + dx + nx, 1 + dy : 1 + dy + ny] for dx, dy in moves], axis=0)


def price(mine: Callable) -> bool:
    """Your price of a metre at risk α, a function of (alpha, weight, scale), against the planner's."""
    alpha = np.array([-0.2, 0.0, 0.15, 0.4, 2.0])
    cases = [(alpha, 3.0, 0.3), (alpha, 10.0, 0.5), (alpha, 0.0, 0.3)]
    mistakes = [
        (lambda a, w, s: 1 + w * np.exp(a / s), "the sign: this way the safest metre is the dearest"),
        (lambda a, w, s: w * np.exp(-a / s), "far from everything a metre must still cost its length"),
        (lambda a, w, s: 1 + np.exp(-w * a / s), "the weight is in the exponent: with weight 0 no risk should count"),
        (lambda a, w, s: 1 + w * np.exp(-a * s), "the unit: an exponent has none, but metres times metres have"),
        (lambda a, w, s: 1 + w * np.exp(-a), "the scale is not used"),
        (
            lambda a, w, s: 1 + w * np.exp(-((a / s) ** 2)),
            "squared, a place beyond contact looks safe",
        ),
    ]
    return compare(mine, lambda a, w, s: 1 + w * np.exp(-a / s), cases, mistakes)


def cost(mine: Callable) -> bool:
    """Your cost of a way, a function of price (nx, ny) and cells (k, 2), against `grid.geodesic`."""
    rng = np.random.default_rng(8)
    cases = []
    for shape in ((7, 9), (12, 6)):
        prices = rng.uniform(1, 5, shape)
        cases.append((prices, grid.path(prices, (0, 0), np.array(shape) - 1)))

    def truth(prices, cells):
        return grid.geodesic(prices, cells[0])[tuple(cells[-1])]

    def legs(cells):
        return np.linalg.norm(np.diff(cells, axis=0), axis=1)

    def at(prices, cells):
        return prices[tuple(cells.T)]

    mistakes = [
        (lambda p, c: ((at(p, c)[1:] + at(p, c)[:-1]) / 2).sum(), "a diagonal step is longer than a straight one"),
        (lambda p, c: (at(p, c)[1:] * legs(c)).sum(), "half of each step lies in the cell that it leaves"),
        (lambda p, c: (at(p, c)[:-1] * legs(c)).sum(), "half of each step lies in the cell that it enters"),
        (lambda p, c: at(p, c).sum(), "this adds up cells: a way is made of the steps between them"),
        (lambda p, c: legs(c).sum(), "this is its length: the price is not in it"),
        (lambda p, c: ((at(p, c)[1:] + at(p, c)[:-1]) * legs(c)).sum(), "the mean of two prices, not their sum"),
    ]
    return compare(mine, truth, cases, mistakes)


def guess(mine: Callable) -> bool:
    """Your guess for A*, a function of price (nx, ny), cell (2,) and goal (2,), against the one of the library."""
    rng = np.random.default_rng(9)
    cases = []
    for low in (1.0, 0.4):
        prices = rng.uniform(low, 5, (20, 15))
        prices[8, 3:] = np.inf
        cases.append((prices, np.array([2, 1]), np.array([17, 12])))

    def finite(prices):
        return prices[np.isfinite(prices)]

    def straight(a, b):
        return math.hypot(*(np.asarray(a) - np.asarray(b)))

    mistakes = [
        (lambda p, a, b: straight(a, b), "that is a distance in cells: the guess is a cost, so what is a cell worth?"),
        (lambda p, a, b: finite(p).mean() * straight(a, b), "more than the truth may be: cheap cells may lie ahead"),
        (lambda p, a, b: finite(p).max() * straight(a, b), "the dearest cell promises too much: is it on the way?"),
        (
            lambda p, a, b: p.min() * np.abs(a - b).sum(),
            "more than the truth may be: a robot may go diagonally",
        ),
        (lambda p, a, b: 0.0, "never wrong, but it guides nobody: this is Dijkstra"),
    ]
    return compare(mine, lambda p, a, b: p.min() * straight(a, b), cases, mistakes)


def own_price(mine: Callable) -> bool:
    """Any price of your own, a function of α (k,) [m]: what it buys in a hall with a gap and a way around it."""
    level = np.linspace(-0.3, 3.0, 34)
    try:
        with np.errstate(all="ignore"):
            answer = ask(mine, level)
    except Fault as fault:
        return say(str(fault))
    answer = np.asarray(answer, float)
    if answer.shape != level.shape:
        return say(f"shape {answer.shape} where {level.shape} is wanted: one price for each α")
    if not (np.isfinite(answer).all() and (answer > 0).all()):
        return say("a price must be finite and above 0: else A* wanders for free, or finds no way at all")
    if (np.diff(answer) > 1e-9).any():
        return say("the sign: somewhere a safer metre is dearer than a more dangerous one")
    if answer[0] <= answer[-1] * (1 + 1e-9):
        return say("the same price everywhere: A* then looks for the shortest way, whatever the risk")
    shortest, bought = _hall(lambda alpha: np.ones_like(alpha)), _hall(mine)
    longer, safer = bought[0] - shortest[0], bought[1] - shortest[1]
    if safer < 0.02:
        return say("a fair price, but nobody changes the way for it: let danger cost more")
    return say(f"a price: {longer:.1f} m of detour for {safer:.2f} m of AV@R", True)


def _hall(rule: Callable) -> tuple[float, float]:
    """Length and total AV@R [m] of the cheapest way past a wall with a narrow gap near, a wide one far."""
    lattice = grid.Lattice((0.0, 0.0), 0.1, (60, 40))
    y = np.concatenate([np.arange(0.0, 1.0, 0.05), np.arange(1.4, 2.4, 0.05)])
    means = torch.tensor(np.stack([np.full(len(y), 3.0), y], 1), dtype=torch.float32)
    n = len(means)
    rotations = geometry.identity_rotations(n, 2)
    wall = SplatMap(means, torch.full((n, 2), math.log(0.03)), rotations, torch.full((n,), 2.0), torch.zeros(n, 3))
    config = Config()
    points = torch.from_numpy(lattice.centers().reshape(-1, 2))
    alpha = risk.field(wall, points, config.level).double().numpy()
    with np.errstate(all="ignore"):
        prices = np.asarray(rule(alpha), float).reshape(lattice.shape)
    prices[alpha.reshape(lattice.shape) < 0.05] = np.inf
    way = planner.safe_path(prices, lattice, np.array([0.55, 1.2]), np.array([5.45, 1.2]))
    return float(planner.lengths(way)[-1]), risk.total(wall, torch.from_numpy(way), config.level)
