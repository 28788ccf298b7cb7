"""Exercises of notebook 01: covariance, opacity logit, bytes of a map, union, a round pillar."""

import math
from collections.abc import Callable
from types import SimpleNamespace

import torch
from torch import Tensor

from mannbv import geometry, splats
from mannbv.course.check.verdict import AGREES, Fault, ask, exercise, judged
from mannbv.splats import SplatMap


def _covariance(log_scales, angle):
    return geometry.covariances(log_scales[None], torch.tensor([[math.cos(angle), math.sin(angle)]]))[0]


def _untransposed(log_scales, angle):
    rotation = torch.tensor([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return rotation @ torch.diag(torch.exp(2 * log_scales)) @ rotation


@exercise(
    cases=[(torch.tensor([-0.5, -1.6]), 0.4), (torch.tensor([-2.0, -1.0]), -1.1), (torch.tensor([0.3, -3.0]), 2.5)],
)
def covariance(s, angle):
    """my_covariance(log_scales (2,), angle [rad]) → Σ (2, 2) [m²]."""
    return {
        AGREES: _covariance(s, angle),
        "the scales enter once: Σ is in m², so S must stand twice": _covariance(s / 2, angle),
        "turned the wrong way: which of the two rotations is transposed?": _covariance(s, -angle),
        "exp of the doubled logarithm is S² already: it must not be squared again": _covariance(2 * s, angle),
        "not symmetric: one of the two rotations is transposed": _untransposed(s, angle),
        "the parameters are logarithms of the scales: where is exp?": _covariance(s.abs().log(), angle),
        "the angle is in radians already": _covariance(s, math.radians(angle)),
    }


@exercise(cases=[(0.1,), (0.5,), (0.97,)])
def logit(o):
    """my_logit(opacity between 0 and 1) → the parameter whose sigmoid it is."""
    return {
        AGREES: math.log(o / (1 - o)),
        "the sign: a more opaque splat has the larger parameter": math.log((1 - o) / o),
        "that is the sigmoid; its inverse is wanted": 1 / (1 + math.exp(-o)),
        "that is the inverse of exp, which would let opacities pass 1": math.log(o),
        "the natural logarithm, not that to base 10": math.log10(o / (1 - o)),
    }


@exercise(cases=[(1, 3), (1, 2), (1000, 3)])
def size(n, dim):
    """my_size(n_splats, dim) → bytes of a map's stored numbers, in float32 [B]."""
    row = sum(math.prod(t.shape[1:]) for t in SplatMap.empty(dim).tensors())
    return {
        AGREES: 4 * n * row,
        "those are the free parameters: a rotation is stored with one number more": 4 * n * (row - 1),
        "float32 has 32 bits: how many bytes?": 8 * n * row,
        "those are bits, bytes are wanted": 32 * n * row,
        "those are numbers, bytes are wanted": n * row,
        "Σ is not stored: only its scales and its rotation are": 4 * n * (dim + dim * dim + 4),
        "a colour has three numbers": 4 * n * (row - 2),
    }


_FIRST = SplatMap(
    torch.tensor([[0.0, 1.0], [2.0, 3.0]]), torch.tensor([[-1.0, -2.0], [-3.0, -1.5]]),
    torch.tensor([[1.0, 0.0], [0.6, 0.8]]), torch.tensor([0.5, 2.0]), torch.tensor([[0.1, 0.2, 0.3], [0.9, 0.8, 0.7]]),
)  # fmt: skip
_SECOND = SplatMap(_FIRST.means + torch.tensor([[0.0], [1.0]]), *_FIRST.tensors()[1:])  # the first splat is in both


def _map(answer) -> SplatMap:
    if not isinstance(answer, SplatMap):
        raise Fault(f"a SplatMap is wanted, got {type(answer).__name__}")
    if not all(bool(t.isfinite().all()) for t in answer.tensors()):
        raise Fault("a number in the map is not finite")
    return answer


def _own_hands(mine: Callable) -> None:
    if {"splats", "union"} <= {*getattr(getattr(mine, "__code__", None), "co_names", ())}:
        raise Fault("that is `splats.union` itself: join the five tables on your own")


@exercise(
    cases=[(_FIRST, _SECOND), (_SECOND, _FIRST)],
    read=lambda answer: torch.cat([t.reshape(-1) for t in _map(answer).tensors()]),
    screen=_own_hands,
)
def union(a, b):
    """my_union(a, b) → the disjoint union of two maps, Eq. (16), as a SplatMap."""
    once = b.select([not bool((mean == a.means).all(1).any()) for mean in b.means])
    return {
        AGREES: splats.union(a, b),
        "the maps stand in the other order": splats.union(b, a),
        "the second map is missing": a,
        "the union is disjoint: splats that look the same are all kept": splats.union(a, once),
    }


def _ring(center, radius, n, thin=0.05, share=0.7, outward=False, log=torch.log, shift=0.0):
    """A pillar of n splats, each `share` of their distance long; outward: turned by 90°."""
    angle = 2 * math.pi * torch.arange(n) / n
    cos, sin = torch.cos(angle), torch.sin(angle)
    out, along = torch.stack([cos, sin], 1), torch.stack([-sin, cos], 1)
    scales = log(torch.tensor([share * 2 * math.pi * radius / n, thin])).expand(n, 2)
    means = center + shift + radius * out
    return SplatMap(means, scales, out if outward else along, torch.full((n,), 3.0), torch.zeros(n, 3))


def _any(rule: Callable) -> Callable:
    """Whether a rule of (map, centre, radius) holds for one of the pillars."""
    return lambda seen: any(bool(rule(m, center, radius)) for m, center, radius, _ in seen.pillars)


def _crosswise(m: SplatMap, center: Tensor, radius: float) -> Tensor:
    lengths, axes = torch.linalg.eigh(m.covariances())
    away = torch.nn.functional.normalize(m.means - center, dim=1)
    outward = (axes[..., -1] * away).sum(1).abs() > 0.9
    return (outward & (lengths[:, 1] > 1.5 * lengths[:, 0])).any()


def _total(m: SplatMap, center: Tensor, radius: float) -> Tensor:
    """The sum of the Gaussians all along a circle."""
    angle = torch.linspace(0, 2 * math.pi, 361)
    away = (center + radius * torch.stack([torch.cos(angle), torch.sin(angle)], 1))[:, None] - m.means
    pull = torch.linalg.solve(m.covariances(), away[..., None])[..., 0]
    return (m.opacities * torch.exp(-0.5 * (away * pull).sum(-1))).sum(-1)


@judged(
    truth=_ring,
    mistakes=[
        (lambda c, r, n: _ring(c, r, n // 2), "{splats} where {n} are wanted", lambda seen: seen.n),
        (lambda *case: splats.lifted(_ring(*case), [0.0], 1.0),
         "the pillar stands in flatland: its splats have two axes", _any(lambda m, c, r: m.dim != len(c))),
        (lambda *case: _ring(*case, shift=0.2), "some means do not lie on the circle",
         _any(lambda m, c, r: (torch.linalg.norm(m.means - c, dim=1) - r).abs().max() > 0.05)),
        (lambda *case: _ring(*case, log=lambda scales: scales),
         "every splat is wider than a metre, both ways: the record holds logarithms of scales",
         _any(lambda m, c, r: m.log_scales.min() > 0)),
        (lambda *case: _ring(*case, share=4.0),
         "a splat is longer than the pillar is wide: how far apart do n of them stand?",
         _any(lambda m, c, r: m.scales.max() > r)),
        (lambda *case: _ring(*case, outward=True),
         "the long axis should follow the circle, but some point outwards: turned, or thicker than long?",
         _any(_crosswise)),
        (lambda *case: _ring(*case, thin=0.2),
         "it leaks: too much at the centre or 0.3 m outside; make the splats thinner",
         _any(lambda m, c, r: max(_total(m, c, at).max() for at in (0.0, r + 0.3)) > 0.05)),
        (lambda *case: _ring(*case, share=0.25), "it has gaps: the sum falls below 0.5 somewhere on the circle",
         _any(lambda m, c, r: _total(m, c, r).min() < 0.5)),
    ],
    praise="closed, thin and hollow",
)  # fmt: skip
def pillar(mine: Callable) -> SimpleNamespace:
    """my_pillar(center (2,) [m], radius [m], n) → a SplatMap of n splats along a circle: closed, thin, hollow.

    Judged by the sum of its Gaussians: at least 0.5 all along the circle, at most 0.05 at its centre and 0.3 m outside.
    """
    asked = [(torch.tensor([0.0, 0.0]), 1.0, 24), (torch.tensor([3.0, -2.0]), 0.6, 16)]
    pillars = [(_map(ask(mine, *case)), *case) for case in asked]
    got, n = next(((m.n_splats, n) for m, *_, n in pillars if m.n_splats != n), (0, 0))
    return SimpleNamespace(pillars=pillars, splats=f"{got} splat{'s' * (got != 1)}", n=n)
