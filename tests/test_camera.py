import math

import numpy as np
import pytest
import torch
from helpers import camera_for, random_pose
from numpy.testing import assert_allclose

from mannbv.camera import EDGE, Camera, Frame, back_project


def test_from_fov_puts_the_edge_rays_at_half_the_angle():
    camera = Camera.from_fov(64, fov=1.2)
    assert camera.dim == 2
    assert camera.shape == camera.size == (64,)
    assert_allclose(math.atan(32 / camera.focal), 0.6)
    assert_allclose(camera.fov, 1.2)
    space = Camera.from_fov(8, 6)
    assert (space.dim, space.size, space.shape) == (3, (8, 6), (6, 8))
    assert_allclose(space.focal, 4.0)  # 90°


@pytest.mark.parametrize("arguments", [(0,), (4, 0), (4, 4, 0.0), (4, 4, math.pi), (4, 4, math.nan), (4, None, -1.0)])
def test_impossible_cameras_are_named(arguments):
    with pytest.raises(ValueError, match=r"^camera: "):
        Camera.from_fov(*arguments)


@pytest.mark.parametrize("dim", [2, 3])
def test_rays_project_onto_their_pixels(dim):
    camera = camera_for(dim, 6, 4, 1.1)
    like = torch.zeros(0, dtype=torch.float64)
    pixels, rays = camera.pixels(like), camera.rays(like)
    assert_allclose(pixels[0], [0.5] * (dim - 1))
    assert_allclose(pixels[1, 0], 1.5)  # row-major: x runs fastest
    assert_allclose(rays[:, -1], 1)
    for depth in (0.3, 2.0):
        assert_allclose(camera.project(rays * depth)[0], pixels, atol=1e-12)


def test_images_put_right_to_the_right_and_down_below():
    centers, _ = camera_for(3, 8, 6).project(torch.tensor([[0.1, 0.2, 1.0]], dtype=torch.float64))
    assert centers[0, 0] > 4
    assert centers[0, 1] > 3


@pytest.mark.parametrize("dim", [2, 3])
def test_the_jacobian_is_that_of_the_projection_inside_the_clamp(dim, rng):
    camera = camera_for(dim, 8, 6)
    points = torch.from_numpy(rng.uniform(-0.5, 0.5, (20, dim)))
    points[:, -1] = torch.from_numpy(rng.uniform(1, 3, 20))
    _, jacobian = camera.project(points)
    for k in range(20):
        expected = torch.func.jacrev(lambda p: camera.project(p[None])[0][0])(points[k])
        assert_allclose(jacobian[k], expected, atol=1e-10)


def test_the_jacobian_clamps_each_axis_by_its_own_half_image():
    camera = camera_for(3, 8, 4)  # half images: 1 and 0.5 over the focal length
    _, jacobian = camera.project(torch.tensor([[9.0, 9.0, 1.0], [-9.0, 0.1, 1.0]], dtype=torch.float64))
    f = camera.focal
    assert_allclose(jacobian[0, :, 2], [-f * EDGE * 1.0, -f * EDGE * 0.5])
    assert_allclose(jacobian[1, :, 2], [f * EDGE * 1.0, -f * 0.1])


@pytest.mark.parametrize("dim", [2, 3])
def test_differentials_agree_with_autograd(dim, rng):
    camera = camera_for(dim, 9, 5)
    points = torch.from_numpy(rng.normal(size=(40, dim)) * 3)
    points[:, -1] = points[:, -1].abs() + 0.2  # some far beyond the clamp
    center, jacobian = camera.differentials(points)
    for k in range(len(points)):
        slopes = torch.func.jacrev(lambda p: tuple(x[0] for x in camera.project(p[None])))(points[k])
        assert_allclose(center[k], slopes[0], atol=1e-9)
        assert_allclose(jacobian[k], slopes[1], atol=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
def test_back_projection_undoes_projection(dim, rng):
    camera = camera_for(dim, 6, 4)
    pose = random_pose(rng, dim)
    depth = torch.from_numpy(rng.uniform(0.5, 4, camera.shape))
    frame = Frame(torch.zeros(*camera.shape, 3, dtype=torch.float64), depth, pose)
    points = back_project(frame, camera)
    local = pose.local(points)
    assert_allclose(local[:, -1], depth.reshape(-1))
    assert_allclose(camera.project(local)[0], camera.pixels(depth), atol=1e-9)


def test_frames_know_which_depths_are_real():
    depth = torch.tensor([1.0, 0.0, math.inf, math.nan, -1.0])
    frame = Frame(torch.zeros(5, 3), depth, random_pose(np.random.default_rng(0), 2))
    assert frame.valid.tolist() == [True, False, False, False, False]
