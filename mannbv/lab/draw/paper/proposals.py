"""The paper's Fig. 2: a safe path with its mask, and the views that two robots propose to themselves and each other."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from mannbv import risk
from mannbv.episode import Record
from mannbv.lab import study
from mannbv.lab.draw import canvas, parts, team
from mannbv.lab.draw.canvas import PALE, placed, robot_color
from mannbv.lab.draw.paper import page
from mannbv.lab.draw.paper.page import GAP, HEAD, LEFT
from mannbv.lab.draw.team import Window
from mannbv.lab.study import RobotSnapshot

_BAR = 0.9  # inches beside the first panel


def mask_figure(record: Record, cycle: int | None = None) -> Figure:
    """Left: a robot's planned path, its mask, and the splats in it by their weight, Eqs. (10)-(13). Then, on the maps
    of two robots, the view that each takes as its own and the one that it suggests to the other.

    Raises ValueError for a record in which no robot suggests a view.
    """
    cycle, one, other = cycle_and_pair(record, cycle)
    snapshot = study.snapshot(record, cycle)
    pair = snapshot.robots[one], snapshot.robots[other]
    aspect, width = 0.85, 4.4
    tall, top = aspect * width, HEAD
    lefts = [LEFT, *(LEFT + width + _BAR + GAP + k * (width + GAP) for k in range(2))]
    with canvas.style():
        made = page.page(
            lefts[-1] + width + 0.3, top + tall + 0.15,
            f"{team.scene_of(record)}, {record.strategy}: a masked path, and views proposed from private maps",
            f"Cycle {cycle + 1} of {len(record.cycles)}: plans and views of that cycle on the maps of the end.",
            record, _entries(robot_color(one)),
        )  # fmt: skip
        ax = placed(made, lefts[0], top, width, tall)
        scale = _mask(ax, pair[0], record, aspect)
        ax.set_title(f"robot {one}: path, mask and weights", loc="left", color=robot_color(one), weight="bold")
        bar = made.colorbar(scale, cax=placed(made, LEFT + width + 0.12, top, 0.14, tall))
        bar.set_label("weight v of a splat, Eq. (13) [1]")
        near = _around(np.concatenate([np.stack([p.position, _view(p)])[:, :2] for p in pair]), aspect, 1.6)
        for left, me, mate in zip(lefts[1:], pair, pair[::-1], strict=True):
            _proposals(placed(made, left, top, width, tall), record, me, mate, near)
    return made


def cycle_and_pair(record: Record, cycle: int | None = None) -> tuple[int, int, int]:
    """A cycle near `study.midway` (or the given one) and two robots that suggest views to each other; or, where there
    is no such pair, a robot and one that it gives a view."""
    middle = study.midway(record) if cycle is None else cycle
    cycles = sorted(range(len(record.cycles)), key=lambda c: abs(c - middle)) if cycle is None else [cycle]
    gains: dict[int, dict[tuple[int, int], float]] = {}
    for c in cycles:
        log = record.cycles[c]
        gains[c] = {(i, k): gain for i, k, _, gain in log.suggestions if log.robots[i].view is not None}
    for c in cycles:
        mutual = {(i, k): min(gain, gains[c][k, i]) for (i, k), gain in gains[c].items() if (k, i) in gains[c]}
        if mutual:
            return c, *max(mutual, key=lambda pair: mutual[pair])
    for c in cycles:
        if gains[c]:
            return c, *max(gains[c], key=lambda pair: gains[c][pair])
    raise ValueError(f"{record.scene}, {record.strategy}: no robot suggests a view; give a distributed or limited run")


def _view(robot: RobotSnapshot) -> np.ndarray:
    """Where a robot under way looks from (d,) [m]."""
    assert robot.view is not None
    return robot.view


def _mask(ax: Axes, robot: RobotSnapshot, record: Record, aspect: float) -> ScalarMappable:
    """A planned path, its balls, and its splats coloured by weight over all others in grey."""
    zone, splat_map, config = robot.zone, robot.belief.splats, record.config
    assert zone is not None  # it is under way
    window = _around(robot.path[:, :2], aspect, 0.2 + float(zone.radii.max()))
    scale = ScalarMappable(Normalize(0.0, config.gamma1), mpl.colormaps["viridis"])
    parts.ground(ax, robot.belief.known)
    parts.zone(ax, robot.path, zone.radii, robot_color(robot.index))
    shown = risk.in_reach(splat_map, robot.position[2:], config)
    others = page.painted(splat_map.select(~zone.selected), PALE)
    page.from_above(ax, others, robot.position[2:], config, opacity=0.35)
    inside = shown & zone.selected
    colors = scale.to_rgba(zone.weights[inside].numpy())[:, :3]
    parts.splats(ax, page.painted(splat_map.select(inside), colors)).set_rasterized(True)
    parts.path(ax, robot.path, robot_color(robot.index), linewidth=2.4)
    team.badge(ax, robot.position, robot.index)
    page.bare(ax, window)
    team.scale_bar(ax, window)
    return scale


def _proposals(ax: Axes, record: Record, me: RobotSnapshot, mate: RobotSnapshot, window: Window) -> None:
    """One robot's own map, the view that it would take alone, and the one that it suggests to a teammate."""
    robot = record.robots[me.index]
    parts.ground(ax, robot.ground)
    page.from_above(ax, robot.local.splats, robot.position[2:], record.config, opacity=0.8)
    for each in (me, mate):
        parts.path(ax, each.path, robot_color(each.index), linestyle=(0, (1, 1.2)) if each is mate else "-")
    title = f"robot {me.index}'s own map and views"
    parts.view(ax, _view(me), me.announced, color=robot_color(me.index), fov=record.config.fov)
    for sender, yaw, gain in mate.suggestions:
        if sender == me.index:
            parts.view(ax, _view(mate), yaw, color=robot_color(mate.index), fov=record.config.fov, hatch="///")
            title += f"; gain for robot {mate.index}: {gain:,.0f}"
    team.badge(ax, _view(me), me.index)
    team.badge(ax, _view(mate), mate.index)
    page.bare(ax, window)
    team.scale_bar(ax, window)
    ax.set_title(title, loc="left", color=robot_color(me.index), weight="bold")


def _around(points: np.ndarray, aspect: float, margin: float) -> Window:
    return Window(points.min(0) - margin, points.max(0) + margin).shaped(aspect)


def _entries(color: str) -> dict:
    return {
        "mask, Eq. (11)": Patch(facecolor=(*to_rgb(color), 0.22)),
        "planned path": Line2D([], [], color="#555555", linewidth=2),
        "announced viewpoint": page.dot("#555555", 9),
        "view for itself": page.wedge("#555555"),
        "view suggested to the teammate": Patch(facecolor="#5555554d", edgecolor="#555555", hatch="////"),
        **page.ground_entries(),
    }
