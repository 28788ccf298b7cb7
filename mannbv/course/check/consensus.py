"""The exercises of notebook 10: residuals, the middle of two yaws, z without a condition, a slope, a solver."""

from collections.abc import Callable

import numpy as np

from mannbv import consensus, geometry, network
from mannbv.course.check.verdict import Fault, ask, compare, say


def residuals(mine: Callable) -> bool:
    """mine(copies (N,), edge (neighbours, N), before (neighbours, N), penalty) → (primal, dual residual) of a robot."""
    rng = np.random.default_rng(0)
    cases = [(rng.normal(size=3), *rng.normal(size=(2, 2, 3)), rho) for rho in (0.5, 0.3, 2.0)]
    return compare(
        mine,
        _residuals,
        cases,
        [
            (lambda t, z, b, r: _residuals(t, z, b, r)[::-1], "swapped: first how far apart, then how far z moved"),
            (
                lambda t, z, b, r: _residuals(t, z, b, 1.0),
                "the dual residual belongs to a slope of Eq. (26): a stiffer team moves by less and feels the same",
            ),
            (
                lambda t, z, b, r: (np.linalg.norm(t - z), r * np.linalg.norm(z - b)),
                "that is a norm over everything; here the worst single entry counts",
            ),
            (
                lambda t, z, b, r: ((t - z).max(), r * (z - b).max()),
                "a difference can be negative: it is its size that counts",
            ),
            (lambda t, z, b, r: (_residuals(t, z, b, r)[0], r * np.abs(t - b).max()), "not T but z has moved"),
        ],
    )


def _residuals(copies, edge, before, penalty) -> tuple:
    return np.abs(copies - edge).max(), penalty * np.abs(edge - before).max()


def middle(mine: Callable) -> bool:
    """mine(a, b, announced) → the yaw [rad] in [−π, π) where two copies of a yaw meet, as offsets from `announced`."""
    cases = [(0.4, 1.0, 0.0), (3.1, -3.0, 3.1), (-2.9, 2.5, 3.0), (2.8, -2.6, 0.2), (-1.0, 0.3, -3.0)]
    wrap = geometry.wrap
    return compare(
        mine,
        _middle,
        cases,
        [
            (
                lambda a, b, o: (a + b) / 2,
                "that is the mean of two numbers, the literal form: 3.1 and −3.0 look almost the same way",
            ),
            (
                lambda a, b, o: o + (wrap(a - o) + wrap(b - o)) / 2,
                "the right direction, but as a number it has left [−π, π)",
            ),
            (lambda a, b, o: (wrap(a - o) + wrap(b - o)) / 2, "that is an offset: which yaw is it counted from?"),
            (
                lambda a, b, o: wrap(a + wrap(b - a) / 2),
                "that is the middle of the shorter way; offsets meet on the side of the announced yaw",
            ),
        ],
    )


def _middle(a, b, announced) -> float:
    """The library's own way: two robots that gain nothing, and one round."""
    nothing = np.zeros((2, 8))
    ends = [consensus.start(i, [1 - i], [announced, 0.0], nothing, copies=[yaw, 0.0]) for i, yaw in enumerate((a, b))]
    met = consensus.step(ends[0], {1: ends[1].copies})
    return float(geometry.wrap(met.origin[0] + met.edge[0, 0]))


def edge(mine: Callable) -> bool:
    """mine(mine, theirs, my_dual, their_dual, penalty) → the z of a link that minimises Eq. (26), for any duals."""
    rng = np.random.default_rng(1)
    cases = [(*rng.normal(size=(4, 3)), rho) for rho in (0.5, 2.0, 0.1)]
    return compare(
        mine,
        _edge,
        cases,
        [
            (lambda a, b, p, q, r: (a + b) / 2, "that is Eq. (28), right only where the two duals cancel"),
            (lambda a, b, p, q, r: _edge(a, b, -p, -q, r), "the sign: towards which side does λ push z in Eq. (26)?"),
            (
                lambda a, b, p, q, r: (a + b) / 2 + (p + q) / r,
                "the duals push too hard: they act against the springs of both ends",
            ),
            (lambda a, b, p, q, r: _edge(a, b, p, -q, r), "the duals of both ends push z the same way"),
            (lambda a, b, p, q, r: (a + b) / 2 + r * (p + q) / 2, "a stiffer spring yields less to the same push"),
        ],
    )


