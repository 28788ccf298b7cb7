"""The plan of what a robot stands on: where it fits, how far the nearest wall is, and the shortest way."""

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from mannbv import grid
from mannbv.config import Config
from mannbv.kernels.flat import rays
from mannbv.world.bodies import Cells, Polygons
from mannbv.world.errors import SceneError
from mannbv.world.segments import Segments

BODY = (Config().body_low, Config().body_high)  # [m] above the floor: what a robot can run into
EYE = Config().camera_height  # [m] above the floor
SNAP = 0.3  # [m] a path may begin and end this far from the nearest free cell's centre
_MOST_CELLS = 20_000_000  # of a grid over a building
_BIN = 0.5  # [m] bins that hold the segments in the search for the nearest


@dataclass(frozen=True, eq=False)
class Ground:
    """What stands in the height of a robot's body, as a plan; of points (k, ≥ 2) [m] only x and y count.

    solids, rooms: what is filled by walls and furniture, and what lies inside the building, its inner walls included.
    floor [m]: height of the ground. body: the heights [m] above it between which things are in the plan.
    """

    walls: Segments
    solids: Polygons | Cells
    rooms: Polygons | Cells
    floor: float = 0.0
    body: tuple[float, float] = BODY
    _memo: dict = field(default_factory=dict, init=False, repr=False)

    @property
    def area(self) -> float:
        """Floor area of the building [m²]; walls between rooms and furniture included where they belong to a room."""
        return self.rooms.area

    def raised(self, places: np.ndarray, height: float = EYE) -> np.ndarray:
        """Places (k, ≥ 2) of the plan with a third coordinate, `height` [m] above the floor."""
        return np.insert(places, 2, self.floor + height, axis=1)

    def solid(self, points: ArrayLike) -> np.ndarray:
        """Which points (k,) lie inside a wall or a piece of furniture."""
        return self.solids.contains(_plane(points))

    def inside(self, points: ArrayLike) -> np.ndarray:
        """Which points (k,) lie in the building, furniture and its inner walls included."""
        return self.rooms.contains(_plane(points))

    def clearance(self, points: ArrayLike) -> np.ndarray:
        """Distance (k,) [m] to the nearest surface; 0 inside walls and furniture."""
        places = _plane(points)
        distance = np.zeros(len(places))
        free = ~self.solid(places)
        distance[free] = rays.clearance(np.ascontiguousarray(places[free]), self.walls.ends, *self._bins)
        return distance

    @cached_property
    def _bins(self):
        lower = self.walls.lower
        shape = tuple(int(n) for n in np.ceil((self.walls.upper - lower) / _BIN + 1e-9) + 1)
        return lower, _BIN, shape, *rays.bins(self.walls.ends, lower, _BIN, shape)

    def lattice(self, cell: float) -> grid.Lattice:
        """Cells of `cell` [m] over the building, with a margin of two cells. Raises SceneError for far too many."""
        size = self.walls.upper - self.walls.lower
        if np.prod(size / cell + 4) > _MOST_CELLS:
            raise SceneError(
                f"{size[0]:g} × {size[1]:g} m is too large for a grid of {cell:g} m cells; are the units metres? "
                "Else give larger cells"
            )
        return grid.Lattice.around(self.walls.lower - 2 * cell, self.walls.upper + 2 * cell, cell)

    def free_grid(self, cell: float, radius: float) -> tuple[grid.Lattice, np.ndarray]:
        """Where a disc of `radius` [m] fits: the lattice, and (nx, ny) bool for cells whose centre is inside the
        building, not solid, and at least `radius` from every surface. Kept for the next call: do not write to it."""
        if (cell, radius) not in self._memo:
            lattice = self.lattice(cell)
            centers = lattice.centers().reshape(-1, 2)
            free = self.inside(centers)
            free[free] = self.clearance(centers[free]) >= max(radius, 1e-9)
            free = free.reshape(lattice.shape)
            free.flags.writeable = False
            self._memo[cell, radius] = lattice, free
        return self._memo[cell, radius]

    def reachable_free(self, cell: float, radius: float, start: ArrayLike) -> np.ndarray:
        """The part (nx, ny) of `free_grid` that a disc of `radius` [m] reaches from `start` (≥ 2,) [m]."""
        _, free = self.free_grid(cell, radius)
        labels, _ = ndimage.label(free)  # sides, not corners: a diagonal move needs both cells beside it
        x, y = self._free_cell(np.asarray(start, float), radius, cell)
        return labels == labels[x, y]

    def shortest_path(self, start: ArrayLike, goal: ArrayLike, radius: float, cell: float = 0.05) -> np.ndarray:
        """The shortest way (k, d) [m] of a disc of `radius` [m] over the true plan's 8-connected cells.

        Both ends are given points, the rest centres of cells. d is that of the goal (d,); in space the whole way has
        the height of the start (≥ d,). Raises ValueError, naming both ends, where there is no way.
        """
        lattice, free = self.free_grid(cell, radius)
        a, b = np.asarray(start, float), np.asarray(goal, float)
        cells = grid.path(np.where(free, 1.0, np.inf), *(self._free_cell(end, radius, cell) for end in (a, b)))
        if cells is None:
            raise ValueError(
                f"no way for a robot of radius {radius:g} m from {_text(a)} to {_text(b)}; "
                "choose another goal or a smaller radius"
            )
        way = np.concatenate([a[None, :2], lattice.centers(cells[1:-1]), b[None, :2]])
        return np.concatenate([way, np.tile(a[2 : len(b)], (len(way), 1))], 1)

    def _free_cell(self, point: np.ndarray, radius: float, cell: float) -> np.ndarray:
        """The free cell at `point`, or the nearest one within `SNAP`."""
        lattice, free = self.free_grid(cell, radius)
        index = np.clip(lattice.index(point[None]), 0, np.array(lattice.shape) - 1)
        near, _ = grid.nearest(free, index)
        if not free.any() or math.dist(lattice.centers(near)[0], point[:2]) > SNAP:
            raise ValueError(
                f"{_text(point)} is no place for a robot of radius {radius:g} m; "
                "move it away from walls and furniture, or choose a smaller radius"
            )
        return near[0]

    def unfit(self, point: ArrayLike, radius: float) -> str:
        """Why a robot of `radius` [m] cannot be at `point` (≥ 2,) [m], and the remedy; "" where it can."""
        place = np.asarray(point, float)
        inside = self.inside(place[None])[0]
        if inside and self.clearance(place[None])[0] >= radius:
            return ""
        where = "inside a wall or furniture" if self.solid(place[None])[0] else "too near to a wall"
        where = where if inside else "outside the building"
        return f"{_text(place)} lies {where} for a robot of radius {radius:g} m; move it into free space"


def _plane(points: ArrayLike) -> np.ndarray:
    return np.asarray(points, float)[:, :2]


def _text(point: np.ndarray) -> str:
    return f"({point[0]:.2f}, {point[1]:.2f})"
