"""Fisher information of a view, exactly: the diagonal or the splats' blocks of JᵀJ; and of past views, Eqs. (3)-(5)."""

from collections.abc import Sequence

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


def _prepared(splat_map: SplatMap, camera: Camera, pose: Pose, others, method: str, sigma_color, sigma_depth):
    """What is rendered, and the kernel that does it (None: the dense twin). Raises ValueError for what cannot be."""
    render.check(splat_map, camera, pose)
    if not (sigma_color > 0 and sigma_depth > 0):
        raise ValueError(f"fisher: sigma_color and sigma_depth must be positive, got {sigma_color}, {sigma_depth}")
    joint = splat_map if others is None else splats.union(splat_map, others)
    asked = *joint.tensors(), pose.rotation, pose.position
    return joint, render.engine(method, joint, *(t for t in asked if torch.is_grad_enabled()))


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
    joint, kernel = _prepared(splat_map, camera, pose, others, method, sigma_color, sigma_depth)
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


def blocks(
    splat_map: SplatMap,
    camera: Camera,
    pose: Pose,
    others: SplatMap | None = None,
    method: str = "auto",
    sigma_color: float = _DEFAULT.sigma_color,
    sigma_depth: float = _DEFAULT.sigma_depth,
) -> Float[Tensor, "n p p"]:
    """Block Fisher information of one RGB-D view: each splat's own p × p block of JᵀJ, whose diagonal is `fisher`.

    Arguments as in `fisher`. A block knows what one view cannot tell apart (a splat's depth from its size, its opacity
    from its colour), and turning the world turns it along, so that a gain made of blocks stays as it was.
    """
    joint, kernel = _prepared(splat_map, camera, pose, others, method, sigma_color, sigma_depth)
    render_gram = _dense_gram if kernel is None else kernel.gram
    index, gram, chain, cross, seen = render_gram(joint, splat_map.n_splats, camera, pose, sigma_color, sigma_depth)
    forward = pose.rotation[:, -1].to(chain) / sigma_depth  # ∂depth/∂mean, over its noise
    v, d, g = len(index), joint.dim, chain.shape[-1]
    shape = chain.transpose(1, 2) @ gram @ chain
    with_value = cross @ chain  # (v, 4, g): with each colour, and with depth
    ahead = torch.cat([forward, torch.zeros(g - d).to(forward)])  # … by the parameters of the shape
    shape = shape + with_value[:, 3, :, None] * ahead + ahead[:, None] * with_value[:, 3, None, :]
    shape = shape + seen[:, None, None] * ahead[:, None] * ahead
    tint = with_value[:, :3] / sigma_color
    plain = (seen / sigma_color**2)[:, None, None] * torch.eye(3).to(chain)
    rows = torch.cat([torch.cat([shape, tint.transpose(1, 2)], 2), torch.cat([tint, plain], 2)], 1)
    whole = torch.zeros(splat_map.n_splats, g + 3, g + 3).to(joint.means)
    return whole.index_copy(0, index, rows.reshape(v, g + 3, g + 3).to(whole))


def _dense_gram(joint: SplatMap, n_own: int, camera: Camera, pose: Pose, sigma_color, sigma_depth):
    """Of the v splats seen that count: index (v,), Gram matrices of their features over pixels and channels (v, K, K),
    chain (v, K, g), Σ lift · weight · features of each channel (v, 4, K), and Σ weight² (v,); lifts are over the noise.
    """
    drawn = render.compose(joint, camera, pose)
    counts = torch.nonzero(drawn.index < n_own)[:, 0]
    values = torch.cat([joint.colors[drawn.index] / sigma_color, drawn.local[:, -1:] / sigma_depth], 1)
    lift = _lift(drawn, values)[:, counts]
    drawn = drawn.narrow(counts)
    features, chain = _response(joint, camera, pose.to(joint.means), drawn)
    gram = torch.einsum("vp,vpk,vpl->vkl", (lift**2).sum(0), features, features)
    cross = torch.einsum("cvp,vpk->vck", lift * drawn.weight, features)
    return drawn.index, gram, chain, cross, (drawn.weight**2).sum(1)


def prior(
    splat_map: SplatMap, camera: Camera, poses: Sequence[Pose], block: bool = False, others: SplatMap | None = None,
    method: str = "auto", sigma_color: float = _DEFAULT.sigma_color, sigma_depth: float = _DEFAULT.sigma_depth,
) -> Float[Tensor, "n p"] | Float[Tensor, "n p p"]:  # fmt: skip
    """Information of the past views `poses` about today's map: Σ fisher, or Σ blocks; the rest as in `fisher`."""
    p = n_parameters(splat_map.dim)
    total = torch.zeros(splat_map.n_splats, *([p] * (1 + block))).to(splat_map.means)
    for pose in poses:
        shown = (blocks if block else fisher)(splat_map, camera, pose, others, method, sigma_color, sigma_depth)
        total = total + shown
    return total
