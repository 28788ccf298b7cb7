import dataclasses
import math

import numpy as np
import pytest
import torch
from helpers import box_frame, camera_for, random_map, random_pose
from numpy.testing import assert_allclose

from mannbv import geometry, information, mapping, render, splats
from mannbv.camera import Frame
from mannbv.config import Config
from mannbv.mapping import LocalMap
from mannbv.splats import SplatMap

CONFIG = Config()
WAYPOINTS = [(1.0 + 0.25 * k, 1.2) for k in range(8)]


def empty(dim=2):
    return LocalMap.empty(dim, information.n_parameters(dim))


@pytest.fixture(scope="module")
def built():
    """A map of the box room from 24 keyframes along a line, looking around."""
    camera, rng = camera_for(2, 64), np.random.default_rng(0)
    local = empty()
    for k, place in enumerate(WAYPOINTS):
        for turn in range(3):
            frame = box_frame(camera, place, 2 * math.pi * turn / 3 + 0.5 * k)
            local = mapping.observe(local, camera, frame, CONFIG, rng)
    return camera, local


def test_the_map_shows_views_it_was_not_fitted_to(built):
    camera, local = built
    errors, depths = [], []
    for place in [(1.6, 1.5), (2.4, 1.0), (1.1, 1.3)]:
        for yaw in np.linspace(-3, 3, 7):
            frame = box_frame(camera, place, float(yaw))
            drawn = render.render(local.splats, camera, frame.pose)
            errors.append(float(((drawn.color - frame.color) ** 2).mean()))
            depths.append(float((drawn.depth - frame.depth).abs().mean()))
    assert -10 * math.log10(np.mean(errors)) > 20.0
    assert np.mean(depths) < 0.1
    assert len(local.keyframes) == 24
    assert local.splats.means.dtype == torch.float32


def test_ids_are_given_once_and_rows_stay_together(built):
    _, local = built
    n = local.splats.n_splats
    assert len(local.ids) == len(local.prior) == n
    assert (local.ids.diff() > 0).all()  # in order of birth, none twice
    assert local.ids.max() < local.born
    assert local.born > n  # some were pruned


def test_what_is_explained_is_not_inserted_again():
    camera, rng = camera_for(2, 64), np.random.default_rng(0)
    frame = box_frame(camera, (2.0, 1.5), 0.3)
    assert mapping.unexplained(SplatMap.empty(2), camera, frame, CONFIG).all()
    first = mapping.observe(empty(), camera, frame, CONFIG, rng)
    assert first.born == 64
    second = mapping.observe(first, camera, frame, CONFIG, rng)
    assert second.born - first.born <= 3
    turned = mapping.observe(first, camera, box_frame(camera, (2.0, 1.5), 0.3 + math.pi), CONFIG, rng)
    assert turned.born == 128  # all of the other side is new


def test_pixels_without_a_depth_are_never_inserted():
    camera, rng = camera_for(2, 64), np.random.default_rng(0)
    frame = box_frame(camera, (2.0, 1.5), 0.3)
    depth = frame.depth.clone()
    depth[:10], depth[10:20], depth[20:30] = 0.0, math.inf, math.nan
    frame = dataclasses.replace(frame, depth=depth)
    local = mapping.observe(empty(), camera, frame, CONFIG, rng)
    assert local.born == 34
    assert all(bool(torch.isfinite(t).all()) for t in local.splats.tensors())
    blind = dataclasses.replace(frame, depth=torch.zeros(64))
    assert mapping.observe(empty(), camera, blind, CONFIG, rng).splats.n_splats == 0


def test_a_wall_before_the_known_one_is_not_explained():
    camera = camera_for(2, 64)
    frame = box_frame(camera, (2.0, 1.5), 0.3)
    local = mapping.observe(empty(), camera, frame, CONFIG, np.random.default_rng(0))
    nearer = dataclasses.replace(frame, depth=frame.depth * 0.8)
    assert mapping.unexplained(local.splats, camera, nearer, CONFIG).float().mean() > 0.9


