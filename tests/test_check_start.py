"""The checkers of notebook 00: right answers pass, and each plausible mistake hears the hint it deserves."""

import math

import pytest
from scipy.special import erfinv
from scipy.stats import norm

from mannbv.course.check import start as check


def tail(mean, std, level):
    """The textbook's expected shortfall, by the normal quantile and density."""
    return mean - std * norm.pdf(norm.ppf(level)) / level


def spread(level):
    return math.exp(-(erfinv(2 * level - 1) ** 2))


def ball(alpha):
    return 0.5 + math.exp(-2 * alpha)


def worth(told, prior, damping):
    return sum(
        float(h / (H + d))
        for row, past in zip(told, prior, strict=True)
        for h, H, d in zip(row, past, damping, strict=True)
    )


ROOT = math.sqrt(2 * math.pi)
AGREES = "agrees with the library"
CASES = [
    (check.avar, tail, AGREES),
    (check.avar, lambda mean, std, level: mean + std * norm.pdf(norm.ppf(level)) / level, "the wrong tail"),
    (check.avar, lambda mean, std, level: norm.ppf(level, mean, std), "the border of the tail"),
    (check.avar, lambda mean, std, level: tail(mean, std, 1 - level), "not of the good"),
    (check.avar, lambda mean, std, level: tail(mean, std**2, level), "not a variance"),
    (check.avar, lambda mean, std, level: mean - tail(mean, std, level), "below the mean"),
    (check.avar, lambda mean, std, level: mean - std * spread(level) / ROOT, "by which share"),
    (check.avar, lambda mean, std, level: mean - std * spread(level) / (level * 2 * math.pi), "the root"),
    (check.avar, lambda mean, std, level: mean - std * spread(level) / (level * math.sqrt(math.pi)), "the root"),
    (check.avar, lambda mean, std, level: mean - std / spread(level) / (level * ROOT), "the exponent's sign"),
    (
        check.avar,
        lambda mean, std, level: mean - std * math.exp(-erfinv(2 * level - 1)) / (level * ROOT),
        "how does ι stand",
    ),
    (check.avar, lambda mean, std, level: mean - std * math.sqrt(spread(level)) / (level * ROOT), "no normal quantile"),
    (
        check.avar,
        lambda mean, std, level: mean - std * math.exp(-(erfinv(level) ** 2)) / (level * ROOT),
        "of which number",
    ),
    (check.avar, lambda mean, std, level: 1 / 0, "it stops with ZeroDivisionError"),
    (check.radius, ball, AGREES),
    (check.radius, lambda alpha: 0.5 + math.exp(2 * alpha), "a sign"),
    (check.radius, lambda alpha: math.exp(-2 * alpha), "keeps a ball"),
    (check.radius, lambda alpha: 0.5 + 2 * math.exp(-alpha), "which stands where"),
    (check.radius, lambda alpha: 0.5 + math.exp(-alpha), "where is β₂"),
    (check.radius, lambda alpha: 0.5 + math.exp(-alpha / 2), "one over a length already"),
    (check.radius, lambda alpha: 1.5 * math.exp(-2 * alpha), "not all of the radius"),
    (check.radius, lambda alpha: 1.5 - math.exp(-2 * alpha), "gets the smaller ball"),
    (check.radius, lambda alpha: ball(alpha) + 0.01, "too large for alpha = -0.1"),
    (check.radius, lambda alpha: ball(max(alpha, 0.0)), "too small for alpha = -0.1"),
    (check.radius, lambda alpha: [ball(alpha)] * 3, "shape (3,) where one number is wanted"),
    (check.radius, lambda alpha: 0.5 + 1.5 * math.exp(-2 * alpha), "another β₁"),
    (check.gain, worth, AGREES),
    (check.gain, lambda h, H, d: ((H + d) / h).sum(), "what divides what"),
    (check.gain, lambda h, H, d: (h * (H + d)).sum(), "knows more already"),
    (check.gain, lambda h, H, d: (h / H).sum(), "no λ"),
    (check.gain, lambda h, H, d: ((h + d) / (H + d)).sum(), "λ belongs to the prior"),
    (check.gain, lambda h, H, d: (h / H + d).sum(), "where does λ belong"),
    (check.gain, lambda h, H, d: (h / (h + H + d)).sum(), "not after it"),
    (check.gain, lambda h, H, d: h.sum() / (H + d).sum(), "not a ratio of sums"),
    (check.gain, lambda h, H, d: (h / (H + d)).mean(), "not a mean"),
    (check.gain, lambda h, H, d: (h / (H + d)).sum(0), "one for each parameter"),
    (check.gain, lambda h, H, d: (h / (H + d)).sum(1), "one for each splat"),
    (check.gain, lambda h, H, d: h / (H + d), "with a diagonal"),
]


@pytest.mark.parametrize(("checker", "mine", "words"), CASES)
def test_answers_get_the_verdict_that_they_deserve(capsys, checker, mine, words):
    agrees = checker(mine)
    said = capsys.readouterr().out.strip()
    assert words in said and len(said.splitlines()) == 1
    assert agrees is (words == AGREES)


@pytest.mark.parametrize("checker", [check.avar, check.radius, check.gain])
@pytest.mark.parametrize("nothing", [None, ...])
def test_an_empty_answer_is_still_to_do(capsys, checker, nothing):
    assert not checker(lambda *case: nothing)
    assert capsys.readouterr().out.strip() == "to do"
