"""Exercises of notebook 06: the weighted gain, maxima on a circle, a slope, a search with few views."""

import math
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import torch
from scipy.signal import find_peaks

from mannbv import geometry, information
from mannbv.camera import Camera
from mannbv.course.check.verdict import AGREES, Fault, ask, exercise, judged, plain
from mannbv.splats import SplatMap


def _information(seed: int) -> tuple:
    rng = np.random.default_rng(seed)
    numbers = [torch.from_numpy(rng.uniform(0.1, 2.0, shape)) for shape in ((6, 9), (6, 9), 6, 9)]
    acquired, prior, weights, damping = numbers
    return acquired, prior, weights, torch.arange(6) % 3 > 0, damping


@exercise(cases=[_information(seed) for seed in range(3)])
def gain(h, H, v, zone, d):
    """my_gain(acquired, prior, weights, selected, damping) → Eq. (15)."""
    w = v[:, None]
    each = w * h / (H + d)
    return {
        AGREES: information.gain(h, H, weights=v, selected=zone, damping=d),
        "the weights do nothing: left out, or put on the prior too, where they cancel": (h / (H + d))[zone].sum(),
        "splats outside the zone count too": each.sum(),
        "the zone is turned inside out": each[~zone].sum(),
        "the weight divides too: what is known already keeps its full size": (w * h / (w * H + d))[zone].sum(),
        "no λ: a splat never seen would divide by 0": (w * h / H)[zone].sum(),
        "the weight counts twice": (w * each)[zone].sum(),
        "a mean: the trace is a sum": each[zone].mean(),
        "the weight belongs to what the view tells, not to what is known": (h / (w * H + d))[zone].sum(),
        "Eq. (15) does not divide by the sum of the weights": each[zone].sum() / v[zone].sum(),
    }


_CURVES = [3, 1, 2, 0, 1, 0], [0, 1, 0, 4, 2, 5], [2, 1, 4, 3, 6, 5, 7, 0], [5, 1, 2, 0, 3, 4]
_CURVES += [2, 1, 0, 0, 0, 3, 1], [50, 49, 51, 30, 20, 60, 10, 0]  # nothing in view; ripple on a hill


@exercise(cases=[(np.array(curve, float),) for curve in _CURVES])
def maxima(gains):
    """my_maxima(gains (M,) on uniform yaws of the circle) → number of local maxima, higher than both neighbours."""
    before, after, low = np.roll(gains, 1), np.roll(gains, -1), int(gains.argmin())
    peaks, inside = (gains > before) & (gains > after), slice(1, -1)
    ends = int(gains[0] > gains[1]) + int(gains[-1] > gains[-2])
    return {
        AGREES: peaks.sum(),
        "yaws form a circle: the first and the last are neighbours": peaks[inside].sum(),
        "the two ends are compared with one neighbour only, but yaws form a circle": peaks[inside].sum() + ends,
        "a flat stretch, where nothing is in view, is no maximum": ((gains >= before) & (gains >= after)).sum(),
        "too few: only hills? here each maximum counts, however low":
            len(find_peaks(np.roll(gains, -low), prominence=0.05 * gains.max())[0]),
        "twice too many: are valleys counted as well?": 2 * peaks.sum(),
        "too many: are valleys counted as well?": (np.sign(gains - before) != np.sign(after - gains)).sum(),
        "higher than the one before is half of it: and the next?": (gains > before).sum(),
        "higher than the next is half of it: and the one before?": (gains > after).sum(),
        "those are the valleys": ((gains < before) & (gains < after)).sum(),
        "that is the place of the largest; how many are there?": np.argmax(gains),
    }  # fmt: skip


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


def _steepness(case, answer, wanted):
    span = case[0].span()
    if span > 0.02:
        return f"the places are too far apart: the landscape bends within {span:.2g} rad,"
    if span < 1e-9:
        return "so small a step is lost in rounding,"
    if np.isclose(answer, wanted * span, rtol=0.05):
        return "that is a difference: over which angle?"
    return "too steep" if abs(answer) > abs(wanted) else "not steep enough"


@exercise(
    cases=[(_Look([0.0, 0.0]), 0.3), (_Look([0.5, -1.0]), 0.9), (_Look([0.0, 1.0]), -0.2)],
    rtol=0.02,
    gap=_steepness,
)
def slope(look, yaw):
    """my_slope(gain_at, yaw [rad]) → derivative of the gain [1/rad], from values alone."""
    gain, slope = look.both(yaw)
    return {
        AGREES: slope,
        "the wrong sign: it points downhill": -slope,
        "twice too much: how far apart are the two places?": 2 * slope,
        "half of it: how far apart are the two places?": slope / 2,
        "that is per degree, and radians are wanted": math.radians(slope),
        "that is the gain, not how it changes": gain,
    }


