"""The fast renderer of space: numba tiles behind torch, with gradients for every splat parameter and exact information.

The dense reference is its twin. Blends under the cut-off 1/255 are dropped and a pixel ends at transmittance 1e-4.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from mannbv.camera import EDGE, LOW_PASS, NEAR, Camera
from mannbv.geometry import Pose
from mannbv.kernels.space import blend, gather, projection, tiles
from mannbv.kernels.space import gram as grams
from mannbv.render.limits import CUTOFF, FLOOR, refuse
from mannbv.splats import SplatMap


@dataclass(frozen=True)
class Sorted:
    """A map before a camera: its arrays, the k splats that touch the image (front to back), and their tiles.

    parts: what `projection.response` needs beside a splat. index (k,): rows of the map. splats (k, COLUMNS): see there.
    pairs, tiles, places, starts: see `tiles.sort`. order: the tiles, the longest first.
    """

    parts: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    index: np.ndarray
    splats: np.ndarray
    pairs: np.ndarray
    tiles: np.ndarray
    places: np.ndarray
    starts: np.ndarray
    order: np.ndarray


def serves(splat_map: SplatMap, *others: Tensor) -> bool:
    """Whether the kernel applies: space, float32, on the CPU, and no gradient asked of the other tensors."""
    means = splat_map.means
    plain = means.dtype == torch.float32 and means.device.type == "cpu"
    return splat_map.dim == 3 and plain and not any(t.requires_grad for t in others)


def array(tensor: Tensor, like: Tensor) -> np.ndarray:
    """The numbers of a tensor, in the precision of another and without holes, for a kernel."""
    return np.ascontiguousarray(tensor.detach().to(like).numpy())


def sort(splat_map: SplatMap, camera: Camera, pose: Pose, cutoff: float = CUTOFF) -> Sorted:
    """Project the splats, order them by range, and deal them out to tiles."""
    refuse(splat_map)
    like = splat_map.means
    means, log_scales, rotations, logits, _ = (array(part, like) for part in splat_map.tensors())
    dtype = means.dtype
    rotation, position = array(pose.rotation, like), array(pose.position, like)
    size = np.array(camera.size, dtype)
    lens = np.array([camera.focal, *(EDGE * n / 2 / camera.focal for n in camera.size)], dtype)
    image = projection.project(
        means, log_scales, rotations, logits, rotation, position, lens, size, dtype.type(NEAR), dtype.type(LOW_PASS),
        dtype.type(cutoff),
    )  # fmt: skip
    index = np.flatnonzero(image[:, projection.REACH] > 0)
    index = index[by_range(image[index, projection.FAR])]
    splats = image[index]
    pairs, starts_of_tiles, places, starts = tiles.sort(splats, *camera.size)
    order = np.argsort(-np.diff(starts_of_tiles), kind="stable")
    parts = means, log_scales, rotations, rotation, position, lens
    return Sorted(parts, index, splats, pairs, starts_of_tiles, places, starts, order)


def by_range(far: np.ndarray) -> np.ndarray:
    """The order of squared ranges, equal ones as they come."""
    if far.dtype != np.float32:
        return np.argsort(far, kind="stable")
    # positive floats sort as their bits do: one plain sort of (range, place), much faster than a stable argsort
    keys = far.view(np.uint32).astype(np.uint64) << np.uint64(32) | np.arange(len(far), dtype=np.uint64)
    keys.sort()
    return (keys & np.uint64(0xFFFFFFFF)).astype(np.int64)


def _values(sorted_: Sorted, colors: np.ndarray, sigma_color=1.0, sigma_depth=1.0) -> np.ndarray:
    depth = sorted_.splats[:, projection.DEPTH : projection.DEPTH + 1]
    values = np.concatenate([colors[sorted_.index] / sigma_color, depth / sigma_depth], 1)
    return values.astype(depth.dtype)


class _Render(torch.autograd.Function):
    """colour, depth and opacity in one array (5, H, W)."""

    @staticmethod
    def forward(ctx, means, log_scales, rotations, logits, colors, camera, pose, cutoff, floor):
        seen = sort(SplatMap(means, log_scales, rotations, logits, colors), camera, pose, cutoff)
        values = _values(seen, colors.detach().numpy())
        floor = values.dtype.type(floor)
        image, full, spans = blend.composite(
            seen.splats, values, seen.pairs, seen.tiles, seen.order, camera.width, camera.height, floor
        )
        ctx.save_for_backward(rotations, means, log_scales, logits, colors)  # the kernel reads their memory
        ctx.kept = seen, values, full, spans, image, floor
        shown = image.copy()
        shown[-1] = 1 - shown[-1]
        return torch.from_numpy(shown)

    @staticmethod
    @once_differentiable
    def backward(ctx, *grad_outputs):  # pyright: ignore[reportIncompatibleMethodOverride]  the decorator has no type
        rotations, *_ = ctx.saved_tensors  # raises if one was changed in place since
        seen, values, full, spans, image, floor = ctx.kept
        slopes = np.ascontiguousarray(grad_outputs[0].numpy())
        sums = blend.backward(
            seen.splats, values, seen.pairs, seen.tiles, full, spans, seen.order, image, slopes, floor
        )
        grads = torch.from_numpy(gather.gradient(sums, seen.places, seen.starts, seen.index, seen.splats, *seen.parts))
        mean, scale, turn, logit, color = grads.split([3, 3, 3, 1, 3], 1)
        return mean, scale, _quaternion_slope(rotations, turn), logit[:, 0], color, None, None, None, None


def _quaternion_slope(quaternions: Tensor, turn: Tensor) -> Tensor:
    """The gradient (n, 4) by quaternions of any length from the one (n, 3) by turns about the body's axes."""
    w, x, y, z = quaternions.unbind(1)
    body = torch.stack([-x, -y, -z, w, -z, y, z, w, -x, -y, x, w], 1).reshape(-1, 4, 3)
    return 2 * (body @ turn[:, :, None])[:, :, 0] / (quaternions**2).sum(1, keepdim=True)


