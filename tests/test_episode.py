"""The loop, its record, and what survives a kill."""

import json
import math

import numpy as np
import pytest
import torch

from mannbv import episode, metrics, risk, world
from mannbv.config import PRESETS, Config
from mannbv.grid import FREE, OCCUPIED

SMALL = Config(image_width=32, fit_steps=4, max_cycles=3, n_yaws=72, rounds=6, n_subgoals=2)
SPACE = PRESETS[3]["quick"].replace(
    image_width=24, image_height=24, fit_steps=4, max_cycles=2, n_yaws=72, rounds=6, n_subgoals=2
)
BOTH = [(2, SMALL), (3, SPACE)]


def without_times(record: episode.Record) -> str:
    cycles = [{k: v for k, v in log.to_json().items() if k != "seconds"} for log in record.cycles]
    rows = [{k: v for k, v in row.to_json().items() if k != "seconds"} for row in record.rows]
    return json.dumps([cycles, rows, record.ledger.to_json(), record.finished])


def same_robots(a: episode.Record, b: episode.Record) -> bool:
    packed = [[episode.to_arrays(robot) for robot in record.robots] for record in (a, b)]
    return all(
        p.keys() == q.keys() and all(np.array_equal(p[k], q[k]) for k in p) for p, q in zip(*packed, strict=True)
    )


@pytest.mark.parametrize(
    ("strategy", "dim", "small"),
    [
        *((strategy, dim, small) for strategy in ("limited", "centralized") for dim, small in BOTH),
        ("distributed", 2, SMALL.replace(solver="cadmm-stochastic")),
    ],
)
def test_a_run_resumed_after_any_cycle_is_the_run_itself(tmp_path, strategy, dim, small):
    snapshots = []

    def keep(record):
        path = tmp_path / f"{len(snapshots)}.npz"
        record.save(path)
        snapshots.append(path)

    config, place = small.replace(depth_noise=0.01, color_noise=0.02), world.load("flat", dim=dim)
    whole = episode.run(place, strategy, config, seed=1, n_robots=2, progress=keep)
    assert len(snapshots) == config.max_cycles + 1  # and the scores
    for path in snapshots:
        resumed = episode.run(place, strategy, config, seed=1, n_robots=2, path=path)
        assert without_times(resumed) == without_times(whole)
        assert same_robots(resumed, whole)


def test_the_same_seed_gives_the_same_record_and_another_one_does_not():
    config = SMALL.replace(max_cycles=1)
    runs = [episode.run("flat", "distributed", config, seed=s, n_robots=2) for s in (3, 3, 4)]
    assert without_times(runs[0]) == without_times(runs[1])
    assert without_times(runs[0]) != without_times(runs[2])


def test_a_seed_and_a_team_counted_by_numpy_can_be_saved(tmp_path, unchecked):
    record = episode.run("flat", "single", SMALL.replace(max_cycles=0), np.int64(0), np.int64(1), tmp_path / "a.npz")
    assert episode.load(tmp_path / "a.npz").seed == record.seed == 0


def test_saving_and_loading_keeps_every_number(tmp_path):
    record = episode.run("flat", "limited", SMALL.replace(max_cycles=1), n_robots=2)
    record.save(tmp_path / "run.npz")
    again = episode.load(tmp_path / "run.npz")
    assert without_times(again) == without_times(record)
    assert same_robots(again, record)
    assert again.config == record.config


def test_robots_reach_their_goals_and_the_scores_hold_together():
    """One whole small episode: two robots in the flat, single strategy, to the end."""
    config = Config(image_width=48, fit_steps=8, max_cycles=40, n_subgoals=2)
    record = episode.run("flat", "single", config, n_robots=2)
    place = world.load("flat")
    for robot, row in zip(record.robots, record.rows, strict=True):
        assert row.reached and row.fate == "reached"
        assert np.linalg.norm(robot.position - place.goals[robot.index]) <= config.reach
        length = np.linalg.norm(np.diff(robot.trail, axis=0), axis=1).sum()
        assert row.path_length_m == pytest.approx(length)
        assert row.min_clearance_m == pytest.approx(place.ground.clearance(robot.trail).min())
        assert row.min_clearance_m >= config.robot_radius and row.collisions == 0
        shortest = place.ground.shortest_path(place.starts[robot.index], place.goals[robot.index], config.robot_radius)
        best = np.linalg.norm(np.diff(shortest, axis=0), axis=1).sum()
        assert row.spl == pytest.approx(best / max(best, length))
        assert row.bytes_sent == row.bytes_received == 0
        assert 0 < row.coverage <= 1 and 10 < row.psnr_db < 40 and 0 < row.depth_mae_m < 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"strategy": "telepathy"}, "telepathy"),
        ({"n_robots": 0}, "number of robots must be a whole number from 1, got 0"),
        ({"n_robots": 2.0}, "number of robots must be a whole number"),
        ({"n_robots": 11}, "11 robots"),
        ({"seed": -1}, "seed"),
        ({"seed": 1.5}, "seed must be a whole number from 0, got 1.5"),
        ({"seed": "one"}, "seed"),
        ({"config": SMALL.replace(network="web")}, "web"),
        ({"config": SMALL.replace(solver="dice", max_cycles=1)}, "dice"),
        ({"config": SMALL.replace(measure="luck", max_cycles=1)}, "luck"),
        ({"scene": "atlantis"}, "atlantis"),
    ],
)
def test_bad_requests_are_named_in_one_line(change, words, unchecked):
    request = {"scene": "flat", "strategy": "distributed", "config": SMALL, "seed": 0, "n_robots": 2} | change
    scene, strategy = request.pop("scene"), request.pop("strategy")
    with pytest.raises(ValueError, match=words) as caught:
        episode.run(scene, strategy, **request)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("fault", ["missing", "other run"])
