"""Rotations, poses and covariances in the plane and in space (Section III-A of the paper).

Cameras look along their last axis: (right, forward) in flatland, (right, down, forward) in 3-D. Worlds have Z up.
Only the two lowest floors ask which of the two dimensions they are in; tests/test_house.py lists the exceptions.
"""

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import ArrayLike
from torch import Tensor

Angle = TypeVar("Angle", float, np.ndarray, Tensor)


@dataclass(frozen=True)
class Pose:
    """A camera's place in the world: x_world = rotation @ x_camera + position.

    rotation: (d, d), its columns the camera's axes in the world. position: (d,) [m]. Tensors, arrays or lists come in,
    floating tensors stay as they are. Raises ValueError for other shapes.
    """

    rotation: Float[Tensor, "d d"]
    position: Float[Tensor, " d"]

    def __post_init__(self):
        for name in ("rotation", "position"):
            object.__setattr__(self, name, _floating(getattr(self, name)))
        d = len(self.position) if self.position.ndim == 1 else 0
        if d not in (2, 3) or self.rotation.shape != (d, d):
            shapes = tuple(self.rotation.shape), tuple(self.position.shape)
            raise ValueError(f"pose: rotation must be (d, d) and position (d,) with d = 2 or 3, got {shapes}")

    @property
    def dim(self) -> int:
        return self.position.shape[-1]

    @property
    def yaw(self) -> float:
        """Heading of the optical axis in the ground plane [rad], in [−π, π)."""
        forward = self.rotation[:, -1].detach()
        return wrap(math.atan2(float(forward[1]), float(forward[0])))

    def to(self, like: Tensor) -> "Pose":
        """The same pose on the device and in the precision of `like`."""
        return Pose(self.rotation.to(like), self.position.to(like))

    def matrix(self) -> Tensor:
        """The homogeneous (d+1, d+1) matrix, camera to world."""
        top = torch.cat([self.rotation, self.position[:, None]], 1)
        bottom = torch.zeros(1, self.dim + 1).to(top)
        bottom[0, -1] = 1.0
        return torch.cat([top, bottom])

    def local(self, points: Tensor) -> Tensor:
        """World points (..., d) [m] in the camera's frame."""
        return (points - self.position) @ self.rotation

    def moved(self, twist: Tensor) -> "Pose":
        """This pose followed by exp(twist) in its own frame; twist (d + d(d−1)/2,) [m, rad]."""
        matrix = self.matrix() @ se_exp(twist)
        return Pose(matrix[:-1, :-1], matrix[:-1, -1])


def _floating(values: ArrayLike) -> Tensor:
    tensor = torch.as_tensor(values)
    return tensor if tensor.is_floating_point() else tensor.to(torch.get_default_dtype())


def wrap(angle: Angle) -> Angle:
    """Angle(s) [rad] brought into [−π, π); floats, arrays and tensors."""
    turned = (angle + math.pi) % (2 * math.pi) - math.pi
    return turned - 2 * math.pi * (turned >= math.pi)  # rounding can bring the remainder to 2π itself


def yaw_pose(position: ArrayLike, yaw: float | Tensor) -> Pose:
    """A level camera at `position` (d,) [m] that looks along `yaw` [rad], counter-clockwise from +x.

    A tensor `yaw` keeps its gradient. Raises ValueError for positions that are not finite (2,) or (3,) vectors.
    """
    position = _floating(position)
    if position.shape not in ((2,), (3,)) or not bool(torch.isfinite(position).all()):
        raise ValueError(f"yaw_pose: position must be 2 or 3 finite coordinates, got {position.tolist()}")
    yaw = torch.as_tensor(yaw, dtype=position.dtype, device=position.device)
    cos, sin, zero = torch.cos(yaw), torch.sin(yaw), torch.zeros_like(yaw)
    if len(position) == 2:
        axes = [torch.stack([sin, -cos]), torch.stack([cos, sin])]
    else:
        right, forward = torch.stack([sin, -cos, zero]), torch.stack([cos, sin, zero])
        axes = [right, torch.stack([zero, zero, zero - 1.0]), forward]
    return Pose(torch.stack(axes, -1), position)


def rotation_matrices(rotations: Float[Tensor, "n k"]) -> Float[Tensor, "n d d"]:
    """Matrices of unit complex numbers (cos, sin) (n, 2) or quaternions (w, x, y, z) (n, 4); inputs are normalised."""
    unit = torch.nn.functional.normalize(rotations, dim=-1)
    if unit.shape[-1] == 2:
        cos, sin = unit.unbind(-1)
        return torch.stack([cos, -sin, sin, cos], -1).reshape(-1, 2, 2)
    w, x, y, z = unit.unbind(-1)
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return torch.stack(rows, -1).reshape(-1, 3, 3)


