"""What a risk weight buys: A*'s way on a map, its length and its risk (Section VI-A)."""

from functools import cache, lru_cache

import numpy as np
import torch

from mannbv import grid, metrics, planner, risk
from mannbv.config import Config
from mannbv.course.widgets import items
from mannbv.course.widgets.explorer import Explorer
from mannbv.course.widgets.masks import flat, surface_splats
from mannbv.course.widgets.settings import Choice, Point, Range
from mannbv.lab import draw
from mannbv.lab.draw.canvas import INK
from mannbv.splats import SplatMap

_CONFIG = Config(cell=0.1)  # coarse, so that a whole sweep of weights fits in a step
_LOW, _HIGH = (0.12, 0.12), (9.88, 7.48)  # the corners of the flat [m]
_WEIGHTS = (0.0, 0.3, 1.0, 2.0, 3.0, 10.0)
_MAPS = ("sharp everywhere", "vague at the kitchen door", "right half never seen")
_DOOR = (6.2, 3.5)  # [m] of the kitchen
_SAFE = 1.0  # [m] and more: the brightest colour
_OWN, _TRUE, _PLAIN = draw.COLORS[1], draw.COLORS[2], draw.COLORS[0]


def risk_weight() -> Explorer:
    """Drag both ends of a way through a flat, and say what a metre of danger is worth; on three maps of it."""
    return Explorer(
        _picture,
        {
            "start": Point((2.6, 0.8), _LOW, _HIGH),
            "goal": Point((8.7, 6.7), _LOW, _HIGH),
            "weight": Range("risk weight w [1]", 0.0, 12.0, 2.0, 0.25),
            "known": Choice("the robot's map", _MAPS, _MAPS[0]),
        },
        size=(860, 390),
    )


@cache
def _ground() -> tuple[grid.Lattice, np.ndarray, np.ndarray]:
    """The lattice, which of its cells are free, and where the robot may go."""
    lattice, free = flat().ground.free_grid(_CONFIG.cell, 0.0)
    occupancy = grid.Occupancy(lattice, np.where(free, -1.0, 1.0).astype(np.float32))
    cells = planner.traversable(occupancy, _CONFIG)
    start = lattice.index(flat().starts[:1])
    return lattice, free, np.isfinite(grid.geodesic(np.where(cells, 1.0, np.inf), start))


@cache
def _surfaces() -> SplatMap:
    return metrics.true_surfaces(flat())


@cache
def _map(known: str) -> SplatMap:
    points, vague, unseen = flat().seen.sampled(0.1), known == _MAPS[1], known == _MAPS[2]
    near = np.linalg.norm(points - _DOOR, axis=1) < 1.0
    seen = points[:, 0] < 5.0 if unseen else np.full(len(points), True)
    return surface_splats(points[seen], np.where(vague & near, 0.3, 0.05)[seen])


@cache
def _risk(known: str) -> np.ndarray:
    """α (nx, ny) [m] of the free cells, nan elsewhere."""
    lattice, free, _ = _ground()
    alpha = np.full(lattice.shape, np.nan)
    alpha[free] = risk.field(_map(known), lattice.centers(np.argwhere(free)), _CONFIG.level).numpy()
    return alpha


@lru_cache(maxsize=256)
def _prices(known: str, weight: float) -> np.ndarray:
    lattice, _, cells = _ground()
    return planner.prices(_map(known), lattice, cells, np.zeros(0), _CONFIG.replace(risk_weight=weight))


def _way(known: str, weight: float, start, goal) -> np.ndarray:
    """A*'s way from the cell of `start` to that of `goal`; from centre to centre, so that lengths compare."""
    lattice = _ground()[0]
    ends = lattice.centers(lattice.index([start, goal]))
    way = planner.safe_path(_prices(known, weight), lattice, *ends)
    assert way is not None  # any two open cells of the flat have one
    return way


