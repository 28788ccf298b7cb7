"""The tile kernel of space against its dense twin: image, gradients, information; the same bits on any threads."""

import math

import numba
import numpy as np
import pytest
import torch
from helpers import random_map, random_pose

from mannbv import information, render
from mannbv.camera import Camera
from mannbv.geometry import yaw_pose
from mannbv.kernels.space import tiles as pairs_of
from mannbv.render import space
from mannbv.splats import SplatMap

NAMES = ["plain", "clamped", "needles", "huge", "near", "loose rotations"]
SIZES = [(1, 1), (16, 16), (37, 23)]


def scene(name: str, rng, n=60) -> SplatMap:
    """Random splats all around the camera, before, beside and behind it, with one thing made hard."""
    means, log_scales, rotations, logits, colors = random_map(rng, n, 3).tensors()
    if name == "clamped":
        logits = logits + 8.0
    if name == "needles":
        log_scales = log_scales + torch.tensor([1.5, -4.0, -4.0])
    if name == "huge":
        log_scales = log_scales + 2.5
    if name == "near":
        means = means * 0.1
    if name == "loose rotations":
        rotations = rotations * 3.7
    return SplatMap(means, log_scales, rotations, logits, colors)


def image(drawn: render.Rendering) -> torch.Tensor:
    return torch.cat([drawn.color.movedim(-1, 0), drawn.depth[None], drawn.opacity[None]])


def with_slopes(draw, splats: SplatMap, slopes) -> list[torch.Tensor]:
    """The image and the gradient of its sum with `slopes` by every field."""
    leaves = [part.clone().requires_grad_() for part in splats.tensors()]
    drawn = draw(SplatMap(*leaves))
    (drawn * slopes).sum().backward()
    return [drawn.detach(), *(leaf.grad for leaf in leaves)]


def cast(splats: SplatMap, dtype) -> SplatMap:
    return SplatMap(*(part.to(dtype) for part in splats.tensors()))


def close(fast, slow, rtol) -> bool:
    return torch.allclose(fast, slow, rtol=rtol, atol=rtol * float(slow.abs().max()) + 1e-12)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", NAMES)
def test_kernel_and_twin_agree_to_the_last_digits_without_cut_offs(name, size, rng):
    splats, camera = scene(name, rng), Camera.from_fov(*size, fov=1.2)
    own, others = splats.select(torch.arange(40)), splats.select(torch.arange(40, 60))
    for _ in range(3):
        pose, slopes = random_pose(rng, 3), torch.from_numpy(rng.normal(size=(5, *camera.shape)))
        fast = with_slopes(lambda m, pose=pose: space.render(m, camera, pose, 0.0, 0.0), splats, slopes)
        slow = with_slopes(lambda m, pose=pose: image(render.render(m, camera, pose, "dense")), splats, slopes)
        assert all(close(a, b, 1e-9) for a, b in zip(fast, slow, strict=True))
        fast = space.fisher(splats, 40, camera, pose, 0.05, 0.1, 0.0, 0.0)
        slow = information.fisher(own, camera, pose, others, "dense", 0.05, 0.1)
        assert close(fast, slow, 1e-9)


@pytest.mark.parametrize("name", [name for name in NAMES if name != "near"])  # there hundreds of faint ones add up
def test_single_precision_with_cut_offs_stays_near_the_twin(name, rng):
    """Dropped blends cost at most a few grey levels somewhere and little on average; information a tenth."""
    splats, camera = scene(name, rng, 200), Camera.from_fov(60, 45)
    single = cast(splats, torch.float32)
    for _ in range(3):
        pose = random_pose(rng, 3)
        fast, slow = image(render.render(single, camera, pose, "tiled")), image(render.render(splats, camera, pose))
        gap = (fast.double() - slow).abs() / slow.amax((1, 2), keepdim=True).clamp_min(1.0)
        assert gap.mean() < 2e-3 and gap.max() < 0.05
        fast, slow = (information.fisher(m, camera, pose) for m in (single, splats))
        total = slow.sum(0)
        assert ((fast.double().sum(0) - total).abs() < 0.1 * total + 1e-9).all()


def test_single_precision_alone_costs_a_millionth(rng):
    splats, camera, pose = scene("needles", rng, 200), Camera.from_fov(64, 48), random_pose(rng, 3)
    single = cast(splats, torch.float32)
    slopes = torch.from_numpy(rng.normal(size=(5, 48, 64)))
    for fast, slow in zip(
        with_slopes(lambda m: space.render(m, camera, pose, 0.0, 0.0), single, slopes.float()),
        with_slopes(lambda m: space.render(m, camera, pose, 0.0, 0.0), splats, slopes),
        strict=True,
    ):
        assert (fast.double() - slow).abs().max() < 1e-4 * slow.abs().max()


def test_the_same_bits_whatever_the_number_of_threads(rng):
    splats, camera, pose = cast(scene("plain", rng, 3000), torch.float32), Camera.from_fov(150, 90), random_pose(rng, 3)
    slopes = torch.from_numpy(rng.normal(size=(5, 90, 150)).astype(np.float32))
    before, answers = numba.get_num_threads(), []
    try:
        for threads in (1, numba.config.NUMBA_NUM_THREADS, 1):
            numba.set_num_threads(threads)
            answers.append(with_slopes(lambda m: space.render(m, camera, pose), splats, slopes))
            answers[-1].append(space.fisher(splats, 2000, camera, pose, 0.05, 0.1))
    finally:
        numba.set_num_threads(before)
    for answer in answers[1:]:
        assert all(torch.equal(a, b) for a, b in zip(answers[0], answer, strict=True))


