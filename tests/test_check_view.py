"""What the checkers of notebook 06 say to its solutions and to plausible wrong answers."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.signal import find_peaks

from mannbv.course.check import one_view as check

NOTEBOOK = Path(__file__).parent.parent / "notebooks" / "06_one_view.ipynb"


def solutions() -> dict:
    """What the cells tagged `solution` define."""
    names = {"math": math, "np": np, "torch": torch}
    for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]:
        if "solution" in cell["metadata"].get("tags", ()):
            exec("".join(cell["source"]), names)
    return names


@pytest.mark.parametrize(
    ("name", "praise"),
    [
        ("gain", "agrees with the library"),
        ("maxima", "agrees with the library"),
        ("slope", "agrees with the library"),
        ("search", "within the budget"),
    ],
)
def test_the_stored_solution_agrees_and_an_empty_one_is_to_do(capsys, name, praise):
    assert getattr(check, name)(solutions()[f"my_{name}"])
    assert capsys.readouterr().out.startswith(praise)
    for nothing in (None, ...):
        assert not getattr(check, name)(lambda *args, nothing=nothing: nothing)
        assert capsys.readouterr().out.strip() == "to do"


def best_of(gain_at, yaws):
    return max(yaws, key=gain_at)


def uniform(gain_at, budget):
    return best_of(gain_at, np.linspace(-math.pi, math.pi, budget, endpoint=False))


def hills(gains):
    """As the notebook counts them."""
    return len(find_peaks(np.roll(gains, -int(gains.argmin())), prominence=0.05 * gains.max())[0])


def climb(gain_at, budget):
    """One start, then uphill."""
    yaw, step = 0.0, 0.2
    for _ in range(budget // 3):
        here, left, right = gain_at(yaw), gain_at(yaw + step), gain_at(yaw - step)
        if max(left, right) <= here:
            step /= 2
        else:
            yaw += step if left > right else -step
    return yaw


@pytest.mark.parametrize(
    ("name", "wrong", "hint"),
    [
        ("gain", lambda h, H, v, zone, d: (h / (H + d))[zone].sum(), "the weights do nothing"),
        ("gain", lambda h, H, v, zone, d: ((v * h.T).T / (v * (H + d).T).T)[zone].sum(), "the weights do nothing"),
        ("gain", lambda h, H, v, zone, d: ((v * h.T).T / (H + d)).sum(), "outside the zone"),
        ("gain", lambda h, H, v, zone, d: ((v * h.T).T / (H + d))[~zone].sum(), "inside out"),
        ("gain", lambda h, H, v, zone, d: ((v * h.T).T / ((v * H.T).T + d))[zone].sum(), "the weight divides too"),
        ("gain", lambda h, H, v, zone, d: ((v * h.T).T / H)[zone].sum(), "no λ"),
        ("gain", lambda h, H, v, zone, d: ((v * h.T).T / (H + d))[zone].mean(), "the trace is a sum"),
        ("gain", lambda h, H, v, zone, d: (h / ((v * H.T).T + d))[zone].sum(), "not to what is known"),
        ("gain", lambda h, H, v, zone, d: ((v * h.T).T / (H + d))[zone].sum() / v[zone].sum(), "does not divide"),
        ("gain", lambda h, H, v, zone, d: ((v**2 * h.T).T / (H + d))[zone].sum(), "counts twice"),
        ("maxima", lambda g: sum(b > max(a, c) for a, b, c in zip(g, g[1:], g[2:], strict=False)), "form a circle"),
        (
            "maxima",
            lambda g: int((np.diff(np.sign(np.diff(g, prepend=-1, append=-1))) < 0).sum()),
            "compared with one neighbour only",
        ),
        (
            "maxima",
            lambda g: int((np.sign(g - np.roll(g, 1)) != np.sign(np.roll(g, -1) - g)).sum()),
            "too many: are valleys",
        ),
        ("maxima", lambda g: int(((g >= np.roll(g, 1)) & (g >= np.roll(g, -1))).sum()), "a flat stretch"),
        ("maxima", hills, "only hills"),
        ("maxima", lambda g: int((g > np.roll(g, 1)).sum()), "and the next?"),
        ("maxima", lambda g: int((g > np.roll(g, -1)).sum()), "and the one before?"),
        ("maxima", lambda g: int(((g < np.roll(g, 1)) & (g < np.roll(g, -1))).sum()), "the valleys"),
        ("maxima", lambda g: g[g > 2], "where one number is wanted"),
        ("maxima", lambda g: 0, "too small for g = [3, 1, 2, 0, 1, 0]"),
        ("maxima", np.argmax, "the place of the largest"),
        ("slope", lambda f, yaw: (f(yaw) - f(yaw + 1e-4)) / 1e-4, "downhill"),
        ("slope", lambda f, yaw: (f(yaw + 1e-4) - f(yaw - 1e-4)) / 1e-4, "twice too much"),
        ("slope", lambda f, yaw: (f(yaw + 1e-4) - f(yaw)) / 2e-4, "half of it"),
        ("slope", lambda f, yaw: (f(yaw + 1e-4) - f(yaw - 1e-4)) / math.degrees(2e-4), "per degree"),
        ("slope", lambda f, yaw: f(yaw), "that is the gain"),
        ("slope", lambda f, yaw: f(yaw + 1e-4) - f(yaw - 1e-4), "over which angle"),
        ("slope", lambda f, yaw: 0.9 * (f(yaw + 1e-4) - f(yaw - 1e-4)) / 2e-4, "not steep enough in case 1 of 3"),
        ("slope", lambda f, yaw: 1.3 * (f(yaw + 1e-4) - f(yaw - 1e-4)) / 2e-4, "too steep in case 1 of 3"),
        ("slope", lambda f, yaw: (f(yaw + 0.0873) - f(yaw - 0.0873)) / 0.1746, "bends within 0.17 rad"),
        ("slope", lambda f, yaw: (f(yaw + 1.0) - f(yaw - 1.0)) / 2, "bends within 2 rad"),
        ("slope", lambda f, yaw: (f(yaw + 1e-17) - f(yaw)) / 1e-17, "lost in rounding"),
        ("search", uniform, "keep some views for a closer look"),
        ("search", lambda f, budget: f(uniform(f, budget - 1)), "that is a gain"),
        ("search", lambda f, budget: int(np.argmax([f(yaw) for yaw in np.linspace(0, 6, budget)])), "an index"),
        ("search", lambda f, budget: [0.0, 1.0], "one yaw is wanted"),
        ("search", lambda f, budget: math.nan, "not finite"),
        ("search", lambda f, budget: f(np.zeros(budget)), "one way at a time"),
        ("search", climb, "on which hill does it start"),
        ("search", lambda f, budget: best_of(f, np.linspace(-3.1, 3.1, 5)), "on which hill does it start"),
        ("search", lambda f, budget: best_of(f, np.linspace(-3.1, 3.1, 360)), "360 views, but only 40 are allowed"),
        ("search", lambda f, budget: 20 + np.degrees(best_of(f, np.linspace(0, 3, 9))), "in degrees"),
        ("search", lambda f, budget: f.best, "it stops with AttributeError"),
    ],
)
def test_a_wrong_answer_gets_its_hint(capsys, name, wrong, hint):
    assert not getattr(check, name)(wrong)
    assert hint in capsys.readouterr().out
