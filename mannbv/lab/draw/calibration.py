"""Predicted risk beside the true clearance: does α foretell how near the walls are?"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mannbv.lab.draw import canvas
from mannbv.lab.draw.canvas import COLORS, INK, PALE
from mannbv.lab.study import Calibration

_KINDS = (
    # name, colour, and markers of which neither hides the other
    ("σ of the splat alone", COLORS[0], {"marker": "o", "markersize": 8, "markerfacecolor": "none"}),
    ("σ widened by its mean's posterior", COLORS[1], {"marker": "s", "markersize": 4}),
)
_MOST = 3000  # waypoints drawn, evenly picked


def calibration_figure(found: Calibration) -> Figure:
    """Left: every waypoint's α against its true clearance, for both σ, with the means of bins; right: how often the
    clearance was less than α. Bars are 95 % intervals over robots."""
    waypoints = found.forecasts
    ends = np.concatenate([waypoints.alpha.ravel(), waypoints.clearance])
    limits = float(ends.min()) - 0.05, float(ends.max()) + 0.05
    made, axes = canvas.figure(11.5, 4.1, columns=3)
    with canvas.style():
        for kind, ax in enumerate(axes[:2]):
            _points(ax, found, kind, limits)
        axes[0].set_ylabel("true clearance [m]")
        _shares(axes[2], found)
        words = f"{len(waypoints.clearance):,} announced waypoints of {found.n_robots} robots"
        made.suptitle(f"Predicted risk and true clearance: {words}", x=0.01, ha="left", fontsize=11)
    return made


def _points(ax: Axes, found: Calibration, kind: int, limits: tuple[float, float]) -> None:
    waypoints, (name, color, mark) = found.forecasts, _KINDS[kind]
    some = np.unique(np.linspace(0, len(waypoints.clearance) - 1, _MOST).round().astype(int))
    ax.plot(waypoints.alpha[kind, some], waypoints.clearance[some], ".", color=PALE, markersize=3, alpha=0.5, mew=0)
    ax.plot(limits, limits, color=INK, linewidth=1)
    x, y = found.alpha.value[kind], found.clearance.value[kind]
    _bars(ax, x, y, found.clearance.low[kind], found.clearance.high[kind], color, mark, "mean of a bin")
    rank = _estimate(found.rank.value[kind], found.rank.low[kind], found.rank.high[kind])
    ax.set_title(f"{name}\nrank correlation {rank}", loc="left", fontsize=9.5)
    ax.annotate("nearer than foretold", (0.97, 0.04), xycoords="axes fraction", ha="right", color=INK, fontsize=8)
    ax.set_xlim(limits)
    ax.set_ylim(0, limits[1])
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlabel("predicted risk α [m]")
    ax.legend(loc="upper left", frameon=False, fontsize=8)


def _shares(ax: Axes, found: Calibration) -> None:
    part = found.overconfident
    for kind, (name, color, mark) in enumerate(_KINDS):
        label = f"{name}: {found.overall.value[kind]:.0%} of all"
        x, y = found.alpha.value[kind], 100 * part.value[kind]
        _bars(ax, x, y, 100 * part.low[kind], 100 * part.high[kind], color, mark, label)
    ax.set_title("Waypoints nearer to a surface than foretold", loc="left", fontsize=9.5)
    ax.set_xlabel("predicted risk α, mean of a bin [m]")
    ax.set_ylabel("clearance below α [%]")
    ax.set_ylim(0, 100)
    ax.legend(loc="upper right", frameon=False, fontsize=8)


def _bars(ax: Axes, x, y, low, high, color: str, mark: dict, label: str) -> None:
    """Points with their intervals; where there is none, the point alone."""
    ends = np.where(np.isfinite(low), [y - low, high - y], 0.0).clip(min=0.0)
    ax.errorbar(x, y, ends, linestyle="none", color=color, capsize=2.5, label=label, **mark)


def _estimate(value, low, high) -> str:
    return f"{value:.2f} ({low:.2f} to {high:.2f})" if np.isfinite(low) else f"{value:.2f}"
