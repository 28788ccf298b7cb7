"""The gain's gradient in se(d), the search for the best view, and agreement on whole poses, in both dimensions."""

import math

import numba
import numpy as np
import pytest
import torch
from helpers import camera_for, random_map, random_pose
from numpy.testing import assert_allclose
from scipy import optimize

from mannbv import consensus, geometry, information, network
from mannbv.splats import SplatMap

DIMS, TWISTS = [2, 3], {2: 3, 3: 6}


@pytest.fixture(autouse=True)
def one_thread():
    """On maps this small threads would only wait for each other."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(before)


def world(rng, dim, n=25, dtype=torch.float64, block=False, nearest=0.0):
    """Splats around, a camera, what one look at them has told, and a level pose to start from."""
    splat_map, camera = random_map(rng, n, dim, dtype), camera_for(dim, 16, 8)
    away = splat_map.means / torch.linalg.norm(splat_map.means, dim=1, keepdim=True)
    splat_map = SplatMap(splat_map.means + nearest * away, *splat_map.tensors()[1:])
    start = geometry.yaw_pose(torch.from_numpy(rng.uniform(-0.3, 0.3, dim)), 0.4)
    prior = information.prior(splat_map, camera, [start.moved(0.3 * torch.ones(TWISTS[dim]).double())], block=block)
    return splat_map, camera, prior, start


def elevation(pose) -> float:
    return math.asin(float(pose.rotation[2, -1])) if pose.dim == 3 else 0.0


@pytest.mark.parametrize("dim", DIMS)
@pytest.mark.parametrize("block", [False, True])
@pytest.mark.parametrize("occluded", [False, True])
def test_the_gradient_in_the_twist_agrees_with_central_differences(dim, block, occluded, rng):
    splat_map, camera, prior, _ = world(rng, dim, block=block)
    others = random_map(rng, 10, dim) if occluded else None
    asked = {"noise": {"sigma_depth": 0.1}, "weights": torch.from_numpy(rng.uniform(0, 1, 25))}
    for _ in range(3):
        pose, h = random_pose(rng, dim), 1e-6
        value, gradient = information.gain_and_gradient(splat_map, camera, pose, prior, others, **asked)

        def gain(twist, pose=pose):
            return information.view_gain(splat_map, camera, pose.moved(twist), prior, others, **asked).item()

        nudges = h * torch.eye(TWISTS[dim], dtype=torch.float64)
        differences = [(gain(nudge) - gain(-nudge)) / (2 * h) for nudge in nudges]
        assert_allclose(value, gain(0 * nudges[0]), rtol=1e-9)
        assert_allclose(gradient, differences, rtol=1e-4, atol=1e-5 * np.abs(differences).max())
        assert np.abs(differences).min() > 0


@pytest.mark.parametrize("dim", DIMS)
def test_the_slope_in_yaw_is_one_direction_of_the_gradient(dim, rng):
    splat_map, camera, prior, start = world(rng, dim)
    for yaw in (-2.0, 0.4, 1.7):
        pose = geometry.yaw_pose(start.position, yaw)
        (vertical,) = information.directions(pose, "yaw")
        value, slope = information.gain_and_slope(splat_map, camera, start.position, yaw, prior)
        with torch.no_grad():  # the gradient does not depend on the caller's mode
            both = information.gain_and_gradient(splat_map, camera, pose, prior)
        assert_allclose(value, both[0])
        assert_allclose(slope, both[1] @ vertical, rtol=1e-9)


@pytest.mark.parametrize("dim", DIMS)
def test_directions_turn_the_camera_as_their_names_say(dim, rng):
    pose = random_pose(rng, dim)
    up, angle = np.eye(dim)[-1], 0.3
    (vertical,) = information.directions(pose, "yaw")
    turned = pose.moved(angle * vertical)
    assert_allclose(turned.position, pose.position)
    assert_allclose(geometry.wrap(turned.yaw - pose.yaw), angle)
    assert elevation(turned) == pytest.approx(elevation(pose))
    if dim == 3:
        assert_allclose(up @ turned.rotation.numpy(), up @ pose.rotation.numpy())  # the whole camera, roll too
        level = geometry.yaw_pose(pose.position, 0.7)
        _, pitch = information.directions(level, "yaw and pitch")
        raised = level.moved(angle * pitch)
        assert elevation(raised) == pytest.approx(angle)
        assert raised.yaw == pytest.approx(0.7)
        assert float(raised.rotation[2, 0]) == pytest.approx(0)  # still level
    shapes = [information.directions(pose, freedom).shape for freedom in information.FREEDOMS]
    assert shapes == [(1, TWISTS[dim]), (dim - 1, TWISTS[dim]), (TWISTS[dim], TWISTS[dim])]
    assert torch.equal(information.directions(pose), torch.eye(TWISTS[dim], dtype=torch.float64))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])  # slopes by differences, and exact ones
@pytest.mark.parametrize("dim", DIMS)
@pytest.mark.parametrize("block", [False, True])
def test_the_best_yaw_is_that_of_a_fine_scan(dim, dtype, block, rng):
    splat_map, camera, prior, start = world(rng, dim, 12, dtype, block)
    found = information.best_view(splat_map, camera, start, prior, "yaw")
    (vertical,) = information.directions(start, "yaw")
    scan = [
        information.view_gain(splat_map, camera, start.moved(angle * vertical), prior).item()
        for angle in np.linspace(0, 2 * np.pi, 180, endpoint=False)
    ]
    assert found.gain > 0.998 * max(scan)
    assert found.gain > 1.1 * scan[0]
    assert_allclose(found.pose.position, start.position)
    assert_allclose(information.view_gain(splat_map, camera, found.pose, prior).item(), found.gain, rtol=1e-5)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_best_yaw_and_pitch_are_those_of_a_grid(seed):
    rng = np.random.default_rng(seed)
    splat_map, camera, prior, start = world(rng, 3, 15, torch.float32)
    limits = (-0.6, 0.6)
    found = information.best_view(splat_map, camera, start, prior, "yaw and pitch", pitch=limits)
    assert limits[0] - 1e-6 <= elevation(found.pose) <= limits[1] + 1e-6
    assert float(found.pose.rotation[2, 0]) == pytest.approx(0, abs=1e-6)  # no roll
    grid = []
    for yaw in np.linspace(0, 2 * np.pi, 48, endpoint=False):
        level = geometry.yaw_pose(start.position, yaw)
        right = information.directions(level, "yaw and pitch")[1]
        grid += [
            information.view_gain(splat_map, camera, level.moved(up * right), prior).item()
            for up in np.linspace(*limits, 9)
        ]
    assert found.gain > 0.97 * max(grid)
    assert found.gain >= information.best_view(splat_map, camera, start, prior, "yaw").gain


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_best_pose_of_flatland_is_that_of_a_grid(seed):
    rng = np.random.default_rng(seed)
    splat_map, camera, prior, start = world(rng, 2, 12, torch.float32, nearest=1.5)
    radius, grid = 0.4, []
    found = information.best_view(splat_map, camera, start, prior, "pose", radius)
    for x, y in np.stack(np.meshgrid(*[np.linspace(-radius, radius, 7)] * 2), -1).reshape(-1, 2):
        if math.hypot(x, y) <= radius:
            place = start.position + torch.tensor([x, y])
            grid += [
                information.view_gain(splat_map, camera, geometry.yaw_pose(place, yaw), prior).item()
                for yaw in np.linspace(0, 2 * np.pi, 36, endpoint=False)
            ]
    assert found.gain > 0.97 * max(grid)


@pytest.mark.parametrize("dim", DIMS)
@pytest.mark.parametrize("freedom", information.FREEDOMS)
def test_more_freedom_gains_more_within_its_limits_and_always_the_same(dim, freedom, rng):
    splat_map, camera, prior, start = world(rng, dim, 12, torch.float32)
    limits = {"radius": 0.2, "pitch": (-0.3, 0.5)}
    found, again = (
        information.best_view(splat_map, camera, start, prior, freedom, rounds=8, **limits) for _ in range(2)
    )
    assert torch.equal(found.pose.matrix(), again.pose.matrix()) and found.gain == again.gain
    assert float(torch.linalg.norm(found.pose.position - start.position)) <= 0.2 + 1e-9
    assert -0.3 - 1e-6 <= elevation(found.pose) <= 0.5 + 1e-6
    assert_allclose(found.pose.rotation @ found.pose.rotation.T, np.eye(dim), atol=1e-9)
    assert found.gain >= information.view_gain(splat_map, camera, start, prior).item()
    less = information.best_view(splat_map, camera, start, prior, "yaw", rounds=8, **limits)
    assert found.gain >= less.gain
    if len(information.directions(start, freedom)) == 1:  # flatland has no pitch
        assert torch.equal(found.pose.matrix(), less.pose.matrix())
    if freedom == "pose":
        assert found.gain > 1.01 * less.gain
        pinned = information.best_view(splat_map, camera, start, prior, freedom, radius=0.0, rounds=4)
        assert_allclose(pinned.pose.position, start.position)


@pytest.mark.parametrize("dim", DIMS)
def test_a_search_that_starts_at_the_top_stays_there(dim, rng):
    splat_map, camera, prior, start = world(rng, dim, 8, torch.float32)
    top = information.best_view(splat_map, camera, start, prior, rounds=30)
    alone = information.best_view(splat_map, camera, top.pose, prior, n_yaws=1, rounds=0)
    assert torch.equal(alone.pose.matrix(), top.pose.matrix())
    assert alone.gain == pytest.approx(top.gain, rel=1e-6)
    empty = SplatMap.empty(dim)
    nothing = information.best_view(empty, camera, start, torch.zeros(0, information.n_parameters(dim)))
    assert nothing.gain == 0 and torch.equal(nothing.pose.matrix(), start.matrix())


def test_what_a_search_refuses(rng):
    splat_map, camera, prior, start = world(rng, 3, 4, torch.float32)
    steep = start.moved(1.2 * information.directions(start, "yaw and pitch")[1])
    for words, call in (
        ("no freedom is called 'roll'; choose one of yaw, yaw and pitch, pose", {"freedom": "roll"}),
        ("elevation of 1.200 rad, must lie within pitch", {"start": steep}),
        ("radius must not be negative, got -1", {"radius": -1.0}),
        ("n_yaws and leads ≥ 1", {"n_yaws": 0}),
        ("do not fit", {"start": geometry.yaw_pose([0.0, 0.0], 0.0)}),
    ):
        with pytest.raises(ValueError, match=words):
            information.best_view(splat_map, camera, call.pop("start", start), prior, **call)


# ---- agreement on twists


class Bowl:
    """−½ (x − a)ᵀ Q (x − a) in all robots' twists (N, t), with its gradient."""

    def __init__(self, stiffness, best):
        self.stiffness, self.best = stiffness, best

    def __call__(self, twists):
        gap = twists.ravel() - self.best
        return -0.5 * gap @ self.stiffness @ gap

    def gradient(self, twists):
        return -(self.stiffness @ (twists.ravel() - self.best)).reshape(twists.shape)