class _Hills:
    """A made-up gain of each yaw, hills and a ripple on top; remembers what was asked, and what it answered."""

    def __init__(self, seed: int):
        rng = np.random.default_rng(seed)
        self._centers, self._heights = rng.uniform(-math.pi, math.pi, 4), rng.uniform(0.3, 1.0, 4)
        self._ripple = rng.uniform(0, 6)
        self.answers: dict[float, float] = {}
        self.calls = 0

    def at(self, yaw):
        hills = np.exp(8 * (np.cos(np.asarray(yaw)[..., None] - self._centers) - 1)) @ self._heights
        return hills * (1 + 0.03 * np.sin(160 * np.asarray(yaw) + self._ripple))

    def __call__(self, yaw) -> float:
        if np.ndim(yaw):
            raise Fault("`gain_at` looks one way at a time: give it one yaw")
        self.calls += 1
        return self.answers.setdefault(float(yaw), float(self.at(float(yaw))))


def _best_of(gain_at: Callable, low: float, high: float, views: int) -> float:
    return max(np.linspace(low, high, views), key=gain_at)


def _two_looks(gain_at: Callable, budget: int) -> float:
    """Around the circle with half of the views, then around the best with the others."""
    near = _best_of(gain_at, -math.pi, math.pi, budget // 2)
    return _best_of(gain_at, near - 0.2, near + 0.2, budget - budget // 2)


def _climb(gain_at: Callable, budget: int) -> float:
    """One start, then uphill."""
    yaw, step = 0.0, 0.2
    for _ in range(budget // 3):
        best = max(yaw, yaw - step, yaw + step, key=gain_at)
        yaw, step = best, step / 2 if best == yaw else step
    return yaw


@judged(
    truth=_two_looks,
    mistakes=[
        (lambda gain_at, budget: [0.0, 1.0], "one yaw is wanted, a number [rad], got {kind}",
         lambda seen: seen.shape != ()),
        (lambda gain_at, budget: math.nan, "that is no yaw: not finite", lambda seen: not math.isfinite(seen.yaw)),
        (lambda gain_at, budget: _best_of(gain_at, -3.1, 3.1, 360), "{calls} views, but only {budget} are allowed",
         lambda seen: seen.calls > seen.budget),
        (lambda gain_at, budget: gain_at(_two_looks(gain_at, budget - 1)),
         "that is a gain; the yaw that has it is wanted", lambda seen: seen.new and seen.yaw in seen.answers.values()),
        (lambda gain_at, budget: int(np.argmax([gain_at(yaw) for yaw in np.linspace(0, 6, budget)])),
         "{yaw:.0f}: is that an index? The yaw itself is wanted, in radians",
         lambda seen: seen.new and seen.kind.startswith("int")),
        (lambda gain_at, budget: 20 + np.degrees(_best_of(gain_at, 0.0, 3.0, 9)),
         "a yaw of {yaw:.3g}: is that in degrees, or an index?", lambda seen: abs(seen.yaw) > 4 * math.pi),
        (_climb, "not the highest hill on {lost} of {n} landscapes: on which hill does it start?",
         lambda seen: seen.lost),
        (lambda gain_at, budget: _best_of(gain_at, -math.pi, math.pi, budget),
         "the right hill, but less than 95 % of its top on {stuck} of {n} landscapes: keep some views for a closer "
         "look", lambda seen: seen.stuck),
        (lambda gain_at, budget: gain_at(np.zeros(budget)), "`gain_at` looks one way at a time: give it one yaw"),
    ],
    praise="within the budget, and at least {least} % of the best on {n} landscapes",
)  # fmt: skip
def search(mine: Callable) -> SimpleNamespace:
    """my_search(gain_at, budget) → a yaw [rad] of large gain, found in at most `budget` calls of gain_at.

    Judged on a dozen landscapes: at least 95 % of the largest gain on each of them.
    """
    seen, yaws, shares, away = SimpleNamespace(budget=40, n=12), information.uniform_yaws(3600), [], []
    for seed in range(seen.n):
        hills = _Hills(seed)
        found = ask(mine, hills, seen.budget)
        seen.kind, seen.shape, seen.calls, seen.answers = (
            type(found).__name__,
            plain(found).shape,
            hills.calls,
            hills.answers,
        )
        seen.yaw = math.nan if seen.shape else float(found)
        seen.new = seen.yaw not in seen.answers
        if not abs(seen.yaw) <= 4 * math.pi or seen.calls > seen.budget:
            return seen
        gains = hills.at(yaws)
        shares.append(float(hills.at(seen.yaw) / gains.max()))
        away.append(abs(geometry.wrap(seen.yaw - yaws[gains.argmax()])))
    stuck = [distance for distance, share in zip(away, shares, strict=True) if share < 0.95]
    seen.stuck, seen.lost = len(stuck), sum(distance > 0.4 for distance in stuck)
    seen.least = math.floor(100 * min(shares))
    return seen
