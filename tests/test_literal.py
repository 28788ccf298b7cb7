"""The paper's literal forms, each reached from a cycle by a name in Config and held against its formula, in full."""

import math

import numpy as np
import pytest
import torch
from scipy import stats

from mannbv import episode, geometry, information, messages, metrics, network, objective, planner, team, world
from mannbv.camera import Camera
from mannbv.config import PRESETS, Config

SMALL = {"image_width": 32, "fit_steps": 4, "max_cycles": 1, "n_yaws": 72, "rounds": 6, "n_subgoals": 2}
CONFIGS = {
    2: Config().replace(**SMALL),
    3: PRESETS[3]["quick"].replace(**SMALL, image_height=32, subgoal_yaws=36),
}


def mission_for(config: Config, strategy: str, dim: int = 2, n: int = 2) -> team.Mission:
    place = episode.draw_team(world.load("flat", dim=dim), n, 0, config)
    camera = Camera.of_dim(dim, config.image_width, config.image_height, config.fov)
    return team.Mission(place, camera, config, network.build("complete", n), strategy, 0)


def cycled(mission: team.Mission):
    """The robots that have planned in a first cycle, and what the cycle reports."""
    place, n = mission.world, len(mission.network)
    robots = [
        team.start(k, place.starts[k, :-1], float(place.starts[k, -1]), place.goals[k], mission) for k in range(n)
    ]
    planned = [team.plan(team.observe(robot, mission, 0), mission) for robot in robots]
    _, log = team.cycle(robots, mission, messages.Mailbox(mission.config.codec, network=mission.network), 0)
    return planned, log


def looked(robot, camera, pose) -> np.ndarray:
    """h of a view on a robot's own map (n, p)."""
    return information.fisher(robot.local.splats, camera, pose).double().numpy()


def known(robot, camera) -> np.ndarray:
    """H, the sum over its keyframes."""
    return sum(looked(robot, camera, frame.pose) for frame in robot.local.keyframes)


def announced(robot):
    plan = robot.plans[robot.index]
    return geometry.yaw_pose(torch.from_numpy(plan.position), plan.yaw), plan.path


LAMBDA = np.array([100.0, 100, 1, 1, 1, 0.25, 10, 10, 10])  # of flatland's nine parameters


def weighed(h, H, v, views):
    """Eq. (15) with matrices V̄, h, H: V̄ on both sides, inverted where it is positive."""
    total = 0.0
    for s in np.flatnonzero(v > 0):
        V = v[s] * np.eye(9)
        total += np.trace(V @ np.diag(h[s]) @ np.linalg.inv(V @ np.diag(H[s] + LAMBDA)))
    return total


def damped(h, H, v, views):
    """Section III-B: every view, the new one too, has + λI."""
    return sum(v[s] * ((h[s] + LAMBDA) / (H[s] + views * LAMBDA)).sum() for s in range(len(v)))


@pytest.mark.parametrize(
    ("change", "formula"), [({"weighs": "both"}, weighed), ({"damped": "views"}, damped)], ids=["weighs", "damped"]
)
def test_a_cycle_weighs_views_by_the_literal_formula(change, formula):
    config = CONFIGS[2].replace(**change)
    mission = mission_for(config, "single")
    robots, log = cycled(mission)
    expected, plain = [], []
    for robot in robots:
        pose, path = announced(robot)
        belief = robot.belief(config)
        zone = objective.zone(belief, path, config)
        h, H = looked(robot, mission.camera, pose), known(robot, mission.camera)
        v = torch.where(zone.selected, zone.weights, 0.0).double().numpy()
        assert len(robot.local.keyframes) == belief.views > 1 and (v > 0).sum() > 20
        expected.append(formula(h, H, v, len(robot.local.keyframes)))
        exact = objective.per_owner([belief], [zone], mission.camera, pose, config)
        assert float(exact) == pytest.approx(expected[-1], rel=1e-4)
        profile = objective.served(belief, mission.camera, pose.position.numpy(), path, config)
        options = {"weights": zone.weights, "selected": zone.selected, "damping": torch.from_numpy(LAMBDA)}
        options |= {"weigh_prior": "weighs" in change, "literal_views": belief.views if "damped" in change else None}
        views = information.yaw_profile(
            belief.splats, mission.camera, pose.position, belief.prior, method="views", **options, n_yaws=72
        )
        assert views.gain_at(pose.yaw) == pytest.approx(expected[-1], rel=1e-4)
        assert np.median(np.abs(profile.gains - views.gains)) < 0.02 * views.gains.max()
        np.testing.assert_allclose([profile.gain_at(yaw) for yaw in profile.yaws], profile.gains, rtol=1e-5, atol=1e-5)
        plain.append((v * (h / (H + LAMBDA)).sum(1)).sum())
    assert log.own_gain == pytest.approx(sum(expected), rel=0.05)
    assert abs(sum(expected) / sum(plain) - 1) > 0.3  # another formula altogether
    assert episode.run("flat", "distributed", config, n_robots=2).finished


