import dataclasses
import inspect
import pickle

import networkx as nx
import numpy as np
import pytest
from scipy import optimize

from mannbv import consensus, network

GRAPHS = ["complete", "ring", "star", "line"]
CADMMS = "cadmm", "cadmm-gradient", "cadmm-stochastic"
N = 4


def circular(difference):
    """Size of an angle's distance from 0, by another way than the library's."""
    return np.abs(np.angle(np.exp(1j * np.asarray(difference))))


class Quadratic:
    """−½ (T − a)ᵀ Q (T − a), with its gradient."""

    def __init__(self, stiffness, best):
        self.stiffness, self.best = stiffness, best

    def __call__(self, yaws):
        return -0.5 * (yaws - self.best) @ self.stiffness @ (yaws - self.best)

    def gradient(self, yaws):
        return -self.stiffness @ (yaws - self.best)


def quadratics(rng, n=N):
    """N concave quadratics and the team's optimum in closed form, (Σ Q)⁻¹ Σ Q a."""
    roots = rng.normal(size=(n, n, n))
    stiff = roots @ roots.transpose(0, 2, 1) / n + 0.2 * np.eye(n)
    best = rng.uniform(-1, 1, (n, n))
    team = np.linalg.solve(stiff.sum(0), np.einsum("ikl,il->k", stiff, best))
    return [Quadratic(q, a) for q, a in zip(stiff, best, strict=True)], team


def bumps(rng, n=5, n_yaws=360):
    """Smooth periodic gains (N, N, M): three von Mises bumps a profile; strangers' maps know less of one's view."""
    heights = rng.exponential(size=(n, n, 3)) * np.where(np.eye(n), 1, rng.uniform(0, 0.8, (n, n)))[..., None]
    centers = rng.uniform(-np.pi, np.pi, (n, n, 3))
    yaws = -np.pi + 2 * np.pi * np.arange(n_yaws) / n_yaws
    return np.einsum("ikb,ikbm->ikm", heights, np.exp(4 * (np.cos(yaws - centers[..., None]) - 1)))


PRECISE = {"penalty": 1.0, "growth": 1.0, "rounds": 400, "tolerance": 1e-6}


@pytest.mark.parametrize("graph", GRAPHS)
@pytest.mark.parametrize("solver", ["cadmm", "cadmm-gradient"])
def test_quadratics_reach_the_closed_form_on_every_graph(solver, graph):
    rng = np.random.default_rng(1)
    functions, team = quadratics(rng)
    trace = consensus.solve(functions, network.build(graph, N), rng.uniform(-1, 1, N), solver, **PRECISE)
    np.testing.assert_allclose(trace[-1].copies, np.tile(team, (N, 1)), atol=2e-5)
    np.testing.assert_allclose(trace[-1].yaws, team, atol=2e-5)


def test_stochastic_steps_hover_around_the_closed_form():
    rng = np.random.default_rng(1)
    functions, team = quadratics(rng)
    settings = PRECISE | {"rate": 0.02, "steps": 20}
    start, graph = rng.uniform(-1, 1, N), network.build("complete", N)
    trace = consensus.solve(functions, graph, start, "cadmm-stochastic", rng=rng, **settings)
    late = np.stack([at.copies for at in trace[100:]])
    np.testing.assert_allclose(late.mean(0), np.tile(team, (N, 1)), atol=0.02)
    assert 1e-3 < late.std(0).mean() < 0.1


def test_a_stochastic_step_looks_at_one_view_and_is_right_on_average():
    """From copies, links and duals alike: the mean of all N steps that may be drawn is the step of the gradient."""
    rng, n = np.random.default_rng(2), 4
    gains, theirs = bumps(rng, n), {j: rng.normal(size=n) for j in (1, 2)}
    still = consensus.CADMM(primal="gradient", steps=0)
    state = still.step(still.start(3, [1, 2], rng.uniform(-3, 3, n), gains[3]), theirs)
    state = dataclasses.replace(state, copies=state.copies + 0.1 * rng.normal(size=n))
    gradient = consensus.CADMM(primal="gradient", steps=1, rate=0.3 / np.sqrt(3))  # of the third primal update
    sure = gradient.step(state, theirs).copies
    nothing = dataclasses.replace(state.objective, gains=np.zeros((n, 360)))
    pulled = gradient.step(dataclasses.replace(state, objective=nothing), theirs)
    solvers = [consensus.CADMM(primal="stochastic", steps=1, rate=0.3, seed=(s,)) for s in range(400)]
    drawn = [solver.step(state, theirs).copies for solver in solvers]
    outcomes, counts = np.unique(np.round(drawn, 12), axis=0, return_counts=True)
    assert len(outcomes) == n and counts.min() > 60
    np.testing.assert_allclose(outcomes.mean(0), sure, atol=1e-11)
    assert ((np.abs(outcomes - pulled.copies) > 1e-9).sum(1) == 1).all()


