"""What stands on a canvas: panels in data units, and the items on them, as plain dictionaries for the browser."""

import math
from collections.abc import Iterable, Sequence

import matplotlib as mpl
import numpy as np
import torch
from matplotlib.colors import ListedColormap, to_hex, to_rgba
from numpy.typing import ArrayLike

from mannbv import grid
from mannbv.lab import draw
from mannbv.lab.draw.canvas import GROUND, INK, PALE, RISK_MAP, UNKNOWN
from mannbv.splats import SplatMap
from mannbv.world import World

REACH = 2.0  # standard deviations that a splat's ellipse shows
YAW_TICKS = [[k * math.pi / 2, label] for k, label in zip(range(-2, 3), ("−π", "−π/2", "0", "π/2", "π"), strict=True)]

Ticks = list[list[float | str]]  # [value, label] each


def panel(
    box: Sequence[float], x: Sequence[float], y: Sequence[float], items: Iterable[dict], *, title: str = "",
    xlabel: str = "", ylabel: str = "", equal: bool = False, axes: bool = True, xticks: Ticks | None = None,
    yticks: Ticks | None = None, legend: Sequence[tuple[str, str, str]] = (),
) -> dict:  # fmt: skip
    """A panel whose data fill the box (left, top, width, height) [px of the canvas].

    x, y: (low, high) in data units; equal: one scale for both. Leave room outside the box: 45 px below and 55 px to
    the left for labels, 25 px above for a title and 18 more for a legend, whose entries are (label, color, mark) with
    mark "line", "dash" or "dot". xticks, yticks: [[value, label], …] in place of round numbers.
    """
    return {
        "box": [float(v) for v in box], "x": [float(v) for v in x], "y": [float(v) for v in y], "items": list(items),
        "title": title, "xlabel": xlabel, "ylabel": ylabel, "equal": equal, "axes": axes,
        "xticks": xticks, "yticks": yticks, "legend": [list(entry) for entry in legend],
    }  # fmt: skip


def plan(
    box: Sequence[float], lower: ArrayLike, upper: ArrayLike, items: Iterable[dict], *, title: str = "",
    xlabel: str = "x [m]", ylabel: str = "y [m]", legend: Sequence[tuple[str, str, str]] = (),
) -> dict:  # fmt: skip
    """A panel of the plane in equal metres, from `lower` to `upper` (≥ 2,) [m]."""
    (left, bottom), (right, top) = np.asarray(lower, float)[:2], np.asarray(upper, float)[:2]
    return panel(
        box, (left, right), (bottom, top), items, equal=True, title=title, xlabel=xlabel, ylabel=ylabel, legend=legend
    )


def _pair(point: ArrayLike) -> list[float]:
    return np.asarray(point, float)[:2].tolist()


def _floats(values: ArrayLike) -> bytes:
    return np.ascontiguousarray(values, np.float32).tobytes()


def line(
    points: ArrayLike, color: str | None = INK, width: float = 1.8, dash: Sequence[float] = (),
    fill: str | None = None, strength: float = 1.0,
) -> dict:  # fmt: skip
    """Points (k, ≥ 2) joined; a row of nan lifts the pen. fill: the colour inside, as opaque as `strength`."""
    points = np.asarray(points, float)[:, :2]
    return {
        "kind": "line", "points": _floats(points), "color": color, "width": width, "dash": list(dash),
        "fill": fill, "strength": strength,
    }  # fmt: skip


def curve(x: ArrayLike, y: ArrayLike, color: str = INK, width: float = 1.8, dash: Sequence[float] = ()) -> dict:
    """A line through (x_k, y_k)."""
    return line(np.column_stack([np.asarray(x, float), np.asarray(y, float)]), color, width, dash)


def dots(points: ArrayLike, color: str = INK, size: float = 7, edge: str | None = None) -> dict:
    """Points (k, ≥ 2) as discs of `size` [px]."""
    points = np.atleast_2d(np.asarray(points, float))[:, :2]
    return {"kind": "dots", "points": _floats(points), "color": color, "size": size, "edge": edge}


def text(at: ArrayLike, words: str, color: str = INK, align: str = "center") -> dict:
    """Words at a point, `align` "left", "center" or "right" of it."""
    return {"kind": "text", "at": _pair(at), "text": words, "color": color, "align": align}


def view(
    position: ArrayLike,
    yaw: float,
    fov: float = math.pi / 2,
    length: float = 1.0,
    color: str = INK,
    strength: float = 0.2,
) -> dict:
    """A camera at `position` [m] looking along `yaw` [rad], its field of view `length` [m] deep."""
    angle = yaw + np.linspace(-fov / 2, fov / 2, 25)
    position = np.asarray(position, float)[:2]
    arc = position + length * np.column_stack([np.cos(angle), np.sin(angle)])
    return line(np.vstack([position, arc, position]), color, 1.3, fill=color, strength=strength)


