"""Teach, learn and study multi-robot next-best-view planning on Gaussian-splat maps."""

import importlib
import os
import warnings
from types import ModuleType

# torch and numba bring an OpenMP each; threads of one that spin while they wait would keep the other's from the cores
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

__version__ = "0.1.0"

_MOVED = {"lab": ("study", "draw", "bench", "doctor"), "course": ("widgets", "check", "grade")}


def __getattr__(name: str) -> ModuleType:
    """Rooms where they were before the wings were built, for one version."""
    for wing, rooms in _MOVED.items():
        if name in rooms:
            place = f"mannbv.{wing}"
            warnings.warn(f"mannbv.{name} has moved: from {place} import {name}", DeprecationWarning, stacklevel=2)
            return importlib.import_module(f"{place}.{name}")
    raise AttributeError(f"module 'mannbv' has no attribute '{name}'")
