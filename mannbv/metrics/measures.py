"""Scores of a robot from the world, its map, its path and what it sent (Section VI-C); never from a record."""

import math

import numpy as np
import torch
from numpy.typing import ArrayLike

from mannbv import geometry, grid, messages, planner, render, risk
from mannbv.belief import Belief
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.messages import Ledger
from mannbv.splats import SplatMap
from mannbv.world import World

HEADINGS = 8  # of the paper's "different viewing angles"; chosen here, as are the two lengths below
_SPACING = 1.0  # [m] between the places along a trajectory where the map is compared with the world
_PATH_SCORES = ("total_risk_m", "total_risk_true_m", "risk_gain_m", "risk_gain_true_m", "reference_clearance_m")


def view_quality(
    splat_map: SplatMap, world: World, camera: Camera, trail: np.ndarray, config: Config
) -> tuple[float, float]:
    """(PSNR [dB], depth MAE [m]) of the map against the world, from places a metre apart on a trajectory (k, d).

    `HEADINGS` headings at each place, the paper's "different viewing angles". PSNR is that of the mean squared error
    over all views; pixels where the sensor has no depth do not count.
    """
    squares, gaps = [], []
    for place in planner.thin(trail, _SPACING):
        for heading in range(HEADINGS):
            pose = geometry.yaw_pose(torch.from_numpy(place), 2 * math.pi * heading / HEADINGS)
            truth = world.sense(camera, pose, max_depth=config.max_depth)
            with torch.no_grad():
                drawn = render.render(splat_map, camera, pose)
            squares.append(((drawn.color - truth.color) ** 2)[truth.valid])
            gaps.append((drawn.depth - truth.depth).abs()[truth.valid])
    square, gap = torch.cat(squares).double().mean().item(), torch.cat(gaps).double().mean().item()
    return -10 * math.log10(max(square, 1e-12)), gap


def true_surfaces(world: World) -> SplatMap:
    """The world's surfaces as splats without spread, so that their risk is the plain distance."""
    points = torch.from_numpy(world.seen.sampled()).float()
    n, dim = points.shape
    rotations = geometry.identity_rotations(n, dim)
    return SplatMap(points, torch.full((n, dim), -20.0), rotations, torch.full((n,), 10.0), torch.zeros(n, 3))


def reference_path(belief: Belief, start: np.ndarray, goal: np.ndarray, config: Config) -> np.ndarray | None:
    """Section VI-C's path: risk-averse A* from start to goal (d,) on a robot's final map.

    None where the map knows none, or no open cell within `reach` and the planner's margins of either end.
    """
    lattice, cells = belief.known.lattice, planner.traversable(belief.known, config)
    if not cells.any():
        return None
    price = planner.prices(belief.splats, lattice, cells, start[2:], config)
    path = planner.safe_path(price, lattice, start, goal)
    if path is None:
        return None
    near = config.reach + config.robot_radius + config.margin
    gaps = np.linalg.norm(path[[0, -1]] - np.stack([start, goal]), axis=1)
    return path if (gaps <= near).all() else None


def path_scores(
    belief: Belief,
    world: World,
    surfaces: SplatMap,
    start: ArrayLike,
    goal: ArrayLike,
    shortest: np.ndarray,
    config: Config,
) -> dict[str, float]:
    """Risk of the reference path and its gain over the shortest feasible path, on the own map and the true surfaces.

    Returns total_risk_m, total_risk_true_m, risk_gain_m, risk_gain_true_m, and reference_clearance_m, the least true
    clearance of the reference path; all NaN where the map knows no way from start to goal.
    """
    path = reference_path(belief, np.asarray(start, float), np.asarray(goal, float), config)
    if path is None:
        return dict.fromkeys(_PATH_SCORES, math.nan)

    def total(splat_map: SplatMap, waypoints: np.ndarray) -> float:
        return risk.along(splat_map, torch.from_numpy(waypoints), config).mean().item()

    own, true = total(belief.splats, path), total(surfaces, path)
    gains = own - total(belief.splats, shortest), true - total(surfaces, shortest)
    return dict(zip(_PATH_SCORES, (own, true, *gains, float(world.ground.clearance(path).min())), strict=True))


def travel_scores(
    world: World, trail: np.ndarray, goal: ArrayLike, shortest: np.ndarray, reached: bool, collisions: int
) -> dict[str, float]:
    """Length, overhead, clearance and SPL of an executed trajectory (k, d) [m].

    shortest (j, d): the shortest feasible path on the true plan. path_overhead counts the rest of the way to the goal,
    which is "reached" from a distance; it is NaN unless the goal was reached.
    """
    length, best = float(planner.lengths(trail)[-1]), float(planner.lengths(shortest)[-1])
    rest = float(np.linalg.norm(trail[-1] - goal))
    return {
        "path_length_m": length,
        "path_overhead": (length + rest) / best - 1 if reached and best > 0 else math.nan,
        "collisions": collisions,
        "min_clearance_m": float(world.ground.clearance(trail).min()),
        "spl": float(reached) * best / max(length, best) if best > 0 else float(reached),
    }


def coverage(occupancy: grid.Occupancy, reachable: np.ndarray, lattice: grid.Lattice) -> float:
    """Share of the reachable free area (nx, ny over `lattice`) that the robot has seen."""
    centers = lattice.centers(np.argwhere(reachable))
    seen = occupancy.lattice.at(occupancy.state, centers, grid.UNKNOWN) != grid.UNKNOWN
    return float(seen.mean()) if len(seen) else math.nan


def traffic(ledger: Ledger, robot: int, strategy: str) -> dict[str, int]:
    """What a robot sent and received [B], what it sent of every kind, and its part of the paper's count."""

    def of(place: int) -> Ledger:
        return Ledger({key: row for key, row in ledger.rows.items() if key[place] == robot})

    kinds = of(0).by_kind()
    return {
        "bytes_sent": ledger.sent_by(robot),
        "bytes_received": ledger.received_by(robot),
        **{f"bytes_{kind.__name__.lower()}": kinds.get(kind.__name__, 0) for kind in messages.KINDS},
        "bytes_paper": of(2).paper_total(strategy),
    }
