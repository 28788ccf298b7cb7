"""The record of an episode, and its file."""

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mannbv import archive, mapping, metrics
from mannbv.camera import Frame
from mannbv.config import Config
from mannbv.grid import Lattice, Occupancy
from mannbv.messages import Ledger
from mannbv.metrics import Row
from mannbv.team import CycleLog, Guests, Robot, RobotLog


class RecordError(ValueError):
    """A file that holds no record, or another run's; the message names the file and the remedy."""


@dataclass(frozen=True)
class Record:
    """One episode: what was asked, what happened each cycle, where the robots and their maps stand, the scores.

    cycles: a log each. rows: the scores of each robot once the episode has ended.
    """

    scene: str
    strategy: str
    seed: int
    config: Config
    cycles: tuple[CycleLog, ...]
    robots: tuple[Robot, ...]
    ledger: Ledger
    rows: tuple[Row, ...] = ()
    finished: bool = False

    @property
    def n_robots(self) -> int:
        return len(self.robots)

    def logs(self, robot: int) -> tuple[RobotLog, ...]:
        """What every cycle reports of one robot."""
        return tuple(log.robots[robot] for log in self.cycles)

    def save(self, path: str | Path) -> None:
        """Write the record to `path` (.npz without pickle); the file is whole at any moment."""
        about = {
            "scene": self.scene, "strategy": self.strategy, "seed": self.seed, "n_robots": self.n_robots,
            "config": dataclasses.asdict(self.config), "cycles": [log.to_json() for log in self.cycles],
            "rows": [row.to_json() for row in self.rows], "finished": self.finished, "ledger": self.ledger.to_json(),
        }  # fmt: skip
        arrays = {"about": _text(about)}
        for robot in self.robots:
            arrays |= to_arrays(robot)
        archive.write(path, arrays, compressed=self.finished)


def load(path: str | Path) -> Record:
    """Read a record; nothing in the file is ever executed. Raises RecordError for anything else."""
    path = Path(path)
    if not path.is_file():
        raise RecordError(f"{path}: no such record")
    try:
        arrays = archive.read(path)
        about = json.loads(bytes(arrays["about"]))  # not strictly: earlier versions wrote NaN where there was one
        robots = tuple(from_arrays(k, arrays) for k in range(about["n_robots"]))
        lost = {f.name for f in dataclasses.fields(Config)} - set(about["config"])
        if lost and not about["finished"]:  # it cannot go on as it began
            raise ValueError(f"an unfinished run of another version, without {sorted(lost)[0]}")
        cycles = tuple(CycleLog.from_json(log, f"cycle {c}") for c, log in enumerate(about["cycles"]))
        ledger = Ledger.from_json(about["ledger"])
        rows = tuple(_row(row, ledger) for row in about["rows"])
        return Record(
            about["scene"], about["strategy"], about["seed"], Config().replace(**about["config"]), cycles, robots,
            ledger, rows, about["finished"],
        )  # fmt: skip
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError) as error:
        fault = " ".join(str(error).split())
        raise RecordError(f"{path}: not a whole record ({fault}); delete it and run again") from None


def _row(value, ledger: Ledger) -> Row:
    """A row of any version: earlier ones left bytes by kind to the reader of the ledger."""
    row = Row.from_json(value, "a row of scores")
    if row.bytes_paper is not None:
        return row
    return dataclasses.replace(row, **metrics.traffic(ledger, row.robot, row.strategy))


def to_arrays(robot: Robot) -> dict[str, np.ndarray]:
    """A robot as named arrays, each behind its number, as in 3/position."""
    lattice, at = robot.ground.lattice, f"{robot.index}/"
    small = {"yaw": robot.yaw, "status": robot.status, "stuck": robot.stuck, "collisions": robot.collisions}
    small |= {"tried": [list(map(float, spot)) for spot in robot.tried]}
    small |= {"origin": lattice.origin, "cell": lattice.cell, "heard": sorted(robot.grids)}
    arrays = {"small": _text(small), "position": robot.position, "goal": robot.goal, "trail": robot.trail}
    arrays |= {"ground": robot.ground.log_odds} | {f"heard_{k}": grid.log_odds for k, grid in robot.grids.items()}
    arrays = {at + name: values for name, values in arrays.items()} | mapping.to_arrays(robot.local, f"{at}own_")
    return arrays | archive.pack(robot.guests, f"{at}guest_") | archive.stack(robot.frames, f"{at}frame_")


def from_arrays(index: int, arrays: Mapping[str, np.ndarray]) -> Robot:
    """The inverse of `to_arrays`, of the robot with that number. Raises KeyError or ValueError for what is none."""
    at = f"{index}/"
    small = archive.from_json(bytes(arrays[f"{at}small"]))
    position, goal, trail, log_odds = (arrays[at + name] for name in ("position", "goal", "trail", "ground"))
    if f"{at}guest_prior" in arrays:  # of a version whose robots did not look up their guests
        prior = arrays[f"{at}guest_prior"]
        arrays = {**arrays, f"{at}guest_sent": prior, f"{at}guest_seen": np.zeros_like(prior)}
    lattice = Lattice(tuple(small["origin"]), small["cell"], log_odds.shape)
    return Robot(
        index, position, small["yaw"], goal, mapping.from_arrays(arrays, f"{at}own_"), Occupancy(lattice, log_odds),
        archive.unpack(Guests, arrays, f"{at}guest_"), trail, archive.unstack(Frame, arrays, f"{at}frame_"),
        grids={k: Occupancy(lattice, arrays[f"{at}heard_{k}"]) for k in small["heard"]},
        tried=tuple(np.array(spot) for spot in small["tried"]),
        status=small["status"], stuck=small["stuck"], collisions=small["collisions"],
    )  # fmt: skip


def _text(value) -> np.ndarray:
    return np.frombuffer(archive.to_json(value).encode(), np.uint8)
