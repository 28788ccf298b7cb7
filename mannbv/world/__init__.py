"""Ground truth: floor plans and maps, what a camera senses in them, how a robot moves (Section VI-B)."""

from mannbv.world.flat import TEXTURES, SceneError, World
from mannbv.world.library import Summary, load, scenes
from mannbv.world.motion import ACTIONS, actions_towards, follow, move, turn_to

__all__ = [
    "ACTIONS",
    "TEXTURES",
    "SceneError",
    "Summary",
    "World",
    "actions_towards",
    "follow",
    "load",
    "move",
    "scenes",
    "turn_to",
]
