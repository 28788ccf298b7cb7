"""Exercises of notebook 03: squared slopes, a change of parameter, the paper's damping, a measure of one's own."""

from collections.abc import Callable
from types import SimpleNamespace

import torch

from mannbv import information
from mannbv.course.check.verdict import AGREES, ask, exercise, judged, number


def _draw(seed: int, *shape: int) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


@exercise(cases=[(_draw(seed, 6, 4),) for seed in range(3)])
def diagonal(J):
    """my_diagonal(jacobian (m, p)) → diag(JᵀJ) (p,)."""
    return {
        AGREES: torch.diagonal(J.T @ J),
        "added before it was squared: +2 and −2 in two channels then tell nothing": J.sum(0) ** 2,
        "absolute values: information adds up squares": J.abs().sum(0),
        "a length: information is its square": (J**2).sum(0).sqrt(),
        "a mean: twice the pixels should tell twice as much": (J**2).mean(0),
        "added over the parameters: keep those, and add over the measurements": (J**2).sum(1),
        "the whole matrix: only its diagonal is wanted": J.T @ J,
    }


@exercise(cases=[(100.0, 0.2), (7.0, 0.5), (7.0, 0.9)])
def logit(h, o):
    """my_logit(information about an opacity, the opacity) → information about its logit."""
    return {
        AGREES: h * (o * (1 - o)) ** 2,
        "unchanged: a step of 1 in the logit is a small step in the opacity": h,
        "the chain factor enters once, but information is a slope squared": h * o * (1 - o),
        "upside down: how far does the opacity move when the logit does?": h / (o * (1 - o)) ** 2,
        "that is relative to the opacity: its own slope has one factor more": h * (1 - o) ** 2,
    }


def _views(seed: int, views: int) -> tuple:
    acquired, prior = _draw(seed, 2, 5, 9) ** 2
    return acquired, prior, 0.1 + _draw(seed + 9, 9) ** 2, views


@exercise(cases=[_views(0, 2), _views(1, 3), _views(2, 7)])
def literal(h, H, d, k):
    """my_literal(acquired, prior, damping, views) → gain with "+ λI" on the new view and on each past one."""
    return {
        AGREES: information.gain(h, H, damping=d, literal_views=k),
        "λ only once, on the prior: that is the library, not the sentence": (h / (H + d)).sum(),
        "the new view has a λ too": (h / (H + k * d)).sum(),
        "each of the past views has a λ of its own": ((h + d) / (H + d)).sum(),
        "the new view is not one of the past ones": ((h + d) / (H + (k + 1) * d)).sum(),
        "each of the past views has a λ, too": ((h + d) / H).sum(),
        "the prior is the sum of the past views already": ((h + d) / (k * (H + d))).sum(),
        "a mean: the trace is a sum": ((h + d) / (H + k * d)).mean(),
        "a ratio of sums: the trace is a sum of ratios": (h + d).sum() / (H + k * d).sum(),
    }


def _trace(F, H):
    return torch.trace(torch.linalg.solve(H, F))


@judged(
    truth=lambda F, H: 0.5 * torch.logdet(torch.eye(len(F)) + torch.linalg.solve(H, F)),
    mistakes=[
        (lambda F, H: torch.logdet(F + H), "a view that shows nothing must be worth 0",
         lambda worth: not abs(worth.nothing) < 1e-9),
        (lambda F, H: -_trace(F, H), "a view that tells twice as much must be worth more, and more than 0",
         lambda worth: not worth.more > worth.view > 0),
        (lambda F, H: torch.trace(F), "who knows more already must gain less",
         lambda worth: not worth.wiser < worth.view),
        (lambda F, H: torch.det(F) / torch.det(H),
         "a view that tells of one direction only, F of rank 1, must be worth more than nothing",
         lambda worth: not worth.narrow > 1e-9),
        (lambda F, H: (F.diagonal() / H.diagonal()).sum(),
         "it changes with the names of the parameters (metres for centimetres, axes turned by 45°)",
         lambda worth: not abs(worth.mixed / worth.view - 1) < 1e-6),
        (_trace, "behaves like a worth, but it is Eq. (5) itself: now find another",
         lambda worth: max(worth.ratios) < (1 + 1e-6) * min(worth.ratios)),
        (lambda F, H: F, "one number is wanted"),
    ],
    praise="behaves like a worth",
)  # fmt: skip
def measure(mine: Callable) -> SimpleNamespace:
    """my_measure(F (p, p) of a view, H (p, p) of what is known) → its worth: any number that behaves like one.

    What some views are worth by a measure, and how it stands to Eq. (5).
    """
    known, view = (J.T @ J + 0.5 * torch.eye(4) for J in (_draw(0, 6, 4), _draw(1, 6, 4)))
    mix, one = _draw(2, 4, 4) + 3 * torch.eye(4), _draw(3, 1, 4)
    asked = {
        "view": (view, known), "nothing": (0 * view, known), "more": (2 * view, known), "wiser": (view, 3 * known),
        "narrow": (one.T @ one, known), "mixed": (mix.T @ view @ mix, mix.T @ known @ mix),
    }  # fmt: skip
    worth = {name: number(ask(mine, *case)) for name, case in asked.items()}
    ratios = [worth[name] / float(_trace(*asked[name])) for name in ("view", "narrow", "wiser")]
    return SimpleNamespace(**worth, ratios=ratios)
