"""From a splat map to an image, Eq. (1)."""

from mannbv.render.dense import Composite, Rendering, compose, render

__all__ = ["Composite", "Rendering", "compose", "render"]
