"""Building blocks: each draws one thing on given axes, in metres, and returns the artist that a legend may name."""

import math

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection, PatchCollection
from matplotlib.colors import ListedColormap, to_rgb
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Wedge
from matplotlib.typing import ColorType, LineStyleType
from numpy.typing import ArrayLike

from mannbv import grid
from mannbv.camera import Frame
from mannbv.information import YawProfile
from mannbv.lab.draw.canvas import COLORS, GROUND, INK, PALE, RISK_MAP, UNKNOWN
from mannbv.render import Rendering
from mannbv.splats import SplatMap
from mannbv.world import World

_REACH = 2.0  # standard deviations that a splat's ellipse shows


def ground_axes(ax: Axes, lower: ArrayLike | None = None, upper: ArrayLike | None = None) -> None:
    """Equal metres along both axes, named; the window from `lower` to `upper` (2,) [m] if given."""
    ax.set_aspect("equal")
    ax.set_xlabel("x [m]")
    ax.set_ylabel("y [m]")
    if lower is not None and upper is not None:
        (left, bottom), (right, top) = np.asarray(lower, float)[:2], np.asarray(upper, float)[:2]
        ax.set(xlim=(left, right), ylim=(bottom, top))


def _cells(ax: Axes, values: np.ndarray, lattice: grid.Lattice, **options) -> AxesImage:
    low = np.array(lattice.origin)
    high = low + np.array(lattice.shape) * lattice.cell
    return ax.imshow(
        np.ma.masked_invalid(values).T, origin="lower", extent=(low[0], high[0], low[1], high[1]),
        interpolation="nearest", **options,
    )  # fmt: skip


def plan(ax: Axes, world: World, cell: float = 0.05) -> LineCollection:
    """The true plan: free floor in white, the rest grey, every wall in its colour."""
    walls = world.ground.walls
    lattice, free = world.ground.free_grid(cell, 0.0)
    _cells(ax, free.astype(float), lattice, cmap=ListedColormap(["#d4d4d4", GROUND]), vmin=0, vmax=1, zorder=0)
    surfaces = LineCollection(list(walls.ends.reshape(-1, 2, 2)), colors=walls.colors, linewidths=1.6, zorder=2)
    ax.add_collection(surfaces)
    ground_axes(ax, walls.lower - 0.2, walls.upper + 0.2)
    return surfaces


def ground(ax: Axes, occupancy: grid.Occupancy) -> AxesImage:
    """What a robot knows of the ground: free in white, occupied in dark grey, unknown in light grey."""
    colors = ListedColormap([UNKNOWN, GROUND, PALE])
    image = _cells(ax, occupancy.state.astype(float), occupancy.lattice, cmap=colors, vmin=-1, vmax=1, zorder=0)
    ground_axes(ax)
    return image


def splats(ax: Axes, splat_map: SplatMap, opacity: float = 1.0, edge: ColorType | None = None) -> EllipseCollection:
    """Splats as ellipses of two standard deviations in their colours, as opaque as they are, times `opacity`."""
    with torch.no_grad():
        covariance = splat_map.covariances()[:, :2, :2].double().cpu()
        length, axes = torch.linalg.eigh(covariance)
        centers = splat_map.means[:, :2].cpu().numpy()
        colors = np.clip(splat_map.colors.detach().cpu().numpy(), 0, 1)
        alphas = splat_map.opacities.detach().cpu().numpy() * opacity
    width, height = 2 * _REACH * length.clamp_min(0).sqrt().numpy().T[::-1] if len(centers) else (np.zeros(0),) * 2
    angle = np.degrees(np.arctan2(axes[:, 1, -1].numpy(), axes[:, 0, -1].numpy()))
    drawn = EllipseCollection(
        width, height, angle, units="xy", offsets=centers, offset_transform=ax.transData,
        facecolors=np.column_stack([colors, alphas]), edgecolors="none" if edge is None else edge,
        linewidths=0.0 if edge is None else 0.4, zorder=3,
    )  # fmt: skip
    ax.add_collection(drawn)
    return drawn


