"""What a risk weight buys: the ways drawn are the cheapest ones, and the numbers beside them are theirs."""

import itertools

import matplotlib as mpl
import numpy as np
import pytest
from scipy import ndimage, sparse, spatial, stats

from mannbv import world
from mannbv.course import widgets

CELL, LEVEL, SCALE = 0.1, 0.1, 0.3
MAPS = widgets.risk_weight().settings["known"].options
SHARP, VAGUE, UNSEEN = MAPS
SWEEP = (0.0, 0.3, 1.0, 2.0, 3.0, 10.0)


def points_of(item) -> np.ndarray:
    """The points of a line or of dots, as the browser gets them."""
    return np.frombuffer(item["points"], np.float32).reshape(-1, 2).astype(float)


def shown(**changed):
    """Panels and line for these settings; the shortest way and the cheapest one."""
    explorer = widgets.risk_weight()
    panels, says = explorer.picture(**explorer.values | changed)
    plain, way = (points_of(item) for item in panels[0]["items"] if item["kind"] == "line")
    return panels, says, plain, way


def alpha_at(points, known) -> np.ndarray:
    """Eqs. (8), (9) by brute force, on what this map should hold."""
    splats = world.load("flat").seen.sampled(0.1)
    std = np.where((known == VAGUE) & (np.linalg.norm(splats - (6.2, 3.5), axis=1) < 1), 0.3, 0.05)
    seen = (splats[:, 0] < 5) | (known != UNSEEN)
    worst = stats.norm.pdf(stats.norm.ppf(LEVEL)) / LEVEL
    away = np.linalg.norm(np.asarray(points)[:, None] - splats[seen], axis=-1)
    return (away - worst * std[seen]).min(1)


def open_cells() -> tuple:
    """The cells where a disc of 0.1 m keeps 0.1 m and half a cell from whatever is not free."""
    lattice, free = world.load("flat").ground.free_grid(CELL, 0.0)
    solid = spatial.cKDTree(lattice.centers(np.argwhere(~free)))
    distance, _ = solid.query(lattice.centers().reshape(-1, 2))
    cells = (distance >= 0.25).reshape(lattice.shape)  # lies between two distances of cells
    labels, _ = ndimage.label(cells)
    return lattice, labels == np.bincount(labels[cells]).argmax()


def cheapest(price, start, goal) -> float:
    """What the cheapest way costs [m], by scipy's Dijkstra on an explicit graph; corners are not cut."""
    number, free, parts = np.arange(price.size).reshape(price.shape), np.isfinite(price), ([], [], [])
    for dx, dy in itertools.product((0, 1), (-1, 0, 1)):
        if (dx, dy) > (0, 0):
            there = [np.roll(a, (-dx, -dy), (0, 1)) for a in (free, number, price)]
            open_ = free & there[0] & np.roll(free, -dx, 0) & np.roll(free, -dy, 1)
            cost = CELL * np.hypot(dx, dy) * (price + there[2]) / 2
            for part, values in zip(parts, (number, there[1], cost), strict=True):
                part.append(values[open_])
    rows, columns, costs = (np.concatenate(part) for part in parts)
    graph = sparse.coo_array((costs, (rows, columns)), (price.size, price.size)).tocsr()
    return sparse.csgraph.dijkstra(graph, directed=False, indices=number[tuple(start)])[number[tuple(goal)]]


@pytest.mark.parametrize(("weight", "known"), [(2.0, SHARP), (12.0, SHARP), (0.5, VAGUE), (6.0, UNSEEN)])
def test_both_ways_are_the_cheapest_at_their_price(weight, known):
    lattice, cells = open_cells()
    alpha = np.full(cells.shape, np.nan)
    alpha[cells] = alpha_at(lattice.centers(np.argwhere(cells)), known)

    def cost(way, price):
        steps, here = np.linalg.norm(np.diff(way, axis=0), axis=1), price[tuple(lattice.index(way).T)]
        return (steps * (here[1:] + here[:-1]) / 2).sum()

    _, _, plain, way = shown(weight=weight, known=known)
    ends = lattice.index([(2.6, 0.8), (8.7, 6.7)])
    even = np.where(cells, 1.0, np.inf)
    price = np.where(cells, 1 + weight * np.exp(-np.maximum(alpha, -3 * SCALE) / SCALE), np.inf)
    assert cost(plain, even) == pytest.approx(cheapest(even, *ends), rel=1e-4)
    assert cost(way, price) == pytest.approx(cheapest(price, *ends), rel=1e-4)
    assert cost(plain, price) > 1.005 * cost(way, price)  # the shortest way would not pass for the cheapest


