"""Exercises of notebook 04: risk, Eqs. (6)-(9)."""

import math
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import torch
from scipy.stats import norm

from mannbv import risk
from mannbv.course.check.verdict import AGREES, ask, exercise, judged, number


@exercise(cases=[(0.3, 0.1), (1.0, 0.4), (0.05, 0.2)])
def contact(mean, std):
    """my_contact(mean, std): the probability that a Gaussian distance is not above zero."""
    return {
        AGREES: norm.cdf(0.0, mean, std),
        "that is the probability of staying clear: the wrong tail": norm.sf(0.0, mean, std),
        "a standard deviation [m] is wanted, not a variance [m²]": norm.cdf(0.0, mean, std**2),
        "σ is a standard deviation [m] already: no root": norm.cdf(0.0, mean, math.sqrt(std)),
        "mean and σ are swapped": norm.cdf(0.0, std, mean),
        "both tails: contact lies on one side only": 2 * norm.cdf(0.0, mean, std),
        "a probability is at most 1: no per cent": 100 * norm.cdf(0.0, mean, std),
        "that is a density [1/m], not a probability": norm.pdf(0.0, mean, std),
    }


def _below(std, level):
    return -risk.average_value_at_risk(0.0, std, level)


@exercise(cases=[(0.1, 0.1, 0.3), (0.4, 0.05, 0.2), (0.2, 0.5, -0.1)])
def gap(std, level, alpha):
    """my_gap(std, level, alpha): the mean distance at which a splat leaves the risk α."""
    return {
        AGREES: alpha + _below(std, level),
        "a vaguer splat needs more room: a sign": alpha - _below(std, level),
        "that leaves a risk of 0 m: where is α?": _below(std, level),
        "that is the border of the tail, V@R, where the mean of the tail is wanted":
            alpha - risk.value_at_risk(0.0, std, level),
        "ε is the share of the bad cases, not of the good": alpha + _below(std, 1 - level),
        "σ is a standard deviation [m], not a variance [m²]": alpha + _below(std**2, level),
    }  # fmt: skip


_MEANS = np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 1.5], [3.0, 2.0]])
_STDS = np.array([0.02, 0.6, 0.1, 0.3])
_POINTS = np.array([[0.8, 0.1], [0.1, 0.2], [1.0, 1.2], [0.5, 1.0], [2.8, 1.2], [1.9, 0.5], [2.5, 2.9], [1.2, 0.6]])


def _away(means, points):
    return np.linalg.norm(points[:, None] - means, axis=-1)


def _where(case, answer, wanted):
    if not np.isin(answer, np.arange(len(case[0]))).all():
        return "not the index of a splat, somewhere"
    x, y = case[2][np.flatnonzero(answer != wanted)[0]]
    return f"another splat at the point ({x:g}, {y:g})"


@exercise(cases=[(_MEANS, _STDS, _POINTS, 0.1), (_MEANS, _STDS, _POINTS, 0.4)], gap=_where)
def culprit(means, stds, points, level):
    """my_culprit(means, stds, points, level): the index of the splat that sets α at each point, Eq. (9)."""
    away = _away(means, points)
    alpha = risk.average_value_at_risk(away, stds, level)
    return {
        AGREES: risk.average_value_at_risk(_away(means, points), stds, level).argmin(1),
        "that goes by the border of the tail, V@R, where the mean of the tail is wanted":
            risk.value_at_risk(away, stds, level).argmin(1),
        "that goes by the mean of the best cases: the wrong tail": (2 * away - alpha).argmin(1),
        "that counts the distance in σ; the risk is a length [m]": (away / stds).argmin(1),
        "that is the nearest mean; a far, vague splat may threaten more": away.argmin(1),
        "that is the most harmless splat: largest α instead of smallest": alpha.argmax(1),
        "one answer a point, not one a splat: the other axis": alpha.argmin(0),
        "that is the risk itself [m]; which splat has it?": alpha.min(1),
        "that is the vaguest splat, wherever the point lies": np.full(len(points), stds.argmax()),
    }  # fmt: skip


def _variance(covariance, mean, point):
    sight = (point - mean) / np.linalg.norm(point - mean)
    return sight @ covariance @ sight