def test_what_a_stochastic_step_draws_hangs_on_seed_robot_and_round_alone():
    rng = np.random.default_rng(3)
    gains, graph = bumps(rng), network.build("ring", 5)
    settings = {"announced": np.zeros(5), "rounds": 6, "primal": "stochastic"}
    states = [list(play(gains, graph, seed=seed, **settings))[-1] for seed in ((7, 1), (7, 1), (7, 2))]
    copies = [np.stack([state.copies for state in team]) for team in states]
    assert np.array_equal(copies[0], copies[1]) and not np.allclose(copies[0], copies[2])
    solver, state = consensus.CADMM(primal="stochastic", seed=(7, 1)), states[0][2]
    thawed, inbox = pickle.loads(pickle.dumps(state)), {1: copies[0][1], 3: copies[0][3]}
    assert np.array_equal(solver.step(thawed, inbox).copies, solver.step(state, inbox).copies)
    assert not any(isinstance(value, np.random.Generator) for value in vars(state).values())
    still = [dataclasses.replace(state, round=number, copies=0 * state.copies) for number in range(40)]
    steps = np.stack([solver.step(at, {}).copies for at in still])
    assert len(np.unique(steps, axis=0)) > 10  # every round draws anew
    by = [consensus.solve(gains, graph, np.zeros(5), "cadmm-stochastic", rng=np.random.default_rng(s))[-1].yaws
          for s in (4, 4, 5)]  # fmt: skip
    assert np.array_equal(by[0], by[1]) and not np.allclose(by[0], by[2])


def test_quadratics_without_gradients_and_with_default_settings():
    rng = np.random.default_rng(2)
    functions, team = quadratics(rng)
    bare = [lambda yaws, f=f: f(yaws) for f in functions]
    ring = network.build("ring", N)
    trace = consensus.solve(bare, ring, rng.uniform(-1, 1, N), **PRECISE)
    np.testing.assert_allclose(trace[-1].yaws, team, atol=2e-5)
    trace = consensus.solve(functions, ring, rng.uniform(-1, 1, N))
    np.testing.assert_allclose(trace[-1].yaws, team, atol=0.05)
    np.testing.assert_allclose(consensus.solve(functions, ring, np.zeros(N), "optimum")[-1].yaws, team, atol=1e-7)


def test_far_from_pi_the_literal_form_does_the_same():
    functions, _ = quadratics(np.random.default_rng(3))
    graph, start = network.build("line", N), np.zeros(N)
    circle, literal = (consensus.solve(functions, graph, start, name) for name in ("cadmm", "cadmm-literal"))
    np.testing.assert_allclose(circle[-1].copies, literal[-1].copies, atol=1e-4)


def test_the_mean_of_everyones_own_best_is_not_the_closed_form():
    rng = np.random.default_rng(1)
    functions, team = quadratics(rng)
    assert np.abs(np.mean([f.best for f in functions], 0) - team).max() > 0.05


def play(objectives, graph, announced, rounds, scale=1.0, **settings):
    """Rounds of start and step by hand; yields every robot's state after each."""
    solver = consensus.CADMM(**settings)
    states = [solver.start(i, list(graph[i]), announced, objectives[i], scale=scale) for i in sorted(graph)]
    for _ in range(rounds):
        sent = [state.copies for state in states]
        states = [solver.step(s, {j: sent[j] for j in s.neighbours}) for s in states]
        yield states


@pytest.mark.parametrize("graph", GRAPHS)
@pytest.mark.parametrize("circle", [True, False])
def test_duals_of_a_link_cancel_and_its_ends_hold_the_same_z_in_every_round(graph, circle):
    rng = np.random.default_rng(3)
    graph, objectives = network.build(graph, 5), bumps(rng)
    for states in play(objectives, graph, rng.uniform(-3, 3, 5), 30, circle=circle):
        for i, j in graph.edges:
            at_i, at_j = states[i].neighbours.index(j), states[j].neighbours.index(i)
            np.testing.assert_allclose(states[i].dual[at_i] + states[j].dual[at_j], 0, atol=1e-12)
            assert np.array_equal(states[i].edge[at_i], states[j].edge[at_j])
    assert max(np.abs(state.dual).max() for state in states) > 0.1


