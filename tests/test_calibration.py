import dataclasses
import json
import math

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose
from scipy import stats
from scipy.stats import norm
from test_risk import by_hand

from mannbv import episode, network, risk, splats, team, world
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.lab import draw, study
from mannbv.lab.study import Forecasts
from mannbv.lab.study.resampling import bootstrap, pearson, ranks, weighted_mean
from mannbv.messages import Mailbox
from mannbv.team import Mission

TINY = Config(max_cycles=3, fit_steps=4, image_width=32)


def toy(rng, alpha, clearance=None, n_robots=40) -> Forecasts:
    """Waypoints of robots that have as many each; alpha: one or two functions of the clearances."""
    clearance = rng.uniform(0.1, 1.5, n_robots * 25) if clearance is None else clearance
    pair = alpha if isinstance(alpha, tuple) else (alpha, alpha)
    robot = np.repeat(np.arange(n_robots), len(clearance) // n_robots)
    return Forecasts(np.stack([f(clearance) for f in pair]), clearance, robot)


# ---- resampling -----------------------------------------------------------------------------------------------------


def test_ranks_and_correlations_of_weighted_samples_are_those_of_repeated_ones(rng):
    a, b = rng.integers(0, 12, 80).astype(float), rng.normal(size=80)
    b += 0.2 * a
    weights = rng.integers(0, 4, 80)
    many = [np.repeat(v, weights) for v in (a, b)]
    floats = weights.astype(float)
    assert_allclose(pearson(a, b, floats), stats.pearsonr(*many).statistic, rtol=1e-9)
    assert_allclose(pearson(ranks(a)(floats), ranks(b)(floats), floats), stats.spearmanr(*many).statistic, rtol=1e-9)
    assert math.isnan(pearson(np.ones(80), b, floats))


def test_the_interval_of_a_mean_is_that_of_the_closed_form(rng):
    values = rng.normal(2.0, 3.0, 400)
    value, low, high = bootstrap(lambda w: weighted_mean(values, w), np.arange(400), rng, 4000)
    half = 1.96 * values.std() / math.sqrt(400)
    assert value == pytest.approx(values.mean())
    assert_allclose([low, high], [value - half, value + half], atol=0.06 * half)
    # one of its units seen five times tells no more; taken for five units it would seem to
    units = np.repeat(np.arange(400), 5)
    copies = np.repeat(values, 5)
    _, low, high = bootstrap(lambda w: weighted_mean(copies, w), units, rng, 4000)
    assert_allclose(high - low, 2 * half, rtol=0.06)
    _, low, high = bootstrap(lambda w: weighted_mean(copies, w), np.arange(2000), rng, 2000)
    assert high - low < 0.6 * 2 * half


def test_intervals_over_robots_hold_the_truth_and_those_over_waypoints_do_not(rng):
    held = np.zeros((100, 2))
    for trial in held:
        both = rng.normal(size=(2, 40, 1)) + 0.3 * rng.normal(size=(2, 40, 10))  # robots differ, waypoints hardly
        a, b = both.reshape(2, -1)
        robot = np.repeat(np.arange(40), 10)
        for k, units in enumerate((robot, np.arange(400))):
            _, low, high = bootstrap(lambda w, a=a, b=b: pearson(a, b, w), units, rng, 200)
            trial[k] = low < 0 < high  # the truth: they have nothing to do with each other
    share = held.mean(0)
    assert share[0] >= 0.87
    assert share[1] < 0.65


def test_one_unit_has_no_interval_and_what_does_not_exist_is_nan(rng):
    values = np.arange(6.0)
    value, low, high = bootstrap(lambda w: weighted_mean(values, w), np.zeros(6, int), rng)
    assert value == 2.5
    assert np.isnan([low, high]).all()
    none = bootstrap(lambda w: np.array([np.nan, w.sum() / 6]), np.arange(6), rng, 20)
    assert np.isnan([part[0] for part in none]).all()
    assert [part[1] for part in none] == [1, 1, 1]


# ---- known answers --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("which", [0, 1])
def test_what_ranks_perfectly_is_told_from_what_ranks_at_random(which, rng):
    perfect, noise = (lambda c: 2 * c - 3), (lambda c: rng.normal(size=len(c)))
    found = study.calibrate(toy(rng, (noise, perfect) if which else (perfect, noise)), rng, draws=200)
    assert_allclose([part[which] for part in found.rank], 1.0, rtol=1e-12)
    assert_allclose([part[:, which] for part in found.auc], 1.0, rtol=1e-12)
    assert found.rank.low[1 - which] < 0 < found.rank.high[1 - which]
    assert (found.auc.low[:, 1 - which] < 0.5).all()
    assert (found.auc.high[:, 1 - which] > 0.5).all()
    assert found.better == study.KINDS[which]
    assert_allclose(found.rank_gained.value, found.rank.value[1] - found.rank.value[0])
    assert_allclose(found.auc_gained.value, found.auc.value[:, 1] - found.auc.value[:, 0])
    reverse = study.calibrate(toy(rng, lambda c: -c), rng, draws=20)
    assert_allclose(reverse.rank.value, -1)
    assert_allclose(reverse.auc.value, 0)


def test_of_two_equal_ones_none_is_better(rng):
    close = study.calibrate(toy(rng, lambda c: c + 0.1 * np.sin(20 * c)), rng, draws=100)
    assert close.better is None
    assert [float(part) for part in close.rank_gained] == [0, 0, 0]
    noisy = toy(rng, (lambda c: c + rng.normal(0, 0.3, len(c)), lambda c: c + rng.normal(0, 0.3, len(c))))
    assert study.calibrate(noisy, rng, draws=200).better is None
    one = dataclasses.replace(noisy, robot=np.zeros(1000, int))
    assert study.calibrate(one, rng, draws=20).better is None
    assert study.calibrate(one, rng, draws=20).n_robots == 1


def test_scores_agree_with_scipy(rng):
    waypoints = toy(
        rng, (lambda c: np.round(c + rng.normal(0, 0.4, len(c)), 1), lambda c: c + rng.normal(0, 0.9, len(c)))
    )
    found = study.calibrate(waypoints, rng, thresholds=(0.3, 0.9, 0.01), draws=20)
    for kind in (0, 1):
        assert_allclose(found.rank.value[kind], stats.spearmanr(waypoints.alpha[kind], waypoints.clearance).statistic)
        for row, limit in enumerate((0.3, 0.9)):
            bad = waypoints.clearance < limit
            pairs = stats.mannwhitneyu(waypoints.alpha[kind, ~bad], waypoints.alpha[kind, bad]).statistic
            assert_allclose(found.auc.value[row, kind], pairs / (bad.sum() * (~bad).sum()))
            assert found.dangerous[row] == bad.sum()
    assert found.dangerous[2] == 0  # nothing is so near: no area, and no warning
    assert np.isnan(found.auc.value[2]).all()


@pytest.mark.parametrize("level", [0.1, 0.3])
def test_a_value_at_risk_is_undercut_as_often_as_its_level_says(level, rng):
    mean = rng.uniform(0.5, 1.5, 20_000)
    clearance = rng.normal(mean, 0.2)
    robot = np.repeat(np.arange(200), 100)
    var, middle = risk.value_at_risk(mean, 0.2, level), risk.value_at_risk(mean, 0.2, 0.5)
    found = study.calibrate(Forecasts(np.stack([var, middle]), clearance, robot), rng, 5, draws=200)
    assert_allclose(found.overall.value, [level, 0.5], atol=0.012)
    assert_allclose(found.overconfident.value, np.array([[level], [0.5]]) * np.ones(5), atol=0.03)
    assert (found.overall.low < [level, 0.5]).all()
    assert (found.overall.high > [level, 0.5]).all()
    assert_allclose(found.bias.value, [norm.ppf(level) * 0.2, 0.0], atol=0.005)
    assert_allclose(found.clearance.value[1], found.alpha.value[1], atol=0.02)


def test_bins_hold_as_many_each_in_ascending_order(rng):
    waypoints = toy(rng, (lambda c: c**2, lambda c: -c))
    found = study.calibrate(waypoints, rng, 4, draws=20)
    for kind in (0, 1):
        order = np.argsort(waypoints.alpha[kind]).reshape(4, 250)
        assert_allclose(found.alpha.value[kind], waypoints.alpha[kind][order].mean(1))
        assert_allclose(found.clearance.value[kind], waypoints.clearance[order].mean(1))
        assert_allclose(found.overconfident.value[kind], (waypoints.clearance < waypoints.alpha[kind])[order].mean(1))
    assert (found.clearance.low <= found.clearance.value).all()
    assert (found.clearance.value <= found.clearance.high).all()


def test_the_same_seed_gives_the_same_numbers(rng):
    waypoints = toy(rng, lambda c: c + rng.normal(0, 0.3, len(c)))
    one, two, other = (study.calibrate(waypoints, np.random.default_rng(seed), draws=50).rank for seed in (3, 3, 4))
    assert (one.low == two.low).all()
    assert (one.low != other.low).any()


# ---- from episodes --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def place():
    return world.load("flat")


@pytest.fixture(scope="module")
def records(place):
    return [episode.run(place, strategy, TINY, seed, 2) for strategy in ("limited", "single") for seed in (0, 1)]


@pytest.mark.parametrize("strategy", ["centralized", "distributed"])
def test_a_cycle_reports_the_risk_that_its_robots_believed_in_when_they_planned(strategy, place):
    mission = Mission(place, Camera.from_fov(32), TINY, network.build("complete", 2), strategy, 0)
    start = place.starts[0]  # of both, so that their maps meet
    robots = [team.start(k, start[:2], float(start[2]) + k, place.goals[k], mission) for k in (0, 1)]
    post, guests_counted = Mailbox("json"), []
    for number in range(2):
        planned = [team.plan(team.observe(robot, mission, number), mission) for robot in robots]
        robots, cycle = team.cycle(robots, mission, post, number)
        for robot, log in zip(planned, cycle.robots, strict=True):
            both = splats.union(robot.local.splats, robot.guests.splats).to(torch.float64)
            wide = 1 / (torch.cat([robot.local.prior, robot.guests.prior])[:, :2] + TINY.damping_mean)
            own, path = robot.local.splats.to(torch.float64), np.array(log.path)
            plain = by_hand(both, path, TINY.level, "avar", "largest")
            inflated = by_hand(both, path, TINY.level, "avar", "largest", wide.double().numpy())
            assert_allclose(log.risk, plain, atol=1e-5)
            assert_allclose(log.risk_inflated, inflated, atol=1e-5)
            assert np.abs(plain - inflated).max() > 1e-3
            guests_counted.append(np.abs(plain - by_hand(own, path, TINY.level, "avar", "largest")).max() > 1e-3)
    json.dumps(cycle.to_json(), allow_nan=False)
    assert not any(guests_counted[:2])  # the first plans are older than the first maps received
    assert any(guests_counted[2:]) == (strategy == "centralized")


def test_a_robot_that_knows_nothing_near_foretells_none(place, monkeypatch):
    monkeypatch.setattr(risk, "in_reach", lambda splat_map, height, config: torch.zeros(splat_map.n_splats) > 0)
    record = episode.run(place, "single", TINY.replace(max_cycles=1), 0, 1)
    log = record.cycles[0].robots[0]
    assert log.risk == log.risk_inflated == (None,) * len(log.path)
    assert study.forecasts([record], place).unknown == len(log.path)
    with pytest.raises(study.StudyError, match="0 waypoints cannot fill 8 bins"):
        study.calibration([record], place)


def test_forecasts_are_all_announced_waypoints_with_their_true_clearance(records, place):
    waypoints = study.forecasts(records, place)
    rows = [
        (log.risk[k], log.risk_inflated[k], float(place.ground.clearance(np.array([point]))[0]), (record.seed, number))
        for record in records
        for cycle in record.cycles
        for number, log in enumerate(cycle.robots)
        for k, point in enumerate(log.path)
    ]
    assert len(rows) > 100
    assert_allclose(waypoints.alpha, np.array([row[:2] for row in rows]).T)
    assert_allclose(waypoints.clearance, [row[2] for row in rows])
    # one robot of one seed is one in every strategy
    assert len(np.unique(waypoints.robot)) == 4
    assert len(set(zip(waypoints.robot, (row[3] for row in rows), strict=True))) == 4
    found = study.calibration(records, place, draws=100)
    assert found.n_robots == 4
    assert_allclose(found.rank.value[0], stats.spearmanr(waypoints.alpha[0], waypoints.clearance).statistic)
    assert found.rank.value[0] > 0.5


def test_what_a_calibration_refuses(records, place):
    with pytest.raises(study.StudyError, match="flat, limited, seed 0, is no episode in corridor; give the world"):
        study.calibration(records, world.load("corridor"))
    values = records[0].cycles[0].to_json()
    for robot in values["robots"]:
        del robot["risk"], robot["risk_inflated"]
    old = dataclasses.replace(records[0], cycles=(team.CycleLog.from_json(values),))
    with pytest.raises(study.StudyError, match="is an older record without forecasts; run it again"):
        study.calibration([old], place)
    with pytest.raises(study.StudyError, match="no waypoint was announced"):
        study.calibration([dataclasses.replace(records[0], cycles=())], place)


def test_the_figure_shows_bins_intervals_and_scores(records, place, tmp_path):
    found = study.calibration(records, place, draws=100)
    made = draw.calibration_figure(found)
    for kind, ax in enumerate(made.axes[:2]):
        points, diagonal, bins = ax.lines[:3]
        assert len(points.get_xdata()) == min(3000, len(found.forecasts.clearance))
        assert_allclose(diagonal.get_xdata(), diagonal.get_ydata())
        assert_allclose(bins.get_xdata(), found.alpha.value[kind])
        assert_allclose(bins.get_ydata(), found.clearance.value[kind])
        ends = np.array(ax.collections[0].get_segments())
        assert_allclose(ends[:, :, 1].T, [found.clearance.low[kind], found.clearance.high[kind]])
        assert f"{found.rank.value[kind]:.2f} (" in ax.get_title(loc="left")
    shares = [box[0] for box in made.axes[2].containers]
    for kind in (0, 1):
        assert_allclose(shares[kind].get_ydata(), 100 * found.overconfident.value[kind])
    draw.save(made, tmp_path / "a.png")
    alone = dataclasses.replace(found.forecasts, robot=np.zeros(len(found.forecasts.robot), int))
    bare = draw.calibration_figure(study.calibrate(alone, np.random.default_rng(0), draws=20))
    draw.save(bare, tmp_path / "b.png")  # one robot: no intervals, and no warning
    assert "(" not in bare.axes[0].get_title(loc="left")
    assert (tmp_path / "a.png").read_bytes() != (tmp_path / "b.png").read_bytes()
