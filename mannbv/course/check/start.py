"""Exercises of notebook 00: AV@R, Eq. (8), the mask's radius, Eq. (10), and the gain, Eq. (5)."""

import math

import numpy as np
import torch
from scipy.special import erfinv

from mannbv import information, mask, risk
from mannbv.config import Config
from mannbv.course.check.verdict import AGREES, exercise


@exercise(cases=[(1.0, 0.2, 0.1), (2.0, 0.3, 0.01), (0.4, 0.5, 0.5), (1.5, 0.05, 0.3)])
def avar(mean, std, level):
    """my_avar(mean, std, level): the mean of the worst cases of a Gaussian distance [m], Eq. (8)."""
    truth, iota, root = risk.average_value_at_risk, erfinv(2 * level - 1), math.sqrt(2 * math.pi)
    below = std * math.exp(-(iota**2)) / (level * root)
    return {
        AGREES: truth(mean, std, level),
        "the mean of the best cases: the wrong tail": mean + below,
        "that is the border of the tail, V@R; AV@R is the mean beyond it": risk.value_at_risk(mean, std, level),
        "ε is the share of the bad cases, not of the good": truth(mean, std, 1 - level),
        "σ is a standard deviation [m], not a variance [m²]": truth(mean, std**2, level),
        "that is how far below the mean; how far is contact?": below,
        "the mean of a tail: by which share must it be divided?": mean - below * level,
        "look at the root in Eq. (8)": [mean - below / root, mean - below * math.sqrt(2)],
        "the exponent's sign: rare cases lie on a thin tail": mean - below * math.exp(2 * iota**2),
        "the exponent: how does ι stand in it?": mean - below * math.exp(iota**2 - iota),
        "the exponent: ι is no normal quantile, its √2 is in erf": mean - below * math.exp(iota**2 / 2),
        "ι: of which number is erf⁻¹ taken?": mean - below * math.exp(iota**2 - erfinv(level) ** 2),
    }


@exercise(cases=[(-0.1,), (0.0,), (0.2,), (0.7,), (3.0,)])
def radius(alpha):
    """my_radius(alpha): the radius of the mask [m] at a waypoint of risk α [m], Eq. (10), by the default constants."""
    r_min, beta1, beta2 = Config().r_min, Config().beta1, Config().beta2
    falls = math.exp(-beta2 * alpha)
    return {
        AGREES: mask.radius(alpha),
        "a safer waypoint, of larger α, gets the smaller ball: a sign": r_min + beta1 / falls,
        "even the safest waypoint keeps a ball of r_min": beta1 * falls,
        "β₁ is a length, β₂ is one over a length: which stands where?": r_min + beta2 * math.exp(-beta1 * alpha),
        "where is β₂?": r_min + beta1 * math.exp(-alpha),
        "β₂ is one over a length already": r_min + beta1 * math.exp(-alpha / beta2),
        "not all of the radius shrinks as the risk falls": (r_min + beta1) * falls,
        "a safer waypoint gets the smaller ball": r_min + beta1 * (1 - falls),
        "right, but for another β₁: the one of `config` is wanted": [
            r_min + other * falls for other in (0.2, 0.25, 0.5, 0.75, 0.8, 1.2, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0)
        ],
    }


def _view(seed: int) -> tuple:
    rng = np.random.default_rng(seed)
    return tuple(torch.from_numpy(rng.uniform(0.1, 2.0, shape)) for shape in ((6, 9), (6, 9), 9))


@exercise(cases=[_view(seed) for seed in range(3)])
def gain(h, H, d):
    """my_gain(acquired, prior, damping): Eq. (5) for diagonal matrices (n, 9), damping (9,), a number out."""
    return {
        AGREES: information.gain(h, H, damping=d),
        "who knows more already gains less: what divides what?": ((H + d) / h).sum(),
        "who knows more already gains less": (h * (H + d)).sum(),
        "no λ: a splat never seen would divide by 0": (h / H).sum(),
        "a view that shows nothing must gain nothing: λ belongs to the prior": ((h + d) / (H + d)).sum(),
        "a view that shows nothing must gain nothing: where does λ belong?": (h / H + d).sum(),
        "compared with what was known before this view, not after it": (h / (h + H + d)).sum(),
        "a sum of ratios, not a ratio of sums": h.sum() / (H + d).sum(),
        "a trace is a sum, not a mean": (h / (H + d)).mean(),
        "one number for the whole view: that is one for each parameter": (h / (H + d)).sum(0),
        "one number for the whole view: that is one for each splat": (h / (H + d)).sum(1),
        "one number for the whole view: what does a trace do with a diagonal?": h / (H + d),
    }
