"""Exercises of notebook 04: risk, Eqs. (6)-(9)."""

import math
from collections.abc import Callable

import numpy as np
import torch
from scipy.stats import norm

from mannbv import risk
from mannbv.course.check.verdict import Fault, ask, compare, say

_GAPS = [(0.3, 0.1), (1.0, 0.4), (0.05, 0.2)]
_NEEDS = [(0.1, 0.1, 0.3), (0.4, 0.05, 0.2), (0.2, 0.5, -0.1)]
_MEANS = np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 1.5], [3.0, 2.0]])
_STDS = np.array([0.02, 0.6, 0.1, 0.3])
_POINTS = np.array([[0.8, 0.1], [0.1, 0.2], [1.0, 1.2], [0.5, 1.0], [2.8, 1.2], [1.9, 0.5], [2.5, 2.9], [1.2, 0.6]])
_TURNED = np.array([[0.17, 0.11], [0.11, 0.10]])
_SIGHTS = [
    (np.diag([0.25, 0.01]), np.array([0.5, 0.25]), np.array([0.5, 1.75])),
    (np.diag([0.25, 0.01]), np.array([0.5, 0.25]), np.array([2.5, 0.25])),
    (_TURNED, np.array([1.0, -1.0]), np.array([2.0, 0.5])),
    (np.diag([0.04, 0.09, 0.01]), np.ones(3), np.array([2.0, 3.0, 0.5])),
]


def contact(mine: Callable) -> bool:
    """my_contact(mean, std): the probability that a Gaussian distance is not above zero."""
    return compare(
        mine,
        lambda mean, std: norm.cdf(0.0, mean, std),
        _GAPS,
        [
            (lambda mean, std: norm.sf(0.0, mean, std), "that is the probability of staying clear: the wrong tail"),
            (lambda mean, std: norm.cdf(0.0, mean, std**2), "a standard deviation [m] is wanted, not a variance [m²]"),
            (lambda mean, std: norm.cdf(0.0, mean, math.sqrt(std)), "σ is a standard deviation [m] already: no root"),
            (lambda mean, std: norm.cdf(0.0, std, mean), "mean and σ are swapped"),
            (lambda mean, std: 2 * norm.cdf(0.0, mean, std), "both tails: contact lies on one side only"),
            (lambda mean, std: 100 * norm.cdf(0.0, mean, std), "a probability is at most 1: no per cent"),
            (lambda mean, std: norm.pdf(0.0, mean, std), "that is a density [1/m], not a probability"),
        ],
    )


def gap(mine: Callable) -> bool:
    """my_gap(std, level, alpha): the mean distance at which a splat leaves the risk α."""

    def truth(std, level, alpha):
        return alpha - risk.average_value_at_risk(0.0, std, level)

    return compare(
        mine,
        truth,
        _NEEDS,
        [
            (lambda std, level, alpha: 2 * alpha - truth(std, level, alpha), "a vaguer splat needs more room: a sign"),
            (lambda std, level, alpha: truth(std, level, alpha) - alpha, "that leaves a risk of 0 m: where is α?"),
            (
                lambda std, level, alpha: alpha - risk.value_at_risk(0.0, std, level),
                "that is the border of the tail, V@R, where the mean of the tail is wanted",
            ),
            (
                lambda std, level, alpha: truth(std, 1 - level, alpha),
                "ε is the share of the bad cases, not of the good",
            ),
            (
                lambda std, level, alpha: truth(std**2, level, alpha),
                "σ is a standard deviation [m], not a variance [m²]",
            ),
        ],
    )


