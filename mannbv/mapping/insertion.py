"""Where a frame shows what the map does not, the splats that are born there, and those that may stay."""

import numpy as np
import torch
from torch import Tensor

from mannbv import geometry, render
from mannbv.camera import Camera, Frame, back_project
from mannbv.config import Config
from mannbv.splats import SplatMap


def unexplained(splat_map: SplatMap, camera: Camera, frame: Frame, config: Config) -> Tensor:
    """Pixels (…) with a depth that the map does not show: too transparent there, or at another depth."""
    if not splat_map.n_splats:
        return frame.valid
    with torch.no_grad():
        drawn = render.render(splat_map, camera, frame.pose)
    depth = drawn.depth / drawn.opacity.clamp_min(1e-6)
    tolerance = config.explained_depth * frame.depth.clamp_min(config.explained_near)
    explained = (drawn.opacity > config.explained_opacity) & ((depth - frame.depth).abs() < tolerance)
    return frame.valid & ~explained


def mistaken(splat_map: SplatMap, camera: Camera, frame: Frame, config: Config) -> Tensor:
    """Pixels (…) with a depth whose colour is wrong by more than `densify_error`: finer than the splats there."""
    with torch.no_grad():
        drawn = render.render(splat_map, camera, frame.pose)
    return frame.valid & ((drawn.color - frame.color).abs().mean(-1) > config.densify_error)


def thinned(pixels: Tensor, spacing: int) -> Tensor:
    """Of the marked pixels (…) at most one in each block of `spacing` pixels a side: the one nearest to its middle."""
    places = pixels.nonzero()
    away = (places % spacing - (spacing - 1) / 2).square().sum(1)
    order = torch.argsort(away, stable=True)
    blocks = np.ravel_multi_index(tuple((places[order] // spacing).T.numpy()), pixels.shape)
    _, first = np.unique(blocks, return_index=True)
    chosen = torch.zeros_like(pixels)
    chosen[tuple(places[order[torch.from_numpy(first)]].T)] = True
    return chosen


def newborn(camera: Camera, frame: Frame, pixels: Tensor, config: Config) -> SplatMap:
    """Round splats at marked pixels (…) of a frame, one in `insert_spacing` pixels a side and about as wide."""
    rows = thinned(pixels, config.insert_spacing).reshape(-1)
    points = back_project(frame, camera)[rows]
    depth = frame.depth.reshape(-1)[rows]
    n, dim = points.shape
    width = config.insert_scale * config.insert_spacing
    log_scales = torch.log(width * depth / camera.focal)[:, None].expand(n, dim)
    logit = float(np.log(config.insert_opacity / (1 - config.insert_opacity)))
    colors = frame.color.reshape(-1, 3)[rows]
    return SplatMap(
        points, log_scales.contiguous(), geometry.identity_rotations(n, dim), torch.full((n,), logit), colors.clone()
    )


def survivors(splat_map: SplatMap, config: Config) -> Tensor:
    """Which splats (n,) stay: opaque enough, and no wider than `prune_scale` [m]."""
    return (splat_map.opacities >= config.prune_opacity) & (splat_map.scales.amax(1) <= config.prune_scale)
