"""Colours, type sizes, figures without pyplot, and their files."""

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import SupportsIndex, overload

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.typing import RcKeyType

from mannbv import archive

INK, PALE, GROUND, UNKNOWN = "#222222", "#8a8a8a", "#ffffff", "#e4e4e4"
# Okabe and Ito's colours, told apart by everyone (their yellow darkened for a white ground), then wine and brown
COLORS = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#B8A800", "#882255", "#8C510A",
)  # fmt: skip
RISK_MAP = "cividis"

_STYLE: dict[RcKeyType, float | str | bool] = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.labelsize": 9,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 9,
    "axes.edgecolor": PALE,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "mannbv",
}


@contextmanager
def style() -> Iterator[None]:
    """Our type sizes and colours, for what is drawn inside; nothing stays changed."""
    with mpl.rc_context(_STYLE):
        yield


def robot_color(robot: SupportsIndex) -> str:
    """The colour of robot `robot` in every picture; from the eleventh robot on they repeat."""
    return COLORS[int(robot) % len(COLORS)]


@overload
def figure(width: float = ..., height: float = ...) -> tuple[Figure, Axes]: ...
@overload
def figure(
    width: float = ..., height: float = ..., rows: int = ..., *, columns: int, sharex: bool = ...,
    sharey: bool = ..., width_ratios: Sequence[float] | None = ...,
) -> tuple[Figure, np.ndarray]: ...  # fmt: skip
def figure(
    width: float = 6.0, height: float = 4.0, rows: int = 1, columns: int = 1, *, sharex: bool = False,
    sharey: bool = False, width_ratios: Sequence[float] | None = None,
) -> tuple[Figure, Axes | np.ndarray]:  # fmt: skip
    """A figure of width × height inches and its axes, as `matplotlib.pyplot.subplots` gives them, without its state."""
    with style():
        made = Figure(figsize=(width, height), layout="constrained")
        return made, made.subplots(rows, columns, sharex=sharex, sharey=sharey, width_ratios=width_ratios)


def placed(canvas: Figure, left: float, top: float, width: float, height: float) -> Axes:
    """Axes at a place given in inches from the figure's upper left corner."""
    full_width, full_height = canvas.get_size_inches()
    box = left / full_width, 1 - (top + height) / full_height, width / full_width, height / full_height
    return canvas.add_axes(box)


def save(canvas: Figure, path: str | Path, dpi: float = 120) -> Path:
    """Write a figure to .png or .svg, byte for byte the same each time; returns the path."""
    path = Path(path)
    if path.suffix not in (".png", ".svg"):
        raise ValueError(f"{path}: a figure is written as .png or .svg")
    picture = _bytes(canvas, path.suffix[1:], dpi)
    with archive.whole(path) as file:
        file.write(picture)
    return path


def show(canvas: Figure, dpi: float = 100) -> None:
    """Display a figure in a notebook, in 256 colours: a third of the bytes to store."""
    from IPython import display
    from PIL import Image

    with Image.open(io.BytesIO(_bytes(canvas, "png", dpi))) as picture:
        few = picture.convert("RGB").quantize(256, dither=Image.Dither.NONE)
    out = io.BytesIO()
    few.save(out, "png", optimize=True)
    display.display(display.Image(out.getvalue()))


def _bytes(canvas: Figure, kind: str, dpi: float) -> bytes:
    out = io.BytesIO()
    with style():
        canvas.savefig(out, format=kind, dpi=dpi, metadata={"png": {"Software": None}, "svg": {"Date": None}}[kind])
    return out.getvalue()