@pytest.mark.parametrize("known", MAPS)
def test_the_numbers_are_those_of_the_ways_drawn(known):
    panels, says, plain, way = shown(known=known)
    true, own = (points_of(item)[0] for item in panels[2]["items"][-2:])
    length, alpha = np.linalg.norm(np.diff(way, axis=0), axis=1).sum(), alpha_at(way, known)
    clearance = world.load("flat").ground.clearance(way)
    assert own == pytest.approx([length, alpha.mean()], abs=1e-3)
    assert true == pytest.approx([length, clearance.mean()], abs=5e-3)  # sampled every 2 cm, without spread
    expected = (
        f"w = 2: {own[0]:.2f} m, mean α {own[1]:.2f} m ({true[1]:.2f} m truly), clearance {clearance.min():.2f} m"
    )
    assert says.startswith(expected)
    shortest = np.linalg.norm(np.diff(plain, axis=0), axis=1).sum()
    assert f"shortest: {shortest:.2f} m, mean α {alpha_at(plain, known).mean():.2f} m" in says
    for item, some in zip(panels[3]["items"], (plain, way), strict=True):
        along = np.concatenate([[0], np.linalg.norm(np.diff(some, axis=0), axis=1).cumsum()])
        np.testing.assert_allclose(points_of(item), np.column_stack([along, alpha_at(some, known)]), atol=1e-3)


@pytest.mark.parametrize("known", MAPS)
def test_the_present_weight_lies_on_the_trade_off(known):
    for number, weight in enumerate(SWEEP):
        items = shown(known=known, weight=weight)[0][2]["items"]
        true, own, _, _, true_now, own_now = map(points_of, items)
        assert (own[number] == own_now[0]).all() and (true[number] == true_now[0]).all()
        assert (own[:, 0].min() == own[0, 0]) and len(own) == len(SWEEP)


def test_the_map_is_coloured_by_its_risk():
    for known in MAPS:
        image, lattice = shown(known=known)[0][0]["items"][0], world.load("flat").ground.free_grid(CELL, 0.0)[0]
        pixels = np.frombuffer(image["rgba"], np.uint8).reshape(*image["shape"], 4)[::-1]
        spots = np.array([(2.6, 0.8), (5.05, 1.35), (6.25, 3.55), (8.7, 6.7), (6.75, 5.05)])
        index = lattice.index(spots)
        expected = mpl.colormaps["cividis"](np.clip(alpha_at(lattice.centers(index), known), 0, 1), bytes=True)
        assert np.abs(pixels[index[:, 1], index[:, 0]].astype(int) - expected).max() <= 2


def test_what_there_is_to_discover():
    sharp, vague, unseen = (shown(weight=0.5, known=known)[3] for known in MAPS)
    door = [np.linalg.norm(way - (6.2, 3.5), axis=1).min() for way in (sharp, vague, unseen)]
    assert door[0] < 0.5 and door[2] < 0.5 and door[1] > 1.5  # a vague door is left for another route
    lengths = [points_of(shown(weight=w)[0][2]["items"][-1])[0, 0] for w in (0.0, 2.0, 2.25, 2.5, 3.0, 12.0)]
    assert np.all(np.diff(lengths) > -0.02) and np.diff(lengths).max() > 1  # the route jumps within a few steps
    for known, promises in ((SHARP, False), (UNSEEN, True)):
        true, own = (points_of(item)[0, 1] for item in shown(known=known)[0][2]["items"][-2:])
        assert (own > true + 0.5) == promises  # who knows less believes more


@pytest.mark.parametrize("ends", [{"goal": (2.6, 0.8)}, {"goal": (8.2, 5.2)}, {"start": (0.12, 0.12)}])
def test_ends_anywhere_have_a_way_from_the_nearest_open_cell(ends):
    lattice, cells = open_cells()
    _, says, plain, way = shown(**ends)
    assert "nan" not in says
    for some in (plain, way):
        assert cells[tuple(lattice.index(some).T)].all()
        for place, end in zip(({"start": (2.6, 0.8), "goal": (8.7, 6.7)} | ends).values(), some[[0, -1]], strict=True):
            centers = lattice.centers(np.argwhere(cells))
            nearest = np.linalg.norm(centers - lattice.centers(lattice.index([place])), axis=1).min()
            assert np.linalg.norm(end - lattice.centers(lattice.index([place]))) == pytest.approx(nearest, abs=1e-4)
