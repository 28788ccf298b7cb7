"""The explorer of C-ADMM: what it draws against rounds played robot by robot, and optima found by brute force."""

import importlib
import math

import numpy as np
import pytest

from mannbv import consensus, geometry, network
from mannbv.course import widgets

module = importlib.import_module("mannbv.course.widgets.consensus")  # the package's name of it is the explorer
CAPTION, RINGS, LINKS, RESIDUALS, SHARE = range(5)


@pytest.fixture(scope="module")
def explorer():
    return widgets.agreement()


def shown(explorer, **values):
    """Panels and line for some settings, and all of them."""
    values = explorer.values | values
    return *explorer.picture(**values), values


def points(panel, kind):
    """The points of every item of a kind in a panel."""
    return [
        np.frombuffer(i["points"], np.float32).reshape(-1, 2).astype(float) for i in panel["items"] if i["kind"] == kind
    ]


def centers(panel):
    return np.array([item["at"] for item in panel["items"] if item["kind"] == "text"])


def by_hand(values):
    """Copies (N, N) [rad] and the primal residual after each round, from the robots' own steps and their mail."""
    gains, announced = module._wishes(values["team"], values["n_robots"], values["seed"])
    graph = network.build(values["graph"], values["n_robots"])
    scale, n = np.abs(gains).max(), len(gains)
    states = [
        consensus.start(i, list(graph[i]), announced, gains[i] / scale, penalty=values["penalty"]) for i in range(n)
    ]
    played = [(np.array([s.yaws for s in states]), math.inf)]
    for _ in range(values["round_"]):
        sent = [s.copies for s in states]
        apart = max(np.abs(sent[i] - sent[j]).max() / 2 for i, j in graph.edges)  # z is in the middle
        states = [consensus.step(s, {j: sent[j] for j in s.neighbours}) for s in states]
        played.append((np.array([s.yaws for s in states]), apart))
    return played


def brute(gains):
    """The best of 7200 yaws for each view, and what the team gains there, by numpy's own interpolation."""
    fine = np.linspace(-np.pi, np.pi, 7200, endpoint=False)
    nodes = np.linspace(-np.pi, np.pi, gains.shape[-1] + 1)
    table = np.array([np.interp(fine, nodes, np.append(row, row[0])) for row in gains.sum(0)])
    return fine[table.argmax(1)], table.max(1).sum()


@pytest.mark.parametrize(
    "values", [{"round_": 7}, {"round_": 20, "n_robots": 7, "graph": "star", "seed": 2, "team": "anywhere"}]
)
def test_copies_and_residuals_are_those_of_robots_that_step_by_themselves(explorer, values):
    panels, says, values = shown(explorer, **values)
    played, n = by_hand(values), values["n_robots"]
    dots = points(panels[RINGS], "dots")
    assert len(dots) == n
    middle = centers(panels[RINGS])
    for i, copies in enumerate(dots):  # an item a robot, a dot a ring
        away = copies - middle
        drawn = np.arctan2(away[:, 1], away[:, 0])
        assert np.abs(geometry.wrap(drawn - played[-1][0][i])).max() < 1e-4
        assert (np.linalg.norm(away, axis=1) < 1).all()
    _, primal, _, _ = points(panels[RESIDUALS], "line")
    assert np.allclose(10 ** primal[: values["round_"], 1], [apart for _, apart in played[1:]], rtol=1e-3)
    assert f"residuals {played[-1][1]:.3f} rad" in says and says.startswith(f"round {values['round_']}: they do not")


@pytest.mark.parametrize(("n_robots", "seed"), [(4, 6), (3, 1), (8, 3)])
def test_the_mark_is_the_best_yaw_and_shares_are_of_its_gain(explorer, n_robots, seed):
    panels, says, values = shown(explorer, n_robots=n_robots, seed=seed, round_=5)
    gains, _ = module._wishes("hills", n_robots, seed)
    best, most = brute(gains)
    marks = points(panels[RINGS], "line")[3].reshape(n_robots, 3, 2)[:, 1] - centers(panels[RINGS])
    assert np.abs(geometry.wrap(np.arctan2(marks[:, 1], marks[:, 0]) - best)).max() < 0.01
    copies = by_hand(values)[-1][0]
    share = consensus.value(gains, np.diagonal(copies)) / most  # each robot takes its own copy of its own yaw
    curve = points(panels[SHARE], "line")[1]
    assert math.isclose(curve[5, 1], share, abs_tol=1e-3) and f"{share:.1%}" in says
    assert curve[:, 1].max() <= 1 + 1e-6  # drawn in single precision


