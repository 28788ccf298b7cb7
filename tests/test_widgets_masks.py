"""Masks along a path: the picture shows the zone and the weights that an independent computation finds."""

import itertools

import matplotlib as mpl
import numpy as np
import pytest
from scipy import sparse, stats

from mannbv import world
from mannbv.course import widgets

STD, LEVEL = 0.05, 0.1
START, GOAL = (2.6, 0.8), (8.7, 6.7)


def floats(item, columns=2) -> np.ndarray:
    """The numbers of an item, as the browser gets them."""
    kind = "shapes" if item["kind"] == "ellipses" else "points"
    return np.frombuffer(item[kind], np.float32).reshape(-1, columns).astype(float)


def shown(**changed):
    """What the picture of these settings shows."""
    explorer = widgets.masks_along_a_path()
    panels, says = explorer.picture(**explorer.values | changed)
    plan, _bar, profile, ranking = panels
    others, some = (item for item in plan["items"] if item["kind"] == "ellipses")
    colors = np.frombuffer(some["rgba"], np.uint8).reshape(-1, 4)[:, :3]
    _rmin, alpha, radius = (floats(item) for item in profile["items"])
    straight, floor = (floats(item)[:, 1] for item in ranking["items"])
    path = floats(next(item for item in plan["items"] if item["kind"] == "dots"))
    return path, alpha, radius, floats(others, 5)[:, :2], floats(some, 5)[:, :2], colors, floor, straight, says


def weight_of(colors) -> np.ndarray:
    """The weights that stand behind colours (n, 3) of the colour bar."""
    ramp = np.round(255 * mpl.colormaps["cividis_r"](np.arange(256))[:, :3])
    return np.abs(colors[:, None].astype(float) - ramp).sum(-1).argmin(1) / 255


def driven(free, sources) -> np.ndarray:
    """Cells from the nearest source to every cell, by scipy's Dijkstra on an explicit graph; corners are not cut."""
    number, ends = np.arange(free.size).reshape(free.shape), ([], [], [])
    for dx, dy in itertools.product((0, 1), (-1, 0, 1)):
        if (dx, dy) > (0, 0):
            moved = [np.roll(a, (-dx, -dy), (0, 1)) for a in (free, number)]
            beside = np.roll(free, -dx, 0) & np.roll(free, -dy, 1)  # the flat's rim is never free: nothing wraps
            open_ = free & moved[0] & beside
            for part, values in zip(ends, (number, moved[1], np.full(free.shape, np.hypot(dx, dy))), strict=True):
                part.append(values[open_])
    rows, columns, lengths = (np.concatenate(part) for part in ends)
    graph = sparse.coo_array((lengths, (rows, columns)), (free.size, free.size)).tocsr()
    from_each = sparse.csgraph.dijkstra(graph, directed=False, indices=number[tuple(sources.T)], min_only=True)
    return from_each.reshape(free.shape)


def weights_over_the_floor(means, path, gamma2):
    """Least and largest weight that Eq. (13) allows: a splat in a wall may be as near to several free cells."""
    flat = world.load("flat")
    lattice, free = flat.ground.free_grid(0.05, 0.0)
    points = flat.seen.sampled(0.1)  # the canvas has them in float32, and some lie where two cells meet
    means = points[np.linalg.norm(points[:, None] - means, axis=-1).argmin(0)]
    path = np.concatenate([path[:-1], [GOAL]])  # all else are centres of cells
    along = driven(free, np.unique(lattice.index(path), axis=0))
    cells = np.argwhere(free)
    away = np.linalg.norm(lattice.index(means)[:, None] - cells, axis=-1)
    rest = away.min(1)
    doors = np.where(away < rest[:, None] + 1e-9, along[tuple(cells.T)], np.nan)
    low, high = (np.exp(-gamma2 * 0.05 * (reach(doors, 1) + rest)) for reach in (np.nanmax, np.nanmin))
    return np.where(low < np.exp(-10 * gamma2), 0, low), high