def test_one_round_is_equations_27_to_29():
    rng = np.random.default_rng(4)
    announced, received = rng.uniform(-3, 3, 3), rng.normal(size=3)
    first = consensus.start(0, [1, 2], announced, np.zeros((3, 8)), penalty=0.3, growth=2.0)
    np.testing.assert_allclose(first.copies, 0, atol=1e-15)
    second = consensus.step(first, {1: received, 2: np.zeros(3)})
    z = received / 2
    np.testing.assert_allclose(second.edge, [z, np.zeros(3)], atol=1e-15)
    np.testing.assert_allclose(second.dual, [-0.3 * z, np.zeros(3)], atol=1e-15)
    assert second.primal_residual == pytest.approx(np.abs(z).max())
    assert second.dual_residual == pytest.approx(0.3 * np.abs(z).max())
    assert second.penalty == pytest.approx(0.6)
    # F = 0: the primal is the minimiser of the quadratic, mean z − Σλ / (ρ · 2)
    np.testing.assert_allclose(second.copies, z / 2 + 0.3 * z / (0.6 * 2), atol=1e-12)


def test_start_and_step_by_name_are_those_of_the_solver_and_remember_it():
    rng = np.random.default_rng(20)
    gains, announced, inbox = rng.normal(size=(3, 24)), rng.uniform(-3, 3, 3), {1: rng.normal(size=3)}
    for settings in ({}, {"penalty": 0.3, "growth": 2.0, "primal": "gradient", "circle": False}):
        solver = consensus.CADMM(**settings)
        ours = solver.step(solver.step(solver.start(0, [1, 2], announced, gains), inbox), inbox)
        first = consensus.start(0, [1, 2], announced, gains, **settings)
        by_name = consensus.step(consensus.step(first, inbox), inbox)
        handed = consensus.step(consensus.step(solver.start(0, [1, 2], announced, gains), inbox, solver), inbox, solver)
        for other in (by_name, handed):
            for field in dataclasses.fields(ours):
                if field.name != "objective":
                    np.testing.assert_array_equal(getattr(other, field.name), getattr(ours, field.name))


def test_a_state_holds_no_settings_and_lives_on_as_bytes():
    rng, settings = np.random.default_rng(21), {f.name for f in dataclasses.fields(consensus.CADMM)}
    assert settings & {f.name for f in dataclasses.fields(consensus.Agreement)} == {
        "penalty"
    }  # ρ of the round: it grows
    graph, objectives, announced = network.build("ring", 4), bumps(rng, 4, 36), rng.uniform(-3, 3, 4)
    solver = consensus.CADMM()
    states = [solver.start(i, list(graph[i]), announced, objectives[i]) for i in range(4)]

    def by_post(outbox):
        for i, state in enumerate(states):
            states[i] = pickle.loads(pickle.dumps(state))
        return {i: {note.sender: note.offsets for note in outbox if note.receiver == i} for i in range(4)}

    *_, last = consensus.exchange(solver, states, by_post, rounds=9, tolerance=0)
    states = [solver.start(i, list(graph[i]), announced, objectives[i]) for i in range(4)]
    for _ in range(9):
        outbox = [note for state in states for note in state.outbox]
        states = [pickle.loads(pickle.dumps(state)) for state in states]
        states = [solver.step(s, {n.sender: n.offsets for n in outbox if n.receiver == s.robot}) for s in states]
    for one, other in zip(last, states, strict=True):
        np.testing.assert_array_equal(one.copies, other.copies)
        np.testing.assert_array_equal(one.dual, other.dual)
    assert last[0].round == 9


def test_an_exchange_hears_only_what_is_delivered():
    graph, objectives, announced = network.build("line", 3), bumps(np.random.default_rng(22), 3), np.zeros(3)
    solver, seen = consensus.CADMM(), []

    def deaf(outbox):
        seen.append([(note.sender, note.receiver, note.round) for note in outbox])
        return {}

    states = [solver.start(i, list(graph[i]), announced, objectives[i]) for i in range(3)]
    *_, last = consensus.exchange(solver, states, deaf, rounds=2)
    assert seen == [[(0, 1, t), (1, 0, t), (1, 2, t), (2, 1, t)] for t in range(2)]
    for before, after in zip(states, last, strict=True):
        np.testing.assert_array_equal(after.edge, before.edge)
        assert not after.dual.any()
    assert len(list(consensus.exchange(solver, states, deaf, rounds=0))) == 1


def test_solve_is_the_loop_over_steps():
    rng = np.random.default_rng(5)
    graph, objectives, announced = network.build("star", 5), bumps(rng), rng.uniform(-3, 3, 5)
    trace = consensus.solve(objectives, graph, announced, rounds=12, tolerance=0)
    *_, states = play(objectives, graph, announced, 12, scale=consensus.scale_of(objectives))
    assert len(trace) == 13
    for i in range(5):
        np.testing.assert_array_equal(trace[-1].copies[i], states[i].yaws)
        assert trace[-1].yaws[i] == states[i].yaw
    assert trace[-1].primal_residual == max(s.primal_residual for s in states)
    assert trace[3].penalty == pytest.approx(0.05 * 1.1**2)


