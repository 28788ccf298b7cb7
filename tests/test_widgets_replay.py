"""The replay of an episode in space: its record without maps, its recording, and the canvas, against the run itself."""

import dataclasses
import math
import re

import numpy as np
import pytest
import torch
from helpers import at_goal

from mannbv import episode, geometry, render, world
from mannbv.camera import Camera
from mannbv.config import PRESETS
from mannbv.course import widgets
from mannbv.course.widgets.playback import Playback
from mannbv.course.widgets.recording import Recording, without_maps
from mannbv.grid import FREE, OCCUPIED, UNKNOWN

CONFIG = PRESETS[3]["quick"].replace(
    image_width=16, image_height=16, fit_steps=4, max_cycles=3, n_yaws=36, rounds=6, n_subgoals=2
)


@pytest.fixture(scope="module")
def place():
    return world.load("flat", dim=3)


@pytest.fixture(scope="module")
def kept(place):
    """The records after every cycle of two robots, and at last with its scores."""
    records = []
    episode.run(place, "distributed", CONFIG, n_robots=2, progress=records.append)
    return records


@pytest.fixture(scope="module")
def recording(kept, place):
    return Recording.of(kept, place)


def shown(explorer, **values):
    return explorer.picture(**explorer.values | values)


def pixels(panel) -> np.ndarray:
    """A panel's image (rows, columns, 3), first row on top."""
    (item,) = (item for item in panel["items"] if item["kind"] == "image")
    return np.frombuffer(item["rgba"], np.uint8).reshape(*item["shape"], 4)[..., :3]


def camera_and_pose(log):
    pose = geometry.yaw_pose(torch.tensor(log.position), log.yaw)
    return Camera.from_fov(16, 16, CONFIG.fov), pose


# ---- the recording --------------------------------------------------------------------------------------------------


def test_the_first_picture_is_the_sensors_and_the_others_are_its_own_maps_before_and_after(kept, recording, place):
    assert recording.views.shape == (3, 2, 3, 16, 16, 3) and recording.psnr.shape == (3, 2, 2)
    for cycle in range(3):
        for k, log in enumerate(kept[2].cycles[cycle].robots):
            camera, pose = camera_and_pose(log)
            seen, before, after = recording.views[cycle, k] / 255
            assert np.abs(seen - place.sense(camera, pose).color.numpy()).max() < 0.003
            drawn = render.render(kept[cycle].robots[k].local.splats, camera, pose, method="dense").color.clamp(0, 1)
            assert np.abs(after - drawn.numpy()).mean() < 0.01
            if cycle:
                drawn = render.render(kept[cycle - 1].robots[k].local.splats, camera, pose, method="dense").color
                assert np.abs(before - drawn.clamp(0, 1).numpy()).mean() < 0.01
            else:
                assert (before == 1).all() and np.isnan(recording.psnr[0, k, 0])


def test_psnr_is_that_of_the_pictures(recording):
    for cycle, k, which in ((0, 0, 1), (1, 0, 0), (2, 1, 0), (2, 1, 1)):
        seen, picture = recording.views[cycle, k, [0, which + 1]] / 255
        assert recording.psnr[cycle, k, which] == pytest.approx(
            -10 * math.log10(((picture - seen) ** 2).mean()), abs=0.4
        )


def test_the_ground_is_that_of_the_robot_after_the_cycle(kept, recording):
    like = kept[-1].robots[0].ground
    for cycle in range(3):
        for k in range(2):
            ground = recording.ground(cycle, k, like)
            assert np.array_equal(ground.state, kept[cycle].robots[k].ground.state) and ground.lattice is like.lattice
    assert set(np.unique(recording.state)) == {UNKNOWN, FREE, OCCUPIED}


def test_a_recording_is_read_as_it_was_written_but_for_jpeg(recording, tmp_path):
    recording.save(tmp_path / "recording.npz")
    again = Recording.load(tmp_path / "recording.npz")
    assert np.array_equal(again.state, recording.state) and np.array_equal(again.psnr, recording.psnr, equal_nan=True)
    ours, theirs = (each.views.reshape(18, -1).astype(float) for each in (recording, again))
    apart = np.abs(ours[:, None] - theirs).mean(-1)
    assert apart.diagonal().max() < 16
    assert (apart.diagonal() < apart.min(0) + 1).all()  # no picture has taken another's place
    assert (tmp_path / "recording.npz").stat().st_size < 0.7 * (recording.views.nbytes + recording.state.nbytes / 4)


def test_an_archive_that_is_no_recording_is_named_in_one_line(tmp_path):
    np.savez(tmp_path / "recording.npz", shape=[1, 2])
    with pytest.raises(ValueError, match=r"recording\.npz: no recording \(.*tools/records\.py") as caught:
        Recording.load(tmp_path / "recording.npz")
    assert "\n" not in str(caught.value)


# ---- the record without maps ----------------------------------------------------------------------------------------


