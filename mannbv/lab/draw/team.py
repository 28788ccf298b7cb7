"""A team in one picture: the plan with the trails, and what each robot believes, fears, and has chosen."""

import dataclasses
import math
from dataclasses import dataclass

import matplotlib.patheffects as effects
import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from mannbv import risk
from mannbv.config import Config
from mannbv.episode import Record
from mannbv.grid import UNKNOWN
from mannbv.lab import report, study
from mannbv.lab.draw import canvas, parts
from mannbv.lab.draw.canvas import INK, PALE, placed, robot_color
from mannbv.lab.study import RobotSnapshot, Snapshot
from mannbv.world import World

WIDTH = 16.0  # inches of every team picture
_LEFT, _RIGHT, _GAP, _TITLE, _AXIS = 0.85, 0.95, 0.14, 0.3, 0.48
_HEAD, KEY_HEIGHT = 0.5, 1.0
_COLUMNS = 5
HALO = [effects.withStroke(linewidth=2.5, foreground="white")]


@dataclass(frozen=True)
class Window:
    """A part of the ground: two corners (2,) [m]."""

    lower: np.ndarray
    upper: np.ndarray

    @property
    def size(self) -> np.ndarray:
        return self.upper - self.lower

    @property
    def aspect(self) -> float:
        """Height over width."""
        return float(self.size[1] / self.size[0])

    def shaped(self, aspect: float) -> "Window":
        """The smallest window of this aspect around it."""
        width, height = self.size
        size = np.array([max(width, height / aspect), max(height, width * aspect)])
        middle = (self.lower + self.upper) / 2
        return Window(middle - size / 2, middle + size / 2)

    def on(self, ax: Axes) -> None:
        ax.set_xlim(self.lower[0], self.upper[0])
        ax.set_ylim(self.lower[1], self.upper[1])


def team_figure(record: Record, world: World, config: Config | None = None, cycle: int | None = None) -> Figure:
    """The plan with everyone's trail and the team's progress; per robot its risk field, and below it its belief around
    the path: splats, masked zone, chosen view and the views that teammates suggest.

    config: with other constants than the record's own; cycle: see `study.snapshot`.
    """
    record = record if config is None else dataclasses.replace(record, config=config)
    snapshot, whole = study.snapshot(record, cycle), explored(record, world)
    plan_height = min(4.2, 6.2 * whole.aspect)
    plan_width, top = plan_height / whole.aspect, _HEAD + _TITLE
    below = top + plan_height + 0.55
    height = below + beliefs_height(record.n_robots, whole) + KEY_HEIGHT
    with canvas.style():
        made = Figure(figsize=(WIDTH, height))
        headline(
            made,
            f"{scene_of(record)}: {record.n_robots} robots, {record.strategy}, seed {record.seed}; {standing(record)}",
        )
        trails(placed(made, _LEFT, top, plan_width, plan_height), record, world, whole, "Ways taken")
        left = _LEFT + plan_width + 1.1
        width = (WIDTH - left - 0.3 - 0.75) / 2
        goal_distances(placed(made, left, top, width, plan_height), record, snapshot.cycle)
        map_sizes(placed(made, left + width + 0.75, top, width, plan_height), record, snapshot.cycle)
        beliefs(made, snapshot, whole, below, record.config)
        key(made, shown(record, snapshot))
    return made


def goal_distances(ax: Axes, record: Record, cycle: int) -> None:
    """How far every robot is from its goal, in a straight line, at the beginning of each cycle."""
    for robot in record.robots:
        places = [log.position for log in record.logs(robot.index)] + [robot.position]
        away = np.linalg.norm(np.array(places) - robot.goal, axis=1)
        ax.plot(np.arange(len(away)) + 1, away, color=robot_color(robot.index))
    _over_cycles(ax, cycle, "Distance to the goal", "straight distance [m]")


