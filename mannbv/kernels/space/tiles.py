"""Which splats touch which tiles of an image, exactly: ellipses against squares, and against rows of pixels.

A pair is one splat in one tile. The pairs of a tile lie together, front to back; `places` finds those of a splat.
"""

import math

import numpy as np
from numba import njit, prange

from mannbv.kernels.arithmetic import KERNEL, PARALLEL
from mannbv.kernels.space.projection import CHUNKS, LXX, LXY, LYY, REACH, U, V

TILE = 16  # [px]
SLACK = 1e-3  # [px] added to an ellipse's ends against rounding


@njit(**KERNEL)
def _columns(splat, low, high):
    """The range of δx on a splat's ellipse w·w ≤ reach between δy = low and δy = high; empty if the first is larger."""
    F = splat.dtype.type
    a, b, c, reach = splat[LXX], splat[LXY], splat[LYY], splat[REACH]
    top = math.sqrt(reach) / c
    if low > top or high < -top:
        return F(1), F(-1)
    low, high = max(low, -top), min(high, top)
    # x = (−b y ± √(reach − c² y²)) / a bends one way: its end is at the peak, or where the slab cuts it off
    peak = b / c * math.sqrt(reach / (b * b + c * c))
    y = min(max(-peak, low), high)
    right = (math.sqrt(max(F(0), reach - c * c * y * y)) - b * y) / a + F(SLACK)
    y = min(max(peak, low), high)
    left = (-math.sqrt(max(F(0), reach - c * c * y * y)) - b * y) / a - F(SLACK)
    return left, right


@njit(**KERNEL)
def _rows(splat, low, high):
    """The range of δy on a splat's ellipse between δx = low and δx = high; empty if the first is larger."""
    F = splat.dtype.type
    a, b, c, reach = splat[LXX], splat[LXY], splat[LYY], splat[REACH]
    square = b * b + c * c
    side = math.sqrt(reach * square) / (a * c)
    if low > side or high < -side:
        return F(1), F(-1)
    low, high = max(low, -side), min(high, side)
    # y = (−a b x ± √(reach · square − a² c² x²)) / square
    peak = b * math.sqrt(reach) / (a * c)
    x = min(max(-peak, low), high)
    down = (math.sqrt(max(F(0), reach * square - (a * c * x) ** 2)) - a * b * x) / square + F(SLACK)
    x = min(max(peak, low), high)
    up = (-math.sqrt(max(F(0), reach * square - (a * c * x) ** 2)) - a * b * x) / square - F(SLACK)
    return up, down


@njit(**KERNEL)
def rows(splat, left, top):
    """First and one past the last row of a tile with its corner at (left, top) [px] that the splat touches."""
    F = splat.dtype.type
    first = left + F(0.5) - splat[U]
    up, down = _rows(splat, first, first + F(TILE - 1))
    if up > down:
        return 0, 0
    offset = splat[V] - top - F(0.5)
    above = max(0, math.ceil(offset + up))
    return above, max(above, min(TILE, math.floor(offset + down) + 1))


@njit(**KERNEL)
def _tile_rows(splat, tiles_down):
    """First and one past the last row of tiles that the splat touches."""
    F = splat.dtype.type
    high = math.sqrt(splat[REACH]) / splat[LYY] + F(SLACK)
    first = math.floor((splat[V] - high - F(0.5)) / F(TILE))
    last = math.floor((splat[V] + high - F(0.5)) / F(TILE))
    return max(0, first), min(tiles_down, last + 1)


@njit(**KERNEL)
def _tile_columns(splat, tile_row, tiles_across):
    """First and one past the last tile of a row of tiles that the splat touches."""
    F = splat.dtype.type
    first = F(tile_row * TILE) + F(0.5) - splat[V]
    left, right = _columns(splat, first, first + F(TILE - 1))
    if left > right:
        return 0, 0
    begin = max(0, math.floor((splat[U] + left - F(0.5)) / F(TILE)))
    return begin, max(begin, min(tiles_across, math.floor((splat[U] + right - F(0.5)) / F(TILE)) + 1))


@njit(**PARALLEL)
def _count(splats, across, down):
    """Pairs of each tile in each chunk of splats (CHUNKS, tiles), and of each splat (k,)."""
    k = len(splats)
    by_tile, by_splat = np.zeros((CHUNKS, across * down), np.int64), np.zeros(k, np.int64)
    for chunk in prange(CHUNKS):
        for s in range(k * chunk // CHUNKS, k * (chunk + 1) // CHUNKS):
            first, last = _tile_rows(splats[s], down)
            for row in range(first, last):
                begin, end = _tile_columns(splats[s], row, across)
                by_splat[s] += end - begin
                for tile in range(row * across + begin, row * across + end):
                    by_tile[chunk, tile] += 1
    return by_tile, by_splat


@njit(**PARALLEL)
def _fill(splats, across, down, free, starts, total):
    """Put every pair in its place: free (CHUNKS, tiles), the first free place of each chunk in each tile."""
    k = len(splats)
    pairs, places = np.empty(total, np.int32), np.empty(total, np.int64)
    for chunk in prange(CHUNKS):
        for s in range(k * chunk // CHUNKS, k * (chunk + 1) // CHUNKS):
            place = starts[s]
            first, last = _tile_rows(splats[s], down)
            for row in range(first, last):
                begin, end = _tile_columns(splats[s], row, across)
                for tile in range(row * across + begin, row * across + end):
                    pairs[free[chunk, tile]] = s
                    places[place] = free[chunk, tile]
                    free[chunk, tile] += 1
                    place += 1
    return pairs, places


def sort(splats, width: int, height: int):
    """The pairs of splats (k, COLUMNS), front to back, with the tiles of an image.

    Returns pairs (m,), the splat of each pair; tiles (t + 1,), where each tile's pairs begin; places (m,), the pairs
    of each splat in turn, and starts (k + 1,), where in `places` those of each splat begin.
    """
    across, down = -(-width // TILE), -(-height // TILE)
    by_tile, by_splat = _count(splats, across, down)
    # a tile's pairs in the order of chunks, so in the order of splats
    ends = np.cumsum(by_tile.T.reshape(-1)).reshape(by_tile.T.shape)
    free = np.ascontiguousarray((ends - by_tile.T).T)
    tiles = np.concatenate([[0], ends[:, -1]])
    starts = np.concatenate([[0], np.cumsum(by_splat)])
    pairs, places = _fill(splats, across, down, free, starts, int(starts[-1]))
    return pairs, tiles, places, starts
