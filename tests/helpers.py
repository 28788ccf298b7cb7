"""What several tests share: random maps, a room of splats, an analytic sensor for it; records of other teams."""

import dataclasses
import itertools
import math

import numpy as np
import torch

from mannbv import geometry
from mannbv.camera import Camera, Frame
from mannbv.episode import Record
from mannbv.splats import SplatMap
from mannbv.team import CycleLog, SuggestionLog


def random_map(rng: np.random.Generator, n: int, dim: int, dtype=torch.float64, reach: float = 3.0) -> SplatMap:
    """n splats of every size, shape and opacity in a cube of half side `reach` [m] around the origin."""
    tensor = lambda values: torch.from_numpy(np.asarray(values)).to(dtype)  # noqa: E731
    rotations = rng.normal(size=(n, 2 if dim == 2 else 4))
    rotations /= np.maximum(np.linalg.norm(rotations, axis=1, keepdims=True), 1e-12)
    return SplatMap(
        tensor(rng.uniform(-reach, reach, (n, dim))),
        tensor(rng.uniform(-3.0, -1.0, (n, dim))),
        tensor(rotations),
        tensor(rng.normal(0, 1.5, n)),
        tensor(rng.uniform(0, 1, (n, 3))),
    )


def shifted(splat_map: SplatMap, offset) -> SplatMap:
    """The same splats elsewhere; offset: number or (d,) [m]."""
    means = splat_map.means + torch.as_tensor(offset).to(splat_map.means)
    return SplatMap(means, *splat_map.tensors()[1:])


def random_pose(rng: np.random.Generator, dim: int, reach: float = 1.0) -> geometry.Pose:
    """A camera turned any way, within `reach` [m] of the origin."""
    twist = rng.normal(size=dim * (dim - 1) // 2)
    position = torch.from_numpy(rng.uniform(-reach, reach, dim))
    return geometry.Pose(geometry.so_exp(torch.from_numpy(twist)), position)


def camera_for(dim: int, width: int, height: int = 5, fov: float = math.pi / 2) -> Camera:
    return Camera.from_fov(width, None if dim == 2 else height, fov)


def box_walls(size=(5.0, 4.0)) -> np.ndarray:
    """Segments (s, 4) [m] of a rectangular room with its corner at the origin and a square pillar inside."""
    (w, h), (x, y, s) = size, (3.2, 2.4, 0.5)
    outer = [(0, 0, w, 0), (w, 0, w, h), (w, h, 0, h), (0, h, 0, 0)]
    inner = [(x, y, x + s, y), (x + s, y, x + s, y + s), (x + s, y + s, x, y + s), (x, y + s, x, y)]
    return np.array(outer + inner, float)


def wall_color(points: np.ndarray) -> np.ndarray:
    """Colours (k, 3) of wall points (k, 2) [m]: smooth waves in the place."""
    x, y = points[:, 0], points[:, 1]
    waves = [np.sin(2.1 * x + 1.3 * y), np.sin(1.7 * x - 2.3 * y + 1.0), np.cos(1.1 * x + 2.9 * y)]
    return 0.5 + 0.35 * np.stack(waves, 1)


def box_map(rng: np.random.Generator, spacing: float = 0.05, dtype=torch.float64) -> SplatMap:
    """The room as mapping would have it: round-ish splats a few centimetres apart, all nearly opaque."""
    walls = box_walls()
    points = []
    for x0, y0, x1, y1 in walls:
        count = round(math.hypot(x1 - x0, y1 - y0) / spacing)
        share = (np.arange(count) + 0.5) / count
        points.append(np.stack([x0 + share * (x1 - x0), y0 + share * (y1 - y0)], 1))
    points = np.concatenate(points)
    n = len(points)
    angle = rng.uniform(-math.pi, math.pi, n)
    fields = (
        points + rng.normal(0, 0.005, (n, 2)),
        np.log(0.6 * spacing) + rng.normal(0, 0.25, (n, 2)),
        np.stack([np.cos(angle), np.sin(angle)], 1),
        rng.normal(2.0, 0.7, n),
        np.clip(wall_color(points) + rng.normal(0, 0.03, (n, 3)), 0, 1),
    )
    return SplatMap(*(torch.from_numpy(f).to(dtype) for f in fields))


def box_frame(camera: Camera, position, yaw: float, dtype=torch.float32) -> Frame:
    """What a flatland camera in the room truly sees, by intersecting each pixel's ray with every wall."""
    pose = geometry.yaw_pose(torch.as_tensor(position, dtype=torch.float64), yaw)
    rays = (camera.rays(pose.position) @ pose.rotation.T).numpy()
    origin = pose.position.numpy()
    walls = box_walls()
    start, along = walls[:, :2] - origin, walls[:, 2:] - walls[:, :2]
    cross = rays[:, None, 0] * along[:, 1] - rays[:, None, 1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / cross
        share = (start[:, 0] * rays[:, None, 1] - start[:, 1] * rays[:, None, 0]) / cross
    depth[~((depth > 1e-9) & (share >= 0) & (share <= 1))] = np.inf
    depth = depth.min(1)
    color = wall_color(origin + rays * depth[:, None])
    tensor = lambda values: torch.from_numpy(values).to(dtype)  # noqa: E731
    return Frame(tensor(color), tensor(depth), pose.to(torch.zeros(0, dtype=dtype)))


def crowd(record: Record, n: int) -> Record:
    """A record of two robots with its robots again and again, as if there were n."""
    robots = tuple(dataclasses.replace(record.robots[k % 2], index=k) for k in range(n))
    views = tuple(SuggestionLog(i, k, 0.3 * i, 1.0) for i, k in itertools.permutations(range(n), 2))
    cycles = tuple(
        dataclasses.replace(log, robots=tuple(log.robots[k % 2] for k in range(n)), suggestions=views)
        for log in record.cycles
    )
    return dataclasses.replace(record, robots=robots, cycles=cycles)


def at_goal(log: CycleLog, robot: int, **changes) -> CycleLog:
    """The log of a cycle as if a robot had been at its goal and had planned nothing."""
    there = dataclasses.replace(log.robots[robot], status="reached", view=None, path=())
    return dataclasses.replace(log, robots=(*log.robots[:robot], there, *log.robots[robot + 1 :]), **changes)
