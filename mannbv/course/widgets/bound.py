"""Two maps over each other: the distributed gain beside the central one, and what breaks the bound (Eqs. (19)-(22))."""

import functools
import math

import numpy as np
import torch

from mannbv import geometry, grid, information, objective
from mannbv.belief import Belief
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.course.widgets import items
from mannbv.course.widgets.explorer import Explorer
from mannbv.course.widgets.settings import Choice, Point, Turn
from mannbv.kernels.flat import rays
from mannbv.lab import draw
from mannbv.lab.draw.canvas import INK, PALE
from mannbv.splats import SplatMap

_LOW, _HIGH = (-3.0, -2.6), (3.0, 2.6)  # [m]
_LATTICE = grid.Lattice.around(_LOW, _HIGH, 0.125)
_CAMERA, _CONFIG, _YAWS = Camera.from_fov(32), Config(), information.uniform_yaws(60)
_HOME, _GOAL = (-2.6, -0.2, 0.0), (1.5, -0.2)  # where robot A looked from and along, where its path ends
# each map: walls that its robot saw, ahead and to the left of where it stood [m]
_WALLS_A = (((1.9, 0.8), (3.9, 0.8)), ((4.5, -0.9), (4.5, 0.3)), ((2.6, -1.0), (3.2, -1.4)))
_WALLS_B = (((3.1, -0.9), (3.1, 0.9)), ((1.7, 0.2), (1.7, 0.7)), ((1.9, -0.9), (2.3, -0.9)))
_OWNERS, _BROKEN, _HOLDS = draw.COLORS[:2], draw.COLORS[8], draw.COLORS[2]
_SLACK = 1e-4  # float32 sums differ in the sixth digit
_TICKS = [[math.log10(ratio), f"{ratio:g}"] for ratio in (0.1, 0.3, 1, 3, 10)]


def lower_bound() -> Explorer:
    """Drag and turn one robot's map over another's, move the view, and see whether Lemma 1 holds, and by what."""
    return Explorer(
        _picture,
        {
            "other": Point((0.5, -2.0), (-2.4, -2.05), (2.4, 2.05)),
            "turned": Turn(math.pi / 2, "other"),
            "viewer": Point((-1.4, -0.2), (-2.4, -2.0), (2.4, 2.0)),
            "yaw": Turn(0.1, "viewer"),
            "jointly": Choice("rendered:", {"each map alone": False, "all maps in one image": True}, False),
            "shared": Choice("known before:", {"its owner's look": False, "everyone's looks": True}, False),
            "own": Choice("weights by:", {"one common grid": False, "each robot's own grid": True}, False),
        },
        size=(860, 430),
    )


@functools.cache
def _seen(walls):
    """What a robot saw, in its own frame, x ahead and y to its left, in metres.

    Long splats on the walls: means, directions and colours; then the ends (k, 2) of its sight lines, and hits (k,).
    """
    parts = []
    for number, (start, end) in enumerate(np.array(walls)):
        n = round(math.dist(start, end) / 0.2)
        along, bands = (np.arange(n) + 0.5) / n, np.arange(n) % 3 / 4
        direction = np.tile((end - start) / math.dist(start, end), (n, 1))
        tint = 0.2 + 0.3 * (np.arange(3) == number % 3) + bands[:, None]
        parts.append((start + along[:, None] * (end - start), direction, tint))
    slopes, (forward, right) = np.linspace(-1, 1, 256), np.array([[1.0, 0.0], [0.0, -1.0]])
    depth = rays.cast(np.array(walls).reshape(-1, 4), np.zeros(2), right, forward, slopes)[0]
    ends = np.where(np.isfinite(depth), depth, 4.0)[:, None] * (forward + slopes[:, None] * right)
    return [np.concatenate(column) for column in zip(*parts, strict=True)], ends, np.isfinite(depth)


def _placed(points, place):
    """Points (k, 2) of a robot's own frame in the world's, for a robot at place (x, y, yaw)."""
    c, s = math.cos(place[2]), math.sin(place[2])
    return points @ np.array([[c, s], [-s, c]]) + place[:2]


