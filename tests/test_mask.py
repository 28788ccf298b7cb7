import math

import numpy as np
import pytest
import torch
from helpers import random_map
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from mannbv import geometry, mask
from mannbv.grid import Lattice, Occupancy
from mannbv.splats import SplatMap


@given(st.floats(-1, 5), st.floats(0, 3), st.floats(0, 2), st.floats(0.01, 3), st.floats(0.01, 5))
def test_a_safer_waypoint_gets_a_smaller_mask(risk, safer, r_min, beta1, beta2):
    values = torch.tensor([risk, risk + safer], dtype=torch.float64)
    here, there = mask.radius(values, r_min, beta1, beta2).tolist()
    assert there <= here
    assert_allclose(here, r_min + beta1 * math.exp(-beta2 * risk), rtol=1e-9)
    assert r_min <= there


def test_the_radius_takes_numbers_and_infinity():
    assert_allclose(mask.radius(0.0, 0.5, 1.0, 2.0), 1.5)
    assert mask.radius(math.inf, 0.5, 1.0, 2.0) == 0.5
    for wrong in ((-0.1, 1.0, 1.0), (0.5, 0.0, 1.0), (0.5, 1.0, -1.0), (math.nan, 1.0, 1.0)):
        with pytest.raises(ValueError, match="mask: needs r_min"):
            mask.radius(0.0, *wrong)


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