def render(splat_map: SplatMap, camera: Camera, pose: Pose, cutoff: float = CUTOFF, floor: float = FLOOR) -> Tensor:
    """colour, depth and opacity as (5, H, W)."""
    return _Render.apply(*splat_map.tensors(), camera, pose, cutoff, floor)


def fisher(
    joint: SplatMap, n_own: int, camera: Camera, pose: Pose, sigma_color: float, sigma_depth: float,
    cutoff: float = CUTOFF, floor: float = FLOOR,
) -> Tensor:  # fmt: skip
    """diag(JᵀJ) (n_own, 13) of the first `n_own` splats; the others only occlude."""
    seen = sort(joint, camera, pose, cutoff)
    values = _values(seen, joint.colors.detach().numpy(), sigma_color, sigma_depth)
    floor = values.dtype.type(floor)
    common = seen.splats, values, seen.pairs, seen.tiles
    image, full, spans = blend.composite(*common, seen.order, camera.width, camera.height, floor)
    table = blend.moments(*common, full, spans, seen.order, image, seen.index < n_own, floor)
    noise = values.dtype.type(sigma_color), values.dtype.type(sigma_depth)
    rows = gather.information(table, seen.places, seen.starts, seen.index, seen.splats, n_own, *seen.parts, *noise)
    return torch.from_numpy(rows)


def gram(
    joint: SplatMap, n_own: int, camera: Camera, pose: Pose, sigma_color: float, sigma_depth: float,
    cutoff: float = CUTOFF, floor: float = FLOOR,
) -> tuple[Tensor, ...]:  # fmt: skip
    """What `information.blocks` is made of: index (c,) of the splats seen among the first `n_own`; of each the Gram
    matrix of its features (6, 6), their chain (6, 10), Σ lift · weight · feature of each channel (4, 6), and Σ weight².

    Features are the monomials of `space`, times the blend; lifts are over the noise.
    """
    seen = sort(joint, camera, pose, cutoff)
    values = _values(seen, joint.colors.detach().numpy(), sigma_color, sigma_depth)
    floor = values.dtype.type(floor)
    common = seen.splats, values, seen.pairs, seen.tiles
    image, full, spans = blend.composite(*common, seen.order, camera.width, camera.height, floor)
    common = *common, full, spans, seen.order, image, seen.index < n_own, floor
    chosen = np.flatnonzero(seen.index < n_own)
    sums, terms = grams.totals(
        blend.moments(*common), grams.crosses(*common), seen.places, seen.starts, seen.index, chosen, seen.splats,
        *seen.parts,
    )  # fmt: skip
    depth = sums[:, None, 15 : 15 + projection.TERMS]
    cross = np.concatenate([sums[:, blend.MOMENTS :].reshape(-1, 3, projection.TERMS), depth], 1)
    parts = seen.index[chosen], sums[:, gather.GRAM], terms.transpose(0, 2, 1), cross, sums[:, blend.MOMENTS - 1]
    return tuple(torch.from_numpy(np.ascontiguousarray(part)) for part in parts)
