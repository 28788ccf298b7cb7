"""What a view tells about the splats: Fisher information, its prior, and the gain, Eqs. (3)-(5), (14), (15).

Parameters per splat, in the world frame: mean (d), log-scale (d), rotation in the body's tangent space (d(d−1)/2),
opacity logit (1), colour (3): 9 in flatland, 13 in 3-D.
"""

import functools
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.sparse import csr_array
from torch import Tensor

from mannbv import geometry, render, splats
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.geometry import Pose
from mannbv.render import row
from mannbv.splats import SplatMap

_DEFAULT = Config()
_OVERSAMPLING = 4  # directions for each pixel on the axis
_PLACES = 5  # in the image


def n_parameters(dim: int) -> int:
    """Fisher parameters of one splat: 9 in flatland, 13 in 3-D."""
    return 2 * dim + dim * (dim - 1) // 2 + 4


def damping(dim: int, config: Config = _DEFAULT) -> Float[Tensor, " p"]:
    """λ per parameter: what is known of it before any view, 1 / std² in the parameter's own units."""
    groups = [config.damping_mean] * dim + [config.damping_scale] * dim
    groups += [config.damping_rotation] * (dim * (dim - 1) // 2) + [config.damping_opacity]
    return torch.tensor(groups + [config.damping_color] * 3)


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
    joint = splat_map if others is None else splats.union(splat_map, others)
    asked = *joint.tensors(), pose.rotation, pose.position
    if render.tiled(method, joint, *(t for t in asked if torch.is_grad_enabled())):
        return row.fisher(joint, splat_map.n_splats, camera, pose, sigma_color, sigma_depth)
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


def _precision(prior: Tensor, weights, selected, damping) -> Tensor:
    """v / (H + λ) for every parameter (n, p), zero outside the selection."""
    if damping is None:
        damping = globals()["damping"]({9: 2, 13: 3}[prior.shape[1]])
    worth = torch.ones(len(prior)).to(prior) if weights is None else torch.as_tensor(weights).to(prior)
    if selected is not None:
        worth = torch.where(torch.as_tensor(selected, device=prior.device), worth, 0.0)
    denominator = prior + torch.as_tensor(damping).to(prior)
    if not bool((denominator > 0).all()):
        raise ValueError("gain: prior + damping must be positive; give a damping above 0 for splats never seen")
    return worth[:, None] / denominator


def gain(
    acquired: Float[Tensor, "n p"],
    prior: Float[Tensor, "n p"],
    weights: Float[Tensor, " n"] | None = None,
    selected: Bool[Tensor, " n"] | None = None,
    damping=None,
    weigh_prior: bool = False,
    literal_views: int | None = None,
) -> Float[Tensor, ""]:
    """Expected information gain tr(H″ H″_prior⁻¹), Eqs. (5) and (15): Σ v · h / (H + λ) over the selected splats.

    acquired, prior: `fisher` of the new view and of all past ones. weights v: Eq. (13), on the acquired information
    only. selected: the masked zone, Eq. (11). damping λ: number or (p,), by default one value a parameter group.
    The paper's literal forms: `weigh_prior` puts V̄ on the prior too, as Eqs. (14)-(15) do, where it cancels;
    `literal_views` = number of past views adds λI to the new view and to each of those, as Section III-B does.
    """
    if acquired.shape != prior.shape:
        raise ValueError(f"gain: acquired {tuple(acquired.shape)} and prior {tuple(prior.shape)} must match")
    if damping is None:
        damping = globals()["damping"]({9: 2, 13: 3}[prior.shape[1]])
    damping = torch.as_tensor(damping).to(prior)
    if literal_views is not None:
        acquired, prior = acquired + damping, prior + (literal_views - 1) * damping
    if weigh_prior and weights is not None:
        weights = torch.where(weights > 0, weights / weights.clamp_min(1e-300), 0.0)
    return (acquired * _precision(prior, weights, selected, damping)).sum()


def gain_and_slope(splat_map: SplatMap, camera: Camera, position, yaw: float, prior: Tensor, others=None, **options):
    """Gain of the view from `position` (d,) along `yaw` [rad], and its exact derivative [1/rad], as two floats.

    options: weights, selected, damping as in `gain`. The order of the splats by range does not change with the yaw,
    so the derivative is that of a smooth function, but for splats that enter at the near plane.
    """
    angle = torch.tensor(float(yaw), dtype=splat_map.means.dtype, requires_grad=True)
    view = geometry.yaw_pose(torch.as_tensor(position).to(splat_map.means), angle)
    value = gain(fisher(splat_map, camera, view, others), prior, **options)
    slope = torch.autograd.grad(value, angle)[0] if value.requires_grad else 0.0
    return value.item(), float(slope)


@dataclass(frozen=True)
class YawProfile:
    """The gain of every yaw at one position: gains (M,) at yaws (M,) = −π + 2π m / M [rad]."""

    yaws: np.ndarray
    gains: np.ndarray
    evaluate: Callable[[float], tuple[float, float]]

    @torch.no_grad()  # so that separate views take the renderer that `gains` took
    def gain_at(self, yaw: float) -> float:
        return self.evaluate(yaw)[0]

    def slope_at(self, yaw: float) -> float:
        """Derivative of the gain [1/rad]."""
        return self.evaluate(yaw)[1]

    @property
    def best(self) -> float:
        """The yaw of the largest gain [rad]."""
        return float(self.yaws[int(np.argmax(self.gains))])

    def leading(self, count: int = 8, apart: float = math.radians(0.9)) -> np.ndarray:
        """Up to `count` yaws of the largest gains, no two nearer than `apart` [rad]; the largest first."""
        chosen: list[float] = []
        for yaw in self.yaws[np.argsort(-self.gains, kind="stable")]:
            if all(abs(geometry.wrap(yaw - other)) >= apart for other in chosen):
                chosen.append(float(yaw))
            if len(chosen) == count:
                break
        return np.array(chosen)


def uniform_yaws(n: int) -> np.ndarray:
    """−π + 2π m / n, m = 0 … n − 1 [rad]."""
    return -math.pi + 2 * math.pi * np.arange(n) / n


def yaw_profile(
    splat_map: SplatMap,
    camera: Camera,
    position,
    prior: Float[Tensor, "n p"],
    weights: Float[Tensor, " n"] | None = None,
    selected: Bool[Tensor, " n"] | None = None,
    damping=None,
    n_yaws: int = _DEFAULT.n_yaws,
    others: SplatMap | None = None,
    method: str = "auto",
    sigma_color: float = _DEFAULT.sigma_color,
    sigma_depth: float = _DEFAULT.sigma_depth,
) -> YawProfile:
    """Gain (15) of all yaws at `position` (d,) [m]; arguments as in `fisher` and `gain`.

    method "views" takes one Fisher a yaw. "panorama" (flatland) looks once in all directions: the information density
    over direction, read at the pixels of every yaw. Depth along the camera's axis is linear in the axis, so three
    densities (xx, xy, yy) give the depth channel. A pinhole stretches what it sees towards the image's edge, hence
    densities for several places in the image. What is left to differ from separate views: the clamp of splats beside
    the image, the near plane. "auto": panorama in flatland, views in 3-D.
    """
    worth = _precision(prior, weights, selected, damping)
    noise = {"sigma_color": sigma_color, "sigma_depth": sigma_depth}
    if method not in ("auto", "panorama", "views") or (method == "panorama" and splat_map.dim != 2):
        raise ValueError(f"yaw_profile: method '{method}' does not serve {splat_map.dim}-D maps; use auto or views")
    yaws = uniform_yaws(n_yaws)
    if method == "views" or splat_map.dim != 2:

        def evaluate(yaw: float) -> tuple[float, float]:
            angle = torch.tensor(float(yaw), dtype=prior.dtype, requires_grad=True)
            view = geometry.yaw_pose(torch.as_tensor(position).to(prior), angle)
            value = (fisher(splat_map, camera, view, others, **noise) * worth).sum()
            slope = torch.autograd.grad(value, angle)[0] if value.requires_grad else 0.0
            return value.item(), float(slope)

        with torch.no_grad():
            gains = np.array([evaluate(yaw)[0] for yaw in yaws])
        return YawProfile(yaws, gains, evaluate)
    if others is not None:
        worth = torch.cat([worth, torch.zeros(others.n_splats, worth.shape[1]).to(worth)])
        splat_map = splats.union(splat_map, others)
    columns = math.ceil(_OVERSAMPLING * 2 * math.pi * camera.focal)
    slants = np.tan(_places(camera.fov))
    densities = row.densities(splat_map, camera, position, worth, slants, columns, sigma_color, sigma_depth)

    def evaluate(yaw: float) -> tuple[float, float]:
        pixels, rates = _pixels((camera.width, camera.focal), columns, np.array([float(yaw)]))
        turn, turn_rate = _axis_terms(np.array([float(yaw)]))
        seen = pixels @ densities
        return float((seen * turn).sum()), float((rates @ densities * turn + seen * turn_rate).sum())

    seen = _uniform_pixels((camera.width, camera.focal), columns, n_yaws) @ densities
    return YawProfile(yaws, (seen * _axis_terms(yaws)[0]).sum(1), evaluate)


def _axis_terms(yaw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What multiplies the four densities (colour, xx, xy, yy) of a camera along `yaw` (k,), and its slope: (k, 4)."""
    cos, sin, zero = np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)
    terms = np.stack([zero + 1, cos * cos, 2 * cos * sin, sin * sin], -1)
    slopes = np.stack([zero, -2 * cos * sin, 2 * (cos * cos - sin * sin), 2 * cos * sin], -1)
    return terms, slopes


def _places(fov: float) -> np.ndarray:
    """Angles to the axis [rad] of the places in an image for which densities are computed."""
    return np.linspace(-fov / 2, fov / 2, _PLACES)


def _pixels(camera_size: tuple[int, float], columns: int, yaw: np.ndarray) -> tuple[csr_array, csr_array]:
    """How the pixels of a pinhole (width, focal) along `yaw` (k,) read the densities, and the slope: (k, all columns).

    A pixel looks along its centre, between columns (cubic convolution, which has a slope everywhere), and between the
    places in the image (Lagrange), so that what a splat gains or loses by falling between two pixels is kept.
    """
    width, focal = camera_size
    right = np.arctan((np.arange(width) + 0.5 - width / 2) / focal)
    nodes = _places(2 * math.atan(width / 2 / focal))
    shares = np.ones((_PLACES, width))
    for a, b in itertools.permutations(range(_PLACES), 2):
        shares[a] *= (right - nodes[b]) / (nodes[a] - nodes[b])
    place = (right - yaw[:, None] + math.pi) * columns / (2 * math.pi) - 0.5
    low = np.floor(place)
    x = (place - low)[..., None] + np.array([1.0, 0.0, -1.0, -2.0])  # signed distance to the four columns around
    far = np.abs(x)
    near = far < 1
    read = np.where(near, 1.5 * far**3 - 2.5 * far**2 + 1, -0.5 * far**3 + 2.5 * far**2 - 4 * far + 2)
    rate = np.sign(x) * np.where(near, 4.5 * far**2 - 5 * far, -1.5 * far**2 + 5 * far - 4)
    column = (low[..., None].astype(np.int64) + np.array([-1, 0, 1, 2])) % columns
    rows = np.broadcast_to(np.arange(len(yaw))[:, None, None, None], (*place.shape, 4, _PLACES))
    cells = rows.ravel(), (column[..., None] + columns * np.arange(_PLACES)).ravel()

    def matrix(values: np.ndarray) -> csr_array:
        return csr_array(((values[..., None] * shares.T[:, None]).ravel(), cells), (len(yaw), _PLACES * columns))

    return matrix(read), matrix(-rate * columns / (2 * math.pi))


@functools.lru_cache(maxsize=4)
def _uniform_pixels(camera_size: tuple[int, float], columns: int, n_yaws: int) -> csr_array:
    """`_pixels` of uniform yaws: the same for every position, so kept."""
    return _pixels(camera_size, columns, uniform_yaws(n_yaws))[0]
