"""A walk through a splat map of space: the plan from above, and what a camera that one turns by hand sees."""

import functools
import math
from contextlib import contextmanager

import numba
import numpy as np
import torch

from mannbv import geometry, information, render, splats, world
from mannbv.camera import Camera, back_project
from mannbv.course.widgets import items
from mannbv.course.widgets.explorer import Explorer
from mannbv.course.widgets.settings import Choice, Point, Range, Turn
from mannbv.lab import draw
from mannbv.lab.draw.canvas import INK, PALE, UNKNOWN
from mannbv.splats import SplatMap

_CAMERA = Camera.from_fov(220, 165)
_START, _YAW = (5.2, 0.9), 1.5  # [m], [rad]: where one stands in the flat at first
_LAYERS, _STEP = 30, 0.08  # of the lifted flat, and the distance between two [m]
_ABOVE = 200  # columns of the plan's picture
_SEEN = 0.5  # opacity from which a pixel shows a depth
_BACKGROUND = torch.tensor([int(UNKNOWN[k : k + 2], 16) / 255 for k in (1, 3, 5)])


def walk(splat_map: SplatMap | None = None) -> Explorer:
    """Stand in a 3-D map (by default the lifted flat) and turn; the plan is cut at the camera's height.

    Raises ValueError for a flatland map, or one without splats.
    """
    start, yaw = (_START, _YAW) if splat_map is None else (None, 0.0)
    splat_map = flat_with_a_height() if splat_map is None else splat_map
    if splat_map.dim != _CAMERA.dim or not splat_map.n_splats:
        raise ValueError("walk: needs a 3-D map with splats in it; splats.lifted gives a flatland map a height")
    low, high = np.quantile(splat_map.means.double().numpy(), (0.005, 0.995), axis=0)  # whatever strays, aside
    low, high = low - 0.05, high + 0.05
    middle = tuple(((low + high)[:2] / 2).tolist())
    lowest, highest, between = (round(float(low[2] + share * (high[2] - low[2])), 2) for share in (0.05, 0.95, 0.5))
    return Explorer(
        functools.partial(_picture, splat_map, low, high, functools.cache(functools.partial(_above, splat_map))),
        {
            "camera": Point(start or middle, tuple(low[:2].tolist()), tuple(high[:2].tolist())),
            "yaw": Turn(yaw, "camera"),
            "pitch": Range("pitch [°]", -60, 60, 0),
            "height": Range("height [m]", lowest, highest, between, 0.05),
            "show": Choice("image", ("colour", "depth"), "colour"),
        },
        size=(860, 410),
    )


@functools.cache
def flat_with_a_height() -> SplatMap:
    """The bundled flat as its cameras see it, lifted to layers, and its floor."""
    flat, lens = world.load("flat"), Camera.from_fov(256)
    places = torch.from_numpy(np.concatenate([flat.starts[:, :2], flat.goals])).float()
    frames = [
        flat.sense(lens, geometry.yaw_pose(place, yaw)) for place in places for yaw in information.uniform_yaws(4)
    ]
    points = torch.cat([back_project(frame, lens)[frame.valid] for frame in frames])
    colors = torch.cat([frame.color[frame.valid] for frame in frames])
    _, first = np.unique(np.floor(points.numpy() / 0.05 + 0.37), axis=0, return_index=True)  # one a cell
    heights = _STEP * (torch.arange(_LAYERS) + 0.5)
    return splats.union(splats.lifted(_round(points[first], colors[first], 0.03), heights, _STEP / 2), _floor(flat))


def _round(points, colors, std: float) -> SplatMap:
    n, d = points.shape
    upright, opaque = geometry.identity_rotations(n, d), torch.full((n,), 3.0)
    return SplatMap(points, torch.full((n, d), math.log(std)), upright, opaque, colors)


def _floor(flat: world.World, cell=0.1) -> SplatMap:
    """A flat splat on every free cell [m] of the floor, in tiles of a square metre."""
    lattice, free = flat.ground.free_grid(cell, 0.0)
    centers = torch.from_numpy(lattice.centers()[free]).float()
    tone = 0.45 + 0.2 * (centers.floor().sum(1, keepdim=True) % 2)
    layer = _round(centers, tone * torch.tensor([1.0, 0.9, 0.75]), 0.7 * cell)
    return splats.lifted(layer, [0.0], 0.01)


