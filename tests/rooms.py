"""A furnished room in space, seen exactly: each pixel's ray is intersected with every box."""

import math

import numpy as np
import torch

from mannbv import geometry
from mannbv.camera import Camera, Frame

ROOM = np.array([[0.0, 0.0, 0.0], [5.0, 4.0, 2.5]])
FURNITURE = np.array([
    [[3.2, 2.4, 0.0], [4.2, 3.4, 0.8]],  # a table
    [[0.3, 3.2, 0.0], [1.5, 3.8, 1.8]],  # a shelf
    [[2.2, 0.2, 0.0], [2.7, 0.7, 1.0]],  # a stool
    [[4.5, 0.3, 0.0], [4.9, 1.3, 2.1]],  # a wardrobe
])  # fmt: skip


def paint(points: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Colours (k, 3) of points (k, 3) [m] on boxes (k,): smooth waves, a tiled floor, striped furniture."""
    x, y, z = points.T
    waves = np.stack([np.sin(2.1 * x + 1.3 * y + z), np.sin(1.7 * x - 2.3 * y + 2.1 * z), np.cos(1.1 * x + 2.9 * y)], 1)
    tiles = np.where((np.floor(x / 0.5) + np.floor(y / 0.5)) % 2, 0.12, -0.12) * (z < 1e-6)
    stripes = np.where(np.floor(8 * z) % 2, 0.1, -0.1) * (box > 0)
    hue = np.stack([np.sin(2.0 * box), np.sin(3.0 * box), np.cos(2.5 * box)], 1)
    return np.clip(0.5 + 0.2 * waves + 0.1 * hue + (tiles + stripes)[:, None], 0, 1)


def cast(origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth (k,) [m] at which rays (k, 3) of depth 1 meet a surface from inside the room, and the number of its box."""
    boxes = np.concatenate([ROOM[None], FURNITURE])
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (boxes[:, :, None] - origin) / rays  # (boxes, 2, k, 3)
    near, far = np.nanmax(ends.min(1), -1), np.nanmin(ends.max(1), -1)
    depth = np.where((near[1:] < far[1:]) & (near[1:] > 0), near[1:], np.inf)
    depth = np.concatenate([far[:1], depth])
    return depth.min(0), depth.argmin(0)


def room_frame(
    camera: Camera, position, yaw: float, pitch: float = 0.0, samples: int = 3, dtype=torch.float32
) -> Frame:
    """What a camera in the room truly sees: colour the mean of `samples`² rays a pixel, depth of the middle one."""
    level = geometry.yaw_pose(torch.as_tensor(position, dtype=torch.float64), yaw)
    pose = level.moved(torch.tensor([0, 0, 0, pitch, 0, 0], dtype=torch.float64))
    fine = Camera(camera.width * samples, camera.height * samples, camera.focal * samples)
    rays = (fine.rays(pose.position) @ pose.rotation.T).numpy()
    origin = pose.position.numpy()
    depth, box = cast(origin, rays)
    blocks = (camera.height, samples, camera.width, samples)
    color = paint(origin + rays * depth[:, None], box).reshape(*blocks, 3).mean((1, 3))
    depth = depth.reshape(blocks)[:, samples // 2, :, samples // 2]
    tensor = lambda values: torch.from_numpy(np.ascontiguousarray(values)).to(dtype)  # noqa: E731
    return Frame(tensor(color), tensor(depth), pose.to(torch.zeros(0, dtype=dtype)))


def stroll(n: int) -> list[tuple[tuple[float, float, float], float, float]]:
    """n views (position, yaw, pitch) of a robot that circles the room while it looks around."""
    turn = 2 * math.pi * np.arange(n) / n
    return [((2.2 + 0.7 * math.cos(a), 1.8 + 0.5 * math.sin(a), 1.2), 2.6 * a, -0.15) for a in turn.tolist()]
