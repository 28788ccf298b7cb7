"""The checker of notebook 07: the stored answers agree, and each likely mistake hears the hint it deserves."""

import numpy as np
import pytest
import torch

from mannbv import geometry, grid, planner, risk
from mannbv.config import Config
from mannbv.course.check import paths as check
from mannbv.splats import SplatMap

AGREES = "agrees with the library"


def sides(marked):
    around = np.pad(marked, 1)
    return around[2:, 1:-1] | around[:-2, 1:-1] | around[1:-1, 2:] | around[1:-1, :-2]


def right_frontier(state):
    return (state == grid.FREE) & sides(state == grid.UNKNOWN)


def right_price(alpha, weight, scale):
    return 1 + weight * np.exp(-alpha / scale)


def right_cost(price, cells):
    here = price[tuple(cells.T)]
    return (np.linalg.norm(np.diff(cells, axis=0), axis=1) * (here[1:] + here[:-1]) / 2).sum()


def right_guess(price, cell, goal):
    return price.min() * np.hypot(*(cell - goal))


CASES = [
    (check.frontier, right_frontier, AGREES),
    (check.frontier, lambda state: None, "to do"),
    (check.frontier, lambda state: (state == grid.UNKNOWN) & sides(state == grid.FREE), "these are the unknown cells"),
    (check.frontier, lambda state: (state != grid.UNKNOWN) & sides(state == grid.UNKNOWN), "walls too?"),
    (check.frontier, lambda state: state == grid.FREE, "all the floor"),
    (check.price, right_price, AGREES),
    (check.price, lambda alpha, weight, scale: ..., "to do"),
    (check.price, lambda alpha, weight, scale: 1 + weight * np.exp(alpha / scale), "the sign"),
    (check.price, lambda alpha, weight, scale: weight * np.exp(-alpha / scale), "must still cost its length"),
    (check.price, lambda alpha, weight, scale: 1 + weight * np.exp(-alpha * scale), "the unit"),
    (check.cost, right_cost, AGREES),
    (check.cost, lambda price, cells: None, "to do"),
    (check.cost, lambda price, cells: price[tuple(cells.T)].sum(), "this adds up cells"),
    (check.cost, lambda price, cells: np.linalg.norm(np.diff(cells, axis=0), axis=1).sum(), "this is its length"),
    (check.guess, right_guess, AGREES),
    (check.guess, lambda price, cell, goal: None, "to do"),
    (check.guess, lambda price, cell, goal: np.hypot(*(cell - goal)), "the guess is a cost"),
    (check.guess, lambda price, cell, goal: price.min() * np.abs(cell - goal).sum(), "diagonally"),
    (check.guess, lambda price, cell, goal: 0.0, "this is Dijkstra"),
    (check.own_price, lambda alpha: 1 + 9 * np.exp(-alpha / 0.5), "a price:"),
    (check.own_price, lambda alpha: None, "to do"),
    (check.own_price, lambda alpha: 1 + np.exp(alpha), "the sign"),
    (check.own_price, lambda alpha: 1 / alpha**3, "above 0"),
    (check.own_price, lambda alpha: np.ones_like(alpha), "the same price everywhere"),
    (check.own_price, lambda alpha: 1 - 1e-4 * alpha, "nobody changes the way for it"),
    (check.own_price, lambda alpha: 1.0, "one price for each"),
]


@pytest.mark.parametrize(("checker", "answer", "words"), CASES)
def test_an_answer_hears_what_it_deserves(capsys, checker, answer, words):
    agrees = checker(answer)
    said = capsys.readouterr().out.strip()
    assert words in said and len(said.splitlines()) == 1
    assert agrees is (answer in (right_frontier, right_price, right_cost, right_guess) or words == "a price:")


def test_the_wanted_price_is_the_planners():
    config = Config(risk_weight=5.0, risk_scale=0.4)
    lattice = grid.Lattice((0.0, 0.0), 0.1, (20, 3))
    rotation = geometry.identity_rotations(1, 2)
    one = SplatMap(torch.zeros(1, 2), torch.full((1, 2), -3.0), rotation, torch.zeros(1), torch.zeros(1, 3))
    priced = planner.prices(one, lattice, np.ones(lattice.shape, bool), np.zeros(0), config)
    alpha = risk.field(one, torch.from_numpy(lattice.centers().reshape(-1, 2)), config.level).double().numpy()
    assert np.allclose(priced.ravel(), right_price(alpha, 5.0, 0.4), rtol=1e-5)
