"""The checkers of notebook 10: what they say to right, empty and plausible wrong answers."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import optimize

from mannbv import consensus, geometry
from mannbv.course.check import consensus as check

NOTEBOOK = Path(__file__).parent.parent / "notebooks" / "10_consensus.ipynb"
EXERCISES = ("residuals", "middle", "edge", "slope", "solver")


def stored_solutions():
    """The functions of the notebook's solution cells, by exercise."""
    space = {"np": np, "geometry": geometry, "consensus": consensus}
    for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]:
        if "solution" in cell["metadata"].get("tags", ()):
            exec("".join(cell["source"]), space)
    return {name: space[f"my_{name}"] for name in EXERCISES}


@pytest.mark.parametrize("exercise", EXERCISES)
def test_the_stored_solution_agrees(capsys, exercise):
    assert getattr(check, exercise)(stored_solutions()[exercise])
    said = capsys.readouterr().out
    assert said.startswith("agrees with the library" if exercise != "solver" else "agrees better than own views")


@pytest.mark.parametrize("exercise", EXERCISES)
def test_an_empty_answer_is_still_to_do(capsys, exercise):
    assert not getattr(check, exercise)(lambda *_: ...)
    assert capsys.readouterr().out == "to do\n"


wrap = geometry.wrap


def own_view(gains, graph, announced, settings):
    return announced


def least(gains, graph, announced, settings):
    return consensus.grid(72)[gains.sum(0).argmin(-1)]


def in_degrees(gains, graph, announced, settings):
    return np.degrees(consensus.solve(gains, graph, announced, "profile")[-1].yaws)


def one_yaw(gains, graph, announced, settings):
    return announced[0]


def broken(*_):
    raise KeyError("robot 7")


@pytest.mark.parametrize(
    ("exercise", "wrong", "words"),
    [
        ("residuals", lambda t, z, b, r: (r * abs(z - b).max(), abs(t - z).max()), "swapped"),
        ("residuals", lambda t, z, b, r: (abs(t - z).max(), abs(z - b).max()), "a stiffer team moves by less"),
        ("residuals", lambda t, z, b, r: (np.sqrt(((t - z) ** 2).sum()), r * np.sqrt(((z - b) ** 2).sum())), "a norm"),
        ("residuals", lambda t, z, b, r: (np.max(t - z), r * np.max(z - b)), "its size that counts"),
        ("residuals", lambda t, z, b, r: (abs(t - z).max(), r * abs(t - b).max()), "not T but z"),
        ("middle", lambda a, b, o: 0.5 * (a + b), "the literal form"),
        ("middle", lambda a, b, o: o + (wrap(a - o) + wrap(b - o)) / 2, "has left [−π, π)"),
        ("middle", lambda a, b, o: (wrap(a - o) + wrap(b - o)) / 2, "which yaw is it counted from"),
        ("middle", lambda a, b, o: np.angle(np.exp(1j * a) + np.exp(1j * b)), "the shorter way"),
        ("edge", lambda a, b, p, q, r: (a + b) / 2, "right only where the two duals cancel"),
        ("edge", lambda a, b, p, q, r: (a + b) / 2 - (p + q) / (2 * r), "the sign"),
        ("edge", lambda a, b, p, q, r: (a + p / r + b + q / r) - (a + b) / 2, "push too hard"),
        ("edge", lambda a, b, p, q, r: (a + b) / 2 + (p - q) / (2 * r), "the same way"),
        ("edge", lambda a, b, p, q, r: (a + b) / 2 + r / 2 * (p + q), "a stiffer spring yields less"),
        ("slope", lambda t, g, z, y, r: g + y.sum(0) + r * (t - z).sum(0), "the sign of the gain"),
        ("slope", lambda t, g, z, y, r: g - y.sum(0) - r * (t - z).sum(0), "the way down"),
        ("slope", lambda t, g, z, y, r: -g + r * (t - z).sum(0), "the duals are missing"),
        ("slope", lambda t, g, z, y, r: -g - y.sum(0) + r * (t - z).sum(0), "the sign of the duals"),
        ("slope", lambda t, g, z, y, r: -g + y.sum(0) + r / 2 * (t - z).sum(0), "the slope of a square"),
        ("slope", lambda t, g, z, y, r: -g + y.mean(0) + r * (t - z).mean(0), "adds up the neighbours"),
        ("slope", lambda t, g, z, y, r: -g + (y + r * (t - z)), "shape (2, 3) where (3,) is wanted"),
        ("solver", own_view, "just everyone's own view"),
        ("solver", least, "worse than everyone's own view"),
        ("solver", in_degrees, "in radians"),
        ("solver", one_yaw, "one finite yaw a robot"),
        ("solver", broken, "it stops with KeyError"),
    ],
)
def test_a_plausible_mistake_is_named(capsys, exercise, wrong, words):
    assert not getattr(check, exercise)(wrong)
    said = capsys.readouterr().out
    assert words in said
    assert said.count("\n") == 1


