import networkx as nx
import numpy as np
import pytest
from scipy import optimize

from mannbv import consensus, network

GRAPHS = ["complete", "ring", "star", "line"]
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


def play(objectives, graph, announced, rounds, lost=lambda i, j: False, **options):
    """Rounds of start and step by hand; yields every robot's state after each."""
    states = [
        consensus.start(i, network.neighbours(graph, i), announced, objectives[i], **options) for i in sorted(graph)
    ]
    for _ in range(rounds):
        sent = [state.copies for state in states]
        states = [consensus.step(s, {j: sent[j] for j in s.neighbours if not lost(j, s.robot)}) for s in states]
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


def scan(function, origin, center, stiffness, low, high):
    """The least of −f(origin + x) + stiffness/2 (x − center)² over [low, high], by a dense scan."""
    x = np.linspace(low, high, 400_001)
    energy = stiffness / 2 * (x - center) ** 2 - function(origin + x)
    return x[energy.argmin()], energy.min()


@pytest.mark.parametrize("circle", [True, False])
def test_the_exact_primal_is_the_global_minimum(circle):
    rng = np.random.default_rng(6)
    for case in range(12):
        n_yaws, stiffness = 360, 10 ** rng.uniform(-2.5, 1)
        center, announced = rng.uniform(-6, 6, 2) if circle else (rng.uniform(-4, 4), 0.0)
        peaks, heights = rng.uniform(-np.pi, np.pi, 3), rng.exponential(size=3)

        def f(yaw, peaks=peaks, heights=heights):
            return sum(h * np.exp(4 * (np.cos(yaw - p) - 1)) for h, p in zip(heights, peaks, strict=True))

        gains = np.array([f(consensus.grid(n_yaws)), np.zeros(n_yaws)])
        # a robot whose only neighbour's z sits where the centre should be
        state = consensus.start(0, [1], [announced, 0.0], gains, penalty=stiffness, circle=circle)
        state = consensus.step(state, {1: np.array([center, center])})
        # undo what its own first copies did to z and λ
        mean = state.edge[0] - state.dual[0] / state.penalty
        low, high = (-30, 30) if circle else (-np.pi, np.pi)
        best, energy = scan(f, announced, mean[0], state.penalty, low, high)
        reached = state.penalty / 2 * (state.copies[0] - mean[0]) ** 2 - f(announced + state.copies[0])
        assert reached <= energy + 1e-4, case
        assert abs(state.copies[0] - best) < 2e-3, case
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
    state = consensus.start(0, [1], announced, gains, penalty=0.5, primal="gradient", steps=2000, rate=0.05)
    before, state = state, consensus.step(state, {1: received})
    mean = state.edge[0] - state.dual[0] / state.penalty

    def energy(x):
        fit = consensus.interpolate(gains, announced + x).sum()
        return state.penalty / 2 * ((x - mean) ** 2).sum() - fit

    local = optimize.minimize(energy, state.copies, tol=1e-10)
    np.testing.assert_allclose(state.copies, local.x, atol=1e-4)
    assert energy(state.copies) < energy(before.copies)


def test_interpolation_and_its_slope_are_exact_for_trigonometric_polynomials():
    yaws, at = consensus.grid(16), np.array([0.3, -2.9])
    table = np.stack([1 + 2 * np.cos(3 * yaws - 0.4), np.sin(yaws) - np.cos(7 * yaws)])
    np.testing.assert_allclose(
        consensus.interpolate(table, at), [1 + 2 * np.cos(0.9 - 0.4), np.sin(-2.9) - np.cos(7 * 2.9)], atol=1e-12
    )
    for n_yaws in (16, 17):  # with and without the highest, half-counted wave
        noise = np.random.default_rng(0).normal(size=n_yaws)
        nodes = consensus.grid(n_yaws)
        np.testing.assert_allclose(consensus.interpolate(np.tile(noise, (n_yaws, 1)), nodes), noise, atol=1e-12)
    slopes = [-6 * np.sin(0.9 - 0.4), np.cos(-2.9) + 7 * np.sin(7 * -2.9)]
    np.testing.assert_allclose(consensus.interpolate(table, at, slope=True), slopes, atol=1e-12)


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
    for solver in ("cadmm", "cadmm-gradient"):
        trace = consensus.solve(objectives, network.build("complete", 2), [3.1, -3.1], solver)
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
    graph, shares = network.build(graph, 5), {name: [] for name in ("own", "cadmm", "cadmm-gradient", "profile")}
    for _ in range(8):
        objectives = bumps(rng)
        own = consensus.solve(objectives, graph, np.zeros(5), "own")[-1].yaws
        best = consensus.value(objectives, consensus.solve(objectives, graph, own, "optimum")[-1].yaws)
        for name, values in shares.items():
            yaws = consensus.solve(objectives, graph, own, name)[-1].yaws
            values.append(consensus.value(objectives, yaws) / best)
    assert max(max(values) for values in shares.values()) <= 1 + 1e-4
    assert min(shares["profile"]) >= 0.995
    assert np.mean(shares["cadmm"]) > np.mean(shares["own"]) + 0.05
    assert np.mean(shares["cadmm-gradient"]) > np.mean(shares["own"])
    assert np.mean(shares["cadmm"]) > np.mean(shares["cadmm-gradient"])


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
    objectives = bumps(np.random.default_rng(11), 1)
    yaw = consensus.solve(objectives, network.build("line", 1), [0.5], solver, steps=3000)[-1].yaws[0]
    dense = consensus.interpolate(objectives[0, 0], consensus.grid(7200))
    slope = consensus.interpolate(objectives[0, 0], np.array([yaw]), slope=True)
    assert abs(slope) < 1e-2
    if solver != "cadmm-gradient":
        assert circular(yaw - consensus.grid(7200)[dense.argmax()]) < 1e-3
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
    states = [
        consensus.start(i, network.neighbours(graph, i), announced, functions[i], penalty=1.0, growth=1.0)
        for i in range(N)
    ]
    for _ in range(120):
        sent = [state.copies for state in states]
        gone = {(i, j): lost(i, j) for i in range(N) for j in range(N) if i < j}
        states = [
            consensus.step(s, {j: sent[j] for j in s.neighbours if not gone[tuple(sorted((j, s.robot)))]})
            for s in states
        ]
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


def test_a_users_own_solver_runs_by_name():
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
        ((np.zeros((2, 2, 8)), PAIR, [0.0, 0.0]), {"rho": 1}, "no setting is called rho"),
        ((np.zeros((2, 2, 8)), PAIR, [0.0, 0.0], "profile"), {"bits": 9}, "1 to 8 bits"),
    ],
)
def test_bad_input_is_named_in_one_line(args, settings, words):
    with pytest.raises(ValueError, match=words) as error:
        consensus.solve(*args, **settings)
    assert "\n" not in str(error.value)


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