def test_a_record_without_maps_keeps_all_but_maps_and_images(kept, tmp_path):
    whole, path = kept[-1], tmp_path / "without_maps.npz"
    without_maps(whole).save(path)
    again = episode.load(path)
    assert again.rows == whole.rows and again.ledger.rows == whole.ledger.rows and again.config == whole.config
    for ours, theirs in zip(again.robots, whole.robots, strict=True):
        assert ours.local.splats.n_splats == 0 and ours.local.keyframes == () and ours.frames == ()
        assert np.array_equal(ours.trail, theirs.trail) and np.array_equal(ours.ground.state, theirs.ground.state)
    for ours, theirs in zip(again.cycles, whole.cycles, strict=True):
        for a, b in zip(ours.robots, theirs.robots, strict=True):
            assert (a.splats, a.status) == (b.splats, b.status)
            assert np.allclose(a.path, b.path, atol=6e-5) and a.chosen == pytest.approx(b.chosen, abs=6e-5)
    whole.save(tmp_path / "whole.npz")
    assert path.stat().st_size < (tmp_path / "whole.npz").stat().st_size / 5


# ---- on the canvas --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("given", ["records", "files"])
def test_pictures_and_ground_are_those_of_the_cycle_and_the_robot(kept, recording, tmp_path, given, place):
    record = without_maps(kept[-1])
    if given == "files":
        record.save(tmp_path / "without_maps.npz")
        recording.save(tmp_path / "recording.npz")
        explorer = widgets.replay(tmp_path / "without_maps.npz", str(tmp_path / "recording.npz"))
        recording = Recording.load(tmp_path / "recording.npz")
    else:
        explorer = widgets.replay(record, recording, place)
    for time, robot in ((0.0, 0), (1.4, 1), (3.0, 0)):
        cycle = min(int(time), 2)
        (plan, *views, chart), says = shown(explorer, cycle=time, robot=robot)
        assert [np.array_equal(pixels(v), recording.views[cycle, robot, k]) for k, v in enumerate(views)] == [True] * 3
        blocked = (pixels(plan) == 0x8A).all(-1)  # the plan's first row is its highest y
        assert np.array_equal(blocked, (recording.state[cycle, robot] == OCCUPIED).T[::-1])
        log = kept[-1].cycles[cycle].robots[robot]
        assert f"cycle {cycle}, robot {robot} {log.status}, {log.splats:,} splats" in says
        assert chart["title"] == "splats in the own map [1]" and "nan" not in says


def test_agreed_and_lonely_yaw_are_told_in_degrees(kept, recording, place):
    _, says = shown(widgets.replay(kept[-1], recording, place), cycle=1.0, robot=1)
    log = kept[-1].cycles[1].robots[1]
    numbers = re.search(r"looks next along (\S+)°, alone (\S+)°; .* to (\d+) dB before and to (\d+) dB after", says)
    expected = [math.degrees(log.chosen), math.degrees(log.announced), *recording.psnr[1, 1]]
    assert [float(n) for n in numbers.groups()] == pytest.approx(expected, abs=0.51)


def test_a_slider_that_has_added_up_to_a_whole_cycle_is_there(kept, recording, place):
    _, says = shown(widgets.replay(kept[-1], recording, place), cycle=1.0 - 1e-12)
    assert says.startswith("cycle 1,")


def test_the_true_plan_takes_the_place_of_the_ground(kept, recording, place):
    explorer = widgets.replay(kept[-1], recording, place)
    (plan, *_), _ = shown(explorer, layer="true plan")
    lines = [item for item in plan["items"] if item["kind"] == "line"]
    assert not [item for item in plan["items"] if item["kind"] == "image"]
    assert len(lines) > len(world.load("flat").seen.ends)


def test_a_robot_at_its_goal_looks_nowhere_next(kept, recording, place):
    ended = (*kept[-1].cycles[:2], at_goal(kept[-1].cycles[2], 0))
    _, says = shown(widgets.replay(dataclasses.replace(kept[-1], cycles=ended), recording, place), cycle=3.0)
    assert "reached" in says and "looks next" not in says


def test_a_recording_of_another_episode_is_refused(kept, recording, place):
    other = dataclasses.replace(
        recording, state=recording.state[:2], views=recording.views[:2], psnr=recording.psnr[:2]
    )
    with pytest.raises(ValueError, match="the record has cycles, robots and cells"):
        widgets.replay(kept[-1], other, place)


# ---- the player, in space -------------------------------------------------------------------------------------------


def test_the_player_serves_records_of_space(kept, place):
    assert Playback(kept[-1]).place.dim == 3  # found by its name
    explorer = widgets.player(kept[:3], place)
    for layer in explorer.settings["layer"].sweep():
        for time in (0.0, 1.5, 3.0):
            panels, says = shown(explorer, layer=layer, cycle=time, robot=1)
            assert panels and "probe: α" in says and "nan" not in says
    (ellipses,) = (item for item in shown(explorer, cycle=1.0)[0][0]["items"] if item["kind"] == "ellipses")
    assert len(ellipses["shapes"]) == 20 * kept[1].robots[0].local.splats.n_splats
