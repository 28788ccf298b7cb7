"""What the team maximises: central, per-owner, local and team gains, Eqs. (17)-(24)."""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import ArrayLike
from torch import Tensor

from mannbv import consensus, information, mask, risk, splats
from mannbv.belief import Belief, gain_options, profile, shown
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.geometry import Pose
from mannbv.information import YawProfile

_DEFAULT = Config()


@dataclass(frozen=True)
class Zone:
    """A trajectory's mask on one map: risk α (k,) and radius (k,) of the waypoints [m], selected (n,), weights (n,)."""

    risk: Tensor
    radii: Tensor
    selected: Tensor
    weights: Tensor


def zone(belief: Belief, path: np.ndarray, config: Config) -> Zone:
    """Π of a trajectory (k, d) [m] on one robot's map, Eqs. (9)-(13)."""
    points = torch.from_numpy(np.asarray(path, float)).to(belief.splats.means)
    alpha = risk.along(belief.splats, points, config)
    radii = mask.radius(alpha, config.r_min, config.beta1, config.beta2, config.r_max)
    selected = mask.zone(belief.splats, points, radii)
    weights = torch.zeros(len(selected)).to(belief.splats.means)
    if bool(selected.any()):
        chosen = belief.splats.select(selected)
        reach = config.gamma1, config.gamma2, config.r_max
        weights[selected] = mask.proximity(chosen, points, belief.ground, *reach)
    return Zone(alpha, radii, selected, weights)


def served(belief: Belief, camera: Camera, position: np.ndarray, path: np.ndarray, config: Config) -> YawProfile | None:
    """I(T_k; Π_{P_k}|G_i; G_i) of every yaw of robot k at `position` (d,), Eq. (23): what robot i serves robot k.

    None where the trajectory is empty or no splat of this map lies near it: the gain is then 0.
    """
    if not len(path):
        return None
    here = zone(belief, path, config)
    if not bool((here.weights > 0).any()):
        return None
    return profile(belief, camera, position, config, here.weights, here.selected)


def local(
    belief: Belief, camera: Camera, positions: list[np.ndarray], paths: list[np.ndarray], config: Config
) -> np.ndarray:
    """F_i as gains (N, M) of each robot's view on M uniform yaws, in one robot's map: the rows of Eq. (24)."""
    rows = np.zeros((len(paths), config.n_yaws))
    for k, (position, path) in enumerate(zip(positions, paths, strict=True)):
        profile = served(belief, camera, position, path, config)
        if profile is not None:
            rows[k] = profile.gains
    return rows


def gradient(belief: Belief, camera: Camera, pose: Pose, path: np.ndarray, config: Config) -> Float[Tensor, " t"]:
    """∂I(T; Π_P|G_i; G_i)/∂T of one view, (d + d(d−1)/2,) in the twist of `Pose.moved`, which Section V-B returns.

    Exact up to `dense_gradient` splats times pixels; beyond, `information.slopes` of the kernels, some percent off.
    """
    here, view = zone(belief, path, config), (belief.splats, camera, pose, belief.prior)
    options = gain_options(belief, config, here.weights, here.selected)
    if belief.splats.n_splats * math.prod(camera.shape) <= config.dense_gradient:
        return information.gain_and_gradient(*view, noise=config.noise, **options)[1]
    return information.slopes(*view, information.directions(pose, "pose"), noise=config.noise, **options)


def per_owner(
    beliefs: list[Belief], zones: list[Zone], camera: Camera, pose: Pose, config: Config, joint_rendering: bool = False
) -> Float[Tensor, " robots"]:
    """The N terms I(T; Π; G_j) of one view, Eq. (19), each on its owner's block of splats.

    The paper's definition renders each block alone; with `joint_rendering` it is a block of one rendering of all,
    where teammates' splats occlude. Their sum is the central gain (18) or the distributed one (21), by the zones given.
    """
    terms = []
    for j, (belief, here) in enumerate(zip(beliefs, zones, strict=True)):
        rest = [b.splats for k, b in enumerate(beliefs) if k != j] if joint_rendering else []
        acquired = shown(belief, camera, pose, config, splats.union(*rest) if rest else None)
        options = gain_options(belief, config, here.weights, here.selected)
        terms.append(information.gain(acquired, belief.prior, **options))
    return torch.stack(terms)


def pooled(beliefs: list[Belief], config: Config = _DEFAULT) -> Belief:
    """The central map (16), its information block by block, and the ground that the team knows together."""
    grounds = [b.ground for b in beliefs if b.ground is not None]
    ground = grounds[0].merged(*grounds[1:], config=config) if grounds else None
    return Belief(splats.union(*(b.splats for b in beliefs)), torch.cat([b.prior for b in beliefs]), ground)


def central_zones(beliefs: list[Belief], path: np.ndarray, config: Config) -> list[Zone]:
    """Π_{P}|G_cent ∩ G_j for every owner j: the central map's mask and weights, cut into the owners' blocks (17)."""
    whole = zone(pooled(beliefs, config), path, config)
    sizes = [b.splats.n_splats for b in beliefs]
    blocks = zip(whole.selected.split(sizes), whole.weights.split(sizes), strict=True)
    return [Zone(whole.risk, whole.radii, selected, weights) for selected, weights in blocks]


def lower_bound(
    beliefs: list[Belief],
    camera: Camera,
    pose: Pose,
    path: np.ndarray,
    config: Config,
    joint_rendering: bool = False,
    joint_priors: list[Tensor] | None = None,
    own_weights: bool = False,
) -> tuple[float, float]:
    """Both sides of Lemma 1 for one view: (I_dist, Eq. (21); I_cent, Eq. (18)).

    By the paper's definition each block is rendered alone, keeps its owner's prior, and weights come from one common
    grid. Central variants: `joint_rendering`; `joint_priors`, every block's information from all robots' views.
    `own_weights`: robot j weighs with its own grid instead of the common one.
    """
    common = pooled(beliefs, config).ground
    local = beliefs if own_weights else [dataclasses.replace(b, ground=common) for b in beliefs]
    distributed = per_owner(local, [zone(b, path, config) for b in local], camera, pose, config)
    blocks = beliefs
    if joint_priors is not None:
        views = sum(b.views for b in beliefs)
        blocks = [dataclasses.replace(b, prior=p, views=views) for b, p in zip(beliefs, joint_priors, strict=True)]
    central = per_owner(blocks, central_zones(beliefs, path, config), camera, pose, config, joint_rendering)
    return distributed.sum().item(), central.sum().item()


def team(gains: np.ndarray, yaws: ArrayLike) -> float:
    """The team's objective, Eq. (24): Σ_k Σ_i f_ik(ψ_k), from tables (N, N, M) on uniform yaws, linear in between."""
    return consensus.value(gains, yaws)


def best(gains: np.ndarray) -> float:
    """The largest value that `team` takes at any yaws: each robot k at the best node of Σ_i f_ik."""
    return float(gains.sum(0).max(1).sum())
