"""The checkers of notebook 04: the stored answers pass, plausible wrong ones get the right hint."""

import math

import numpy as np
import pytest
from scipy.stats import norm

from mannbv import risk
from mannbv.course.check import risk as check


def avar(mean, std, level):
    return risk.average_value_at_risk(mean, std, level)


def distances(means, stds, points, level):
    return np.linalg.norm(points[:, None] - means, axis=-1)


def sight(mean, point):
    return (point - mean) / np.linalg.norm(point - mean)


def upper(mean, std, level):
    return 2 * mean - avar(mean, std, level)


def chernoff(mean, std, level):
    return mean - std * math.sqrt(2 * math.log(1 / level))


AGREES = "agrees with the library"
CASES = [
    (check.contact, lambda mean, std: norm.cdf(-mean / std), AGREES),
    (check.contact, lambda mean, std: norm.cdf(mean / std), "staying clear"),
    (check.contact, lambda mean, std: norm.cdf(-mean / std**2), "not a variance"),
    (check.contact, lambda mean, std: norm.cdf(-mean / math.sqrt(std)), "no root"),
    (check.contact, lambda mean, std: norm.cdf(-std / mean), "swapped"),
    (check.contact, lambda mean, std: 1 - norm.cdf(mean / std) + norm.cdf(-mean / std), "both tails"),
    (check.contact, lambda mean, std: 100 * norm.cdf(-mean / std), "per cent"),
    (check.contact, lambda mean, std: norm.pdf(0.0, mean, std), "density"),
    (check.gap, lambda std, level, alpha: alpha - avar(0.0, std, level), AGREES),
    (check.gap, lambda std, level, alpha: alpha + avar(0.0, std, level), "a sign"),
    (check.gap, lambda std, level, alpha: -avar(0.0, std, level), "where is α"),
    (check.gap, lambda std, level, alpha: alpha - risk.value_at_risk(0.0, std, level), "the border of the tail"),
    (check.gap, lambda std, level, alpha: alpha - avar(0.0, std, 1 - level), "not of the good"),
    (check.gap, lambda std, level, alpha: alpha - avar(0.0, std**2, level), "not a variance"),
    (check.culprit, lambda *case: avar(distances(*case), case[1], case[3]).argmin(1), AGREES),
    (check.culprit, lambda *case: distances(*case).argmin(1), "nearest mean"),
    (check.culprit, lambda *case: avar(distances(*case), case[1], case[3]).argmax(1), "harmless"),
    (check.culprit, lambda *case: avar(distances(*case), case[1], case[3]).argmin(0), "the other axis"),
    (check.culprit, lambda *case: avar(distances(*case), case[1], case[3]).min(1), "which splat"),
    (check.culprit, lambda *case: np.full(len(case[2]), case[1].argmax()), "the vaguest"),
    (check.culprit, lambda *case: risk.value_at_risk(distances(*case), case[1], case[3]).argmin(1), "the border of"),
    (check.culprit, lambda *case: upper(distances(*case), case[1], case[3]).argmin(1), "the wrong tail"),
    (check.culprit, lambda *case: (distances(*case) / case[1]).argmin(1), "the distance in σ"),
    (check.culprit, lambda *case: np.zeros(len(case[2])), "another splat at the point (0.8, 0.1) in case 1 of 2"),
    (check.culprit, lambda *case: np.full(len(case[2]), 0.5), "not the index of a splat"),
    (check.along, lambda cov, mean, point: math.sqrt(sight(mean, point) @ cov @ sight(mean, point)), AGREES),
    (check.along, lambda cov, mean, point: math.sqrt(sight(0, mean) @ cov @ sight(0, mean)), "at the origin"),
    (check.along, lambda cov, mean, point: math.sqrt(sight(0, point) @ cov @ sight(0, point)), "at the origin"),
    (check.along, lambda cov, mean, point: sight(mean, point) @ cov @ sight(mean, point), "variance"),
    (check.along, lambda cov, mean, point: math.sqrt((point - mean) @ cov @ (point - mean)), "a unit one"),
    (check.along, lambda cov, mean, point: math.sqrt(np.linalg.eigvalsh(cov).max()), "the largest σ"),
    (
        check.along,
        lambda cov, mean, point: 1 / math.sqrt(sight(mean, point) @ np.linalg.inv(cov) @ sight(mean, point)),
        "ellipse",
    ),
    (check.measure, chernoff, "a risk measure"),
    (check.measure, avar, "a risk measure"),
    (check.measure, lambda mean, std, level: 2 * mean - chernoff(mean, std, level), "the wrong tail"),
    (check.measure, lambda mean, std, level: chernoff(mean, std, 1 - level), "more careful"),
    (check.measure, lambda mean, std, level: mean * (1 - std), "half a metre"),
    (check.measure, lambda mean, std, level: mean - 0.1, "its own risk"),
    (check.measure, lambda mean, std, level: mean - 0.2 * (std > 0), "vaguer"),
    (check.measure, risk.value_at_risk, "for ε above 0.5"),
    (check.measure, lambda mean, std, level: np.array([mean, std]), "one number"),
    (check.measure, lambda mean, std, level: 1 / 0, "it stops with ZeroDivisionError"),
]


@pytest.mark.parametrize(("checker", "mine", "words"), CASES)
def test_answers_get_the_verdict_that_they_deserve(capsys, checker, mine, words):
    agrees = checker(mine)
    assert words in capsys.readouterr().out
    assert agrees is (words in (AGREES, "a risk measure"))


@pytest.mark.parametrize("checker", [check.contact, check.gap, check.culprit, check.along, check.measure])
@pytest.mark.parametrize("nothing", [None, ...])
def test_an_empty_answer_is_still_to_do(capsys, checker, nothing):
    assert not checker(lambda *case: nothing)
    assert capsys.readouterr().out.strip() == "to do"


def test_a_measure_of_numbers_only_passes_and_hears_that_it_cannot_steer_a_team(capsys):
    assert check.measure(chernoff)
    assert check.measure(lambda mean, std, level: mean - math.expm1(std) / level)
    able, unable = capsys.readouterr().out.splitlines()
    assert "numbers only" in unable and "numbers only" not in able
