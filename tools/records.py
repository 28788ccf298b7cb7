"""Make the records that notebook 15 reads, below notebooks/records.

    python tools/records.py episode                  15_episode.npz and 15_reel.npz: five robots drive once, minutes
    python tools/records.py evaluation FOLDER...     15_evaluation.npz: from folders of `compare`, in 3-D and the plane
    --out DIR: another folder

The evaluation keeps every score, what was foretold at each waypoint beside what is true there (thinned evenly), and how
views of the first distributed run of each building compare with flatland's. An hour or two of `compare` makes it anew:

    for s in flat openplan corridor wings; do for d in 2 3; do
        python -m mannbv compare $s --dim $d --seeds 3 --out out/evaluation$d/$s; done; done
    python tools/records.py evaluation out/evaluation2/* out/evaluation3/*
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from mannbv import episode, study, world
from mannbv.config import PRESETS
from mannbv.widgets.reel import Reel, lean
from mannbv.world import SceneError

RECORDS = Path(__file__).resolve().parent.parent / "notebooks" / "records"
SCENE, STRATEGY = "flat", "distributed"
WAYPOINTS = 4000  # of a building, at most
DIGITS = 6  # of a score


def film(out: Path) -> None:
    """Run the episode and write its lean record and its reel."""
    place, kept = world.load(SCENE, dim=3), []
    record = episode.run(place, STRATEGY, PRESETS[3]["quick"], progress=kept.append)
    lean(record).save(out / "15_episode.npz")
    Reel.of(kept, place).save(out / "15_reel.npz")


def evaluation(folders: list[Path], out: Path) -> None:
    """Gather what `compare` has left. Raises StudyError, SceneError or OSError for what cannot be read."""
    several, left_out = study.gather(folders)
    print(*left_out, sep="\n", end="\n" * bool(left_out))
    told, views, buildings = [], [], [results["scene"] for results in several if results["dim"] == 3]
    runs = {}
    for path in study.run_files(folders):
        record = episode.load(path)
        if len(record.robots[0].position) == 3 and record.finished:
            runs.setdefault(record.scene, []).append(path)
    for number, scene in enumerate(buildings):
        told.append(_forecasts(number, world.load(scene, dim=3), map(episode.load, runs[scene])))
        first = next((r for r in map(episode.load, runs[scene]) if r.strategy == STRATEGY), None)
        if first is not None:
            views.append(_views(number, study.same_views(first, world.load(scene))))
    columns = {key: np.concatenate([part[key] for part in told], -1) for key in told[0]}
    columns |= {key: np.concatenate([part[key] for part in views]) for key in (views[0] if views else {})}
    text = json.dumps([_short(results) for results in several], separators=(",", ":"))
    path = out / "15_evaluation.npz"
    np.savez_compressed(path, results=np.frombuffer(text.encode(), np.uint8), buildings=buildings, **columns)


def _forecasts(building: int, place, records) -> dict[str, np.ndarray]:
    """Waypoints to the millimetre, every so many of them."""
    told = study.forecasts(records, place)
    every = slice(None, None, -(-len(told.robot) // WAYPOINTS))
    robot = np.full(len(told.robot), 1000 * building) + told.robot
    columns = {"alpha": 1000 * told.alpha, "clearance": 1000 * told.clearance, "robot": robot}
    return {f"waypoint_{key}": np.round(value)[..., every].astype(np.int16) for key, value in columns.items()}


def _views(building: int, views: study.SameViews) -> dict[str, np.ndarray]:
    columns = {"robot": 1000 * building + views.robot}
    columns |= {key: getattr(views, key).astype(np.float32) for key in ("correlation", "turn", "share", "chance")}
    return {f"view_{key}": value for key, value in columns.items()}


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
        film(asked.out) if asked.what == "episode" else evaluation(asked.folders, asked.out)
    except (OSError, ValueError, SceneError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
