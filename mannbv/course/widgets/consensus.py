"""C-ADMM on yaws, round by round: everyone's copies of everyone's yaw, and how far from agreement (Eqs. (25)-(29))."""

import functools
import math

import numpy as np

from mannbv import consensus, geometry, network
from mannbv.course.check.consensus import hilly
from mannbv.course.widgets import items
from mannbv.course.widgets.explorer import Explorer
from mannbv.course.widgets.settings import Choice, Range
from mannbv.lab import draw
from mannbv.lab.draw.canvas import INK, PALE

_ROUNDS, _TOLERANCE = 50, consensus.Settings().tolerance
_HILLS, _ANYWHERE, _SEAM, _WOUND = "hills", "anywhere", "seam", "wound"
_TEAMS = {
    "hills, from own best views": _HILLS,
    "hills, from anywhere": _ANYWHERE,
    "3.1 and −3.1 rad in turn": _SEAM,
    "none, wound around the circle": _WOUND,
}
_SOLVERS = {"cadmm": "cadmm", "cadmm-gradient": "cadmm-gradient", "cadmm-literal": "cadmm-literal",
            "profile (one exchange)": "profile", "own (no message)": "own"}  # fmt: skip
_POWERS = [[-4, "10⁻⁴"], [-2, "0.01"], [0, "1"]]
_RIM, _HEIGHT, _PITCH = 1.1, 0.5, 3.5  # in radii of a ring: where gains start, how high they rise, ring to ring


def agreement() -> Explorer:
    """Play the rounds of C-ADMM: copies of each yaw travel on rings, and residuals and the team's gain are charted."""
    return Explorer(
        _picture,
        {
            "round_": Range("round", 0, _ROUNDS, 0, play=250),
            "team": Choice("wishes:", _TEAMS, _HILLS),
            "solver": Choice("solver:", _SOLVERS, "cadmm"),
            "n_robots": Range("robots", 3, 8, 4),
            "graph": Choice("graph:", tuple(network.GRAPHS), "ring"),
            "penalty": Range("penalty ρ at first", 0.0125, 0.8, 0.05, math.log10(2), log=True),
            "seed": Range("made-up team number", 0, 20, 6),
        },
        size=(860, 460),
    )


@functools.lru_cache(32)
def _wishes(team, n_robots, seed):
    """Gains (N, N, M), and first copies: announced yaws (N,), or each robot's own of all (N, N) [rad]."""
    rng = np.random.default_rng(seed)
    if team == _WOUND:
        return np.zeros((n_robots, n_robots, 72)), np.tile(
            2 * np.pi * np.arange(n_robots)[:, None] / n_robots, n_robots
        )
    if team == _SEAM:
        favourite = 3.1 * (-1.0) ** np.arange(n_robots)[:, None]
        hill = np.exp(4 * (np.cos(consensus.grid(72) - favourite) - 1))
        return np.tile(hill[:, None], (1, n_robots, 1)), np.tile(favourite, n_robots)
    gains = hilly(rng, n_robots)
    if team == _ANYWHERE:
        return gains, rng.uniform(-np.pi, np.pi, n_robots)
    return gains, consensus.solve(gains, network.build("complete", n_robots), np.zeros(n_robots), "own")[-1].yaws


@functools.lru_cache(8)
def _played(team, solver, n_robots, graph, penalty, seed):
    """The whole trace, the best yaws (N,), and each round's share of the optimum; nan where nothing can be gained."""
    gains, first = _wishes(team, n_robots, seed)
    links = network.build(graph, n_robots)
    trace = consensus.solve(gains, links, first, solver, penalty=penalty, rounds=_ROUNDS)
    best = consensus.solve(gains, links, first, "optimum")[-1].yaws
    reached = consensus.interpolate(gains.sum(0), np.array([best, *(stand.yaws for stand in trace)])).sum(1)
    return trace, best, reached[1:] / (reached[0] or math.nan)


def _picture(round_, team, solver, n_robots, graph, penalty, seed):
    gains, first = _wishes(team, n_robots, seed)
    trace, best, shares = _played(team, solver, n_robots, graph, penalty, seed)
    last = min(round_, len(trace) - 1)
    stand = trace[last]
    announced = first if first.ndim == 1 else np.diagonal(first)
    panels = [_caption(), _rings(gains, announced, best, stand.copies), _links(network.build(graph, n_robots))]
    panels += [_residuals(trace, round_), _share(shares, round_)]
    return panels, _says(solver, stand, round_, len(trace) - 1, shares[last])


def _says(solver, stand, round_, last, share) -> str:
    gained = "there is nothing to gain" if math.isnan(share) else f"{share:.1%} of the team's optimum"
    if not stand.states:
        return f"{solver}: no rounds; of the others, a robot knows only what they announced; {gained}"
    apart = np.abs(geometry.wrap(stand.copies[:, None] - stand.copies)).max()
    verdict = "they do not agree yet" if round_ < last else "the rounds are over, and they do not agree"
    if max(stand.primal_residual, stand.dual_residual) < _TOLERANCE:
        verdict = f"they agree, after {last} rounds"
    sent = f"residuals {stand.primal_residual:.3f} rad and {stand.dual_residual:.3f}" if round_ else "nothing sent yet"
    return f"round {round_}: {verdict}; copies up to {apart:.2f} rad apart, {sent}; {gained}"


