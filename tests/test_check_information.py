"""What the checkers of notebook 03 say to its solutions and to plausible wrong answers."""

import json
import math
from pathlib import Path

import pytest
import torch

from mannbv.course.check import information as check

NOTEBOOK = Path(__file__).parent.parent / "notebooks" / "03_information.ipynb"


def solutions() -> dict:
    """What the cells tagged `solution` define."""
    names = {"math": math, "torch": torch}
    for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]:
        if "solution" in cell["metadata"].get("tags", ()):
            exec("".join(cell["source"]), names)
    return names


@pytest.mark.parametrize(
    ("name", "praise"),
    [
        ("diagonal", "agrees with the library"),
        ("logit", "agrees with the library"),
        ("literal", "agrees with the library"),
        ("measure", "behaves like a worth"),
    ],
)
def test_the_stored_solution_agrees_and_an_empty_one_is_to_do(capsys, name, praise):
    assert getattr(check, name)(solutions()[f"my_{name}"])
    assert capsys.readouterr().out.strip() == praise
    for nothing in (None, ...):
        assert not getattr(check, name)(lambda *args, nothing=nothing: nothing)
        assert capsys.readouterr().out.strip() == "to do"


@pytest.mark.parametrize(
    ("name", "wrong", "hint"),
    [
        ("diagonal", lambda J: J.sum(0) ** 2, "before it was squared"),
        ("diagonal", lambda J: J.abs().sum(0), "absolute values"),
        ("diagonal", lambda J: torch.linalg.norm(J, dim=0), "a length"),
        ("diagonal", lambda J: (J**2).mean(0), "a mean"),
        ("diagonal", lambda J: (J**2).sum(1), "over the parameters"),
        ("diagonal", lambda J: J.T @ J, "the whole matrix"),
        ("diagonal", lambda J: -(J**2).sum(0), "too small"),
        ("logit", lambda h, o: h * o * (1 - o), "enters once"),
        ("logit", lambda h, o: h / (o * (1 - o)) ** 2, "upside down"),
        ("logit", lambda h, o: h * (1 - o) ** 2, "one factor more"),
        ("logit", lambda h, o: h, "unchanged"),
        ("literal", lambda h, H, d, k: (h / (H + d)).sum(), "only once"),
        ("literal", lambda h, H, d, k: (h / (H + k * d)).sum(), "the new view has a λ too"),
        ("literal", lambda h, H, d, k: ((h + d) / (H + d)).sum(), "of its own"),
        ("literal", lambda h, H, d, k: ((h + d) / (H + d + k * d)).sum(), "not one of the past ones"),
        ("literal", lambda h, H, d, k: ((h + d) / H).sum(), "has a λ, too"),
        ("literal", lambda h, H, d, k: ((h + d) / (H + d) / k).sum(), "sum of the past views"),
        ("literal", lambda h, H, d, k: ((h + d) / (H + k * d)).mean(), "the trace is a sum"),
        ("literal", lambda h, H, d, k: (h + d).sum() / (H + k * d).sum(), "a ratio of sums"),
        ("literal", lambda h, H, d, k: (h + d) / (H + k * d), "shape (5, 9)"),
        ("measure", lambda F, H: torch.logdet(F + H), "must be worth 0"),
        ("measure", lambda F, H: -torch.trace(F @ torch.linalg.inv(H)), "must be worth more"),
        ("measure", lambda F, H: torch.trace(F), "must gain less"),
        ("measure", lambda F, H: (F.diagonal() / H.diagonal()).sum(), "the names of the parameters"),
        ("measure", lambda F, H: torch.det(F) / torch.det(H), "of one direction only"),
        ("measure", lambda F, H: torch.linalg.eigvals(torch.linalg.solve(H, F)).real.min(), "of one direction only"),
        ("measure", lambda F, H: torch.logdet(F) - torch.logdet(H), "must be worth 0"),
        ("measure", lambda F, H: torch.trace(F @ torch.linalg.inv(H)), "Eq. (5) itself"),
        ("measure", lambda F, H: 0.5 * torch.trace(torch.linalg.solve(H, F)), "Eq. (5) itself"),
        ("measure", lambda F, H: F, "one number"),
        ("measure", lambda F, H: F.no_such_thing, "it stops with AttributeError"),
    ],
)
def test_a_wrong_answer_gets_its_hint(capsys, name, wrong, hint):
    assert not getattr(check, name)(wrong)
    assert hint in capsys.readouterr().out


def test_other_measures_of_ones_own_behave_too():
    assert check.measure(lambda F, H: torch.trace(F @ torch.linalg.inv(F + H)))
    assert check.measure(lambda F, H: torch.linalg.eigvals(torch.linalg.solve(H, F)).real.max())
