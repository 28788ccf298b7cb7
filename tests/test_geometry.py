import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from mannbv import geometry
from mannbv.geometry import Pose


def skew(v):
    """By hand: [v]× in space, v·J in the plane."""
    if len(v) == 1:
        return np.array([[0, -v[0]], [v[0], 0]])
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def twist_matrix(twist):
    dim = {3: 2, 6: 3}[len(twist)]
    matrix = np.zeros((dim + 1, dim + 1))
    matrix[:dim, :dim], matrix[:dim, dim] = skew(twist[dim:]), twist[:dim]
    return matrix


@pytest.mark.parametrize("dim", [2, 3])
def test_exponentials_agree_with_scipy(dim, rng):
    for _ in range(20):
        turn = rng.normal(size=dim * (dim - 1) // 2)
        twist = np.concatenate([rng.normal(size=dim), turn])
        assert_allclose(geometry.so_exp(torch.from_numpy(turn)), expm(skew(turn)), atol=1e-12)
        assert_allclose(geometry.se_exp(torch.from_numpy(twist)), expm(twist_matrix(twist)), atol=1e-12)
    if dim == 3:
        assert_allclose(geometry.so_exp(torch.from_numpy(turn)), Rotation.from_rotvec(turn).as_matrix(), atol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, 2.0, math.pi - 1e-3, math.pi - 1e-7])
