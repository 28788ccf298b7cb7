"""Flatland's fast renderer: the numba kernel of a one-row image behind torch, with gradients for every splat parameter.

The dense reference is its twin; blends under 1/255 are dropped and a pixel ends at transmittance 1e-4.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor
from torch.autograd.function import once_differentiable

from mannbv import geometry
from mannbv.camera import EDGE, LOW_PASS, NEAR, Camera
from mannbv.geometry import Pose
from mannbv.kernels.flat import gram as grams
from mannbv.kernels.flat import row
from mannbv.render.limits import CUTOFF, FLOOR, refuse
from mannbv.splats import SplatMap


@dataclass(frozen=True)
class Row:
    """The splats before a one-row camera, front to back: rows of the map, image quantities, chain (see the kernel)."""

    index: np.ndarray
    u: np.ndarray
    var: np.ndarray
    depth: np.ndarray
    chain: np.ndarray
    opacity: np.ndarray
    forward: np.ndarray

    def shape(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.u, self.var, self.opacity


def serves(splat_map: SplatMap, *others: Tensor) -> bool:
    """Whether the kernel applies: flatland, float32, on the CPU, and no gradient asked of the other tensors."""
    means = splat_map.means
    plain = means.dtype == torch.float32 and means.device.type == "cpu"
    return splat_map.dim == 2 and plain and not any(t.requires_grad for t in others)


def project(splat_map: SplatMap, camera: Camera, pose: Pose, around: bool = False) -> Row:
    """Project a flatland map for the kernel; `around`: in all directions, u = focal · angle, without low pass."""
    refuse(splat_map)
    means, log_scales, rotations, logits, _ = (t.detach().double().cpu().numpy() for t in splat_map.tensors())
    rotation, position = pose.rotation.detach().double().cpu().numpy(), pose.position.detach().double().cpu().numpy()
    limit, low_pass = EDGE * camera.width / 2 / camera.focal, 0.0 if around else LOW_PASS
    index, u, var, depth, chain = row.project(
        means, log_scales, rotations, rotation, position, camera.focal, camera.width, limit, NEAR, low_pass, around
    )
    return Row(index, u, var, depth, chain, 1 / (1 + np.exp(-logits[index])), rotation[:, 1])


class _Render(torch.autograd.Function):
    """colour and depth (4, W) and opacity (W,) in one array (5, W)."""

    @staticmethod
    def forward(ctx, means, log_scales, rotations, logits, colors, camera, pose, cutoff, floor):
        seen = project(SplatMap(means, log_scales, rotations, logits, colors), camera, pose)
        values = np.concatenate([colors.detach().double().numpy()[seen.index], seen.depth[:, None]], 1)
        image = row.composite(*seen.shape(), values, camera.width, cutoff, floor)
        ctx.save_for_backward(means, log_scales, rotations, logits, colors)
        ctx.kept = seen, values, image, camera.width, cutoff, floor
        return torch.from_numpy(image).to(means)

    @staticmethod
    @once_differentiable
    def backward(ctx, *grad_outputs):  # pyright: ignore[reportIncompatibleMethodOverride]  the decorator has no type
        (slopes,), (seen, values, image, width, cutoff, floor) = grad_outputs, ctx.kept
        u, var, opacity = seen.shape()
        means, log_scales, rotations, logits, colors = ctx.saved_tensors
        q, by_value = row.backward(u, var, opacity, values, image, slopes.double().numpy(), width, cutoff, floor)
        chain, by_var = seen.chain, q[:, 1:2]
        by_mean = q[:, :1] * chain[:, :2] + by_var * chain[:, 2:4] + by_value[:, 3:] * seen.forward
        unit = torch.nn.functional.normalize(rotations.detach().double(), dim=1).numpy()[seen.index]
        length = torch.linalg.norm(rotations.detach().double(), dim=1).numpy()[seen.index]
        across = np.stack([-unit[:, 1], unit[:, 0]], 1) / length[:, None]
        parts = [by_mean, by_var * chain[:, 4:6], by_var * chain[:, 6:] * across, q[:, 2], by_value[:, :3]]
        grads = []
        for like, part in zip((means, log_scales, rotations, logits, colors), parts, strict=True):
            grad = np.zeros(like.shape)
            grad[seen.index] = part
            grads.append(torch.from_numpy(grad).to(like))
        return (*grads, None, None, None, None)


def render(splat_map: SplatMap, camera: Camera, pose: Pose, cutoff: float = CUTOFF, floor: float = FLOOR) -> Tensor:
    """colour, depth and opacity as (5, W)."""
    return _Render.apply(*splat_map.tensors(), camera, pose, cutoff, floor)


def fisher(
    joint: SplatMap, n_own: int, camera: Camera, pose: Pose, sigma_color: float, sigma_depth: float,
    cutoff: float = CUTOFF, floor: float = FLOOR,
) -> Tensor:  # fmt: skip
    """diag(JᵀJ) (n_own, 9) of the first `n_own` splats; the others only occlude."""
    seen = project(joint, camera, pose)
    colors = joint.colors.detach().double().numpy()[seen.index]
    own = seen.index < n_own
    rows = row.fisher(
        *seen.shape(), seen.depth, seen.chain, colors, seen.forward, own, camera.width, float(sigma_color),
        float(sigma_depth), cutoff, floor,
    )  # fmt: skip
    total = np.zeros((n_own, 9))
    total[seen.index[own]] = rows[own]
    return torch.from_numpy(total).to(joint.means)


def gram(
    joint: SplatMap, n_own: int, camera: Camera, pose: Pose, sigma_color: float, sigma_depth: float,
    cutoff: float = CUTOFF, floor: float = FLOOR,
) -> tuple[Tensor, ...]:  # fmt: skip
    """What `information.blocks` is made of, as `tiles.gram` gives it; features are 1, δ and δ², times the blend."""
    seen = project(joint, camera, pose)
    colors = joint.colors.detach().double().numpy()[seen.index]
    values = np.concatenate([colors / float(sigma_color), seen.depth[:, None] / float(sigma_depth)], 1)
    own = seen.index < n_own
    sums = grams.row_moments(*seen.shape(), values, camera.width, float(cutoff), float(floor))[own]
    var, slopes = seen.var[own, None], seen.chain[own]
    chain = np.zeros((len(sums), 3, 6))
    chain[:, 0, 5] = 1 - seen.opacity[own]
    chain[:, 1, :2] = slopes[:, :2] / var
    chain[:, 2, :5] = 0.5 * slopes[:, 2:] / var**2
    powers = np.add.outer(np.arange(3), np.arange(3))
    parts = seen.index[own], sums[:, powers], chain, sums[:, 5:-1].reshape(-1, 4, 3), sums[:, -1]
    return tuple(torch.from_numpy(np.ascontiguousarray(part)) for part in parts)


def densities(
    joint: SplatMap, camera: Camera, position: ArrayLike, worth: Tensor, slants: np.ndarray, columns: int,
    sigma_color: float, sigma_depth: float, cutoff: float = CUTOFF,
) -> np.ndarray:  # fmt: skip
    """What a pixel would gain in every direction, for each of some places in the image: (4, slants, columns).

    worth (n, 9): v / (H + λ), 0 for splats that only occlude. slants: tan φ of the places. Columns and the four
    densities are the kernel's; any precision and device comes in, float64 comes out.
    """
    pose = geometry.yaw_pose(torch.as_tensor(position).detach().double().cpu(), 0.0)
    seen = project(joint, camera, pose, around=True)
    colors = joint.colors.detach().double().cpu().numpy()[seen.index]
    relative = joint.means.detach().double().cpu().numpy()[seen.index] - pose.position.numpy()
    splats = seen.var, seen.opacity, relative, seen.chain, colors, worth.detach().double().cpu().numpy()[seen.index]
    limit, noise = EDGE * camera.width / 2 / camera.focal, (float(sigma_color), float(sigma_depth))
    steps = (np.arange(columns) + 0.5) * 2 * math.pi / columns - math.pi
    compass = np.stack([np.sin(steps), np.cos(steps)], 1)
    places = [(float(slant), LOW_PASS / (1 + slant**2) ** 2, limit, NEAR) for slant in slants]
    parts = [row.densities(compass, *splats, camera.focal, *place, *noise, cutoff) for place in places]
    return np.stack(parts).transpose(2, 0, 1)
