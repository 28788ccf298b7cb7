"""The record of an episode, and its file."""

import dataclasses
import json
import os
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from mannbv import mapping
from mannbv.camera import Frame
from mannbv.config import Config
from mannbv.geometry import Pose
from mannbv.grid import Lattice, Occupancy
from mannbv.messages import Ledger
from mannbv.splats import SplatMap
from mannbv.team import CycleLog, Guests, Robot, RobotLog


class RecordError(ValueError):
    """A file that holds no record, or another run's; the message names the file and the remedy."""


@dataclass(frozen=True)
class Record:
    """One episode: what was asked, what happened each cycle, where the robots and their maps stand, the scores.

    cycles: a log each. rows: one dict of scores a robot once the episode has ended.
    """

    scene: str
    strategy: str
    seed: int
    config: Config
    cycles: tuple[CycleLog, ...]
    robots: tuple[Robot, ...]
    ledger: Ledger
    rows: tuple[dict, ...] = ()
    finished: bool = False

    @property
    def n_robots(self) -> int:
        return len(self.robots)

    def logs(self, robot: int) -> tuple[RobotLog, ...]:
        """What every cycle reports of one robot."""
        return tuple(log.robots[robot] for log in self.cycles)

    def save(self, path) -> None:
        """Write the record to `path` (.npz without pickle); the file is whole at any moment."""
        path = Path(path)
        arrays = {"about": _text({
            "scene": self.scene, "strategy": self.strategy, "seed": self.seed, "n_robots": self.n_robots,
            "config": dataclasses.asdict(self.config), "cycles": [log.to_json() for log in self.cycles],
            "rows": self.rows, "finished": self.finished, "ledger": self.ledger.to_json(),
        })}  # fmt: skip
        for robot in self.robots:
            arrays |= {f"{robot.index}/{key}": value for key, value in _pack(robot).items()}
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
        with beside.open("wb") as file:
            (np.savez_compressed if self.finished else np.savez)(file, **arrays)
        os.replace(beside, path)


def load(path) -> Record:
    """Read a record; nothing in the file is ever executed. Raises RecordError for anything else."""
    path = Path(path)
    if not path.is_file():
        raise RecordError(f"{path}: no such record")
    try:
        if not zipfile.is_zipfile(path):  # numpy would advise to trust it
            raise zipfile.BadZipFile("no .npz archive, or cut short")
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            about = json.loads(bytes(archive["about"]).decode())
            robots = tuple(_unpack(k, archive) for k in range(about["n_robots"]))
        lost = {f.name for f in dataclasses.fields(Config)} - set(about["config"])
        if lost and not about["finished"]:  # it cannot go on as it began
            raise ValueError(f"an unfinished run of another version, without {sorted(lost)[0]}")
        return Record(
            about["scene"], about["strategy"], about["seed"], Config().replace(**about["config"]),
            tuple(CycleLog.from_json(log, f"cycle {c}") for c, log in enumerate(about["cycles"])), robots,
            Ledger.from_json(about["ledger"]), tuple(about["rows"]), about["finished"],
        )  # fmt: skip
    except (zipfile.BadZipFile, OSError, EOFError, KeyError, TypeError, ValueError, IndexError) as error:
        fault = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordError(f"{path}: not a whole record ({fault}); delete it and run again") from None


# ---- a robot as named arrays ----------------------------------------------------------------------------------------


def _text(value) -> np.ndarray:
    return np.frombuffer(json.dumps(value).encode(), np.uint8)


def _pack(robot: Robot) -> dict[str, np.ndarray]:
    small = {"yaw": robot.yaw, "status": robot.status, "stuck": robot.stuck, "collisions": robot.collisions}
    small |= {"tried": [list(map(float, spot)) for spot in robot.tried]}
    lattice = robot.ground.lattice
    small |= {"origin": lattice.origin, "cell": lattice.cell, "heard": sorted(robot.heard)}
    arrays = {"small": _text(small), "position": robot.position, "goal": robot.goal, "trail": robot.trail}
    arrays |= {"ground": robot.ground.log_odds} | _pack_map("guest", robot.guests.splats)
    arrays |= {f"own_{name}": values for name, values in mapping.to_arrays(robot.local).items()}
    guests = robot.guests
    arrays |= {"guest_senders": guests.senders.numpy(), "guest_ids": guests.ids.numpy()}
    arrays["guest_prior"] = guests.prior.numpy()
    arrays |= {f"heard_{k}": ground.log_odds for k, ground in robot.heard.items()}
    return arrays | _pack_frames("frame", robot.frames)


def _unpack(index: int, archive) -> Robot:
    def get(name: str) -> np.ndarray:
        return archive[f"{index}/{name}"]

    small = json.loads(bytes(get("small")).decode())
    log_odds = get("ground")
    lattice = Lattice(tuple(small["origin"]), small["cell"], log_odds.shape)
    own = f"{index}/own_"
    local = mapping.from_arrays({key.removeprefix(own): archive[key] for key in archive.files if key.startswith(own)})
    guest_prior = torch.from_numpy(get("guest_prior"))
    senders, ids = torch.from_numpy(get("guest_senders")), torch.from_numpy(get("guest_ids"))
    guests = Guests(_unpack_map("guest", get), senders, ids, guest_prior)
    heard = {k: Occupancy(lattice, get(f"heard_{k}")) for k in small["heard"]}
    return Robot(
        index, get("position"), small["yaw"], get("goal"), local, Occupancy(lattice, log_odds), guests, get("trail"),
        frames=_unpack_frames("frame", get), heard=heard, tried=tuple(np.array(spot) for spot in small["tried"]),
        status=small["status"], stuck=small["stuck"], collisions=small["collisions"],
    )  # fmt: skip


_FIELDS = [f.name for f in dataclasses.fields(SplatMap)]


def _pack_map(name: str, splat_map: SplatMap) -> dict[str, np.ndarray]:
    return {f"{name}_{f}": getattr(splat_map, f).numpy() for f in _FIELDS}


def _unpack_map(name: str, get: Callable) -> SplatMap:
    return SplatMap(*(torch.from_numpy(get(f"{name}_{f}")) for f in _FIELDS))


def _pack_frames(name: str, frames: tuple[Frame, ...]) -> dict[str, np.ndarray]:
    arrays = {f"{name}_count": np.array(len(frames))}
    if frames:
        parts = {"color": [f.color for f in frames], "depth": [f.depth for f in frames]}
        parts |= {"rotation": [f.pose.rotation for f in frames], "position": [f.pose.position for f in frames]}
        arrays |= {f"{name}_{part}": torch.stack(values).numpy() for part, values in parts.items()}
    return arrays


def _unpack_frames(name: str, get: Callable) -> tuple[Frame, ...]:
    if not int(get(f"{name}_count")):
        return ()
    parts = (torch.from_numpy(get(f"{name}_{part}")) for part in ("color", "depth", "rotation", "position"))
    return tuple(Frame(c, d, Pose(r, p)) for c, d, r, p in zip(*parts, strict=True))
