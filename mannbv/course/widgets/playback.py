"""What a player shows of an episode: who stood where when, on which map, and one number of every robot over time."""

import functools
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch

from mannbv import episode, metrics, risk, world
from mannbv.camera import Camera
from mannbv.episode import Record
from mannbv.grid import Occupancy
from mannbv.lab import study
from mannbv.messages import Ledger
from mannbv.team import RobotLog
from mannbv.world import World


class Playback:
    """The records of an episode, what can be measured in them, and who stands where when.

    given: a record, a file of one, or the records after every cycle. measures: name with unit → values (cycles, robots)
    or (cycles, 1); `measured`, `belief`, `field` (α on the ground) and `way_risk` are worked out once.
    Raises ValueError for a record without a cycle; what `episode.load` and `world.load` raise.
    """

    def __init__(self, given: Record | Sequence[Record] | str | Path, place: World | None = None):
        records = [episode.load(given)] if isinstance(given, (str, Path)) else given
        records = [records] if isinstance(records, Record) else list(records)
        if not records:
            raise ValueError("player: no record in the list; run the episode for a cycle first")
        self.last = records[-1]
        self.cycles = self.last.cycles
        if not self.cycles:
            raise ValueError(f"player: the record of {self.last.scene} has no cycle yet; run it further")
        first = {len(r.cycles): r for r in records if not r.finished}  # a finished one has mapped once more
        self.kept = all(k + 1 in first for k in range(len(self.cycles)))
        self._robots = [first[k + 1].robots if self.kept else self.last.robots for k in range(len(self.cycles))]
        dim = len(self.last.robots[0].position)
        self.place = world.load(self.last.scene, dim=dim) if place is None else place
        self.stops = [_stops(self.last, k) for k in range(self.last.n_robots)]
        self.measures = {
            "way to the goal done [%]": self._done,
            "splats in the own map [1]": self._splats,
            "sent so far [kB]": self._sent,
            "gain, share of the team's best [%]": self._shares,
        }
        if self.kept:
            self.measures |= {"α on its way [m]": self._risks, "PSNR of its map [dB]": self._quality}
        self.measured = functools.cache(lambda name: self.measures[name]())
        self.belief = functools.cache(lambda cycle, k: self._robots[cycle][k].belief())
        self.field = functools.cache(self._field)
        self.way_risk = functools.cache(self._way_risk)

    def ground(self, cycle: int, k: int) -> Occupancy:
        """What robot k knew of the ground after its move in a cycle, or at the end if no maps were kept."""
        return self._robots[cycle][k].ground

    def log(self, cycle: int, k: int) -> RobotLog:
        """What the record says of robot k in a cycle."""
        return self.cycles[cycle].robots[k]

    def stand(self, time: float, k: int) -> tuple[np.ndarray, np.ndarray, float]:
        """A robot's trail so far (j, d), its place (d,) [m], and where it looks or drives to [rad]."""
        robot, cycle = self.last.robots[k], min(int(time), len(self.cycles) - 1)
        start, end = self.stops[k][cycle : cycle + 2]
        at = start + (time - cycle) * (end - start)
        low = min(int(at), len(robot.trail) - 2) if len(robot.trail) > 1 else 0
        ends = robot.trail[low], robot.trail[min(low + 1, len(robot.trail) - 1)]
        here = ends[0] + (at - low) * (ends[1] - ends[0])
        yaw = robot.yaw if time == len(self.cycles) else self.log(cycle, k).yaw
        if time != int(time) and end > start:
            yaw = float(np.arctan2(*(ends[1] - ends[0])[1::-1]))
        return np.vstack([robot.trail[: low + 1], here]), here, yaw

    # ---- one number of every robot (cycles, robots), or of the team (cycles, 1) ----

    def _splats(self) -> np.ndarray:
        return np.array([[robot.splats for robot in log.robots] for log in self.cycles], float)

    def _done(self) -> np.ndarray:
        robots = self.last.robots
        places = np.array([[robot.position for robot in log.robots] for log in self.cycles])
        away = np.linalg.norm(np.vstack([places, [[r.position for r in robots]]]) - [r.goal for r in robots], axis=2)
        return 100 * (1 - away / away[0])

    def _sent(self) -> np.ndarray:
        def until(cycle: int) -> Ledger:
            return Ledger({key: row for key, row in self.last.ledger.rows.items() if key[4] < cycle})

        robots, cycles = range(self.last.n_robots), range(len(self.cycles) + 1)
        return np.array([[ledger.sent_by(k) / 1000 for k in robots] for ledger in map(until, cycles)])

    def _shares(self) -> np.ndarray:
        best = np.array([log.best_gain for log in self.cycles])
        share = np.divide([log.team_gain for log in self.cycles], best, np.full(len(best), np.nan), where=best > 0)
        return 100 * share[:, None]

    def _field(self, cycle: int, k: int) -> np.ndarray:
        rest = self.last.robots[k].position[2:]
        return study.ground_risk(self.belief(cycle, k), self.last.config, rest)

    def _way_risk(self, cycle: int, k: int) -> float:
        """The total risk of the path planned in a cycle, on the map it was planned on [m]; nan without a path."""
        path, config = np.array(self.log(cycle, k).path, float), self.last.config
        if not len(path):
            return float("nan")
        return risk.along(self.belief(cycle, k).splats, torch.from_numpy(path), config).mean().item()

    def _each(self, measure: Callable[[int, int], float]) -> np.ndarray:
        return np.array([[measure(c, k) for k in range(self.last.n_robots)] for c in range(len(self.cycles))])

    def _risks(self) -> np.ndarray:
        return self._each(self.way_risk)

    def _quality(self) -> np.ndarray:
        config = self.last.config
        camera = Camera.of_dim(self.place.dim, config.image_width, config.image_height, config.fov)

        def psnr(cycle: int, k: int) -> float:
            trail = self.last.robots[k].trail
            return metrics.view_quality(self.belief(cycle, k).splats, self.place, camera, trail, config)[0]

        return self._each(psnr)


def _stops(record: Record, k: int) -> np.ndarray:
    """Rows of a robot's trail at which it stood at the beginning of every cycle, and at the end."""
    trail, at, rows = record.robots[k].trail, 0, []
    for log in record.logs(k):
        at += int(np.argmax((trail[at:] == log.position).all(1)))
        rows.append(at)
    return np.array([*rows, len(trail) - 1])
