"""Checks of notebook 15: promises that were not kept, paired teams, the order of strategies in two worlds."""

import itertools
import math
from collections.abc import Callable

import numpy as np
from scipy import special, stats

from mannbv.course.check.verdict import compare


def overconfident(mine: Callable) -> bool:
    """mine(alpha, clearance) → the share of waypoints whose true clearance is smaller than their α, both (k,) [m]."""
    rng = np.random.default_rng(5)
    alpha = [rng.uniform(-0.1, 0.9, k) for k in (40, 7)]
    cases = [(a, np.abs(a + rng.normal(0.05, 0.2, len(a)))) for a in alpha]
    return compare(
        mine,
        lambda a, c: np.mean(c < a),
        cases,
        [
            (lambda a, c: np.mean(c > a), "those are the promises that were kept: here less was clear than α said"),
            (lambda a, c: np.sum(c < a), "that counts them; which share of all waypoints are they?"),
            (lambda a, c: 100 * np.mean(c < a), "a share lies between 0 and 1; percents are a hundred times as many"),
            (lambda a, c: np.mean(a - c), "that is by how much on average; the question is how often"),
            (lambda a, c: c < a, "a verdict for each waypoint: what share of them is true?"),
        ],
    )


def paired(mine: Callable) -> bool:
    """mine(ours, theirs) → mean difference of paired teams (k,), and half of its 95 % interval by Student's t."""

    def halved(std: Callable, factor: Callable):
        def answer(a, b):
            return np.mean(a - b), factor(len(a)) * std(a, b) / math.sqrt(len(a))

        return answer

    def student(n):
        return special.stdtrit(n - 1, 0.975)

    def spread(a, b):
        return np.std(a - b, ddof=1)

    def unpaired(a, b):
        return math.sqrt(np.var(a, ddof=1) + np.var(b, ddof=1))

    rng = np.random.default_rng(2)
    teams = [rng.normal(17, 2, k) for k in (12, 4)]
    cases = [(team + rng.normal(0.4, 0.5, len(team)), team) for team in teams]
    right = halved(spread, student)
    return compare(
        mine,
        right,
        cases,
        [
            (lambda a, b: right(b, a), "the other way round: how much more have ours than theirs?"),
            (halved(unpaired, student), "teams differ more than strategies do: take each team's difference first"),
            (halved(spread, lambda n: 1.96), "1.96 is for many teams: with so few, Student's t is wider"),
            (halved(lambda a, b: np.std(a - b), student), "numpy's std divides by n; a sample's, by n − 1: ddof=1"),
            (halved(spread, lambda n: student(n) * math.sqrt(n)), "that is the spread of teams: divide by √n"),
            (halved(spread, lambda n: student(n + 1)), "t has one degree of freedom less than there are teams"),
            (halved(spread, lambda n: special.stdtrit(n - 1, 0.95)), "that leaves 5 % on each side, 90 % between"),
            (halved(spread, lambda n: 2 * student(n)), "the whole width; half of it is asked for"),
            (halved(spread, lambda n: 1.0), "that is the standard error: how many of those does 95 % take?"),
        ],
        rtol=1e-4,
    )  # fmt: skip


def order(mine: Callable) -> bool:
    """mine(plane, space) → Kendall's τ of the same strategies' scores in two worlds, (s,) each, none equal."""

    def pairs(a, b):
        return [np.sign((a[i] - a[j]) * (b[i] - b[j])) for i, j in itertools.combinations(range(len(a)), 2)]

    rng = np.random.default_rng(8)
    cases = [(rng.permutation(k) + 0.5 * rng.random(k), rng.permutation(k) * 10.0) for k in (4, 4, 6)]
    return compare(
        mine,
        lambda a, b: np.mean(pairs(a, b)),
        cases,
        [
            (lambda a, b: np.mean(np.array(pairs(a, b)) > 0), "the share of pairs alike; τ takes the others off"),
            (lambda a, b: -np.mean(pairs(a, b)), "the sign: alike is +1, turned round −1"),
            (lambda a, b: np.sum(pairs(a, b)), "of how many pairs? τ lies between −1 and 1"),
            (lambda a, b: np.sum(pairs(a, b)) / len(a) ** 2, "none pairs with itself, and each pair counts once"),
            (lambda a, b: stats.spearmanr(a, b)[0], "that is Spearman's, of ranks; τ counts pairs"),
            (lambda a, b: np.corrcoef(a, b)[0, 1], "that is Pearson's, of values; τ asks for the order only"),
        ],
    )  # fmt: skip
