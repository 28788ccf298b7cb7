"""Make the records that notebook 15 reads, below notebooks/records.

    python tools/records.py episode                  15_episode.npz, 15_recording.npz: five robots drive once, minutes
    python tools/records.py evaluation FOLDER...     15_evaluation.npz: from folders of `compare`, in 3-D and the plane
    --out DIR: another folder

The evaluation keeps every score; what was foretold at each waypoint beside what is true there (thinned evenly), when it
was announced and on the maps of the end; what teammates' splats make of a robot's views; and how views of the first
distributed run of each building compare with flatland's. An hour or two of `compare` makes it anew:

    for s in flat openplan corridor wings; do for d in 2 3; do
        python -m mannbv compare $s --dim $d --seeds 3 --out out/evaluation$d/$s; done; done
    python tools/records.py evaluation out/evaluation2/* out/evaluation3/*
"""

import argparse
import dataclasses
import itertools
import math
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import torch

from mannbv import archive, episode, metrics, risk, splats, team, world
from mannbv.camera import Camera
from mannbv.config import PRESETS
from mannbv.course.widgets.recording import Recording, without_maps
from mannbv.lab import study
from mannbv.world import SceneError, World

RECORDS = Path(__file__).resolve().parent.parent / "notebooks" / "records"
SCENE, STRATEGY = "flat", "distributed"
WAYPOINTS = 4000  # of a building, at most
DIGITS = 6  # of a score


def record_episode(out: Path) -> None:
    """Run the episode and write its record without maps and its recording."""
    place, kept = world.load(SCENE, dim=3), []
    record = episode.run(place, STRATEGY, PRESETS[3]["quick"], progress=kept.append)
    without_maps(record).save(out / "15_episode.npz")
    Recording.of(kept, place).save(out / "15_recording.npz")


def evaluation(folders: list[Path], out: Path) -> None:
    """Gather what `compare` has left. Raises StudyError, SceneError or OSError for what cannot be read."""
    several, left_out = study.gather(folders)
    print(*left_out, sep="\n", end="\n" * bool(left_out))
    buildings, runs = [results.scene for results in several if results.dim == 3], {}
    for path in study.run_files(folders):
        record = episode.load(path)
        if len(record.robots[0].position) == 3 and record.finished:
            runs.setdefault(record.scene, []).append(path)
    parts = [_building(number, scene, runs[scene]) for number, scene in enumerate(buildings)]
    names = dict.fromkeys(name for part in parts for name in part)
    columns = {name: np.concatenate([part[name] for part in parts if name in part], -1) for name in names}
    text = archive.to_json([_short(results.to_json()) for results in several], separators=(",", ":"))
    columns |= {"results": np.frombuffer(text.encode(), np.uint8), "buildings": np.array(buildings)}
    archive.write(out / "15_evaluation.npz", columns, compressed=True)


def _building(number: int, scene: str, runs: list[Path]) -> dict[str, np.ndarray]:
    """What is kept of a building's runs in space. A robot of one seed has one number: its own and 1000 a building."""
    place = world.load(scene, dim=3)

    def records(strategy=None):  # one at a time: maps are large
        return (record for record in map(episode.load, runs) if strategy in (None, record.strategy))

    columns = _forecasts("waypoint", study.forecasts(records(), place))
    columns |= _forecasts("hindsight", study.forecasts(map(in_hindsight, records()), place))
    columns |= _haze(itertools.islice(records("centralized"), 1), place)
    first = next(records(STRATEGY), None)
    if first is not None:
        columns |= _views(study.same_views(first, world.load(scene)))
    return {name: value + 1000 * number * name.endswith("robot") for name, value in columns.items()}


def in_hindsight(record: episode.Record) -> episode.Record:
    """The record, had it known its last maps: of both kinds of forecast, the first is α from the camera, the second α
    from the body."""
    maps = [robot.belief().splats for robot in record.robots]

    def hindsight(splat_map, log: team.RobotLog) -> team.RobotLog:
        points = torch.tensor(log.path).reshape(-1, len(log.position))
        configs = (record.config.replace(risk_from=measured_from) for measured_from in ("camera", "body"))
        alpha = (tuple(risk.along(splat_map, points, config).tolist()) for config in configs)
        return dataclasses.replace(log, **dict(zip(study.KINDS, alpha, strict=True)))

    cycles = (dataclasses.replace(log, robots=tuple(map(hindsight, maps, log.robots))) for log in record.cycles)
    return dataclasses.replace(record, cycles=tuple(cycles))


def _forecasts(name: str, found: study.Forecasts) -> dict[str, np.ndarray]:
    """Waypoints to the millimetre, every so many of them."""
    every = slice(None, None, -(-len(found.robot) // WAYPOINTS))
    columns = {"alpha": 1000 * found.alpha, "clearance": 1000 * found.clearance, "robot": found.robot}
    return {f"{name}_{key}": np.round(value)[..., every].astype(np.int16) for key, value in columns.items()}


def _haze(records: Iterable[episode.Record], place: World) -> dict[str, np.ndarray]:
    """Scores (3, n) of views at the ends and the middle of trajectories, by `metrics.view_quality`, from three maps:
    the robot's own; with it all splats of its teammates; with it those of them that `share_scale` lets pass."""
    psnr, depth, robots = [], [], []
    for record in records:
        config, maps = record.config, [robot.local.splats for robot in record.robots]
        camera = Camera.of_dim(3, config.image_width, config.image_height, config.fov)
        for robot, own in zip(record.robots, maps, strict=True):
            others = splats.union(*(each for each in maps if each is not own))
            narrow = others.select(others.scales.amax(1) <= (config.share_scale or math.inf))
            held = own, splats.union(own, others), splats.union(own, narrow)
            stops = robot.trail[[0, len(robot.trail) // 2, -1]]
            scores = [metrics.view_quality(each, place, camera, stops, config) for each in held]
            psnr.append([score[0] for score in scores])
            depth.append([score[1] for score in scores])
            robots.append(record.seed * record.n_robots + robot.index)
    if not robots:
        return {}
    columns = {"psnr": np.transpose(psnr).astype("f4"), "depth": np.transpose(depth).astype("f4")}
    return {f"haze_{key}": value for key, value in columns.items()} | {"haze_robot": np.array(robots, np.int16)}


def _views(views: study.SameViews) -> dict[str, np.ndarray]:
    columns = {key: getattr(views, key).astype(np.float32) for key in ("correlation", "turn", "share", "chance")}
    return {"view_robot": views.robot.astype(np.int16)} | {f"view_{key}": value for key, value in columns.items()}


def _short(value):
    """Numbers to `DIGITS` significant digits."""
    if isinstance(value, dict):
        return {key: _short(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_short(part) for part in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Make the records that notebook 15 reads.")
    parser.add_argument("what", choices=("episode", "evaluation"))
    parser.add_argument("folders", nargs="*", type=Path, help="of compare, for the evaluation")
    parser.add_argument("--out", type=Path, default=RECORDS, help="default: notebooks/records")
    asked = parser.parse_args(argv)
    if (asked.what == "evaluation") != bool(asked.folders):
        parser.error("an evaluation needs the folders that compare wrote, an episode none")
    try:
        asked.out.mkdir(parents=True, exist_ok=True)
        record_episode(asked.out) if asked.what == "episode" else evaluation(asked.folders, asked.out)
    except (OSError, ValueError, SceneError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