def culprit(mine: Callable) -> bool:
    """my_culprit(means, stds, points, level): the index of the splat that sets α at each point, Eq. (9)."""

    def risks(means, stds, points, level):
        distance = np.linalg.norm(points[:, None] - means, axis=-1)
        return distance, risk.average_value_at_risk(distance, stds, level)

    def by_border(means, stds, points, level):
        return risk.value_at_risk(risks(means, stds, points, level)[0], stds, level).argmin(1)

    def by_best_cases(means, stds, points, level):
        distance, alpha = risks(means, stds, points, level)
        return (2 * distance - alpha).argmin(1)

    def by_spreads(means, stds, points, level):
        return (risks(means, stds, points, level)[0] / stds).argmin(1)

    def gap(case, answer, wanted):
        if not np.isin(answer, np.arange(len(case[0]))).all():
            return "not the index of a splat, somewhere"
        k = int(np.flatnonzero(answer != wanted)[0])
        x, y = case[2][k]
        return f"another splat at the point ({x:g}, {y:g})"

    return compare(
        mine,
        lambda *case: risks(*case)[1].argmin(1),
        [(_MEANS, _STDS, _POINTS, 0.1), (_MEANS, _STDS, _POINTS, 0.4)],
        [
            (by_border, "that goes by the border of the tail, V@R, where the mean of the tail is wanted"),
            (by_best_cases, "that goes by the mean of the best cases: the wrong tail"),
            (by_spreads, "that counts the distance in σ; the risk is a length [m]"),
            (lambda *case: risks(*case)[0].argmin(1), "that is the nearest mean; a far, vague splat may threaten more"),
            (lambda *case: risks(*case)[1].argmax(1), "that is the most harmless splat: largest α instead of smallest"),
            (lambda *case: risks(*case)[1].argmin(0), "one answer a point, not one a splat: the other axis"),
            (lambda *case: risks(*case)[1].min(1), "that is the risk itself [m]; which splat has it?"),
            (
                lambda means, stds, points, level: np.full(len(points), stds.argmax()),
                "that is the vaguest splat, wherever the point lies",
            ),
        ],
        gap=gap,
    )


def along(mine: Callable) -> bool:
    """my_along(covariance, mean, point): the standard deviation of a splat along the line of sight [m]."""

    def variance(covariance, mean, point, power=2):
        away = point - mean
        return away @ covariance @ away / np.linalg.norm(away) ** power

    origin = "that line starts at the origin; it should join the mean and the point"
    return compare(
        mine,
        lambda *case: math.sqrt(variance(*case)),
        _SIGHTS,
        [
            (variance, "that is a variance [m²]; a length [m] is wanted"),
            (
                lambda *case: math.sqrt(variance(*case, power=0)),
                "it grows with the distance: make the direction a unit one",
            ),
            (lambda covariance, mean, point: math.sqrt(variance(covariance, 0 * mean, mean)), origin),
            (lambda covariance, mean, point: math.sqrt(variance(covariance, 0 * point, point)), origin),
            (
                lambda covariance, mean, point: math.sqrt(np.linalg.eigvalsh(covariance)[-1]),
                "that is the largest σ, from whatever side one looks",
            ),
            (
                lambda covariance, mean, point: variance(np.linalg.inv(covariance), mean, point) ** -0.5,
                "that is how far the ellipse reaches in this direction, not the spread of the coordinate along it",
            ),
        ],
    )


def measure(mine: Callable) -> bool:
    """my_measure(mean, std, level): any risk measure that keeps a planner's common sense; says which rule it breaks."""
    try:
        sure, here, ahead, vague, rare, above, above_vague = (
            float(ask(mine, *case))
            for case in [
                (1.0, 0.0, 0.1), (1.0, 0.2, 0.1), (1.5, 0.2, 0.1), (1.0, 0.3, 0.1), (1.0, 0.2, 0.01),
                (1.0, 0.2, 0.9), (1.0, 0.3, 0.9),
            ]
        )  # fmt: skip
    except Fault as fault:
        return say(str(fault))
    except (TypeError, ValueError, RuntimeError):
        return say("one number is wanted: a risk [m]")
    for kept, hint in [
        (math.isclose(sure, 1.0), "a distance known for certain (σ = 0) is its own risk"),
        (math.isclose(ahead - here, 0.5), "half a metre more of distance is half a metre more of safety"),
        (here < 1.0, "a bad case is nearer than the mean: the wrong tail"),
        (vague < here, "a vaguer splat must not look safer"),
        (rare < here, "a smaller level must be more careful"),
        (above_vague < above <= 1.0, "for ε above 0.5, too, a vaguer splat must not look safer"),
    ]:
        if not kept:
            return say(hint)
    many = "" if _takes_tensors(mine) else "; but it takes numbers only: to steer a team, write it for tensors"
    return say(f"a risk measure: farther is safer, surer is safer, rarer is worse{many}", True)


def _takes_tensors(mine: Callable) -> bool:
    """Whether a measure serves `risk.field`, which asks for many splats at once."""
    means, stds = torch.tensor([[1.0, 0.5], [0.2, 0.3]], dtype=torch.float64)
    try:
        many = mine(means, stds, 0.1)
        return many.shape == means.shape and math.isclose(float(many[1]), float(mine(0.5, 0.3, 0.1)))
    except Exception:
        return False
