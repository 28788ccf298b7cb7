"""The checkers of notebook 15: the stored answers pass, plausible wrong ones get the right hint."""

import numpy as np
import pytest
from scipy import stats

from mannbv.course.check import gibson_episode as check

AGREES = "agrees with the library"


def by_scipy(ours, theirs, confidence=0.95):
    test = stats.ttest_rel(ours, theirs).confidence_interval(confidence)
    return (test.low + test.high) / 2, (test.high - test.low) / 2


def unpaired(ours, theirs):
    error = np.sqrt((np.var(ours, ddof=1) + np.var(theirs, ddof=1)) / len(ours))
    return np.mean(ours) - np.mean(theirs), stats.t.ppf(0.975, len(ours) - 1) * error


def scaled(factor):
    """By scipy, its half width times a factor of n."""

    def answer(a, b):
        mean, half = by_scipy(a, b)
        return mean, half * factor(len(a))

    return answer


def wide(n):
    return stats.t.ppf(0.975, n - 1)


CASES = [
    (check.overconfident, lambda a, c: float((c < a).sum()) / len(a), AGREES),
    (check.overconfident, lambda a, c: sum(y < x for x, y in zip(a, c, strict=True)) / len(a), AGREES),
    (check.overconfident, lambda a, c: (a < c).mean(), "that were kept"),
    (check.overconfident, lambda a, c: (c < a).sum(), "that counts them"),
    (check.overconfident, lambda a, c: 100 * (c < a).mean(), "between 0 and 1"),
    (check.overconfident, lambda a, c: a.mean() - c.mean(), "by how much"),
    (check.overconfident, lambda a, c: c < a, "for each waypoint"),
    (check.overconfident, lambda a, c: 0.3, "too"),
    (check.paired, by_scipy, AGREES),
    (check.paired, lambda a, b: by_scipy(b, a), "other way round"),
    (check.paired, unpaired, "each team's difference first"),
    (check.paired, scaled(lambda n: 1.96 / wide(n)), "1.96 is for many"),
    (check.paired, scaled(lambda n: stats.norm.ppf(0.975) / wide(n)), "1.96 is for many"),
    (check.paired, scaled(lambda n: np.sqrt((n - 1) / n)), "ddof=1"),
    (check.paired, scaled(np.sqrt), "by √n"),
    (check.paired, scaled(lambda n: stats.t.ppf(0.975, n) / wide(n)), "degree of freedom"),
    (check.paired, lambda a, b: by_scipy(a, b, 0.9), "90 %"),
    (check.paired, scaled(lambda n: 2.0), "whole width"),
    (check.paired, scaled(lambda n: 1 / wide(n)), "standard error"),
    (check.order, lambda a, b: stats.kendalltau(a, b)[0], AGREES),
    (check.order, lambda a, b: stats.kendalltau(a, b)[0] / 2 + 0.5, "share of pairs"),
    (check.order, lambda a, b: stats.kendalltau(-a, b)[0], "the sign"),
    (check.order, lambda a, b: stats.kendalltau(a, b)[0] * len(a) * (len(a) - 1) / 2, "of how many"),
    (check.order, lambda a, b: stats.kendalltau(a, b)[0] * (len(a) - 1) / len(a) / 2, "counts once"),
    (check.order, lambda a, b: stats.spearmanr(a, b)[0], "Spearman"),
    (check.order, lambda a, b: stats.pearsonr(a, b)[0], "Pearson"),
]


@pytest.mark.parametrize(("checker", "mine", "words"), CASES)
def test_answers_get_the_verdict_that_they_deserve(capsys, checker, mine, words):
    agrees = checker(mine)
    assert words in capsys.readouterr().out
    assert agrees is (words == AGREES)


@pytest.mark.parametrize("checker", [check.overconfident, check.paired, check.order])
@pytest.mark.parametrize("nothing", [None, ...])
def test_an_empty_answer_is_still_to_do(capsys, checker, nothing):
    assert not checker(lambda *case: nothing)
    assert capsys.readouterr().out.strip() == "to do"