def between(gains, yaw):
    """A table's function at any yaws, by numpy's own interpolation."""
    nodes = -np.pi + 2 * np.pi * np.arange(len(gains) + 1) / len(gains)
    return np.interp((np.asarray(yaw) + np.pi) % (2 * np.pi) - np.pi, nodes, np.append(gains, gains[0]))


@pytest.mark.parametrize("circle", [True, False])
@pytest.mark.parametrize("rough", [True, False])
def test_the_exact_primal_is_the_global_minimum(circle, rough):
    rng = np.random.default_rng(6)
    for case in range(12):
        n_yaws, stiffness = 36 if rough else 360, 10 ** rng.uniform(-2.5, 1)
        center, announced = rng.uniform(-6, 6, 2) if circle else (rng.uniform(-4, 4), 0.0)
        table = rng.exponential(size=n_yaws) if rough else bumps(rng, 1, n_yaws)[0, 0]
        # a robot whose only neighbour's z sits where the centre should be
        solver = consensus.CADMM(penalty=stiffness, circle=circle)
        state = solver.start(0, [1], [announced, 0.0], np.array([table, np.zeros(n_yaws)]))
        state = solver.step(state, {1: np.array([center, center])})
        # undo what its own first copies did to z and λ
        mean = state.edge[0] - state.dual[0] / state.penalty

        def energy(x, table=table, announced=announced, mean=mean, stiffness=state.penalty):
            return stiffness / 2 * (x - mean[0]) ** 2 - between(table, announced + x)

        x = np.linspace(*((-30, 30) if circle else (-np.pi, np.pi)), 400_001)
        scanned = energy(x)
        assert scanned.min() - 0.01 < energy(state.copies[0]) <= scanned.min() + 1e-12, case
        if not rough:
            assert abs(state.copies[0] - x[scanned.argmin()]) < 1e-3, case
        # the zero objective: the quadratic's own minimiser, or the nearest end of the interval
        flat = mean[1] if circle else np.clip(mean[1], -np.pi, np.pi)
        assert state.copies[1] == pytest.approx(flat, abs=1e-9)


def test_a_search_within_plus_minus_pi_of_the_present_copy_would_miss_it():
    gains = np.zeros((2, 360))
    state = consensus.start(0, [1], [0.0, 0.0], gains, penalty=1.0)
    state = consensus.step(state, {1: np.array([12.0, 0.0])})
    assert state.copies[0] == pytest.approx(6 + 6 / 1.1)  # z = 6, λ = −6, and the next penalty is 1.1


def test_the_gradient_primal_descends_the_same_function():
    rng = np.random.default_rng(7)
    gains, announced, received = bumps(rng, 2)[0], rng.uniform(-3, 3, 2), rng.normal(size=2)
    solver = consensus.CADMM(penalty=0.5, primal="gradient", steps=2000, rate=0.05)
    before = solver.start(0, [1], announced, gains)
    state = solver.step(before, {1: received})
    mean = state.edge[0] - state.dual[0] / state.penalty

    def energy(x):
        fit = consensus.interpolate(gains, announced + x).sum()
        return state.penalty / 2 * ((x - mean) ** 2).sum() - fit

    local = optimize.minimize(energy, state.copies, tol=1e-10)
    np.testing.assert_allclose(state.copies, local.x, atol=1e-2)
    assert energy(state.copies) < energy(before.copies)


@pytest.mark.parametrize("n_yaws", [16, 17, 360])
def test_a_table_is_linear_between_its_nodes_and_its_slope_a_central_difference(n_yaws):
    rng = np.random.default_rng(0)
    table, at, nodes = rng.normal(size=(40, n_yaws)), rng.uniform(-9, 9, 40), consensus.grid(n_yaws)
    expected = [between(row, yaw) for row, yaw in zip(table, at, strict=True)]
    np.testing.assert_allclose(consensus.interpolate(table, at), expected, atol=1e-12)
    np.testing.assert_allclose(consensus.interpolate(np.tile(table[0], (n_yaws, 1)), nodes), table[0], rtol=0)
    np.testing.assert_allclose(consensus.interpolate(table[0], at), between(table[0], at), atol=1e-12)
    step = 2 * np.pi / n_yaws
    ahead, behind = ([between(r, y + side) for r, y in zip(table, at, strict=True)] for side in (step, -step))
    expected = (np.array(ahead) - behind) / (2 * step)
    np.testing.assert_allclose(consensus.interpolate(table, at, slope=True), expected, atol=1e-9)
    smooth = np.cos(nodes)  # whose true slope is known
    np.testing.assert_allclose(consensus.interpolate(smooth, at, slope=True), -np.sin(at), atol=step**2)


