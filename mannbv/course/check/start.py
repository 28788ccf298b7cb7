"""Exercises of notebook 00: AV@R, Eq. (8), the mask's radius, Eq. (10), and the gain, Eq. (5)."""

import math
from collections.abc import Callable

import numpy as np
import torch
from scipy.special import erfinv

from mannbv import information, mask, risk
from mannbv.config import Config
from mannbv.course.check.verdict import compare

_TAILS = [(1.0, 0.2, 0.1), (2.0, 0.3, 0.01), (0.4, 0.5, 0.5), (1.5, 0.05, 0.3)]


def avar(mine: Callable) -> bool:
    """my_avar(mean, std, level): the mean of the worst cases of a Gaussian distance [m], Eq. (8)."""

    def truth(mean, std, level):
        return risk.average_value_at_risk(mean, std, level)

    def other(exponent: Callable, divisor: Callable):
        """Eq. (8) with another exponent, of ι and ε, or with another divisor, of ε."""
        return lambda mean, std, level: mean - std * math.exp(-exponent(erfinv(2 * level - 1), level)) / divisor(level)

    def root(level):
        return level * math.sqrt(2 * math.pi)

    def square(iota, level):
        return iota**2

    mistakes = [
        (lambda mean, std, level: 2 * mean - truth(mean, std, level), "the mean of the best cases: the wrong tail"),
        (risk.value_at_risk, "that is the border of the tail, V@R; AV@R is the mean beyond it"),
        (lambda mean, std, level: truth(mean, std, 1 - level), "ε is the share of the bad cases, not of the good"),
        (lambda mean, std, level: truth(mean, std**2, level), "σ is a standard deviation [m], not a variance [m²]"),
        (
            lambda mean, std, level: mean - truth(mean, std, level),
            "that is how far below the mean; how far is contact?",
        ),
        (other(square, lambda level: root(1.0)), "the mean of a tail: by which share must it be divided?"),
        (other(square, lambda level: level * 2 * math.pi), "look at the root in Eq. (8)"),
        (other(square, lambda level: level * math.sqrt(math.pi)), "look at the root in Eq. (8)"),
        (other(lambda iota, level: -(iota**2), root), "the exponent's sign: rare cases lie on a thin tail"),
        (other(lambda iota, level: iota, root), "the exponent: how does ι stand in it?"),
        (other(lambda iota, level: iota**2 / 2, root), "the exponent: ι is no normal quantile, its √2 is in erf"),
        (other(lambda iota, level: erfinv(level) ** 2, root), "ι: of which number is erf⁻¹ taken?"),
    ]
    return compare(mine, truth, _TAILS, mistakes)


def radius(mine: Callable) -> bool:
    """my_radius(alpha): the radius of the mask [m] at a waypoint of risk α [m], Eq. (10), by the default constants."""
    least, one, two = Config().r_min, Config().beta1, Config().beta2
    mistakes = [
        (
            lambda alpha: least + one * math.exp(two * alpha),
            "a safer waypoint, of larger α, gets the smaller ball: a sign",
        ),
        (lambda alpha: one * math.exp(-two * alpha), "even the safest waypoint keeps a ball of r_min"),
        (
            lambda alpha: least + two * math.exp(-one * alpha),
            "β₁ is a length, β₂ is one over a length: which stands where?",
        ),
        (lambda alpha: least + one * math.exp(-alpha), "where is β₂?"),
        (lambda alpha: least + one * math.exp(-alpha / two), "β₂ is one over a length already"),
        (lambda alpha: (least + one) * math.exp(-two * alpha), "not all of the radius shrinks as the risk falls"),
        (lambda alpha: least + one * (1 - math.exp(-two * alpha)), "a safer waypoint gets the smaller ball"),
        (
            lambda alpha: least + (np.mean(np.asarray(mine(0.0), float)) - least) * math.exp(-two * alpha),
            "right, but for another β₁: the one of `config` is wanted",
        ),
    ]
    return compare(mine, mask.radius, [(-0.1,), (0.0,), (0.2,), (0.7,), (3.0,)], mistakes, rtol=1e-5)


def gain(mine: Callable) -> bool:
    """my_gain(told, prior, damping): Eq. (5) for diagonal matrices; told, prior (n, 9), damping (9,), a number out."""

    def case(seed: int) -> tuple:
        rng = np.random.default_rng(seed)
        return tuple(torch.from_numpy(rng.uniform(0.1, 2.0, shape)) for shape in ((6, 9), (6, 9), 9))

    mistakes = [
        (lambda h, H, d: ((H + d) / h).sum(), "who knows more already gains less: what divides what?"),
        (lambda h, H, d: (h * (H + d)).sum(), "who knows more already gains less"),
        (lambda h, H, d: (h / H).sum(), "no λ: a splat never seen would divide by 0"),
        (
            lambda h, H, d: ((h + d) / (H + d)).sum(),
            "a view that shows nothing must gain nothing: λ belongs to the prior",
        ),
        (lambda h, H, d: (h / H + d).sum(), "a view that shows nothing must gain nothing: where does λ belong?"),
        (lambda h, H, d: (h / (h + H + d)).sum(), "compared with what was known before this view, not after it"),
        (lambda h, H, d: h.sum() / (H + d).sum(), "a sum of ratios, not a ratio of sums"),
        (lambda h, H, d: (h / (H + d)).mean(), "a trace is a sum, not a mean"),
        (lambda h, H, d: (h / (H + d)).sum(0), "one number for the whole view: that is one for each parameter"),
        (lambda h, H, d: (h / (H + d)).sum(1), "one number for the whole view: that is one for each splat"),
        (lambda h, H, d: h / (H + d), "one number for the whole view: what does a trace do with a diagonal?"),
    ]
    return compare(mine, lambda h, H, d: information.gain(h, H, damping=d), [case(seed) for seed in range(3)], mistakes)
