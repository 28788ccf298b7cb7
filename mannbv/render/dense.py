"""The readable renderer: every splat against every pixel, in plain torch, for both dimensions.

Differentiable twice, on any device and in any precision; what a faster kernel is checked against.
"""

from dataclasses import dataclass, fields

import torch
from torch import Tensor

from mannbv import geometry
from mannbv.camera import LOW_PASS, NEAR, Camera
from mannbv.geometry import Pose
from mannbv.render.limits import MAX_BLEND, refuse
from mannbv.splats import SplatMap

_REACH = 13.0  # standard deviations past which exp(−x²/2) vanishes even in float32


@dataclass(frozen=True)
class Rendering:
    """An image: color (…, 3), depth (…) along the camera's axis [m], opacity (…); row-major."""

    color: Tensor
    depth: Tensor
    opacity: Tensor


@dataclass(frozen=True)
class Composite:
    """The v splats that touch an image of P pixels, front to back, and what Eq. (1) makes of them.

    index (v,): their rows in the map. local (v, d): means in the camera's frame [m]. jacobian (v, m, d) [px/m].
    pull (v, P, m): Σ_I⁻¹ Δ [1/px]. blend ρ, transmittance Π(1 − ρ), weight ρ Π(1 − ρ): (v, P).
    free (v, P): where ρ is below its cap, so that it still responds to the splat.
    """

    index: Tensor
    local: Tensor
    jacobian: Tensor
    pull: Tensor
    blend: Tensor
    transmittance: Tensor
    weight: Tensor
    free: Tensor

    def narrow(self, rows: Tensor) -> "Composite":
        """Only some of the splats; what they were composited with stays in the numbers."""
        return Composite(*(getattr(self, f.name)[rows] for f in fields(self)))


def _image_covariance(splat_map: SplatMap, jacobian: Tensor, pose: Pose) -> Tensor:
    """Σ_I = J Rᵀ Σ R Jᵀ + low pass [px²], (n, m, m)."""
    spread = jacobian @ pose.rotation.T @ geometry.rotation_matrices(splat_map.rotations) * splat_map.scales[:, None]
    return spread @ spread.transpose(-1, -2) + LOW_PASS * torch.eye(jacobian.shape[1]).to(jacobian)


@torch.no_grad()
def _front_to_back(splat_map: SplatMap, camera: Camera, pose: Pose) -> Tensor:
    """Rows of the splats that can touch the image, by range (which, unlike depth, does not change with the yaw)."""
    local = pose.local(splat_map.means)
    index = torch.nonzero(local[:, -1] > NEAR)[:, 0]
    if len(index):
        center, jacobian = camera.project(local[index])
        covariance = _image_covariance(splat_map.select(index), jacobian, pose)
        reach = _REACH * torch.diagonal(covariance, dim1=-2, dim2=-1).sqrt()
        half = torch.tensor(camera.size).to(center) / 2
        index = index[((center - half).abs() - half <= reach).all(1)]
    distance = torch.linalg.norm(local[index], dim=1)
    return index[torch.argsort(distance, stable=True)]


def check(splat_map: SplatMap, camera: Camera, pose: Pose) -> None:
    """Raises ValueError if map, camera and pose disagree about the dimension."""
    if not splat_map.dim == pose.dim == len(camera.size) + 1:
        raise ValueError(
            f"render: a {splat_map.dim}-D map, a {pose.dim}-D pose and a {len(camera.size)}-axis image do not fit; "
            "flatland cameras have height None"
        )


def compose(splat_map: SplatMap, camera: Camera, pose: Pose) -> Composite:
    """Project the splats and composite them along every pixel's ray. Raises ValueError for what cannot be drawn."""
    check(splat_map, camera, pose)
    refuse(splat_map)
    pose = pose.to(splat_map.means)
    index = _front_to_back(splat_map, camera, pose)
    seen = splat_map.select(index)
    local = pose.local(seen.means)
    center, jacobian = camera.project(local)
    inverse = geometry.small_inverse(_image_covariance(seen, jacobian, pose))
    offset = camera.pixels(local) - center[:, None]
    pull = torch.einsum("vij,vpj->vpi", inverse, offset)
    raw = seen.opacities[:, None] * torch.exp(-0.5 * (pull * offset).sum(-1))
    blend = raw.clamp(max=MAX_BLEND)
    through = torch.cumprod(1 - blend, 0)
    transmittance = torch.cat([torch.ones_like(through[:1]), through[:-1]])
    return Composite(index, local, jacobian, pull, blend, transmittance, blend * transmittance, raw <= MAX_BLEND)


def render(splat_map: SplatMap, camera: Camera, pose: Pose) -> Rendering:
    """Eq. (1) by the dense reference."""
    drawn = compose(splat_map, camera, pose)
    shape = camera.shape
    color = drawn.weight.T @ splat_map.colors[drawn.index]
    depth = drawn.weight.T @ drawn.local[:, -1]
    return Rendering(color.reshape(*shape, 3), depth.reshape(shape), drawn.weight.sum(0).reshape(shape))
