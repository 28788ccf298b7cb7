"""The receding-horizon loop until every robot is at its goal, its record, save and resume (Section VI-A)."""

import dataclasses
import json
import math
import numbers
import os
import time
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from mannbv import mapping, metrics, network, team, world
from mannbv.camera import Camera, Frame
from mannbv.config import Config
from mannbv.geometry import Pose
from mannbv.grid import Lattice, Occupancy
from mannbv.messages import Ledger, Mailbox
from mannbv.splats import SplatMap
from mannbv.team import Guests, Mission, Robot

PRIORS = ("recompute", "incremental")
_PATIENCE = 3  # cycles in a row without any route after which a robot is given up; chosen here


class RecordError(ValueError):
    """A file that holds no record, or another run's; the message names the file and the remedy."""


@dataclass(frozen=True)
class Record:
    """One episode: what was asked, what happened each cycle, where the robots and their maps stand, the scores.

    cycles: a plain dict a cycle (see `team.cycle`). rows: one dict of scores a robot once the episode has ended.
    """

    scene: str
    strategy: str
    seed: int
    config: Config
    cycles: tuple[dict, ...]
    robots: tuple[Robot, ...]
    ledger: Ledger
    rows: tuple[dict, ...] = ()
    finished: bool = False

    @property
    def n_robots(self) -> int:
        return len(self.robots)

    def save(self, path) -> None:
        """Write the record to `path` (.npz without pickle); the file is whole at any moment."""
        path = Path(path)
        arrays = {"about": _text({
            "scene": self.scene, "strategy": self.strategy, "seed": self.seed, "n_robots": self.n_robots,
            "config": dataclasses.asdict(self.config), "cycles": self.cycles, "rows": self.rows,
            "finished": self.finished, "ledger": self.ledger.to_json(),
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
            tuple(about["cycles"]), robots, Ledger.from_json(about["ledger"]), tuple(about["rows"]), about["finished"],
        )  # fmt: skip
    except (zipfile.BadZipFile, OSError, EOFError, KeyError, TypeError, ValueError, IndexError) as error:
        fault = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordError(f"{path}: not a whole record ({fault}); delete it and run again") from None


def run(
    scene,
    strategy: str,
    config: Config | None = None,
    seed: int = 0,
    n_robots: int = 5,
    path=None,
    progress: Callable[[Record], None] | None = None,
) -> Record:
    """Run a team until every robot reached its goal, is stuck for good, or `max_cycles` are over; then score it.

    scene: a `world.World`, or what `world.load` takes. seed: which of the scene's start–goal pairs are used, the first
    yaws, the sensor noise. path: save the record there after each cycle, and resume from it if it is there.
    progress(record) is called after each cycle. Raises ValueError for an unknown strategy, too many robots, a start
    in a wall or a goal out of reach; RecordError if `path` holds another run.
    """
    config = config or Config()
    if strategy not in team.REGISTRY:
        raise ValueError(f"no strategy is called '{strategy}'; choose one of {', '.join(team.REGISTRY)}")
    for name, value, least in (("seed", seed, 0), ("number of robots", n_robots, 1)):
        if isinstance(value, bool) or not isinstance(value, numbers.Integral) or value < least:
            raise ValueError(f"episode: the {name} must be a whole number from {least}, got {value!r}")
    seed, n_robots = int(seed), int(n_robots)
    if config.prior not in PRIORS:
        raise ValueError(f"episode: no prior is called '{config.prior}'; choose one of {', '.join(PRIORS)}")
    place = scene if hasattr(scene, "sense") else world.load(scene)
    place = draw_team(place, n_robots, seed, config)
    camera = Camera.of_dim(place.dim, config.image_width, config.image_height, config.fov)
    mission = Mission(place, camera, config, network.build(config.network, n_robots), strategy, seed)
    network.check(mission.network, n_robots)

    asked = (place.name, strategy, seed, config, n_robots)
    if path is not None and Path(path).exists():
        record = load(path)
        if (record.scene, record.strategy, record.seed, record.config, record.n_robots) != asked:
            raise RecordError(f"{path}: holds another run; choose another folder, or delete it to start afresh")
    else:
        robots = tuple(
            team.start(k, place.starts[k, :-1], float(place.starts[k, -1]), place.goals[k], mission)
            for k in range(n_robots)
        )
        record = Record(place.name, strategy, seed, config, (), robots, Ledger())
    while not record.finished:
        record = _advance(record, mission)
        if path is not None:
            record.save(path)
        if progress is not None:
            progress(record)
    return record


def draw_team(place, n_robots: int, seed: int, config: Config):
    """The scene with `n_robots` of its start–goal pairs, drawn by the seed, and random first yaws (in whole turns).

    Seed 0 takes the first pairs. Raises ValueError where the team cannot start or a goal is out of reach.
    """
    place = place.suited(config)
    rng = np.random.default_rng([seed, 2_147_483_647])  # a stream that no robot draws from
    pairs = min(len(place.starts), len(place.goals))
    order = np.arange(pairs) if seed == 0 else rng.permutation(pairs)
    starts, goals = place.starts[order].copy(), place.goals[order]
    turns = round(2 * math.pi / config.turn)
    if seed:
        starts[:, -1] += rng.integers(0, turns, len(starts)) * config.turn
    drawn = dataclasses.replace(place, starts=starts, goals=goals)
    drawn.check_team(n_robots, config.robot_radius, config.cell)
    return drawn


def _advance(record: Record, mission: Mission) -> Record:
    """One more cycle, or the end."""
    config, number = mission.config, len(record.cycles)
    settled = all(robot.status == "reached" or robot.stuck >= _PATIENCE for robot in record.robots)
    if settled or number >= config.max_cycles:
        robots = tuple(team.observe(robot, mission, number) for robot in record.robots)
        record = dataclasses.replace(record, robots=robots)
        return dataclasses.replace(record, rows=tuple(score(record, mission)), finished=True)
    post = Mailbox(config.codec, record.ledger)
    robots, report = team.cycle(list(record.robots), mission, post, number)
    return dataclasses.replace(record, cycles=(*record.cycles, report), robots=tuple(robots), ledger=post.ledger)


def score(record: Record, mission: Mission) -> list[dict]:
    """A row of `results.json` for each robot; maps are scored as the strategy holds them, guests included."""
    place, config = mission.world, mission.config
    surfaces = metrics.true_surfaces(place)
    began = time.perf_counter()
    spent = sum(sum(cycle["seconds"].values()) for cycle in record.cycles)
    rows = []
    for robot in record.robots:
        belief = robot.belief(config)
        start, reached = robot.trail[0], robot.status == "reached"
        shortest = place.shortest_path(start, robot.goal, config.robot_radius, config.cell)
        reachable = place.reachable_free(config.cell, config.robot_radius, start)
        psnr, mae = metrics.view_quality(belief.splats, place, mission.camera, robot.trail, config)
        row = {"strategy": record.strategy, "seed": record.seed, "robot": robot.index, "reached": reached}
        row["cycles"] = sum(cycle["robots"][robot.index]["status"] != "reached" for cycle in record.cycles)
        row |= metrics.travel_scores(place, robot.trail, robot.goal, shortest, reached, robot.collisions)
        row |= metrics.path_scores(belief, place, surfaces, start, robot.goal, shortest, config)
        row |= {"psnr_db": psnr, "depth_mae_m": mae}
        row["bytes_sent"] = record.ledger.sent_by(robot.index)
        row["bytes_received"] = record.ledger.received_by(robot.index)
        row["coverage"] = metrics.coverage(belief.occupancy, reachable, place.lattice(config.cell))
        row["fate"] = "reached" if reached else why_not(robot, config)
        rows.append(row)
    seconds = spent + time.perf_counter() - began
    return [{k: _plain(v) for k, v in row.items()} | {"seconds": seconds} for row in rows]


def why_not(robot: Robot, config: Config) -> str:
    """What kept a robot from its goal."""
    if robot.stuck:
        return "no frontier left to go to"
    return f"{config.max_cycles} cycles were not enough, {np.linalg.norm(robot.goal - robot.position):.1f} m to go"


def _plain(value):
    """JSON has no NaN: a number that does not exist is null."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


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
