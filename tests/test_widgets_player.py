"""The player: who stands where when, whose map is shown, and the numbers beside it, against the record itself."""

import dataclasses
import math
import re

import numpy as np
import pytest
import torch
from helpers import at_goal
from scipy import stats

from mannbv import episode, messages, world
from mannbv.config import Config
from mannbv.course import widgets
from mannbv.course.widgets.playback import Playback

CONFIG = Config(image_width=32, fit_steps=4, max_cycles=3, n_yaws=72, rounds=6, n_subgoals=2)


@pytest.fixture(scope="module")
def kept():
    """The records after every cycle of two robots, and at last with its scores."""
    records = []
    episode.run("flat", "limited", CONFIG, n_robots=2, progress=records.append)
    return records


def points(item) -> np.ndarray:
    return np.frombuffer(item["points"], np.float32).reshape(-1, 2)


def shown(explorer, **values):
    panels, says = explorer.picture(**explorer.values | values)
    return panels, says


def handle(panel) -> dict:
    return next(item for item in panel["items"] if item["kind"] == "handle")


def test_at_whole_cycles_the_robots_stand_and_look_as_the_record_says(kept):
    playback = Playback(kept)
    for k, robot in enumerate(kept[-1].robots):
        for number, log in enumerate(kept[-1].logs(k)):
            trail, here, yaw = playback.stand(float(number), k)
            assert np.allclose(here, log.position) and yaw == log.yaw and np.array_equal(trail[-1], here)
        trail, here, yaw = playback.stand(float(len(kept[-1].cycles)), k)
        assert (
            np.allclose(here, robot.position)
            and yaw == robot.yaw
            and np.allclose(trail[:-1], robot.trail[: len(trail) - 1])
        )


def test_between_two_cycles_a_robot_is_on_its_way_and_faces_along_it(kept):
    playback, robot = Playback(kept), kept[-1].robots[0]
    starts = [log.position for log in kept[-1].logs(0)[:2]]
    trail, here, yaw = playback.stand(0.5, 0)
    assert min(np.linalg.norm(here - starts[0]), np.linalg.norm(here - starts[1])) > 0.1
    a, b = robot.trail[:-1], robot.trail[1:]
    share = np.clip(((here - a) * (b - a)).sum(1) / ((b - a) ** 2).sum(1), 0, 1)
    away = np.linalg.norm(a + share[:, None] * (b - a) - here, axis=1)
    on = int(np.argmin(away))
    assert away[on] < 1e-9 and len(trail) == on + 2
    assert math.cos(yaw - math.atan2(*(b - a)[on][::-1])) > 1 - 1e-9
    driven = np.linalg.norm(np.diff(playback.stand(1.0, 0)[0], axis=0), axis=1).sum()
    assert np.linalg.norm(np.diff(trail, axis=0), axis=1).sum() == pytest.approx(driven / 2, rel=0.1)


def test_the_map_is_that_of_the_cycle_where_records_of_every_cycle_are_given(kept):
    playback = Playback(kept)
    for number, cycle in enumerate(kept[-1].cycles):
        for k, log in enumerate(cycle.robots):
            assert playback.belief(number, k).splats.n_splats == log.splats + log.guests
            assert playback.ground(number, k) is kept[number].robots[k].ground
    panels, says = shown(widgets.player(kept), cycle=1.0, robot=1)
    log = kept[-1].cycles[1].robots[1]
    (ellipses,) = (item for item in panels[0]["items"] if item["kind"] == "ellipses")
    assert len(ellipses["shapes"]) == 20 * (log.splats + log.guests)
    assert f"{log.splats} splats" in says and panels[0]["title"] == "robot 1: its splats"


def test_one_record_has_maps_of_its_end_only_and_the_player_says_so(kept, tmp_path):
    kept[-1].save(tmp_path / "run.npz")
    for given in (kept[-1], tmp_path / "run.npz", str(tmp_path / "run.npz")):
        explorer = widgets.player(given)
        panels, says = shown(explorer, cycle=0.0)
        (ellipses,) = (item for item in panels[0]["items"] if item["kind"] == "ellipses")
        assert len(ellipses["shapes"]) == 20 * kept[-1].robots[0].belief().splats.n_splats
        assert "as at the end" in panels[0]["title"] and f"{kept[-1].cycles[0].robots[0].splats} splats" in says
        assert "as at the end" not in shown(explorer, layer="true plan")[0][0]["title"]
        assert not any("PSNR" in name or "α" in name for name in explorer.settings["chart"].options)