@pytest.mark.parametrize("seed", range(25))
def test_nothing_exceeds_the_optimum_of_rough_tables(seed):
    rng = np.random.default_rng(seed)
    n, n_yaws = int(rng.integers(1, 6)), int(rng.integers(4, 400))
    gains = rng.exponential(size=(n, n, n_yaws)) * 10 ** rng.uniform(-4, 4)
    graph, announced = network.build("complete", n), rng.uniform(-np.pi, np.pi, n)
    best, at_nodes = consensus.best_yaws(gains.sum(0), announced), gains.sum(0).max(1).sum()
    top = consensus.value(gains, best)
    assert top == at_nodes
    np.testing.assert_array_equal(consensus.solve(gains, graph, announced, "optimum")[-1].yaws, best)
    for solver in consensus.SOLVERS:
        assert consensus.value(gains, consensus.solve(gains, graph, announced, solver)[-1].yaws) <= at_nodes
    several = np.concatenate([rng.uniform(-9, 9, (2000, n)), best + 1e-9 * rng.normal(size=(100, n))])
    assert max(consensus.value(gains, yaws) for yaws in several) <= at_nodes
    # and no single row promises more than it holds: a smooth interpolant of the same table does
    assert consensus.interpolate(gains[0], best).max() <= gains[0].max()


def test_of_equally_good_yaws_the_nearest_is_taken_whatever_the_unit():
    plateau = np.array([0, 1, 1, 0, 0, 1, 0, 0.0])  # 1 from −135° to −90°, and at 45°
    near = np.radians([-100.0, -80, 20, 150, -170, -135])
    expected = np.radians([-100.0, -90, 45, -135, -135, -135])
    for unit in (1e-20, 1.0, 1e20):
        np.testing.assert_allclose(consensus.best_yaws(np.tile(unit * plateau, (6, 1)), near), expected, atol=1e-12)


def facing(peaks, n_yaws=360, sharpness=4):
    """Robot i's map prefers everyone to look along peaks[i]."""
    yaws = consensus.grid(n_yaws)
    rows = [np.exp(sharpness * (np.cos(yaws - p) - 1)) for p in peaks]
    return np.repeat(np.stack(rows)[:, None], len(peaks), 1)


@pytest.mark.parametrize("sharpness", [0, 2, 4])
def test_yaws_either_side_of_pi_meet_at_pi_on_the_circle_and_at_0_in_the_literal_form(sharpness):
    pair, copies = network.build("complete", 2), np.array([[3.1, 3.1], [-3.1, -3.1]])
    objectives = facing([3.1, -3.1], sharpness=sharpness) - (sharpness == 0)
    on_circle = consensus.solve(objectives, pair, copies, rounds=60)[-1]
    assert circular(on_circle.copies - np.pi).max() < 0.02
    literal = consensus.solve(objectives, pair, copies, "cadmm-literal", rounds=60)[-1]
    assert np.abs(literal.copies).max() < 0.02
    if sharpness:
        assert consensus.value(objectives, literal.yaws) < 0.1 * consensus.value(objectives, on_circle.yaws)


@pytest.mark.parametrize("functions", [False, True])
def test_announced_yaws_either_side_of_pi_meet_at_pi(functions):
    objectives = facing([3.1, -3.1])
    if functions:
        objectives = [lambda t, p=p: np.exp(4 * (np.cos(t - p) - 1)).sum() for p in (3.1, -3.1)]
    for solver in CADMMS:
        trace = consensus.solve(objectives, network.build("complete", 2), [3.1, -3.1], solver, rate=0.1)
        assert circular(trace[-1].copies - np.pi).max() < 0.02


def test_a_ring_of_copies_a_fifth_of_a_turn_apart_agrees():
    ring, copies = network.build("ring", 5), np.repeat(np.radians(72.0 * np.arange(5))[:, None], 5, 1)
    trace = consensus.solve(np.zeros((5, 5, 8)), ring, copies, rounds=100)
    assert circular(trace[-1].copies - trace[-1].copies[0]).max() < 0.05
    # wrapped differences, as a mean on the circle in place would take them, cancel at every robot: a fixed point
    angle = copies[:, 0]
    pull = np.angle(np.exp(1j * (np.roll(angle, 1) - angle))) + np.angle(np.exp(1j * (np.roll(angle, -1) - angle)))
    np.testing.assert_allclose(pull, 0, atol=1e-12)


