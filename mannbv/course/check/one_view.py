"""Checkers of notebook 06: the weighted gain, maxima on a circle, a slope, a search with few views."""

import math
from collections.abc import Callable

import numpy as np
import torch
from scipy.signal import find_peaks

from mannbv import geometry, information
from mannbv.camera import Camera
from mannbv.course.check.verdict import Fault, ask, compare, say
from mannbv.splats import SplatMap


def gain(mine: Callable) -> bool:
    """mine(acquired, prior, weights, selected, damping) → Eq. (15)."""

    def case(seed: int) -> tuple:
        rng = np.random.default_rng(seed)
        numbers = [torch.from_numpy(rng.uniform(0.1, 2.0, shape)) for shape in ((6, 9), (6, 9), 6, 9)]
        acquired, prior, weights, damping = numbers
        return acquired, prior, weights, torch.arange(6) % 3 > 0, damping

    def without_weights(h, H, v, zone, d):
        return (h / (H + d))[zone].sum()

    return compare(
        mine,
        lambda h, H, v, zone, d: information.gain(h, H, weights=v, selected=zone, damping=d),
        [case(seed) for seed in range(3)],
        [
            (without_weights, "the weights do nothing: left out, or put on the prior too, where they cancel"),
            (lambda h, H, v, zone, d: (v[:, None] * h / (H + d)).sum(), "splats outside the zone count too"),
            (lambda h, H, v, zone, d: (v[:, None] * h / (H + d))[~zone].sum(), "the zone is turned inside out"),
            (
                lambda h, H, v, zone, d: (v[:, None] * h / (v[:, None] * H + d))[zone].sum(),
                "the weight divides too: what is known already keeps its full size",
            ),
            (lambda h, H, v, zone, d: (v[:, None] * h / H)[zone].sum(), "no λ: a splat never seen would divide by 0"),
            (lambda h, H, v, zone, d: (v[:, None] ** 2 * h / (H + d))[zone].sum(), "the weight counts twice"),
            (lambda h, H, v, zone, d: (v[:, None] * h / (H + d))[zone].mean(), "a mean: the trace is a sum"),
            (
                lambda h, H, v, zone, d: (h / (v[:, None] * H + d))[zone].sum(),
                "the weight belongs to what the view tells, not to what is known",
            ),
            (
                lambda h, H, v, zone, d: (v[:, None] * h / (H + d))[zone].sum() / v[zone].sum(),
                "Eq. (15) does not divide by the sum of the weights",
            ),
        ],
    )


def maxima(mine: Callable) -> bool:
    """mine(gains (M,) on uniform yaws of the whole circle) → number of local maxima, higher than both neighbours."""

    def inner(gains) -> int:
        return int(((gains[1:-1] > gains[:-2]) & (gains[1:-1] > gains[2:])).sum())

    def truth(gains) -> int:
        return int(((gains > np.roll(gains, 1)) & (gains > np.roll(gains, -1))).sum())

    def hills(gains) -> int:
        low = int(gains.argmin())
        return len(find_peaks(np.roll(gains, -low), prominence=0.05 * gains.max())[0])

    def flat_too(gains) -> int:
        return int(((gains >= np.roll(gains, 1)) & (gains >= np.roll(gains, -1))).sum())

    def turns(gains) -> int:
        return int((np.sign(gains - np.roll(gains, 1)) != np.sign(np.roll(gains, -1) - gains)).sum())

    cases = [[3, 1, 2, 0, 1, 0], [0, 1, 0, 4, 2, 5], [2, 1, 4, 3, 6, 5, 7, 0], [5, 1, 2, 0, 3, 4]]
    cases += [[2, 1, 0, 0, 0, 3, 1], [50, 49, 51, 30, 20, 60, 10, 0]]  # nothing in view; ripple on a hill
    return compare(
        mine,
        truth,
        [(np.array(case, float),) for case in cases],
        [
            (inner, "yaws form a circle: the first and the last are neighbours"),
            (
                lambda g: inner(np.concatenate([[-np.inf], g, [-np.inf]])),
                "the two ends are compared with one neighbour only, but yaws form a circle",
            ),
            (flat_too, "a flat stretch, where nothing is in view, is no maximum"),
            (hills, "too few: only hills? here each maximum counts, however low"),
            (lambda g: 2 * truth(g), "twice too many: are valleys counted as well?"),
            (turns, "too many: are valleys counted as well?"),
            (lambda g: int((g > np.roll(g, 1)).sum()), "higher than the one before is half of it: and the next?"),
            (lambda g: int((g > np.roll(g, -1)).sum()), "higher than the next is half of it: and the one before?"),
            (lambda g: truth(-g), "those are the valleys"),
            (lambda g: int(np.argmax(g)), "that is the place of the largest; how many are there?"),
        ],
    )


