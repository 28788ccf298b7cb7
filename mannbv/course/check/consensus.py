"""Exercises of notebook 10: residuals, the middle of two yaws, z without a condition, a slope, a solver."""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from mannbv import consensus, geometry, network
from mannbv.course.check.verdict import AGREES, Fault, ask, exercise, judged, plain

_rng = np.random.default_rng(0)


@exercise(cases=[(_rng.normal(size=3), *_rng.normal(size=(2, 2, 3)), rho) for rho in (0.5, 0.3, 2.0)])
def residuals(t, z, b, r):
    """my_residuals(copies (N,), edge (neighbours, N), before, penalty) → (primal, dual residual) of a robot."""
    apart, moved = np.abs(t - z).max(), np.abs(z - b).max()
    return {
        AGREES: (apart, r * moved),
        "swapped: first how far apart, then how far z moved": (r * moved, apart),
        "the dual residual belongs to a slope of Eq. (26): a stiffer team moves by less and feels the same":
            (apart, moved),
        "that is a norm over everything; here the worst single entry counts":
            (np.linalg.norm(t - z), r * np.linalg.norm(z - b)),
        "a difference can be negative: it is its size that counts": ((t - z).max(), r * (z - b).max()),
        "not T but z has moved": (apart, r * np.abs(t - b).max()),
    }  # fmt: skip


def _middle(a, b, announced) -> float:
    """The library's own way: two robots that gain nothing, and one round."""
    nothing = np.zeros((2, 8))
    ends = [consensus.start(i, [1 - i], [announced, 0.0], nothing, copies=[yaw, 0.0]) for i, yaw in enumerate((a, b))]
    met = consensus.step(ends[0], {1: ends[1].copies})
    return float(geometry.wrap(met.origin[0] + met.edge[0, 0]))


@exercise(cases=[(0.4, 1.0, 0.0), (3.1, -3.0, 3.1), (-2.9, 2.5, 3.0), (2.8, -2.6, 0.2), (-1.0, 0.3, -3.0)])
def middle(a, b, announced):
    """my_middle(a, b, announced) → the yaw [rad] in [−π, π) where two copies of a yaw meet, as offsets."""
    offset = (geometry.wrap(a - announced) + geometry.wrap(b - announced)) / 2
    return {
        AGREES: _middle(a, b, announced),
        "that is the mean of two numbers, the literal form: 3.1 and −3.0 look almost the same way": (a + b) / 2,
        "the right direction, but as a number it has left [−π, π)": announced + offset,
        "that is an offset: which yaw is it counted from?": offset,
        "that is the middle of the shorter way; offsets meet on the side of the announced yaw":
            geometry.wrap(a + geometry.wrap(b - a) / 2),
    }  # fmt: skip


@exercise(cases=[(*_rng.normal(size=(4, 3)), rho) for rho in (0.5, 2.0, 0.1)])
def edge(a, b, p, q, r):
    """my_edge(mine, theirs, my_dual, their_dual, penalty) → the z of a link that minimises Eq. (26), for any duals."""
    return {
        AGREES: (a + b) / 2 + (p + q) / (2 * r),
        "that is Eq. (28), right only where the two duals cancel": (a + b) / 2,
        "the sign: towards which side does λ push z in Eq. (26)?": (a + b) / 2 - (p + q) / (2 * r),
        "the duals push too hard: they act against the springs of both ends": (a + b) / 2 + (p + q) / r,
        "the duals of both ends push z the same way": (a + b) / 2 + (p - q) / (2 * r),
        "a stiffer spring yields less to the same push": (a + b) / 2 + r * (p + q) / 2,
    }


def _slope(t, g, z, y, r):
    return -g + y.sum(0) + r * (t - z).sum(0)


@exercise(cases=[(*_rng.normal(size=(2, 3)), *_rng.normal(size=(2, m, 3)), rho) for m, rho in ((2, 0.5), (3, 2.0))])
def slope(t, g, z, y, r):
    """my_slope(copies (N,), gradient, edge (neighbours, N), dual, penalty) → the slope (N,) of what (27) minimises."""
    return {
        AGREES: _slope(t, g, z, y, r),
        "the sign of the gain: what is minimised holds −F": _slope(t, -g, z, y, r),
        "every sign is turned: that is the way down, not the slope": -_slope(t, g, z, y, r),
        "the duals are missing: λᵀ(T − z) has a slope too": _slope(t, g, z, 0 * y, r),
        "the sign of the duals: λ stands before T, not before z": _slope(t, g, z, -y, r),
        "the slope of a square: what becomes of the ½?": _slope(t, g, z, y, r / 2),
        "the slope of a square: in Eq. (26) a ½ stands before it": _slope(t, g, z, y, 2 * r),
        "Eq. (27) adds up the neighbours; that is their mean": -g + y.mean(0) + r * (t - z).mean(0),
    }


