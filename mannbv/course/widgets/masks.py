"""Masks along a path: which splats a path masks, and what each then weighs (Eqs. (10)-(13))."""

from functools import cache

import matplotlib as mpl
import numpy as np
import torch
from numpy.typing import ArrayLike

from mannbv import geometry, grid, mask, planner, risk, world
from mannbv.config import Config
from mannbv.course.widgets import items
from mannbv.course.widgets.explorer import Explorer
from mannbv.course.widgets.settings import Choice, Point, Range
from mannbv.lab import draw
from mannbv.lab.draw.canvas import INK, PALE
from mannbv.splats import SplatMap

_CONFIG = Config()
_BODY, _SPACING = 0.2, 0.2  # [m] that the path keeps from surfaces, and between waypoints
_WEIGHTS = "cividis_r"  # dark counts much, as on the notebook's white ground
_PATH, _DISC = draw.COLORS[1], draw.COLORS[5]
_LOW, _HIGH = (0.12, 0.12), (9.88, 7.48)  # the corners of the flat [m]


def masks_along_a_path() -> Explorer:
    """Drag both ends of a path through a flat; widen and narrow its mask, and weigh over the floor or straight."""
    return Explorer(
        _picture,
        {
            "start": Point((2.6, 0.8), _LOW, _HIGH),
            "goal": Point((8.7, 6.7), _LOW, _HIGH),
            "r_min": Range("r_min [m]", 0.0, 1.0, _CONFIG.r_min, 0.05),
            "beta1": Range("β₁ [m]", 0.1, 2.0, _CONFIG.beta1, 0.1),
            "beta2": Range("β₂ [1/m]", 0.2, 6.0, _CONFIG.beta2, 0.2),
            "gamma2": Range("γ₂ [1/m]", 0.0, 3.0, _CONFIG.gamma2, 0.1),
            "straight": Choice("distance", {"over the floor": False, "straight, through walls": True}, False),
        },
        size=(860, 390),
    )


@cache
def flat() -> world.World:
    """The bundled flat in which paths are drawn."""
    return world.load("flat")


def surface_splats(points: np.ndarray, std: ArrayLike) -> SplatMap:
    """Round splats on points (n, 2) of a plan's surfaces; std: one standard deviation [m] for all, or (n,)."""
    n = len(points)
    scales = torch.as_tensor(std, dtype=torch.float64).log().expand(2, n).T.contiguous()
    upright = geometry.identity_rotations(n, 2).double()
    return SplatMap(torch.from_numpy(points), scales, upright, torch.full((n,), 4.0), torch.full((n, 3), 0.4))


@cache
def _scene() -> tuple[SplatMap, grid.Occupancy, np.ndarray]:
    """The map, the ground, and A*'s price of a cell: 1 wherever one can drive to, so that every end has its way."""
    lattice, free = flat().ground.free_grid(_CONFIG.cell, 0.0)
    known = grid.Occupancy(lattice, np.where(free, -1.0, 1.0).astype(np.float32))
    wide = flat().ground.reachable_free(_CONFIG.cell, _BODY, flat().starts[0])
    return surface_splats(flat().seen.sampled(0.1), 0.05), known, np.where(wide, 1.0, np.inf)


@cache
def _walls() -> list[dict]:
    return items.walls(flat())


def _picture(start, goal, r_min, beta1, beta2, gamma2, straight):
    splat_map, ground, price = _scene()
    way = planner.safe_path(price, ground.lattice, np.array(start), np.array(goal))
    assert way is not None  # any two open cells of the flat have one
    path = planner.thin(way, _SPACING)
    alpha = risk.field(splat_map, path, _CONFIG.level)
    radii = mask.radius(alpha, r_min, beta1, beta2)
    inside = mask.zone(splat_map, path, radii)
    some = splat_map.select(inside)
    over, through = (mask.proximity(some, path, way, gamma2=gamma2).numpy() for way in (ground, None))
    weights = through if straight else over
    panels = [
        _plan(start, goal, path, radii.numpy(), splat_map.select(~inside), some, weights),
        items.color_bar((535, 45, 12, 300), 0, 1, "weight v [1]", _WEIGHTS),
        _profile(planner.lengths(path), alpha.numpy(), radii.numpy(), r_min),
        _ranking(over, through, straight),
    ]
    return panels, (
        f"{some.n_splats} of {splat_map.n_splats} splats in the zone; mean α {alpha.mean():.2f} m, "
        f"mean radius {radii.mean():.2f} m; weights above ½: {(over > 0.5).sum()} over the floor, "
        f"{(through > 0.5).sum()} straight"
    )


def _plan(start, goal, path, radii, others, some, weights) -> dict:
    shades = mpl.colormaps[_WEIGHTS](weights)[:, :3]
    return items.plan(
        (55, 43, 425, 302), _LOW, _HIGH,
        [
            _discs(path, radii),
            *_walls(),
            items.splats(others, 0.5, edge=None, colors=np.full((others.n_splats, 3), 0.7)),
            items.splats(some, edge=INK, width=0.3, colors=shades),
            items.line(path, _PATH, 2.2),
            items.dots(path, _PATH, 4),
            items.handle("start", start, "the start of the path", _PATH),
            items.handle("goal", goal, "the goal of the path", _PATH),
        ],
        title="drag the ends: which splats matter to the path, and how much?",
        legend=[("waypoints", _PATH, "dot"), ("their discs", _DISC, "dot"), ("splats outside", "#bbbbbb", "dot")],
    )  # fmt: skip


def _discs(path, radii) -> dict:
    """Discs in one line, so that where they overlap the colour is no deeper: their union is the zone of Eq. (12)."""
    angle = np.linspace(0, 2 * np.pi, 49)
    rims = path[:, None, :2] + radii[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], 1)
    lifted = np.concatenate([rims, np.full((len(path), 1, 2), np.nan)], 1).reshape(-1, 2)
    return items.line(lifted, _DISC, 0.4, fill=_DISC, strength=0.25)


def _profile(along, alpha, radii, r_min) -> dict:
    top, right = max(1.6, 1.1 * float(radii.max())), max(1.0, float(along[-1]))
    return items.panel(
        (620, 43, 225, 132), (0, right), (min(0.0, float(alpha.min())), top),
        [
            items.line([[0, r_min], [right, r_min]], PALE, 1.2, dash=(4, 3)),
            items.curve(along, alpha, _PATH),
            items.curve(along, radii, draw.COLORS[0]),
        ],
        xlabel="along the path [m]", ylabel="[m]",
        legend=[("α", _PATH, "line"), ("radius", draw.COLORS[0], "line"), ("r_min", PALE, "dash")],
    )  # fmt: skip


def _ranking(over, through, straight) -> dict:
    """Weights in falling order: what lies between the curves is paid to splats that only a straight line reaches."""
    rank = np.arange(1, len(over) + 1)
    floor, air = (np.sort(weights)[::-1] for weights in (over, through))
    wide = (1.3, 2.6) if straight else (2.6, 1.3)
    return items.panel(
        (620, 245, 225, 100), (0, max(10, len(over))), (0, 1.02),
        [
            items.curve(rank, air, draw.COLORS[3], dash=(5, 3), width=wide[1]),
            items.curve(rank, floor, draw.COLORS[2], width=wide[0]),
        ],
        xlabel="splats of the zone, heaviest first", ylabel="weight v [1]",
        legend=[("over the floor", draw.COLORS[2], "line"), ("straight", draw.COLORS[3], "dash")],
    )  # fmt: skip
