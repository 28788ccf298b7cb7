"""Information over yaw: what every direction of a camera would tell, and which splats pay for it (Eqs. (5), (15))."""

import functools
import math

import matplotlib as mpl
import numpy as np
import torch
from matplotlib.colors import to_rgb

from mannbv import geometry, grid, information, mask
from mannbv.camera import Camera
from mannbv.course.widgets import items
from mannbv.course.widgets.explorer import Explorer
from mannbv.course.widgets.settings import Choice, Point, Range, Switch, Turn
from mannbv.lab import draw
from mannbv.lab.draw.canvas import INK, PALE
from mannbv.splats import SplatMap

_LOW, _HIGH = (0.0, 0.0), (5.0, 4.4)  # [m] a room, with a wall that leaves a door at its upper end
_WALLS = [((0, 0), (5, 0)), ((5, 0), (5, 4.4)), ((5, 4.4), (0, 4.4)), ((0, 4.4), (0, 0)), ((3, 0), (3, 3.1))]
_TABLE = [((1.0, 2.5), (1.9, 2.5)), ((1.9, 2.5), (1.9, 3.1)), ((1.9, 3.1), (1.0, 3.1)), ((1.0, 3.1), (1.0, 2.5))]
_PATH = np.array([[0.6, 0.7], [1.4, 1.2], [2.3, 2.4], [3.0, 3.7], [4.0, 3.6], [4.4, 2.6]])  # [m]
_SEEN_FROM = np.array([1.5, 1.2])  # [m] where the robot looked before
_BEFORE = {"never": (), "once, to the right": (0.0,), "all around": tuple(information.uniform_yaws(6))}  # [rad]
_CAMERA = Camera.from_fov(64)
_UNPAID, _SHARES = "#d0d0d0", "cividis_r"  # the splats that pay most are the darkest


def information_over_yaw() -> Explorer:
    """Drag a robot about a room and turn its camera: the gain of this yaw, of every other, and who pays for it."""
    return Explorer(
        _picture,
        {
            "robot": Point((1.5, 1.2), (0.2, 0.2), (4.8, 4.2)),
            "yaw": Turn(0.0, "robot"),
            "before": Choice("looked around before:", _BEFORE, _BEFORE["once, to the right"]),
            "near": Switch("weights by nearness to the path"),
            "times": Range("damping λ [× default]", 0.01, 100.0, 1.0, 0.1, log=True),
        },
    )


