"""Teach, learn and study multi-robot next-best-view planning on Gaussian-splat maps."""

import importlib
import os
import warnings

# torch and numba bring an OpenMP each; threads of one that spin while they wait would keep the other's from the cores
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

__version__ = "0.1.0"

_MOVED = dict.fromkeys(("study", "draw", "bench", "doctor"), "lab")
_MOVED |= dict.fromkeys(("widgets", "check", "grade"), "course")


def __getattr__(name: str):
    """Rooms where they were before the wings were built, for one version."""
    if name not in _MOVED:
        raise AttributeError(f"module 'mannbv' has no attribute '{name}'")
    place = f"mannbv.{_MOVED[name]}"
    warnings.warn(f"mannbv.{name} has moved: from {place} import {name}", DeprecationWarning, stacklevel=2)
    return importlib.import_module(f"{place}.{name}")