def identity_rotations(n: int, dim: int) -> Tensor:
    """n rotations that turn nothing: (n, 2) complex numbers or (n, 4) quaternions."""
    rotations = torch.zeros(n, 2 if dim == 2 else 4)
    rotations[:, 0] = 1.0
    return rotations


def covariances(log_scales: Float[Tensor, "n d"], rotations: Float[Tensor, "n k"]) -> Float[Tensor, "n d d"]:
    """Σ = R S² Rᵀ [m²], with S = diag(exp(log_scales))."""
    factor = rotation_matrices(rotations) * torch.exp(log_scales)[:, None, :]
    return factor @ factor.transpose(-1, -2)


def turn_generators(dim: int) -> Tensor:
    """The basis of so(d): (d(d−1)/2, d, d) skew matrices; flatland has one, space has those about x, y and z."""
    if dim == 2:
        return torch.tensor([[[0.0, -1.0], [1.0, 0.0]]])
    return torch.tensor(
        [
            [[0.0, 0, 0], [0, 0, -1], [0, 1, 0]],
            [[0.0, 0, 1], [0, 0, 0], [-1, 0, 0]],
            [[0.0, -1, 0], [1, 0, 0], [0, 0, 0]],
        ]
    )


def so_exp(angles: Tensor) -> Tensor:
    """Rotation matrix (d, d) of a rotation vector, (1,) in the plane or (3,) in space [rad]."""
    dim = 2 if len(angles) == 1 else 3
    return torch.linalg.matrix_exp(torch.einsum("k,kij->ij", angles, turn_generators(dim).to(angles)))


def so_log(rotation: Tensor) -> Tensor:
    """Rotation vector [rad] of a rotation matrix, the inverse of `so_exp` for angles below π."""
    skew = (rotation - rotation.T) / 2
    sines = torch.einsum("kij,ij->k", turn_generators(len(rotation)).to(rotation), skew) / 2
    if len(rotation) == 2:
        return torch.atan2(sines, rotation[0, 0])
    sine = torch.linalg.norm(sines)
    angle = torch.atan2(sine, (torch.trace(rotation) - 1) / 2)
    if float(sine.detach()) > 1e-6 or float(rotation.detach().trace()) > 0:
        return sines * (angle / sine if float(sine.detach()) > 1e-12 else 1.0)
    symmetric = (rotation + rotation.T) / 2 + torch.eye(3).to(rotation)  # half a turn: 2 a aᵀ, a the axis
    axis = symmetric[:, torch.argmax(torch.diagonal(symmetric))]
    axis = axis * torch.where(axis @ sines < 0, -1.0, 1.0)
    return angle * axis / torch.linalg.norm(axis)


def _split(twist: Tensor) -> tuple[Tensor, Tensor]:
    dim = 2 if len(twist) == 3 else 3
    return twist[:dim], twist[dim:]


def se_exp(twist: Tensor) -> Tensor:
    """Homogeneous matrix of a twist (translation first, then rotation vector): (3,) → (3, 3), (6,) → (4, 4)."""
    shift, angles = _split(twist)
    dim = len(shift)
    omega = torch.einsum("k,kij->ij", angles, turn_generators(dim).to(twist))
    top = torch.cat([omega, shift[:, None]], 1)
    return torch.linalg.matrix_exp(torch.cat([top, torch.zeros(1, dim + 1).to(twist)]))


def se_log(matrix: Tensor) -> Tensor:
    """Twist of a homogeneous matrix, the inverse of `se_exp` for rotations below π."""
    dim = len(matrix) - 1
    angles = so_log(matrix[:dim, :dim])
    omega = torch.einsum("k,kij->ij", angles, turn_generators(dim).to(matrix))
    # the upper right block of exp([[Ω, I], [0, 0]]) is the mean of exp(tΩ) over t in [0, 1]
    padded = torch.zeros(2 * dim, 2 * dim).to(matrix)
    padded[:dim, :dim], padded[:dim, dim:] = omega, torch.eye(dim).to(matrix)
    mean_turn = torch.linalg.matrix_exp(padded)[:dim, dim:]
    return torch.cat([torch.linalg.solve(mean_turn, matrix[:dim, dim]), angles])


def small_inverse(matrices: Tensor) -> Tensor:
    """Inverses of a stack of 1×1 or 2×2 matrices by the closed form; a general solver would be slow."""
    if matrices.shape[-1] == 1:
        return 1.0 / matrices
    (a, b), (c, d) = (row.unbind(-1) for row in matrices.unbind(-2))
    determinant = a * d - b * c
    flat = torch.stack([d, -b, -c, a], -1) / determinant[..., None]
    return flat.reshape(matrices.shape)
