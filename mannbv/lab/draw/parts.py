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

from mannbv import grid
from mannbv.lab.draw.canvas import COLORS, GROUND, INK, PALE, RISK_MAP, UNKNOWN
from mannbv.world import World

_REACH = 2.0  # standard deviations that a splat's ellipse shows


def ground_axes(ax: Axes, lower=None, upper=None) -> None:
    """Equal metres along both axes, named; the window from `lower` to `upper` (2,) [m] if given."""
    ax.set_aspect("equal")
    ax.set_xlabel("x [m]")
    ax.set_ylabel("y [m]")
    if lower is not None:
        ax.set_xlim(lower[0], upper[0])
        ax.set_ylim(lower[1], upper[1])


def _cells(ax: Axes, values: np.ndarray, lattice: grid.Lattice, **options) -> AxesImage:
    low = np.array(lattice.origin)
    high = low + np.array(lattice.shape) * lattice.cell
    return ax.imshow(
        np.ma.masked_invalid(values).T, origin="lower", extent=(low[0], high[0], low[1], high[1]),
        interpolation="nearest", **options,
    )  # fmt: skip


def plan(ax: Axes, world: World, cell=0.05) -> LineCollection:
    """The true plan: free floor in white, the rest grey, every wall in its colour."""
    walls = world.ground.walls
    lattice, free = world.ground.free_grid(cell, 0.0)
    _cells(ax, free.astype(float), lattice, cmap=ListedColormap(["#d4d4d4", GROUND]), vmin=0, vmax=1, zorder=0)
    surfaces = LineCollection(walls.ends.reshape(-1, 2, 2), colors=walls.colors, linewidths=1.6, zorder=2)
    ax.add_collection(surfaces)
    ground_axes(ax, walls.lower - 0.2, walls.upper + 0.2)
    return surfaces


def ground(ax: Axes, occupancy: grid.Occupancy) -> AxesImage:
    """What a robot knows of the ground: free in white, occupied in dark grey, unknown in light grey."""
    colors = ListedColormap([UNKNOWN, GROUND, PALE])
    image = _cells(ax, occupancy.state.astype(float), occupancy.lattice, cmap=colors, vmin=-1, vmax=1, zorder=0)
    ground_axes(ax)
    return image


def splats(ax: Axes, splat_map, opacity=1.0, edge=None, seen_from_above=slice(0, 2)) -> EllipseCollection:
    """Splats as ellipses of two standard deviations in their colours, as opaque as they are, times `opacity`."""
    with torch.no_grad():
        covariance = splat_map.covariances()[:, seen_from_above, seen_from_above].double().cpu()
        length, axes = torch.linalg.eigh(covariance)
        centers = splat_map.means[:, seen_from_above].cpu().numpy()
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


def view(ax: Axes, position, yaw, fov=math.pi / 2, length=1.0, color=COLORS[0], fill=0.3, **options) -> Wedge:
    """A camera at `position` (≥ 2,) [m] looking along `yaw` [rad], its field of view `length` [m] deep."""
    low, high = math.degrees(yaw - fov / 2), math.degrees(yaw + fov / 2)
    face = (*to_rgb(color), fill)
    options = {"linewidth": 1.3, "zorder": 5} | options
    return ax.add_patch(Wedge(tuple(position[:2]), length, low, high, facecolor=face, edgecolor=color, **options))


def zone(ax: Axes, waypoints, radii, color=COLORS[0], strength=0.22) -> PatchCollection:
    """The balls B(p_k, r_k) of a mask [m], Eq. (11), as one pale region."""
    pale = tuple(1 - strength * (1 - part) for part in to_rgb(color))  # opaque: overlaps stay as pale
    balls = [Circle(tuple(p[:2]), float(r)) for p, r in zip(waypoints, radii, strict=True)]
    return ax.add_collection(PatchCollection(balls, facecolor=pale, edgecolor="none", zorder=1))


def risk(ax: Axes, field: np.ndarray, lattice: grid.Lattice, low=0.0, high=None) -> AxesImage:
    """A risk field α (nx, ny) [m] as a heat map, dark where dangerous; nan shows as unknown."""
    ax.set_facecolor(UNKNOWN)
    known = field[np.isfinite(field)]
    high = high if high is not None else (float(known.max()) if len(known) else 1.0)
    values = np.where(np.isposinf(field), high, field)
    image = _cells(ax, values, lattice, cmap=RISK_MAP, vmin=low, vmax=high, zorder=0)
    ground_axes(ax)
    return image


def path(ax: Axes, waypoints, color=COLORS[0], **options) -> Line2D:
    """Waypoints (k, ≥ 2) [m] as a line."""
    waypoints = np.asarray(waypoints, float)
    options = {"linewidth": 1.8, "solid_capstyle": "round", "zorder": 4} | options
    return ax.plot(waypoints[:, 0], waypoints[:, 1], color=color, **options)[0]


def profile(ax: Axes, yaw_profile, color=COLORS[0], label: str | None = None) -> Line2D:
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


def strip(ax: Axes, image, color=INK, label: str | None = None) -> Line2D:
    """A one-row RGB-D image (a frame or a rendering): a band of its colours above the curve of its depth."""
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
