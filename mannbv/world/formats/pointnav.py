"""Habitat PointNav episodes as scenes: a `.json.gz` file names a mesh, and where an agent starts and should end.

Habitat's y axis points up and its camera looks along −z; a place (x, y, z) there is (x, −z, y) here. Gibson's meshes
have their own licence and are not part of this project: the README says how to get them.
"""

import gzip
import json
import math
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from mannbv.config import Config
from mannbv.world import errors, places
from mannbv.world.errors import SceneError
from mannbv.world.formats import mesh, storeys
from mannbv.world.formats.entries import Entry
from mannbv.world.ground import EYE, Ground
from mannbv.world.surfaces import Surfaces
from mannbv.world.world import World

MOST_BYTES = 2**28  # of a file, unpacked
STEP = 0.3  # [m] an episode's height may differ so much from its storey's floor
HINT = "Gibson's scenes are free to get under their own licence, README.md says how"


def load(
    path: str | Path,
    scenes_dir: str | Path | None = None,
    building: str | None = None,
    up: str | None = None,
    scale: float | None = None,
    floor: float | None = None,
    n_robots: int = 10,
) -> World:
    """The scene of a file's first episode, or of the first in a `building`, with its episodes' starts and goals.

    scenes_dir: the folder that holds what scene_id names, as in gibson/Cantwell.glb. The robots take the episodes on
    the first one's storey, in order, but for those whose start is not free, whose goal is out of reach, or that come
    near another's. Cameras stand `Config.camera_height` above the start. up, scale: as in `mesh.read`, but Habitat's
    unit is the metre. floor: a height [m]; the storey nearest to it instead of the first episode's. Raises SceneError.
    """
    path = Path(path)
    if scenes_dir is None:
        raise SceneError(f"{path}: which folder holds its scenes? Name it with --scenes-dir; {HINT}")
    episodes = read(path)
    if building is not None:
        known = sorted({PurePosixPath(e.scene).stem for e in episodes})
        episodes = [e for e in episodes if building in (e.scene, PurePosixPath(e.scene).stem)]
        if not episodes:
            some = ", ".join(known[:20]) + ", …" * (len(known) > 20)
            raise SceneError(f"{path}: has no episode in {building}; its buildings are {some}")
    name = episodes[0].scene
    episodes = [e for e in episodes if e.scene == name]
    file = _found(path, Path(scenes_dir), name)
    surfaces, notes = mesh.read(file, up, 1.0 if scale is None else scale)
    with errors.naming(f"{path}: {name}"):
        floor = _storey(surfaces, episodes, floor)
        if floor is None:
            raise SceneError("no episode starts on a floor; are the mesh's up axis and unit right? Try --up, --scale")
        ground = storeys.ground(surfaces, floor)
    team, skipped = _team(ground, episodes, n_robots)
    if not team:
        raise SceneError(
            f"{path}: no episode of {name} has a free start and a goal within reach; are up axis and unit right? "
            "Try --up, --scale"
        )
    eye = [0, 0, EYE]
    starts = np.array([[*(e.start + eye), e.yaw] for e in team])
    goals = np.array([e.goal + eye for e in team])
    description = f"Habitat episodes, {floor:.2f} m floor"
    return World(file.stem, description, surfaces, ground, starts, goals, notes + skipped)


@dataclass(frozen=True, eq=False)
class Episode:
    """One PointNav task: the mesh's name; start (3,) and goal (3,) [m], on the floor, z up; yaw [rad]."""

    scene: str
    start: np.ndarray
    yaw: float
    goal: np.ndarray


def read(path: str | Path) -> list[Episode]:
    """The episodes of a file, in order. Raises SceneError."""
    path = Path(path)
    try:
        with gzip.open(path) as file:
            data = file.read(MOST_BYTES + 1)
    except gzip.BadGzipFile:
        raise SceneError(f"{path}: not packed by gzip; give the .json.gz of a PointNav data set") from None
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or "cut short or damaged"
        raise SceneError(f"{path}: cannot be read ({reason}); check the path, or download it again") from None
    if len(data) > MOST_BYTES:
        raise SceneError(f"{path}: unpacks to more than {MOST_BYTES >> 20} MB; give the file of a single scene")
    try:
        document = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise SceneError(f"{path}: not valid JSON ({error}); is the file complete?") from None
    listed = document.get("episodes") if isinstance(document, dict) else None
    if not isinstance(listed, list):
        raise SceneError(f"{path}: has no list of episodes; give a PointNav data set")
    if not listed:
        inside = sorted((path.parent / "content").glob("*.json.gz"))
        remedy = f"give one of content/, as {inside[0]}" if inside else "give another file"
        raise SceneError(f"{path}: its list of episodes is empty; {remedy}")
    episodes = Entry(document, str(path), remedy="is this a PointNav data set?").children("episodes")
    return [_episode(entry) for entry in episodes]


