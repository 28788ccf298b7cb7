"""Checkers of notebook 03: squared slopes, a change of parameter, the paper's damping, a measure of one's own."""

from collections.abc import Callable

import torch

from mannbv import information
from mannbv.check.verdict import compare


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
        return acquired, prior, 0.3, views

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
            (lambda h, H, d, k: (h + d).sum() / (H + k * d).sum(), "a ratio of sums: the trace is a sum of ratios"),
        ],
    )


def measure(mine: Callable) -> bool:
    """mine(F (p, p) of a view, H (p, p) of what is known) → its worth: any number that behaves like one."""
    known, view = (J.T @ J + 0.5 * torch.eye(4) for J in (_draw(0, 6, 4), _draw(1, 6, 4)))
    nothing, mix = torch.zeros_like(view), _draw(2, 4, 4) + 3 * torch.eye(4)
    asked = {
        "view": (view, known), "nothing": (nothing, known), "more": (2 * view, known), "wiser": (view, 3 * known),
        "mixed": (mix.T @ view @ mix, mix.T @ known @ mix),
    }  # fmt: skip
    worth = {}
    for name, case in asked.items():
        try:
            worth[name] = mine(*case)
            worth[name] = None if worth[name] is None or worth[name] is ... else float(worth[name])
        except Exception as error:
            print(f"it stops with {type(error).__name__}: {error}".splitlines()[0])
            return False
    if worth["view"] is None:
        verdict = "to do"
    elif abs(worth["nothing"]) > 1e-9:
        verdict = "a view that shows nothing must be worth 0"
    elif not worth["more"] > worth["view"] > 0:
        verdict = "a view that tells twice as much must be worth more, and more than 0"
    elif not worth["wiser"] < worth["view"]:
        verdict = "who knows more already must gain less"
    elif abs(worth["mixed"] / worth["view"] - 1) > 1e-6:
        verdict = "it changes with the names of the parameters (metres for centimetres, x and y for axes turned by 45°)"
    else:
        verdict = "behaves like a worth"
    print(verdict)
    return verdict == "behaves like a worth"
