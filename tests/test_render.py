import math

import numpy as np
import pytest
import torch
from helpers import camera_for, random_map, random_pose, shifted
from numpy.testing import assert_allclose

from mannbv import geometry, information, render
from mannbv.render import flat
from mannbv.splats import SplatMap


def by_hand(splat_map, camera, pose):
    """Eq. (1) pixel by pixel and splat by splat, in numpy, with its own projection."""
    means, log_scales, rotations, logits, colors = (t.numpy().astype(float) for t in splat_map.tensors())
    turn, place = pose.rotation.numpy().astype(float), pose.position.numpy().astype(float)
    dim, f = means.shape[1], camera.focal
    size = [camera.width] if dim == 2 else [camera.width, camera.height]
    seen = []
    for mean, scale, rotation, logit, color in zip(means, log_scales, rotations, logits, colors, strict=True):
        local = turn.T @ (mean - place)
        z = local[-1]
        if z <= 0.1:
            continue
        if dim == 2:
            c, s = rotation / np.linalg.norm(rotation)
            axes = np.array([[c, -s], [s, c]])
        else:
            w, *v = rotation / np.linalg.norm(rotation)
            cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
            axes = np.eye(3) + 2 * w * cross + 2 * cross @ cross
        sigma = axes @ np.diag(np.exp(2 * scale)) @ axes.T
        jacobian = np.zeros((dim - 1, dim))
        center = np.zeros(dim - 1)
        for a in range(dim - 1):
            limit = 1.3 * (size[a] / 2) / f
            jacobian[a, a] = f / z
            jacobian[a, -1] = -f / z * min(max(local[a] / z, -limit), limit)
            center[a] = f * local[a] / z + size[a] / 2
        image = jacobian @ turn.T @ sigma @ turn @ jacobian.T + 0.3 * np.eye(dim - 1)
        opacity = 1 / (1 + math.exp(-logit))
        seen.append((np.linalg.norm(local), z, center, np.linalg.inv(image), opacity, color))
    seen.sort(key=lambda s: s[0])
    rows = []
    for line in range(1 if dim == 2 else camera.height):
        for column in range(camera.width):
            pixel = np.array([column + 0.5, line + 0.5])[: dim - 1]
            color, depth, through = np.zeros(3), 0.0, 1.0
            for _, z, center, inverse, opacity, own in seen:
                offset = pixel - center
                blend = min(0.99, opacity * math.exp(-0.5 * offset @ inverse @ offset))
                color, depth, through = (
                    color + own * blend * through,
                    depth + z * blend * through,
                    through * (1 - blend),
                )
            rows.append([*color, depth, 1 - through])
    image = np.array(rows).reshape(*camera.shape, 5)
    return image[..., :3], image[..., 3], image[..., 4]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_images_agree_with_the_formula_by_hand(dim, dtype, rng):
    for _ in range(4):
        splat_map = random_map(rng, 30, dim, dtype)  # some behind and beside the camera, some as large as the view
        camera, pose = camera_for(dim, 9, 6), random_pose(rng, dim)
        drawn = render.render(splat_map, camera, pose, method="dense")
        assert drawn.color.dtype == dtype
        assert drawn.color.shape == (*camera.shape, 3)
        expected = by_hand(splat_map, camera, pose)
        bound = {torch.float32: 3e-4, torch.float64: 1e-10}[dtype]
        for got, want in zip((drawn.color, drawn.depth, drawn.opacity), expected, strict=True):
            assert_allclose(got, want, rtol=bound, atol=bound)
        assert expected[2].max() > 0.3


@pytest.mark.parametrize("dim", [2, 3])
def test_an_empty_map_or_view_is_black(dim):
    camera, pose = camera_for(dim, 5, 4), geometry.yaw_pose(torch.zeros(dim), 0.0)
    behind = torch.zeros(1, dim)
    behind[0, 0] = -2.0
    for splat_map in (
        SplatMap.empty(dim),
        SplatMap(behind, behind, geometry.identity_rotations(1, dim), torch.zeros(1), torch.ones(1, 3)),
    ):
        drawn = render.render(splat_map, camera, pose)
        assert drawn.color.shape == (*camera.shape, 3)
        assert not any(t.any() for t in (drawn.color, drawn.depth, drawn.opacity))


