"""Starts and goals where a scene names none: a team close enough together for its members' views to overlap."""

import math

import numpy as np

from mannbv import grid
from mannbv.world import cells
from mannbv.world.ground import Ground

CLEARANCE = 0.3  # [m] around every start and goal
CELL = 0.1  # [m]
REACH = 8.0  # [m] starts and goals lie within this graph distance of the hub
LENGTH = 10.0  # [m] a path of about this length is sought for every robot
APART = 0.6  # [m] between two starts, and between two goals
HEADING = math.radians(5)


def choose(ground: Ground, n_robots: int) -> tuple[np.ndarray, np.ndarray]:
    """Starts (k, 3) and goals (k, 2) [m, rad], k ≤ n_robots, in the largest region with `CLEARANCE`; no chance in it.

    The hub is that region's cell nearest to its middle. Starts spread over its surroundings, each as far as possible
    from those before; a robot's goal lies about `LENGTH` away and `APART` from the others'.
    """
    lattice, free = ground.free_grid(CELL, CLEARANCE)
    region = cells.largest(free)
    if n_robots < 1 or not region.any():
        return np.zeros((0, 3)), np.zeros((0, 2))
    inner = np.argwhere(region)
    cost = np.where(region, 1.0, np.inf)
    hub = inner[np.argmin(((inner - inner.mean(0)) ** 2).sum(1))]
    near = inner[grid.geodesic(cost, hub)[tuple(inner.T)] * CELL <= REACH]
    starts = _spread(near, n_robots)
    goals = []
    for start in starts:
        away = grid.geodesic(cost, start)[tuple(near.T)] * CELL
        for goal in goals:
            away[np.linalg.norm(near - goal, axis=1) * CELL < APART] = -math.inf
        if not np.isfinite(away).any():
            break
        goals.append(near[np.argmin(np.abs(away - LENGTH))])
    start, goal = lattice.centers(starts[: len(goals)]), lattice.centers(np.array(goals))
    yaws = np.arctan2(*(goal - start).T[::-1])
    return np.column_stack([start, np.round(yaws / HEADING) * HEADING]), goal


def _spread(cells: np.ndarray, count: int) -> np.ndarray:
    """Up to `count` cells, each as far as possible from those before, at least `APART`."""
    chosen = [cells[0]]
    gap = np.linalg.norm(cells - chosen[0], axis=1)
    while len(chosen) < count and gap.max() * CELL >= APART:
        chosen.append(cells[gap.argmax()])
        gap = np.minimum(gap, np.linalg.norm(cells - chosen[-1], axis=1))
    return np.array(chosen)
