"""Which part of the plane something fills: a set of polygons, or the cells of a map that may be rotated."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mannbv import grid
from mannbv.kernels.flat import rays


@dataclass(frozen=True)
class Polygons:
    """Simple polygons, each (k, 2) [m]; they may overlap."""

    corners: tuple[np.ndarray, ...]

    @property
    def area(self) -> float:
        """Sum of the areas [m²]; what two polygons share counts twice."""
        return sum(abs(signed_area(polygon)) for polygon in self.corners)

    def which(self, points: ArrayLike) -> np.ndarray:
        """Index (k,) of the first polygon that holds each point (k, 2), −1 where none does."""
        points = np.ascontiguousarray(points, float)
        if not self.corners:
            return np.full(len(points), -1)
        offsets = np.cumsum([0, *(len(polygon) for polygon in self.corners)])
        return rays.which_polygon(points, np.concatenate(self.corners), offsets)

    def contains(self, points: ArrayLike) -> np.ndarray:
        """Which points (k, 2) lie in one of the polygons."""
        return self.which(points) >= 0


@dataclass(frozen=True)
class Cells:
    """The marked cells of a lattice whose frame is turned by `rotation` (2, 2) and moved by `shift` (2,) [m].

    A point outside the lattice belongs to it if `outside` says so.
    """

    lattice: grid.Lattice
    marked: np.ndarray
    rotation: np.ndarray
    shift: np.ndarray
    outside: bool

    @property
    def area(self) -> float:
        """Area of the marked cells [m²]."""
        return float(self.marked.sum()) * self.lattice.cell**2

    def contains(self, points: ArrayLike) -> np.ndarray:
        """Which points (k, 2) [m] of the world lie in a marked cell."""
        return self.lattice.at(self.marked, (np.asarray(points, float) - self.shift) @ self.rotation, self.outside)


def signed_area(polygon: ArrayLike) -> float:
    """Area [m²] inside a polygon (k, 2), positive where its corners run counter-clockwise."""
    x, y = np.asarray(polygon, float).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def turn(yaw: float) -> np.ndarray:
    """The rotation (2, 2) by `yaw` [rad], counter-clockwise."""
    return np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