@pytest.mark.parametrize("dim", [2, 3])
def test_one_pixel_sees_the_splat_before_it(dim):
    camera = camera_for(dim, 1, 1)
    means = torch.zeros(2, dim, dtype=torch.float64)
    means[:, 0] = torch.tensor([3.0, 2.0])  # the second is in front
    splat_map = SplatMap(
        means,
        torch.full((2, dim), -2.0, dtype=torch.float64),
        geometry.identity_rotations(2, dim).double(),
        torch.tensor([20.0, 0.0], dtype=torch.float64),  # capped at 0.99; one half
        torch.tensor([[1.0, 0, 0], [0, 1.0, 0]], dtype=torch.float64),
    )
    drawn = render.render(splat_map, camera, geometry.yaw_pose(torch.zeros(dim), 0.0))
    assert_allclose(drawn.color.reshape(3), [0.5 * 0.99, 0.5, 0.0])
    assert_allclose(drawn.depth.reshape(()), 0.5 * 2 + 0.5 * 0.99 * 3)
    assert_allclose(drawn.opacity.reshape(()), 0.5 + 0.5 * 0.99)


@pytest.mark.parametrize("dim", [2, 3])
def test_images_are_differentiable_in_everything(dim, rng):
    splat_map = random_map(rng, 4, dim)
    ahead = torch.tensor([3.0, 0.0, 0.0][:dim], dtype=torch.float64)
    means = 0.3 * splat_map.means + ahead
    camera, pose = camera_for(dim, 3, 2), geometry.yaw_pose(torch.zeros(dim, dtype=torch.float64), 0.1)

    def image(position, *fields):
        drawn = render.render(SplatMap(*fields), camera, geometry.Pose(pose.rotation, position))
        return torch.cat([drawn.color.reshape(-1), drawn.depth.reshape(-1), drawn.opacity.reshape(-1)])

    inputs = [pose.position, means, *splat_map.tensors()[1:]]
    inputs = [t.clone().requires_grad_(True) for t in inputs]
    assert torch.autograd.gradcheck(image, inputs)


@pytest.mark.parametrize("dim", [2, 3])
def test_moving_world_and_camera_together_changes_nothing(dim, rng):
    splat_map, camera, pose = random_map(rng, 20, dim), camera_for(dim, 7, 5), random_pose(rng, dim)
    offset = torch.from_numpy(rng.normal(size=dim) * 10)
    one = render.render(splat_map, camera, pose)
    other = render.render(shifted(splat_map, offset), camera, geometry.Pose(pose.rotation, pose.position + offset))
    assert_allclose(one.color, other.color, atol=1e-10)
    order = torch.from_numpy(rng.permutation(20))
    assert_allclose(render.render(splat_map.select(order), camera, pose).color, one.color, atol=1e-10)


def test_the_order_is_by_range_not_by_depth():
    """A splat ahead at 3 m and one aside, farther but of smaller depth; both wide."""
    means = torch.tensor([[3.0, 0.0], [2.8, 2.2]], dtype=torch.float64)
    splat_map = SplatMap(
        means,
        torch.zeros(2, 2, dtype=torch.float64),
        geometry.identity_rotations(2, 2).double(),
        torch.full((2,), 10.0, dtype=torch.float64),
        torch.eye(3, dtype=torch.float64)[:2],
    )
    drawn = render.compose(splat_map, camera_for(2, 8), geometry.yaw_pose(torch.zeros(2), 0.0))
    assert drawn.index.tolist() == [0, 1]


@pytest.mark.parametrize(
    ("map_dim", "camera_dim", "pose_dim"), [(2, 3, 2), (3, 2, 3), (2, 2, 3), (3, 3, 2), (2, 3, 3), (3, 2, 2)]
)
def test_dimensions_that_do_not_fit_are_named(map_dim, camera_dim, pose_dim, rng):
    with pytest.raises(ValueError, match=r"^render: a .-D map, a .-D pose and a .-axis image do not fit"):
        render.render(random_map(rng, 2, map_dim), camera_for(camera_dim, 4), random_pose(rng, pose_dim))


def test_unknown_methods_are_named(rng):
    with pytest.raises(ValueError, match="render: unknown method 'fast'"):
        render.render(random_map(rng, 2, 2), camera_for(2, 4), random_pose(rng, 2), method="fast")