def _around(center, radius, yaw) -> np.ndarray:
    return np.asarray(center) + np.multiply(radius, np.array([np.cos(yaw), np.sin(yaw)])).T


def _rings(gains, announced, best, copies) -> dict:
    """A ring for each robot's yaw: copies inside, one radius a robot; outside, what that yaw is worth to the team."""
    n, lift = len(copies), np.full((1, 2), math.nan)
    columns = math.ceil(n / 2)
    centers = [(_PITCH * (k % columns), -_PITCH * (k // columns)) for k in range(n)]
    worth = gains.sum(0) / (gains.sum(0).max() or 1)
    circle, yaws, radii = np.linspace(0, 2 * np.pi, 73), consensus.grid(gains.shape[-1]), np.linspace(0.95, 0.4, n)
    worth, yaws = np.column_stack([worth, worth[:, 0]]), np.append(yaws, np.pi)
    ring, rim, marks, starts = [], [], [], []
    for k, center in enumerate(centers):
        ring += [_around(center, 1, circle), lift]
        rim += [_around(center, _RIM + _HEIGHT * worth[k], yaws), lift]
        marks += [_around(center, [_RIM - 0.1, _RIM + _HEIGHT + 0.1], np.full(2, best[k])), lift]
        starts += [_around(center, [0.25, 1.0], np.full(2, announced[k])), lift]
    shown = [
        items.line(np.concatenate(rim), PALE, 1, fill=PALE, strength=0.35),
        items.line(np.concatenate(ring), PALE, 1, fill="#ffffff"),
        items.line(np.concatenate(starts), PALE, 1.2, (2, 3)),
        items.line(np.concatenate(marks) if worth.any() else lift, INK, 2.5),
    ]
    for i in range(n):
        at = [_around(center, radii[i], copies[i, k]) for k, center in enumerate(centers)]
        shown.append(items.dots(at, draw.robot_color(i), 9, "#ffffff"))
    shown += [items.text(center, f"{k}", draw.robot_color(k)) for k, center in enumerate(centers)]
    x, y = (-_PITCH / 2, _PITCH * (columns - 0.5)), (-1.5 * _PITCH, _PITCH / 2)
    return items.panel((10, 40, 540, 390), x, y, shown, equal=True, axes=False)


def _caption() -> dict:
    lines = (
        "inside ring k: everyone's copies of robot k's yaw, each in its robot's colour",
        "outside: what that yaw is worth to the team; black: the best yaw, dotted: the announced one",
    )
    words = [items.text((0, y), line, align="left") for y, line in zip((0.75, 0.25), lines, strict=True)]
    return items.panel((20, 0, 600, 40), (0, 1), (0, 1), words, axes=False)


def _links(graph) -> dict:
    """Who talks to whom: robots on a circle, the middle of a star in its middle."""
    n = len(graph)
    at = _around((0, 0), 1, np.pi / 2 - 2 * np.pi * np.arange(n) / n)
    if n > 3 and max(dict(graph.degree).values()) == n - 1 > graph.degree[n - 1]:
        at = np.vstack([[0, 0], _around((0, 0), 1, np.pi / 2 - 2 * np.pi * np.arange(n - 1) / (n - 1))])
    shown = [items.line(at[list(link)], PALE) for link in graph.edges]
    shown += [items.dots(at[[k]], draw.robot_color(k), 17) for k in range(n)]
    shown += [items.text(at[k], f"{k}", "#ffffff") for k in range(n)]
    return items.panel((640, 5, 170, 120), (-1.7, 1.7), (-1.2, 1.2), shown, equal=True, axes=False)


def _residuals(trace, round_) -> dict:
    """Both residuals over the rounds, on a logarithmic axis, and where the rounds may end."""
    rounds = np.arange(1, len(trace))
    shown = [items.line([(0, math.log10(_TOLERANCE)), (_ROUNDS, math.log10(_TOLERANCE))], PALE, 1.2, (4, 3))]
    for name, color in (("primal_residual", draw.COLORS[0]), ("dual_residual", draw.COLORS[1])):
        height = np.log10([max(getattr(stand, name), 1e-9) for stand in trace[1:]])
        shown.append(items.curve(rounds, height, color))
        shown.append(items.dots(np.column_stack([rounds, height])[min(round_, len(rounds)) - 1 :][: round_ > 0], color))
    shown.append(items.line([(round_, -9), (round_, 9)], INK, 1.2))
    legend = [("primal [rad]", draw.COLORS[0], "line"), ("dual", draw.COLORS[1], "line"), ("end", PALE, "dash")]
    return items.panel(
        (610, 180, 235, 105), (0, _ROUNDS), (-4, 1), shown,
        title="residuals: apart, and still moving", yticks=_POWERS, legend=legend,
    )  # fmt: skip


def _share(shares, round_) -> dict:
    """What the team would gain if the rounds ended here, as a share of its optimum."""
    known = np.array(shares)
    shown = [
        items.line([(0, 1), (_ROUNDS, 1)], PALE, 1.2, (4, 3)),
        items.curve(np.arange(len(known)), known, draw.COLORS[2]),
        items.line([(round_, -9), (round_, 9)], INK, 1.2),
        items.dots([[min(round_, len(known) - 1), known[min(round_, len(known) - 1)]]], draw.COLORS[2]),
    ]
    return items.panel((610, 345, 235, 75), (0, _ROUNDS), (0, 1.1), shown, xlabel="round [1]",
                       title="share of the team's optimum [1]")  # fmt: skip
