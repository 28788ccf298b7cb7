import math

import numpy as np
import pytest
import torch
from helpers import box_map, camera_for, random_map, random_pose
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from mannbv import geometry, information, render, splats
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.render import flat
from mannbv.splats import SplatMap


def moved(splat_map: SplatMap, omega):
    """The map with its parameters ω (n, p) changed: mean, log-scale, rotation in the body's tangent, logit, colour."""
    d = splat_map.dim
    mean, scale, turn, logit, color = omega.split([d, d, d * (d - 1) // 2, 1, 3], 1)
    if d == 2:
        c, s = splat_map.rotations.unbind(1)
        cos, sin = torch.cos(turn[:, 0]), torch.sin(turn[:, 0])
        rotations = torch.stack([c * cos - s * sin, c * sin + s * cos], 1)
    else:  # q ⊗ (1, θ/2), to first order
        w, v = splat_map.rotations[:, :1], splat_map.rotations[:, 1:]
        half = turn / 2
        rotations = torch.cat([w - (v * half).sum(1, keepdim=True), v + w * half + torch.linalg.cross(v, half)], 1)
    return SplatMap(
        splat_map.means + mean,
        splat_map.log_scales + scale,
        rotations,
        splat_map.opacity_logits + logit[:, 0],
        splat_map.colors + color,
    )


def jacobian(splat_map, camera, pose, others=None, sigma_color=0.05, sigma_depth=0.05):
    """∂(every channel of every pixel)/∂ω by autograd: (channels, n, p)."""

    def measured(omega):
        parts = [moved(splat_map, omega)] + ([others] if others is not None else [])
        drawn = render.render(splats.union(*parts), camera, pose, method="dense")
        return torch.cat([drawn.color.reshape(-1) / sigma_color, drawn.depth.reshape(-1) / sigma_depth])

    n_parameters = 2 * splat_map.dim + splat_map.dim * (splat_map.dim - 1) // 2 + 4
    return torch.func.jacrev(measured)(torch.zeros(splat_map.n_splats, n_parameters, dtype=torch.float64))


def crowded(rng, n, dim):
    """Splats all around, some behind and beside the camera, some so opaque that their blend is capped."""
    splat_map = random_map(rng, n, dim)
    capped = torch.arange(n) % 4 == 0
    log_scales = splat_map.log_scales + torch.where(capped, 1.5, 0.0)[:, None]
    logits = torch.where(capped, 12.0, splat_map.opacity_logits)
    return SplatMap(splat_map.means, log_scales, splat_map.rotations, logits, splat_map.colors)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("occluded", [False, True])
@pytest.mark.parametrize("sigmas", [(0.05, 0.05), (0.3, 0.01)])
def test_fisher_is_the_squared_jacobian_of_autograd(dim, occluded, sigmas, rng):
    noise, capped = {"sigma_color": sigmas[0], "sigma_depth": sigmas[1]}, 0
    for _ in range(6):
        splat_map, camera, pose = crowded(rng, 14, dim), camera_for(dim, 9, 5), random_pose(rng, dim)
        others = random_map(rng, 8, dim) if occluded else None
        capped += int((~render.compose(splat_map, camera, pose).free).sum())
        expected = (jacobian(splat_map, camera, pose, others, **noise) ** 2).sum(0)
        found = information.fisher(splat_map, camera, pose, others, method="dense", **noise)
        assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * float(expected.max()))
        assert torch.equal(found, information.fisher(splat_map, camera, pose, others, **noise))
        assert (expected.amax(0) > 0).all()  # every parameter was put to the test
        assert (expected.amax(1) == 0).any()  # as was a splat behind the camera
    assert capped  # and a blend at its cap


@pytest.mark.parametrize("dim", [2, 3])
def test_summing_channels_before_squaring_is_another_thing(dim, rng):
    """FisherRF's shortcut, one backward pass for the sum of all channels, misses terms: it must not pass."""
    splat_map, camera, pose = random_map(rng, 14, dim), camera_for(dim, 9, 5), random_pose(rng, dim)
    wrong = jacobian(splat_map, camera, pose).sum(0) ** 2
    right = information.fisher(splat_map, camera, pose)
    with pytest.raises(AssertionError):
        assert_allclose(wrong, right, rtol=0.1, atol=0.1 * float(right.max()))


@pytest.mark.parametrize("dim", [2, 3])
def test_others_only_occlude(dim, rng):
    splat_map, camera, pose = random_map(rng, 20, dim), camera_for(dim, 9, 5), random_pose(rng, dim)
    others = random_map(rng, 10, dim)
    whole = information.fisher(splats.union(splat_map, others), camera, pose)
    alone = information.fisher(splat_map, camera, pose)
    found = information.fisher(splat_map, camera, pose, others)
    assert_allclose(found, whole[:20], rtol=1e-12)
    assert found.shape == (20, information.n_parameters(dim))
    assert (found - alone).abs().max() > 1.0
    assert_allclose(information.fisher(splat_map, camera, pose, SplatMap.empty(dim).to(torch.float64)), alone)
    assert (found >= 0).all()
    assert information.fisher(SplatMap.empty(dim).to(torch.float64), camera, pose, others).shape[0] == 0


@pytest.mark.parametrize("occluded", [False, True])
def test_the_kernels_fisher_is_its_twins_when_it_drops_nothing(occluded, rng):
    for _ in range(4):
        splat_map, camera, pose = crowded(rng, 30, 2), camera_for(2, 33), random_pose(rng, 2)
        others = random_map(rng, 10, 2) if occluded else None
        joint = splat_map if others is None else splats.union(splat_map, others)
        twin = information.fisher(splat_map, camera, pose, others, sigma_color=0.1, sigma_depth=0.02)
        found = flat.fisher(joint, 30, camera, pose, 0.1, 0.02, cutoff=0.0, floor=0.0)
        assert_allclose(found, twin, rtol=1e-8, atol=1e-12 * float(twin.max()))


def test_what_the_kernel_drops_hardly_matters(rng):
    splat_map = box_map(rng, dtype=torch.float32)
    camera, pose = camera_for(2, 64), geometry.yaw_pose(torch.tensor([2.2, 1.7]), 0.5)
    fast, twin = (information.fisher(splat_map, camera, pose, method=m) for m in ("tiled", "dense"))
    assert not torch.equal(fast, twin)
    assert_allclose(fast.sum(0), twin.sum(0), rtol=0.02)


def test_unknown_methods_are_named(rng):
    with pytest.raises(ValueError, match="unknown method 'fast'"):
        information.fisher(random_map(rng, 2, 2), camera_for(2, 4), random_pose(rng, 2), method="fast")
    with pytest.raises(ValueError, match="yaw_profile: unknown method 'all'; use auto, panorama or views"):
        information.yaw_profile(random_map(rng, 2, 3), camera_for(3, 4), [0.0] * 3, torch.zeros(2, 13), method="all")


@pytest.mark.parametrize("dim", [2, 3])
def test_what_does_not_fit_together_is_named(dim, rng, unchecked):
    splat_map, camera, pose = random_map(rng, 3, dim), camera_for(dim, 4), random_pose(rng, dim)
    other, prior = camera_for(5 - dim, 4), torch.ones(3, information.n_parameters(dim))
    place = [0.0] * dim
    for words, call in (
        ("do not fit", lambda: information.fisher(splat_map, other, pose)),
        ("must be positive, got 0, 0.05", lambda: information.fisher(splat_map, camera, pose, sigma_color=0)),
        ("do not fit", lambda: information.yaw_profile(splat_map, other, place, prior)),
        ("do not fit", lambda: information.yaw_profile(splat_map, camera, [0.0] * (5 - dim), prior)),
        ("2 rows of prior for 3 splats", lambda: information.yaw_profile(splat_map, camera, place, prior[:2])),
        ("0 yaws", lambda: information.yaw_profile(splat_map, camera, place, prior, n_yaws=0)),
        ("7 columns", lambda: information.gain(prior[:, :7], prior[:, :7])),
        (r"weights must be \(3,\)", lambda: information.gain(prior, prior, torch.ones(2))),
        (r"selected must be \(3,\)", lambda: information.gain(prior, prior, None, [True])),
        ("True or False of each splat", lambda: information.gain(prior, prior, None, [0, 1, 2])),
    ):
        with pytest.raises(ValueError, match=words):
            call()


@pytest.mark.parametrize("dim", [2, 3])
def test_the_prior_is_the_sum_over_past_views(dim, rng):
    splat_map, camera = random_map(rng, 10, dim), camera_for(dim, 7, 5)
    poses = [random_pose(rng, dim) for _ in range(3)]
    expected = sum(information.fisher(splat_map, camera, pose, sigma_depth=0.2) for pose in poses)
    assert_allclose(information.prior(splat_map, camera, poses, sigma_depth=0.2), expected)
    assert not information.prior(splat_map, camera, []).any()


def test_damping_is_in_each_parameters_own_unit():
    config = Config(damping_mean=1.0, damping_scale=2.0, damping_rotation=3.0, damping_opacity=4.0, damping_color=5.0)
    assert information.damping(2, config).tolist() == [1, 1, 2, 2, 3, 4, 5, 5, 5]
    assert information.damping(3, config).tolist() == [1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 5, 5, 5]


def test_the_gain_by_hand(rng):
    acquired, prior = (torch.from_numpy(rng.uniform(0, 5, (6, 9))) for _ in range(2))
    weights = torch.from_numpy(rng.uniform(0, 1, 6))
    selected = torch.tensor([True, False, True, True, False, False])
    total = 0.0
    for s in (0, 2, 3):
        for k in range(9):
            total += float(weights[s] * acquired[s, k] / (prior[s, k] + 0.7))
    assert_allclose(information.gain(acquired, prior, weights, selected, 0.7), total)
    literal = sum(float((acquired[s] + 0.7) @ (1 / (prior[s] + 3 * 0.7))) for s in range(6))
    assert_allclose(information.gain(acquired, prior, damping=0.7, literal_views=3), literal)
    default = sum(float(acquired[s] @ (1 / (prior[s] + information.damping(2)))) for s in range(6))
    assert_allclose(information.gain(acquired, prior), default, rtol=1e-6)


@pytest.mark.parametrize("p", [9, 13])
def test_the_gain_is_a_trace_of_matrices(p, rng):
    """Eq. (5) with the diagonal matrices written out."""
    acquired, prior = (torch.from_numpy(rng.uniform(0, 5, (3, p))) for _ in range(2))
    h, past = np.diag(acquired.numpy().ravel()), np.diag(prior.numpy().ravel() + 0.5)
    assert_allclose(information.gain(acquired, prior, damping=0.5), np.trace(h @ np.linalg.inv(past)))


def test_weights_on_both_sides_cancel(rng):
    """Eqs. (14)-(15) read literally put the same V̄ on both: only splats of weight 0 then differ from no weights."""
    acquired, prior = (torch.from_numpy(rng.uniform(0, 5, (6, 9))) for _ in range(2))
    weights = torch.tensor([0.3, 1.0, 0.0, 1e-6, 0.8, 0.0], dtype=torch.float64)
    literal = information.gain(acquired, prior, weights, damping=0.5, weigh_prior=True)
    assert_allclose(literal, information.gain(acquired, prior, selected=weights > 0, damping=0.5))
    assert literal > information.gain(acquired, prior, weights, damping=0.5)


@settings(max_examples=50)
@given(st.integers(0, 2**32 - 1))
def test_gains_only_grow_with_splats_weights_and_ignorance(seed):
    rng = np.random.default_rng(seed)
    acquired, prior, more = (torch.from_numpy(rng.uniform(0, 5, (6, 9))) for _ in range(3))
    small = torch.from_numpy(rng.random(6) < 0.5)
    large = small | torch.from_numpy(rng.random(6) < 0.5)
    light = torch.from_numpy(rng.uniform(0, 1, 6))
    base = information.gain(acquired, prior, light, small)
    assert 0 <= base <= information.gain(acquired, prior, light, large) + 1e-12
    assert base <= information.gain(acquired, prior, light + 0.1, small) + 1e-12
    assert base >= information.gain(acquired, prior + more, light, small) - 1e-12


def test_what_the_gain_refuses():
    with pytest.raises(ValueError, match="prior \\+ damping must be positive"):
        information.gain(torch.ones(2, 9), torch.zeros(2, 9), damping=0.0)


def test_shapes_that_differ_are_named(unchecked):
    with pytest.raises(ValueError, match=r"acquired \(2, 9\) and prior \(3, 9\) must match"):
        information.gain(torch.ones(2, 9), torch.zeros(3, 9))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("occluded", [False, True])
def test_the_gains_slope_agrees_with_central_differences(dim, occluded, rng):
    splat_map, camera = random_map(rng, 25, dim), camera_for(dim, 16, 8)
    position, prior = torch.from_numpy(rng.uniform(-1, 1, dim)), torch.zeros(25, information.n_parameters(dim))
    others = random_map(rng, 10, dim) if occluded else None
    options = {"weights": torch.from_numpy(rng.uniform(0, 1, 25)), "selected": torch.arange(25) % 3 > 0}
    for yaw in (-2.0, 0.4, 1.7):
        value, slope = information.gain_and_slope(splat_map, camera, position, yaw, prior.double(), others, **options)
        h = 1e-5
        low, high = (
            information.gain_and_slope(splat_map, camera, position, yaw + s, prior.double(), others, **options)[0]
            for s in (-h, h)
        )
        assert abs(slope) > 1e-3
        assert_allclose(slope, (high - low) / (2 * h), rtol=1e-4)
        pose = geometry.yaw_pose(position, yaw)
        view = information.fisher(splat_map, camera, pose, others)
        assert_allclose(value, information.gain(view, prior.double(), **options), rtol=1e-9)


def room(rng, width, dtype=torch.float32):
    """A room's splats, of which two views are already had."""
    splat_map, camera = box_map(rng, dtype=dtype), camera_for(2, width)
    past = [geometry.yaw_pose(torch.tensor([1.0, 1.0], dtype=dtype), yaw) for yaw in (0.3, 2.0)]
    return splat_map, camera, information.prior(splat_map, camera, past)


PLACES = [(2.2, 1.7), (1.0, 3.0), (4.2, 1.2), (2.0, 3.2), (4.4, 3.4)]


@pytest.mark.parametrize(("width", "median", "largest"), [(64, 0.03, 0.3), (128, 0.01, 0.1), (256, 0.003, 0.03)])
def test_the_profile_is_close_to_separate_views(width, median, largest, rng):
    splat_map, camera, prior = room(rng, width)
    for place in PLACES:
        profile = information.yaw_profile(splat_map, camera, place, prior)
        views = information.yaw_profile(splat_map, camera, place, prior, method="views")
        assert_allclose(profile.yaws, -math.pi + np.arange(360) * math.radians(1))
        errors = abs(profile.gains / views.gains - 1)
        assert np.median(errors) < median
        assert errors.max() < largest


@pytest.mark.parametrize("width", [64, 128, 256])
def test_a_leading_yaw_is_nearly_the_best_of_all(width, rng):
    splat_map, camera, prior = room(rng, width)
    for place in PLACES:
        profile = information.yaw_profile(splat_map, camera, place, prior)
        views = information.yaw_profile(splat_map, camera, place, prior, method="views")
        leading = profile.leading(8)
        assert len(leading) == len(set(leading)) == 8
        assert leading[0] == profile.best
        assert max(views.gain_at(yaw) for yaw in leading) >= 0.98 * views.gains.max()
        assert views.gains.min() < 0.6 * views.gains.max()  # there was something to choose


def test_one_density_for_the_whole_image_would_not_do(rng, monkeypatch):
    """A pinhole stretches what it sees off its axis: with the axis's density throughout, the profile is wrong."""
    splat_map, camera, prior = room(rng, 128)
    views = information.yaw_profile(splat_map, camera, PLACES[0], prior, method="views").gains
    good = information.yaw_profile(splat_map, camera, PLACES[0], prior).gains
    right = flat.densities
    monkeypatch.setattr(flat, "densities", lambda *a: right(*a[:4], 0 * a[4], *a[5:]))
    bad = information.yaw_profile(splat_map, camera, PLACES[0], prior).gains
    assert np.median(abs(bad / views - 1)) > 10 * np.median(abs(good / views - 1))


def test_profile_and_views_agree_ever_better_with_more_pixels(rng):
    errors = []
    for width in (64, 256, 1024):
        splat_map, camera, prior = room(rng, width)
        profile = information.yaw_profile(splat_map, camera, PLACES[0], prior, n_yaws=24)
        views = information.yaw_profile(splat_map, camera, PLACES[0], prior, n_yaws=24, method="views")
        errors.append(np.median(abs(profile.gains / views.gains - 1)))
    assert errors[0] > 3 * errors[1]
    assert errors[2] < 0.005


def test_separate_views_are_fisher_and_gain(rng):
    for dim in (2, 3):
        splat_map, camera = random_map(rng, 15, dim), camera_for(dim, 8, 6)
        place, others = rng.uniform(-1, 1, dim), random_map(rng, 5, dim)
        prior = torch.from_numpy(rng.uniform(0, 3, (15, information.n_parameters(dim))))
        options = {"weights": torch.from_numpy(rng.uniform(0, 1, 15)), "selected": torch.arange(15) > 4, "damping": 2.0}
        profile = information.yaw_profile(
            splat_map, camera, place, prior, n_yaws=5, others=others, method="views", sigma_color=0.1, **options
        )
        for yaw, value in zip(profile.yaws, profile.gains, strict=True):
            view = information.fisher(splat_map, camera, geometry.yaw_pose(place, yaw), others, sigma_color=0.1)
            assert_allclose(value, information.gain(view, prior, **options), rtol=1e-9)
            assert_allclose(profile.gain_at(yaw), value, rtol=1e-9)
        differences = profile.gain_at(0.3 + 1e-5) - profile.gain_at(0.3 - 1e-5)
        assert_allclose(profile.slope_at(0.3), differences / 2e-5, rtol=1e-4)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_profiles_slope_agrees_with_central_differences(dtype, rng):
    splat_map, camera, prior = room(rng, 64, dtype)
    profile = information.yaw_profile(splat_map, camera, PLACES[0], prior)
    for yaw in rng.uniform(-4, 4, 10):
        differences = profile.gain_at(yaw + 1e-6) - profile.gain_at(yaw - 1e-6)
        assert_allclose(profile.slope_at(yaw), differences / 2e-6, rtol=1e-3, atol=1e-5 * profile.gains.max())
    for k in (0, 100, 359):
        assert_allclose(profile.gain_at(profile.yaws[k]), profile.gains[k], rtol=1e-9)
        assert_allclose(profile.gain_at(profile.yaws[k] + 2 * math.pi), profile.gains[k], rtol=1e-9)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_profile_is_linear_in_the_weights(dtype, rng):
    splat_map, camera, prior = room(rng, 64, dtype)
    a, b = (torch.from_numpy(rng.uniform(0, 1, splat_map.n_splats)).to(dtype) for _ in range(2))
    some = torch.from_numpy(rng.random(splat_map.n_splats) < 0.3)

    def gains(**options):
        return information.yaw_profile(splat_map, camera, PLACES[1], prior, **options).gains

    assert_allclose(gains(weights=2 * a + b), 2 * gains(weights=a) + gains(weights=b), rtol=1e-4)
    assert_allclose(gains(selected=some) + gains(selected=~some), gains(), rtol=1e-4)
    assert_allclose(gains(weights=some.to(dtype)), gains(selected=some), rtol=1e-5)
    assert not gains(weights=torch.zeros_like(a)).any()


def test_the_profile_lets_others_occlude(rng):
    splat_map, camera, prior = room(rng, 256)
    wall = box_map(rng, dtype=torch.float32)
    means = wall.means * 0.3 + torch.tensor([1.5, 1.2])  # a small opaque room around the camera
    others = SplatMap(means, wall.log_scales - 1, *wall.tensors()[2:])
    place = (2.2, 1.7)
    options = {"others": others, "n_yaws": 36}
    profile = information.yaw_profile(splat_map, camera, place, prior, **options)
    views = information.yaw_profile(splat_map, camera, place, prior, method="views", **options)
    alone = information.yaw_profile(splat_map, camera, place, prior, n_yaws=36)
    assert profile.gains.sum() < 0.2 * alone.gains.sum()
    assert_allclose(profile.gains.sum(), views.gains.sum(), rtol=0.05)


def test_two_pixels_gain_what_the_kernels_densities_say(rng):
    """A view of two pixels 45° apart: both lie in the middle of a column, so that nothing is interpolated."""
    columns, angle = 64, math.pi / 8
    camera = Camera(2, None, 0.5 / math.tan(angle))
    for step in (3, 20, 47):
        left, right = (step + 0.5 + k * columns / 8 for k in (0, 1))
        yaw = -((left + right) / 2 * 2 * math.pi / columns - math.pi)  # columns run to the right
        place = torch.from_numpy(rng.normal(size=2))
        around = yaw + rng.uniform(-0.5, 0.5, 25)  # none so far aside that the view would clamp it
        means = place + torch.from_numpy(rng.uniform(0.5, 3, (25, 1)) * np.stack([np.cos(around), np.sin(around)], 1))
        splat_map = SplatMap(means, *crowded(rng, 25, 2).tensors()[1:])
        worth = torch.from_numpy(rng.uniform(0, 1, (25, 9)))
        worth[::5] = 0  # occluders
        view = information.fisher(splat_map, camera, geometry.yaw_pose(place, yaw), sigma_color=0.1, sigma_depth=0.02)
        slants = np.array([-math.tan(angle), math.tan(angle)])
        found = flat.densities(splat_map, camera, place, worth, slants, columns, 0.1, 0.02, cutoff=0.0)
        cos, sin = math.cos(yaw), math.sin(yaw)
        total = found[:, 0, int(left)] + found[:, 1, int(right)]
        assert_allclose(total @ [1, cos * cos, 2 * cos * sin, sin * sin], (view * worth).sum(), rtol=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_profile_of_nothing_is_zero(dim):
    none = torch.zeros(0, information.n_parameters(dim))
    profile = information.yaw_profile(SplatMap.empty(dim), camera_for(dim, 8), [0.0] * dim, none)
    assert not profile.gains.any()
    assert profile.slope_at(0.3) == 0.0


@pytest.mark.parametrize("dim", [2, 3])
def test_a_prior_of_other_columns_and_negative_weights_are_refused(dim, rng, unchecked):
    splats, camera = random_map(rng, 12, dim, torch.float32), camera_for(dim, 16)
    for columns in (1, 8):
        with pytest.raises(ValueError, match="needs a prior of"):
            information.yaw_profile(splats, camera, torch.zeros(dim), torch.zeros(12, columns), damping=1.0)
    prior = torch.zeros(12, information.n_parameters(dim))
    with pytest.raises(ValueError, match="weights must not be negative, got -1"):
        information.yaw_profile(splats, camera, torch.zeros(dim), prior, weights=-torch.ones(12))
    with pytest.raises(ValueError, match="sigma_color and sigma_depth must be positive"):
        information.yaw_profile(splats, camera, torch.zeros(dim), prior, sigma_color=0.0)


def test_a_slope_is_a_slope_without_gradients_too(rng):
    splats, camera = random_map(rng, 12, 2), camera_for(2, 16)
    first = information.gain_and_slope(splats, camera, torch.zeros(2), 0.3, torch.zeros(12, 9))
    with torch.no_grad():
        assert information.gain_and_slope(splats, camera, torch.zeros(2), 0.3, torch.zeros(12, 9)) == first
    assert first[1] != 0