@pytest.mark.parametrize("graph", ["complete", "ring"])
def test_agreement_beats_own_views_and_a_profile_is_all_but_the_optimum(graph):
    rng = np.random.default_rng(8)
    graph, shares = network.build(graph, 5), {name: [] for name in ("own", *CADMMS, "profile")}
    for _ in range(8):
        objectives = bumps(rng)
        own = consensus.solve(objectives, graph, np.zeros(5), "own")[-1].yaws
        best = consensus.value(objectives, consensus.solve(objectives, graph, own, "optimum")[-1].yaws)
        for name, values in shares.items():
            yaws = consensus.solve(objectives, graph, own, name)[-1].yaws
            values.append(consensus.value(objectives, yaws) / best)
    assert max(max(values) for values in shares.values()) <= 1
    assert min(shares["profile"]) >= 0.995
    assert np.mean(shares["cadmm"]) > np.mean(shares["own"]) + 0.05
    for steps in ("cadmm-gradient", "cadmm-stochastic"):
        assert np.mean(shares["own"]) < np.mean(shares[steps]) < np.mean(shares["cadmm"])


def test_the_optimum_is_that_of_a_dense_scan():
    objectives = bumps(np.random.default_rng(9), 3)
    yaws = consensus.solve(objectives, network.build("line", 3), np.zeros(3), "optimum")[-1].yaws
    dense = np.linspace(-np.pi, np.pi, 5_000, endpoint=False)
    for k in range(3):
        team = sum(consensus.interpolate(objectives[i, k], dense) for i in range(3))
        assert circular(yaws[k] - dense[team.argmax()]) < 2e-3


def test_a_profile_costs_a_byte_a_bin_and_survives_the_trip():
    gains = bumps(np.random.default_rng(10), 1)[0, 0] + 3
    levels, height = consensus.quantise(gains)
    assert levels.nbytes == 36
    assert levels.min() == 0
    assert levels.max() == 255
    restored = consensus.restore(levels, height, 360)
    assert np.abs(restored - (gains - gains.min())).max() < 0.01 * np.ptp(gains)
    rough = consensus.restore(*consensus.quantise(gains, 36, 2), 360)
    assert np.abs(rough - (gains - gains.min())).max() > 0.05 * np.ptp(gains)
    assert consensus.quantise(np.full(36, 2.0))[1] < 1e-15


@pytest.mark.parametrize("solver", consensus.SOLVERS)
def test_a_team_of_one_and_robots_at_their_goals(solver):
    objectives, pitch = bumps(np.random.default_rng(11), 1), 2 * np.pi / 360
    yaw = consensus.solve(objectives, network.build("line", 1), [0.5], solver, steps=3000)[-1].yaws[0]
    before, here, after = between(objectives[0, 0], yaw + np.array([-pitch, 0, pitch]))
    assert here > max(before, after) - 1e-3
    if solver not in ("cadmm-gradient", "cadmm-stochastic"):
        assert here == pytest.approx(objectives.max(), rel=1e-12)
    # nothing to gain: everybody keeps its announced view
    still = consensus.solve(np.zeros((3, 3, 12)), network.build("ring", 3), [3.0, -1.0, 0.5], solver)[-1].yaws
    np.testing.assert_allclose(still, [3.0, -1.0, 0.5], atol=1e-9)


def test_units_do_not_matter_and_the_scale_must_be_common():
    rng = np.random.default_rng(12)
    objectives, graph, announced = bumps(rng), network.build("ring", 5), rng.uniform(-3, 3, 5)
    one = consensus.solve(objectives, graph, announced)[-1].yaws
    np.testing.assert_allclose(consensus.solve(1e6 * objectives, graph, announced)[-1].yaws, one, atol=1e-9)
    each = [consensus.scale_of(row) for row in objectives]
    assert max(each) == consensus.scale_of(objectives) == objectives.max()
    assert consensus.scale_of(np.zeros((2, 2, 8))) == 1.0
    by_own = objectives / np.reshape(each, (-1, 1, 1))  # every robot by its own scale: another problem
    best, other = (consensus.solve(o, graph, announced, "optimum")[-1].yaws for o in (objectives, by_own))
    assert circular(best - other).max() > 0.01


def test_functions_may_be_scaled_too():
    rng = np.random.default_rng(13)
    functions, _ = quadratics(rng)
    graph, start = network.build("ring", N), rng.uniform(-1, 1, N)
    tenfold = [lambda yaws, f=f: 10 * f(yaws) for f in functions]
    one, ten = consensus.solve(functions, graph, start)[-1], consensus.solve(tenfold, graph, start, scale=10.0)[-1]
    np.testing.assert_allclose(one.copies, ten.copies, atol=1e-5)


