"""The team's objective, and the paper's propositions 1 and 2 and lemma 1 as laws, with what breaks the lemma."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
import torch
from helpers import box_map, camera_for, random_map, shifted
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from mannbv import consensus, geometry, information, objective, splats
from mannbv.belief import Belief
from mannbv.config import Config
from mannbv.grid import FREE, Lattice, Occupancy
from mannbv.objective import Zone
from mannbv.splats import SplatMap

CONFIG = Config()
LATTICE = Lattice((-3.0, -3.0), 0.5, (12, 12))


def random_team(rng, dim, n_robots=2, dtype=torch.float64, largest=7):
    """Beliefs, information of everyone's views, a camera, a view and a path; grids are parts of one truth."""
    camera = camera_for(dim, 12, 6)
    truth = np.where(rng.random(LATTICE.shape) < 0.25, 2.0, -1.0)

    def view():
        place = torch.from_numpy(rng.uniform(-2, 2, dim)).to(dtype)
        return geometry.yaw_pose(place, float(rng.uniform(-math.pi, math.pi)))

    views, beliefs, joint_priors = [view() for _ in range(n_robots)], [], []
    for j in range(n_robots):
        splat_map = random_map(rng, int(rng.integers(1, largest)), dim, dtype, reach=2.5)
        known = rng.random(LATTICE.shape) < rng.uniform(0.4, 1)
        ground = Occupancy(LATTICE, np.where(known, truth, 0).astype(np.float32))
        beliefs.append(Belief(splat_map, information.prior(splat_map, camera, [views[j]]), ground))
        joint_priors.append(information.prior(splat_map, camera, views))
    pose = view()
    ahead = pose.rotation[:, -1].numpy().astype(float)
    path = pose.position.numpy() + np.linspace(0, 2, 4)[:, None] * ahead
    return beliefs, joint_priors, camera, pose, path


seeds, dims, sizes = st.integers(0, 2**32 - 1), st.sampled_from([2, 3]), st.integers(1, 4)


def one_go(beliefs, zones, camera, pose):
    """Eq. (18) for one view from the union map alone, no blocks: what the sum over owners must equal."""
    whole = splats.union(*(b.splats for b in beliefs))
    return information.gain(
        information.fisher(whole, camera, pose),
        torch.cat([b.prior for b in beliefs]),
        torch.cat([z.weights for z in zones]),
        torch.cat([z.selected for z in zones]),
    ).item()


def random_zone(rng, n):
    weights = torch.from_numpy(rng.uniform(0, 1, n))
    return Zone(torch.zeros(1), torch.zeros(1), torch.from_numpy(rng.random(n) < 0.7), weights)


@settings(max_examples=40)
@given(seeds, dims, sizes)
def test_owners_blocks_of_one_joint_rendering_add_up_to_the_central_gain(seed, dim, n_robots):
    """Eq. (19)."""
    rng = np.random.default_rng(seed)
    beliefs, _, camera, pose, _ = random_team(rng, dim, n_robots)
    zones = [random_zone(rng, b.splats.n_splats) for b in beliefs]
    terms = objective.per_owner(beliefs, zones, camera, pose, CONFIG, joint_rendering=True)
    assert terms.shape == (n_robots,)
    assert_allclose(terms.sum(), one_go(beliefs, zones, camera, pose), rtol=1e-9, atol=1e-12)


def test_blocks_rendered_alone_do_not_add_up_to_one_joint_rendering():
    """So that the law above is no tautology: it is the occlusion that counts."""
    apart = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        beliefs, _, camera, pose, _ = random_team(rng, 2, 3)
        zones = [random_zone(rng, b.splats.n_splats) for b in beliefs]
        alone = objective.per_owner(beliefs, zones, camera, pose, CONFIG).sum().item()
        for term, belief, zone in zip(
            objective.per_owner(beliefs, zones, camera, pose, CONFIG), beliefs, zones, strict=True
        ):
            assert_allclose(term, one_go([belief], [zone], camera, pose), rtol=1e-9, atol=1e-12)
        apart += abs(alone - one_go(beliefs, zones, camera, pose)) > 0.01 * alone
    assert apart > 5