def map_sizes(ax: Axes, record: Record, cycle: int) -> None:
    """How many splats every robot's own map holds at the beginning of each cycle."""
    for robot in record.robots:
        counts = [log.splats for log in record.logs(robot.index)] + [robot.local.splats.n_splats]
        ax.plot(np.arange(len(counts)) + 1, counts, color=robot_color(robot.index), label=f"robot {robot.index}")
    _over_cycles(ax, cycle, "Size of the robots' own maps", "splats [1]")
    ax.legend(edgecolor="none", framealpha=1.0, loc="lower right", ncols=math.ceil(record.n_robots / _COLUMNS))


def _over_cycles(ax: Axes, cycle: int, title: str, unit: str) -> None:
    ax.axvline(cycle + 1, color=PALE, linewidth=1, linestyle=(0, (4, 2)))
    near = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points", "va": "top"}
    ax.annotate("shown below", (cycle + 1, 1.0), (4, -4), color="#555555", fontsize=8, **near)
    ax.set_ylim(bottom=0)
    ax.set_xlabel("planning cycle [1]")
    ax.set_ylabel(unit)
    ax.set_title(title, loc="left")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))


def explored(record: Record, world: World) -> Window:
    """The part of the plan that some robot has seen, as far as it is the building."""
    seen, building = known(record), world.ground.walls
    lower, upper = np.maximum(seen.lower, building.lower - 0.2), np.minimum(seen.upper, building.upper + 0.2)
    return _shapely(Window(lower, upper))


def known(record: Record) -> Window:
    """The ground that some robot has seen, with its way and its goal."""
    corners = [np.stack([robot.goal[:2], *robot.trail[:, :2]]) for robot in record.robots]
    for robot in record.robots:
        lattice = robot.ground.lattice
        corners.append(lattice.centers(np.argwhere(robot.ground.state != UNKNOWN)))
    points = np.concatenate(corners)
    return _shapely(Window(points.min(0) - 0.3, points.max(0) + 0.3))


def _shapely(window: Window) -> Window:
    return window.shaped(min(max(window.aspect, 0.45), 1.25))


def standing(record: Record) -> str:
    """How far the team is, in words."""
    at_goal = sum(robot.status == "reached" for robot in record.robots)
    return f"{at_goal} of {record.n_robots} at their goals after {len(record.cycles)} cycles"


def scene_of(record: Record) -> str:
    """A record's scene, for a title."""
    return report.setting(record.scene, record.robots[0].local.splats.dim)


def headline(made: Figure, text: str) -> None:
    """What was run, at the top."""
    made.text(_LEFT / WIDTH, 1 - 0.18 / made.get_figheight(), text, fontsize=13, va="top", color=INK, weight="bold")


def shown(record: Record, snapshot: Snapshot) -> str:
    """Of which cycle the beliefs are."""
    return (
        f"Lower rows ({record.strategy}): paths, masked zones and views as planned in cycle {snapshot.cycle + 1} of "
        f"{len(record.cycles)}, on the maps and with the risk of the end.\n{heights(record)}"
    ).strip()


def heights(record: Record) -> str:
    """Which splats a view from above shows; nothing in flatland."""
    low, high = record.config.body_low, record.config.body_high
    return {3: f"From above: splats {low:g} to {high:g} m over the floor."}.get(record.robots[0].local.splats.dim, "")


def trails(ax: Axes, record: Record, world: World, window: Window, title: str) -> None:
    """The true plan with the ways that the robots took, from their starts (dots) to their goals (stars)."""
    parts.plan(ax, world)
    widths = np.linspace(5, 1.6, record.n_robots)  # thinner and thinner: none hides another
    for robot, width in zip(record.robots, widths, strict=True):
        parts.path(ax, robot.trail, robot_color(robot.index), linewidth=width)
    for robot in record.robots:
        color = robot_color(robot.index)
        ax.plot(*robot.goal[:2], "*", color=color, markersize=14, markeredgecolor="white", zorder=6)
        badge(ax, robot.trail[0], robot.index)
    window.on(ax)
    ax.set_title(title, loc="left")


