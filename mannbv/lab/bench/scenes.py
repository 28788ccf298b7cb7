"""What is rendered: a room whose walls are covered with random splats, in the plane or in space; the same each time."""

import math

import numpy as np
import torch

from mannbv import geometry
from mannbv.camera import Camera
from mannbv.geometry import Pose
from mannbv.splats import SplatMap

SIDES = (6.0, 6.0, 2.5)  # [m]
EYE, YAW = (2.2, 2.6, 1.4), 0.6  # a camera inside [m], [rad]
_THICK = 0.01  # [m] std of a splat's place across its wall
_STD = (0.02, 0.06)  # [m] of a splat
_OPACITY = (0.3, 0.95)


def room(n_splats: int, dim: int, seed: int = 0) -> SplatMap:
    """n splats on the walls (in space on floor and ceiling too) of a room, evenly by area, with a corner at 0."""
    rng = np.random.default_rng(seed)
    sides = np.array(SIDES[:dim])
    areas = np.prod(sides) / sides  # of the wall across each axis
    axis, far = rng.choice(dim, n_splats, p=areas / areas.sum()), rng.integers(2, size=n_splats)
    means = sides * rng.random((n_splats, dim))
    means[np.arange(n_splats), axis] = far * sides[axis] + rng.normal(0, _THICK, n_splats)
    rotations = rng.normal(size=(n_splats, geometry.identity_rotations(1, dim).shape[1]))
    rotations /= np.linalg.norm(rotations, axis=1, keepdims=True)
    opacity = rng.uniform(*_OPACITY, n_splats)
    fields = (
        means,
        rng.uniform(math.log(_STD[0]), math.log(_STD[1]), (n_splats, dim)),
        rotations,
        np.log(opacity / (1 - opacity)),
        rng.random((n_splats, 3)),
    )
    return SplatMap(*(torch.from_numpy(part.astype(np.float32)) for part in fields))


def view(size: int, dim: int) -> tuple[Camera, Pose]:
    """A square camera (in flatland a row) of 90° inside the room, and where it stands."""
    return Camera.of_dim(dim, size, size, math.pi / 2), geometry.yaw_pose(torch.tensor(EYE[:dim]), YAW)