def bowls(rng, n, t):
    roots = rng.normal(size=(n, n * t, n * t))
    stiff = roots @ roots.transpose(0, 2, 1) / (n * t) + 0.3 * np.eye(n * t)
    return [Bowl(q, a) for q, a in zip(stiff, rng.uniform(-1, 1, (n, n * t)), strict=True)]


PRECISE = {"penalty": 1.0, "growth": 1.0, "rounds": 400, "tolerance": 1e-7}


@pytest.mark.parametrize("graph", ["complete", "ring", "line"])
@pytest.mark.parametrize(("t", "k"), [(3, 3), (3, 1), (6, 6), (6, 2)])
@pytest.mark.parametrize("solver", ["cadmm", "cadmm-gradient"])
def test_twists_reach_the_closed_form(graph, t, k, solver):
    """The maximiser of Σ F over the span of the directions, from its normal equations."""
    rng, n = np.random.default_rng(t + k), 3
    functions, directions = bowls(rng, n, t), rng.normal(size=(n, k, t))
    if k == t:
        directions = np.tile(np.eye(t), (n, 1, 1))
    else:
        directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    span = np.zeros((n * k, n * t))
    for i in range(n):
        span[i * k : (i + 1) * k, i * t : (i + 1) * t] = directions[i]
    total = sum(f.stiffness for f in functions)
    best = np.linalg.solve(span @ total @ span.T, span @ sum(f.stiffness @ f.best for f in functions)) @ span
    trace = consensus.solve_twists(functions, network.build(graph, n), directions, solver, **PRECISE)
    assert_allclose(trace[-1].copies, np.tile(best.reshape(1, n, t), (n, 1, 1)), atol=5e-5)
    assert_allclose(trace[-1].twists, best.reshape(n, t), atol=5e-5)
    assert len(trace) > 3 and not trace[0].states[0].dual.any()
    mine = [f.best.reshape(n, t)[i] for i, f in enumerate(functions)]
    assert np.abs(trace[-1].twists - mine).max() > 0.05  # nobody's own wish


