"""What one would write without this package's kernels, in plain torch; every function returns what ours returns."""

import torch
from torch import Tensor

from mannbv import render
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.geometry import Pose
from mannbv.splats import SplatMap

_DEFAULT = Config()
_TURN = 2  # the rotation's place among a map's fields: written as (cos, sin) or a quaternion it has no like in Fisher


def _measured(splat_map: SplatMap, camera: Camera, pose: Pose) -> Tensor:
    """Every channel of every pixel over its standard deviation."""
    drawn = render.render(splat_map, camera, pose, "dense")
    return torch.cat([drawn.color.reshape(-1) / _DEFAULT.sigma_color, drawn.depth.reshape(-1) / _DEFAULT.sigma_depth])


def _table(squares: list[Tensor]) -> Tensor:
    """(n, p) without the rotation's columns: mean, log-scale, logit, colour."""
    return torch.cat([part.reshape(len(part), -1) for k, part in enumerate(squares) if k != _TURN], 1)


def looped_fisher(splat_map: SplatMap, camera: Camera, pose: Pose) -> Tensor:
    """diag(JᵀJ) by one backward pass for each channel of each pixel."""
    leaves = [part.detach().clone().requires_grad_() for part in splat_map.tensors()]
    squares = [torch.zeros_like(leaf) for leaf in leaves]
    for value in _measured(SplatMap(*leaves), camera, pose):
        for total, slope in zip(squares, torch.autograd.grad(value, leaves, retain_graph=True), strict=True):
            total += slope**2
    return _table(squares)


def jacrev_fisher(splat_map: SplatMap, camera: Camera, pose: Pose) -> Tensor:
    """diag(JᵀJ) by `torch.func.jacrev`."""
    fields = splat_map.tensors()
    slopes = torch.func.jacrev(lambda *parts: _measured(SplatMap(*parts), camera, pose), tuple(range(len(fields))))
    return _table([(slope**2).sum(0) for slope in slopes(*fields)])


def without_turn(rows: Tensor, dim: int) -> Tensor:
    """Fisher rows (n, p) without the rotation's columns."""
    return torch.cat([rows[:, : 2 * dim], rows[:, -4:]], 1)


def risk_field(splat_map: SplatMap, points: Tensor, factor: float) -> Tensor:
    """min over splats of distance − factor · σ, from all distances, some points at a time."""
    offset = factor * splat_map.scales.amax(1)
    return torch.cat([(torch.cdist(part, splat_map.means) - offset).amin(1) for part in points.split(100)])
