"""Shapes and types of every room are checked in tests; one thread; nothing random but what a test seeds."""

import importlib.util
from pathlib import Path

import hypothesis
import jaxtyping
import numba
import numpy as np
import pytest
import torch

_PACKAGE = Path(importlib.util.find_spec("mannbv").origin).parent


def _rooms() -> list[str]:
    """Every module or folder of the package but the numba kernels, whose loops cannot be wrapped."""
    names = {path.stem for path in _PACKAGE.glob("*.py")} | {
        path.parent.name for path in _PACKAGE.glob("*/__init__.py")
    }
    return [f"mannbv.{name}" for name in sorted(names - {"__init__", "kernels"})]


# the hook takes prefixes, so "mannbv" alone would cover the kernels too
jaxtyping.install_import_hook(_rooms(), "typechecker.checked")

torch.set_num_threads(1)
numba.set_num_threads(1)
hypothesis.settings.register_profile("mannbv", deadline=None, derandomize=True, database=None)
hypothesis.settings.load_profile("mannbv")


@pytest.fixture(autouse=True)
def _seeded():
    torch.manual_seed(0)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture
def unchecked(monkeypatch):
    """Without the shape checks, which would catch a wrong shape before the library's own message does."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
