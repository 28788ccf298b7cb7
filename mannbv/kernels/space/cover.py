"""Which cells of a lattice a slice of a building covers: triangles cut by a band of heights, seen from above."""

import math

import numpy as np
from numba import njit


@njit(cache=True)
def cover(corners, low, high, origin, cell, marked):
    """Marks the cells (nx, ny) that any part of a triangle between the heights `low` and `high` [m] touches.

    corners (f, 3, 3) [m]. A part is a convex polygon; in each row of cells it spans one interval, so that no cell is
    missed and none is marked that the part does not touch.
    """
    nx, ny = marked.shape
    ends = np.empty((6, 3))  # a triangle between two planes has at most five corners
    for f in range(len(corners)):
        count = _band(corners[f], low, high, ends)
        if count == 0:
            continue
        y_min, y_max = ends[0, 1], ends[0, 1]
        for k in range(1, count):
            y_min, y_max = min(y_min, ends[k, 1]), max(y_max, ends[k, 1])
        first = max(0, math.floor((y_min - origin[1]) / cell))
        last = min(ny - 1, math.floor((y_max - origin[1]) / cell))
        for j in range(first, last + 1):
            x_min, x_max = _interval(ends, count, origin[1] + j * cell, origin[1] + (j + 1) * cell)
            begin = max(0.0, math.floor((x_min - origin[0]) / cell))
            end = min(nx - 1.0, math.floor((x_max - origin[0]) / cell))
            if begin <= end:
                for i in range(int(begin), int(end) + 1):
                    marked[i, j] = True


@njit(cache=True)
def _band(triangle, low, high, ends):
    """Corners of the part of a triangle between two heights, in order, into `ends`; returns their number."""
    if min(triangle[0, 2], triangle[1, 2], triangle[2, 2]) > high:
        return 0
    if max(triangle[0, 2], triangle[1, 2], triangle[2, 2]) < low:
        return 0
    above, count = np.empty((6, 3)), 0
    for k in range(3):
        count = _cut(triangle[k], triangle[(k + 1) % 3], low, 1.0, above, count)
    kept = 0
    for k in range(count):
        kept = _cut(above[k], above[(k + 1) % count], high, -1.0, ends, kept)
    return kept


@njit(cache=True)
def _cut(a, b, height, sign, into, count):
    """Appends what an edge a → b contributes to the side of a plane z = height where sign · z is larger."""
    da, db = sign * (a[2] - height), sign * (b[2] - height)
    if da >= 0:
        into[count] = a
        count += 1
    if (da > 0 and db < 0) or (da < 0 and db > 0):
        into[count] = a + da / (da - db) * (b - a)
        count += 1
    return count


@njit(cache=True)
def _interval(ends, count, low, high):
    """Smallest and largest x of a convex polygon's part between two values of y; (inf, −inf) where there is none."""
    x_min, x_max = math.inf, -math.inf
    for k in range(count):
        a, b = ends[k], ends[(k + 1) % count]
        y0, y1 = min(a[1], b[1]), max(a[1], b[1])
        if y1 < low or y0 > high:
            continue
        for bound in (low, high):
            y = min(max(bound, y0), y1)
            share = (y - a[1]) / (b[1] - a[1]) if y1 > y0 else 0.0
            x = a[0] + share * (b[0] - a[0])
            x_min, x_max = min(x_min, x), max(x_max, x)
            if y1 == y0:
                x_min, x_max = min(x_min, b[0]), max(x_max, b[0])
    return x_min, x_max
