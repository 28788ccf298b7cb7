"""Caps, cut-offs and refusals of all renderers, kernels and dense twin alike."""

import math
from dataclasses import fields

import torch

from mannbv.kernels.limits import MAX_BLEND
from mannbv.splats import SplatMap

__all__ = ["CUTOFF", "FLOOR", "MAX_BLEND", "MAX_LOG_SCALE", "MAX_MEAN", "refuse"]

CUTOFF, FLOOR = 1 / 255, 1e-4
_FIELDS = [field.name for field in fields(SplatMap)]
MAX_MEAN, MAX_LOG_SCALE = 1e12, 14.0  # [m], and e¹⁴ m are a thousand kilometres


def refuse(splat_map: SplatMap) -> None:
    """Raises ValueError for what the kernel, compiled for numbers of reasonable size, must not see."""
    for name, part in zip(_FIELDS, splat_map.tensors(), strict=True):
        part = part.detach()
        if not (math.isfinite(part.sum()) or bool(torch.isfinite(part).all())):  # the sum is the quicker look
            raise ValueError(f"render: {name} hold nan or infinity; drop those splats with select(torch.isfinite(…))")
    turns = splat_map.rotations.detach().to(torch.float32).square().sum(1)
    if not bool(((turns > 1e-30) & (turns < 1e30)).all()):
        raise ValueError("render: rotations hold one of no length, or of none that fits a float; normalise them")
    farthest = float(splat_map.means.detach().abs().max()) if splat_map.n_splats else 0.0
    if farthest > MAX_MEAN:
        raise ValueError(f"render: a splat at {farthest:.0e} m; means are metres")
    widest = float(splat_map.log_scales.detach().max()) if splat_map.n_splats else 0.0
    if widest > MAX_LOG_SCALE:
        raise ValueError(f"render: a splat of e^{widest:.0f} m; log_scales are logarithms of metres")
