"""Teach, learn and study multi-robot next-best-view planning on Gaussian-splat maps."""

import os

# torch and numba bring an OpenMP each; threads of one that spin while they wait would keep the other's from the cores
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

__version__ = "0.1.0"