def test_every_pixel_finds_every_splat_that_reaches_it(rng):
    """The pairs against brute force over pixels; a tile too few would leave holes, which no tolerance may hide."""
    splats, camera, pose = scene("needles", rng, 300), Camera.from_fov(75, 50), random_pose(rng, 3)
    seen = space.sort(splats, camera, pose)
    x, y = np.meshgrid(np.arange(75) + 0.5, np.arange(50) + 0.5)
    across, needed, kept = -(-75 // pairs_of.TILE), set(), set()
    for s, (u, v, a, b, c, reach) in enumerate(seen.splats[:, :6]):
        hit = (a * (x - u) + b * (y - v)) ** 2 + (c * (y - v)) ** 2 <= reach
        needed |= {(int(py // 16) * across + int(px // 16), s) for px, py in zip(x[hit], y[hit], strict=True)}
    for tile in range(len(seen.tiles) - 1):
        row = seen.pairs[seen.tiles[tile] : seen.tiles[tile + 1]]
        assert (np.diff(row) > 0).all()  # front to back, each once
        kept |= {(tile, int(s)) for s in row}
    assert needed <= kept and len(kept) < 1.1 * len(needed) + 10
    for s in range(len(seen.splats)):
        assert (seen.pairs[seen.places[seen.starts[s] : seen.starts[s + 1]]] == s).all()
    assert len(seen.places) == len(seen.pairs) == len(np.unique(seen.places))


def test_equal_ranges_keep_the_order_of_the_map():
    double = SplatMap(
        torch.tensor([[2.0, 0, 0]] * 2), torch.full((2, 3), -1.5), torch.tensor([[1.0, 0, 0, 0]] * 2),
        torch.tensor([2.0, 2.0]), torch.tensor([[1.0, 0, 0], [0, 1.0, 0]]),
    )  # fmt: skip
    pose = yaw_pose(torch.zeros(3), 0.0)
    color = render.render(double, Camera.from_fov(9, 9), pose, "tiled").color[4, 4]
    assert color[0] > 3 * color[1] > 0


def test_nothing_to_see_is_black_and_has_no_slope(rng):
    camera, pose = Camera.from_fov(20, 10), random_pose(rng, 3)
    empty = cast(scene("plain", rng, 0), torch.float32)
    assert torch.equal(image(render.render(empty, camera, pose, "tiled")), torch.zeros(5, 10, 20))
    assert information.fisher(empty, camera, pose, method="tiled").shape == (0, 13)
    behind = SplatMap(pose.position[None].float() - 2 * pose.rotation[:, 2].float(), *(part[:1] for part in cast(scene("plain", rng), torch.float32).tensors()[1:]))  # fmt: skip  # noqa: E501
    drawn = with_slopes(lambda m: image(render.render(m, camera, pose, "tiled")), behind, torch.ones(5, 10, 20))
    assert all(float(part.abs().max()) == 0 for part in drawn)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        (0, math.nan, "means hold nan"),
        (3, math.inf, "opacity_logits hold nan or inf"),
        (1, 80.0, "a splat of e\\^80 m"),
    ],
)
def test_what_the_kernel_must_not_see_is_refused(field, value, message, rng):
    parts = [part.clone() for part in cast(scene("plain", rng), torch.float32).tensors()]
    parts[field].view(-1)[5] = value
    with pytest.raises(ValueError, match=message):
        render.render(SplatMap(*parts), Camera.from_fov(8, 8), random_pose(rng, 3))


def test_auto_draws_with_the_kernel_where_it_applies_and_with_the_twin_elsewhere(rng):
    splats, camera, pose = scene("plain", rng), Camera.from_fov(20, 10), random_pose(rng, 3)
    assert render.engine("auto", cast(splats, torch.float32), pose.position) is space
    assert render.engine("auto", splats, pose.position) is None  # float64
    assert render.engine("auto", cast(splats, torch.float32), pose.position.requires_grad_()) is None
    with pytest.raises(ValueError, match="the kernel serves float32"):
        render.render(splats, camera, pose, "tiled")
    with pytest.warns(UserWarning, match=r"this map is on meta: the dense twin draws it"):  # any device but the CPU
        assert render.engine("tiled", cast(splats, torch.float32).to("meta")) is None


def test_a_rotation_of_no_length_is_refused(rng):
    means, log_scales, rotations, *rest = cast(scene("plain", rng), torch.float32).tensors()
    rotations = rotations.clone()
    rotations[3] = 0.0
    with pytest.raises(ValueError, match="rotations hold one of no length"):
        render.render(SplatMap(means, log_scales, rotations, *rest), Camera.from_fov(8, 8), random_pose(rng, 3))


def test_what_the_kernel_cannot_differentiate_is_an_error_and_no_wrong_number(rng):
    leaves = [part.requires_grad_() for part in cast(scene("plain", rng), torch.float32).tensors()]
    drawn = render.render(SplatMap(*leaves), Camera.from_fov(20, 16), random_pose(rng, 3), "tiled")
    (slope,) = torch.autograd.grad(drawn.color.sum(), leaves[2], create_graph=True)
    with pytest.raises(RuntimeError, match="does not require grad"):
        slope.square().sum().backward()
    with torch.no_grad():
        leaves[0].add_(0.3)  # the kernel's arrays are these very numbers
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        drawn.depth.sum().backward()