def _scores(known: str, way: np.ndarray) -> tuple[float, float, float, float]:
    """Length [m], mean α [m] on the map and on the true surfaces, least true clearance [m]."""
    own, true = (risk.total(m, torch.from_numpy(way), _CONFIG.level) for m in (_map(known), _surfaces()))
    return float(planner.lengths(way)[-1]), own, true, float(flat().ground.clearance(way).min())


@lru_cache(maxsize=32)
def _sweep(known: str, start, goal) -> np.ndarray:
    return np.array([_scores(known, _way(known, weight, start, goal)) for weight in _WEIGHTS])


def _picture(start, goal, weight, known):
    plain, way = (_way(known, w, start, goal) for w in (0.0, weight))
    sweep, here = _sweep(known, start, goal), _scores(known, way)
    panels = [
        _plan(start, goal, weight, known, plain, way),
        items.color_bar((535, 45, 12, 300), 0, _SAFE, "α on the map [m]"),
        _trade(sweep, here),
        _profile(known, plain, way),
    ]
    return panels, f"w = {weight:g}: {_said(*here)}; shortest: {_said(*sweep[0])}"


def _said(length, own, true, clearance) -> str:
    return f"{length:.2f} m, mean α {own:.2f} m ({true:.2f} m truly), clearance {clearance:.2f} m"


def _plan(start, goal, weight, known, plain, way) -> dict:
    return items.plan(
        (55, 43, 425, 302), _LOW, _HIGH,
        [
            items.cells(_risk(known), _ground()[0], 0, _SAFE),
            items.line(plain, "white", 2.4, dash=(5, 3)),
            items.line(way, _OWN, 2.6),
            items.handle("start", start, "the start of the way", INK),
            items.handle("goal", goal, "the goal of the way", INK),
        ],
        title="drag the ends, raise the price of danger",
        legend=[(f"cheapest way, w = {weight:g}", _OWN, "line"), ("shortest way (white)", "#bbbbbb", "dash")],
    )  # fmt: skip


def _span(values, least: float) -> tuple[float, float]:
    """An axis for values, at least so long, with some room at both ends."""
    low, room = min(values), max(max(values) - min(values), least)
    return low - 0.1 * room, low + 1.1 * room


def _trade(sweep, here) -> dict:
    """Mean α over length, for the weights of the sweep; a disc for the present one."""
    length, own, true, _ = sweep.T
    across, up = _span([*length, here[0]], 0.5), _span([*own, *true, *here[1:3]], 0.2)
    marks = [items.dots(np.column_stack([length, y]), c, 5) for y, c in ((own, _OWN), (true, _TRUE))]
    return items.panel(
        (620, 43, 225, 132), across, up,
        [
            items.curve(length, true, _TRUE, dash=(5, 3)),
            items.curve(length, own, _OWN),
            *marks,
            items.dots([[here[0], here[2]]], _TRUE, 10, INK),
            items.dots([[here[0], here[1]]], _OWN, 10, INK),
        ],
        xlabel=f"length [m], w = {_WEIGHTS[0]:g} … {_WEIGHTS[-1]:g}", ylabel="mean α [m]",
        legend=[("on the map", _OWN, "line"), ("true surfaces", _TRUE, "dash")],
    )  # fmt: skip


def _profile(known, plain, way) -> dict:
    """α of the map along both ways."""
    curves = [(planner.lengths(w), risk.field(_map(known), w, _CONFIG.level).numpy()) for w in (plain, way)]
    (along, alpha), (further, safer) = curves
    low, high = min(0.0, alpha.min(), safer.min()), max(alpha.max(), safer.max(), 0.5)
    return items.panel(
        (620, 245, 225, 100), (0, max(along[-1], further[-1], 1.0)), (low, 1.05 * high),
        [items.curve(along, alpha, _PLAIN, dash=(5, 3)), items.curve(further, safer, _OWN)],
        xlabel="along the way [m]", ylabel="α on the map [m]",
        legend=[("shortest", _PLAIN, "dash"), ("cheapest", _OWN, "line")],
    )  # fmt: skip