@pytest.mark.parametrize("dim", DIMS)
@pytest.mark.parametrize("solver", ["cadmm", "cadmm-gradient"])
def test_with_the_yaw_alone_it_is_the_agreement_on_yaws(dim, solver):
    """Round by round what `solve` does, penalties, residuals and copies."""
    rng, n = np.random.default_rng(3), 4
    announced, heights = rng.uniform(-3, 3, n), rng.exponential(size=(n, n, 2))
    centers, ring = rng.uniform(-np.pi, np.pi, (n, n, 2)), network.build("ring", n)

    def gain(i, yaws):
        return (heights[i] * np.exp(2 * (np.cos(yaws[:, None] - centers[i]) - 1))).sum()

    levels = [geometry.yaw_pose(torch.zeros(dim, dtype=torch.float64), yaw) for yaw in announced]
    directions = np.stack([information.directions(pose, "yaw").numpy() for pose in levels])

    def of_twists(i):
        return lambda twists: gain(i, announced + np.einsum("nt,nt->n", twists, directions[:, 0]))

    yaws = [lambda yaws, i=i: gain(i, yaws) for i in range(n)]
    old = consensus.solve(yaws, ring, announced, solver, rounds=12, tolerance=0)
    new = consensus.solve_twists([of_twists(i) for i in range(n)], ring, directions, solver, rounds=12, tolerance=0)
    assert len(old) == len(new) == 13
    for before, now in zip(old, new, strict=True):
        angles = np.einsum("ikt,kt->ik", now.copies, directions[:, 0])
        assert_allclose(geometry.wrap(announced + angles - before.copies), 0, atol=1e-5)
        assert now.penalty == before.penalty
        assert_allclose(now.primal_residual, before.primal_residual, atol=1e-5)
        assert_allclose(now.dual_residual, before.dual_residual, atol=1e-5)
    moved = [pose.moved(torch.from_numpy(twist)).yaw for pose, twist in zip(levels, new[-1].twists, strict=True)]
    assert_allclose(geometry.wrap(np.array(moved) - old[-1].yaws), 0, atol=1e-5)


