"""Ground truth: floor plans and maps, what a camera senses in them, how a robot moves (Section VI-B)."""

from mannbv.world.flat import TEXTURES, SceneError, World
from mannbv.world.library import Place, Summary, load, scenes
from mannbv.world.motion import ACTIONS, actions_towards, follow, move, turn_to
from mannbv.world.space import Space
from mannbv.world.surfaces import Surfaces

__all__ = [
    "ACTIONS",
    "TEXTURES",
    "Place",
    "SceneError",
    "Space",
    "Summary",
    "Surfaces",
    "World",
    "actions_towards",
    "follow",
    "load",
    "move",
    "scenes",
    "turn_to",
]
