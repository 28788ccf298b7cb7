"""Risk-averse A*, subgoals, and where a robot fits."""

import dataclasses

import numpy as np
import pytest
import torch
from skimage.graph import route_through_array

from mannbv import geometry, grid, information, planner, risk
from mannbv.belief import Belief
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.splats import SplatMap

CONFIG = Config()
LATTICE = grid.Lattice((0.0, 0.0), 0.1, (60, 40))


def wall(points) -> SplatMap:
    means = torch.tensor(np.asarray(points), dtype=torch.float32)
    n, dim = means.shape
    rotations = geometry.identity_rotations(n, dim)
    return SplatMap(means, torch.full((n, dim), np.log(0.04)), rotations, torch.full((n,), 2.0), torch.rand(n, 3))


def known(state: np.ndarray) -> grid.Occupancy:
    log_odds = np.select([state == grid.FREE, state == grid.OCCUPIED], [-2.0, 4.0], 0.0)
    return grid.Occupancy(LATTICE, log_odds.astype(np.float32))


def hall() -> np.ndarray:
    state = np.full(LATTICE.shape, grid.FREE, np.int8)
    state[[0, -1]] = state[:, [0, -1]] = grid.OCCUPIED
    return state


def test_the_price_of_a_cell_is_one_plus_what_its_risk_adds():
    splats, cells = wall([[3.0, 2.0]]), hall() == grid.FREE
    price = planner.prices(splats, LATTICE, cells, np.zeros(0), CONFIG)
    x, y = 33, 20
    distance = np.linalg.norm(LATTICE.centers(np.array([[x, y]]))[0] - [3.0, 2.0])
    alpha = risk.average_value_at_risk(distance, 0.04, CONFIG.level)
    expected = 1 + CONFIG.risk_weight * np.exp(-alpha / CONFIG.risk_scale)
    assert price[x, y] == pytest.approx(expected, rel=1e-5)
    assert np.isinf(price[0, 0])


@pytest.mark.parametrize("floor", [3.0, 1.0])
def test_prices_grow_no_more_below_a_floor_of_risk(floor):
    wide = wall([[3.0, 2.0]])
    wide = dataclasses.replace(wide, log_scales=torch.full((1, 2), np.log(0.8)))  # α = −1.4 m on its mean
    config = CONFIG.replace(risk_floor=floor)
    price = planner.prices(wide, LATTICE, hall() == grid.FREE, np.zeros(0), config)
    assert price[30, 20] == pytest.approx(1 + config.risk_weight * np.exp(floor), rel=1e-6)
    assert price[5, 20] < price[30, 20]


def test_a_risk_averse_path_is_longer_and_safer():
    splats, cells = wall([[3.0, 2.0], [3.0, 1.9], [3.0, 2.1]]), hall() == grid.FREE
    start, goal = np.array([0.55, 2.05]), np.array([5.45, 2.05])
    paths = []
    for weight in (0.0, 3.0, 30.0):
        price = planner.prices(splats, LATTICE, cells, np.zeros(0), CONFIG.replace(risk_weight=weight))
        paths.append(planner.safe_path(price, LATTICE, start, goal))
    length = [planner.lengths(path)[-1] for path in paths]
    total = [risk.total(splats, torch.from_numpy(path)) for path in paths]
    assert length[0] < length[1] < length[2]
    assert total[0] < total[1] < total[2]


def test_safe_paths_cost_what_scikit_image_says(rng):
    price = rng.uniform(1, 4, LATTICE.shape)
    start, goal = np.array([0.25, 0.35]), np.array([5.65, 3.75])
    path = planner.safe_path(price, LATTICE, start, goal)
    cells = LATTICE.index(path)
    step = np.linalg.norm(np.diff(cells, axis=0), axis=1)
    cost = (step * (price[tuple(cells[1:].T)] + price[tuple(cells[:-1].T)]) / 2).sum()
    ends = LATTICE.index(np.stack([start, goal]))
    _, reference = route_through_array(price, *ends, fully_connected=True, geometric=True)
    assert cost == pytest.approx(reference)
    assert np.allclose(path[-1], goal)