@settings(max_examples=60)
@given(seeds, dims, sizes, st.sampled_from(["avar", "var", "mean"]), st.sampled_from([0.05, 0.5, 0.9]))
def test_a_robots_own_mask_lies_within_the_central_one(seed, dim, n_robots, measure, level):
    """Eq. (20)."""
    beliefs, _, _, _, path = random_team(np.random.default_rng(seed), dim, n_robots)
    config = CONFIG.replace(measure=measure, level=level, r_min=0.2)
    for belief, block in zip(beliefs, objective.central_zones(beliefs, path, config), strict=True):
        own = objective.zone(belief, path, config)
        assert (own.risk >= block.risk).all()
        assert (own.radii <= block.radii).all()
        assert not (own.selected & ~block.selected).any()
        assert not own.weights[~own.selected].any()


def test_the_central_mask_is_sometimes_larger():
    larger = 0
    for seed in range(20):
        beliefs, _, _, _, path = random_team(np.random.default_rng(seed), 2, 3)
        blocks = objective.central_zones(beliefs, path, CONFIG)
        larger += any(
            bool((~objective.zone(b, path, CONFIG).selected & c.selected).any())
            for b, c in zip(beliefs, blocks, strict=True)
        )
    assert larger > 3


@settings(max_examples=40)
@given(seeds, dims, sizes)
def test_the_distributed_gain_is_a_lower_bound(seed, dim, n_robots):
    """Eq. (22), by the paper's definition: blocks alone, own priors, weights from one common grid."""
    beliefs, _, camera, pose, path = random_team(np.random.default_rng(seed), dim, n_robots)
    distributed, central = objective.lower_bound(beliefs, camera, pose, path, CONFIG)
    assert 0 <= distributed <= central * (1 + 1e-9) + 1e-12


# What keeps the lemma: {blocks alone, joint} × {own prior, joint} × {common weights, each robot's own}
COMBINATIONS = list(itertools.product([False, True], repeat=3))
KEEPS = {flags: not any(flags) for flags in COMBINATIONS}


@pytest.fixture(scope="module")
def tried():
    """(distributed, central) of every combination on random teams of flatland, where the kernel is fast."""
    sides = {flags: [] for flags in COMBINATIONS}
    for seed in range(700):
        rng = np.random.default_rng(seed)
        beliefs, joint_priors, *view = random_team(rng, 2, int(rng.integers(2, 4)), torch.float32)
        distributed, central = objective.lower_bound(beliefs, *view, CONFIG)
        sides[False, False, False].append((distributed, central))
        if seed >= 250:
            continue
        own, _ = objective.lower_bound(beliefs, *view, CONFIG, own_weights=True)
        for joint, shared in itertools.product([False, True], repeat=2):
            _, central = objective.lower_bound(beliefs, *view, CONFIG, joint, joint_priors if shared else None)
            sides[joint, shared, False].append((distributed, central))
            sides[joint, shared, True].append((own, central))
    return {flags: np.array(pairs) for flags, pairs in sides.items()}


def splats_at(*means):
    """Nearly opaque round splats of 5 cm."""
    n = len(means)
    return SplatMap(
        torch.tensor(means, dtype=torch.float64),
        torch.full((n, 2), math.log(0.05), dtype=torch.float64),
        geometry.identity_rotations(n, 2).double(),
        torch.full((n,), 3.0, dtype=torch.float64),
        torch.full((n, 3), 0.5, dtype=torch.float64),
    )


