"""Splat and camera: what one row of pixels makes of two splats (Eq. (1))."""

import math

import numpy as np
import torch

from mannbv import geometry, render
from mannbv.camera import Camera
from mannbv.course.widgets import items
from mannbv.course.widgets.explorer import Explorer
from mannbv.course.widgets.settings import Point, Range, Turn
from mannbv.lab import draw
from mannbv.splats import SplatMap

_WIDTH = 128
_PLANE, _LOW, _HIGH = ((-1.0, -2.0), (5.0, 2.0)), (0.0, -1.1), (4.1, 1.1)  # [m]
_COLORS = torch.tensor([[0.84, 0.37, 0.0], [0.0, 0.45, 0.70]])


def splat_and_camera() -> Explorer:
    """Drag either of two splats, the camera and where it looks; turn, stretch and thin out the orange one."""
    return Explorer(
        _picture,
        {
            "camera": Point((0.0, 0.0), _LOW, _HIGH),
            "yaw": Turn(0.0, "camera"),
            "orange": Point((2.0, 0.15), _LOW, _HIGH),
            "blue": Point((3.2, -0.3), _LOW, _HIGH),
            "turned": Range("turned [°]", -90, 90, 30),
            "long": Range("long σ [m]", 0.02, 0.6, 0.4, 0.02),
            "short": Range("short σ [m]", 0.02, 0.6, 0.08, 0.02),
            "opacity": Range("opacity [1]", 0.05, 0.99, 0.7, 0.01),
        },
    )


def _picture(camera, yaw, orange, blue, turned, long, short, opacity):
    logit = torch.logit(torch.tensor([opacity, 0.9]))
    angle = torch.tensor([math.radians(turned), 0.0])
    rotations = torch.stack([angle.cos(), angle.sin()], 1)
    scales = torch.tensor([[long, short], [0.25, 0.25]])
    pair = SplatMap(torch.tensor([orange, blue]), scales.log(), rotations, logit, _COLORS)
    image = render.render(pair, Camera.from_fov(_WIDTH), geometry.yaw_pose(torch.tensor(camera), yaw))
    color, depth, seen = (part.numpy() for part in (image.color, image.depth, image.opacity))
    pixel = np.arange(_WIDTH) + 0.5
    ahead = np.array(camera) + 0.9 * np.array([math.cos(yaw), math.sin(yaw)])
    place = items.plan(
        (55, 25, 420, 320), *_PLANE,
        [
            items.view(camera, yaw, length=0.7),
            items.splats(pair, edge="#222222"),
            items.handle("orange", orange, "the orange splat", draw.COLORS[1]),
            items.handle("blue", blue, "the blue splat", draw.COLORS[0]),
            items.handle("camera", camera, "the camera", "#222222"),
            items.handle("yaw", ahead, "where the camera looks", draw.COLORS[2], about=camera),
        ],
        title="the plane: drag splats, camera and view",
    )  # fmt: skip
    band = items.image(np.dstack([255 * color.clip(0, 1)[None], np.full((1, _WIDTH), 255)]).round(), (0, _WIDTH, 0, 1))
    row = items.panel((540, 25, 300, 40), (0, _WIDTH), (0, 1), [band], title="the image: one row", xticks=[], yticks=[])
    curves = [items.curve(pixel, depth, draw.COLORS[2]), items.curve(pixel, seen, draw.COLORS[3])]
    legend = [("depth [m]", draw.COLORS[2], "line"), ("opacity [1]", draw.COLORS[3], "line")]
    below = items.panel((540, 110, 300, 220), (0, _WIDTH), (0, 5), curves, xlabel="pixel [px]", legend=legend)
    middle = _WIDTH // 2
    return [place, row, below], f"at pixel {middle}: opacity {seen[middle]:.2f}, depth {depth[middle]:.2f} m"