def test_robots_keep_their_margin_from_walls_and_their_radius_from_the_unknown():
    state = hall()
    state[30:, :] = grid.UNKNOWN
    cells = planner.traversable(known(state), CONFIG)
    centers = LATTICE.centers(np.argwhere(cells))
    walls = LATTICE.centers(np.argwhere(state == grid.OCCUPIED))
    dark = LATTICE.centers(np.argwhere(state == grid.UNKNOWN))
    away = lambda points: np.linalg.norm(centers[:, None] - points, axis=-1).min()  # noqa: E731
    assert away(walls) >= CONFIG.robot_radius + CONFIG.margin + LATTICE.cell / 2
    assert CONFIG.robot_radius + LATTICE.cell / 2 <= away(dark) < CONFIG.robot_radius + CONFIG.margin + LATTICE.cell / 2
    assert len(centers) > 500


def scenario(state, goal, n_subgoals=4, tried=()):
    splats = wall([[x / 10, 0.05] for x in range(60)])
    prior = torch.ones(60, information.n_parameters(2))
    config = CONFIG.replace(n_subgoals=n_subgoals, min_frontier=3)
    camera = Camera.from_fov(32)
    return planner.plan(
        Belief(splats, prior, known(state)), camera, np.array([1.0, 2.0]), np.asarray(goal), config, tried
    )


def test_a_known_way_to_the_goal_needs_no_subgoal():
    route = scenario(hall(), [5.0, 3.0])
    assert route.look is None and len(route.candidates) == 0
    assert np.allclose(route.waypoints[-1], [5.0, 3.0])


def two_doors() -> np.ndarray:
    """A hall whose right half is unknown behind a wall with two doors: one near the goal, one out of the way."""
    state = hall()
    state[30] = grid.OCCUPIED
    state[31:, 1:-1] = grid.UNKNOWN
    for door in (6, 32):
        state[30, door - 4 : door + 5] = grid.FREE
    return state


def test_subgoals_lie_at_frontiers_near_the_goal():
    route = scenario(two_doors(), [5.0, 3.2], n_subgoals=1)
    assert np.allclose(route.look, LATTICE.centers(np.array([30, 32])), atol=0.11)
    assert len(route.candidates) == 1
    assert np.linalg.norm(route.waypoints[-1] - route.look) < 0.5


def test_a_subgoal_that_showed_nothing_is_not_tried_again():
    first = scenario(two_doors(), [5.0, 3.2])
    second = scenario(two_doors(), [5.0, 3.2], tried=(first.waypoints[-1],))
    assert second.look is not None and np.linalg.norm(second.look - first.look) > 1.0
    both = (first.waypoints[-1], second.waypoints[-1])
    assert scenario(two_doors(), [5.0, 3.2], tried=both) is None


def test_among_near_subgoals_the_most_informative_one_is_taken():
    state = two_doors()
    goal = [5.0, 1.95]  # as near through either door, within the allowed detour
    route = scenario(state, goal)
    assert len(route.candidates) == 2
    chosen = int(np.argmax(route.gains))
    assert np.allclose(route.waypoints[-1], route.candidates[chosen], atol=0.11)
    # independently: the gain of the best of many views from each candidate
    splats = wall([[x / 10, 0.05] for x in range(60)])
    prior, camera = torch.ones(60, 9), Camera.from_fov(32)
    best = [
        max(
            float(information.gain(information.fisher(splats, camera, geometry.yaw_pose(spot, yaw)), prior))
            for yaw in information.uniform_yaws(72)
        )
        for spot in route.candidates
    ]
    assert int(np.argmax(best)) == chosen


def test_there_is_no_route_out_of_a_closed_room():
    state = hall()
    state[30] = grid.OCCUPIED
    state[31:] = grid.UNKNOWN
    assert scenario(state, [5.0, 3.2]) is None


def test_thinned_paths_keep_their_ends_and_spacing(rng):
    path = np.cumsum(rng.uniform(0, 0.05, (100, 2)), 0)
    thin = planner.thin(path, 0.25)
    assert np.array_equal(thin[[0, -1]], path[[0, -1]])
    gaps = np.diff(planner.lengths(path)[[int(np.flatnonzero((path == p).all(1))[0]) for p in thin]])
    assert gaps.max() < 0.25 + 0.08 and gaps.min() > 0.1
    route = planner.Route(path, None, np.zeros((0, 2)), np.zeros(0))
    assert planner.lengths(route.ahead(0.8))[-1] <= 0.8
