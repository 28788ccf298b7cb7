"""Scores against independent counts."""

import math

import numpy as np
import pytest
import torch
from skimage.metrics import peak_signal_noise_ratio

from mannbv import geometry, grid, metrics, planner, render, risk, world
from mannbv.belief import Belief
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.splats import SplatMap

CONFIG = Config(image_width=48)
CAMERA = Camera.from_fov(48)


@pytest.fixture(scope="module")
def place():
    return world.load("flat")


def surface_map(place) -> SplatMap:
    """True surfaces as opaque grey splats."""
    points = torch.from_numpy(place.seen.sampled(0.05)).float()
    n = len(points)
    grey = torch.full((n, 3), 0.5)
    return SplatMap(
        points, torch.full((n, 2), math.log(0.03)), geometry.identity_rotations(n, 2), torch.full((n,), 4.0), grey
    )


def test_view_quality_is_scikit_images_over_all_views(place):
    splats, trail = surface_map(place), place.starts[:2, :2]
    psnr, mae = metrics.view_quality(splats, place, CAMERA, trail, CONFIG)
    truths, images, gaps = [], [], []
    for spot in trail:
        for k in range(8):
            pose = geometry.yaw_pose(torch.from_numpy(spot), k * math.pi / 4)
            truth, drawn = place.sense(CAMERA, pose), render.render(splats, CAMERA, pose)
            assert bool(truth.valid.all())
            truths.append(truth.color.numpy())
            images.append(drawn.color.numpy())
            gaps.append(np.abs(drawn.depth.numpy() - truth.depth.numpy()))
    reference = peak_signal_noise_ratio(np.stack(truths), np.stack(images), data_range=1.0)
    assert psnr == pytest.approx(reference, abs=1e-3)
    assert mae == pytest.approx(np.mean(gaps), rel=1e-4)


def test_true_risk_is_the_mean_clearance(place):
    path = place.ground.shortest_path(place.starts[0], place.goals[0], 0.2)
    true = risk.total(metrics.true_surfaces(place), torch.from_numpy(path))
    assert true == pytest.approx(place.ground.clearance(path).mean(), abs=0.002)


def test_risk_gain_is_that_of_the_planned_path_over_the_shortest(place):
    lattice, free = place.ground.free_grid(CONFIG.cell, 0.05)
    ground = grid.Occupancy(lattice, np.where(free, -1.0, 3.0).astype(np.float32))
    belief = Belief(surface_map(place), torch.zeros(0, 9), ground)
    start, goal = place.starts[0, :2], place.goals[0]
    shortest = place.ground.shortest_path(start, goal, CONFIG.robot_radius)
    scores = metrics.path_scores(belief, place, metrics.true_surfaces(place), start, goal, shortest, CONFIG)
    path = metrics.reference_path(belief, start, goal, CONFIG)
    brute = [
        min(
            risk.average_value_at_risk(float(np.linalg.norm(p - m)), float(s.max()), CONFIG.level)
            for m, s in zip(belief.splats.means.numpy(), belief.splats.scales.numpy(), strict=True)
        )
        for p in path[::10]
    ]
    assert risk.total(belief.splats, torch.from_numpy(path[::10])) == pytest.approx(np.mean(brute), abs=1e-4)
    own = risk.total(belief.splats, torch.from_numpy(path))
    assert scores["total_risk_m"] == pytest.approx(own)
    assert scores["risk_gain_m"] == pytest.approx(own - risk.total(belief.splats, torch.from_numpy(shortest)))
    assert scores["reference_clearance_m"] == pytest.approx(place.ground.clearance(path).min())
    assert scores["risk_gain_m"] > 0.05  # the planned path pays for safety
    assert planner.lengths(path)[-1] >= planner.lengths(shortest)[-1] - 0.2


def test_a_map_without_a_way_scores_nothing(place):
    ground = grid.Occupancy.unknown(place.ground.lattice(CONFIG.cell))
    belief = Belief(surface_map(place), torch.zeros(0, 9), ground)
    shortest = place.ground.shortest_path(place.starts[0], place.goals[0], 0.1)
    scores = metrics.path_scores(
        belief, place, metrics.true_surfaces(place), place.starts[0, :2], place.goals[0], shortest, CONFIG
    )
    assert all(math.isnan(value) for value in scores.values())


def test_a_path_that_ends_far_from_the_goal_is_no_path_to_it(place):
    lattice, free = place.ground.free_grid(CONFIG.cell, 0.05)
    known = free & (np.linalg.norm(lattice.centers() - place.starts[0, :2], axis=-1) < 2.0)
    ground = grid.Occupancy(lattice, np.where(known, -1.0, 0.0).astype(np.float32))
    belief = Belief(surface_map(place), torch.zeros(0, 9), ground)
    assert metrics.reference_path(belief, place.starts[0, :2], place.goals[0], CONFIG) is None
    assert metrics.reference_path(belief, place.starts[0, :2], place.starts[0, :2] + [0.3, 0.0], CONFIG) is not None


def test_travel_scores_by_hand(place):
    trail = place.starts[0, :2] + np.array([[0.0, 0], [0.3, 0], [0.3, 0.4]])
    goal = trail[-1] + [0.1, 0.0]
    shortest = np.stack([trail[0], trail[0] + [0.5, 0.0]])
    scores = metrics.travel_scores(place, trail, goal, shortest, True, 2)
    assert scores["path_length_m"] == pytest.approx(0.7)
    assert scores["path_overhead"] == pytest.approx(0.8 / 0.5 - 1)
    assert scores["spl"] == pytest.approx(0.5 / 0.7)
    assert scores["collisions"] == 2
    lost = metrics.travel_scores(place, trail, goal, shortest, False, 0)
    assert lost["spl"] == 0 and math.isnan(lost["path_overhead"])


def test_coverage_counts_seen_cells():
    lattice = grid.Lattice((0.0, 0.0), 0.1, (10, 10))
    log_odds = np.zeros((10, 10), np.float32)
    log_odds[:4] = -1
    reachable = np.ones((10, 10), bool)
    assert metrics.coverage(grid.Occupancy(lattice, log_odds), reachable, lattice) == pytest.approx(0.4)