def counterexample(occluder: bool, teammate_looked: bool, own_grid: str | None):
    """One robot's splat beyond a waypoint, and what a teammate may know that makes its central gain smaller.

    The camera at (−1, 0.25) looks along +x at the waypoint (2.75, 0.25) and the splat (3.75, 0.25) behind it.
    """
    camera, pose = camera_for(2, 32), geometry.yaw_pose(torch.tensor([-1.0, 0.25], dtype=torch.float64), 0.0)
    mine = splats_at([3.75, 0.25])
    # a teammate's splat hides mine; where it does not, it lies behind the camera. Its own gain never counts: too far
    theirs = splats_at([-0.2, 0.25] if occluder else [-2.0, 0.25])
    joint_priors = [torch.zeros(1, 9, dtype=torch.float64) for _ in range(2)]
    if teammate_looked:
        joint_priors[0] = information.prior(mine, camera, [pose])
    lattice = Lattice((-3.0, -1.0), 0.5, (16, 5))
    own, common = (np.full(lattice.shape, -1.0, np.float32) for _ in range(2))
    waypoint, wall, beyond = lattice.index([[2.75, 0.25], [3.25, 0.25], [3.75, 0.25]])
    if own_grid == "a wall unknown to me":
        # I believe that the straight way is free; the teammate has seen a wall right across
        common[wall[0]] = 3.0
    elif own_grid == "a room on the other side":
        # behind my waypoint two cells of wall, the splat in the second; a teammate knows a room beyond it
        own[wall[0]], own[beyond[0]] = 3.0, 3.0
        common[wall[0]], common[beyond[0]] = 3.0, 3.0
        own[beyond[0] + 1 :] = 0.0
    grids = [Occupancy(lattice, own), Occupancy(lattice, common)]
    nothing = torch.zeros(1, 9, dtype=torch.float64)
    beliefs = [Belief(m, nothing, g) for m, g in zip([mine, theirs], grids, strict=True)]
    config = CONFIG.replace(r_min=2.0)
    return beliefs, joint_priors, (camera, pose, np.array([[2.75, 0.25]]), config), own, waypoint


NAMES = ["joint rendering", "joint prior", "own weights"]
IDS = [", ".join(itertools.compress(NAMES, flags)) or "the paper's" for flags in COMBINATIONS]


@pytest.mark.parametrize("flags", COMBINATIONS, ids=IDS)
def test_which_combinations_keep_the_lower_bound(flags, tried):
    joint, shared, own_weights = flags
    distributed, central = tried[flags].T
    broken = distributed > central * (1 + 1e-5) + 1e-9
    assert (distributed > 0).sum() >= 100
    if KEEPS[flags]:
        assert not broken.any()
    elif joint or shared:  # own grids alone break it for one random team in fifty: see their constructed teams
        assert broken.mean() > 0.05
    for grid_story in ["a wall unknown to me", "a room on the other side"] if own_weights else [None]:
        beliefs, joint_priors, view, *_ = counterexample(joint, shared, grid_story)
        priors = joint_priors if shared else None
        distributed, central = objective.lower_bound(beliefs, *view, joint, priors, own_weights)
        assert distributed > 0
        if KEEPS[flags]:
            assert distributed <= central * (1 + 1e-9)
        else:
            assert distributed > 1.2 * central
            # by the paper's definition the same team keeps the lemma
            distributed, central = objective.lower_bound(beliefs, *view)
            assert distributed <= central * (1 + 1e-9)


@pytest.mark.parametrize("story", ["a wall unknown to me", "a room on the other side"])
def test_the_grids_of_the_counterexamples_tell_their_story(story):
    beliefs, _, (_, _, path, config), own, waypoint = counterexample(False, False, story)
    common = objective.pooled(beliefs).ground
    assert beliefs[0].ground.state[tuple(waypoint)] == common.state[tuple(waypoint)] == FREE
    mine = objective.zone(beliefs[0], path, config).weights.item()
    central = objective.central_zones(beliefs, path, config)[0].weights.item()
    assert_allclose(mine, math.exp(-1.0))  # two cells of half a metre
    # cut off: by the wall without a gap, or because the nearest free cell is now in the room beyond
    assert central == 0.0
    assert (own != beliefs[1].ground.log_odds).any()