class _Look:
    """The gain of a view of three wide splats, by yaw; remembers which yaws were asked for."""

    def __init__(self, position):
        zero = torch.zeros(3, dtype=torch.float64)
        places = torch.tensor([[2.0, 0.3], [2.5, -0.8], [1.8, 1.2]], dtype=torch.float64)
        colors = torch.tensor([[0.9, 0.2, 0.1], [0.1, 0.6, 0.9], [0.4, 0.8, 0.2]], dtype=torch.float64)
        axes = torch.stack([zero + 1, zero], 1)
        self._map = SplatMap(places, (zero - 1)[:, None].expand(3, 2), axes, zero, colors)
        self._options = Camera.from_fov(16), position
        self._prior = torch.zeros(3, 9, dtype=torch.float64)
        self._asked: list[float] = []

    def both(self, yaw) -> tuple[float, float]:
        return information.gain_and_slope(self._map, *self._options, yaw, self._prior)

    def __call__(self, yaw) -> float:
        self._asked.append(float(yaw))
        return self.both(yaw)[0]

    def span(self) -> float:
        """How far apart the yaws were that were asked for [rad]."""
        return max(self._asked) - min(self._asked) if self._asked else math.nan


def slope(mine: Callable) -> bool:
    """mine(gain_at, yaw [rad]) → derivative of the gain [1/rad], from values alone."""
    cases = [(_Look([0.0, 0.0]), 0.3), (_Look([0.5, -1.0]), 0.9), (_Look([0.0, 1.0]), -0.2)]

    def times(factor: float) -> Callable:
        return lambda look, yaw: factor * look.both(yaw)[1]

    def gap(case, answer, wanted):
        span = case[0].span()
        if span > 0.02:
            return f"the places are too far apart: the landscape bends within {span:.2g} rad,"
        if span < 1e-9:
            return "so small a step is lost in rounding,"
        if np.isclose(answer, wanted * span, rtol=0.05):
            return "that is a difference: over which angle?"
        return "too steep" if abs(answer) > abs(wanted) else "not steep enough"

    return compare(
        mine,
        times(1.0),
        cases,
        [
            (times(-1.0), "the wrong sign: it points downhill"),
            (times(2.0), "twice too much: how far apart are the two places?"),
            (times(0.5), "half of it: how far apart are the two places?"),
            (times(math.pi / 180), "that is per degree, and radians are wanted"),
            (lambda look, yaw: look(yaw), "that is the gain, not how it changes"),
        ],
        rtol=0.02,
        gap=gap,
    )


class _Hills:
    """A made-up gain of each yaw, hills and a ripple on top; remembers what was asked, and what it answered."""

    def __init__(self, seed: int):
        rng = np.random.default_rng(seed)
        self._centers, self._heights = rng.uniform(-math.pi, math.pi, 4), rng.uniform(0.3, 1.0, 4)
        self._ripple = rng.uniform(0, 6)
        self.told: dict[float, float] = {}
        self.calls = 0

    def at(self, yaw):
        hills = np.exp(8 * (np.cos(np.asarray(yaw)[..., None] - self._centers) - 1)) @ self._heights
        return hills * (1 + 0.03 * np.sin(160 * np.asarray(yaw) + self._ripple))

    def __call__(self, yaw) -> float:
        if np.ndim(yaw):
            raise Fault("`gain_at` looks one way at a time: give it one yaw")
        self.calls += 1
        return self.told.setdefault(float(yaw), float(self.at(float(yaw))))


def search(mine: Callable, budget: int = 40, share: float = 0.95) -> bool:
    """mine(gain_at, budget) → a yaw [rad] of large gain, found in at most `budget` calls of gain_at.

    Judged on a dozen landscapes: at least `share` of the largest gain on each of them.
    """
    yaws, shares, away = information.uniform_yaws(3600), [], []
    for seed in range(12):
        landscape = _Hills(seed)
        try:
            found = _yaw(ask(mine, landscape, budget), landscape, budget)
        except Fault as fault:
            return say(str(fault))
        gains = landscape.at(yaws)
        shares.append(float(landscape.at(found) / gains.max()))
        away.append(abs(geometry.wrap(found - yaws[gains.argmax()])))
    stuck = [distance for distance, part in zip(away, shares, strict=True) if part < share]
    if stuck and max(stuck) > 0.4:
        lost = sum(distance > 0.4 for distance in stuck)
        return say(f"not the highest hill on {lost} of {len(shares)} landscapes: on which hill does it start?")
    if stuck:
        text = (
            f"the right hill, but less than {100 * share:.0f} % of its top on {len(stuck)} of {len(shares)} landscapes"
        )
        return say(f"{text}: keep some views for a closer look")
    least = math.floor(100 * min(shares))
    return say(f"within the budget, and at least {least} % of the best on {len(shares)} landscapes", True)


def _yaw(found, landscape: _Hills, budget: int) -> float:
    """The yaw that a search returned. Raises Fault where it is none, or cost too much."""
    try:
        yaw = float(found)
    except (TypeError, ValueError, RuntimeError):
        raise Fault(f"one yaw is wanted, a number [rad], got {type(found).__name__}") from None
    if not math.isfinite(yaw):
        raise Fault("that is no yaw: not finite")
    if landscape.calls > budget:
        raise Fault(f"{landscape.calls} views, but only {budget} are allowed")
    if yaw not in landscape.told and yaw in landscape.told.values():
        raise Fault("that is a gain; the yaw that has it is wanted")
    if yaw not in landscape.told and isinstance(found, int | np.integer):
        raise Fault(f"{found}: is that an index? The yaw itself is wanted, in radians")
    if abs(yaw) > 4 * math.pi:
        raise Fault(f"a yaw of {yaw:.0f}: is that in degrees, or an index?")
    return yaw