def test_rounds_stop_by_tolerance_or_by_number():
    rng = np.random.default_rng(14)
    objectives, graph, announced = bumps(rng), network.build("complete", 5), rng.uniform(-3, 3, 5)
    trace = consensus.solve(objectives, graph, announced, rounds=200, tolerance=0.01)
    assert 1 < len(trace) < 201
    last = trace[-1]
    assert max(last.primal_residual, last.dual_residual) < 0.01
    assert circular(last.copies - last.yaws).max() < 0.02  # neighbours are within 2 · 0.01 of each other
    assert max(trace[-2].primal_residual, trace[-2].dual_residual) >= 0.01
    assert len(consensus.solve(objectives, graph, announced, rounds=7, tolerance=0)) == 8
    for stand in trace:
        assert stand.copies.min() >= -np.pi
        assert stand.copies.max() <= np.pi


@pytest.mark.parametrize("graph", ["ring", "star"])
def test_links_that_fail_both_ways_only_delay_agreement(graph):
    rng = np.random.default_rng(15)
    functions, team = quadratics(rng)
    graph = network.build(graph, N)
    down = set()

    def lost(sender, receiver):
        if sender < receiver:  # the first of the two decides for both
            (down.add if rng.random() < 0.3 else down.discard)((sender, receiver))
        return (min(sender, receiver), max(sender, receiver)) in down

    announced = rng.uniform(-1, 1, N)
    solver = consensus.CADMM(penalty=1.0, growth=1.0)
    states = [solver.start(i, list(graph[i]), announced, functions[i]) for i in range(N)]

    def deliver(outbox):
        gone = {(i, j): lost(i, j) for i in range(N) for j in range(N) if i < j}
        inbox = [note for note in outbox if not gone[tuple(sorted(note[:2]))]]
        return {i: {note.sender: note.offsets for note in inbox if note.receiver == i} for i in range(N)}

    *_, states = consensus.exchange(solver, states, deliver, rounds=120, tolerance=0)
    np.testing.assert_allclose([s.yaws for s in states], np.tile(team, (N, 1)), atol=1e-3)


def test_messages_lost_one_way_leave_an_agreement_a_little_off_the_optimum():
    rng = np.random.default_rng(16)
    functions, team = quadratics(rng)
    graph, start = network.build("ring", N), rng.uniform(-1, 1, N)
    lossy = consensus.solve(functions, graph, start, loss=0.2, rng=np.random.default_rng(0), **PRECISE)[-1]
    assert np.ptp(lossy.copies, axis=0).max() < 1e-4
    own = consensus.solve(functions, graph, start, "own")[-1].yaws
    best, reached, apart = (consensus.value(functions, yaws) for yaws in (team, lossy.yaws, own))
    assert apart < reached < best
    assert best - reached < 0.1 * (best - apart)
    assert np.abs(lossy.yaws - team).max() > 1e-3  # the duals of a link no longer cancel
    again = consensus.solve(functions, graph, start, loss=0.2, rng=np.random.default_rng(0), **PRECISE)[-1]
    np.testing.assert_array_equal(again.yaws, lossy.yaws)


def test_a_users_own_solver_runs_by_name(unchecked):
    def north(objectives, network, yaws, settings):
        assert objectives.max() == 1.0
        assert settings.rounds == 3
        return np.full(len(objectives), np.pi / 2)

    consensus.register("north", north)
    try:
        objectives = 7 * bumps(np.random.default_rng(17), 3)
        trace = consensus.solve(objectives, network.build("ring", 3), np.zeros(3), "north", rounds=3)
    finally:
        del consensus.SOLVERS["north"]
    np.testing.assert_array_equal(trace[-1].yaws, np.pi / 2)
    np.testing.assert_array_equal(trace[-1].copies, np.pi / 2 * np.eye(3))
    for name, function in [("cadmm", north), ("mine", 3)]:
        with pytest.raises(ValueError, match="cannot register"):
            consensus.register(name, function)


def holes(i, k, m):
    table = np.zeros((2, 2, 8))
    table[i, k, m] = np.nan
    return table


PAIR = nx.path_graph(2)