def view(
    ax: Axes, position: ArrayLike, yaw: float, fov: float = math.pi / 2, length: float = 1.0,
    color: ColorType = COLORS[0], fill: float = 0.3, hatch: str | None = None,
) -> Wedge:  # fmt: skip
    """A camera at `position` (≥ 2,) [m] looking along `yaw` [rad], its field of view `length` [m] deep."""
    low, high = math.degrees(yaw - fov / 2), math.degrees(yaw + fov / 2)
    x, y = np.asarray(position, float)[:2]
    style = {"facecolor": (*to_rgb(color), fill), "edgecolor": color, "hatch": hatch, "linewidth": 1.3, "zorder": 5}
    drawn = Wedge((x, y), length, low, high, **style)
    ax.add_patch(drawn)
    return drawn


def zone(
    ax: Axes, waypoints: ArrayLike, radii: ArrayLike, color: ColorType = COLORS[0], strength: float = 0.22
) -> PatchCollection:
    """The balls B(p_k, r_k) of a mask [m], Eq. (11), as one pale region."""
    pale = tuple(1 - strength * (1 - part) for part in to_rgb(color))  # opaque: overlaps stay as pale
    centers = np.asarray(waypoints, float)[:, :2]
    balls = [Circle((x, y), r) for (x, y), r in zip(centers, np.asarray(radii, float), strict=True)]
    drawn = PatchCollection(balls, facecolor=pale, edgecolor="none", zorder=1)
    ax.add_collection(drawn)
    return drawn


def risk(ax: Axes, field: np.ndarray, lattice: grid.Lattice, low: float = 0.0, high: float | None = None) -> AxesImage:
    """A risk field α (nx, ny) [m] as a heat map, dark where dangerous; nan shows as unknown."""
    ax.set_facecolor(UNKNOWN)
    known = field[np.isfinite(field)]
    high = high if high is not None else (float(known.max()) if len(known) else 1.0)
    values = np.where(np.isposinf(field), high, field)
    image = _cells(ax, values, lattice, cmap=RISK_MAP, vmin=low, vmax=high, zorder=0)
    ground_axes(ax)
    return image


def path(
    ax: Axes, waypoints: ArrayLike, color: ColorType = COLORS[0], *, linewidth: float = 1.8,
    linestyle: LineStyleType = "-", label: str | None = None,
) -> Line2D:  # fmt: skip
    """Waypoints (k, ≥ 2) [m] as a line."""
    x, y = np.asarray(waypoints, float).T[:2]
    style = {"linewidth": linewidth, "linestyle": linestyle, "solid_capstyle": "round", "zorder": 4}
    return ax.plot(x, y, color=color, label=label, **style)[0]


def profile(ax: Axes, yaw_profile: YawProfile, color: ColorType = COLORS[0], label: str | None = None) -> Line2D:
    """The gain of every yaw of a view, its best marked."""
    line = ax.plot(yaw_profile.yaws, yaw_profile.gains, color=color, label=label)[0]
    best = int(np.argmax(yaw_profile.gains))
    ax.plot(yaw_profile.yaws[best], yaw_profile.gains[best], "o", color=color, markersize=5)
    ax.set_xlim(-math.pi, math.pi)
    ax.set_xticks(np.linspace(-math.pi, math.pi, 5), ["−π", "−π/2", "0", "π/2", "π"])
    ax.set_ylim(bottom=0)
    ax.set_xlabel("yaw [rad]")
    ax.set_ylabel("information gain [1]")
    return line


def strip(ax: Axes, image: Frame | Rendering, color: ColorType = INK, label: str | None = None) -> Line2D:
    """A one-row RGB-D image: a band of its colours above the curve of its depth."""
    colors = np.clip(image.color.detach().cpu().numpy().reshape(-1, 3), 0, 1)
    depth = image.depth.detach().cpu().numpy().reshape(-1)
    n = len(depth)
    line = ax.plot(np.arange(n) + 0.5, np.where(depth > 0, depth, np.nan), color=color, label=label)[0]
    ax.set_xlim(0, n)
    ax.set_ylim(bottom=0)
    ax.set_xlabel("pixel [px]")
    ax.set_ylabel("depth [m]")
    band = ax.inset_axes((0.0, 1.03, 1.0, 0.16))
    band.imshow(colors[None], extent=(0, n, 0, 1), aspect="auto", interpolation="nearest")
    band.set_axis_off()
    return line
