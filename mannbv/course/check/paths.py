"""Exercises of notebook 07: frontiers, the price of a metre, the cost of a way, A*'s guess."""

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Literal

import numpy as np
import torch

from mannbv import geometry, grid, planner, risk
from mannbv.config import Config
from mannbv.course.check.verdict import AGREES, Fault, ask, exercise, judged, plain
from mannbv.splats import SplatMap

_SIDES = ((1, 0), (-1, 0), (0, 1), (0, -1))
_CORNERS = ((1, 1), (1, -1), (-1, 1), (-1, -1))


def _beside(marked: np.ndarray, moves=_SIDES, edge: Literal["constant", "edge", "wrap"] = "constant") -> np.ndarray:
    around = np.pad(marked, 1, mode=edge)
    nx, ny = marked.shape
    return np.any([around[1 + dx : 1 + dx + nx, 1 + dy : 1 + dy + ny] for dx, dy in moves], axis=0)


_rng = np.random.default_rng(7)
_KINDS = [grid.UNKNOWN, grid.FREE, grid.OCCUPIED]


@exercise(cases=[(_rng.choice(_KINDS, size=shape, p=[0.3, 0.5, 0.2]),) for shape in ((6, 9), (12, 5))])
def frontier(state):
    """my_frontier(state (nx, ny)) → which cells (nx, ny) are frontier cells, bool."""
    unknown, floor, wall = (state == kind for kind in _KINDS)
    marks = np.zeros(state.shape, bool)
    for cells in grid.frontiers(state):
        marks[tuple(cells.T)] = True
    return {
        AGREES: marks,
        "these are the unknown cells: a frontier is floor to stand on": unknown & _beside(floor),
        "a corner is not enough: it must be beside it": floor & _beside(unknown, _SIDES + _CORNERS),
        "walls too? nobody can stand there": ~unknown & _beside(unknown),
        "beside a wall is where floor ends, not where knowledge does": floor & _beside(wall),
        "all the floor: and where does what is known end?": floor,
        "over the edge: to np.roll the last row is a neighbour of the first, to a robot it is not":
            floor & _beside(unknown, edge="wrap"),
        "a cell on the edge of the grid has fewer neighbours, but may be a frontier": np.pad(marks[1:-1, 1:-1], 1),
    }  # fmt: skip


_ALPHA = np.array([-0.2, 0.0, 0.15, 0.4, 2.0])


@exercise(cases=[(_ALPHA, 3.0, 0.3), (_ALPHA, 10.0, 0.5), (_ALPHA, 0.0, 0.3)])
def price(a, w, s):
    """my_price(alpha, weight, scale): the planner's price of a metre at risk α."""
    return {
        AGREES: 1 + w * np.exp(-a / s),
        "the sign: this way the safest metre is the dearest": 1 + w * np.exp(a / s),
        "far from everything a metre must still cost its length": w * np.exp(-a / s),
        "the weight is in the exponent: with weight 0 no risk should count": 1 + np.exp(-w * a / s),
        "the unit: an exponent has none, but metres times metres have": 1 + w * np.exp(-a * s),
        "the scale is not used": 1 + w * np.exp(-a),
        "squared, a place beyond contact looks safe": 1 + w * np.exp(-((a / s) ** 2)),
    }


def _ways() -> list[tuple]:
    rng = np.random.default_rng(8)
    prices = [rng.uniform(1, 5, shape) for shape in ((7, 9), (12, 6))]
    return [(p, grid.path(p, (0, 0), np.array(p.shape) - 1)) for p in prices]


