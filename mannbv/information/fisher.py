"""Fisher information of a view, exactly diag(JᵀJ), and of all past views, Eqs. (3)-(5)."""

import torch
from jaxtyping import Float
from torch import Tensor

from mannbv import geometry, render, splats
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.geometry import Pose
from mannbv.splats import SplatMap

_DEFAULT = Config()


def n_parameters(dim: int) -> int:
    """Fisher parameters of one splat: 9 in flatland, 13 in 3-D."""
    return 2 * dim + dim * (dim - 1) // 2 + 4


def _lift(drawn: render.Composite, values: Float[Tensor, "v c"]) -> Float[Tensor, "c v p"]:
    """∂(Σ values · weight)/∂ρ of each splat at each pixel: what shows through it less what lies behind."""
    shares = drawn.weight * values.T[:, :, None]
    behind = torch.cumsum(shares.flip(1), 1).flip(1) - shares
    return drawn.transmittance * values.T[:, :, None] - behind / (1 - drawn.blend)


def _response(splat_map: SplatMap, camera: Camera, pose: Pose, drawn: render.Composite):
    """How pixels answer to the v drawn splats through K image quantities: position (m), covariance (m²), logit (1).

    Returns features (v, P, K) = ∂ρ/∂quantity and chain (v, K, g) = ∂quantity/∂(mean, log-scale, rotation, logit).
    """
    seen = splat_map.select(drawn.index)
    outer = 0.5 * drawn.pull[..., :, None] * drawn.pull[..., None, :]
    logit = (1 - seen.opacities)[:, None, None].expand(-1, drawn.blend.shape[1], 1)
    active = torch.where(drawn.free, drawn.blend, 0.0)[..., None]
    features = active * torch.cat([drawn.pull, outer.flatten(-2), logit], -1)

    to_image = drawn.jacobian @ pose.rotation.T  # (v, m, d), from world
    center_slope, jacobian_slope = camera.differentials(drawn.local)
    # mean: through the centre, and through the Jacobian that carries Σ into the image
    center_mean = center_slope @ pose.rotation.T
    image_slope = torch.einsum("vmak,da,ek->vmde", jacobian_slope, pose.rotation, pose.rotation)
    half = torch.einsum("vmde,vdf,vnf->vmne", image_slope, seen.covariances(), to_image)
    axes = to_image @ geometry.rotation_matrices(seen.rotations)  # the splat's axes in the image
    squares = seen.scales**2
    scale = 2 * torch.einsum("vmi,vni,vi->vmni", axes, axes, squares)
    turn = torch.einsum("vmi,rij,vj,vnj->vmnr", axes, geometry.turn_generators(seen.dim).to(axes), squares, axes)
    covariance = torch.cat([half + half.transpose(1, 2), scale, turn + turn.transpose(1, 2)], -1)

    v, m, _, g = covariance.shape
    chain = torch.cat(
        [
            torch.cat([center_mean, torch.zeros(v, m, g - seen.dim + 1).to(axes)], -1),
            torch.cat([covariance.reshape(v, m * m, g), torch.zeros(v, m * m, 1).to(axes)], -1),
            torch.cat([torch.zeros(v, 1, g).to(axes), torch.ones(v, 1, 1).to(axes)], -1),
        ],
        1,
    )
    return features, chain


def fisher(
    splat_map: SplatMap,
    camera: Camera,
    pose: Pose,
    others: SplatMap | None = None,
    method: str = "auto",
    sigma_color: float = _DEFAULT.sigma_color,
    sigma_depth: float = _DEFAULT.sigma_depth,
) -> Float[Tensor, "n p"]:
    """Diagonal Fisher information of one RGB-D view, exactly diag(JᵀJ), Eqs. (3)-(5).

    Every channel of every pixel is one measurement with standard deviation `sigma_color` [1] or `sigma_depth` [m].
    `others` are rendered too (they occlude) but their parameters do not count. Differentiable in map and pose.

    A splat moves a pixel only through the few image quantities q = (position, covariance, logit, depth), so one
    small Gram matrix M = Σ_pixels g gᵀ a splat gives diag(JᵀJ) = diag(Aᵀ M A), A = ∂q/∂ω.
    """
    render.check(splat_map, camera, pose)
    if not (sigma_color > 0 and sigma_depth > 0):
        raise ValueError(f"fisher: sigma_color and sigma_depth must be positive, got {sigma_color}, {sigma_depth}")
    joint = splat_map if others is None else splats.union(splat_map, others)
    asked = *joint.tensors(), pose.rotation, pose.position
    kernel = render.engine(method, joint, *(t for t in asked if torch.is_grad_enabled()))
    if kernel is not None:
        return kernel.fisher(joint, splat_map.n_splats, camera, pose, sigma_color, sigma_depth)
    pose = pose.to(joint.means)
    drawn = render.compose(joint, camera, pose)
    counts = torch.nonzero(drawn.index < splat_map.n_splats)[:, 0]
    color = _lift(drawn, joint.colors[drawn.index])[:, counts] / sigma_color
    depth = _lift(drawn, drawn.local[:, -1:])[0, counts] / sigma_depth
    drawn = drawn.narrow(counts)
    features, chain = _response(joint, camera, pose, drawn)
    energy = (color**2).sum(0) + depth**2
    gram = torch.einsum("vp,vpk,vpl->vkl", energy, features, features)
    cross = torch.einsum("vp,vpk->vk", depth * drawn.weight / sigma_depth, features)
    seen = (drawn.weight**2).sum(1)

    shape = torch.einsum("vka,vkl,vla->va", chain, gram, chain)
    forward = pose.rotation[:, -1]  # ∂depth/∂mean
    mean = 2 * forward * torch.einsum("vka,vk->va", chain[..., : joint.dim], cross)
    mean = mean + (seen / sigma_depth**2)[:, None] * forward**2
    rows = torch.cat(
        [shape[:, : joint.dim] + mean, shape[:, joint.dim :], (seen / sigma_color**2)[:, None].expand(-1, 3)], 1
    )
    return torch.zeros(splat_map.n_splats, rows.shape[1]).to(rows).index_copy(0, drawn.index, rows)


def prior(splat_map: SplatMap, camera: Camera, poses: list[Pose], **noise) -> Float[Tensor, "n p"]:
    """Information of the past views `poses` about today's map: Σ fisher. `noise` as in `fisher`."""
    total = torch.zeros(splat_map.n_splats, n_parameters(splat_map.dim)).to(splat_map.means)
    for pose in poses:
        total = total + fisher(splat_map, camera, pose, **noise)
    return total