def test_bad_records_are_named(tmp_path, fault):
    path = tmp_path / "run.npz"
    if fault == "other run":
        episode.run("flat", "single", SMALL.replace(max_cycles=0), n_robots=1, path=path)
    with pytest.raises(episode.RecordError) as caught:
        episode.load(path) if fault == "missing" else episode.run("flat", "single", SMALL, 1, 1, path)
    assert "run.npz" in str(caught.value) and "\n" not in str(caught.value)


def test_an_unreachable_goal_is_refused_before_anything_runs(place_with_island):
    with pytest.raises(ValueError, match="outside the building"):
        episode.run(place_with_island, "single", SMALL, n_robots=1)


@pytest.fixture
def place_with_island():
    """The flat with its first goal outside the building."""
    import dataclasses

    place = world.load("flat")
    goals = place.goals.copy()
    goals[0] = place.seen.upper + 1.0
    return dataclasses.replace(place, goals=goals)


def test_a_robot_without_a_way_says_why():
    """Shut in by its own margin, a robot is stuck, not lost: the episode ends and names it."""
    record = episode.run("flat", "single", SMALL.replace(margin=3.0, max_cycles=10), n_robots=1)
    assert len(record.cycles) == 3
    assert record.rows[0].fate == "no frontier left to go to" and not record.rows[0].reached
    assert record.rows[0].path_overhead is None
    assert json.loads(json.dumps(record.rows[0].to_json()))["total_risk_m"] is None


def test_noise_reaches_the_map():
    quiet, loud = (
        episode.run("flat", "single", SMALL.replace(max_cycles=1, depth_noise=noise), n_robots=1)
        for noise in (0.0, 0.05)
    )
    assert not torch.equal(quiet.robots[0].local.splats.means[:50], loud.robots[0].local.splats.means[:50])
    assert math.isfinite(loud.rows[0].depth_mae_m)


# ---- in space -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def spatial():
    """Four cycles of a robot in the 3-D flat, and what it was asked."""
    config = SPACE.replace(image_width=32, image_height=32, max_cycles=4, fit_steps=8)
    return episode.run(world.load("flat", dim=3), "single", config, n_robots=1), config


def test_a_robot_in_space_stays_at_camera_height_and_keeps_clear_of_what_stands_there(spatial):
    record, config = spatial
    (robot,), (row,) = record.robots, record.rows
    assert np.array_equal(np.unique(robot.trail[:, 2]), [config.camera_height])
    assert len(robot.trail) > 40
    clear = world.load("flat", dim=3).ground.clearance(robot.trail)
    assert row.min_clearance_m == clear.min() >= config.robot_radius
    assert row.collisions == 0


def test_what_a_robot_in_space_takes_for_ground_is_ground(spatial):
    record, _ = spatial
    known, place = record.robots[0].ground, world.load("flat", dim=3)
    centers = known.lattice.centers().reshape(-1, 2)
    clear = place.ground.clearance(centers).reshape(known.lattice.shape)
    inside = place.ground.inside(centers).reshape(known.lattice.shape)
    assert (clear[(known.state == OCCUPIED) & inside] <= 0.05).all()  # a surface in each, at most half a diagonal away
    assert (known.state == FREE).sum() > 3000
    assert (clear[(known.state == FREE) & inside] > 0).mean() > 0.97


def test_risk_in_space_is_of_what_the_body_can_touch(spatial):
    record, config = spatial
    robot = record.robots[0]
    own, path = robot.local.splats, torch.from_numpy(np.array(record.cycles[-1].robots[0].path))
    height = own.means[:, 2].numpy()
    reach = (height >= 0.1) & (height <= 1.3) & (own.opacities.numpy() >= config.risk_opacity)
    std = own.scales[torch.from_numpy(reach)].double().amax(1)
    for axes, measured_from in ((2, "body"), (3, "camera")):
        away = torch.cdist(path[:, :axes], own.means[torch.from_numpy(reach), :axes].double())
        expected = (away - 1.7549833193248685 * std).amin(1)  # of a Gaussian's worst tenth: exp(−ι²) / (0.1 √(2π))
        found = risk.along(own, path, config.replace(risk_from=measured_from)).double()
        assert torch.allclose(found, expected, atol=1e-5)
    assert (risk.field(own, path, config.level) < expected - 0.01).any()  # elsewhere floor and ceiling count


def test_risk_on_the_true_surfaces_is_the_clearance():
    """By the body; a robot's camera is farther from low furniture than its body is."""
    config = SPACE
    place = world.load("flat", dim=3)
    lattice, free = place.ground.free_grid(0.05, 0.1)
    spots = lattice.centers(np.argwhere(free)[::97])
    path = np.column_stack([spots, np.full(len(spots), config.camera_height)])
    surfaces = metrics.true_surfaces(place)
    body, camera = (
        risk.along(surfaces, torch.from_numpy(path), config.replace(risk_from=name)).numpy()
        for name in ("body", "camera")
    )
    assert np.abs(body - place.ground.clearance(path)).max() < 0.02
    assert (camera > body - 1e-6).all() and (camera > body + 0.1).any()
