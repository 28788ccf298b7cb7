"""Flatland's kernel against its dense twin, and the yaw profile against separate views in the bundled scenes."""

import math

import numpy as np
import pytest
import torch
from helpers import box_map, random_map, random_pose

from mannbv import geometry, information, mapping, render, world
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.render import flat
from mannbv.splats import SplatMap


def scene(name: str, rng) -> SplatMap:
    """Random splats all around the camera, with one thing made hard."""
    splats = random_map(rng, 80, 2, torch.float64)
    means, log_scales, rotations, logits, colors = splats.tensors()
    if name == "clamped":
        logits = logits + 8.0
    if name == "needles":
        log_scales = log_scales + torch.tensor([1.5, -4.0])
    if name == "huge":
        log_scales = log_scales + 2.5
    if name == "near":
        means = means * 0.1
    if name == "loose rotations":
        rotations = rotations * 3.7
    return SplatMap(means, log_scales, rotations, logits, colors)


NAMES = ["plain", "clamped", "needles", "huge", "near", "loose rotations"]


def image(drawn: render.Rendering) -> torch.Tensor:
    return torch.cat([drawn.color.T, drawn.depth[None], drawn.opacity[None]])


@pytest.mark.parametrize("width", [1, 24, 61])
@pytest.mark.parametrize("name", NAMES)
def test_kernel_and_twin_agree_to_the_last_digits_without_cut_offs(name, width, rng):
    splats, camera = scene(name, rng), Camera.from_fov(width, fov=1.2)
    for _ in range(4):
        pose, slopes = random_pose(rng, 2), torch.from_numpy(rng.normal(size=(5, width)))
        answers = []
        for draw in (lambda m: flat.render(m, camera, pose, 0.0, 0.0), lambda m: image(render.render(m, camera, pose, "dense"))):  # fmt: skip  # noqa: E501, B023
            leaves = [t.clone().requires_grad_() for t in splats.tensors()]
            drawn = draw(SplatMap(*leaves))
            (drawn * slopes).sum().backward()
            answers.append([drawn.detach(), *(t.grad for t in leaves)])
        for fast, slow in zip(*answers, strict=True):
            assert torch.allclose(fast, slow, rtol=1e-9, atol=1e-9 * float(slow.abs().max()) + 1e-12)
        fast = flat.fisher(splats, 50, camera, pose, 0.05, 0.1, 0.0, 0.0)
        own, others = splats.select(torch.arange(50)), splats.select(torch.arange(50, 80))
        slow = information.fisher(own, camera, pose, others, "dense", 0.05, 0.1)
        assert torch.allclose(fast, slow, rtol=1e-9, atol=1e-9 * float(slow.max()) + 1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_cut_offs_cost_little(name, rng):
    splats, camera = scene(name, rng).to(torch.float32), Camera.from_fov(64)
    for _ in range(4):
        pose = random_pose(rng, 2)
        fast, slow = (image(render.render(splats, camera, pose, method)) for method in ("tiled", "dense"))
        assert float((fast - slow).abs().max()) <= 0.03 * float(slow.abs().max())
        fast, slow = (information.fisher(splats, camera, pose, method=method) for method in ("tiled", "dense"))
        assert float((fast - slow).abs().sum()) <= 0.05 * float(slow.sum())


def test_an_empty_map_draws_nothing_and_tells_nothing():
    camera, pose = Camera.from_fov(16), geometry.yaw_pose([0.0, 0.0], 0.0)
    assert float(image(render.render(SplatMap.empty(2), camera, pose, "tiled")).abs().max()) == 0
    assert information.fisher(SplatMap.empty(2), camera, pose).shape == (0, 9)


def test_the_kernel_says_where_it_does_not_serve(rng):
    camera, pose = Camera.from_fov(8, 8), geometry.yaw_pose([0.0, 0.0, 0.0], 0.0)
    with pytest.raises(ValueError, match="float32 on the CPU"):
        render.render(random_map(rng, 3, 3), camera, pose, "tiled")
    with pytest.raises(ValueError, match="tilde"):
        render.render(random_map(rng, 3, 3), camera, pose, "tilde")


def test_a_gradient_in_the_pose_goes_through_the_twin(rng):
    splats, camera = random_map(rng, 40, 2, torch.float32), Camera.from_fov(32)
    yaw = torch.tensor(0.3, requires_grad=True)
    drawn = render.render(splats, camera, geometry.yaw_pose(torch.zeros(2), yaw))
    (slope,) = torch.autograd.grad(drawn.color.sum(), yaw)
    views = [
        render.render(splats.to(torch.float64), camera, geometry.yaw_pose(torch.zeros(2).double(), 0.3 + h), "dense")
        for h in (1e-5, -1e-5)
    ]
    assert float(slope) == pytest.approx(float((views[0].color.sum() - views[1].color.sum()) / 2e-5), rel=1e-2)


def mapped(scene: str, robot: int, width: int):
    """A robot's map of a bundled scene after a look around and two steps on its way, and where it goes next."""
    place, config, camera = world.load(scene), Config(image_width=width, fit_steps=10), Camera.from_fov(width)
    path = place.ground.shortest_path(place.starts[robot], place.goals[robot], 0.2)
    local = mapping.LocalMap.empty(2, information.n_parameters(2))
    spots = [path[0]] * 4 + [path[len(path) // 4]] * 2
    for k, spot in enumerate(spots):
        frame = place.sense(camera, geometry.yaw_pose(torch.from_numpy(spot), k * math.pi / 2))
        local = mapping.observe(local, camera, frame, config, np.random.default_rng(0))
    prior = information.prior(local.splats, camera, [frame.pose for frame in local.keyframes])
    return local.splats, camera, path[16], prior


@pytest.mark.parametrize("width", [64, 256])
@pytest.mark.parametrize("name", ["flat", "corridor", "openplan", "wings"])
def test_the_profile_is_the_gain_of_separate_views(name, width):
    """Median error within 3 %; the best of the eight leading yaws, rendered, within 2 % of the best of 360 views."""
    for robot in range(2):
        splats, camera, spot, prior = mapped(name, robot, width)
        profile = information.yaw_profile(splats, camera, spot, prior)
        views = information.yaw_profile(splats, camera, spot, prior, method="views")
        assert np.median(np.abs(profile.gains - views.gains) / views.gains) < 0.03
        best = max(views.gain_at(yaw) for yaw in profile.leading(8))
        assert best > 0.98 * views.gains.max()
        naive = np.roll(profile.gains, 20)  # a profile that is turned by 20° fails both
        assert np.median(np.abs(naive - views.gains) / views.gains) > 0.03


def test_occluders_hide_but_gain_nothing(rng):
    """`others` in the profile is `others` in the separate views."""
    splats, others = box_map(rng, dtype=torch.float32), random_map(rng, 30, 2, torch.float32, reach=1.0)
    camera, spot, prior = Camera.from_fov(128), [1.5, 1.5], torch.ones(splats.n_splats, 9)
    profile = information.yaw_profile(splats, camera, spot, prior, others=others)
    views = information.yaw_profile(splats, camera, spot, prior, others=others, method="views", n_yaws=90)
    at = np.array([profile.gain_at(yaw) for yaw in views.yaws])
    assert np.median(np.abs(at - views.gains) / views.gains) < 0.03


@pytest.mark.parametrize(("field", "value", "message"), [(0, math.nan, "means hold nan"), (1, 400.0, "e\\^400 m")])
def test_what_the_kernel_must_not_see_is_refused(field, value, message, rng):
    parts = [part.clone() for part in random_map(rng, 9, 2, torch.float32).tensors()]
    parts[field].view(-1)[5] = value
    with pytest.raises(ValueError, match=message):
        render.render(SplatMap(*parts), Camera.from_fov(8), geometry.yaw_pose(torch.zeros(2), 0.0))