def test_weights_on_the_prior_cancel():
    """Eqs. (14)-(15) as they are written: with V̄ on both, only where it is 0 do weights count."""
    config = CONFIGS[2].replace(weighs="both")
    mission = mission_for(config, "single", n=1)
    ((robot,), _) = cycled(mission)
    pose, path = announced(robot)
    gains = [
        objective.served(robot.belief(c), mission.camera, pose.position.numpy(), path, c).gains
        for c in (config, config.replace(gamma1=7.0), config.replace(gamma2=0.1), config.replace(weighs="acquired"))
    ]
    assert np.allclose(gains[0], gains[1]) and np.allclose(gains[0], gains[2])
    assert not np.allclose(gains[0], gains[3], rtol=0.1)


@pytest.mark.parametrize("strategy", ["limited", "centralized"])
def test_with_lambda_on_every_view_guests_bring_that_of_their_senders_views(strategy):
    config = CONFIGS[2].replace(damped="views")
    mission = mission_for(config, strategy, n=3)
    robots, _ = cycled(mission)
    shared = team.share(robots, mission, messages.Mailbox("binary"), team.REGISTRY[strategy])
    shared, met = team.each(shared, team.meet, mission), 0
    for robot in shared:
        here, guests, pose = robot.belief(config), robot.guests, announced(robot)[0]
        own = len(robot.local.keyframes)
        told = [known(robot, mission.camera) + own * LAMBDA]
        seen = sum(
            information.fisher(guests.splats, mission.camera, f.pose, robot.local.splats) for f in robot.local.keyframes
        )
        for sender, number, mine in zip(guests.senders.tolist(), guests.ids.tolist(), seen.numpy(), strict=True):
            other = shared[sender]
            row = int(torch.nonzero(other.local.ids == number))
            theirs = known(other, mission.camera)[row] + len(other.local.keyframes) * LAMBDA
            told.append((theirs + mine + own * LAMBDA)[None])
            met += 1
        h = information.fisher(here.splats, mission.camera, pose).double().numpy()
        profile = information.yaw_profile(
            here.splats, mission.camera, pose.position, here.prior, damping=torch.from_numpy(LAMBDA),
            literal_views=here.views, method="views", n_yaws=4,
        )  # fmt: skip
        assert profile.gain_at(pose.yaw) == pytest.approx(((h + LAMBDA) / np.concatenate(told)).sum(), rel=1e-4)
    assert met > 20


def alpha(splats, points, level, sight_dims=None) -> np.ndarray:
    """Eq. (9) splat by splat: distance less √(nᵀ Σ n) times what the worst share of a normal variable averages."""
    worst = stats.norm.pdf(stats.norm.ppf(level)) / level
    means, covariances = splats.means.double().numpy(), splats.covariances().double().numpy()
    lowest = []
    for point in np.asarray(points, float):
        away = means - point
        away[:, sight_dims or len(point) :] = 0.0
        distance = np.linalg.norm(away, axis=1)
        sight = away / distance[:, None]
        lowest.append((distance - worst * np.sqrt(np.einsum("ni,nij,nj->n", sight, covariances, sight))).min())
    return np.array(lowest)