def _shown(picture: render.Rendering) -> np.ndarray:
    """A rendering as bytes (rows, columns, 4), first row at the bottom; where there is no splat, grey."""
    color = picture.color + (1 - picture.opacity[..., None]) * _BACKGROUND
    rgb = (255 * color.clamp(0, 1)).round().numpy()
    return np.dstack([rgb, np.full(rgb.shape[:2], 255)])[::-1]


def _above(splat_map: SplatMap, extent: tuple, height: float) -> np.ndarray:
    """What lies below `height` [m], on extent (x0, x1, y0, y1) [m], from so far above that it looks like a plan."""
    x0, x1, y0, y1 = extent
    far = 100 * (x1 - x0)
    camera = Camera(_ABOVE, math.ceil(_ABOVE * (y1 - y0) / (x1 - x0)), _ABOVE * far / (x1 - x0))
    down = torch.tensor([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])  # right is +x, down in the image −y, ahead −z
    place = torch.tensor([(x0 + x1) / 2, (y0 + y1) / 2, height + far])
    return _shown(render.render(splat_map.select(splat_map.means[:, 2] < height), camera, geometry.Pose(down, place)))


@contextmanager
def _one_thread():
    """A picture this small is drawn before a second thread has woken up, and a busy machine wakes it late."""
    kept = numba.get_num_threads(), torch.get_num_threads()
    numba.set_num_threads(1)
    torch.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(kept[0])
        torch.set_num_threads(kept[1])


@_one_thread()
def _picture(splat_map, low, high, above, camera, yaw, pitch, height, show):
    level = geometry.yaw_pose(torch.tensor([*camera, height]), yaw)
    pose = level.moved(torch.tensor([0, 0, 0, math.radians(pitch), 0, 0]))  # about its own axis to the right
    picture = render.render(splat_map, _CAMERA, pose)
    depth = torch.where(picture.opacity > _SEEN, picture.depth / picture.opacity, math.nan).numpy()
    far = max(1, round(0.6 * math.dist(low[:2], high[:2])))
    rows, columns = depth.shape
    middle = float(depth[rows // 2, columns // 2])
    ahead = "nothing to see" if math.isnan(middle) else f"a surface {middle:.2f} m away along the axis"
    return [
        _plan(low, high, above, camera, yaw, height),
        _row(depth[rows // 2], far),
        *_image(picture, depth, far, show),
    ], (
        f"{splat_map.n_splats:,} splats; facing {math.degrees(yaw):.0f}°, in the middle {ahead}; "
        f"{np.isnan(depth).mean():.0%} of the pixels show no surface"
    )


def _plan(low, high, above, camera, yaw, height) -> dict:
    reach = 0.07 * float((high - low)[:2].max())  # of the heading's handle; the plan leaves as much room around
    lower, upper = low[:2] - 1.2 * reach, high[:2] + 1.2 * reach
    ahead = np.array(camera) + reach * np.array([math.cos(yaw), math.sin(yaw)])
    extent = float(lower[0]), float(upper[0]), float(lower[1]), float(upper[1])
    return items.plan(
        (50, 30, 275, 225), lower, upper,
        [
            items.image(above(extent, height), extent),
            items.view(camera, yaw, _CAMERA.fov, 3.2 * reach, draw.COLORS[1], 0.35),
            items.handle("camera", camera, "the camera", INK),
            items.handle("yaw", ahead, "where the camera looks", draw.COLORS[1], about=camera),
        ],
        title="drag the camera, turn it",
    )  # fmt: skip


def _row(depth, far) -> dict:
    curve = items.curve(np.arange(len(depth)) + 0.5, depth, draw.COLORS[2])
    return items.panel(
        (50, 302, 275, 60), (0, len(depth)), (0, far), [curve], yticks=[[0, "0"], [far, str(far)]],
        xlabel="pixel of the dashed row [px]", ylabel="depth [m]",
    )  # fmt: skip


def _image(picture, depth, far, show) -> list[dict]:
    rows, columns = depth.shape
    extent, middle = (0, columns, 0, rows), rows / 2
    seen = items.heat(depth[::-1], extent, 0, far) if show == "depth" else items.image(_shown(picture), extent)
    dashes = items.line([[0, middle], [columns, middle]], "#ffffff" if show == "depth" else PALE, 1, dash=(4, 5))
    name = "its depth; grey: nothing there" if show == "depth" else "its image; grey: nothing there"
    panel = items.panel(
        (405, 30, 2 * columns, 2 * rows), (0, columns), (0, rows), [seen, dashes], title=name, xticks=[], yticks=[]
    )
    return [panel, items.color_bar((383, 30, 10, 2 * rows), 0, far, "depth [m]")] if show == "depth" else [panel]
