"""Checks of notebook 01: covariance, opacity logit, bytes of a map, union, a round pillar."""

import math

import torch
from torch import Tensor

from mannbv import geometry, splats
from mannbv.course.check.verdict import Fault, ask, compare, say
from mannbv.splats import SplatMap


def covariance(mine) -> bool:
    """mine(log_scales (2,), angle [rad]) → Σ (2, 2) [m²]."""
    cases = [(torch.tensor([-0.5, -1.6]), 0.4), (torch.tensor([-2.0, -1.0]), -1.1), (torch.tensor([0.3, -3.0]), 2.5)]

    def true(log_scales, angle, turn=1.0):
        rotation = torch.tensor([[math.cos(angle), turn * math.sin(angle)]])
        return geometry.covariances(log_scales[None], rotation)[0]

    def unturned(log_scales, angle):
        rotation = torch.tensor([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        return rotation @ torch.diag(torch.exp(2 * log_scales)) @ rotation

    def with_log_squared(log_scales, angle):
        return true(torch.log(log_scales.abs()), angle)

    return compare(
        mine, true, cases,
        [
            (lambda s, a: true(s / 2, a), "the scales enter once: Σ is in m², so S must stand twice"),
            (lambda s, a: true(s, a, -1.0), "turned the wrong way: which of the two rotations is transposed?"),
            (lambda s, a: true(2 * s, a), "exp of the doubled logarithm is S² already: it must not be squared again"),
            (unturned, "not symmetric: one of the two rotations is transposed"),
            (with_log_squared, "the parameters are logarithms of the scales: where is exp?"),
            (lambda s, a: true(s, math.radians(a)), "the angle is in radians already"),
        ],
        rtol=1e-4, atol=1e-6,
    )  # fmt: skip


def logit(mine) -> bool:
    """mine(opacity between 0 and 1) → the parameter whose sigmoid it is."""
    cases = [(0.1,), (0.5,), (0.97,)]
    return compare(
        mine, lambda o: math.log(o / (1 - o)), cases,
        [
            (lambda o: math.log((1 - o) / o), "the sign: a more opaque splat has the larger parameter"),
            (lambda o: 1 / (1 + math.exp(-o)), "that is the sigmoid; its inverse is wanted"),
            (lambda o: math.log(o), "that is the inverse of exp, which would let opacities pass 1"),
            (lambda o: math.log10(o / (1 - o)), "the natural logarithm, not that to base 10"),
        ],
        rtol=1e-4,
    )  # fmt: skip


def size(mine) -> bool:
    """mine(n_splats, dim) → bytes of a map's stored numbers, in float32 [B]."""

    def true(n_splats, dim, extra=0, n_bytes=4):
        row = sum(math.prod(t.shape[1:]) for t in SplatMap.empty(dim).tensors())
        return n_bytes * n_splats * (row + extra)

    def matrix(n_splats, dim):
        return 4 * n_splats * (dim + dim * dim + 4)

    return compare(
        mine, true, [(1, 3), (1, 2), (1000, 3)],
        [
            (lambda n, d: true(n, d, -1), "those are the free parameters: a rotation is stored with one number more"),
            (lambda n, d: true(n, d, 0, 8), "float32 has 32 bits: how many bytes?"),
            (lambda n, d: true(n, d, 0, 32), "those are bits, bytes are wanted"),
            (lambda n, d: true(n, d, 0, 1), "those are numbers, bytes are wanted"),
            (matrix, "Σ is not stored: only its scales and its rotation are"),
            (lambda n, d: true(n, d, -2), "a colour has three numbers"),
        ],
    )  # fmt: skip


def union(mine) -> bool:
    """mine(a, b) → the disjoint union of two maps, Eq. (16), as a SplatMap."""

    def flat(splat_map):
        return torch.cat([t.reshape(-1) for t in splat_map.tensors()])

    def joined(a, b):
        if {"splats", "union"} <= set(getattr(getattr(mine, "__code__", None), "co_names", ())):
            raise Fault("that is `splats.union` itself: join the five tables on your own")
        return flat(_map(ask(mine, a, b)))

    def once(a, b):
        return splats.union(a, b.select([not bool((m == a.means).all(1).any()) for m in b.means]))

    first = SplatMap(
        torch.tensor([[0.0, 1.0], [2.0, 3.0]]), torch.tensor([[-1.0, -2.0], [-3.0, -1.5]]),
        torch.tensor([[1.0, 0.0], [0.6, 0.8]]), torch.tensor([0.5, 2.0]),
        torch.tensor([[0.1, 0.2, 0.3], [0.9, 0.8, 0.7]]),
    )  # fmt: skip
    second = SplatMap(first.means + torch.tensor([[0.0], [1.0]]), *first.tensors()[1:])  # the first splat is in both
    return compare(
        joined, lambda a, b: flat(splats.union(a, b)), [(first, second), (second, first)],
        [
            (lambda a, b: flat(splats.union(b, a)), "the maps stand in the other order"),
            (lambda a, b: flat(a), "the second map is missing"),
            (lambda a, b: flat(once(a, b)), "the union is disjoint: splats that look the same are all kept"),
        ],
    )  # fmt: skip


def pillar(mine) -> bool:
    """mine(center (2,) [m], radius [m], n) → a SplatMap of n splats along a circle: closed, thin, hollow.

    Judged by the sum of its Gaussians: at least 0.5 all along the circle, at most 0.05 at its centre and 0.3 m outside.
    """
    for center, radius, n in ((torch.tensor([0.0, 0.0]), 1.0, 24), (torch.tensor([3.0, -2.0]), 0.6, 16)):
        try:
            _judge_pillar(_map(ask(mine, center, radius, n)), center, radius, n)
        except Fault as fault:
            return say(str(fault))
    return say("closed, thin and hollow", True)


def _map(answer) -> SplatMap:
    if not isinstance(answer, SplatMap):
        raise Fault(f"a SplatMap is wanted, got {type(answer).__name__}")
    return answer


def _judge_pillar(drawn: SplatMap, center: Tensor, radius: float, n: int) -> None:
    if drawn.n_splats != n:
        raise Fault(f"{drawn.n_splats} splat{'s' * (drawn.n_splats != 1)} where {n} are wanted")
    if drawn.dim != center.shape[0]:
        raise Fault("the pillar stands in flatland: its splats have two axes")
    angle = torch.linspace(0, 2 * math.pi, 361)
    circle = torch.stack([torch.cos(angle), torch.sin(angle)], 1)
    on, inside, outside = (_total(drawn, center + r * circle) for r in (radius, 0.0, radius + 0.3))
    if (torch.linalg.norm(drawn.means - center, dim=1) - radius).abs().max() > 0.05:
        raise Fault("some means do not lie on the circle")
    if drawn.log_scales.min() > 0:
        raise Fault("every splat is wider than a metre, both ways: the record holds logarithms of scales")
    if drawn.scales.max() > radius:
        raise Fault("a splat is longer than the pillar is wide: how far apart do n of them stand?")
    lengths, axes = torch.linalg.eigh(drawn.covariances())
    away = torch.nn.functional.normalize(drawn.means - center, dim=1)
    outward = (axes[..., -1] * away).sum(1).abs() > 0.9
    if bool((outward & (lengths[:, 1] > 1.5 * lengths[:, 0])).any()):
        raise Fault("the long axis should follow the circle, but some point outwards: turned, or thicker than long?")
    if inside.max() > 0.05 or outside.max() > 0.05:
        raise Fault("it leaks: too much at the centre or 0.3 m outside; make the splats thinner")
    if on.min() < 0.5:
        raise Fault("it has gaps: the sum falls below 0.5 somewhere on the circle")


def _total(splat_map: SplatMap, points: Tensor) -> Tensor:
    away = points[:, None] - splat_map.means
    pull = torch.linalg.solve(splat_map.covariances(), away[..., None])[..., 0]
    return (splat_map.opacities * torch.exp(-0.5 * (away * pull).sum(-1))).sum(-1)
