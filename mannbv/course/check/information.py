"""Checkers of notebook 03: squared slopes, a change of parameter, the paper's damping, a measure of one's own."""

from collections.abc import Callable

import torch

from mannbv import information
from mannbv.course.check.verdict import Fault, ask, compare, say


def _draw(seed: int, *shape: int) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def diagonal(mine: Callable) -> bool:
    """mine(jacobian (m, p)) → diag(JᵀJ) (p,)."""
    return compare(
        mine,
        lambda J: torch.diagonal(J.T @ J),
        [(_draw(seed, 6, 4),) for seed in range(3)],
        [
            (lambda J: J.sum(0) ** 2, "added before it was squared: +2 and −2 in two channels then tell nothing"),
            (lambda J: J.abs().sum(0), "absolute values: information adds up squares"),
            (lambda J: (J**2).sum(0).sqrt(), "a length: information is its square"),
            (lambda J: (J**2).mean(0), "a mean: twice the pixels should tell twice as much"),
            (lambda J: (J**2).sum(1), "added over the parameters: keep those, and add over the measurements"),
            (lambda J: J.T @ J, "the whole matrix: only its diagonal is wanted"),
        ],
    )


def logit(mine: Callable) -> bool:
    """mine(information about an opacity, the opacity) → information about its logit."""
    return compare(
        mine,
        lambda h, opacity: h * (opacity * (1 - opacity)) ** 2,
        [(100.0, 0.2), (7.0, 0.5), (7.0, 0.9)],
        [
            (lambda h, o: h, "unchanged: a step of 1 in the logit is a small step in the opacity"),
            (lambda h, o: h * o * (1 - o), "the chain factor enters once, but information is a slope squared"),
            (lambda h, o: h / (o * (1 - o)) ** 2, "upside down: how far does the opacity move when the logit does?"),
            (lambda h, o: h * (1 - o) ** 2, "that is relative to the opacity: its own slope has one factor more"),
        ],
    )


def literal(mine: Callable) -> bool:
    """mine(acquired, prior, damping, views) → gain with "+ λI" on the new view and on each of the past `views`."""

    def case(seed: int, views: int) -> tuple:
        acquired, prior = _draw(seed, 2, 5, 9) ** 2
        return acquired, prior, 0.1 + _draw(seed + 9, 9) ** 2, views

    def truth(acquired, prior, damping, views):
        return information.gain(acquired, prior, damping=damping, literal_views=views)

    return compare(
        mine,
        truth,
        [case(0, 2), case(1, 3), case(2, 7)],
        [
            (
                lambda h, H, d, k: (h / (H + d)).sum(),
                "λ only once, on the prior: that is the library, not the sentence",
            ),
            (lambda h, H, d, k: (h / (H + k * d)).sum(), "the new view has a λ too"),
            (lambda h, H, d, k: ((h + d) / (H + d)).sum(), "each of the past views has a λ of its own"),
            (lambda h, H, d, k: ((h + d) / (H + (k + 1) * d)).sum(), "the new view is not one of the past ones"),
            (lambda h, H, d, k: ((h + d) / H).sum(), "each of the past views has a λ, too"),
            (lambda h, H, d, k: ((h + d) / (k * (H + d))).sum(), "the prior is the sum of the past views already"),
            (lambda h, H, d, k: ((h + d) / (H + k * d)).mean(), "a mean: the trace is a sum"),
            (lambda h, H, d, k: (h + d).sum() / (H + k * d).sum(), "a ratio of sums: the trace is a sum of ratios"),
        ],
    )


def measure(mine: Callable) -> bool:
    """mine(F (p, p) of a view, H (p, p) of what is known) → its worth: any number that behaves like one."""
    known, view = (J.T @ J + 0.5 * torch.eye(4) for J in (_draw(0, 6, 4), _draw(1, 6, 4)))
    mix, one = _draw(2, 4, 4) + 3 * torch.eye(4), _draw(3, 1, 4)
    asked = {
        "view": (view, known), "nothing": (0 * view, known), "more": (2 * view, known), "wiser": (view, 3 * known),
        "narrow": (one.T @ one, known), "mixed": (mix.T @ view @ mix, mix.T @ known @ mix),
    }  # fmt: skip
    try:
        worth = {name: float(ask(mine, *case)) for name, case in asked.items()}
    except Fault as fault:
        return say(str(fault))
    except (TypeError, ValueError, RuntimeError):
        return say("one number is wanted")
    if not abs(worth["nothing"]) < 1e-9:
        return say("a view that shows nothing must be worth 0")
    if not worth["more"] > worth["view"] > 0:
        return say("a view that tells twice as much must be worth more, and more than 0")
    if not worth["wiser"] < worth["view"]:
        return say("who knows more already must gain less")
    if not worth["narrow"] > 1e-9:
        return say("a view that tells of one direction only, F of rank 1, must be worth more than nothing")
    if not abs(worth["mixed"] / worth["view"] - 1) < 1e-6:
        return say("it changes with the names of the parameters (metres for centimetres, axes turned by 45°)")
    traces = {name: float(torch.trace(torch.linalg.solve(H, F))) for name, (F, H) in asked.items()}
    ratios = [worth[name] / traces[name] for name in ("view", "narrow", "wiser")]
    if max(ratios) < (1 + 1e-6) * min(ratios):
        return say("behaves like a worth, but it is Eq. (5) itself: now find another")
    return say("behaves like a worth", True)
