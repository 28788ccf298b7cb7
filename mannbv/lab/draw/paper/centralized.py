"""Centralized sharing in the course of an episode: small local maps, a large global one, ever more bytes."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from mannbv import messages, splats
from mannbv.episode import Record
from mannbv.lab import report, study
from mannbv.lab.draw import canvas, parts, team
from mannbv.lab.draw.canvas import COLORS, INK, placed, robot_color
from mannbv.lab.draw.paper import page
from mannbv.lab.draw.paper.page import GAP, HEAD, LEFT, RIGHT
from mannbv.lab.draw.team import Window
from mannbv.lab.study import EpisodeLog

_SHOWN, _CURVES = 5, 2.4
_MIB, _MB = 2**-20, 1e-6


def growth_figure(record: Record) -> Figure:
    """Above: the global map ⊔ G_i at five cycles; below: its splats, one uplink of them, and the bytes sent so far."""
    whole, log = team.known(record), study.episode_of(record)
    picks = study.picked(log.cycles, _SHOWN)
    if not picks:
        raise ValueError(f"{record.scene}, {record.strategy}: no cycle was run yet")
    width = page.column_width(_SHOWN)
    tall = width * whole.aspect
    below = HEAD + 0.15 + tall + 0.5
    page_width = LEFT + _SHOWN * (width + GAP) - GAP + RIGHT
    half = (page_width - LEFT - RIGHT - 2.4) / 2
    with canvas.style():
        made = page.page(
            page_width, below + _CURVES + 0.4,
            f"{team.scene_of(record)}, {record.strategy}: {record.n_robots} robots' maps, and what sharing them takes",
            "Maps, oldest first: today's splats, as many of each robot as it had in that cycle; in a colour a robot.",
            record, {},
        )  # fmt: skip
        for k, cycle in enumerate(picks):
            ax = placed(made, LEFT + k * (width + GAP), HEAD + 0.15, width, tall)
            _map(ax, record, log, cycle, whole)
        _sizes(placed(made, LEFT + 0.15, below, half, _CURVES), record, log)
        _sent(placed(made, LEFT + 0.15 + half + 1.95, below, half, _CURVES), log)
    return made


def _map(ax: Axes, record: Record, log: EpisodeLog, cycle: int, whole: Window) -> None:
    """The global map as it was in a cycle."""
    counts = log.splats[cycle]
    ground = record.robots[0].ground.merged(*(robot.ground for robot in record.robots[1:]), config=record.config)
    parts.ground(ax, ground)
    held = [
        page.painted(page.back_then(robot, count), robot_color(robot.index))
        for robot, count in zip(record.robots, counts, strict=True)
    ]
    page.from_above(ax, splats.union(*held), record.robots[0].position[2:], record.config, opacity=0.7)
    for k, robot in enumerate(record.cycles[cycle].robots):
        team.badge(ax, robot.position, k, 9)
    page.bare(ax, whole)
    team.scale_bar(ax, whole)
    size = messages.centralized_bytes(counts, record.robots[0].local.splats.dim) * _MIB
    title = f"cycle {cycle + 1}: {sum(counts):,} splats\none uplink {report.digits(size)} MiB"
    ax.set_title(title, loc="left", fontsize=10)


def _sizes(ax: Axes, record: Record, log: EpisodeLog) -> None:
    """Splats of every robot, stacked, and on the right the size of one uplink of all maps."""
    counts = np.array(log.splats).T
    cycles = np.arange(counts.shape[1]) + 1
    names = [f"robot {k}" for k in range(record.n_robots)]
    ax.stackplot(cycles, counts, colors=[robot_color(k) for k in range(record.n_robots)], labels=names, alpha=0.85)
    each = messages.centralized_bytes([1], record.robots[0].local.splats.dim) * _MIB
    right = ax.secondary_yaxis("right", functions=(lambda n: np.multiply(n, each), lambda size: np.divide(size, each)))
    right.set_ylabel("one uplink of all maps [MiB]")
    ax.set_ylabel("splats, stacked [1]")
    _over_cycles(ax, "Size of the global map", cycles)
    ax.legend(loc="upper left", frameon=False, fontsize=8, ncols=1 + record.n_robots // 6)


def _sent(ax: Axes, log: EpisodeLog) -> None:
    """Bytes since the start."""
    cycles = np.arange(log.cycles) + 1
    curves = (
        (log.bytes_by_cycle, "really sent, every link", COLORS[1], "-"),
        (log.bytes_paper_by_cycle, "the paper's count: one uplink of each map", INK, "--"),
    )
    for sizes, name, color, line in curves:
        ax.plot(cycles, np.cumsum(sizes) * _MB, color=color, linestyle=line, linewidth=2, label=name)
    ax.set_ylabel("sent since the start [MB]")
    _over_cycles(ax, "Bytes of the whole team", cycles)
    ax.legend(loc="upper left", frameon=False)


def _over_cycles(ax: Axes, title: str, cycles: np.ndarray) -> None:
    ax.set_xlim(cycles[0], max(cycles[-1], cycles[0] + 1))
    ax.set_ylim(bottom=0)
    ax.set_xlabel("planning cycle [1]")
    ax.set_title(title, loc="left")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