def splats(
    splat_map: SplatMap, opacity: float = 1.0, edge: str | None = None, width: float = 0.5,
    colors: ArrayLike | None = None,
) -> dict:  # fmt: skip
    """Splats from above as ellipses of two standard deviations, as opaque as they are, times `opacity`.

    colors: (n, 3) in place of their own.
    """
    with torch.no_grad():
        variance, directions = torch.linalg.eigh(splat_map.covariances()[:, :2, :2].double())
        long, short = (REACH * variance[:, k].clamp_min(0).sqrt() for k in (1, 0))
        angle = torch.atan2(directions[:, 1, 1], directions[:, 0, 1])
        means = splat_map.means[:, :2].double()
        shapes = torch.stack([means[:, 0], means[:, 1], long, short, angle], 1).numpy()
        shown = splat_map.colors.numpy() if colors is None else np.asarray(colors)
        alphas = splat_map.opacities.numpy() * opacity
    rgba = np.clip(np.column_stack([shown, alphas]) * 255, 0, 255).round().astype(np.uint8)
    return {"kind": "ellipses", "shapes": _floats(shapes), "rgba": rgba.tobytes(), "edge": edge, "width": width}


def heat(
    values: ArrayLike, extent: Sequence[float], low: float, high: float, colors: str | list[str] = RISK_MAP,
    missing: str = UNKNOWN,
) -> dict:  # fmt: skip
    """An image of `values` (rows, columns), first row at the bottom, on extent (x0, x1, y0, y1); nan in `missing`.

    colors: a matplotlib colour map, or a list of colours for whole-number values from `low` to `high`.
    """
    values = np.asarray(values, float)
    scale = mpl.colormaps[colors] if isinstance(colors, str) else ListedColormap(colors)
    share = np.clip((values - low) / (high - low), 0, 1)
    rgba = scale(np.ma.masked_invalid(share), bytes=True)
    rgba[np.isnan(values)] = (255 * np.array(to_rgba(missing))).round()
    return image(rgba, extent)


def image(rgba: ArrayLike, extent: Sequence[float]) -> dict:
    """An image (rows, columns, 4) of bytes, first row at the bottom, on extent (x0, x1, y0, y1)."""
    pixels = np.ascontiguousarray(np.asarray(rgba, np.uint8)[::-1])
    return {
        "kind": "image",
        "rgba": pixels.tobytes(),
        "shape": list(pixels.shape[:2]),
        "extent": [float(v) for v in extent],
    }


def cells(
    values: ArrayLike, lattice: grid.Lattice, low: float, high: float, colors: str | list[str] = RISK_MAP
) -> dict:
    """A heat map of values (nx, ny) on a lattice's cells; see `heat`."""
    start, end = np.array(lattice.origin), np.array(lattice.origin) + np.array(lattice.shape) * lattice.cell
    return heat(np.asarray(values, float).T, (start[0], end[0], start[1], end[1]), low, high, colors)


def ground(occupancy: grid.Occupancy) -> dict:
    """What a robot knows of the ground: free in white, occupied in dark grey, unknown in light grey."""
    return cells(occupancy.state, occupancy.lattice, -1, 1, colors=[UNKNOWN, GROUND, PALE])


def walls(world: World) -> list[dict]:
    """The surfaces of a plan, or of the ground of a space, each in its colour."""
    walls = world.ground.walls
    return [
        line(segment, to_hex(color), 2.2)
        for segment, color in zip(walls.ends.reshape(-1, 2, 2), walls.colors, strict=True)
    ]


def color_bar(box: Sequence[float], low: float, high: float, label: str, colors: str = RISK_MAP) -> dict:
    """A narrow panel that says which colour of `heat` is which value."""
    ramp = heat(np.linspace(low, high, 128)[:, None], (0, 1, low, high), low, high, colors=colors)
    return panel(box, (0, 1), (low, high), [ramp], xticks=[], title="", ylabel=label)


def handle(
    name: str, at: ArrayLike, label: str, color: str = draw.COLORS[1], about: ArrayLike | None = None,
    along: str | None = None,
) -> dict:  # fmt: skip
    """A handle for the setting `name` at a point; `label` says what it moves.

    about: the point around which it turns, for a `Turn`. along: "x" or "y" where it slides along one axis, whose
    coordinate is then the setting's value.
    """
    return {
        "kind": "handle", "name": name, "at": _pair(at), "label": label, "color": color,
        "about": None if about is None else _pair(about), "along": along,
    }  # fmt: skip
