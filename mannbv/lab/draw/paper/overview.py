"""One cycle of a team told as the paper's Fig. 1: private maps, what crosses the links, the views that are chosen."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mannbv.episode import Record
from mannbv.lab import report, study
from mannbv.lab.draw import canvas, parts, team
from mannbv.lab.draw.canvas import INK, placed, robot_color
from mannbv.lab.draw.paper import page
from mannbv.lab.draw.paper.page import GAP, HEAD, LEFT, RIGHT
from mannbv.lab.draw.team import Window
from mannbv.messages import Ledger

_MOST = 5  # robots shown
_BAND = 1.7  # inches of the row of arrows
_NAMES = {
    "Plan": "plans (path, view, yaw)",
    "Suggestion": "suggested views and their gains",
    "Copies": "copies of the team's yaws (C-ADMM)",
    "Profile": "gains of all yaws",
    "Splats": "splats",
    "Grid": "grids",
}


def overview_figure(record: Record, cycle: int | None = None) -> Figure:
    """One planning cycle (`study.midway` by default) from top to bottom: every robot's own map and plan, the bytes that
    it sent and received, and the view that the team chose for it, beside what teammates suggest."""
    snapshot, whole = study.snapshot(record, cycle), team.known(record)
    count = min(record.n_robots, _MOST)
    width = page.column_width(count)
    tall, page_width = width * whole.aspect, max(LEFT + count * (width + GAP) - GAP + RIGHT, 10.5)
    band, below = HEAD + tall, HEAD + tall + _BAND
    with canvas.style():
        shown = "" if count == record.n_robots else f"; robots 0 to {count - 1} shown"
        made = page.page(
            page_width, below + tall + 0.15,
            f"{team.scene_of(record)}, {record.strategy}: one planning cycle of {record.n_robots} robots",
            f"Cycle {snapshot.cycle + 1} of {len(record.cycles)}{shown}. "
            "Upper maps: the oldest splats, as many as then; lower maps: those of the end.",
            record, _entries(),
        )  # fmt: skip
        for k in range(count):
            left = LEFT + k * (width + GAP)
            _own(placed(made, left, HEAD, width, tall), record, snapshot, k, whole)
            ax = placed(made, left, below, width, tall)
            team.belief(ax, snapshot.robots[k], record.config)
            near = team.closeup(snapshot.robots[k], whole.aspect)
            near.on(ax)
            team.scale_bar(ax, near)
        page.beside(made, "observe, map, plan", HEAD, tall)
        page.beside(made, "exchange", band, _BAND)
        page.beside(made, "agree on views", below, tall)
        strip = placed(made, LEFT, band, count * (width + GAP) - GAP, _BAND)
        _traffic(strip, record, snapshot.cycle, [k * (width + GAP) + width / 2 for k in range(count)])
    return made


def _own(ax: Axes, record: Record, snapshot: study.Snapshot, k: int, whole: Window) -> None:
    """A robot's private map with its plan."""
    robot, planned = record.robots[k], snapshot.robots[k]
    count = record.cycles[snapshot.cycle].robots[k].splats
    parts.ground(ax, robot.ground)
    page.from_above(ax, page.back_then(robot, count), robot.position[2:], record.config)
    parts.path(ax, planned.path, robot_color(k))
    ax.plot(*robot.goal[:2], "*", color=robot_color(k), markersize=13, markeredgecolor="white", zorder=6)
    team.badge(ax, planned.position, k)
    page.bare(ax, whole)
    team.scale_bar(ax, whole)
    title = f"robot {k}: {count:,} splats of its own"
    ax.set_title(title, loc="left", color=robot_color(k), weight="bold", fontsize=10)


def _traffic(ax: Axes, record: Record, cycle: int, middles: list[float]) -> None:
    """Arrows between each robot and all others, with the bytes that the ledger has for this cycle."""
    ledger = Ledger({key: row for key, row in record.ledger.rows.items() if key[4] == cycle})
    width = ax.bbox.width / ax.figure.dpi  # inches
    ax.set(xlim=(0, width), ylim=(0, _BAND))
    ax.set_axis_off()
    for k, x in enumerate(middles):
        for top, word, n_bytes in (
            (_BAND - 0.06, "sends", ledger.sent_by(k)),
            (0.5, "receives", ledger.received_by(k)),
        ):
            arrow = {"arrowstyle": "-|>", "color": robot_color(k), "linewidth": 2, "shrinkA": 0, "shrinkB": 0}
            ax.annotate("", (x, top - 0.44), (x, top), arrowprops=arrow)
            ax.text(x + 0.12, top - 0.2, f"{word} {kilobytes(n_bytes)}", va="center", color=INK, fontsize=9)
    box = {"boxstyle": "round,pad=0.45", "facecolor": "#f2f2f2", "edgecolor": "#bbbbbb"}
    ax.text(
        width / 2,
        0.83,
        _said(ledger, max(1, int(width / 4))),
        ha="center",
        va="center",
        color=INK,
        fontsize=9.5,
        bbox=box,
    )


def _said(ledger: Ledger, columns: int) -> str:
    """What crosses the links, at most `columns` kinds a line."""
    kinds = ledger.by_kind()
    if not kinds:
        return "nothing is sent: every robot plans alone"
    words = [f"{_NAMES.get(kind, kind.lower())} {kilobytes(n_bytes)}" for kind, n_bytes in kinds.items()]
    words += [] if "Splats" in kinds else ["no splat, no image"]
    lines = [words[k : k + columns] for k in range(0, len(words), columns)]
    return "\n".join(" · ".join(line) for line in lines)


def kilobytes(n_bytes: int) -> str:
    """Bytes in KB (1000 B), three digits."""
    return f"{report.digits(n_bytes / 1000)} KB"


def _entries() -> dict:
    return {
        "robot": page.dot("#555555", 9),
        "goal": Line2D([], [], marker="*", linestyle="", markersize=12, color="#555555"),
        "planned path": Line2D([], [], color="#555555", linewidth=2),
        "chosen view": page.wedge("#555555"),
        "view that a teammate suggests, in its colour": Line2D([], [], color=robot_color(1), linewidth=2),
        **page.ground_entries(),
    }
