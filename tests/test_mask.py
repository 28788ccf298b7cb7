import itertools
import math

import numpy as np
import pytest
import torch
from helpers import random_map
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from mannbv import geometry, mask
from mannbv.config import Config
from mannbv.grid import Lattice, Occupancy
from mannbv.splats import SplatMap


@given(st.floats(-1, 5), st.floats(0, 3), st.floats(0, 2), st.floats(0.01, 3), st.floats(0.01, 5))
def test_a_safer_waypoint_gets_a_smaller_mask(risk, safer, r_min, beta1, beta2):
    values = torch.tensor([risk, risk + safer], dtype=torch.float64)
    here, there = mask.radius(values, r_min, beta1, beta2, r_max=0.0).tolist()
    assert there <= here
    assert_allclose(here, r_min + beta1 * math.exp(-beta2 * risk), rtol=1e-9)
    assert r_min <= there


def test_the_radius_takes_numbers_and_infinity():
    assert_allclose(mask.radius(0.0, 0.5, 1.0, 2.0), 1.5)
    assert mask.radius(math.inf, 0.5, 1.0, 2.0) == 0.5
    for wrong in ((-0.1, 1.0, 1.0), (0.5, 0.0, 1.0), (0.5, 1.0, -1.0), (math.nan, 1.0, 1.0)):
        with pytest.raises(ValueError, match="mask: needs r_min"):
            mask.radius(0.0, *wrong)


def test_no_radius_exceeds_its_bound_and_ordinary_ones_do_not_feel_it():
    alpha = torch.linspace(-1.1, 3, 50, dtype=torch.float64)  # a splat with σ = 0.6 m on the waypoint: −1.05 m
    assert mask.radius(alpha).tolist() == mask.radius(alpha, r_max=0.0).tolist()
    deep = torch.tensor([-2.0, -5.0, -1000.0])
    assert mask.radius(deep).tolist() == [Config().r_max] * 3 == [10.0] * 3
    assert mask.radius(deep, 0.5, 1.0, 2.0, 3.0).tolist() == [3.0] * 3
    assert_allclose(mask.radius(-5.0, 0.5, 1.0, 2.0, 0.0), 0.5 + math.exp(10), rtol=1e-6)
    for wrong in (0.4, -1.0, math.nan):
        with pytest.raises(ValueError, match="mask: r_max must be at least r_min"):
            mask.radius(0.0, 0.5, 1.0, 2.0, wrong)
    with pytest.raises(ValueError, match="config: r_max must be at least r_min, or 0, got"):
        Config().replace(r_max=0.4)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_zone_by_brute_force(dim, rng):
    splat_map = random_map(rng, 60, dim)
    path, radii = rng.uniform(-3, 3, (5, dim)), rng.uniform(0.2, 2, 5)
    found = mask.zone(splat_map, torch.from_numpy(path), torch.from_numpy(radii))
    expected = [
        any(math.dist(mean, p) <= r for p, r in zip(path, radii, strict=True)) for mean in splat_map.means.tolist()
    ]
    assert found.tolist() == expected
    assert 0 < sum(expected) < 60


def test_a_zone_of_nothing_is_empty(rng, unchecked):
    splat_map, path = random_map(rng, 4, 2), torch.zeros(3, 2)
    assert mask.zone(splat_map, path[:0], torch.zeros(0)).tolist() == [False] * 4
    assert mask.zone(SplatMap.empty(2), path, torch.ones(3)).shape == (0,)
    for odd in (torch.zeros(3, 5), torch.zeros(2), torch.zeros(1, 3, 2)):
        with pytest.raises(ValueError, match="the path must be"):
            mask.zone(splat_map, odd, torch.ones(len(odd)))
        with pytest.raises(ValueError, match="the path must be"):
            mask.proximity(splat_map, odd)
    with pytest.raises(ValueError, match="1 waypoints but 1 radii; give each its own"):
        mask.zone(splat_map, torch.zeros(1, splat_map.dim), 1.0)
    with pytest.raises(ValueError, match="3 waypoints but 2 radii"):
        mask.zone(splat_map, path, torch.ones(2))


def at(*means, dim=2):
    n = len(means)
    return SplatMap(
        torch.tensor(means),
        torch.full((n, dim), -3.0),
        geometry.identity_rotations(n, dim),
        torch.zeros(n),
        torch.zeros(n, 3),
    )