def test_the_kernel_is_the_dense_twin_when_it_drops_nothing(rng):
    for _ in range(4):
        splat_map, camera, pose = random_map(rng, 40, 2), camera_for(2, 33), random_pose(rng, 2)
        twin = render.render(splat_map, camera, pose, method="dense")
        image = flat.render(splat_map, camera, pose, cutoff=0.0, floor=0.0)
        expected = torch.cat([twin.color.T, twin.depth[None], twin.opacity[None]])
        assert_allclose(image, expected, rtol=1e-10, atol=1e-12)


def test_the_kernels_gradients_are_those_of_its_twin(rng):
    splat_map, camera, pose = random_map(rng, 40, 2), camera_for(2, 33), random_pose(rng, 2)
    slopes = torch.from_numpy(rng.normal(size=(5, 33)))
    grads = []
    for kernel in (True, False):
        leaves = [
            1.3 * t if k == 2 else t.clone() for k, t in enumerate(splat_map.tensors())
        ]  # rotations not of length 1
        leaves = [t.requires_grad_(True) for t in leaves]
        if kernel:
            image = flat.render(SplatMap(*leaves), camera, pose, cutoff=0.0, floor=0.0)
        else:
            twin = render.render(SplatMap(*leaves), camera, pose, method="dense")
            image = torch.cat([twin.color.T, twin.depth[None], twin.opacity[None]])
        grads.append(torch.autograd.grad((slopes * image).sum(), leaves))
    for kernel, twin in zip(*grads, strict=True):
        assert_allclose(kernel, twin, rtol=1e-8, atol=1e-9)
        assert twin.abs().max() > 0.1


def test_the_kernel_drops_no_more_than_it_says(rng):
    """Leaving out a blend ρ changes a colour in [0, 1] by ρ at most; a full pixel by its last 1e-4."""
    for _ in range(5):
        splat_map, camera, pose = random_map(rng, 60, 2, torch.float32), camera_for(2, 40), random_pose(rng, 2)
        pose = pose.to(splat_map.means)
        fast, twin = (render.render(splat_map, camera, pose, method=m) for m in ("tiled", "dense"))
        blend = render.compose(splat_map, camera, pose).blend
        bound = torch.where(blend < flat.CUTOFF * 1.0001, blend, 0.0).sum(0) + flat.FLOOR + 1e-5
        assert ((fast.color - twin.color).abs().amax(1) <= bound).all()
        assert ((fast.opacity - twin.opacity).abs() <= bound).all()
        assert ((fast.depth - twin.depth).abs() <= 6 * bound).all()  # nothing is deeper than 6 m
        assert (fast.opacity - twin.opacity).abs().max() > 1e-5  # something was dropped: the bound is put to use


def test_the_kernel_serves_only_what_it_can(rng):
    flat, pose = random_map(rng, 3, 2, torch.float32), geometry.yaw_pose(torch.zeros(2), 0.0)
    assert torch.equal(
        render.render(flat, camera_for(2, 8), pose).color, render.render(flat, camera_for(2, 8), pose, "tiled").color
    )
    turning = geometry.yaw_pose(torch.zeros(2), torch.tensor(0.0, requires_grad=True))
    for splat_map, camera, view in [
        (flat.to(torch.float64), camera_for(2, 8), pose),
        (flat, camera_for(2, 8), turning),
        (random_map(rng, 3, 3), camera_for(3, 8), geometry.yaw_pose(torch.zeros(3), 0.0)),
    ]:
        with pytest.raises(ValueError, match="render: the kernel serves"):
            render.render(splat_map, camera, view, "tiled")
        assert render.render(splat_map, camera, view).color.shape == (*camera.shape, 3)  # auto falls back


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("field", range(5))
@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_the_twin_refuses_what_the_kernels_refuse(dim, field, bad, rng):
    """In the same words, for images and for information; it used to draw NaN."""
    parts = [part.clone() for part in random_map(rng, 6, dim, torch.float32).tensors()]
    parts[field].view(-1)[-1] = bad
    splat_map, camera, pose = SplatMap(*parts), camera_for(dim, 8), random_pose(rng, dim)
    words = set()
    for look in (render.render, information.fisher, information.blocks):
        for method in ("tiled", "dense"):
            with pytest.raises(ValueError, match="hold nan or infinity") as caught:
                look(splat_map, camera, pose, method=method)
            words.add(str(caught.value))
    assert len(words) == 1
