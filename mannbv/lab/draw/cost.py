"""What rendering and information cost, against splats, pixels and threads."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from mannbv.lab.draw import canvas
from mannbv.lab.draw.canvas import COLORS, INK, PALE

_STAGES = (
    ("fisher", "Fisher, its forward pass included", COLORS[1]),
    ("backward", "forward and gradient", COLORS[0]),
    ("forward", "forward", COLORS[2]),
)


def cost_figure(report: dict) -> Figure:
    """One panel for each curve of a report of `bench`: medians, and the band that holds half of the rounds.

    Against splats and pixels CPU time of one thread, which a busy machine hardly changes; against threads the clock.
    """
    made, axes = canvas.figure(11.0, 3.6, columns=3, sharey=True)
    rows = [row for row in report["results"] if "over" in row["facts"]]
    with canvas.style():
        for ax, over in zip(axes, ("splats", "pixels", "threads"), strict=True):
            _panel(ax, [row for row in rows if row["facts"]["over"] == over], over)
        axes[0].set_ylabel("time of a call [ms]")
        handles, names = axes[0].get_legend_handles_labels()
        if handles:
            axes[0].legend(handles, names, loc="upper left", frameon=False)
    return made


def _panel(ax: Axes, rows: list[dict], over: str) -> None:
    for stage, name, color in _STAGES:
        own = sorted((row for row in rows if row["facts"]["stage"] == stage), key=lambda row: row["facts"]["at"])
        times = [row["samples" if over == "threads" else "cpu"] for row in own]
        at, middle = [row["facts"]["at"] for row in own], [1e3 * time["median"] for time in times]
        low, high = ([1e3 * time["quartiles"][end] for time in times] for end in (0, 1))
        ax.fill_between(at, low, high, color=color, alpha=0.2, linewidth=0)
        ax.plot(at, middle, "o-", color=color, markersize=4, linewidth=1.5, label=name)
    ax.set_title(_title(rows, over), loc="left")
    ax.set_xlabel(over)
    if not rows:
        ax.annotate("not measured", (0.5, 0.5), xycoords="axes fraction", ha="center", color=PALE)
        return
    ax.set_xscale("log")
    ax.set_yscale("log")
    places = sorted({row["facts"]["at"] for row in rows})
    ax.set_xticks(places, [_short(place) for place in places])
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.tick_params(axis="x", which="minor", length=0)
    ax.grid(color="#dddddd", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.tick_params(colors=INK)


def _title(rows: list[dict], over: str) -> str:
    """What stays the same along the curve."""
    if not rows:
        return over
    size, n_splats = (
        f"{rows[0]['facts']['width']}×{rows[0]['facts']['width']} px",
        f"{rows[0]['facts']['splats']:,} splats",
    )
    fixed = {
        "splats": f"{size}, CPU time",
        "pixels": f"{n_splats}, CPU time",
        "threads": f"{n_splats}, {size}, wall clock",
    }
    return fixed[over]


def _short(count: int) -> str:
    """1k, 2.5k, 1.3M."""
    for size, letter in ((1_000_000, "M"), (1000, "k")):
        if count >= size:
            return f"{count / size:.2g}{letter}" if count < 100 * size else f"{count / size:.0f}{letter}"
    return str(count)