def hilly(rng: np.random.Generator, n_robots: int = 4, n_yaws: int = 72, narrow: float = 4.0) -> np.ndarray:
    """Made-up gains (N, N, M): three hills a view, lower in the maps of teammates, which know less of it."""
    known = np.where(np.eye(n_robots), 1.0, rng.uniform(0, 0.8, (n_robots, n_robots)))
    heights = known[..., None] * rng.exponential(size=(n_robots, n_robots, 3))
    tops = rng.uniform(-np.pi, np.pi, (n_robots, n_robots, 3, 1))
    hills = np.exp(narrow * (np.cos(consensus.grid(n_yaws) - tops) - 1))
    return np.einsum("ikb,ikbm->ikm", heights, hills)


def _means(gains) -> list[np.ndarray]:
    """Means of the maps' favourite yaws for each view, (N,) each: on the circle and as numbers, weighted and not."""
    favourites, worth = consensus.grid(gains.shape[-1])[gains.argmax(-1)], gains.max(-1)
    around = [np.angle((w * np.exp(1j * favourites)).sum(0)) for w in (worth, np.ones_like(worth))]
    return [*around, np.average(favourites, axis=0, weights=worth), favourites.mean(0)]


@judged(
    truth=lambda gains, graph, announced, settings: consensus.solve(gains, graph, announced, "optimum")[-1].yaws,
    mistakes=[
        (lambda gains, graph, announced, settings: announced,
         "just everyone's own view: nothing that a teammate's map says has been used",
         lambda seen: abs(seen.reached - seen.alone) < 1e-6),
        *(
            (lambda gains, *rest, k=k: _means(gains)[k],
             "a mean of what the maps would like best: between two hills lies a valley; choose a yaw, average none",
             lambda seen: seen.reached < seen.alone and seen.to_mean < 0.05)
            for k in range(4)
        ),
        (lambda gains, *rest: consensus.grid(72)[gains.sum(0).argmin(-1)],
         "worse than everyone's own view: is it the largest gain that you pick, and in the right map?",
         lambda seen: seen.reached < seen.alone),
        (lambda gains, graph, announced, settings: announced[0],
         "one finite yaw a robot is wanted, shape (4,), got shape ()"),
        (lambda gains, *rest: np.degrees(consensus.grid(72)[gains.sum(0).argmax(-1)]),
         "yaws are in radians, and in [−π, π); these are larger"),
    ],
    praise="agrees better than own views: {reached:.0%} of the optimum on average, where those have {alone:.0%}",
)  # fmt: skip
def solver(mine: Callable) -> SimpleNamespace:
    """my_solver(objectives (N, N, M), network, announced (N,), settings) → N yaws [rad] that beat own views."""
    rng, graph, shares, near = np.random.default_rng(3), network.build("ring", 4), [], []
    for _ in range(20):
        gains = hilly(rng)
        gains /= consensus.scale_of(gains)
        own, best = (consensus.solve(gains, graph, np.zeros(4), name)[-1].yaws for name in ("own", "optimum"))
        yaws = ask(mine, gains.copy(), graph, own.copy(), consensus.Settings())
        yaws = plain(yaws[-1].yaws if isinstance(yaws, list) and yaws and hasattr(yaws[-1], "yaws") else yaws)
        if yaws.shape != (4,) or not np.isfinite(yaws).all():
            raise Fault(f"one finite yaw a robot is wanted, shape (4,), got shape {yaws.shape}")
        if np.abs(yaws).max() > 2 * np.pi:
            raise Fault("yaws are in radians, and in [−π, π); these are larger")
        shares.append([consensus.value(gains, views) / consensus.value(gains, best) for views in (yaws, own)])
        near.append([np.abs(geometry.wrap(yaws - mean)) for mean in _means(gains)])
    reached, alone = np.mean(shares, 0)
    return SimpleNamespace(reached=reached, alone=alone, to_mean=np.median(near, axis=(0, 2)).min())
