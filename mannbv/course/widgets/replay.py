"""Replay: a recorded episode of space to wind to and fro, with what each robot saw and what its map made of it."""

import functools
import math
from pathlib import Path

import numpy as np

from mannbv import episode, world
from mannbv.config import PRESETS
from mannbv.course.widgets import items
from mannbv.course.widgets.explorer import Explorer
from mannbv.course.widgets.playback import Playback
from mannbv.course.widgets.player import chart_panel, key, team_items
from mannbv.course.widgets.recording import VIEWS, Recording
from mannbv.course.widgets.settings import Choice, Range
from mannbv.episode import Record
from mannbv.team import RobotLog
from mannbv.world import World

_TEAM = PRESETS[3]["quick"].replace(image_width=24, image_height=24, fit_steps=8, n_yaws=72, max_cycles=4)
_LAYERS = ("ground it knows", "true plan")
_SIDE, _LEFT, _TOP = 118, 470, 40  # [px] of a picture, and where the first one stands


def replay(
    record: Record | str | Path | None = None,
    recording: Recording | str | Path | None = None,
    place: World | None = None,
) -> Explorer:
    """Play an episode of space: all ways, and one robot's ground, plan, view and pictures.

    record: an `episode.Record`, with or without maps, or a file of one; recording: its `Recording` or a file of one. By
    default a team of two is run once, some seconds. place: the World, where `world.load` does not know the scene by
    its name.
    Raises ValueError where the two do not belong together; what `episode.load` and `Recording.load` raise.
    """
    if record is None or recording is None:
        record, recording, place = _small_team()
    record = episode.load(record) if isinstance(record, (str, Path)) else record
    recording = Recording.load(recording) if isinstance(recording, (str, Path)) else recording
    asked = len(record.cycles), record.n_robots, *record.robots[0].ground.lattice.shape
    if recording.state.shape != asked:
        raise ValueError(
            f"replay: the record has cycles, robots and cells {asked}, the recording {recording.state.shape}"
        )
    playback = Playback(record, place)
    return Explorer(
        functools.partial(_picture, playback, recording),
        {
            "cycle": Range("cycle", 0, len(playback.cycles), 0.0, 0.05, play=900),
            "robot": Choice("robot", tuple(range(record.n_robots)), 0),
            "layer": Choice("shown", _LAYERS, _LAYERS[0]),
            "chart": Choice("over time", tuple(playback.measures), "splats in the own map [1]"),
        },
        size=(860, 400),
    )


@functools.cache
def _small_team() -> tuple[Record, Recording, World]:
    print("Two robots drive through the flat in space once; that takes some seconds.")
    place, kept = world.load("flat", dim=3), []
    record = episode.run(place, "distributed", _TEAM, n_robots=2, progress=kept.append)
    return record, Recording.of(kept, place), place


def _picture(playback: Playback, recording: Recording, cycle, robot, layer, chart):
    number = min(int(cycle + 1e-6), len(playback.cycles) - 1)  # sliders add up 0.05
    log, like = playback.log(number, robot), playback.last.robots[robot].ground
    under = (
        items.walls(playback.place) if layer == "true plan" else [items.ground(recording.ground(number, robot, like))]
    )
    lower, upper = playback.place.seen.lower - 0.2, playback.place.seen.upper + 0.2
    plan = items.plan(
        (50, 45, 360, 300), lower, upper, under + team_items(playback, cycle, number, robot),
        title=f"robot {robot}: {layer}", legend=key(robot),
    )  # fmt: skip
    pictures = [_view(pixels, k) for k, pixels in enumerate(recording.views[number, robot])]
    below = chart_panel(playback, cycle, robot, chart, (_LEFT + 35, _TOP + _SIDE + 65, 340, 120))
    before, after = recording.psnr[number, robot]
    says = f"cycle {number}, robot {robot} {log.status}, {log.splats:,} splats; {_degrees(log)}"
    seen = f"its map shows what it sees {'not at all' if math.isnan(before) else f'to {before:.0f} dB'} before"
    return [plan, *pictures, below], f"{says}{seen} and to {after:.0f} dB after mapping it"


def _degrees(log: RobotLog) -> str:
    if not log.path:
        return ""
    chosen, alone = (round(math.degrees(yaw)) for yaw in (log.chosen, log.announced))
    return f"looks next along {chosen}°, alone {alone}°; "


def _view(pixels: np.ndarray, k: int) -> dict:
    """A picture (h, w, 3) of bytes as the k-th small panel."""
    h, w, _ = pixels.shape
    rgba = np.dstack([pixels, np.full((h, w), 255, np.uint8)])[::-1]
    box = (_LEFT + k * (_SIDE + 12), _TOP, _SIDE, _SIDE * h / w)
    return items.panel(box, (0, w), (0, h), [items.image(rgba, (0, w, 0, h))], title=VIEWS[k], xticks=[], yticks=[])
