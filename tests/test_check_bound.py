"""What the checks of notebook 09 say to right, wrong and empty answers."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from mannbv.config import Config
from mannbv.course.check import team_problem

NOTEBOOK = Path(__file__).parent.parent / "notebooks" / "09_team_problem.ipynb"
CONFIG = Config()


def ball(alpha):
    return CONFIG.r_min + CONFIG.beta1 * np.exp(-CONFIG.beta2 * alpha)


@pytest.fixture(scope="module")
def stored():
    """The functions of the notebook's solutions."""
    names = {"np": np, "math": math, "config": CONFIG}
    for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]:
        if "solution" in cell["metadata"].get("tags", ()):
            exec("".join(cell["source"]), names)
    return names


WRONG = {
    "team": [
        (lambda g, c: sum(g[k, k, m] for k, m in enumerate(c)), "its own map only"),
        (lambda g, c: sum(g[i, :, m].sum() for i, m in enumerate(c)), "maps and views are mixed up"),
        (lambda g, c: np.mean([g[:, k, m].sum() for k, m in enumerate(c)]), "that is a mean"),
        (lambda g, c: g.max(2).sum(), "one camera"),
        (lambda g, c: g.sum(0).max(1).sum(), "the yaws are given"),
        (lambda g, c: g[:, :, c].sum(), "one of its own"),
    ],
    "radii": [
        (lambda r: ball(r.max(0)), "the safest map"),
        (lambda r: ball(r).min(0), "the safest map"),
        (lambda r: ball(r.mean(0)), "a mean belongs to no map"),
        (lambda r: ball(r).sum(0), "do not add up"),
        (lambda r: CONFIG.r_min + CONFIG.beta1 * np.exp(CONFIG.beta2 * r.min(0)), "look at the sign"),
        (lambda r: ball(r.min(1)), "one a robot"),
        (lambda r: r.min(0), "the radii are wanted"),
    ],
    "sides": [
        (lambda w, o, c: (w[c].sum(), w[o].sum()), "wrong order"),
        (lambda w, o, c: (w[o].sum(), w.sum()), "the centre has a zone too"),
        (lambda w, o, c: (w[o].sum(), w[c & ~o].sum()), "also counts what the owner counts"),
        (lambda w, o, c: (w[o].mean(), w[c].mean()), "not a mean"),
        (lambda w, o, c: w[o].sum(), "shape () where (2,) is wanted"),
    ],
    "look": [
        (lambda: (2.5, 0.0, math.pi), "does its camera show it?"),
        (lambda: (3.0, 0.0, 0.0), "does its camera show it?"),
        (lambda: (3.0, 1.0, -math.pi / 2), "learned other things"),
        (lambda: (2.5, 0.0), "it stops with ValueError"),
    ],
}


@pytest.mark.parametrize("name", WRONG)
def test_the_stored_solution_agrees_and_an_empty_one_is_to_do(name, stored, capsys):
    assert getattr(team_problem, name)(stored[f"my_{name}"])
    assert capsys.readouterr().out.strip() == "agrees with the library"
    for empty in (None, ...):
        assert not getattr(team_problem, name)(lambda *case, empty=empty: empty)
        assert capsys.readouterr().out.strip() == "to do"


@pytest.mark.parametrize(("name", "mine", "hint"), [(name, *pair) for name, pairs in WRONG.items() for pair in pairs])
def test_a_wrong_answer_is_told_what_is_wrong(name, mine, hint, capsys):
    assert not getattr(team_problem, name)(mine)
    assert hint in capsys.readouterr().out
