"""Scenes by name or by file."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from mannbv.world import extrude
from mannbv.world.errors import SceneError
from mannbv.world.formats import mesh, plan, pointnav, rosmap
from mannbv.world.world import World


@dataclass(frozen=True)
class Summary:
    """A bundled scene: its name, a line about it, its floor area [m²]."""

    name: str
    description: str
    area: float


def folder() -> Path:
    """Where the bundled scenes lie: inside an installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    for place in (package / "data", package.parent / "data"):
        if (place / "flat.json").is_file():
            return place
    raise SceneError(f"{package}: the bundled scenes are missing; install the package again")


def scenes() -> list[Summary]:
    """The bundled scenes, the smallest first."""
    plans = [plan.read(path) for path in folder().glob("*.json")]
    return sorted((Summary(p.name, p.description, p.inside.area) for p in plans), key=lambda s: s.area)


def load(
    scene: str | Path,
    *,
    dim: int | None = None,
    starts: ArrayLike | None = None,
    goals: ArrayLike | None = None,
    up: str | None = None,
    scale: float | None = None,
    floor: float | None = None,
    scenes_dir: str | Path | None = None,
    building: str | None = None,
) -> World:
    """The world of a bundled scene (its name) or a plan (`.json`), flat or in 3-D; of a ROS map (`.yaml`, flat); of a
    mesh (`.glb`, `.gltf`, `.obj`, `.ply`) or a Habitat PointNav file (`.json.gz`), in 3-D or the plan of its ground.

    dim: 2, 3, or None for what the file is made for. `starts` (k, 3) x, y [m], yaw [rad] and `goals` (k, 2) [m] replace
    those of the scene. Of a mesh: up ("y", "-z", …), scale [m a unit] and floor [m] overrule what is guessed; of
    PointNav episodes also: scenes_dir, where their meshes lie, and building, the name of one of them (default: the
    first's). Loading executes nothing. Raises SceneError, one line that names the file, the thing and the remedy.
    """
    given = {"up": up, "scale": scale, "floor": floor, "scenes_dir": scenes_dir, "building": building}
    given = {name: value for name, value in given.items() if value is not None}
    return _load(Path(scene), dim, given).placed(starts, goals)


def _load(path: Path, dim: int | None, given: dict) -> World:
    kind = ".json.gz" if path.name.lower().endswith(".json.gz") else path.suffix.lower()
    for option in given:
        if kind != ".json.gz" and (kind not in mesh.SUFFIXES or option in ("scenes_dir", "building")):
            kinds = "PointNav episodes" if option in ("scenes_dir", "building") else "meshes and PointNav episodes"
            raise SceneError(f"{path}: --{option.replace('_', '-')} is for {kinds}; leave it out")
    if kind == ".json.gz" or kind in mesh.SUFFIXES:
        building = (mesh if kind in mesh.SUFFIXES else pointnav).load(path, **given)
        return _grounded(building) if dim == 2 else building
    if kind in (".yaml", ".yml"):
        if dim == 3:
            raise SceneError(f"{path}: a ROS map tells no heights; use --dim 2, or give a mesh")
        return rosmap.load(path)
    if kind != ".json":
        names = ", ".join(scene.name for scene in scenes())
        known = f"give one of {names}, a plan (.json), a ROS map (.yaml), a mesh ({', '.join(mesh.SUFFIXES)})"
        if kind or len(path.parts) != 1 or not (folder() / f"{path.name}.json").is_file():
            raise SceneError(f"{path}: no such scene; {known}, or PointNav episodes (.json.gz)")
        path = folder() / f"{path.name}.json"
    return extrude.load(path) if dim == 3 else plan.load(path)


def _grounded(building: World) -> World:
    """The plan of a building's ground as a world in the plane."""
    ground, starts, goals = building.ground, np.delete(building.starts, 2, axis=1), building.goals[:, :2].copy()
    return World(building.name, building.description, ground.walls, ground, starts, goals, building.notes)
