"""From a splat map to an image, Eq. (1)."""

from mannbv.render.dense import Composite, Rendering, check, compose
from mannbv.render.dispatch import METHODS, engine, render

__all__ = ["METHODS", "Composite", "Rendering", "check", "compose", "engine", "render"]