_TURNED = np.array([[0.17, 0.11], [0.11, 0.10]])


@exercise(
    cases=[
        (np.diag([0.25, 0.01]), np.array([0.5, 0.25]), np.array([0.5, 1.75])),
        (np.diag([0.25, 0.01]), np.array([0.5, 0.25]), np.array([2.5, 0.25])),
        (_TURNED, np.array([1.0, -1.0]), np.array([2.0, 0.5])),
        (np.diag([0.04, 0.09, 0.01]), np.ones(3), np.array([2.0, 3.0, 0.5])),
    ],
)
def along(covariance, mean, point):
    """my_along(covariance, mean, point): the standard deviation of a splat along the line of sight [m]."""
    return {
        AGREES: math.sqrt(_variance(covariance, mean, point)),
        "that is a variance [m²]; a length [m] is wanted": _variance(covariance, mean, point),
        "it grows with the distance: make the direction a unit one":
            math.sqrt((point - mean) @ covariance @ (point - mean)),
        "that line starts at the origin; it should join the mean and the point":
            [math.sqrt(_variance(covariance, 0 * end, end)) for end in (mean, point)],
        "that is the largest σ, from whatever side one looks": math.sqrt(np.linalg.eigvalsh(covariance)[-1]),
        "that is how far the ellipse reaches in this direction, not the spread of the coordinate along it":
            _variance(np.linalg.inv(covariance), mean, point) ** -0.5,
    }  # fmt: skip


def _chernoff(mean, std, level):
    """A Gaussian falls below this with probability at most ε."""
    return mean - std * math.sqrt(2 * math.log(1 / level))


def _takes_tensors(mine: Callable) -> bool:
    """Whether a measure serves `risk.field`, which asks for many splats at once."""
    means, stds = torch.tensor([[1.0, 0.5], [0.2, 0.3]], dtype=torch.float64)
    try:
        many = mine(means, stds, 0.1)
        return many.shape == means.shape and math.isclose(float(many[1]), float(mine(0.5, 0.3, 0.1)))
    except Exception:
        return False


@judged(
    truth=_chernoff,
    mistakes=[
        (lambda mean, std, level: mean - 0.1, "a distance known for certain (σ = 0) is its own risk",
         lambda risk: not math.isclose(risk.sure, 1.0)),
        (lambda mean, std, level: mean * (1 - std), "half a metre more of distance is half a metre more of safety",
         lambda risk: not math.isclose(risk.ahead - risk.here, 0.5)),
        (lambda *case: 2 * case[0] - _chernoff(*case), "a bad case is nearer than the mean: the wrong tail",
         lambda risk: not risk.here < 1.0),
        (lambda mean, std, level: mean - 0.2 * (std > 0), "a vaguer splat must not look safer",
         lambda risk: not risk.vague < risk.here),
        (lambda mean, std, level: _chernoff(mean, std, 1 - level), "a smaller level must be more careful",
         lambda risk: not risk.rare < risk.here),
        (risk.value_at_risk, "for ε above 0.5, too, a vaguer splat must not look safer",
         lambda risk: not risk.above_vague < risk.above <= 1.0),
        (lambda mean, std, level: np.array([mean, std]), "one number is wanted: a risk [m]"),
    ],
    praise="a risk measure: farther is safer, surer is safer, rarer is worse{many}",
)  # fmt: skip
def measure(mine: Callable) -> SimpleNamespace:
    """my_measure(mean, std, level): any risk measure that keeps a planner's common sense."""
    cases = {
        "sure": (1.0, 0.0, 0.1), "here": (1.0, 0.2, 0.1), "ahead": (1.5, 0.2, 0.1), "vague": (1.0, 0.3, 0.1),
        "rare": (1.0, 0.2, 0.01), "above": (1.0, 0.2, 0.9), "above_vague": (1.0, 0.3, 0.9),
    }  # fmt: skip
    seen = {name: number(ask(mine, *case), "a risk [m]") for name, case in cases.items()}
    many = "" if _takes_tensors(mine) else "; but it takes numbers only: to steer a team, write it for tensors"
    return SimpleNamespace(**seen, many=many)