def test_the_rim_rises_with_the_teams_gain(explorer):
    panels, _, _ = shown(explorer)
    gains, _ = module._wishes("hills", 4, explorer.values["seed"])
    rim = points(panels[RINGS], "line")[0].reshape(4, -1, 2)[:, :72] - centers(panels[RINGS])[:, None]
    height = np.linalg.norm(rim, axis=2) - module._RIM
    assert np.allclose(height / height.max(), gains.sum(0) / gains.sum(0).max(), atol=1e-4)
    assert np.allclose(np.arctan2(rim[0, :, 1], rim[0, :, 0])[1:], consensus.grid(72)[1:], atol=1e-5)


@pytest.mark.parametrize("graph", network.GRAPHS)
@pytest.mark.parametrize("n_robots", [3, 6])
def test_the_links_are_the_graphs(explorer, graph, n_robots):
    panels, _, _ = shown(explorer, graph=graph, n_robots=n_robots)
    at = np.concatenate(points(panels[LINKS], "dots"))
    ends = [{int(np.linalg.norm(at - end, axis=1).argmin()) for end in line} for line in points(panels[LINKS], "line")]
    assert {frozenset(pair) for pair in ends} == {frozenset(edge) for edge in network.build(graph, n_robots).edges}
    assert np.linalg.norm(at[:, None] - at, axis=-1)[np.triu_indices(n_robots, 1)].min() > 0.5


def test_the_literal_form_meets_at_the_worst_yaw_unless_one_side_outvotes_the_other(explorer):
    for solver, n_robots, share in (("cadmm-literal", 4, 0), ("cadmm", 4, 1), ("cadmm-literal", 5, 1)):
        panels, says, _ = shown(explorer, team="seam", solver=solver, n_robots=n_robots, round_=50)
        assert "they agree" in says
        assert abs(points(panels[SHARE], "line")[1][-1, 1] - share) < 0.01
        away = np.concatenate(points(panels[RINGS], "dots")) - np.tile(centers(panels[RINGS]), (n_robots, 1))
        assert (np.sign(away[:, 0]) == 1 - 2 * share).all()  # at 0, or at ±π


def test_copies_wound_around_the_circle_unwind(explorer):
    first, says, _ = shown(explorer, team="wound", n_robots=5)
    turned = np.concatenate([copies[:1] for copies in points(first[RINGS], "dots")]) - centers(first[RINGS])[0]
    yaws = np.arctan2(turned[:, 1], turned[:, 0])
    assert np.abs(geometry.wrap(np.diff(yaws) - 2 * np.pi / 5)).max() < 1e-4
    assert "there is nothing to gain" in says
    assert np.isnan(points(first[RINGS], "line")[3]).all()  # so no yaw is the best
    assert "they agree" in shown(explorer, team="wound", n_robots=5, round_=50)[1]


@pytest.mark.parametrize("solver", ["own", "profile"])
def test_who_plays_no_rounds_has_no_residuals(explorer, solver):
    panels, says, _ = shown(explorer, solver=solver, round_=9)
    assert says.startswith(f"{solver}: no rounds") and all(not len(p) for p in points(panels[RESIDUALS], "dots"))
    gains, _ = module._wishes("hills", 4, explorer.values["seed"])
    own = consensus.grid(72)[np.einsum("kkm->km", gains).argmax(1)]
    reached = consensus.value(gains, own) / brute(gains)[1]
    share = points(panels[SHARE], "line")[1][0, 1]
    assert abs(share - reached) < 0.02 if solver == "own" else share > 0.99 > reached


def test_a_solver_that_ends_apart_says_so(explorer):
    _, says, _ = shown(explorer, penalty=0.0125, n_robots=8, graph="line", round_=50)
    assert "the rounds are over, and they do not agree" in says


def test_moving_the_round_plays_nothing_anew(explorer):
    explorer.move(round_=1)
    before = module._played.cache_info().misses
    for number in (3, 30, 50, 0):
        explorer.move(round_=number)
    assert module._played.cache_info().misses == before
