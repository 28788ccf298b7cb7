"""Checkers of notebook 06: the weighted gain, maxima on a circle, a slope, a search with few views."""

import math
from collections.abc import Callable

import numpy as np
import torch

from mannbv import geometry, information
from mannbv.camera import Camera
from mannbv.check.verdict import compare
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
        ],
    )


def maxima(mine: Callable) -> bool:
    """mine(gains (M,) on uniform yaws of the whole circle) → number of local maxima."""

    def inner(gains) -> int:
        return int(((gains[1:-1] > gains[:-2]) & (gains[1:-1] > gains[2:])).sum())

    def truth(gains) -> int:
        return int(((gains > np.roll(gains, 1)) & (gains > np.roll(gains, -1))).sum())

    cases = [[3, 1, 2, 0, 1, 0], [0, 1, 0, 4, 2, 5], [2, 1, 4, 3, 6, 5, 7, 0], [5, 1, 2, 0, 3, 4]]
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
            (lambda g: 2 * truth(g), "twice too many: are valleys counted as well?"),
            (lambda g: int(np.argmax(g)), "that is the place of the largest; how many are there?"),
        ],
    )


class _Look:
    """The gain of a view of three wide splats, by yaw."""

    def __init__(self, position):
        zero = torch.zeros(3, dtype=torch.float64)
        places = torch.tensor([[2.0, 0.3], [2.5, -0.8], [1.8, 1.2]], dtype=torch.float64)
        colors = torch.tensor([[0.9, 0.2, 0.1], [0.1, 0.6, 0.9], [0.4, 0.8, 0.2]], dtype=torch.float64)
        axes = torch.stack([zero + 1, zero], 1)
        self._map = SplatMap(places, (zero - 1)[:, None].expand(3, 2), axes, zero, colors)
        self._options = Camera.from_fov(16), position
        self._prior = torch.zeros(3, 9, dtype=torch.float64)

    def both(self, yaw) -> tuple[float, float]:
        return information.gain_and_slope(self._map, *self._options, yaw, self._prior)

    def __call__(self, yaw) -> float:
        return self.both(yaw)[0]


def slope(mine: Callable) -> bool:
    """mine(gain_at, yaw [rad]) → derivative of the gain [1/rad], from values alone."""
    cases = [(_Look([0.0, 0.0]), 0.3), (_Look([0.5, -1.0]), 0.9), (_Look([0.0, 1.0]), -0.2)]

    def times(factor: float) -> Callable:
        return lambda look, yaw: factor * look.both(yaw)[1]

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
    )


def search(mine: Callable, budget: int = 40) -> bool:
    """mine(gain_at, budget) → a yaw [rad] of large gain, found in at most `budget` calls of gain_at."""
    shares = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        centers, heights, ripple = rng.uniform(-math.pi, math.pi, 4), rng.uniform(0.3, 1.0, 4), rng.uniform(0, 6)
        asked: list[float] = []

        def landscape(yaw, centers=centers, heights=heights, ripple=ripple):
            hills = np.exp(8 * (np.cos(np.asarray(yaw)[..., None] - centers) - 1)) @ heights
            return hills * (1 + 0.03 * np.sin(160 * np.asarray(yaw) + ripple))

        def gain_at(yaw, landscape=landscape, asked=asked):
            asked.append(float(yaw))
            return float(landscape(yaw))

        try:
            found = mine(gain_at, budget)
            found = found if found is None or found is ... else float(found)
        except Exception as error:
            return _say(f"it stops with {type(error).__name__}: {error}".splitlines()[0])
        if found is None or found is ...:
            return _say("to do")
        if not math.isfinite(found):
            return _say("that is no yaw: not finite")
        if len(asked) > budget:
            return _say(f"{len(asked)} views, but only {budget} are allowed")
        if abs(found) > 4 * math.pi:
            return _say(f"a yaw of {found:.0f}: is that in degrees?")
        shares.append(float(landscape(geometry.wrap(found)) / landscape(information.uniform_yaws(3600)).max()))
    if min(shares) < 0.9:
        stuck = sum(share < 0.9 for share in shares)
        return _say(f"on {stuck} of {len(shares)} landscapes less than 90 % of the best: on which hill does it start?")
    print(f"within the budget, and at least {math.floor(100 * min(shares))} % of the best on {len(shares)} landscapes")
    return True


def _say(text: str) -> bool:
    print(text)
    return False