@exercise(cases=_ways)
def cost(prices, cells):
    """my_cost(price (nx, ny), cells (k, 2)): the cost of a way, as A* adds it up."""
    at, legs = prices[tuple(cells.T)], np.linalg.norm(np.diff(cells, axis=0), axis=1)
    return {
        AGREES: grid.geodesic(prices, cells[0])[tuple(cells[-1])],
        "a diagonal step is longer than a straight one": ((at[1:] + at[:-1]) / 2).sum(),
        "half of each step lies in the cell that it leaves": (at[1:] * legs).sum(),
        "half of each step lies in the cell that it enters": (at[:-1] * legs).sum(),
        "this adds up cells: a way is made of the steps between them": at.sum(),
        "this is its length: the price is not in it": legs.sum(),
        "the mean of two prices, not their sum": ((at[1:] + at[:-1]) * legs).sum(),
    }


def _plan(low: float) -> np.ndarray:
    prices = _rng.uniform(low, 5, (20, 15))
    prices[8, 3:] = np.inf
    return prices


@exercise(cases=[(_plan(low), np.array([2, 1]), np.array([17, 12])) for low in (1.0, 0.4)])
def guess(price, cell, goal):
    """my_guess(price (nx, ny), cell (2,), goal (2,)): what A* may hope for, never more than the truth."""
    finite, away = price[np.isfinite(price)], math.dist(cell, goal)
    return {
        AGREES: price.min() * away,
        "that is a distance in cells: the guess is a cost, so what is a cell worth?": away,
        "more than the truth may be: cheap cells may lie ahead": finite.mean() * away,
        "the dearest cell promises too much: is it on the way?": finite.max() * away,
        "more than the truth may be: a robot may go diagonally": price.min() * np.abs(cell - goal).sum(),
        "never wrong, but it guides nobody: this is Dijkstra": 0.0,
    }


def _asked(rule: Callable, alpha: np.ndarray) -> np.ndarray:
    with np.errstate(all="ignore"):
        prices = plain(ask(rule, alpha.copy()))
    if prices.shape != alpha.shape:
        raise Fault(f"shape {prices.shape} where {alpha.shape} is wanted: one price for each α")
    return prices


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
    prices = _asked(rule, alpha).reshape(lattice.shape)
    prices[alpha.reshape(lattice.shape) < 0.05] = np.inf
    way = planner.safe_path(prices, lattice, np.array([0.55, 1.2]), np.array([5.45, 1.2]))
    assert way is not None  # past the end of the wall
    return float(planner.lengths(way)[-1]), risk.total(wall, torch.from_numpy(way), config.level)


@judged(
    truth=lambda alpha: 1 + 9 * np.exp(-alpha / 0.5),
    mistakes=[
        (lambda alpha: 1 / alpha**3,
         "a price must be finite and above 0: else A* wanders for free, or finds no way at all",
         lambda seen: not seen.fine),
        (lambda alpha: 1 + np.exp(alpha), "the sign: somewhere a safer metre is dearer than a more dangerous one",
         lambda seen: (np.diff(seen.prices) > 1e-9).any()),
        (np.ones_like, "the same price everywhere: A* then looks for the shortest way, whatever the risk",
         lambda seen: seen.prices[0] <= seen.prices[-1] * (1 + 1e-9)),
        (lambda alpha: 1 - 1e-4 * alpha, "a fair price, but nobody changes the way for it: let danger cost more",
         lambda seen: seen.safer < 0.02),
        (lambda alpha: 1.0, "shape () where (39,) is wanted: one price for each α"),
    ],
    praise="a price: {longer:.1f} m of detour for {safer:.2f} m of AV@R",
)  # fmt: skip
def own_price(mine: Callable) -> SimpleNamespace:
    """my_rule(alpha (k,) [m]): any price of a metre; what it buys in a hall with a gap and a way around it."""
    seen = SimpleNamespace(prices=_asked(mine, np.linspace(-0.3, 3.5, 39)))
    seen.fine = bool(np.isfinite(seen.prices).all() and (seen.prices > 0).all())
    if seen.fine:
        shortest, bought = _hall(np.ones_like), _hall(mine)
        seen.longer, seen.safer = bought[0] - shortest[0], bought[1] - shortest[1]
    return seen
