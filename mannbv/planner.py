"""Where to go: risk-averse A* on the grid, and the most informative of the subgoals near the goal (Section VI-A)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike

from mannbv import grid, risk
from mannbv.belief import Belief, profile
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.splats import SplatMap


@dataclass(frozen=True)
class Route:
    """A planned way: waypoints (k, d) [m] a cell apart; look (d,) [m], what to face at its end, None at the goal.

    candidates (c, d) and gains (c,): the subgoals that were compared, and the information of each one's best view.
    """

    waypoints: np.ndarray
    look: np.ndarray | None
    candidates: np.ndarray
    gains: np.ndarray

    def ahead(self, distance: float) -> np.ndarray:
        """The waypoints up to `distance` [m] along the route, at least the first two, so that it is a way."""
        return self.waypoints[: max(2, int(np.searchsorted(lengths(self.waypoints), distance + 1e-9)))]


def lengths(path: np.ndarray) -> np.ndarray:
    """Distance travelled (k,) [m] at each waypoint of a path (k, d)."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])[: len(path)]


def thin(path: np.ndarray, spacing: float) -> np.ndarray:
    """Waypoints about `spacing` [m] apart, both ends included: what is sent and masked."""
    if len(path) < 3:
        return path
    along = lengths(path)
    marks = np.linspace(0.0, along[-1], max(2, int(np.ceil(along[-1] / spacing)) + 1))
    return path[np.unique(np.searchsorted(along, marks - 1e-9))]


def raised(ground: np.ndarray, rest: ArrayLike) -> np.ndarray:
    """Points (k, d) [m] over points (k, 2) of the ground; rest (d − 2,): the coordinates above it, [] in flatland."""
    above = np.asarray(rest, float)
    return np.concatenate([ground, np.broadcast_to(above, (len(ground), len(above)))], 1)


def traversable(occupancy: grid.Occupancy, config: Config) -> np.ndarray:
    """Cells (nx, ny) where the robot's disc fits: a margin from occupied cells, its bare radius from unknown ones."""
    state, cell = occupancy.state, occupancy.lattice.cell
    body = config.robot_radius + 0.5 * cell
    near = grid.within(state == grid.OCCUPIED, body + config.margin, cell)
    return (state == grid.FREE) & ~near & ~grid.within(state == grid.UNKNOWN, body, cell)


def prices(
    splat_map: SplatMap, lattice: grid.Lattice, cells: np.ndarray, rest: np.ndarray, config: Config
) -> np.ndarray:
    """A*'s price (nx, ny) per metre: 1 + risk_weight · exp(−α / risk_scale) on the given cells, inf elsewhere.

    rest: as in `raised`, so that α is taken at camera height in 3-D. Below α = −risk_floor · risk_scale prices grow no
    more.
    """
    price = np.full(cells.shape, np.inf)
    points = raised(lattice.centers(np.argwhere(cells)), rest)
    alpha = risk.along(splat_map, torch.from_numpy(points), config).double().numpy()
    alpha = np.maximum(alpha, -config.risk_floor * config.risk_scale)
    price[cells] = 1.0 + config.risk_weight * np.exp(-alpha / config.risk_scale)
    return price


def safe_path(price: np.ndarray, lattice: grid.Lattice, start: np.ndarray, goal: np.ndarray) -> np.ndarray | None:
    """Cheapest waypoints (k, d) [m] by A* between the open cells nearest to start and goal (d,), None if none.

    The ends are the cells' centres, but for a goal that lies in the last one, which is then the last waypoint.
    """
    ends = lattice.index(np.stack([start, goal]))
    near, _ = grid.nearest(np.isfinite(price), np.clip(ends, 0, np.array(lattice.shape) - 1))
    if not np.isfinite(price).any():
        return None
    cells = grid.path(price, near[0], near[1])
    if cells is None:
        return None
    ground = lattice.centers(cells)
    if (near[1] == ends[1]).all():
        ground[-1] = goal[:2]
    return raised(ground, start[2:])


def _frontier_targets(
    occupancy: grid.Occupancy, reach: np.ndarray, config: Config
) -> list[tuple[np.ndarray, np.ndarray]]:
    """For each frontier: the reachable cell nearest to it, and its own middle cell."""
    targets = []
    for cells in grid.frontiers(occupancy.state, config.min_frontier):
        middle = cells[np.argmin(((cells - cells.mean(0)) ** 2).sum(1))]
        near, _ = grid.nearest(reach, middle[None])
        targets.append((near[0], middle))
    return targets


def plan(
    belief: Belief,
    camera: Camera,
    position: np.ndarray,
    goal: np.ndarray,
    config: Config,
    tried: Sequence[np.ndarray] = (),
) -> Route | None:
    """The route to the goal if it is known to be reachable, else to the most informative frontier near it.

    Frontiers count if they have `min_frontier` cells and lengthen the optimistic way to the goal (unknown cells open)
    by no more than `detour` and `slack`; of the `n_subgoals` nearest, the one whose best view gains most is chosen.
    tried: (x, y) [m] of subgoals that showed nothing new. None where there is nowhere to go.
    """
    occupancy = belief.known
    lattice = occupancy.lattice
    cells = traversable(occupancy, config)
    here, goal_cell = lattice.index(np.stack([position, goal]))
    if not cells.any():
        return None
    near, _ = grid.nearest(cells, np.clip(here, 0, np.array(lattice.shape) - 1)[None])
    walked = grid.geodesic(np.where(cells, 1.0, np.inf), near)
    reach = np.isfinite(walked)
    price = prices(belief.splats, lattice, reach, position[2:], config)
    nothing = np.zeros((0, len(position))), np.zeros(0)
    if lattice.at(reach, goal[None], False)[0]:
        way = safe_path(price, lattice, position, goal)
        return way if way is None else Route(way, None, *nothing)

    blocked = grid.within(occupancy.state == grid.OCCUPIED, config.robot_radius + 0.5 * lattice.cell, lattice.cell)
    blocked[goal_cell[0], goal_cell[1]] = False
    onward = grid.geodesic(np.where(blocked, np.inf, 1.0), goal_cell)
    targets = _frontier_targets(occupancy, reach, config)
    length = np.array([walked[tuple(t)] + onward[tuple(m)] for t, m in targets]) * lattice.cell
    spots = lattice.centers(np.array([t for t, _ in targets]).reshape(-1, 2))
    fresh = np.isfinite(length)
    for spot in tried:
        fresh &= np.linalg.norm(spots - spot, axis=1) > config.tried_radius
    order = [k for k in np.argsort(length, kind="stable") if fresh[k]]
    if not order:
        return None
    longest = length[order[0]] * (1 + config.detour) + config.slack
    order = [k for k in order if length[k] <= longest][: config.n_subgoals]
    candidates = raised(spots[order], position[2:])
    gains = np.array([profile(belief, camera, s, config, n_yaws=config.subgoal_yaws).gains.max() for s in candidates])
    best = int(np.argmax(gains))
    way = safe_path(price, lattice, position, candidates[best])
    look = np.concatenate([lattice.centers(targets[order[best]][1]), position[2:]])
    return way if way is None else Route(way, look, candidates, gains)
