"""The checks of notebook 01: right answers agree, empty ones are to do, plausible wrong ones get the right hint."""

import math

import pytest
import torch

from mannbv import splats
from mannbv.course.check import splats as check
from mannbv.splats import SplatMap


def covariance(log_scales, angle):
    cos, sin = math.cos(angle), math.sin(angle)
    R, S = torch.tensor([[cos, -sin], [sin, cos]]), torch.diag(torch.exp(log_scales))
    return R @ S @ S @ R.T


def scaled_once(log_scales, angle):
    return covariance(log_scales / 2, angle)


def untransposed(log_scales, angle):
    cos, sin = math.cos(angle), math.sin(angle)
    R, S = torch.tensor([[cos, -sin], [sin, cos]]), torch.diag(torch.exp(log_scales))
    return R @ S @ S @ R


def union(a, b):
    return SplatMap(*(torch.cat([x, y]) for x, y in zip(a.tensors(), b.tensors(), strict=True)))


def pillar(center, radius, n, thin=0.05, share=0.7, tangent=1.0, log=torch.log, shift=0.0):
    angle = 2 * math.pi * torch.arange(n) / n
    cos, sin = torch.cos(angle), torch.sin(angle)
    out, along = torch.stack([cos, sin], 1), torch.stack([-sin, cos], 1)
    scales = torch.tensor([share * 2 * math.pi * radius / n, thin]).expand(n, 2)
    rotations = along if tangent else out
    return SplatMap(center + shift + radius * out, log(scales), rotations, torch.full((n,), 3.0), torch.zeros(n, 3))


EXERCISES = ("covariance", "logit", "size", "union", "pillar")


@pytest.mark.parametrize("exercise", EXERCISES)
@pytest.mark.parametrize("nothing", [None, ...])
def test_an_empty_answer_is_to_do(capsys, exercise, nothing):
    assert getattr(check, exercise)(lambda *case: nothing) is False
    assert capsys.readouterr().out == "to do\n"


@pytest.mark.parametrize(
    ("exercise", "mine", "words"),
    [
        ("covariance", covariance, "agrees with the library"),
        ("logit", lambda o: math.log(o / (1 - o)), "agrees with the library"),
        ("size", lambda n, d: n * 4 * (2 * d + (2 if d == 2 else 4) + 4), "agrees with the library"),
        ("size", lambda n, d: n * {2: 40, 3: 56}[d], "agrees with the library"),  # 56 B as in the paper's tables
        ("union", union, "agrees with the library"),
        ("pillar", pillar, "closed, thin and hollow"),
    ],
)
def test_right_answers_agree(capsys, exercise, mine, words):
    assert getattr(check, exercise)(mine) is True
    assert capsys.readouterr().out == words + "\n"


@pytest.mark.parametrize(
    ("exercise", "mine", "hint"),
    [
        ("covariance", scaled_once, "S must stand twice"),
        ("covariance", lambda s, a: covariance(s, -a), "turned the wrong way"),
        ("covariance", lambda s, a: covariance(torch.log(s.abs()), a), "where is exp?"),
        ("covariance", lambda s, a: covariance(s, math.radians(a)), "in radians already"),
        ("covariance", lambda s, a: covariance(s, a)[0], "shape (2,) where (2, 2) is wanted"),
        ("covariance", lambda s, a: covariance(2 * s, a), "S² already"),
        ("covariance", untransposed, "not symmetric"),
        ("covariance", lambda s, a: torch.linalg.cholesky(covariance(s, a)), "for s = [-0.5, -1.6], a = 0.4"),
        ("logit", lambda o: torch.log(o / (1 - o)), "it stops with TypeError"),
        ("logit", lambda o: math.log((1 - o) / o), "the sign"),
        ("logit", lambda o: 1 / (1 + math.exp(-o)), "its inverse is wanted"),
        ("logit", math.log, "inverse of exp"),
        ("logit", lambda o: math.log10(o / (1 - o)), "natural logarithm"),
        ("size", lambda n, d: n * {2: 36, 3: 52}[d], "free parameters"),
        ("size", lambda n, d: n * {2: 80, 3: 112}[d], "how many bytes?"),
        ("size", lambda n, d: n * {2: 320, 3: 448}[d], "those are bits"),
        ("size", lambda n, d: n * {2: 10, 3: 14}[d], "those are numbers"),
        ("size", lambda n, d: 4 * n * (d + d * d + 4), "Σ is not stored"),
        ("size", lambda n, d: n * {2: 32, 3: 48}[d], "three numbers"),
        ("union", lambda a, b: union(b, a), "other order"),
        ("union", lambda a, b: a, "second map is missing"),
        ("union", lambda a, b: list(union(a, b).tensors()), "a SplatMap is wanted, got list"),
        ("union", lambda a, b: splats.union(a, b), "`splats.union` itself"),
        ("union", lambda a, b: union(a, union(b, b)), "where (40,) is wanted"),
        ("pillar", lambda c, r, n: pillar(c, r, n, log=lambda s: s), "logarithms of scales"),
        ("pillar", lambda c, r, n: pillar(c, r, n, tangent=0), "long axis should follow the circle"),
        ("pillar", lambda c, r, n: pillar(c, r, n, thin=0.2), "it leaks"),
        ("pillar", lambda c, r, n: pillar(c, r, n, share=0.25), "it has gaps"),
        ("pillar", lambda c, r, n: pillar(c, r, n, shift=0.2), "do not lie on the circle"),
        ("pillar", lambda c, r, n: pillar(c, r, n, share=4), "longer than the pillar is wide"),
        ("pillar", lambda c, r, n: pillar(c, r, n, thin=0.3), "turned, or thicker than long?"),
        ("pillar", lambda c, r, n: pillar(c, r, n // 2), "12 splats where 24 are wanted"),
        ("pillar", lambda c, r, n: pillar(c, r, 1), "1 splat where 24 are wanted"),
        ("pillar", lambda c, r, n: SplatMap.empty(3).select([0] * 0), "0 splats where 24"),
        ("pillar", lambda c, r, n: 1.0, "a SplatMap is wanted, got float"),
        ("pillar", lambda c, r, n: 1 / 0, "it stops with ZeroDivisionError"),
    ],
)
def test_a_plausible_wrong_answer_gets_its_hint(capsys, exercise, mine, hint):
    assert getattr(check, exercise)(mine) is False
    assert hint in capsys.readouterr().out


def test_a_union_without_doubles_is_told_that_the_union_is_disjoint(capsys):
    def once(a, b):
        return union(a, b.select([not (m == a.means).all(1).any() for m in b.means]))

    assert check.union(once) is False
    assert "disjoint" in capsys.readouterr().out