def corridor(unknown=()):
    """Two rows of cells of 0.5 m: the lower one open from end to end, the upper one only at the right end.

    y 1.0  . . . . .         x = unknown: the splat above is then reached from the left no more
    y 0.5  # # # # .   ←  a wall between
    y 0.0  s . x . .         s: the waypoint's cell
    """
    log_odds = np.full((5, 3), -1.0, np.float32)
    log_odds[:4, 1] = 2.0
    for cell in unknown:
        log_odds[cell] = 0.0
    return Occupancy(Lattice((0.0, 0.0), 0.5, (5, 3)), log_odds)


def test_proximity_follows_the_corridor():
    waypoint = torch.tensor([[0.25, 0.25]])
    splat_map = at([0.25, 0.25], [1.25, 0.25], [0.25, 1.25], [1.3, 0.3])
    # 3 cells right, a diagonal is barred by the wall's last cell, so 1 more right, 2 up, 4 left: 10 cells of 0.5 m
    expected = [0.0, 1.0, 5.0, 1.0]
    found = mask.proximity(splat_map, waypoint, corridor(), 2.0, 0.3)
    assert_allclose(found, 2.0 * np.exp(-0.3 * np.array(expected)), rtol=1e-6)


def test_a_straight_line_through_the_wall_would_not_do():
    splat_map, waypoint = at([0.25, 1.25]), torch.tensor([[0.25, 0.25]])
    straight = mask.proximity(splat_map, waypoint, None, 1.0, 1.0)
    assert_allclose(straight, math.exp(-1.0), rtol=1e-6)
    assert mask.proximity(splat_map, waypoint, corridor(), 1.0, 1.0) < 0.05 * straight


@pytest.mark.parametrize("gamma2", [1.0, 0.0])
def test_unknown_cells_block_and_what_is_cut_off_weighs_nothing(gamma2):
    waypoint = torch.tensor([[0.25, 0.25]])
    splat_map = at([0.25, 1.25], [1.75, 0.25], [0.75, 0.25])
    found = mask.proximity(splat_map, waypoint, corridor(unknown=[(2, 0)]), 1.0, gamma2)
    assert_allclose(found, [0.0, 0.0, math.exp(-gamma2 * 0.5)], rtol=1e-6)


def test_a_splat_in_a_wall_is_reached_from_its_nearest_free_cell():
    # above the wall's cell (1, 1) nothing is known, so that only the cell below it is beside it
    found = mask.proximity(at([0.75, 0.7]), torch.tensor([[0.25, 0.25]]), corridor(unknown=[(1, 2)]), 1.0, 1.0)
    assert_allclose(found, math.exp(-(0.5 + 0.5)), rtol=1e-6)  # one cell along, one cell up


@pytest.mark.parametrize("thickness", [1, 2, 3, 4])
def test_each_face_of_a_wall_is_reached_from_its_own_side(thickness):
    """Cells of 0.1 m; the robot stands 0.5 m in front of the wall, and the way around it is some 6 m long."""
    lattice = Lattice((0.0, 0.0), 0.1, (12 + thickness, 35))
    log_odds = np.full(lattice.shape, -1.0, np.float32)
    log_odds[6 : 6 + thickness, :34] = 2.0
    robot = torch.tensor([[0.15, 0.55]])
    edge = 0.1 * thickness
    into = np.array([0.0, 0.01, 0.3 * edge, 0.49 * edge])
    near, far = 0.6 + into, 0.6 + edge - into
    splat_map = at(*[[float(x), 0.55] for x in (*near, *far)])
    found = -np.log(mask.proximity(splat_map, robot, Occupancy(lattice, log_odds), limit=100.0).numpy())
    assert (found[:4] < 0.6 + edge).all()
    assert (found[4:] > 5.5).all()


def ways(free, source):
    """Cells from a source to every free cell, by relaxing all steps until nothing changes; no cutting of corners."""
    far = np.full(free.shape, np.inf)
    far[source] = 0.0 if free[source] else np.inf
    while True:
        padded, before = np.pad(far, 1, constant_values=np.inf), far
        open_ = np.pad(free, 1)
        best = far
        for dx, dy in itertools.product((-1, 0, 1), repeat=2):
            move = np.s_[1 + dx : 1 + dx + free.shape[0], 1 + dy : 1 + dy + free.shape[1]]
            level = np.s_[1 + dx : 1 + dx + free.shape[0], 1 : 1 + free.shape[1]]
            upright = np.s_[1 : 1 + free.shape[0], 1 + dy : 1 + dy + free.shape[1]]
            fits = free & open_[level] & open_[upright]
            best = np.where(fits, np.minimum(best, padded[move] + math.hypot(dx, dy)), best)
        far = best
        if np.array_equal(far, before):
            return far