def badge(ax: Axes, place: ArrayLike, index: int, size: float = 11) -> None:
    """A robot: a dot with its number."""
    x, y = np.asarray(place, float)[:2]
    ax.plot(x, y, "o", color=robot_color(index), markersize=size, markeredgecolor="white", zorder=7)
    ax.annotate(
        str(index),
        (x, y),
        color="white",
        fontsize=size * 0.64,
        weight="bold",
        ha="center",
        va="center_baseline",
        zorder=8,
    )


def beliefs_height(n_robots: int, window: Window) -> float:
    """Inches that `beliefs` takes."""
    return math.ceil(n_robots / _COLUMNS) * (2 * _panel_width() * window.aspect + _TITLE + _AXIS + 0.12)


def _panel_width() -> float:
    return (WIDTH - _LEFT - _RIGHT - (_COLUMNS - 1) * _GAP) / _COLUMNS


def beliefs(made: Figure, snapshot: Snapshot, whole: Window, top: float, config: Config) -> None:
    """Two panels a robot, five robots a row: its risk field, and its belief around its path."""
    width = _panel_width()
    height = width * whole.aspect
    known = np.concatenate([p.risk[np.isfinite(p.risk)] for p in snapshot.robots])
    low, high = (min(0.0, np.quantile(known, 0.01)), np.quantile(known, 0.995)) if len(known) else (0.0, 1.0)
    for k, robot in enumerate(snapshot.robots):
        row, column = divmod(k, _COLUMNS)
        left = _LEFT + column * (width + _GAP)
        above = top + row * beliefs_height(1, whole) + _TITLE
        near = closeup(robot, whole.aspect)
        ax = placed(made, left, above, width, height)
        image = risk_panel(ax, robot, float(low), float(high), near)
        whole.on(ax)
        if column:
            ax.tick_params(labelleft=False)
            ax.set_ylabel("")
        else:
            _row_name(made, "risk α", above, height)
            _row_name(made, "belief", above + height + _AXIS, height)
            right = _LEFT + min(len(snapshot.robots), _COLUMNS) * (width + _GAP) - _GAP
            bar = made.colorbar(image, cax=placed(made, right + 0.12, above, 0.14, height), extend="both")
            bar.set_label("α, AV@R distance [m]")
        ax = placed(made, left, above + height + _AXIS, width, height)
        belief(ax, robot, config)
        near.on(ax)
        scale_bar(ax, near)


def _row_name(made: Figure, name: str, top: float, height: float) -> None:
    made.text(
        0.13 / WIDTH, 1 - (top + height / 2) / made.get_figheight(), name, rotation=90, va="center", weight="bold"
    )


def risk_panel(ax: Axes, robot: RobotSnapshot, low: float, high: float, near: Window) -> AxesImage:
    """The risk field over the ground that a robot knows, its path, and a frame around what the belief panel shows."""
    lattice = robot.belief.known.lattice
    image = parts.risk(ax, robot.risk, lattice, low, high)
    parts.path(ax, robot.path.reshape(-1, len(robot.position)), "white", linewidth=1.4)
    corner = float(near.lower[0]), float(near.lower[1])
    frame = {"fill": False, "edgecolor": INK, "linewidth": 0.8, "linestyle": (0, (4, 2)), "zorder": 5}
    ax.add_patch(Rectangle(corner, *near.size, **frame))
    badge(ax, robot.position, robot.index, 9)
    title = f"robot {robot.index}: {robot.belief.splats.n_splats:,} splats"
    ax.set_title(title, loc="left", color=robot_color(robot.index), weight="bold", fontsize=9)
    return image