@pytest.mark.parametrize("dim", [2, 3])
def test_sigma_along_the_line_of_sight_reaches_forecasts_zones_prices_and_scores(dim):
    config = CONFIGS[dim].replace(spread="along", fit_steps=24)
    mission = mission_for(config, "single", dim, n=1)
    ((robot,), log) = cycled(mission)
    belief, (_, path) = robot.belief(config), announced(robot)
    counts = belief.splats.opacities.numpy() >= config.risk_opacity
    if dim == 3:  # as the body sees it: what stands in its height, as far away as it is horizontally
        height = belief.splats.means[:, 2].numpy() - (robot.position[2] - config.camera_height)
        counts &= (height >= config.body_low) & (height <= config.body_high)
    near = belief.splats.select(torch.from_numpy(counts))
    expected = alpha(near, path, config.level, 2)
    widest = near.scales.amax(1)
    assert (near.scales.amin(1) < 0.9 * widest).any()
    np.testing.assert_allclose(log.robots[0].risk, expected, atol=1e-4)
    zone = objective.zone(belief, path, config)
    np.testing.assert_allclose(zone.radii, 0.5 + np.exp(-2 * expected), rtol=1e-3)
    cells = np.zeros(belief.ground.lattice.shape, bool)
    cells[tuple(np.argwhere(belief.ground.state == 0)[::97].T)] = True
    price = planner.prices(belief.splats, belief.ground.lattice, cells, robot.position[2:], config)
    points = planner.raised(belief.ground.lattice.centers(np.argwhere(cells)), robot.position[2:])
    expected = 1 + 3 * np.exp(-np.maximum(alpha(near, points, config.level, 2), -0.9) / 0.3)
    np.testing.assert_allclose(price[cells], expected, rtol=1e-3)
    ahead = robot.route.waypoints[: len(robot.route.waypoints) // 2]
    surfaces = metrics.true_surfaces(mission.world)
    way = metrics.reference_path(belief, ahead[0], ahead[-1], config)
    scores = metrics.path_scores(belief, mission.world, surfaces, ahead[0], ahead[-1], ahead, config)
    assert scores["total_risk_m"] == pytest.approx(alpha(near, way, config.level, 2).mean(), abs=1e-4)
    assert episode.run(world.load("flat", dim=dim), "single", config, n_robots=1).finished


def test_an_answer_carries_the_gain_and_its_gradient_by_the_pose():
    """Section V-B, against differences of gains of views moved by hand, by the dense twin."""
    config = CONFIGS[2].replace(answers="gradient", codec="binary")
    mission = mission_for(config, "distributed", n=3)
    robots, _ = cycled(mission)
    robots = team.share(robots, mission, messages.Mailbox("binary"), team.REGISTRY["distributed"])
    robots = team.each(robots, team.evaluate, mission, team.serve)
    post = messages.Mailbox("binary", network=mission.network)
    heard = team.exchange(robots, team.suggest, mission, post)
    told = [(robot, note) for robot in heard for note in robot.choice.suggestions if note.gain > 0]
    assert len(told) >= 2
    for robot, note in told:
        teller = heard[note.robot]
        pose, path = announced(robot)
        zone = objective.zone(teller.belief(config), path, config)
        splats, H, v = (
            teller.local.splats,
            known(teller, mission.camera),
            torch.where(zone.selected, zone.weights, 0.0).double().numpy(),
        )

        def gain(x, y, yaw, splats=splats, H=H, v=v):
            view = geometry.yaw_pose(torch.tensor([x, y], dtype=torch.float64), yaw)
            h = information.fisher(splats.to(torch.float64), mission.camera, view, method="dense").numpy()
            return (v[:, None] * h / (H + LAMBDA)).sum()

        (x, y), yaw, eps = pose.position.tolist(), float(pose.yaw), 1e-6
        by_place = [(gain(x + eps * a, y + eps * b, yaw) - gain(x - eps * a, y - eps * b, yaw)) / (2 * eps)
                    for a, b in pose.rotation.T.tolist()]  # fmt: skip
        by_yaw = (gain(x, y, yaw + eps) - gain(x, y, yaw - eps)) / (2 * eps)
        expected = np.array([*by_place, by_yaw])
        np.testing.assert_allclose(note.gradient, expected, rtol=2e-3, atol=1e-3 * np.abs(expected).max())
        rough = objective.gradient(teller.belief(config), mission.camera, pose, path, config.replace(dense_gradient=0))
        assert np.abs(rough.numpy() - expected).max() <= 0.25 * np.abs(expected).max()  # the kernel drops faint shares
    sizes = {row[1] / row[0] for row in post.ledger.rows.values()}
    assert sizes == {44 + 4 + 3 * 8}
    assert episode.run("flat", "distributed", config, n_robots=2).finished


def test_a_view_at_every_pose_is_a_stride_of_one_step():
    """Every cycle moves by a step or two, the diagonal of a cell, turns to the yaw that it chose, and looks."""
    config = CONFIGS[2].replace(stride=0.05, max_cycles=12)
    record = episode.run("flat", "single", config, n_robots=1)
    (robot,) = record.robots
    places = np.array([log.robots[0].position for log in record.cycles] + [robot.position])
    moved = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert ((moved > 0.02) & (moved < 0.11)).all()
    frames = robot.local.keyframes[4:]  # after the first look around
    yaws = np.array([frame.pose.yaw for frame in frames])
    chosen = np.array([log.robots[0].chosen for log in record.cycles])
    assert len(frames) == 2 * len(record.cycles)
    assert np.abs(geometry.wrap(yaws[1::2] - chosen)).max() <= config.turn / 2 + 1e-6
    usual = episode.run("flat", "single", config.replace(stride=0.8, max_cycles=1), n_robots=1)
    assert len(usual.robots[0].trail) > len(robot.trail) / 2
    assert math.dist(usual.robots[0].trail[0], usual.robots[0].trail[-1]) > 0.5
