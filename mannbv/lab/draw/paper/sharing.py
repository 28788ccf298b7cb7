"""Centralized beside limited sharing: what two robots hold of each other at the end, and the bytes that it took."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from mannbv import splats
from mannbv.episode import Record
from mannbv.lab import report, study
from mannbv.lab.draw import canvas, parts, team
from mannbv.lab.draw.canvas import COLORS, INK, PALE, placed, robot_color
from mannbv.lab.draw.paper import page
from mannbv.lab.draw.paper.page import GAP, HEAD, LEFT
from mannbv.lab.draw.team import Window

_CURVES, _MB = 4.2, 1e-6
_WAYS = {"centralized": "whole maps", "limited": "view cones"}
_LINES = ((INK, "o"), (COLORS[1], "s"))


def sharing_figure(central: Record, limited: Record) -> Figure:
    """A row a record: the maps that the first two robots hold at its end, own splats grey, received ones in the
    sender's colour. On the right the bytes of splats in every cycle, by the paper's count."""
    records = central, limited
    whole = Window(
        np.minimum(*(team.known(record).lower for record in records)),
        np.maximum(*(team.known(record).upper for record in records)),
    )
    count = min(2, *(record.n_robots for record in records))
    width = 4.4
    tall = width * whole.aspect
    bottom = HEAD + 2 * tall + 0.45 + 0.25
    left = LEFT + count * (width + GAP) + 0.75
    shown = "" if count == central.n_robots else f" (the first {count} shown)"
    with canvas.style():
        made = page.page(
            left + _CURVES + 0.3, bottom - 0.1,
            f"{team.scene_of(central)}, {central.n_robots} robots{shown}: centralized and limited sharing",
            "Maps as they stand at the end of each episode. Bytes as the paper counts them: centralized, one uplink of "
            "each map; limited, the splats of all pairs.",
            central, _entries(central.n_robots),
        )  # fmt: skip
        for row, record in enumerate(records):
            top = HEAD + row * (tall + 0.45)
            page.beside(made, f"{record.strategy}: {_WAYS.get(record.strategy, 'what is sent')}", top, tall)
            for k in range(count):
                _held(placed(made, LEFT + k * (width + GAP), top, width, tall), record, k, whole)
        _bytes(placed(made, left, HEAD, _CURVES, 2 * tall + 0.15), records)
    return made


def _held(ax: Axes, record: Record, k: int, whole: Window) -> None:
    """All splats that a robot holds."""
    robot, config = record.robots[k], record.config
    parts.ground(ax, robot.belief(config).known)
    held = [page.painted(robot.local.splats, PALE)]
    for sender in robot.guests.senders.unique().tolist():
        held.append(page.painted(robot.guests.splats.select(robot.guests.senders == sender), robot_color(sender)))
    page.from_above(ax, splats.union(*held), robot.position[2:], config, opacity=0.9)
    team.badge(ax, robot.position, k)
    page.bare(ax, whole)
    team.scale_bar(ax, whole)
    title = f"robot {k}: {robot.local.splats.n_splats:,} own splats, {robot.guests.splats.n_splats:,} received"
    ax.set_title(title, loc="left", color=robot_color(k), weight="bold", fontsize=9.5)


def _bytes(ax: Axes, records) -> None:
    """The bytes of splats that each record's team shared in every cycle."""
    for record, (color, marker) in zip(records, _LINES, strict=True):
        sizes = np.array(study.episode_of(record).bytes_paper_by_cycle) * _MB
        style = {"color": color, "marker": marker, "markersize": 4, "linewidth": 1.6}
        ax.plot(
            np.arange(len(sizes)) + 1,
            sizes,
            **style,
            label=f"{record.strategy}: {report.digits(sizes.sum())} MB in all",
        )
    ax.set_ylim(0, 1.2 * ax.get_ylim()[1])  # room for the legend
    ax.set_xlabel("planning cycle [1]")
    ax.set_ylabel("splats sent in a cycle [MB]")
    ax.set_title("What is shared", loc="left")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.legend(loc="upper left", frameon=False)


def _entries(n_robots: int) -> dict:
    received = {f"received from robot {k}": page.dot(robot_color(k)) for k in range(n_robots)}
    return {"own splat": page.dot(PALE), **received, **page.ground_entries()}