def test_the_tolerance_of_depth_ends_at_a_nearness():
    camera = camera_for(2, 64)
    frame = box_frame(camera, (0.5, 1.0), math.pi)  # a wall 0.5 m away
    local = mapping.observe(empty(), camera, frame, CONFIG, np.random.default_rng(0))
    drawn = render.render(local.splats, camera, frame.pose)
    depth = drawn.depth / drawn.opacity
    wrong = dataclasses.replace(frame, depth=depth + 0.04)  # by 7 % of itself, but less than 5 % of a metre
    opaque = drawn.opacity > CONFIG.explained_opacity
    assert opaque.sum() > 50 and (depth[opaque] < 0.6).all()
    assert not mapping.unexplained(local.splats, camera, wrong, CONFIG)[opaque].any()
    assert mapping.unexplained(local.splats, camera, wrong, CONFIG.replace(explained_near=0.1)).all()


def test_every_group_of_parameters_takes_its_own_steps(rng):
    """Adam's first step is as long as the rate, up or down, wherever the slope is not 0."""
    camera, splat_map = camera_for(2, 32), random_map(rng, 20, 2, torch.float32, reach=1.0)
    names = ("rate_mean", "rate_scale", "rate_rotation", "rate_opacity", "rate_color")
    rates = dict(zip(names, (1e-3, 2e-3, 3e-3, 4e-3, 5e-3), strict=True))
    frame = box_frame(camera, (2.0, 1.5), math.pi)
    fitted = mapping.fit(splat_map, camera, [frame], CONFIG.replace(learning_rate=0.5, **rates), steps=1)
    for part, before, rate in zip(fitted.tensors(), splat_map.tensors(), rates.values(), strict=True):
        if part is fitted.rotations:  # brought back to length 1 afterwards
            signs = torch.tensor([(1.0, 1), (1, -1), (-1, 1), (-1, -1)])[:, None]
            could = torch.nn.functional.normalize(before + 0.5 * rate * signs, dim=-1)
            moved = (part - before).abs().amax(1) > 1e-5
            assert moved.sum() > 5
            assert (could - part).abs().amax(-1).amin(0)[moved].max() < 1e-6
            continue
        moved = (part != before) & (part > 0) & (part < 1) if part is fitted.colors else part != before
        assert moved.sum() > 5
        assert_allclose((part - before)[moved].abs(), 0.5 * rate, rtol=2e-2)


@pytest.mark.parametrize("dim", [2, 3])
def test_new_splats_lie_on_what_was_seen(dim, rng):
    camera, pose = camera_for(dim, 6, 4), random_pose(rng, dim)
    depth = torch.from_numpy(rng.uniform(0.5, 4, camera.shape))
    frame = Frame(torch.from_numpy(rng.uniform(0, 1, (*camera.shape, 3))), depth, pose)
    marked = torch.from_numpy(rng.random(camera.shape) < 0.5)
    fresh = mapping.newborn(camera, frame, marked, CONFIG)
    assert fresh.n_splats == int(marked.sum())
    local = pose.local(fresh.means)
    assert_allclose(local[:, -1], depth[marked])
    assert_allclose(camera.project(local)[0], camera.pixels(depth)[marked.reshape(-1)], atol=1e-6)
    assert_allclose(fresh.scales, (CONFIG.insert_scale * depth[marked] / camera.focal)[:, None].expand(-1, dim))
    assert_allclose(fresh.opacities, CONFIG.insert_opacity, rtol=1e-6)
    assert_allclose(fresh.colors, frame.color[marked])