@pytest.mark.parametrize(
    ("args", "settings", "words"),
    [
        ((holes(1, 0, 5), PAIR, [0.0, 0.0]), {}, "robot 0's view in robot 1's map is not finite at yaw number 5"),
        ((np.zeros((2, 3, 8)), PAIR, [0.0, 0.0]), {}, r"shape \(N, N, M\).*\(2, 3, 8\)"),
        ((np.zeros((2, 2, 3)), PAIR, [0.0, 0.0]), {}, "at least 4 yaws"),
        (([], PAIR, []), {}, "at least one robot"),
        (("gains", PAIR, [0.0, 0.0]), {}, "array or a list of N functions"),
        (([abs, None], PAIR, [0.0, 0.0]), {}, "array or a list of N functions"),
        (([lambda t: np.nan] * 2, PAIR, [0.0, 0.0]), {}, "objective returned nan at yaws"),
        ((np.zeros((2, 2, 8)), PAIR, [0.0, 0.0, 0.0]), {}, "2 or 2 × 2 finite angles"),
        ((np.zeros((2, 2, 8)), PAIR, [0.0, np.inf]), {}, "finite angles"),
        ((np.zeros((2, 2, 8)), nx.empty_graph(2), [0.0, 0.0]), {}, "cannot reach each other"),
        ((np.zeros((2, 2, 8)), nx.path_graph(3), [0.0, 0.0]), {}, "extra or missing: 2"),
        ((np.zeros((2, 2, 8)), PAIR, [0.0, 0.0], "sgd"), {}, "no solver is called 'sgd'"),
        ((np.zeros((2, 2, 8)), PAIR, [0.0, 0.0]), {"penalty": 0}, "penalty must be positive"),
        ((np.zeros((2, 2, 8)), PAIR, [0.0, 0.0]), {"penalty": np.nan}, "penalty must be positive"),
        ((np.zeros((2, 2, 8)), PAIR, [0.0, 0.0]), {"growth": -1}, "growth must be positive"),
        ((np.zeros((2, 2, 8)), PAIR, [0.0, 0.0]), {"scale": 0.0}, "scale must be positive"),
        ((np.zeros((2, 2, 8)), PAIR, [0.0, 0.0]), {"rounds": -1}, "rounds must not be negative"),
        ((np.zeros((2, 2, 8)), PAIR, [0.0, 0.0]), {"primal": "newton"}, "no primal update is called 'newton'"),
        ((np.zeros((2, 2, 8)), PAIR, [0.0, 0.0]), {"loss": 0.1}, "needs an rng"),
        ((np.zeros((2, 2, 8)), PAIR, [0.0, 0.0]), {"rho": 1}, "no setting is called rho; see consensus.Settings"),
        ((np.zeros((2, 2, 8)), PAIR, [0.0, 0.0]), {"penality": 1}, r"called penality; did you mean penalty\?"),
        ((np.zeros((2, 2, 8)), PAIR, [0.0, 0.0], "profile"), {"bits": 9}, "1 to 8 bits"),
    ],
)
def test_bad_input_is_named_in_one_line(args, settings, words, unchecked):
    with pytest.raises(ValueError, match=words) as error:
        consensus.solve(*args, **settings)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("function", [consensus.solve, consensus.solve_twists])
def test_completion_sees_every_setting_with_its_default(function):
    shown = inspect.signature(function).parameters
    fields = {f.name: f.default for f in dataclasses.fields(consensus.Settings)}
    assert {name: shown[name].default for name in fields} == fields
    assert all(shown[name].kind is inspect.Parameter.KEYWORD_ONLY for name in fields)
    assert list(shown)[:4] == ["objectives", "network", *list(shown)[2:3], "solver"]
    options = inspect.unwrap(function).__annotations__["settings"].__args__[0].__annotations__
    assert options == {f.name: f.type for f in dataclasses.fields(consensus.Settings)}  # what a type checker completes


def test_a_solver_names_the_setting_that_was_meant():
    with pytest.raises(ValueError, match=r"^consensus: no setting is called penality; did you mean penalty\?$"):
        consensus.CADMM(penality=0.1)
    with pytest.raises(ValueError, match="growth must be positive"):
        consensus.CADMM(growth=0.0)


def test_a_step_refuses_strangers_and_garbage():
    state = consensus.start(0, [1], [0.0, 0.0], np.zeros((2, 8)))
    with pytest.raises(ValueError, match="no link to robot 2"):
        consensus.step(state, {2: np.zeros(2)})
    for bad in (np.zeros(3), np.array([0.0, np.nan])):
        with pytest.raises(ValueError, match="robot 1 sent"):
            consensus.step(state, {1: bad})
    for gains in (np.zeros((3, 8)), np.zeros((2, 3)), np.full((2, 8), np.inf)):
        with pytest.raises(ValueError, match="needs finite gains"):
            consensus.start(0, [1], [0.0, 0.0], gains)
    with pytest.raises(ValueError, match="must be positive"):
        consensus.start(0, [1], [0.0, 0.0], np.zeros((2, 8)), penalty=0.0)