def _episode(entry: Entry) -> Episode:
    """An entry of the list, in this project's axes."""
    rotation, goals = entry.array("start_rotation", (4,)), entry.children("goals")
    if not 0.9 < np.linalg.norm(rotation) < 1.1:
        entry.fail("start_rotation", "a unit quaternion [x, y, z, w]", rotation.tolist())
    if not goals:
        entry.fail("goals", "a list of at least one goal", [])
    start, goal = entry.array("start_position", (3,)), goals[0].array("position", (3,))
    yaw = _yaw(rotation / np.linalg.norm(rotation))
    return Episode(entry.text("scene_id"), _upright(start), yaw, _upright(goal))


def _upright(point) -> np.ndarray:
    x, y, z = point
    return np.array([x, -z, y])


def _yaw(rotation) -> float:
    """Heading [rad] of a camera turned by a unit quaternion (x, y, z, w) that looks along −z before."""
    x, y, z, w = rotation
    ahead = _upright([-2 * (x * z + w * y), 2 * (w * x - y * z), 2 * (x * x + y * y) - 1])
    return math.atan2(ahead[1], ahead[0])


def _found(path: Path, folder: Path, name: str) -> Path:
    """The mesh `name` in `folder`, under its whole name or the end of it; never outside the folder."""
    if not folder.is_dir():
        raise SceneError(f"{folder}: is no folder; --scenes-dir names the one that holds {name}; {HINT}")
    parts = [part for part in PurePosixPath(name.replace("\\", "/")).parts if part not in ("/", "..")]
    for k in range(len(parts)):
        file = folder.joinpath(*parts[k:])
        if file.is_file():
            return file
    raise SceneError(f"{path}: its scene {name} is not in {folder}; put it there; {HINT}")


def _storey(surfaces: Surfaces, episodes: list[Episode], wanted) -> float | None:
    """Height [m] of the floor nearest to `wanted`, or of that under the first start that has one."""
    floors = storeys.floors(surfaces)
    if wanted is not None:
        return storeys.nearest(floors, wanted) if floors else None
    starts = np.stack([episode.start for episode in episodes])
    depth, _ = surfaces.cast(starts + np.array([0, 0, STEP]), np.tile([0.0, 0.0, -1.0], (len(starts), 1)))
    below = starts[depth <= 2 * STEP, 2] + STEP - depth[depth <= 2 * STEP]
    if len(below) == 0:
        return None
    here = float(below[0])
    floor = storeys.nearest([*floors, here + storeys.APART], here)
    return floor if abs(floor - here) <= storeys.FLAT else here  # a landing between two storeys


def _team(ground: Ground, episodes: list[Episode], n_robots: int) -> tuple[list[Episode], tuple[str, ...]]:
    """The episodes that robots take, and a note that counts the others seen on the way."""
    team, unfit, close = [], 0, 0
    for episode in episodes:
        if len(team) == n_robots:
            break
        ends = np.stack([episode.start, episode.goal])
        on_floor = np.abs(ends[:, 2] - ground.floor).max() <= STEP
        if not on_floor or not _reachable(ground, *ends):
            unfit += 1
        elif any(math.dist(a, b) < places.APART for e in team for a, b in zip(ends, (e.start, e.goal), strict=True)):
            close += 1
        else:
            team.append(episode)
    notes = [f"{unfit} episodes skipped: another storey, no free start, or a goal out of reach"] if unfit else []
    notes += [f"{close} episodes skipped: too near to another's start or goal"] if close else []
    return team, tuple(notes)


def _reachable(ground: Ground, start: np.ndarray, goal: np.ndarray) -> bool:
    radius = Config().robot_radius
    if ground.clearance(np.stack([start, goal])).min() < radius:
        return False
    try:
        ground.shortest_path(start, goal, radius)
    except ValueError:
        return False
    return True
