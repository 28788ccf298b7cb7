"""What the paper's figures share: a page laid out in inches, and maps seen from above."""

import dataclasses
import math

import numpy as np
import torch
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import ArrayLike

from mannbv import risk
from mannbv.config import Config
from mannbv.episode import Record
from mannbv.lab.draw import canvas, parts, team
from mannbv.lab.draw.canvas import INK, PALE
from mannbv.lab.draw.team import Window
from mannbv.splats import SplatMap
from mannbv.team import Robot

LEFT, RIGHT, GAP, HEAD = 0.75, 0.3, 0.25, 0.85  # inches
_WIDEST, _PAGE = 4.6, 16.0


def column_width(count: int) -> float:
    """Inches of each of `count` panels side by side."""
    return min(_WIDEST, (_PAGE - LEFT - RIGHT - (count - 1) * GAP) / count)


def page(width: float, height: float, title: str, note: str, record: Record, entries: dict[str, Artist]) -> Figure:
    """A page: its title, `height` for its panels, a legend of `entries` (name → artist), what the maps show."""
    note = "\n".join(filter(None, (note, team.heights(record))))
    columns = max(1, min(len(entries), int(width / 2.1)))
    legend = 0.24 * math.ceil(len(entries) / columns) + 0.16 * note.count("\n")
    full = height + legend + 0.5
    made = Figure(figsize=(width, full))
    made.text(LEFT / width, 1 - 0.18 / full, title, fontsize=13, va="top", color=INK, weight="bold")
    made.text(LEFT / width, 0.14 / full, note, fontsize=9, color=INK)
    if entries:
        options = {"frameon": False, "borderaxespad": 0, "borderpad": 0, "handlelength": 1.8, "columnspacing": 1.5}
        place = LEFT / width, (legend + 0.36) / full
        made.legend(entries.values(), entries.keys(), loc="upper left", bbox_to_anchor=place, ncols=columns, **options)
    return made


def beside(made: Figure, name: str, top: float, height: float) -> None:
    """The name of a row of panels, at the left edge."""
    x, y = 0.42 / made.get_figwidth(), 1 - (top + height / 2) / made.get_figheight()
    made.text(x, y, name, rotation=90, va="center", ha="center", weight="bold", color=INK)


def bare(ax: Axes, window: Window) -> None:
    """Axes that are only a window: a frame without numbers."""
    window.on(ax)
    ax.set_facecolor(canvas.UNKNOWN)
    ax.set(xticks=[], yticks=[], xlabel="", ylabel="")
    for side in ax.spines.values():
        side.set_visible(True)


def from_above(ax: Axes, splat_map: SplatMap, height: ArrayLike, config: Config, opacity: float = 1.0) -> None:
    """A map from above, what a robot with its camera at `height` (d − 2,) [m] could meet, the largest splats lowest.

    Drawn as pixels also in .svg, where tens of thousands of ellipses would be a burden.
    """
    shown = splat_map.select(risk.in_reach(splat_map, height, config))
    shown = shown.select(torch.argsort(shown.scales.amax(1), descending=True, stable=True))
    parts.splats(ax, shown, opacity).set_rasterized(True)


def back_then(robot: Robot, count: int) -> SplatMap:
    """The oldest `count` of a robot's splats of today: a record keeps no earlier map, but splats in order of birth."""
    return robot.local.splats.select(torch.arange(min(count, robot.local.splats.n_splats)))


def painted(splat_map: SplatMap, colors: str | np.ndarray) -> SplatMap:
    """The map in other colours: one by its name, or (n, 3)."""
    colors = np.broadcast_to(to_rgb(colors) if isinstance(colors, str) else colors, (splat_map.n_splats, 3))
    return dataclasses.replace(splat_map, colors=torch.tensor(colors).to(splat_map.colors))


def dot(color: str, size: float | None = None) -> Line2D:
    """A legend's dot."""
    return Line2D([], [], marker="o", linestyle="", color=color, markersize=size)


def wedge(color: str) -> Patch:
    """A legend's field of view."""
    return Patch(facecolor=(*to_rgb(color), 0.3), edgecolor=color)


def ground_entries() -> dict[str, Artist]:
    """Legend entries of the ground that a robot knows."""
    return {
        "ground seen as occupied": Patch(facecolor=PALE),
        "unknown ground": Patch(facecolor=canvas.UNKNOWN, edgecolor=PALE),
    }
