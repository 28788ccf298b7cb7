"""Scenes by name or by file."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mannbv.world import extrude
from mannbv.world.errors import SceneError
from mannbv.world.formats import mesh, plan, pointnav, rosmap
from mannbv.world.world import World

_OF_A_MESH = ("up", "scale", "floor", "scenes_dir", "building")  # the last two: of PointNav episodes only


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


def load(scene, *, dim: int | None = None, starts=None, goals=None, **of_a_mesh) -> World:
    """The world of a bundled scene (its name) or a plan (`.json`), flat or in 3-D; of a ROS map (`.yaml`, flat); of a
    mesh (`.glb`, `.gltf`, `.obj`, `.ply`) or a Habitat PointNav file (`.json.gz`), in 3-D or the plan of its ground.

    dim: 2, 3, or None for what the file is made for. `starts` (k, 3) x, y [m], yaw [rad] and `goals` (k, 2) [m] replace
    those of the scene. Of a mesh: up ("y", "-z", …), scale [m a unit] and floor [m] overrule what is guessed; of
    PointNav episodes also: scenes_dir, where their meshes lie, and building, the name of one of them (default: the
    first's). Loading executes nothing. Raises SceneError, one line that names the file, the thing and the remedy.
    """
    given = {name: value for name, value in of_a_mesh.items() if value is not None}
    unknown = sorted(set(given) - set(_OF_A_MESH))
    if unknown:
        raise TypeError(f"load: no option is called {', '.join(unknown)}; known: {', '.join(_OF_A_MESH)}")
    return _load(Path(scene), dim, given).placed(starts, goals)


def _load(path: Path, dim: int | None, given: dict) -> World:
    suffix = ".json.gz" if path.name.lower().endswith(".json.gz") else path.suffix.lower()
    if suffix == ".json.gz":
        place = pointnav.load(path, given.pop("scenes_dir", None), given.pop("building", None), **given)
        return _grounded(place) if dim == 2 else place
    wrong = [name for name in given if suffix not in mesh.SUFFIXES or name not in _OF_A_MESH[:3]]
    if wrong:
        what = "PointNav episodes" if wrong[0] not in _OF_A_MESH[:3] else "meshes and PointNav episodes"
        raise SceneError(f"{path}: --{wrong[0].replace('_', '-')} is for {what}; leave it out")
    if suffix in mesh.SUFFIXES:
        place = mesh.load(path, **given)
        return _grounded(place) if dim == 2 else place
    if suffix in (".yaml", ".yml"):
        if dim == 3:
            raise SceneError(f"{path}: a ROS map tells no heights; use --dim 2, or give a mesh")
        return rosmap.load(path)
    if suffix != ".json":
        names = ", ".join(scene.name for scene in scenes())
        known = f"give one of {names}, a plan (.json), a ROS map (.yaml), a mesh ({', '.join(mesh.SUFFIXES)})"
        if suffix or len(path.parts) != 1 or not (folder() / f"{path.name}.json").is_file():
            raise SceneError(f"{path}: no such scene; {known}, or PointNav episodes (.json.gz)")
        path = folder() / f"{path.name}.json"
    return extrude.load(path) if dim == 3 else plan.load(path)


def _grounded(building: World) -> World:
    """The plan of a building's ground as a world in the plane."""
    ground, starts, goals = building.ground, np.delete(building.starts, 2, axis=1), building.goals[:, :2].copy()
    return World(building.name, building.description, ground.walls, ground, starts, goals, building.notes)
