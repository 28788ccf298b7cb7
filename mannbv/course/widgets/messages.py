"""Messages: what a team sends in one cycle, link by link and kind by kind, in really encoded bytes (Section VI-D)."""

import math

import numpy as np

from mannbv import messages as wire
from mannbv import network
from mannbv.config import Config
from mannbv.course.widgets import items
from mannbv.course.widgets.explorer import Explorer
from mannbv.course.widgets.settings import Choice, Range
from mannbv.course.widgets.traffic import cycle_ledger, size_of
from mannbv.lab import draw
from mannbv.lab.draw.canvas import PALE

_CODEC = Config().codec
_KINDS: dict[str, str] = dict(zip(("Plan", "Suggestion", "Copies", "Splats", "Grid"), draw.COLORS, strict=False))
_NAMES = {"json": "JSON", "binary": "binary"}
_LOW, _HIGH = 1.0, 9.0  # 10 B to 1 GB, as powers of ten


def messages() -> Explorer:
    """Choose a team, who hears whom, and a strategy; see what one planning cycle costs every link and every robot."""
    return Explorer(
        _picture,
        {
            "strategy": Choice("strategy", ("distributed", "limited", "centralized"), "distributed"),
            "graph": Choice("graph", tuple(network.GRAPHS), "complete"),
            "robots": Range("robots [1]", 2, 10, 5),
            "splats": Range("splats in a map [1]", 100, 30_000, 1000, 0.05, log=True),
            "rounds": Range("rounds of C-ADMM [1]", 0, 60, 30),
            "waypoints": Range("waypoints of a path [1]", 1, 200, 20),
        },
        size=(860, 400),
    )


def _picture(strategy, graph, robots, splats, rounds, waypoints):
    options = {"graph": graph, "robots": robots, "splats": round(splats), "rounds": rounds, "waypoints": waypoints}
    books = {codec: cycle_ledger(strategy, codec=codec, **options) for codec in wire.CODECS}
    book, whole = books[_CODEC], cycle_ledger("centralized", codec=_CODEC, **options)
    own = ", ".join(f"{size_of(ledger.total() / robots)} in {_NAMES[codec]}" for codec, ledger in books.items())
    says = f"a robot sends {own}; the team {size_of(book.total())} in {book.messages():,} messages"
    if strategy != "centralized":
        times = whole.total() / book.total()
        says += f"; centralized it would be {size_of(whole.total())}, {times:,.{int(times < 10)}f} times as much"
    else:
        says += f"; the paper counts every map once, {size_of(book.paper_total(strategy))} of these"
    return [_team(graph, robots, book), _bars(robots, round(splats), books)], says


def _team(graph: str, robots: int, book: wire.Ledger) -> dict:
    at, outward = _places(graph, robots)
    links = book.by_link()
    shown = []
    for i, k in network.build(graph, robots).edges:
        both = links.get((i, k), 0) + links.get((k, i), 0)
        shown.append(items.line(at[[i, k]], PALE, _thick(both)))
    for k in range(robots):
        shown.append(items.dots(at[k], draw.robot_color(k), 24, edge="white"))
        shown.append(items.text(at[k], str(k), "white"))
        shown += _words(at[k] + outward[k] - [0.033 * len(size_of(book.sent_by(k))), 0], book.sent_by(k), 0.066, 0.08)
    for x, n_bytes in zip((-1.1, -0.1, 0.9), (1e3, 1e5, 1e7), strict=True):
        shown.append(items.line([[x - 0.2, -1.62], [x + 0.1, -1.62]], PALE, _thick(n_bytes)))
        shown.append(items.text((x + 0.16, -1.62), size_of(n_bytes), align="left"))
    shown.append(items.text((0, 1.42), f"sent by each robot; links as thick as log bytes ({_NAMES[_CODEC]})"))
    return items.panel((15, 30, 360, 350), (-1.65, 1.65), (-1.75, 1.5), shown, equal=True, axes=False)


def _places(graph: str, robots: int):
    """Where robots (n, 2) stand in the picture, and where their numbers do beside them."""
    if graph == "line":
        x = np.linspace(-1.35, 1.35, robots)
        return np.column_stack([x, 0 * x]), np.array([[0.0, 0.24 * (-1) ** k] for k in range(robots)])
    ring = robots - (graph == "star")
    angle = math.pi / 2 - 2 * math.pi * np.arange(ring) / ring
    at = np.column_stack([np.cos(angle), np.sin(angle)])
    if graph == "star":
        between = math.pi / 2 - math.pi / ring
        hub = [0.5 * math.cos(between), 0.5 * math.sin(between)]
        return np.vstack([np.zeros(2), at]), np.vstack([hub, at * [0.36, 0.24]])
    return at, at * [0.36, 0.24]


def _thick(n_bytes) -> float:
    """Pixels for the bytes of a link: 2.5 for every power of ten beyond 1 kB."""
    return 1 + 2.5 * max(0.0, math.log10(max(n_bytes, 1)) - 3)


def _bars(robots: int, splats: int, books: dict[str, wire.Ledger]) -> dict:
    """What a robot sends, on average, of each kind: filled in binary, outlined in JSON."""
    paper = {
        "ideal exchange": wire.ideal_exchange_bytes(),
        "Table VI, limited": wire.limited_sharing_bytes(robots) / robots,
        "56 B a splat": wire.centralized_bytes([splats] * robots) / robots,
    }
    marks = list(zip(paper, (draw.COLORS[2], draw.COLORS[3], draw.COLORS[1]), strict=True))
    shown = [items.curve([math.log10(paper[name])] * 2, [-0.6, 5.6], color, dash=(6, 4)) for name, color in marks]
    rows = [*_KINDS, "all"]
    for codec, ledger in books.items():
        sums = ledger.by_kind() | {"all": ledger.total()}
        for y, kind in enumerate(reversed(rows)):
            if kind in sums:
                shown += _bar(y, sums[kind] / robots, _KINDS.get(kind, "#444444"), codec == "binary")
            elif codec == _CODEC:
                shown.append(items.text((_LOW + 0.1, y), "none", PALE, align="left"))
    ticks = [[p, size_of(10.0**p)] for p in range(int(_LOW), int(_HIGH) + 1)]
    names = [[y, kind] for y, kind in enumerate(reversed(rows))]
    return items.panel(
        (465, 50, 380, 295), (_LOW, _HIGH), (-0.6, 5.6), shown, xticks=ticks, yticks=names,
        title="a robot's bytes in a cycle: binary filled, JSON outlined",
        xlabel="sent by a robot, mean of the team; dashed: the paper's counts",
        legend=[(name, color, "dash") for name, color in marks],
    )  # fmt: skip


def _bar(y, n_bytes, color: str, filled: bool) -> list[dict]:
    low, high = (y - 0.4, y - 0.02) if filled else (y + 0.02, y + 0.4)
    end = max(_LOW, math.log10(n_bytes))
    corners = [[_LOW, low], [end, low], [end, high], [_LOW, high], [_LOW, low]]
    shape = items.line(corners, color, 1.4, fill=color, strength=0.9 if filled else 0.12)
    return [*_words((end + 0.08, (low + high) / 2), n_bytes, 0.17, 0.17), shape]


def _words(at, n_bytes, wide, high) -> list[dict]:
    """Bytes in words right of a place, on white, so that no line runs through them."""
    (x, y), words = at, size_of(n_bytes)
    right = x + wide * len(words)
    ground = [[x, y - high], [right, y - high], [right, y + high], [x, y + high]]
    return [items.line(ground, None, fill="#ffffff", strength=1), items.text((x, y), words, align="left")]