@functools.cache
def _room() -> SplatMap:
    """Long splats on the walls and on a table, in bands of colour."""
    parts = []
    for number, (start, end) in enumerate([*_WALLS, *_TABLE]):
        start, end = np.array(start, float), np.array(end, float)
        length = math.dist(start, end)
        share = (np.arange(n := round(length / 0.16)) + 0.5) / n
        tint = np.array(to_rgb(draw.COLORS[number % 6]))
        bands = 0.25 + 0.6 * (np.arange(n) // 2 % 2)[:, None]
        parts.append((start + share[:, None] * (end - start), np.tile((end - start) / length, (n, 1)), bands * tint))
    means, rotations, colors = (np.concatenate(column) for column in zip(*parts, strict=True))
    n = len(means)
    fields = means, np.log(np.tile([0.08, 0.03], (n, 1))), rotations, np.full(n, 2.0), colors
    return SplatMap(*(torch.from_numpy(field).float() for field in fields))


@functools.cache
def _prior(before):
    """What the views along the yaws `before` have told."""
    return information.prior(_room(), _CAMERA, [geometry.yaw_pose(_SEEN_FROM, yaw) for yaw in before])


@functools.cache
def _weights(near):
    """Eq. (13) for the path, or 1 for each splat."""
    if not near:
        return torch.ones(_room().n_splats)
    lattice = grid.Lattice.around(_LOW, _HIGH, 0.1)
    x, y = lattice.centers().transpose(2, 0, 1)
    solid = ((abs(x - 3) < 0.1) & (y < 3.1)) | ((abs(x - 1.45) < 0.45) & (abs(y - 2.8) < 0.3))
    return mask.proximity(_room(), _PATH, grid.Occupancy(lattice, np.where(solid, 8.0, -4.0)))


def _picture(robot, yaw, before, near, times):
    room, prior, weights, damping = _room(), _prior(before), _weights(near), times * information.damping(2)
    profile = information.yaw_profile(room, _CAMERA, np.array(robot), prior, weights, damping=damping)
    acquired = information.fisher(room, _CAMERA, geometry.yaw_pose(np.array(robot), yaw)).requires_grad_()
    gain = information.gain(acquired, prior, weights, damping=damping)
    (worth,) = torch.autograd.grad(
        gain, acquired
    )  # (15) is linear in what the view tells: a splat pays row times slope
    pays = (acquired * worth).sum(1).detach().numpy()
    gain = gain.item()
    payers = int(np.searchsorted(np.cumsum(-np.sort(-pays)), 0.9 * pays.sum())) + 1 if gain > 0 else 0
    best = float(profile.gains.max())
    says = (
        f"this view gains {gain:.0f} by its own rendering, {profile.gain_at(yaw):.0f} by the curve; "
        f"the best of all yaws {best:.0f}, at {math.degrees(profile.best):.0f}°; "
        f"{payers} of {room.n_splats} splats pay 90 % of this view's gain"
    )
    return [*_plane(robot, yaw, before, near, pays), _curve(profile, yaw, gain)], says


def _plane(robot, yaw, before, near, pays):
    """The room, its splats coloured by what they pay, and the colour bar."""
    most = 100 * float(pays.max() / max(pays.sum(), 1e-12)) or 1.0
    shares = 100 * pays / max(pays.sum(), 1e-12)
    order = np.argsort(shares)  # the dearest on top
    colors = mpl.colormaps[_SHARES](shares[order] / most)[:, :3]
    colors[shares[order] < most / 1000] = to_rgb(_UNPAID)
    ahead = np.array(robot) + 0.55 * np.array([math.cos(yaw), math.sin(yaw)])
    looks = [items.view(_SEEN_FROM, look, _CAMERA.fov, 0.45, PALE, 0.15) for look in before]
    plane = items.plan(
        (50, 45, 330, 290), _LOW - np.array(0.4), _HIGH + np.array(0.4),
        [
            items.line(_PATH, draw.COLORS[0], 2.0 if near else 1.0, () if near else (4, 4)),
            *looks,
            items.view(robot, yaw, _CAMERA.fov, 0.8, draw.COLORS[2]),
            items.splats(_room().select(order.copy()), colors=colors, edge="#555555"),
            items.handle("robot", robot, "the robot", INK),
            items.handle("yaw", ahead, "where the camera looks", draw.COLORS[2], about=robot),
        ],
        title="who pays for this view",
        legend=[("path", draw.COLORS[0], "line" if near else "dash"), ("this view", draw.COLORS[2], "line")]
        + [("views before", PALE, "line")] * bool(before),
    )  # fmt: skip
    return plane, items.color_bar((442, 45, 12, 290), 0.0, most, "share of the gain [%]", _SHARES)


def _curve(profile, yaw, gain):
    """The gain of every yaw."""
    yaws, gains = profile.yaws, profile.gains
    top = 1.2 * max(float(gains.max()), gain, 1e-9)
    peaks = (gains > np.roll(gains, 1)) & (gains > np.roll(gains, -1))
    marks = [
        items.curve([yaw, yaw], [0, 0.93 * top], draw.COLORS[2], width=1.2, dash=(4, 4)),
        items.curve(np.append(yaws, math.pi), np.append(gains, gains[0]), INK),
        items.dots(np.column_stack([yaws, gains])[peaks].reshape(-1, 2), draw.COLORS[4], 5),
        items.dots([[profile.best, gains.max()]], draw.COLORS[1], 10),
        items.dots([[yaw, gain]], draw.COLORS[2], 9, edge="white"),
        items.handle("yaw", (yaw, 0.93 * top), "the yaw along the curve", draw.COLORS[2], along="x"),
    ]
    legend = [("best", draw.COLORS[1], "dot"), ("other maxima", draw.COLORS[4], "dot")]
    legend += [("this view, rendered", draw.COLORS[2], "dot")]
    return items.panel(
        (540, 45, 305, 290), (-math.pi, math.pi), (0, top), marks, title="the gain of every yaw", xlabel="yaw [rad]",
        ylabel="gain [1]", xticks=items.YAW_TICKS, legend=legend,
    )  # fmt: skip
