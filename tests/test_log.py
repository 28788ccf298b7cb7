"""Logs of cycles: what a file of any version holds becomes the same frozen record, or one clear line."""

import dataclasses
import json
import math
import pickle
from pathlib import Path

import numpy as np
import pytest

from mannbv import episode
from mannbv.config import Config
from mannbv.team import CycleLog, RobotLog, Seconds, SuggestionLog

SHIPPED = Path(__file__).parent.parent / "notebooks" / "records"
QUICK = Config(image_width=32, fit_steps=4, max_cycles=2, n_yaws=72, rounds=6, n_subgoals=2)

PLANNING = RobotLog(
    (0.5, 1.0),
    0.1,
    "moving",
    40,
    3,
    (1.5, 1.0),
    0.2,
    -0.3,
    ((0.5, 1.0), (1.5, 1.0)),
    ((2.0, 1.0),),
    (0.4, None),
    (0.3, None),
)
AT_GOAL = RobotLog((3.0, 1.0), 0.0, "reached", 20, 0, None, 0.0, 0.0)
LOG = CycleLog(
    4, (PLANNING, AT_GOAL), (SuggestionLog(0, 1, 0.5, 30.0),), (0.1, 0.01), 70.0, 80.0, 60.0, Seconds(map=1.5, move=0.5)
)


def test_a_log_survives_json_and_pickling_and_cannot_change():
    text = json.dumps(LOG.to_json(), allow_nan=False)
    assert CycleLog.from_json(json.loads(text)) == pickle.loads(pickle.dumps(LOG)) == LOG
    assert hash(LOG) == hash(dataclasses.replace(LOG))  # nothing in it can be changed
    assert dataclasses.replace(LOG, suggestions=()) != LOG
    with pytest.raises(dataclasses.FrozenInstanceError):
        LOG.robots[0].yaw = 1.0


def test_the_form_on_disk_is_the_one_of_earlier_versions():
    """Written out by hand: readers of `.npz` records elsewhere rely on it."""
    assert LOG.to_json() == {
        "cycle": 4,
        "robots": [
            {
                "position": [0.5, 1.0], "yaw": 0.1, "status": "moving", "splats": 40, "guests": 3, "view": [1.5, 1.0],
                "announced": 0.2, "chosen": -0.3, "path": [[0.5, 1.0], [1.5, 1.0]], "subgoals": [[2.0, 1.0]],
                "risk": [0.4, None], "risk_inflated": [0.3, None],
            },
            {
                "position": [3.0, 1.0], "yaw": 0.0, "status": "reached", "splats": 20, "guests": 0, "view": None,
                "announced": 0.0, "chosen": 0.0, "path": [], "subgoals": [], "risk": None, "risk_inflated": None,
            },
        ],
        "suggestions": [[0, 1, 0.5, 30.0]],
        "residuals": [0.1, 0.01],
        "team_gain": 70.0, "best_gain": 80.0, "own_gain": 60.0,
        "seconds": {"map": 1.5, "plan": 0.0, "share": 0.0, "evaluate": 0.0, "agree": 0.0, "move": 0.5},
    }  # fmt: skip
    assert LOG.seconds.total == 2.0


def test_a_number_that_does_not_exist_is_null():
    values = dataclasses.replace(LOG, team_gain=float("nan")).to_json()
    assert values["team_gain"] is None
    assert math.isnan(CycleLog.from_json(values).team_gain)


def test_a_record_of_an_earlier_version_is_read_and_written_as_it_was():
    record = episode.load(SHIPPED / "15_episode.npz")
    with np.load(SHIPPED / "15_episode.npz") as archive:
        cycles = json.loads(bytes(archive["about"]).decode())["cycles"]
    assert [log.to_json() for log in record.cycles] == cycles
    assert [log.splats for log in record.logs(3)] == [cycle["robots"][3]["splats"] for cycle in cycles]


def test_a_record_from_before_there_were_forecasts_is_read():
    values = LOG.to_json()
    for robot in values["robots"]:
        del robot["risk"], robot["risk_inflated"]
    assert CycleLog.from_json(values).robots[0].risk is None


def test_what_a_cycle_logs_is_plain_all_the_way_down(tmp_path):
    record = episode.run("flat", "limited", QUICK, n_robots=2, path=tmp_path / "run.npz")
    assert len({*record.cycles}) == 2
    assert episode.load(tmp_path / "run.npz").cycles == record.cycles
    assert {type(number) for log in record.logs(0) for number in (*log.position, *log.path[0], log.chosen)} == {float}


@pytest.mark.parametrize(
    ("damage", "line"),
    [
        (lambda v: v.pop("robots"), "cycle 4 has no 'robots'"),
        (lambda v: v.update(robots={}), "cycle 4, robots must be a list, not {}"),
        (lambda v: v.update(colour=1), "cycle 4 has a field 'colour' that this version does not know"),
        (lambda v: v["robots"][1].update(splats=2.5), "cycle 4, robots 1, splats must be a whole number, not 2.5"),
        (lambda v: v["robots"][1].update(splats=True), "cycle 4, robots 1, splats must be a whole number, not True"),
        (lambda v: v["robots"][0].update(view=["here"]), "cycle 4, robots 0, view 0 must be a number, not 'here'"),
        (lambda v: v["robots"][0].update(yaw="north"), "cycle 4, robots 0, yaw must be a number, not 'north'"),
        (lambda v: v["suggestions"][0].pop(), "cycle 4, suggestions 0 must be a list of sender, target, yaw, gain"),
        (lambda v: v["seconds"].update(map="1"), "cycle 4, seconds, map must be a number, not '1'"),
    ],
)
def test_a_wrong_field_is_named_in_a_line(damage, line):
    values = LOG.to_json()
    damage(values)
    with pytest.raises(ValueError) as error:
        CycleLog.from_json(values, "cycle 4")
    assert str(error.value) == line
