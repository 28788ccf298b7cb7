"""The best view near a waypoint: over the yaw, over yaw and pitch, or over the whole pose (Remark 1)."""

import math
from dataclasses import dataclass
from typing import Unpack

import torch
from jaxtyping import Float
from torch import Tensor

from mannbv import geometry, render
from mannbv.camera import Camera
from mannbv.config import Noise
from mannbv.geometry import Pose
from mannbv.information.gain import Options, gain_and_gradient, view_gain
from mannbv.splats import SplatMap

FREEDOMS = ("yaw", "yaw and pitch", "pose")
_NUDGE = 1e-3  # [m, rad] half the distance of two views whose gains make a slope
_STEPS = 1e-3, 0.1, 0.4  # [m, rad] the shortest, the first and the longest step


@dataclass(frozen=True)
class View:
    """A pose and the gain of looking from there."""

    pose: Pose
    gain: float


def directions(pose: Pose, freedom: str = "pose") -> Float[Tensor, "k t"]:
    """The twists (k, d + d(d−1)/2), in the camera's own frame, along which a view may move with this freedom.

    "yaw" turns about the world's vertical, "pitch" about the camera's first axis (flatland has none), "pose" is all of
    se(d), where a metre counts as much as a radian. Raises ValueError for another name.
    """
    if freedom not in FREEDOMS:
        raise ValueError(f"views: no freedom is called '{freedom}'; choose one of {', '.join(FREEDOMS)}")
    d = pose.dim
    everything = torch.eye(d * (d + 1) // 2).to(pose.rotation)
    if freedom == "pose":
        return everything
    ground = torch.zeros(d, d).to(pose.rotation)
    ground[0, 1], ground[1, 0] = -1.0, 1.0
    turn = pose.rotation.T @ ground @ pose.rotation
    yaw = torch.einsum("kij,ij->k", geometry.turn_generators(d).to(turn), turn) / 2
    turns = everything[d:]
    rows = torch.stack([yaw @ turns, turns[0]])[: len(turns)]  # in flatland the first turn is the yaw itself
    return rows[:1] if freedom == "yaw" else rows


def _moved(pose: Pose, rows: Tensor, steps: Tensor) -> Pose:
    """One direction after the other, so that a level camera stays level under yaw and pitch."""
    for row, step in zip(rows, steps, strict=True):
        pose = pose.moved(step * row)
    return pose


def _elevation(pose: Pose) -> float:
    """Angle of the optical axis above the ground [rad]; 0 in flatland."""
    return math.asin(min(max(float(pose.rotation[2:, -1].sum()), -1.0), 1.0))


def _held(pose: Pose, center: Tensor, radius: float, pitch: tuple[float, float]) -> Pose:
    """The pose brought back to the ball and between the two elevations, where it left them."""
    offset = pose.position - center
    far = float(torch.linalg.norm(offset))
    position = pose.position if far <= radius else center + offset * (radius / far)
    rotation, excess = pose.rotation, _elevation(pose) - min(max(_elevation(pose), pitch[0]), pitch[1])
    if excess:
        ahead = rotation[:, -1]
        across = torch.stack([ahead[1], -ahead[0], torch.zeros_like(ahead[0])])  # ahead × up: horizontal
        rotation = geometry.so_exp(-excess * across / torch.linalg.norm(across)) @ rotation
    return Pose(rotation, position)


@torch.no_grad()
def slopes(
    splat_map: SplatMap,
    camera: Camera,
    pose: Pose,
    prior: Tensor,
    rows: Float[Tensor, "k t"],
    others: SplatMap | None = None,
    noise: Noise | None = None,
    **options: Unpack[Options],
) -> Float[Tensor, " k"]:
    """How the gain of the view from `pose` changes along twists `rows` (k, t) of `Pose.moved` [1/m, 1/rad].

    Other arguments as in `view_gain`. Exact where the dense twin renders; where a kernel does, differences of two
    gains, 2 mm or 2 mrad apart.
    """
    look = splat_map, camera
    if render.engine("auto", splat_map) is None:
        return rows @ gain_and_gradient(*look, pose, prior, others, noise, **options)[1].to(rows)
    ahead, back = (
        torch.stack([view_gain(*look, pose.moved(side * row), prior, others, noise, **options) for row in rows])
        for side in (_NUDGE, -_NUDGE)
    )
    return (ahead.to(rows) - back.to(rows)) / (2 * _NUDGE)


@torch.no_grad()
def best_view(
    splat_map: SplatMap,
    camera: Camera,
    start: Pose,
    prior: Tensor,
    freedom: str = "pose",
    radius: float = 0.3,
    pitch: tuple[float, float] = (-math.pi / 4, math.pi / 4),
    n_yaws: int = 24,
    leads: int = 3,
    rounds: int = 20,
    others: SplatMap | None = None,
    noise: Noise | None = None,
    **options: Unpack[Options],
) -> View:
    """The view of largest gain that a search from `start` finds; never worse than the start, the same every time.

    First `n_yaws` views around the vertical, with pitch as many halfway to each of its limits; then, from the
    `leads` highest peaks, up to `rounds` steps of gradient ascent with backtracking along `directions`: of the yaw,
    then of each further freedom asked for. The position stays within `radius` [m] of the start's, the elevation
    within `pitch` [rad]. Other arguments as in `view_gain`: blocks as a prior make a gain of blocks. Where splats are
    nearer than the radius there are many hills, and the highest may be missed. Raises ValueError for limits that the
    start itself does not keep.
    """
    render.check(splat_map, camera, start)
    here = start.to(torch.zeros(0, dtype=torch.float64))
    directions(here, freedom)
    if not (radius >= 0 and pitch[0] - 1e-6 <= _elevation(here) <= pitch[1] + 1e-6):
        raise ValueError(
            f"views: the start, at an elevation of {_elevation(here):.3f} rad, must lie within pitch "
            f"[{pitch[0]:.3f}, {pitch[1]:.3f}], and the radius must not be negative, got {radius}"
        )
    if not (n_yaws >= 1 and leads >= 1 and rounds >= 0):
        raise ValueError(f"views: needs n_yaws and leads ≥ 1 and rounds ≥ 0, got {n_yaws}, {leads} and {rounds}")

    def value(pose: Pose) -> float:
        return view_gain(splat_map, camera, pose, prior, others, noise, **options).item()

    def ascend(pose: Pose, height: float, freedom: str) -> View:
        shortest, length, longest = _STEPS
        for _ in range(rounds):
            rows = directions(pose, freedom)
            climb = slopes(splat_map, camera, pose, prior, rows, others, noise, **options)
            steep = torch.linalg.norm(climb)
            if not steep > 0:
                break
            while length >= shortest:
                there = _held(_moved(pose, rows, length * climb / steep), here.position, radius, pitch)
                found = value(there)
                if found > height:
                    break
                length /= 2
            else:
                break
            pose, height, length = there, found, min(2 * length, longest)
        return View(pose, height)

    upward = directions(here, "yaw and pitch")[1:]
    rings, center = [here], here.position
    if freedom != "yaw":
        halfway = [(limit - _elevation(here)) / 2 for limit in pitch]
        rings += [_held(here.moved(half * row), center, radius, pitch) for row in upward for half in halfway]
    views = []
    for ring in rings:
        (vertical,) = directions(ring, "yaw")
        around = [ring] + [ring.moved(2 * math.pi * k / n_yaws * vertical) for k in range(1, n_yaws)]
        found = [value(pose) for pose in around]
        peaks = [k for k in range(n_yaws) if found[k] >= max(found[k - 1], found[k + 1 - n_yaws])]
        views += [View(around[k], found[k]) for k in sorted(peaks, key=lambda k: -found[k])[:leads]]
    stages = {len(directions(here, name)): name for name in FREEDOMS[: FREEDOMS.index(freedom) + 1]}
    for stage in stages.values():  # one after the other, so that more freedom never gains less
        views = sorted((ascend(view.pose, view.gain, stage) for view in views), key=lambda view: -view.gain)[:leads]
    return View(views[0].pose.to(start.position), views[0].gain)
