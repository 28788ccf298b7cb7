"""A local map as named arrays, and as a file from which mapping goes on as if it had never stopped."""

import dataclasses
import os
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch

from mannbv.camera import Frame
from mannbv.geometry import Pose
from mannbv.mapping.adam import Moments
from mannbv.mapping.local import LocalMap
from mannbv.splats import FormatError, SplatMap

_SPLATS = [f.name for f in dataclasses.fields(SplatMap)]
_MOMENTS = [f.name for f in dataclasses.fields(Moments)]
_FRAME = ("color", "depth", "rotation", "position")


def to_arrays(local: LocalMap) -> dict[str, np.ndarray]:
    """Everything that the next step needs: splats, ids, prior, moments, keyframes."""
    arrays = {name: part.numpy() for name, part in zip(_SPLATS, local.splats.tensors(), strict=True)}
    arrays |= {"ids": local.ids.numpy(), "prior": local.prior.numpy(), "born": np.array(local.born)}
    if local.moments is not None:
        pairs = zip(_MOMENTS, local.moments.tensors(), strict=True)
        arrays |= {f"moments_{name}": part.numpy() for name, part in pairs}
    if local.keyframes:
        parts = [(f.color, f.depth, f.pose.rotation, f.pose.position) for f in local.keyframes]
        stacked = zip(_FRAME, zip(*parts, strict=True), strict=True)
        arrays |= {f"keyframe_{name}": torch.stack(values).numpy() for name, values in stacked}
    return arrays


def from_arrays(arrays: Mapping[str, np.ndarray]) -> LocalMap:
    """The inverse of `to_arrays`. Raises KeyError for a missing array, ValueError for rows that do not match."""
    tensor = lambda name: torch.from_numpy(np.array(arrays[name]))  # noqa: E731
    splat_map = SplatMap(*(tensor(name) for name in _SPLATS))
    ids, prior, moments, keyframes = tensor("ids"), tensor("prior"), None, ()
    if f"moments_{_MOMENTS[0]}" in arrays:
        moments = Moments(*(tensor(f"moments_{name}") for name in _MOMENTS))
    for part in (ids, prior, *(moments.tensors() if moments else ())):
        if len(part) != splat_map.n_splats:
            raise ValueError(f"{len(part)} rows beside {splat_map.n_splats} splats")
    for name, part in zip(_SPLATS, splat_map.tensors(), strict=True):
        if not bool(torch.isfinite(part).all()):
            raise ValueError(f"{name} hold nan or infinity")
    width = sum(part.shape[1:].numel() for part in splat_map.tensors())
    if moments and not moments.first.shape == moments.second.shape == (splat_map.n_splats, width):
        raise ValueError(f"moments of {tuple(moments.first.shape)} beside splats of {width} numbers")
    if f"keyframe_{_FRAME[0]}" in arrays:
        parts = zip(*(tensor(f"keyframe_{name}") for name in _FRAME), strict=True)
        keyframes = tuple(Frame(color, depth, Pose(turn, place)) for color, depth, turn, place in parts)
    return LocalMap(splat_map, ids, prior, keyframes, int(arrays["born"]), moments)


def save(local: LocalMap, path) -> None:
    """Write a local map to `path` (.npz without pickle); the file is whole at any moment."""
    path = Path(path)
    beside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    with beside.open("wb") as file:
        np.savez(file, **to_arrays(local))
    os.replace(beside, path)


def load(path) -> LocalMap:
    """Read a local map; nothing in the file is ever executed. Raises splats.FormatError for anything else."""
    path = Path(path)
    if not path.is_file():
        raise FormatError(f"{path}: no such file")
    try:
        if not zipfile.is_zipfile(path):  # numpy would advise to trust it
            raise zipfile.BadZipFile("no .npz archive, or cut short")
        with np.load(path, allow_pickle=False) as archive:
            return from_arrays(archive)
    except (zipfile.BadZipFile, zlib.error, MemoryError, OSError, EOFError, KeyError, TypeError, ValueError) as error:
        fault = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise FormatError(f"{path}: not a whole local map ({fault}); map again from the frames") from None
