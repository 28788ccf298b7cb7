"""A local map as named arrays, and as a file from which mapping goes on as if it had never stopped."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch

from mannbv import archive
from mannbv.camera import Frame
from mannbv.mapping.adam import Moments
from mannbv.mapping.local import LocalMap
from mannbv.splats import FormatError, SplatMap


def to_arrays(local: LocalMap, prefix: str = "") -> dict[str, np.ndarray]:
    """Everything that the next step needs: splats, ids, prior, moments, keyframes."""
    arrays = archive.pack(local.splats, prefix) | archive.stack(local.keyframes, f"{prefix}keyframe_")
    own = {"ids": local.ids.numpy(), "prior": local.prior.numpy(), "born": np.array(local.born)}
    moments = archive.pack(local.moments, f"{prefix}moments_") if local.moments else {}
    return arrays | {prefix + name: values for name, values in own.items()} | moments


def from_arrays(arrays: Mapping[str, np.ndarray], prefix: str = "") -> LocalMap:
    """The inverse of `to_arrays`. Raises KeyError for a missing array, ValueError for rows that do not match."""
    splat_map = archive.unpack(SplatMap, arrays, prefix)
    ids, prior = (torch.from_numpy(arrays[prefix + name]) for name in ("ids", "prior"))
    kept = f"{prefix}moments_first" in arrays
    moments = archive.unpack(Moments, arrays, f"{prefix}moments_") if kept else None
    for part in (ids, prior, *(moments.tensors() if moments else ())):
        if len(part) != splat_map.n_splats:
            raise ValueError(f"{len(part)} rows beside {splat_map.n_splats} splats")
    if not all(bool(torch.isfinite(part).all()) for part in splat_map.tensors()):
        raise ValueError("its splats hold nan or infinity")
    width = sum(part.shape[1:].numel() for part in splat_map.tensors())
    if moments and not moments.first.shape == moments.second.shape == (splat_map.n_splats, width):
        raise ValueError(f"moments of {tuple(moments.first.shape)} beside splats of {width} numbers")
    keyframes = archive.unstack(Frame, arrays, f"{prefix}keyframe_")
    return LocalMap(splat_map, ids, prior, keyframes, int(arrays[f"{prefix}born"]), moments)


def save(local: LocalMap, path: str | Path) -> None:
    """Write a local map to `path` (.npz without pickle); the file is whole at any moment."""
    archive.write(path, to_arrays(local))


def load(path: str | Path) -> LocalMap:
    """Read a local map; nothing in the file is ever executed. Raises splats.FormatError for anything else."""
    try:
        return from_arrays(archive.read(path))
    except (ValueError, TypeError) as error:
        raise FormatError(f"{path}: not a whole local map ({error}); map again from the frames") from None
