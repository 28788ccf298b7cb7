"""Fit splats to frames: the loss of Eq. (2), and the descent."""

import torch
from torch import Tensor

from mannbv import render
from mannbv.camera import Camera, Frame
from mannbv.config import Config
from mannbv.mapping.adam import Moments, step_all, step_seen
from mannbv.splats import SplatMap


def loss(splat_map: SplatMap, camera: Camera, frame: Frame, depth_weight: float) -> Tensor:
    """Eq. (2) as means over pixels: L1 of colour + ψ L1 of depth [m]; pixels without a depth count for neither."""
    drawn = render.render(splat_map, camera, frame.pose)
    valid = frame.valid
    color = (drawn.color[valid] - frame.color[valid]).abs().sum(-1)
    depth = (drawn.depth[valid] - frame.depth[valid]).abs()  # a missing depth may be NaN, whose slope would spread
    return (color + depth_weight * depth).sum() / max(int(valid.sum()), 1)


def refine(
    splat_map: SplatMap, moments: Moments | None, camera: Camera, frames: list[Frame], config: Config, steps: int
) -> tuple[SplatMap, Moments | None]:
    """Adam on Eq. (2), one frame a step in turn, the last frame at every other step.

    moments: the memory with which the splats come, and with which they go; then only those that a frame shows are
    moved. None: a fresh memory, which moves all of them, and is forgotten.
    """
    if not (splat_map.n_splats and frames and steps):
        return splat_map, moments
    fields = [part.detach().reshape(splat_map.n_splats, -1) for part in splat_map.tensors()]
    widths = [field.shape[1] for field in fields]
    groups = config.rate_mean, config.rate_scale, config.rate_rotation, config.rate_opacity, config.rate_color
    lengths = [rate * config.learning_rate for rate, w in zip(groups, widths, strict=True) for _ in range(w)]
    rates = torch.tensor(lengths, dtype=torch.float64)
    rows = torch.cat(fields, 1).requires_grad_()
    memory = Moments.none(*rows.shape, dtype=rows.dtype) if moments is None else moments.copy()
    for turn in range(steps):
        frame = frames[-1] if turn % 2 == 0 else frames[-1 - (turn // 2) % len(frames)]
        if not bool(frame.valid.any()):
            continue
        means, log_scales, rotations, logits, colors = rows.split(widths, 1)
        drawn = SplatMap(means, log_scales, rotations, logits[:, 0], colors)
        (slopes,) = torch.autograd.grad(loss(drawn, camera, frame, config.depth_weight), rows)
        (step_all if moments is None else step_seen)(rows.detach(), slopes, memory, rates, config)
    means, log_scales, rotations, logits, colors = (part.contiguous() for part in rows.detach().split(widths, 1))
    unit = torch.nn.functional.normalize(rotations, dim=1)
    fitted = SplatMap(means, log_scales, unit, logits[:, 0], colors.clamp(0, 1))
    return fitted, None if moments is None else memory


def fit(splat_map: SplatMap, camera: Camera, frames: list[Frame], config: Config, steps: int | None = None) -> SplatMap:
    """`refine` with a fresh optimiser; `fit_steps` steps unless told otherwise."""
    return refine(splat_map, None, camera, frames, config, config.fit_steps if steps is None else steps)[0]