class TeamGain:
    """F_i: what all robots' views, moved by twists from the announced poses, tell about robot i's map, over a scale.

    A spring holds each robot near its announced pose.
    """

    def __init__(self, splat_map, camera, prior, poses, scale=1.0):
        self.map, self.camera, self.prior, self.poses, self.scale = splat_map, camera, prior, poses, scale

    def total(self, twists):
        gains = sum(
            information.view_gain(self.map, self.camera, pose.moved(twist), self.prior)
            for pose, twist in zip(self.poses, twists, strict=True)
        )
        return gains / self.scale - (twists**2).sum()

    def __call__(self, twists):
        return self.total(torch.from_numpy(twists)).item()

    def gradient(self, twists):
        leaf = torch.from_numpy(twists).requires_grad_()
        return torch.autograd.grad(self.total(leaf), leaf)[0].numpy()


@pytest.mark.parametrize("dim", DIMS)
@pytest.mark.parametrize("freedom", ["yaw", "pose"])
def test_a_team_agrees_on_poses_that_tell_it_more(dim, freedom):
    """Against staying as announced, and against one who climbs the same hill and knows everything."""
    rng, n = np.random.default_rng(5), 2
    worlds = [world(rng, dim, 6, nearest=2.0) for _ in range(n)]
    camera, poses = camera_for(dim, 6, 4), [start for *_, start in worlds]
    # large, round and faint splats make gentle hills
    maps = [
        SplatMap(m.means, 0 * m.log_scales - 0.5, m.rotations, 0 * m.opacity_logits - 1, m.colors) for m, *_ in worlds
    ]
    seen = geometry.yaw_pose(torch.zeros(dim).double(), 2.0)
    priors = [information.prior(m, camera, [seen]) + 1e4 for m in maps]
    directions = np.stack([information.directions(pose, freedom).numpy() for pose in poses])
    still = np.zeros((n, TWISTS[dim]))
    scale = max(TeamGain(m, camera, p, poses)(still) for m, p in zip(maps, priors, strict=True))
    functions = [TeamGain(m, camera, p, poses, scale) for m, p in zip(maps, priors, strict=True)]

    def spread(x):
        return np.einsum("nk,nkt->nt", x.reshape(n, -1), directions)

    def team(x):
        return sum(f(spread(x)) for f in functions)

    def slope(x):
        return np.einsum("nt,nkt->nk", sum(f.gradient(spread(x)) for f in functions), directions).ravel()

    graph = network.build("complete", n)
    last = consensus.solve_twists(
        functions, graph, directions, "cadmm-gradient", penalty=2.0, rate=0.03, rounds=30, tolerance=1e-3
    )[-1]
    agreed = np.einsum("nt,nkt->nk", last.twists, directions).ravel()
    best = optimize.minimize(lambda x: -team(x), 0 * agreed, jac=lambda x: -slope(x), options={"maxiter": 10})
    assert_allclose(spread(agreed), last.twists, atol=1e-9)
    assert_allclose(last.copies[0], last.copies[1], atol=0.05)
    before = team(0 * agreed)
    assert -best.fun > 1.02 * before
    assert team(agreed) - before > 0.9 * (-best.fun - before)


def test_what_agreement_on_twists_refuses(unchecked):
    graph, functions, eye = network.build("line", 2), [lambda twists: 0.0] * 2, np.tile(np.eye(3), (2, 1, 1))
    for words, call in (
        ("no solver of twists is called 'own'; choose one of cadmm, cadmm-gradient", (functions, graph, eye, "own")),
        ("must be a list of N functions", (np.zeros((2, 2, 8)).tolist(), graph, eye)),
        (r"directions must be finite and \(2, k, t\), got \(3, 3\)", (functions, graph, np.eye(3))),
        ("returned nan", ([lambda twists: math.nan] * 2, graph, eye)),
    ):
        with pytest.raises(ValueError, match=words):
            consensus.solve_twists(*call)
    with pytest.raises(ValueError, match="no setting is called speed"):
        consensus.solve_twists(functions, graph, eye, speed=2)
    trace = consensus.solve_twists(functions, graph, eye)
    assert not trace[-1].twists.any()  # nothing to gain: as announced
