"""Grow and fit a local map to RGB-D frames, Eq. (2): insert where the map does not explain, fit, densify, prune."""

from mannbv.mapping.adam import Moments
from mannbv.mapping.fitting import fit, loss, refine
from mannbv.mapping.insertion import mistaken, newborn, survivors, thinned, unexplained
from mannbv.mapping.local import LocalMap, observe, window
from mannbv.mapping.store import from_arrays, load, save, to_arrays

__all__ = [
    "LocalMap", "Moments", "fit", "from_arrays", "load", "loss", "mistaken", "newborn", "observe", "refine", "save",
    "survivors", "thinned", "to_arrays", "unexplained", "window",
]  # fmt: skip