def brute_force(splats, point) -> float:
    """α [m] by the mean of a Gaussian's lower tail, splat by splat."""
    tail = stats.norm.pdf(stats.norm.ppf(CONFIG.level)) / CONFIG.level
    return float((torch.linalg.norm(splats.means - torch.tensor(point), dim=1) - splats.scales.amax(1) * tail).min())


@pytest.mark.parametrize("place", [(2.0, 1.5), (6.5, 4.0), (5.0, 1.1)])
def test_the_probe_reads_the_robots_map_and_the_true_distance(kept, place):
    _, says = shown(widgets.player(kept), cycle=2.0, robot=0, probe=place)
    alpha, clear = (float(number) for number in re.search(r"probe: α (\S+) m, true distance (\S+) m", says).groups())
    assert alpha == pytest.approx(brute_force(kept[2].robots[0].belief().splats, place), abs=0.006)
    surfaces = world.load("flat").seen.sampled(0.005)
    assert clear == pytest.approx(np.linalg.norm(surfaces - place, axis=1).min(), abs=0.012)


def test_the_curves_are_those_of_the_record(kept):
    playback, last = Playback(kept), kept[-1]
    done = playback.measured("way to the goal done [%]")
    assert done.shape == (4, 2) and np.all(done[0] == 0)
    for k, robot in enumerate(last.robots):
        left = np.linalg.norm(robot.position - robot.goal) / np.linalg.norm(robot.trail[0] - robot.goal)
        assert done[-1, k] == pytest.approx(100 - 100 * left)
    sent = playback.measured("sent so far [kB]")
    assert np.all(sent[0] == 0) and np.all(np.diff(sent, axis=0) >= 0)
    assert 1000 * sent[-1] == pytest.approx([last.ledger.sent_by(k) for k in range(2)])
    assert 1000 * sent[1].sum() == pytest.approx(last.ledger.by_cycle()[0])
    best = playback.measured("gain, share of the team's best [%]")[:, 0]
    share = last.cycles[0].team_gain / last.cycles[0].best_gain
    assert np.all(best <= 100 + 1e-6) and best[0] == pytest.approx(100 * share)
    path, splats = last.cycles[1].robots[0].path, kept[1].robots[0].belief().splats
    assert playback.measured("α on its way [m]")[1, 0] == pytest.approx(
        np.mean([brute_force(splats, p) for p in path]), rel=1e-4
    )
    psnr = playback.measured("PSNR of its map [dB]")
    assert psnr.shape == (3, 2) and np.all(psnr[-1] > psnr[0])  # scored along the same way


def test_the_time_can_be_dragged_along_the_chart(kept):
    explorer = widgets.player(kept)
    place, chart = explorer.canvas.picture["panels"][:2]
    assert handle(chart)["along"] == "x" and handle(place)["name"] == "probe"
    explorer._moved({"name": "cycle", "x": 1.4, "y": 0.0, "along": "x"})
    chart = explorer.canvas.picture["panels"][1]
    done = Playback(kept).measured("way to the goal done [%]")[:, 0]
    assert handle(chart)["at"] == pytest.approx([1.4, done[1] + 0.4 * (done[2] - done[1])])
    assert explorer.says.value.startswith("cycle 1, robot 0") and explorer.controls["cycle"].value == 1.4


def test_each_layer_shows_another_thing_and_only_risk_a_colour_bar(kept):
    explorer = widgets.player(kept)
    kinds = {
        layer: [{item["kind"] for item in panel["items"]} for panel in shown(explorer, layer=layer)[0]]
        for layer in explorer.settings["layer"].options
    }
    assert "image" not in kinds["true plan"][0] and "ellipses" not in kinds["true plan"][0]
    assert "image" in kinds["ground it knows"][0] and "ellipses" in kinds["its splats"][0]
    assert [len(panels) for panels in kinds.values()] == [2, 2, 2, 3]


def test_a_robot_at_its_goal_plans_nothing_more(kept):
    last = kept[-1]
    cycles = tuple(at_goal(log, 0) for log in last.cycles)
    _, says = shown(widgets.player(dataclasses.replace(last, cycles=cycles)))
    assert "robot 0 reached" in says and "looks along" not in says and "nan" not in says


def test_a_record_without_a_cycle_is_refused():
    empty = episode.Record("flat", "single", 0, CONFIG, (), (), messages.Ledger())
    with pytest.raises(ValueError, match="flat has no cycle yet"):
        widgets.player(empty)