def _edge(mine, theirs, my_dual, their_dual, penalty):
    return (mine + theirs) / 2 + (my_dual + their_dual) / (2 * penalty)


def slope(mine: Callable) -> bool:
    """mine(copies (N,), gradient (N,), edge (neighbours, N), dual, penalty) → the slope (N,) of what (27) minimises."""
    rng = np.random.default_rng(2)
    cases = [(*rng.normal(size=(2, 3)), *rng.normal(size=(2, m, 3)), rho) for m, rho in ((2, 0.5), (3, 2.0))]
    return compare(
        mine,
        _slope,
        cases,
        [
            (lambda t, g, z, y, r: _slope(t, -g, z, y, r), "the sign of the gain: what is minimised holds −F"),
            (lambda t, g, z, y, r: -_slope(t, g, z, y, r), "every sign is turned: that is the way down, not the slope"),
            (lambda t, g, z, y, r: _slope(t, g, z, 0 * y, r), "the duals are missing: λᵀ(T − z) has a slope too"),
            (lambda t, g, z, y, r: _slope(t, g, z, -y, r), "the sign of the duals: λ stands before T, not before z"),
            (lambda t, g, z, y, r: _slope(t, g, z, y, r / 2), "the slope of a square: what becomes of the ½?"),
            (
                lambda t, g, z, y, r: -g + y.mean(0) + r * (t - z).mean(0),
                "Eq. (27) adds up the neighbours; that is their mean",
            ),
        ],
    )


def _slope(copies, gradient, edge, dual, penalty):
    return -gradient + dual.sum(0) + penalty * (copies - edge).sum(0)


def hilly(rng, n_robots=4, n_yaws=72, narrow=4.0) -> np.ndarray:
    """Made-up gains (N, N, M): three hills a view, lower in the maps of teammates, which know less of it."""
    known = np.where(np.eye(n_robots), 1.0, rng.uniform(0, 0.8, (n_robots, n_robots)))
    heights = known[..., None] * rng.exponential(size=(n_robots, n_robots, 3))
    tops = rng.uniform(-np.pi, np.pi, (n_robots, n_robots, 3, 1))
    hills = np.exp(narrow * (np.cos(consensus.grid(n_yaws) - tops) - 1))
    return np.einsum("ikb,ikbm->ikm", heights, hills)


def solver(mine: Callable) -> bool:
    """mine(objectives (N, N, M), network, announced (N,), settings) → N yaws [rad] that beat everyone's own views."""
    rng, graph, shares = np.random.default_rng(3), network.build("ring", 4), []
    for _ in range(20):
        gains = hilly(rng)
        gains /= consensus.scale_of(gains)
        own, best = (consensus.solve(gains, graph, np.zeros(4), name)[-1].yaws for name in ("own", "optimum"))
        try:
            yaws = ask(mine, gains.copy(), graph, own.copy(), consensus.Settings())
        except Fault as fault:
            return say(str(fault))
        yaws = yaws[-1].yaws if isinstance(yaws, list) and hasattr(yaws[-1], "yaws") else np.asarray(yaws, float)
        if yaws.shape != (4,) or not np.isfinite(yaws).all():
            return say(f"one finite yaw a robot is wanted, shape (4,), got shape {yaws.shape}")
        if np.abs(yaws).max() > 2 * np.pi:
            return say("yaws are in radians, and in [−π, π); these are larger")
        top = consensus.value(gains, best)
        shares.append([consensus.value(gains, views) / top for views in (yaws, own)])
    reached, alone = np.mean(shares, 0)
    if abs(reached - alone) < 1e-6:
        return say("just everyone's own view: nothing that a teammate's map says has been used")
    if reached < alone:
        return say("worse than everyone's own view: is it the largest gain that you pick, and in the right map?")
    praise = f"agrees better than own views: {reached:.0%} of the optimum on average, where those have {alone:.0%}"
    return say(praise, True)
