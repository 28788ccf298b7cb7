"""Ground truth: a `World` is what a camera meets and what a robot stands on; how a robot moves there (Section VI-B)."""

from mannbv.world.errors import SceneError
from mannbv.world.ground import Ground
from mannbv.world.library import Summary, load, scenes
from mannbv.world.motion import follow, turn_to
from mannbv.world.segments import TEXTURES, Segments
from mannbv.world.surfaces import Surfaces
from mannbv.world.world import World

__all__ = [
    "TEXTURES",
    "Ground",
    "SceneError",
    "Segments",
    "Summary",
    "Surfaces",
    "World",
    "follow",
    "load",
    "scenes",
    "turn_to",
]
