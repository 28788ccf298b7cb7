"""The storeys of a building of triangles: where its floors are, and the plan of the ground on each."""

import math
from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from mannbv import grid
from mannbv.kernels.space import cover
from mannbv.world import cells
from mannbv.world.errors import SceneError
from mannbv.world.ground import BODY, Ground
from mannbv.world.surfaces import Surfaces

CELL = 0.025  # [m] of the plan …
COARSE = 0.05  # [m] … and of that of a very large building
STANDING = 1.4  # [m] of free height above what one can stand on
APART = 1.8  # [m] between two storeys
FLAT = 0.1  # [m] a floor may rise or fall so much
HOLE = 0.3  # [m²] a smaller gap in a scanned floor is closed
PORCH = 2.5  # [m] ground without walls around counts so far from ground with walls
RADIUS = 0.1  # [m] the free ground is what a disc of this radius can reach
_LEVEL = 0.7  # one can stand on what slants less, as a cosine
_COLUMNS = 150  # vertical lines along the longer side
_EYES = (1.25, 0.5, 2.0)  # [m] above a floor, where one looks around for walls
_AROUND = 16  # directions in which one looks
_ENCLOSED = 0.6  # share of them that must end at a wall
_BLOCK = 10  # cells
_MOST_CELLS = 20_000_000
_LAYERS = 40  # surfaces that one vertical line meets


def floors(surfaces: Surfaces) -> list[float]:
    """Heights [m] of the storeys' floors, the lowest first.

    A floor is where much ground lies at one height with room to stand and with walls around: no roof, no table, and
    nothing that is small beside the largest floor.
    """
    size = (surfaces.upper - surfaces.lower)[:2].max()
    points, gaps, level = columns(surfaces, max(0.05, size / _COLUMNS))
    points = points[level & (gaps >= STANDING)]
    walled = _enclosed(surfaces, points, _EYES[:1])  # from a roof one sees over its edge
    heights = points[walled if walled.any() else slice(None), 2]
    found, most = [], 0
    while len(heights):
        edges = np.arange(heights.min() - FLAT, heights.max() + 2 * FLAT, FLAT / 2)
        counts = np.convolve(np.histogram(heights, edges)[0], np.ones(3), "same")
        middle = edges[counts.argmax()] + FLAT / 4
        floor = float(np.median(heights[np.abs(heights - middle) <= FLAT]))
        near = np.abs(heights - floor) <= FLAT
        most = max(most, near.sum())
        if near.sum() < most / 10:
            break
        found.append(floor)
        heights = heights[np.abs(heights - floor) >= APART]
    return sorted(round(floor, 4) + 0.0 for floor in found)  # no −0.00


def nearest(heights: Sequence[float], wanted: float) -> float:
    """The one of `heights` [m] nearest to a wanted one. Raises SceneError for a wish that is no finite number."""
    if not math.isfinite(wanted):
        raise SceneError(f"a floor's height must be a finite number [m], got {wanted}; choose another with --floor")
    return min(heights, key=lambda z: abs(z - wanted))


def height(surfaces: Surfaces) -> float:
    """Height of a storey in the surfaces' own unit: floor to ceiling, or that of the walls where no ceiling is.

    nan where neither can be seen.
    """
    size = (surfaces.upper - surfaces.lower)[:2].max()
    points, gaps, level = columns(surfaces, size / _COLUMNS)
    if not level.any():
        return math.nan
    _, column = np.unique(points[:, :2], axis=0, return_inverse=True)
    largest = np.zeros(column.max() + 1)  # room between two level surfaces, column by column
    under = level & np.isfinite(gaps) & np.append(False, level[:-1])
    np.maximum.at(largest, column[under], gaps[under])
    rooms = largest[largest > size / 1000]
    if len(rooms) >= 0.2 * len(largest):
        bins = np.round(np.log(rooms / rooms.min()) / 0.05).astype(int)
        weight = np.convolve(np.bincount(bins, rooms, minlength=3), np.ones(3), "same")
        common = rooms[np.abs(bins - weight.argmax()) <= 1]
        if len(common) >= 0.2 * len(largest):
            return float(np.median(common))
    return _walls(surfaces, points[level & np.isinf(gaps), 2])


def _walls(surfaces: Surfaces, seen: np.ndarray) -> float:
    """Height of the walls above the most common height (k,) seen from above."""
    rise, area = _slant(surfaces.corners)
    upright = rise < 0.1
    if not upright.any() or len(seen) == 0:
        return math.nan
    counts, edges = np.histogram(seen, 100)
    floor = np.median(seen[np.abs(seen - edges[counts.argmax()]) <= edges[1] - edges[0]])
    tops = surfaces.corners[upright, :, 2].max(1)
    order = np.argsort(tops)
    total = np.cumsum(area[upright][order])
    return float(tops[order][np.searchsorted(total, 0.95 * total[-1])] - floor)


