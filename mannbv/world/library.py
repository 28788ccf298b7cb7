"""Scenes by name or by file."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mannbv.world import plan, rosmap
from mannbv.world.flat import SceneError, World


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
    return sorted((Summary(p.name, p.description, p.area) for p in plans), key=lambda s: s.area)


def load(scene, *, starts=None, goals=None) -> World:
    """The world of a bundled scene (its name), a plan (`.json`) or a ROS map (`.yaml`, `.yml`).

    `starts` (k, 3) x, y [m], yaw [rad] and `goals` (k, 2) [m] replace those of the scene. Loading executes nothing.
    Raises SceneError, one line that names the file, the thing and the remedy.
    """
    world = _load(Path(scene))
    for name, places, width in (("starts", starts, 3), ("goals", goals, 2)):
        if places is None:
            continue
        places = np.atleast_2d(np.asarray(places, float))
        if places.ndim != 2 or places.shape[1] != width or not np.isfinite(places).all():
            raise SceneError(f"{world.name}: {name} must be rows of {width} finite numbers")
        world = dataclasses.replace(world, **{name: places})
    return world


def _load(path: Path) -> World:
    suffix = path.suffix.lower()
    if suffix == ".json":
        return plan.load(path)
    if suffix in (".yaml", ".yml"):
        return rosmap.load(path)
    names = ", ".join(scene.name for scene in scenes())
    if suffix or len(path.parts) != 1 or not (folder() / f"{path.name}.json").is_file():
        raise SceneError(f"{path}: no such scene; give one of {names}, a plan (.json) or a ROS map (.yaml)")
    return plan.load(folder() / f"{path.name}.json")