def test_the_teams_objective_by_hand(rng):
    """Eq. (24) on tables, linear between the yaws, around the circle."""
    n, m = 4, 36
    gains, yaws = rng.uniform(0, 5, (n, n, m)), rng.uniform(-7, 7, n)
    grid = -math.pi + 2 * math.pi * np.arange(m + 1) / m
    total = 0.0
    for i in range(n):
        for k in range(n):
            closed = np.append(gains[i, k], gains[i, k, 0])
            total += np.interp(geometry.wrap(float(yaws[k])), grid, closed)
    assert_allclose(objective.team(gains, yaws), total)
    assert_allclose(
        objective.team(gains, grid[[0, 5, 35, 9]]), sum(gains[:, k, c].sum() for k, c in enumerate([0, 5, 35, 9]))
    )
    assert_allclose(objective.team(gains, np.full(n, math.pi)), gains[:, :, 0].sum())
    top = consensus.best_yaws(gains.sum(0), yaws)
    assert objective.team(gains, top) == objective.best(gains) == gains.sum(0).max(1).sum()
    assert all(objective.team(gains, some) <= objective.best(gains) for some in rng.uniform(-7, 7, (200, n)))


def test_what_a_robot_serves_is_the_profile_of_the_masked_zone(rng):
    splat_map, camera = box_map(rng, dtype=torch.float32), camera_for(2, 32)
    belief = Belief(splat_map, torch.zeros(splat_map.n_splats, 9))
    paths = [np.array([[1.0, 0.5], [2.0, 0.5]]), np.zeros((0, 2)), np.array([[50.0, 50.0]])]
    places = [np.array(p) for p in ([1.5, 1.5], [2.0, 2.0], [50.0, 50.0])]
    rows = objective.local(belief, camera, places, paths, CONFIG)
    assert rows.shape == (3, CONFIG.n_yaws)
    assert not rows[1:].any()  # no trajectory; a trajectory far from every splat
    zone = objective.zone(belief, paths[0], CONFIG)
    assert 0 < zone.selected.sum() < splat_map.n_splats
    yaw = information.uniform_yaws(CONFIG.n_yaws)[40]
    view = information.fisher(splat_map, camera, geometry.yaw_pose(torch.tensor([1.5, 1.5]), yaw))
    expected = information.gain(view, belief.prior, zone.weights, zone.selected)
    assert_allclose(rows[0, 40], expected, rtol=0.15)  # a profile's; exactness is shown elsewhere
    assert objective.served(belief, camera, places[1], paths[1], CONFIG) is None


def test_the_zone_of_an_empty_map_is_empty():
    zone = objective.zone(Belief(SplatMap.empty(2), torch.zeros(0, 9)), np.zeros((2, 2)), CONFIG)
    assert torch.isinf(zone.risk).all()
    assert_allclose(zone.radii, CONFIG.r_min)
    assert zone.weights.shape == zone.selected.shape == (0,)


def test_a_vague_splat_on_the_path_does_not_mask_the_whole_world():
    vague = splats_at([0.0, 0.0], [12.0, 0.0])
    vague = dataclasses.replace(vague, log_scales=torch.tensor([[1.0, 1.0], [-3.0, -3.0]], dtype=torch.float64))
    belief, path = Belief(vague, torch.zeros(2, 9, dtype=torch.float64)), np.zeros((1, 2))
    bounded, literal = (objective.zone(belief, path, CONFIG.replace(r_max=r_max)) for r_max in (10.0, 0.0))
    assert bounded.radii.tolist() == [10.0] and bounded.selected.tolist() == [True, False]
    assert_allclose(literal.radii, 0.5 + torch.exp(-2.0 * literal.risk))
    assert literal.selected.all()


@pytest.mark.parametrize("dim", [2, 3])
def test_far_teammates_change_nothing(dim, rng):
    beliefs, _, camera, pose, path = random_team(rng, dim, 2)
    far = Belief(shifted(beliefs[1].splats, 500.0), beliefs[1].prior, beliefs[1].ground)
    team = [beliefs[0], far]
    for joint in (False, True):
        distributed, central = objective.lower_bound(team, camera, pose, path, CONFIG, joint)
        assert_allclose(distributed, central, rtol=1e-9)
