"""Where information matters: mask radius, masked zone, proximity weights, Eqs. (10)-(13)."""

import numpy as np
import torch
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike
from torch import Tensor

from mannbv import grid
from mannbv.config import Config
from mannbv.splats import SplatMap

_DEFAULT = Config()


def radius(
    risk: ArrayLike,
    r_min: float = _DEFAULT.r_min,
    beta1: float = _DEFAULT.beta1,
    beta2: float = _DEFAULT.beta2,
    r_max: float = _DEFAULT.r_max,
) -> Tensor:
    """r_mask = r_min + β₁ exp(−β₂ α) [m], Eq. (10), at most r_max: a safer waypoint gets a smaller mask.

    risk: α of the waypoints [m], number or tensor; +inf (an empty map) gives r_min. r_max: 0 for none, as in the paper.
    Raises ValueError unless r_min ≥ 0, β₁, β₂ > 0, and r_max is 0 or at least r_min.
    """
    if not (r_min >= 0 and beta1 > 0 and beta2 > 0):
        raise ValueError(f"mask: needs r_min ≥ 0 and β₁, β₂ > 0, got {r_min}, {beta1}, {beta2}")
    if not (r_max == 0 or r_max >= r_min):
        raise ValueError(f"mask: r_max must be at least r_min, or 0 for no bound, got {r_max} and {r_min}")
    return (r_min + beta1 * torch.exp(-beta2 * torch.as_tensor(risk))).clamp(max=r_max or np.inf)


def _waypoints(splat_map: SplatMap, path: ArrayLike) -> Float[Tensor, "k d"]:
    points = torch.as_tensor(path)
    points = points if len(points) else torch.zeros(0, splat_map.dim)
    if points.ndim != 2 or points.shape[1] != splat_map.dim:
        raise ValueError(f"mask: the path must be (k, {splat_map.dim}) beside this map, got {tuple(points.shape)}")
    return points


def zone(splat_map: SplatMap, path: ArrayLike, radii: ArrayLike) -> Bool[Tensor, " n"]:
    """Which splats' means lie in a ball B(p_k, r_k) around some waypoint, Eqs. (11), (12); path (k, d), radii (k,) [m].

    Raises ValueError if the two lengths differ, or for waypoints of another dimension.
    """
    points, reach = _waypoints(splat_map, path), torch.as_tensor(radii)
    if reach.shape != points.shape[:1]:
        raise ValueError(f"mask: {len(points)} waypoints but {reach.numel()} radii; give each its own")
    if not (len(points) and splat_map.n_splats):
        return torch.zeros(splat_map.n_splats, dtype=torch.bool)
    away = torch.linalg.norm(splat_map.means[:, None] - points.to(splat_map.means), dim=-1)
    return (away <= reach.to(splat_map.means)).any(1)


def proximity(
    splat_map: SplatMap,
    path: ArrayLike,
    occupancy: grid.Occupancy | None = None,
    gamma1: float = _DEFAULT.gamma1,
    gamma2: float = _DEFAULT.gamma2,
    limit: float = _DEFAULT.r_max,
) -> Float[Tensor, " n"]:
    """v(g) = γ₁ exp(−γ₂ ‖p − μ‖_g), Eq. (13), p the waypoint nearest along the graph.

    The graph distance [m] runs over known-free cells to the one nearest to the splat, on its side of a wall, then
    straight; a splat outside the grid is reached by way of the border cell next to it. Unknown and occupied cells
    block; a splat farther than `limit` [m] (0: none) or cut off gets weight 0. Without an occupancy: straight.
    """
    points = _waypoints(splat_map, path)
    if not (gamma1 > 0 and gamma2 >= 0):
        raise ValueError(f"mask: needs γ₁ > 0 and γ₂ ≥ 0, got {gamma1}, {gamma2}")
    if not (len(points) and splat_map.n_splats):
        return torch.zeros(splat_map.n_splats).to(splat_map.means)
    if occupancy is None:
        distance = torch.linalg.norm(splat_map.means[:, None] - points.to(splat_map.means), dim=-1).amin(1)
        return gamma1 * torch.exp(-gamma2 * distance)
    lattice, free, limit = occupancy.lattice, occupancy.state == grid.FREE, limit or np.inf
    sources = lattice.index(points.detach().cpu().numpy())
    along = grid.geodesic(np.where(free, 1.0, np.inf), sources[lattice.inside(sources)], limit / lattice.cell)
    means = splat_map.means.detach().cpu().double().numpy()
    there = lattice.index(means)
    cells = np.clip(there, 0, np.array(lattice.shape) - 1)
    places = np.clip((means[:, :2] - lattice.origin) / lattice.cell, cells, np.nextafter(cells + 1.0, 0))
    door, rest = grid.beside(free, places)
    beyond = np.linalg.norm(means[:, :2] - lattice.centers(cells), axis=1) * ~lattice.inside(there)
    distance = (along[door[:, 0], door[:, 1]] + rest) * lattice.cell + beyond
    reached = np.isfinite(distance) & (distance <= limit)
    weights = np.where(reached, gamma1 * np.exp(-gamma2 * np.where(reached, distance, 0.0)), 0.0)
    return torch.from_numpy(weights).to(splat_map.means)