def _team(other, turned):
    """Each robot's belief after its own look, and what both looks tell about each map; map B placed by a hand."""
    places, beliefs, everything = (_HOME, (*other, turned)), [], []
    looks = [geometry.yaw_pose(np.array(place[:2]), place[2]) for place in places]
    for walls, place, look in zip((_WALLS_A, _WALLS_B), places, looks, strict=True):
        (means, directions, colors), ends, hits = _seen(walls)
        scales, turned_only = np.log(np.tile([0.09, 0.03], (len(means), 1))), (0.0, 0.0, place[2])
        fields = _placed(means, place), scales, _placed(directions, turned_only), np.full(len(means), 2.5), colors
        splat_map = SplatMap(*(torch.from_numpy(field).float() for field in fields))
        ground = grid.Occupancy.unknown(_LATTICE).carved(place[:2], _placed(ends, place), hits)
        beliefs.append(Belief(splat_map, information.prior(splat_map, _CAMERA, [look]), ground))
        everything.append(information.prior(splat_map, _CAMERA, looks))
    return beliefs, everything


@functools.lru_cache(8)
def _compared(other, turned, viewer, jointly, shared, own):
    """The team, the path, both sides' zones, both sides of Lemma 1 split by owner as a function of yaw, on all yaws.

    Eq. (21) and Eq. (18) as `objective.lower_bound` has them, which says their sums only.
    """
    beliefs, everything = _team(other, turned)
    common = objective.pooled(beliefs).ground
    local = beliefs if own else [Belief(b.splats, b.prior, common) for b in beliefs]
    central = [Belief(b.splats, p) for b, p in zip(beliefs, everything, strict=True)] if shared else beliefs
    path = np.linspace(viewer, _GOAL, 6)
    zones = [objective.zone(b, path, _CONFIG) for b in local], objective.central_zones(beliefs, path, _CONFIG)

    def sides(yaw):
        pose = geometry.yaw_pose(np.array(viewer), yaw)
        served = objective.per_owner(local, zones[0], _CAMERA, pose, _CONFIG)
        return torch.stack([served, objective.per_owner(central, zones[1], _CAMERA, pose, _CONFIG, jointly)]).numpy()

    return beliefs, common, path, zones, sides, np.array([sides(float(yaw)) for yaw in _YAWS])


def _picture(other, turned, viewer, yaw, jointly, shared, own):
    beliefs, common, path, zones, sides, all_around = _compared(other, turned, viewer, jointly, shared, own)
    here = sides(yaw)
    distributed, central = here.sum(1).tolist()
    yaws, both = np.append(_YAWS, yaw), np.append(all_around, here[None], 0).sum(2)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = both[:, 0] / both[:, 1]  # nan where a view gains nothing
    broken = distributed > (1 + _SLACK) * central
    verdict = f"holds: {1 - ratios[-1]:.0%} to spare" if distributed else "holds: nothing is promised"
    if broken:
        verdict = f"broken: {ratios[-1]:.2f} × the central gain" if central else "broken: the central gain is 0"
    plane = items.plan(
        (50, 45, 415, 340), _LOW, _HIGH, _on_the_plane(beliefs, common, path, zones, other, turned, viewer, yaw),
        title="drag and turn map B and the view",
        xlabel="x [m]     strong: the centre counts it; outlined: its owner too",
        legend=[*((f"map {name}", color, "dot") for name, color in zip("AB", _OWNERS, strict=True)),
                ("central zone", "#A8DCCB", "dot"), ("path", INK, "line")],
    )  # fmt: skip
    ratio = f", ratio {ratios[-1]:.2f}" if central else ""
    says = f"distributed gain {distributed:.1f}, central gain {central:.1f}{ratio}: the bound {'is ' * broken}{verdict}"
    return [plane, _bars(here, verdict, broken), _chart(yaws, ratios)], says