@pytest.mark.parametrize("dim", [2, 3])
def test_the_loss_is_equation_two(dim, rng):
    splat_map, camera, pose = random_map(rng, 20, dim), camera_for(dim, 6, 4), random_pose(rng, dim)
    color = torch.from_numpy(rng.uniform(0, 1, (*camera.shape, 3)))
    depth = torch.from_numpy(rng.uniform(0.5, 4, camera.shape))
    depth[..., :2] = torch.tensor([0.0, math.nan])
    frame = Frame(color, depth, pose)
    drawn = render.render(splat_map, camera, pose)
    total, count = 0.0, 0
    for index in np.ndindex(*camera.shape):
        if index[-1] < 2:
            continue
        total += sum(abs(float(drawn.color[index][c] - color[index][c])) for c in range(3))
        total += 0.7 * abs(float(drawn.depth[index] - depth[index]))
        count += 1
    assert_allclose(mapping.loss(splat_map, camera, frame, 0.7), total / count, rtol=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
def test_fitting_lowers_the_loss_and_heeds_missing_depths(dim, rng):
    truth, camera, pose = random_map(rng, 12, dim, torch.float32), camera_for(dim, 12, 6), random_pose(rng, dim)
    pose = pose.to(truth.means)
    drawn = render.render(truth, camera, pose)
    depth = drawn.depth.clone()
    depth[..., 0] = math.nan  # its slope must not spread
    frame = Frame(drawn.color, depth, pose)
    start = SplatMap(truth.means + 0.05, truth.log_scales + 0.2, *truth.tensors()[2:4], truth.colors * 0.7)
    config = CONFIG.replace(fit_steps=40)
    fitted = mapping.fit(start, camera, [frame], config)
    losses = [float(mapping.loss(m, camera, frame, 0.5)) for m in (truth, start, fitted)]
    assert losses[0] == 0
    assert losses[2] < 0.5 * losses[1]
    assert_allclose(torch.linalg.norm(fitted.rotations, dim=1), 1, rtol=1e-5)
    assert ((fitted.colors >= 0) & (fitted.colors <= 1)).all()
    assert mapping.fit(start, camera, [], config) is start
    assert mapping.fit(start, camera, [frame], config, steps=0) is start


def test_survivors_are_opaque_and_small(rng):
    splat_map = random_map(rng, 40, 2)
    keep = mapping.survivors(splat_map, CONFIG.replace(prune_opacity=0.4, prune_scale=0.2))
    expected = (splat_map.opacities >= 0.4) & (splat_map.scales.amax(1) <= 0.2)
    assert torch.equal(keep, expected)
    assert 0 < keep.sum() < 40


def test_ids_and_prior_follow_their_splats_through_insertion_and_pruning():
    camera, rng = camera_for(2, 32), np.random.default_rng(0)
    config = CONFIG.replace(fit_steps=0)  # splats keep their places, so that they can be recognised
    local = mapping.observe(empty(), camera, box_frame(camera, (2.0, 1.5), 0.3), config, rng)
    mark = torch.arange(32, dtype=torch.float32)[:, None].expand(-1, 9).contiguous()
    logits = torch.where(torch.arange(32) % 3 == 0, -9.0, local.splats.opacity_logits)  # to be pruned
    before = local.replace(prior=mark, splats=SplatMap(*local.splats.tensors()[:3], logits, local.splats.colors))
    after = mapping.observe(before, camera, box_frame(camera, (2.0, 1.5), 0.3 + math.pi), config, rng)
    kept = torch.arange(32)[torch.arange(32) % 3 > 0]
    assert after.ids[: len(kept)].tolist() == kept.tolist()
    assert torch.equal(after.prior[: len(kept)], mark[kept])
    assert torch.equal(after.splats.means[: len(kept)], local.splats.means[kept])
    assert after.ids[len(kept) :].tolist() == list(range(32, 64))
    assert not after.prior[len(kept) :].any()
    # what was pruned is born anew under new ids when it is seen again
    again = mapping.observe(after, camera, box_frame(camera, (2.0, 1.5), 0.3), config, rng)
    assert again.born > 64
    assert len(set(again.ids.tolist())) == again.splats.n_splats


def test_the_window_holds_the_latest_and_two_older_keyframes(rng):
    frames = tuple(
        Frame(torch.zeros(1, 3), torch.tensor([float(k)]), geometry.yaw_pose(torch.zeros(2), 0.0)) for k in range(20)
    )
    window = mapping.window(frames, CONFIG.replace(fit_window=6), rng)
    numbers = [int(f.depth[0]) for f in window]
    assert numbers[-6:] == list(range(14, 20))
    assert len(numbers) == 8
    assert sorted(numbers) == numbers
    assert [int(f.depth[0]) for f in mapping.window(frames[:4], CONFIG, rng)] == [0, 1, 2, 3]


def test_the_same_seed_gives_the_same_map():
    camera = camera_for(2, 32)
    maps = []
    for _ in range(2):
        rng, local = np.random.default_rng(3), empty()
        for k in range(10):
            local = mapping.observe(local, camera, box_frame(camera, (2.0, 1.5), 0.5 * k), CONFIG, rng)
        maps.append(local.splats)
    assert all(torch.equal(a, b) for a, b in zip(maps[0].tensors(), maps[1].tensors(), strict=True))


def test_an_empty_map_stays_one():
    local = empty(3)
    assert (local.splats.n_splats, local.prior.shape, local.born) == (0, (0, 13), 0)
    assert splats.union(local.splats, local.splats).n_splats == 0
