"""The main job in one picture: one strategy's team at work, and what all of them achieved."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mannbv.episode import Record
from mannbv.lab import study
from mannbv.lab.draw import canvas, team
from mannbv.lab.draw.canvas import COLORS, INK, PALE, placed
from mannbv.lab.draw.team import WIDTH
from mannbv.lab.study import Results
from mannbv.metrics import SCORES, Score
from mannbv.world import World

_GAP = 0.85  # inches between two rows of panels
_PANELS = ("total_risk_true_m", "psnr_db", "path_overhead", "sent_per_cycle_b")


def compare_figure(results: Results, record: Record, world: World) -> Figure:
    """Left: the plan and the ways taken in `record`; right: all strategies of `results`; below: the robots' beliefs."""
    snapshot, whole = study.snapshot(record), team.explored(record, world)
    plan_height = min(4.2, 6.2 * whole.aspect)
    plan_width, top = plan_height / whole.aspect, 0.8
    below = top + plan_height + 0.55
    height = below + team.beliefs_height(record.n_robots, whole) + team.KEY_HEIGHT
    n_strategies, several = len(results.summary), len(results.seeds) > 1
    with canvas.style():
        made = Figure(figsize=(WIDTH, height))
        which = f"{len(results.seeds)} seeds" if several else f"seed {results.seeds[0]}"
        ways = f"{n_strategies} strategies" if n_strategies > 1 else record.strategy
        team.headline(made, f"{team.scene_of(record)}: {results.robots} robots, {ways}, {which}")
        ax = placed(made, 0.85, top, plan_width, plan_height)
        team.trails(
            ax, record, world, whole, f"Ways taken, {record.strategy}, seed {record.seed}: {team.standing(record)}"
        )
        left = 0.85 + plan_width + 1.5
        width, tall = (WIDTH - left - 0.3 - 0.4) / 2, (plan_height - _GAP) / 2
        for k, name in enumerate(_PANELS):
            score = SCORES[name].of(results.constant("measure", "avar"))
            row, column = divmod(k, 2)
            spot = left + column * (width + 0.4), top + row * (tall + _GAP), width, tall
            scores(placed(made, *spot), results, score, shown=record.strategy, named=column == 0)
        team.beliefs(made, snapshot, whole, below, record.config)
        dots = "seeds, bars 95 % intervals (an arrow: it goes on)" if several else "robots"
        team.key(made, f"Upper right: diamonds are means, dots {dots}. {team.shown(record, snapshot)}")
    return made


def scores(ax: Axes, results: Results, score: Score, shown: str, named: bool) -> None:
    """One score of every strategy: its mean, the 95 % interval where there are several seeds, and the single values.

    The axis spans values and means; an interval that reaches further ends in an arrow.
    """
    names, log = list(results.summary), score.unit == "B"
    entries = [results.summary[name].get(score.key) for name in names]
    dots = [np.array(_values(results, name, score), float) * score.scale for name in names]
    spread = np.concatenate([*dots, [entry.mean * score.scale for entry in entries if entry]])
    low, high = _limits(spread, log)
    for k, (name, entry) in enumerate(zip(names, entries, strict=True)):
        color = COLORS[1] if name == shown else INK
        ax.plot(dots[k], np.full(len(dots[k]), k + 0.24), "o", color=PALE, markersize=4, alpha=0.55, mew=0)
        if entry is None:
            ax.annotate("none", (0.02, k), xycoords=("axes fraction", "data"), va="center", color=PALE, fontsize=8)
            continue
        if entry.interval:
            ends = np.array(entry.interval) * score.scale
            ax.plot(np.clip(ends, low, high), [k, k], color=color, linewidth=2)
            for end, edge, arrow in ((low - ends[0], low, "<"), (ends[1] - high, high, ">")):
                if end > 0 and not (log and edge == 0):
                    ax.plot(edge, k, arrow, color=color, markersize=6, clip_on=False)
        ax.plot(entry.mean * score.scale, k, "D", color=color, markersize=6.5, zorder=3, clip_on=False)
    if log:
        ax.set_xscale("symlog", linthresh=100)
    ax.set_xlim(low, high)
    ax.set_ylim(len(names) - 0.5, -0.5)
    ax.set_yticks(range(len(names)), names if named else [])
    for name, tick in zip(names, ax.get_yticklabels(), strict=False):
        tick.set(color=COLORS[1] if name == shown else INK, weight="bold" if name == shown else "normal")
    direction = {1: "  (more is better)", -1: "  (less is better)", 0: ""}[score.better]
    ax.set_title(score.label + direction, loc="left", fontsize=9.5)
    ax.set_xlabel(f"[{score.unit}]")
    ax.grid(axis="x", color="#dddddd", linewidth=0.6)
    ax.set_axisbelow(True)
    if not len(spread):
        ax.set_xticks([])


def _values(results: Results, strategy: str, score: Score) -> list[float]:
    """The single values of a strategy: of every team where there are several seeds, else of every robot."""
    if len(results.seeds) > 1:
        values = [scores[score.key] for scores in study.per_seed(results.of(strategy))[strategy].values()]
    else:
        values = [getattr(row, score.key, None) for row in results.of(strategy)]
    return [value for value in values if value is not None]


def _limits(values: np.ndarray, log: bool) -> tuple[float, float]:
    if log:
        return 0.0, max(3.0 * float(values.max(initial=0.0)), 1000.0)
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    room = 0.35 * (high - low) or 0.1 * abs(high) or 1.0
    return low - room, high + room
