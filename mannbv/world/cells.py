"""From free cells to the plan of a ground: walls along the edges of cells."""

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from mannbv import grid
from mannbv.kernels.flat import rays
from mannbv.world import bodies
from mannbv.world.ground import Ground
from mannbv.world.segments import TEXTURES, Segments

TEXTURE = (float(TEXTURES["noise"]), 0.7, 0.5, 0.0)  # of every wall: kind, period [m], contrast, phase [m]
_HUES = 3.0  # [m] over such a distance the walls' base colour changes


def ground(free: np.ndarray, cell: float, origin: ArrayLike, yaw: float = 0.0, floor: float = 0.0) -> Ground:
    """The ground whose free part is exactly the cells `free` (nx, ny); everything else is solid.

    `origin` x, y [m] is the outer corner of the first cell of size `cell` [m], about which the lattice is turned by
    `yaw` [rad]; floor [m]. Every edge between a free cell and another is a wall. Raises SceneError if none is free.
    """
    rotation, origin = bodies.turn(yaw), np.asarray(origin, float)
    lattice = grid.Lattice((0.0, 0.0), cell, free.shape)
    ends = np.ascontiguousarray((cell_edges(free).reshape(-1, 2) * cell @ rotation.T + origin).reshape(-1, 4))
    colors = np.clip(0.55 + 0.45 * rays.noise_at((ends[:, :2] + ends[:, 2:]) / 2, _HUES), 0.15, 0.95)
    return Ground(
        walls=Segments(ends, colors, np.tile(TEXTURE, (len(ends), 1))),
        solids=bodies.Cells(lattice, ~free, rotation, origin, outside=True),
        rooms=bodies.Cells(lattice, free, rotation, origin, outside=False),
        floor=floor,
    )


def largest(free: np.ndarray, counted: np.ndarray | None = None) -> np.ndarray:
    """The region of `free` (nx, ny), connected by its cells' sides, with the most cells, or most of those `counted`.

    Nothing where nothing is free.
    """
    labels, count = ndimage.label(free)
    if count == 0:
        return np.zeros_like(free)
    return labels == np.bincount(labels[free if counted is None else free & counted], minlength=2)[1:].argmax() + 1


def cell_edges(free: np.ndarray) -> np.ndarray:
    """Edges (s, 2, 2), in cells, between the free and the other cells of (nx, ny); straight runs are merged."""
    padded = np.pad(free, 1).astype(np.int8)
    across_y = _runs(np.diff(padded, axis=1)[1:-1])
    across_x = _runs(np.diff(padded, axis=0)[:, 1:-1].T)
    return np.concatenate([across_y, across_x[..., ::-1]]).astype(float)


def _runs(change: np.ndarray) -> np.ndarray:
    """Ends (s, 2, 2) of the runs along the first axis of equal values other than 0."""
    padded = np.pad(change, ((1, 1), (0, 0)))
    breaks = padded[1:] != padded[:-1]
    line, begin = np.nonzero((breaks & (padded[1:] != 0)).T)
    same, end = np.nonzero((breaks & (padded[:-1] != 0)).T)
    return np.stack([np.stack([begin, line], 1), np.stack([end, same], 1)], 1)