@pytest.mark.parametrize("seed", range(12))
def test_proximity_by_brute_force(seed):
    rng, lattice = np.random.default_rng(seed), Lattice((-1.0, 0.5), 0.25, (14, 11))
    log_odds = rng.choice([-1.0, 0.0, 2.0], lattice.shape, p=[0.75, 0.05, 0.2]).astype(np.float32)
    free = log_odds < 0
    source = tuple(int(c) for c in rng.choice(np.argwhere(free)))
    means = rng.uniform([-1.6, -0.1], [3.1, 3.9], (60, 2))  # some outside
    means[:20] = np.round(means[:20] * 4) / 4  # on borders and corners of cells, where float32 is exact
    far = ways(free, source)
    expected = []
    for mean in means.astype(np.float32).astype(float):
        cell = np.clip(np.floor((mean - [-1.0, 0.5]) / 0.25), 0, [13, 10])
        inside = np.clip(mean, [-1.0, 0.5] + 0.25 * cell, [-1.0, 0.5] + 0.25 * (cell + 1))
        doors = np.argwhere(free)
        away = np.linalg.norm([-1.0, 0.5] + 0.25 * (doors + 0.5) - inside, axis=1)
        near = doors[away <= away.min() + 1e-9]  # between equals either will do
        straight = 0.25 * np.linalg.norm(near - cell, axis=1)
        outside = not ((mean >= [-1.0, 0.5]).all() and (mean < [2.5, 3.25]).all())
        beyond = outside * math.dist(mean, [-1.0, 0.5] + 0.25 * (cell + 0.5))
        expected.append(np.exp(-(0.25 * far[near[:, 0], near[:, 1]] + straight + beyond)))
    path = torch.tensor([-1.0, 0.5]) + 0.25 * (torch.tensor(source) + 0.5)
    found = mask.proximity(at(*means.tolist()), path[None], Occupancy(lattice, log_odds), limit=100.0).numpy()
    for mine, either in zip(found, expected, strict=True):
        assert np.isclose(mine, either, rtol=1e-5, atol=1e-12).any()
    assert (found > 0).mean() > 0.3


def test_the_nearest_waypoint_counts_and_the_limit_cuts():
    waypoints = torch.tensor([[0.25, 0.25], [2.25, 1.25], [9.0, 9.0]])  # the last lies beyond the lattice
    splat_map = at([0.25, 1.25])
    assert_allclose(mask.proximity(splat_map, waypoints, corridor(), 1.0, 1.0), math.exp(-2.0), rtol=1e-6)
    assert mask.proximity(splat_map, waypoints, corridor(), 1.0, 1.0, limit=1.9).tolist() == [0.0]
    assert mask.proximity(splat_map, waypoints, corridor(), 1.0, 1.0, limit=2.1).item() > 0


def test_a_splat_outside_the_grid_is_reached_straight_from_its_border_cell():
    waypoint = torch.tensor([[0.25, 0.25]])  # the centre of the corner cell
    for away in (0.5, 2.0):
        found = mask.proximity(at([0.25 - away, 0.25]), waypoint, corridor(), 1.0, 1.0)
        assert_allclose(found, math.exp(-away), rtol=1e-6)


def test_without_a_limit_only_what_is_cut_off_weighs_nothing():
    corner = torch.tensor([[0.25, 0.25]])
    for gamma2 in (1.0, 0.0):
        free, shut = (
            mask.proximity(at([0.25, 1.25]), corner, corridor(cells), 1.0, gamma2, 0.0) for cells in ((), [(2, 0)])
        )
        assert_allclose(free, math.exp(-5.0 * gamma2), rtol=1e-6)
        assert shut.tolist() == [0.0]


def test_height_does_not_count_on_the_ground():
    flat = mask.proximity(at([1.25, 0.25]), torch.tensor([[0.25, 0.25]]), corridor())
    space = mask.proximity(at([1.25, 0.25, 0.7], dim=3), torch.tensor([[0.25, 0.25, 1.5]]), corridor())
    assert_allclose(flat, space)
    straight = mask.proximity(at([1.0, 0.0, 0.0], dim=3), torch.tensor([[0.0, 0.0, 2.0]]))
    assert_allclose(straight, math.exp(-math.sqrt(5)), rtol=1e-6)


def test_proximity_of_nothing_and_what_it_refuses():
    assert mask.proximity(SplatMap.empty(2), torch.zeros(1, 2)).shape == (0,)
    assert mask.proximity(at([0.0, 0.0]), torch.zeros(0, 2)).tolist() == [0.0]
    for wrong in ((0.0, 1.0), (1.0, -1.0), (1.0, math.nan)):
        with pytest.raises(ValueError, match="mask: needs γ₁ > 0 and γ₂ ≥ 0"):
            mask.proximity(at([0.0, 0.0]), torch.zeros(1, 2), None, *wrong)