def test_logarithms_undo_exponentials(dim, angle, rng):
    for _ in range(10):
        axis = rng.normal(size=dim * (dim - 1) // 2)
        turn = torch.from_numpy(angle * axis / np.linalg.norm(axis))
        twist = torch.cat([torch.from_numpy(rng.normal(size=dim)), turn])
        assert_allclose(geometry.so_log(geometry.so_exp(turn)), turn, atol=1e-8)
        # near half a turn the shift is recovered through a solve, hence the looser bound
        assert_allclose(geometry.se_log(geometry.se_exp(twist)), twist, atol=1e-6)


@pytest.mark.parametrize("axis", [[1.0, 0, 0], [0, -1.0, 0], [0.6, 0, 0.8], [-0.48, 0.6, 0.64]])
def test_half_a_turn_keeps_its_axis_up_to_sign(axis):
    found = geometry.so_log(torch.from_numpy(2 * np.outer(axis, axis) - np.eye(3)))
    assert_allclose(np.linalg.norm(found), math.pi, atol=1e-9)
    assert_allclose(abs(found @ torch.tensor(axis, dtype=torch.float64)), math.pi, atol=1e-9)


@given(st.floats(-100, 100))
def test_wrap_is_the_same_angle_in_the_half_open_circle(angle):
    wrapped = geometry.wrap(angle)
    assert -math.pi <= wrapped <= math.pi
    assert_allclose([math.cos(wrapped), math.sin(wrapped)], [math.cos(angle), math.sin(angle)], atol=1e-12)


def test_wrap_takes_numbers_arrays_and_tensors():
    assert geometry.wrap(math.pi) == -math.pi
    assert_allclose(geometry.wrap(np.array([3 * math.pi / 2, -7.0])), [-math.pi / 2, 2 * math.pi - 7])
    assert_allclose(geometry.wrap(torch.tensor([4.0])), [4 - 2 * math.pi], rtol=1e-6)


def test_rotations_agree_with_scipy(rng):
    quaternions = rng.normal(size=(50, 4))  # w, x, y, z; not of unit length
    expected = Rotation.from_quat(quaternions[:, [1, 2, 3, 0]]).as_matrix()
    assert_allclose(geometry.rotation_matrices(torch.from_numpy(quaternions)), expected, atol=1e-12)
    angles = rng.uniform(-4, 4, 50)
    turns = np.stack([np.cos(angles), np.sin(angles)], 1) * rng.uniform(0.5, 2, (50, 1))
    expected = np.stack([expm(skew([a])) for a in angles])
    assert_allclose(geometry.rotation_matrices(torch.from_numpy(turns)), expected, atol=1e-12)
    assert geometry.rotation_matrices(torch.zeros(0, 4)).shape == (0, 3, 3)


@pytest.mark.parametrize("dim", [2, 3])
def test_covariances_have_the_scales_along_the_axes(dim, rng):
    n = 20
    log_scales = rng.normal(-2, 1, (n, dim))
    rotations = rng.normal(size=(n, 2 if dim == 2 else 4))
    found = geometry.covariances(torch.from_numpy(log_scales), torch.from_numpy(rotations)).numpy()
    matrices = geometry.rotation_matrices(torch.from_numpy(rotations)).numpy()
    for k in range(n):
        axes, variances = matrices[k], np.exp(2 * log_scales[k])
        assert_allclose(found[k] @ axes, axes * variances, rtol=1e-9, atol=1e-12)  # eigenvectors, eigenvalues
        assert_allclose(np.linalg.det(found[k]), variances.prod(), rtol=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
def test_identity_rotations_turn_nothing(dim):
    found = geometry.rotation_matrices(geometry.identity_rotations(4, dim))
    assert_allclose(found, np.broadcast_to(np.eye(dim), (4, dim, dim)))


def test_turn_generators_span_the_skew_matrices():
    for dim in (2, 3):
        basis = np.eye(dim * (dim - 1) // 2)
        assert_allclose(geometry.turn_generators(dim), np.stack([skew(e) for e in basis]))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0, math.pi])
def test_a_level_camera_looks_along_its_yaw(dim, yaw):
    position = np.arange(1.0, dim + 1)
    pose = geometry.yaw_pose(position, yaw)
    forward = np.array([math.cos(yaw), math.sin(yaw), 0.0])[:dim]
    right = np.array([math.sin(yaw), -math.cos(yaw), 0.0])[:dim]  # clockwise, seen from above
    assert_allclose(pose.rotation[:, -1], forward, atol=1e-12)
    assert_allclose(pose.rotation[:, 0], right, atol=1e-12)
    if dim == 3:
        assert_allclose(pose.rotation[:, 1], [0, 0, -1])  # down
    assert_allclose(pose.rotation.T @ pose.rotation, np.eye(dim), atol=1e-12)
    assert abs(geometry.wrap(pose.yaw - yaw)) < 1e-9
    assert -math.pi <= pose.yaw < math.pi
    # in a plane seen from above, (right, forward) is a right-handed frame, as (right, down, forward) is in space
    assert_allclose(np.linalg.det(pose.rotation), 1.0)
    assert pose.dim == dim


def test_yaw_keeps_its_gradient():
    yaw = torch.tensor(0.3, dtype=torch.float64, requires_grad=True)
    pose = geometry.yaw_pose(torch.zeros(3, dtype=torch.float64), yaw)
    (slope,) = torch.autograd.grad(pose.rotation[0, -1], yaw)
    assert_allclose(slope, -math.sin(0.3))


@pytest.mark.parametrize("position", [[0.0], [0.0, math.nan], [1.0, 2.0, math.inf], [[0.0, 0.0]], [0.0] * 4])
def test_yaw_pose_names_a_bad_position(position):
    with pytest.raises(ValueError, match="yaw_pose: position must be 2 or 3 finite coordinates"):
        geometry.yaw_pose(position, 0.0)


def test_whole_coordinates_become_floats():
    assert geometry.yaw_pose([1, 2], 0.0).position.is_floating_point()


def test_a_pose_takes_arrays_and_lists_and_names_bad_shapes(unchecked):
    for kind in (np.array, list, torch.tensor):
        pose = Pose(kind([[0, -1], [1, 0]]), kind([2, 3]))
        assert_allclose(pose.local(torch.tensor([[3.0, 3.0]])), [[0.0, -1.0]])
    double = torch.eye(3, dtype=torch.float64)
    assert Pose(double, double[0]).rotation is double
    for rotation, position in ((torch.eye(3), torch.zeros(2)), (torch.eye(4), torch.zeros(4)), (torch.eye(2), 0.0)):
        with pytest.raises(ValueError, match=r"pose: rotation must be \(d, d\) and position \(d,\)"):
            Pose(rotation, position)


@pytest.mark.parametrize("dim", [2, 3])
def test_local_coordinates_undo_the_pose(dim, rng):
    turn = torch.from_numpy(rng.normal(size=dim * (dim - 1) // 2))
    pose = Pose(geometry.so_exp(turn), torch.from_numpy(rng.normal(size=dim)))
    camera_points = rng.normal(size=(7, dim))
    homogeneous = np.concatenate([camera_points, np.ones((7, 1))], 1)
    world = (pose.matrix().numpy() @ homogeneous.T).T
    assert_allclose(world[:, -1], 1)
    assert_allclose(pose.local(torch.from_numpy(world[:, :dim])), camera_points, atol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_moved_goes_in_the_cameras_own_frame(dim, rng):
    pose = geometry.yaw_pose(rng.normal(size=dim), 0.4)
    step = np.zeros(dim + dim * (dim - 1) // 2)
    step[dim - 1] = 0.25  # forward
    ahead = pose.moved(torch.from_numpy(step))
    assert_allclose(ahead.position, pose.position + 0.25 * pose.rotation[:, -1], atol=1e-12)
    assert_allclose(ahead.rotation, pose.rotation, atol=1e-12)
    twist = rng.normal(size=len(step))
    expected = pose.matrix().numpy() @ expm(twist_matrix(twist))
    assert_allclose(pose.moved(torch.from_numpy(twist)).matrix(), expected, atol=1e-12)


def test_small_inverses_are_inverses(rng):
    for size in (1, 2):
        stack = rng.normal(size=(10, size, size))
        assert_allclose(geometry.small_inverse(torch.from_numpy(stack)), np.linalg.inv(stack), rtol=1e-9)