@pytest.mark.parametrize("changed", [{}, {"r_min": 0.2, "beta1": 1.6, "beta2": 5.0}, {"goal": (2.9, 5.0)}])
def test_zone_and_curves_are_those_of_the_equations(changed):
    path, alpha, radius, others, some, _, _, _, says = shown(**changed)
    setting = {"r_min": 0.5, "beta1": 1.0, "beta2": 2.0} | changed
    splats = np.concatenate([others, some])
    assert len(splats) == len(world.load("flat").seen.sampled(0.1))
    worst = STD * stats.norm.pdf(stats.norm.ppf(LEVEL)) / LEVEL  # mean of a normal's lower tail
    away = np.linalg.norm(splats[:, None] - path, axis=-1)
    np.testing.assert_allclose(alpha[:, 1], away.min(0) - worst, atol=1e-5)
    np.testing.assert_allclose(
        radius[:, 1], setting["r_min"] + setting["beta1"] * np.exp(-setting["beta2"] * alpha[:, 1]), rtol=1e-5
    )
    travelled = np.concatenate([[0], np.linalg.norm(np.diff(path, axis=0), axis=1).cumsum()])
    np.testing.assert_allclose(alpha[:, 0], travelled, atol=1e-4)
    inside = (away <= radius[:, 1]).any(1)
    assert (inside[len(others) :]).all() and not inside[: len(others)].any()
    assert says.startswith(f"{len(some)} of {len(splats)} splats in the zone; mean α {alpha[:, 1].mean():.2f} m")


@pytest.mark.parametrize("gamma2", [0.4, 1.0, 2.5])
def test_weights_are_those_of_a_drive_over_the_floor(gamma2):
    path, _, _, _, some, colors, floor, straight, says = shown(gamma2=gamma2)
    low, high = weights_over_the_floor(some, path, gamma2)
    assert (high - low < 0.02).mean() > 0.9  # few splats have a choice of doors
    for ranked, bound, sign in ((floor, low, -1), (floor, high, 1)):
        assert (sign * (np.sort(bound)[::-1] - ranked) >= -1e-4).all()
    given = weight_of(colors)
    assert ((low - 0.006 <= given) & (given <= high + 0.006)).all()
    assert f"above ½: {(floor > 0.5).sum()} over the floor, {(straight > 0.5).sum()} straight" in says
    assert ((weight_of(shown(gamma2=gamma2, straight=True)[5]) > high + 0.006).mean()) > 0.1  # the other would fail


def test_straight_weights_see_through_walls():
    path, _, _, _, some, colors, floor, straight, _ = shown(straight=True)
    away = np.linalg.norm(some[:, None] - path, axis=-1).min(1)
    np.testing.assert_allclose(straight, np.sort(np.exp(-away))[::-1], atol=1e-5)
    assert np.abs(weight_of(colors) - np.exp(-away)).max() < 0.006
    assert (straight > floor - 0.05).all() and straight.min() > 0.2 > floor.min()  # a bathroom wall's far side


def test_extremes():
    *_, others, some, _, floor, straight, says = shown(start=(5.3, 5.2), r_min=0.0, beta1=0.1)
    assert len(some) == len(floor) == len(straight) == 0 and len(others) > 1500
    assert says.startswith("0 of")
    *_, floor, straight, _ = shown(gamma2=0.0)
    assert (straight == 1).all() and set(np.unique(floor)) <= {0.0, 1.0}
    path, *_ = shown(goal=(2.6, 0.8))  # both ends at one place
    assert np.ptp(path, axis=0).max() < 0.1


def test_a_wider_mask_loses_no_splat():
    before = {tuple(p) for p in shown(beta1=0.4)[4]}
    after = {tuple(p) for p in shown(beta1=1.2)[4]}
    assert before < after


@pytest.mark.parametrize("goal", [(8.2, 5.2), (0.12, 0.12), (9.2, 2.55)])  # on a table, in a corner, behind a bed
def test_an_end_where_no_robot_fits_is_taken_to_the_nearest_place_that_can_be_reached(goal):
    path, *_ = shown(goal=goal)
    flat = world.load("flat")
    reachable = flat.ground.reachable_free(0.05, 0.2, flat.starts[0])
    centers = flat.ground.lattice(0.05).centers(np.argwhere(reachable))
    assert flat.ground.clearance(path[1:]).min() > 0.2 - 1e-4
    assert np.linalg.norm(path[-1] - goal) < np.linalg.norm(centers - goal, axis=1).min() + 0.05
    straight, shortest = np.linalg.norm(path[-1] - START), flat.ground.shortest_path(START, path[-1], 0.2)
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert straight <= length <= np.linalg.norm(np.diff(shortest, axis=0), axis=1).sum() + 0.1