def belief(ax: Axes, robot: RobotSnapshot, config: Config) -> None:
    """A robot's map around its path: the masked zone and its splats, the chosen view, and what others suggest.

    In 3-D, from above: the splats that its body could meet.
    """
    color = robot_color(robot.index)
    parts.ground(ax, robot.belief.known)
    shown = risk.in_reach(robot.belief.splats, robot.position[2:], config)
    chosen = torch.zeros_like(shown)
    if robot.zone is not None:
        parts.zone(ax, robot.path, robot.zone.radii, color)
        chosen = robot.zone.selected
    parts.splats(ax, robot.belief.splats.select(shown & ~chosen), opacity=0.35).set_rasterized(
        True
    )  # not ten thousand shapes in .svg
    parts.splats(ax, robot.belief.splats.select(shown & chosen), edge=INK).set_rasterized(True)
    parts.path(ax, robot.path.reshape(-1, len(robot.position)), color)
    if robot.view is not None:
        for mate, yaw, _ in robot.suggestions:
            ray(ax, robot.view, yaw, robot_color(mate), length=1.05)
        parts.view(ax, robot.view, robot.chosen, length=0.8, color=color)
    badge(ax, robot.position, robot.index, 10)
    ax.set_xticks([])
    ax.set_yticks([])
    ax.set_xlabel("")
    ax.set_ylabel("")
    for side in ax.spines.values():
        side.set_visible(True)


def ray(ax: Axes, place: np.ndarray, yaw: float, color: str, length: float) -> None:
    """A view that is only suggested: a line along its yaw."""
    away = np.array([math.cos(yaw), math.sin(yaw)])
    ends = np.stack([place[:2], place[:2] + length * away])
    ax.plot(ends[:, 0], ends[:, 1], color=color, linewidth=1.6, zorder=6, path_effects=HALO)


def closeup(robot: RobotSnapshot, aspect: float) -> Window:
    """The window around a robot's path and view."""
    points = [robot.position[:2], *robot.path[:, :2]]
    if robot.view is not None:
        points += [robot.view[:2] - 1.0, robot.view[:2] + 1.0]
    points = np.array(points)
    middle, half = (points.min(0) + points.max(0)) / 2, np.maximum((points.max(0) - points.min(0)) / 2 + 0.7, 1.6)
    return Window(middle - half, middle + half).shaped(aspect)


def scale_bar(ax: Axes, window: Window) -> None:
    """One metre, at the lower left."""
    x, y = window.lower + 0.05 * window.size.min()
    ax.plot([x, x + 1], [y, y], color=INK, linewidth=2.5, solid_capstyle="butt", zorder=9, path_effects=HALO)
    ax.annotate(
        "1 m", (x + 0.5, y), (0, 3), textcoords="offset points", ha="center", fontsize=8, path_effects=HALO, zorder=9
    )


def key(made: Figure, text: str) -> None:
    """What the lines and areas mean, and a line of text, at the bottom."""
    grey = "#555555"

    def line(**options) -> Line2D:
        return Line2D([], [], color=grey, **options)

    def dot(**options) -> Line2D:
        return line(marker="o", linestyle="", **options)

    entries = {
        "start; robot": dot(markersize=9),
        "goal": line(marker="*", linestyle="", markersize=12),
        "way taken; planned path": line(linewidth=2),
        "chosen view": Patch(facecolor="#5555554d", edgecolor=grey),
        "view that a teammate suggests, in its colour": Line2D([], [], color=robot_color(1), linewidth=2),
        "masked zone, Eq. (11)": Patch(facecolor="#d3e4f0"),
        "splat in the zone, Eq. (12): two standard deviations": dot(markeredgecolor=INK, markerfacecolor="#c9b28f"),
        "other splat": dot(markeredgewidth=0, alpha=0.35),
        "ground seen as occupied": Patch(facecolor=PALE),
        "unknown ground": Patch(facecolor=canvas.UNKNOWN, edgecolor=PALE),
    }
    height = made.get_figheight()
    place = _LEFT / WIDTH, (KEY_HEIGHT - 0.08) / height
    options = {"frameon": False, "borderaxespad": 0, "borderpad": 0, "handlelength": 1.8}
    made.legend(entries.values(), entries.keys(), loc="upper left", bbox_to_anchor=place, ncols=5, **options)
    made.text(_LEFT / WIDTH, 0.16 / height, text, fontsize=9, color=INK)
