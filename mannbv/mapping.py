"""Grow and fit a local map to RGB-D frames, Eq. (2): insert where the map does not explain, fit, prune."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from mannbv import geometry, render, splats
from mannbv.camera import Camera, Frame, back_project
from mannbv.config import Config
from mannbv.splats import SplatMap

# Adam's step for mean [m], log-scale, rotation, opacity logit, colour; chosen here
_RATES = (0.002, 0.03, 0.03, 0.05, 0.02)


@dataclass(frozen=True)
class LocalMap:
    """One robot's private map: its splats, their ids (n,) in order of birth, what is known of them, its keyframes.

    prior (n, p): information of the past keyframes; its rows follow insertion and pruning, new splats start at 0.
    """

    splats: SplatMap
    ids: Int[Tensor, " n"]
    prior: Float[Tensor, "n p"]
    keyframes: tuple[Frame, ...] = ()
    born: int = 0

    @staticmethod
    def empty(dim: int, n_parameters: int) -> "LocalMap":
        return LocalMap(SplatMap.empty(dim), torch.zeros(0, dtype=torch.int64), torch.zeros(0, n_parameters))

    def replace(self, **changes) -> "LocalMap":
        return dataclasses.replace(self, **changes)


def unexplained(splat_map: SplatMap, camera: Camera, frame: Frame, config: Config) -> Tensor:
    """Pixels (…) with a depth that the map does not show: too transparent there, or at another depth."""
    if not splat_map.n_splats:
        return frame.valid
    with torch.no_grad():
        drawn = render.render(splat_map, camera, frame.pose)
    depth = drawn.depth / drawn.opacity.clamp_min(1e-6)
    tolerance = config.explained_depth * frame.depth.clamp_min(1.0)
    explained = (drawn.opacity > config.explained_opacity) & ((depth - frame.depth).abs() < tolerance)
    return frame.valid & ~explained


def newborn(camera: Camera, frame: Frame, pixels: Tensor, config: Config) -> SplatMap:
    """One round splat at each marked pixel (…) of a frame, a fixed number of pixels wide."""
    rows = pixels.reshape(-1)
    points = back_project(frame, camera)[rows]
    depth = frame.depth.reshape(-1)[rows]
    n, dim = points.shape
    log_scales = torch.log(config.insert_scale * depth / camera.focal)[:, None].expand(n, dim)
    logit = float(np.log(config.insert_opacity / (1 - config.insert_opacity)))
    colors = frame.color.reshape(-1, 3)[rows]
    return SplatMap(
        points, log_scales.contiguous(), geometry.identity_rotations(n, dim), torch.full((n,), logit), colors.clone()
    )


def loss(splat_map: SplatMap, camera: Camera, frame: Frame, depth_weight: float) -> Tensor:
    """Eq. (2) as means over pixels: L1 of colour + ψ L1 of depth [m]; pixels without a depth count for neither."""
    drawn = render.render(splat_map, camera, frame.pose)
    valid = frame.valid
    color = (drawn.color[valid] - frame.color[valid]).abs().sum(-1)
    depth = (drawn.depth[valid] - frame.depth[valid]).abs()  # a missing depth may be NaN, whose slope would spread
    return (color + depth_weight * depth).sum() / max(int(valid.sum()), 1)


def fit(splat_map: SplatMap, camera: Camera, frames: list[Frame], config: Config, steps: int | None = None) -> SplatMap:
    """Adam on Eq. (2), one frame a step in turn, the last frame at every other step; a fresh optimiser each time."""
    steps = config.fit_steps if steps is None else steps
    if not (splat_map.n_splats and frames and steps):
        return splat_map
    leaves = [t.detach().clone().requires_grad_(True) for t in splat_map.tensors()]
    groups = [{"params": [t], "lr": r * config.learning_rate} for t, r in zip(leaves, _RATES, strict=True)]
    optimiser = torch.optim.Adam(groups, betas=(0.8, 0.95), foreach=True)
    for step in range(steps):
        frame = frames[-1] if step % 2 == 0 else frames[-1 - (step // 2) % len(frames)]
        if not bool(frame.valid.any()):
            continue
        optimiser.zero_grad()
        loss(SplatMap(*leaves), camera, frame, config.depth_weight).backward()
        optimiser.step()
    means, log_scales, rotations, logits, colors = (t.detach() for t in leaves)
    return SplatMap(means, log_scales, torch.nn.functional.normalize(rotations, dim=1), logits, colors.clamp(0, 1))


def survivors(splat_map: SplatMap, config: Config) -> Tensor:
    """Which splats (n,) stay: opaque enough, and no wider than `prune_scale` [m]."""
    return (splat_map.opacities >= config.prune_opacity) & (splat_map.scales.amax(1) <= config.prune_scale)


def window(keyframes: tuple[Frame, ...], config: Config, rng: np.random.Generator) -> list[Frame]:
    """The latest keyframes, and two older ones so that the past is not forgotten; the newest last."""
    recent, old = list(keyframes[-config.fit_window :]), keyframes[: -config.fit_window]
    chosen = sorted(rng.permutation(len(old))[:2].tolist())
    return [old[k] for k in chosen] + recent


def observe(local: LocalMap, camera: Camera, frame: Frame, config: Config, rng: np.random.Generator) -> LocalMap:
    """A robot's map after one more keyframe: insert, fit on a window, prune."""
    fresh = newborn(camera, frame, unexplained(local.splats, camera, frame, config), config)
    grown = splats.union(local.splats, fresh)
    ids = torch.cat([local.ids, local.born + torch.arange(fresh.n_splats)])
    prior = torch.cat([local.prior, torch.zeros(fresh.n_splats, local.prior.shape[1])])
    keyframes = (*local.keyframes, frame)
    fitted = fit(grown, camera, window(keyframes, config, rng), config)
    keep = survivors(fitted, config)
    return LocalMap(fitted.select(keep), ids[keep], prior[keep], keyframes, local.born + fresh.n_splats)
