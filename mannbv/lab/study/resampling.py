"""Intervals by resampling whole units, for numbers that have no formula and for samples that are not independent."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Shaped
from numpy.typing import ArrayLike


class Estimate(NamedTuple):
    """What a sample says, and the ends of its interval; all of one shape. nan where there is no number, or no interval
    because all of the sample is one unit."""

    value: np.ndarray
    low: np.ndarray
    high: np.ndarray


def bootstrap(
    statistic: Callable[[np.ndarray], ArrayLike],
    units: Shaped[np.ndarray, " k"],
    rng: np.random.Generator,
    draws: int = 1000,
    confidence: float = 0.95,
) -> Estimate:
    """`statistic` of the whole sample, with the percentile interval over `draws` resamplings of its units.

    statistic(weights (k,)) → an array of any shape, where weights say how often each of the k observations counts, 1 at
    first. units: what each observation belongs to; a unit is drawn with all of its observations, for these depend on
    each other. Few units make the interval too short: see how many there are. Resamples without a number are left out.
    """
    names, unit = np.unique(units, return_inverse=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        value = np.asarray(statistic(np.ones(len(units))), float)
        none = np.full_like(value, np.nan)
        if len(names) < 2:
            return Estimate(value, none, none)
        picks = rng.integers(len(names), size=(draws, len(names)))
        again = np.array([statistic(np.bincount(pick, minlength=len(names))[unit].astype(float)) for pick in picks])
    ends = np.array([(1 - confidence) / 2, (1 + confidence) / 2])
    known = np.isfinite(again)
    # like nanquantile, which warns where there is no number at all
    low, high = np.nanquantile(np.where(known.any(0), again, 0.0), ends, axis=0)
    empty = ~known.any(0) | ~np.isfinite(value)
    return Estimate(value, np.where(empty, np.nan, low), np.where(empty, np.nan, high))


def weighted_mean(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Mean over the last axis of values (…, k), weights (…, k)."""
    return np.asarray((values * weights).sum(-1) / weights.sum(-1))


def ranks(values: Shaped[np.ndarray, " k"]) -> Callable[[np.ndarray], np.ndarray]:
    """How many observations of a weighted sample (k,) lie below each, and half of those equal to it: a function of the
    weights, so that a sample is sorted once for all of its resamples."""
    order, place = np.unique(values, return_inverse=True)

    def of(weights: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        counts = np.bincount(place, weights, minlength=len(order))
        return (np.cumsum(counts) - counts / 2)[place]

    return of


def pearson(a: np.ndarray, b: np.ndarray, weights: np.ndarray) -> float:
    """Linear correlation of a weighted sample; nan where one of the two does not vary."""
    a, b = a - weighted_mean(a, weights), b - weighted_mean(b, weights)
    together, own = weighted_mean(a * b, weights), weighted_mean(a * a, weights) * weighted_mean(b * b, weights)
    return float(together / np.sqrt(own)) if own > 0 else np.nan
