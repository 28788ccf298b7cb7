"""tools/records.py: what notebook 15 reads is what was run, shortened as it says, and faults are named in one line."""

import dataclasses
import importlib.util
import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch

from mannbv import episode, geometry, planner, render, splats, world
from mannbv.camera import Camera
from mannbv.config import PRESETS
from mannbv.course.widgets.recording import Recording
from mannbv.lab import study

ROOT = Path(__file__).resolve().parent.parent
SMALL = {"image_width": 16, "image_height": 16, "fit_steps": 4, "n_yaws": 36, "rounds": 4, "n_subgoals": 2}
SHIPPED = ROOT / "notebooks" / "records"


@pytest.fixture(scope="module")
def records():
    spec = importlib.util.spec_from_file_location("records", ROOT / "tools" / "records.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A folder of runs of the flat, in the plane and in space."""
    folder = tmp_path_factory.mktemp("evaluation")
    for dim, strategy in ((3, "distributed"), (3, "centralized"), (2, "distributed"), (2, "single")):
        config = PRESETS[dim]["quick"].replace(**SMALL, max_cycles=2)
        path = folder / f"{dim}" / "runs" / f"{strategy}-0.npz"
        episode.run(world.load("flat", dim=dim), strategy, config, n_robots=2, path=path)
    return folder


@pytest.fixture(scope="module")
def made(records, runs, tmp_path_factory):
    out = tmp_path_factory.mktemp("records")
    assert records.main(["evaluation", str(runs / "2"), str(runs / "3"), "--out", str(out)]) == 0
    with np.load(out / "15_evaluation.npz", allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def test_scores_are_those_of_the_runs_to_six_digits(made, runs):
    several, _ = study.gather([runs / "2", runs / "3"])
    kept = [study.Results.from_json(values) for values in json.loads(bytes(made["results"]))]
    assert [(one.dim, len(one.rows)) for one in kept] == [(one.dim, len(one.rows)) for one in several]
    for ours, theirs in zip(kept, several, strict=True):
        assert ours.episodes[0].splats == theirs.episodes[0].splats
        for row, true in zip(ours.rows, theirs.rows, strict=True):
            numbers = {key: value for key, value in true.to_json().items() if isinstance(value, float)}
            assert {key: getattr(row, key) for key in numbers} == pytest.approx(numbers, rel=1e-5)
            assert dataclasses.replace(row, **numbers) == true and len(numbers) > 5


def test_waypoints_are_forecasts_to_the_millimetre(made, runs, records, monkeypatch):
    place, all_runs = world.load("flat", dim=3), _space(runs)
    forecasts = study.forecasts(all_runs, place)
    assert np.abs(made["waypoint_alpha"] / 1000 - forecasts.alpha).max() <= 0.00051
    clearance = np.concatenate([place.ground.clearance(_paths(run)) for run in all_runs])
    assert np.abs(made["waypoint_clearance"] / 1000 - clearance).max() <= 0.00051
    assert np.array_equal(made["waypoint_robot"], forecasts.robot)
    monkeypatch.setattr(records, "WAYPOINTS", 10)
    thin = records._forecasts("waypoint", forecasts)
    assert 5 <= len(thin["waypoint_robot"]) <= 10
    assert set(thin["waypoint_clearance"]) <= set(made["waypoint_clearance"])


def _space(runs) -> list:
    """The runs in space, in the order of their files."""
    return [episode.load(runs / "3" / "runs" / f"{strategy}-0.npz") for strategy in ("centralized", "distributed")]


def test_a_second_building_has_robots_of_its_own(records, runs):
    paths = [runs / "3" / "runs" / "distributed-0.npz"]
    columns = records._building(2, "flat", paths)
    assert set(columns["waypoint_robot"]) == set(columns["hindsight_robot"]) == {2000, 2001}
    assert set(columns["view_robot"]) <= {2000, 2001} and not any(name.startswith("haze") for name in columns)


def test_in_hindsight_the_last_map_is_asked_from_the_camera_and_from_the_body(runs, records):
    run = _space(runs)[1]
    late = records.in_hindsight(run)
    for cycle, before in zip(late.cycles, run.cycles, strict=True):
        for robot, log, old in zip(run.robots, cycle.robots, before.robots, strict=True):
            means, std = robot.local.splats.means.numpy(), robot.local.splats.scales.amax(1).numpy()
            reach = (means[:, 2] >= 0.1) & (means[:, 2] <= 1.3) & (robot.local.splats.opacities.numpy() >= 0.5)
            away = np.array(log.path)[:, None] - means[reach]
            for axes, kind in ((3, "risk"), (2, "risk_inflated")):
                distance = np.linalg.norm(away[..., :axes], axis=-1)
                expected = (distance - 1.7549833193248685 * std[reach]).min(1)  # the worst tenth of a Gaussian
                assert np.allclose(getattr(log, kind), expected, atol=1e-4)
            assert log.path == old.path and log.risk != old.risk


def test_haze_is_scored_on_the_own_map_with_everything_and_with_what_is_sent(made, runs):
    run, place = _space(runs)[0], world.load("flat", dim=3)
    maps = [robot.local.splats for robot in run.robots]
    camera = Camera.from_fov(16, 16, run.config.fov)
    assert made["haze_psnr"].shape == made["haze_depth"].shape == (3, 2)
    for k, robot in enumerate(run.robots):
        other = maps[1 - k]
        sent = other.select(other.scales.amax(1) <= 0.1)
        assert 0 < sent.n_splats < other.n_splats
        for row, held in enumerate((maps[k], splats.union(other, maps[k]), splats.union(sent, maps[k]))):
            stops = planner.thin(robot.trail[[0, len(robot.trail) // 2, -1]], 1.0)  # this way is a short one
            psnr, depth = _quality(held, place, camera, stops)
            assert made["haze_psnr"][row, k] == pytest.approx(psnr, abs=0.02)
            assert made["haze_depth"][row, k] == pytest.approx(depth, abs=0.005)


def _quality(splat_map, place, camera, stops) -> tuple[float, float]:
    """PSNR [dB] and depth error [m] of a map at stops (k, 3), eight headings each."""
    squares, gaps = [], []
    for stop, heading in itertools.product(stops, range(8)):
        pose = geometry.yaw_pose(stop, heading * math.pi / 4)
        truth = place.sense(camera, pose)
        drawn = render.render(splat_map, camera, pose)
        squares.append(((drawn.color - truth.color) ** 2)[truth.valid].ravel())
        gaps.append((drawn.depth - truth.depth).abs()[truth.valid])
    return -10 * math.log10(torch.cat(squares).mean()), float(torch.cat(gaps).mean())


def _paths(record) -> np.ndarray:
    """Announced waypoints (k, 3) [m] whose α is known."""
    logs = [robot for cycle in record.cycles for robot in cycle.robots]
    return np.array([
        point
        for log in logs
        for point, *alpha in zip(log.path, log.risk, log.risk_inflated, strict=True)
        if None not in alpha
    ])  # fmt: skip


def test_views_are_those_of_the_distributed_run(made, runs):
    run = episode.load(runs / "3" / "runs" / "distributed-0.npz")
    views = study.same_views(run, world.load("flat"))
    assert np.allclose(made["view_share"], views.share, atol=1e-6) and np.array_equal(made["view_robot"], views.robot)


def test_an_episode_becomes_a_record_and_a_recording_that_belong_together(records, tmp_path, monkeypatch):
    monkeypatch.setattr(records, "PRESETS", {3: {"quick": PRESETS[3]["quick"].replace(**SMALL, max_cycles=1)}})
    assert records.main(["episode", "--out", str(tmp_path)]) == 0
    record, recording = episode.load(tmp_path / "15_episode.npz"), Recording.load(tmp_path / "15_recording.npz")
    assert record.n_robots == 5 and record.finished and len(record.rows) == 5
    assert recording.state.shape == (1, 5, *record.robots[0].ground.lattice.shape)
    assert np.array_equal(recording.state[-1], [robot.ground.state for robot in record.robots])


def test_what_is_shipped_fits_together_and_is_small():
    record, recording = episode.load(SHIPPED / "15_episode.npz"), Recording.load(SHIPPED / "15_recording.npz")
    assert recording.state.shape[:2] == (len(record.cycles), record.n_robots)
    assert np.array_equal(recording.state[-1], [robot.ground.state for robot in record.robots])
    assert sum(path.stat().st_size for path in SHIPPED.glob("15_*")) <= 1_000_000


@pytest.mark.parametrize(("asked", "words"), [(["evaluation", "{}/none"], "no such file"), (["evaluation"], "folders")])
def test_faults_are_told_in_one_line_and_nothing_is_written(records, tmp_path, capsys, asked, words):
    command = [part.format(tmp_path) for part in asked] + ["--out", str(tmp_path / "out")]
    try:
        code = records.main(command)
    except SystemExit as error:
        code = error.code
    printed = capsys.readouterr().err
    assert code == 2 and words in printed and "Traceback" not in printed
    assert not list(tmp_path.rglob("*.npz"))
