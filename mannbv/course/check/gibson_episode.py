"""Exercises of notebook 15: promises that were not kept, paired teams, the order of strategies in two worlds."""

import itertools
import math

import numpy as np
from scipy import special, stats

from mannbv.course.check.verdict import AGREES, exercise

_rng = np.random.default_rng(5)


def _waypoints(k: int) -> tuple:
    alpha = _rng.uniform(-0.1, 0.9, k)
    return alpha, np.abs(alpha + _rng.normal(0.05, 0.2, k))


@exercise(cases=[_waypoints(40), _waypoints(7)])
def overconfident(a, c):
    """my_overconfident(alpha, clearance), both (k,) [m] → the share of waypoints with a clearance below their α."""
    return {
        AGREES: np.mean(c < a),
        "those are the promises that were kept: here less was clear than α said": np.mean(c > a),
        "that counts them; which share of all waypoints are they?": np.sum(c < a),
        "a share lies between 0 and 1; percents are a hundred times as many": 100 * np.mean(c < a),
        "that is by how much on average; the question is how often": np.mean(a - c),
        "a verdict for each waypoint: what share of them is true?": c < a,
    }


def _teams(n: int) -> tuple:
    theirs = _rng.normal(17, 2, n)
    return theirs + _rng.normal(0.4, 0.5, n), theirs


def _paired(a, b):
    return np.mean(a - b), special.stdtrit(len(a) - 1, 0.975) * np.std(a - b, ddof=1) / math.sqrt(len(a))


@exercise(cases=[_teams(12), _teams(4)])
def paired(a, b):
    """my_paired(ours, theirs) → mean difference of paired teams (k,), and half of its 95 % interval by Student's t."""
    mean, half = _paired(a, b)
    n, root, std = len(a), math.sqrt(len(a)), np.std(a - b, ddof=1)
    return {
        AGREES: _paired(a, b),
        "the other way round: how much more have ours than theirs?": (-mean, half),
        "teams differ more than strategies do: take each team's difference first":
            (mean, half / std * math.hypot(np.std(a, ddof=1), np.std(b, ddof=1))),
        "1.96 is for many teams: with so few, Student's t is wider": (mean, 1.96 * std / root),
        "numpy's std divides by n; a sample's, by n − 1: ddof=1": (mean, half * math.sqrt((n - 1) / n)),
        "that is the spread of teams: divide by √n": (mean, half * root),
        "t has one degree of freedom less than there are teams": (mean, special.stdtrit(n, 0.975) * std / root),
        "that leaves 5 % on each side, 90 % between": (mean, special.stdtrit(n - 1, 0.95) * std / root),
        "the whole width; half of it is asked for": (mean, 2 * half),
        "that is the standard error: how many of those does 95 % take?": (mean, std / root),
    }  # fmt: skip


def _scores(k: int) -> tuple:
    return _rng.permutation(k) + 0.5 * _rng.random(k), _rng.permutation(k) * 10.0


def _pairs(a, b):
    return np.array([np.sign((a[i] - a[j]) * (b[i] - b[j])) for i, j in itertools.combinations(range(len(a)), 2)])


@exercise(cases=[_scores(4), _scores(4), _scores(6)])
def order(a, b):
    """my_order(plane, space) → Kendall's τ of the same strategies' scores in two worlds, (s,) each, none equal."""
    return {
        AGREES: np.mean(_pairs(a, b)),
        "the share of pairs alike; τ takes the others off": np.mean(_pairs(a, b) > 0),
        "the sign: alike is +1, turned round −1": -np.mean(_pairs(a, b)),
        "of how many pairs? τ lies between −1 and 1": np.sum(_pairs(a, b)),
        "none pairs with itself, and each pair counts once": np.sum(_pairs(a, b)) / len(a) ** 2,
        "that is Spearman's, of ranks; τ counts pairs": stats.spearmanr(a, b)[0],
        "that is Pearson's, of values; τ asks for the order only": np.corrcoef(a, b)[0, 1],
    }