def _on_the_plane(beliefs, common, path, zones, other, turned, viewer, yaw) -> list[dict]:
    shown = [items.ground(common), _area(path, zones[1][0].radii.numpy())]
    for owner, belief, mine, block in zip(_OWNERS, beliefs, *zones, strict=True):
        tint = np.array([int(owner[k : k + 2], 16) for k in (1, 3, 5)]) / 255
        outside, only_central = ~block.selected, block.selected & ~mine.selected
        for chosen, opacity, edge in ((outside, 0.3, None), (only_central, 1.0, None), (mine.selected, 1.0, INK)):
            part = belief.splats.select(chosen)
            shown.append(items.splats(part, opacity, edge, 1.4, np.tile(tint, (part.n_splats, 1))))
    ahead = [np.array(at) + 0.5 * np.array([math.cos(a), math.sin(a)]) for at, a in ((other, turned), (viewer, yaw))]
    return [
        *shown,
        items.view(_HOME[:2], _HOME[2], length=0.45, color=_OWNERS[0]),
        items.view(other, turned, length=0.45, color=_OWNERS[1]),
        items.curve(*path.T),
        items.dots(path, INK, 5),
        items.view(viewer, yaw, length=0.9),
        items.handle("other", other, "map B, and where its robot looked from", _OWNERS[1]),
        items.handle("turned", ahead[0], "turns map B", "#F5C7A0", about=other),
        items.handle("viewer", viewer, "the robot that is to look", INK),
        items.handle("yaw", ahead[1], "where it would look", "#F0E442", about=viewer),
    ]


def _area(path, radii) -> dict:
    """The discs of a zone, filled in one stroke so that they do not darken where they overlap."""
    angle = np.append(np.linspace(0, 2 * math.pi, 49), math.nan)  # the nan lifts the pen
    discs = path[:, None] + radii[:, None, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return items.line(discs.reshape(-1, 2), None, fill=_HOLDS, strength=0.16)


def _bars(here, verdict, broken) -> dict:
    """Both sides as lying bars, split by owner; what the distributed one has too much is framed."""
    distributed, central = here.sum(1).tolist()
    longest, shown = max(distributed, central, 1.0), []
    for row, terms in zip((1, 0), here, strict=True):
        edges = np.append(0, np.cumsum(terms))
        for owner, low, high in zip(_OWNERS, edges, edges[1:], strict=False):
            shown.append(_box(low, high, row, None, fill=owner, strength=0.8))
    shown += [_box(central, distributed, 1, _BROKEN, width=4)] * broken
    shown.append(items.line([(central, -0.5), (central, 1.5)], INK, 1.3, (4, 3)))
    shown.append(items.text((0.02 * longest, 1.85), verdict, _BROKEN if broken else _HOLDS, "left"))
    names = [[1, "distributed (21)"], [0, "central (18)"]]
    return items.panel((590, 45, 255, 120), (0, 1.05 * longest), (-0.5, 2.1), shown, xlabel="gain of this view [1]",
                       title="the two sides of Lemma 1", yticks=names)  # fmt: skip


def _box(low, high, row, color, **options) -> dict:
    corners = [(low, row - 0.35), (high, row - 0.35), (high, row + 0.35), (low, row + 0.35), (low, row - 0.35)]
    return items.line(corners, color, **options)


def _chart(yaws, ratios) -> dict:
    """Distributed over central gain for every yaw, the present one last; the axis ends at a tenth and ten times."""
    yaw, order, height = yaws[-1], np.argsort(yaws), np.clip(np.log10(np.maximum(ratios, 1e-9)), -1, 1)
    over = np.column_stack([yaws, np.nan_to_num(height).clip(0)])[order]
    over = [(over[0, 0], 0), *over, (over[-1, 0], 0)]
    return items.panel(
        (590, 245, 255, 140), (-math.pi, math.pi), (-1.08, 1.08),
        [
            items.line(over, None, fill=_BROKEN, strength=0.35),
            items.line([(-math.pi, 0), (math.pi, 0)], PALE, 1.3, (4, 3)),
            items.curve(yaws[order], height[order]),
            items.handle("yaw", (yaw, np.nan_to_num(height[-1])), "where it would look", "#F0E442", along="x"),
        ],
        title="over all yaws: broken above 1", xlabel="yaw [rad]", ylabel="distributed / central [1]",
        xticks=items.YAW_TICKS, yticks=_TICKS,
    )  # fmt: skip