def test_the_truth_of_each_check_is_the_library_or_a_scan():
    rng = np.random.default_rng(0)
    state = consensus.start(0, [1, 2], rng.uniform(-3, 3, 3), rng.normal(size=(3, 24)), penalty=0.4)
    for _ in range(2):
        before, state = state, consensus.step(state, {1: rng.normal(size=3), 2: rng.normal(size=3)})
    told = state.primal_residual, state.dual_residual
    assert check._residuals(state.agreed, state.edge, before.edge, before.penalty) == pytest.approx(told)
    # z: the least of the terms of Eq. (26) that hold it
    a, b, p, q, rho = rng.normal(size=5)
    rho = abs(rho)

    def link(z):
        return p * (a - z) + rho / 2 * (a - z) ** 2 + q * (b - z) + rho / 2 * (b - z) ** 2

    assert check._edge(a, b, p, q, rho) == pytest.approx(optimize.minimize_scalar(link).x, abs=1e-6)
    # the slope: finite differences of what Eq. (27) minimises, for F = c · T
    copies, c, edge, dual = rng.normal(size=3), rng.normal(size=3), rng.normal(size=(2, 3)), rng.normal(size=(2, 3))

    def energy(t):
        return -c @ t + (dual * (t - edge)).sum() + rho / 2 * ((t - edge) ** 2).sum()

    found = optimize.approx_fprime(copies, energy, 1e-7)
    np.testing.assert_allclose(check._slope(copies, c, edge, dual, rho), found, atol=1e-5)
    # the middle: offsets by another way than the library's wrap
    turns = np.angle(np.exp(1j * (np.array([2.8, -2.6]) - 0.2)))
    assert check._middle(2.8, -2.6, 0.2) == pytest.approx(np.angle(np.exp(1j * (0.2 + turns.mean()))))


def test_made_up_gains_hold_less_in_the_maps_of_teammates():
    gains = check.hilly(np.random.default_rng(0), 6)
    assert gains.shape == (6, 6, 72)
    assert gains.min() > 0
    own = np.eye(6, dtype=bool)
    assert gains[own].mean() > 1.5 * gains[~own].mean()


def test_the_general_z_forgives_any_first_duals_and_the_mean_does_not():
    rng = np.random.default_rng(1)
    wish, weight, first = rng.normal(size=2), rng.uniform(0.5, 2, 2), rng.normal(size=2)
    best = (weight * wish).sum() / weight.sum()

    def reached(middle):
        z, dual = 0.0, first
        for _ in range(200):
            copies = (weight * wish + z - dual) / (weight + 1)  # Eq. (27) with a penalty of 1
            z = middle(*copies, *dual, 1.0)
            dual = dual + copies - z
        return copies

    np.testing.assert_allclose(reached(stored_solutions()["edge"]), best, atol=1e-9)
    assert np.abs(reached(lambda a, b, p, q, r: (a + b) / 2) - best).min() > 0.05