def columns(surfaces: Surfaces, spacing: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where vertical lines, `spacing` apart, meet triangles: points (k, 3), the free height (k,) above each up to the
    next one, inf below the sky, and whether (k,) the triangle is about level. Column by column, from above."""
    lower, upper = surfaces.lower, surfaces.upper
    x, y = (np.arange(low + spacing / 2, high, spacing) for low, high in zip(lower[:2], upper[:2], strict=True))
    origins = np.stack([*(v.ravel() for v in np.meshgrid(x, y, indexing="ij")), np.full(len(x) * len(y), upper[2])], 1)
    origins[:, 2] += spacing
    level = _slant(surfaces.corners)[0] > _LEVEL
    column, above = np.arange(len(origins)), np.full(len(origins), np.inf)
    found = [(np.zeros(0, int), np.zeros((0, 3)), np.zeros(0), np.zeros(0, bool))]
    for _ in range(_LAYERS):
        depth, face = surfaces.cast(origins, np.broadcast_to([0.0, 0.0, -1.0], origins.shape))
        hit = face >= 0
        origins, column, face = origins[hit] - depth[hit, None] * [0, 0, 1], column[hit], face[hit]
        found.append((column, origins.copy(), above[hit] - origins[:, 2], level[face]))
        above = origins[:, 2].copy()
        origins[:, 2] -= spacing / 1000
    column, points, gaps, level = (np.concatenate([f[k] for f in found]) for k in range(4))
    order = np.argsort(column, kind="stable")
    return points[order], gaps[order], level[order]


def _enclosed(surfaces: Surfaces, points: np.ndarray, eyes) -> np.ndarray:
    """Which points (k, 3) of a floor have walls around: most horizontal directions end at one, for some eye height."""
    angles = (np.arange(_AROUND) + 0.5) * 2 * math.pi / _AROUND
    directions = np.tile(np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1), (len(points), 1))
    ends = np.zeros(len(directions), bool)
    for eye in eyes:
        open_ = ~ends
        origins = np.repeat(points + np.array([0, 0, eye]), _AROUND, 0)[open_]
        ends[open_] = surfaces.cast(origins, directions[open_])[1] >= 0
    return ends.reshape(-1, _AROUND).mean(1) >= _ENCLOSED


def free_cells(surfaces: Surfaces, floor: float) -> tuple[grid.Lattice, np.ndarray]:
    """The lattice of a storey's plan, and (nx, ny) bool for the free ground that a robot can reach.

    That is the connected region with the most ground indoors, and up to `PORCH` out of it. Free is a cell with floor
    within `FLAT` of the height `floor` [m] and without any part of a triangle between the heights of `BODY` above it.
    Raises SceneError for far too large a building.
    """
    low, high = surfaces.lower[:2], surfaces.upper[:2]
    cell = CELL if np.prod((high - low) / CELL) <= _MOST_CELLS else COARSE
    if np.prod((high - low) / cell) > _MOST_CELLS:
        size = " × ".join(f"{v:.0f}" for v in high - low)
        raise SceneError(f"a building of {size} m is too large for a plan; is the unit metres? Try --scale 0.01")
    lattice = grid.Lattice.around(low - 2 * cell, high + 2 * cell, cell)
    occupied, ground = np.zeros(lattice.shape, bool), np.zeros(lattice.shape, bool)
    cover.cover(surfaces.corners, floor + BODY[0], floor + BODY[1], np.array(lattice.origin), cell, occupied)
    level = surfaces.corners[_slant(surfaces.corners)[0] > _LEVEL]
    cover.cover(level, floor - FLAT, floor + FLAT, np.array(lattice.origin), cell, ground)
    free = _filled(ground | occupied, round(HOLE / cell**2)) & ~occupied
    indoors = _indoors(surfaces, floor, lattice, free)
    free &= grid.within(indoors, PORCH, cell)
    margin = RADIUS / cell + 0.5  # to the nearest cell's centre, not its edge
    reached = cells.largest(ndimage.distance_transform_edt(free) >= margin, indoors)
    return lattice, free & (ndimage.distance_transform_edt(~reached) < margin)


def ground(surfaces: Surfaces, floor: float) -> Ground:
    """The plan of the storey at the height `floor` [m]. Raises SceneError."""
    lattice, free = free_cells(surfaces, floor)
    if not free.any():
        raise SceneError(f"no ground is free on the floor at {floor:.2f} m; choose another with --floor")
    return cells.ground(free, lattice.cell, lattice.origin, floor=floor)


def _indoors(surfaces: Surfaces, floor: float, lattice: grid.Lattice, free: np.ndarray) -> np.ndarray:
    """Which cells (nx, ny) have walls around, looked at in blocks of `_BLOCK`; all, if none has."""
    nx, ny = (-(-n // _BLOCK) for n in lattice.shape)
    wide = grid.Lattice(lattice.origin, lattice.cell * _BLOCK, (nx, ny))
    padded = np.pad(free, [(0, m * _BLOCK - n) for n, m in zip(lattice.shape, wide.shape, strict=True)])
    blocks = np.any(padded.reshape(nx, _BLOCK, ny, _BLOCK), axis=(1, 3))
    blocks[blocks] = _enclosed(surfaces, np.column_stack([wide.centers()[blocks], np.full(blocks.sum(), floor)]), _EYES)
    walled = np.kron(blocks, np.ones((_BLOCK, _BLOCK), bool))[: free.shape[0], : free.shape[1]]
    return walled if walled.any() else np.ones_like(free)


def _slant(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How level triangles (f, 3, 3) lie, 1 for a floor and 0 for a wall, and twice their areas."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    return np.abs(normal[:, 2]) / area, area


def _filled(ground: np.ndarray, most: int) -> np.ndarray:
    """With its holes of at most `most` cells filled."""
    labels, _ = ndimage.label(~ground)
    small = np.bincount(labels.ravel()) <= most
    small[0] = False
    return ground | small[labels]
