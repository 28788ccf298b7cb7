"""Loops over grid cells: shortest paths by Dijkstra or A*, and carving of free space along rays."""

import heapq
import math

import numpy as np
from numba import njit

_DX = np.array([1, -1, 0, 0, 1, 1, -1, -1])
_DY = np.array([0, 0, 1, -1, 1, -1, 1, -1])


@njit(cache=True)
def shortest(cost, sources, target, limit):
    """Cheapest ways from any source cell over an 8-connected grid.

    cost (nx, ny): price per cell length, inf where blocked; a move costs the mean of its two cells times its length,
    and a diagonal move needs both cells beside it open. sources (k, 2). target (2,): stop there, guided by the straight
    distance at the lowest price; (−1, −1) fills the grid. limit: leave ways dearer than this.
    Returns distance (nx, ny) in cells and parent (nx, ny), the flat index of the cell before, −1 at sources.
    """
    nx, ny = cost.shape
    distance = np.full((nx, ny), np.inf)
    parent = np.full((nx, ny), -1, np.int64)
    closed = np.zeros((nx, ny), np.bool_)
    guided = target[0] >= 0
    cheapest = np.inf
    if guided:
        for x in range(nx):
            for y in range(ny):
                cheapest = min(cheapest, cost[x, y])
    queue = [(0.0, 0)]  # tells numba the type
    queue.clear()
    for k in range(len(sources)):
        x, y = sources[k, 0], sources[k, 1]
        if cost[x, y] < np.inf:
            distance[x, y] = 0.0
            heapq.heappush(queue, (0.0, x * ny + y))
    while len(queue) > 0:
        _, cell = heapq.heappop(queue)
        x, y = cell // ny, cell % ny
        if closed[x, y]:
            continue
        closed[x, y] = True
        if x == target[0] and y == target[1]:
            break
        for k in range(8):
            u, v = x + _DX[k], y + _DY[k]
            if u < 0 or v < 0 or u >= nx or v >= ny or closed[u, v] or cost[u, v] == np.inf:
                continue
            length = 1.0
            if k >= 4:
                if cost[u, y] == np.inf or cost[x, v] == np.inf:
                    continue
                length = math.sqrt(2.0)
            reached = distance[x, y] + 0.5 * length * (cost[x, y] + cost[u, v])
            if reached < distance[u, v] and reached <= limit:
                distance[u, v] = reached
                parent[u, v] = cell
                ahead = 0.0
                if guided:
                    ahead = cheapest * math.hypot(u - target[0], v - target[1])
                heapq.heappush(queue, (reached + ahead, u * ny + v))
    return distance, parent


@njit(cache=True)
def carve(seen_free, seen_hit, starts, ends, hits):
    """Mark the cells that rays cross (up to, not including, the end cell) and the end cells of rays that hit.

    Coordinates in cells. starts, ends (k, 2), hits (k,) bool. Exact traversal: every crossed cell once, in order.
    """
    nx, ny = seen_free.shape
    for k in range(len(ends)):
        origin_x, origin_y = starts[k, 0], starts[k, 1]
        dx, dy = ends[k, 0] - origin_x, ends[k, 1] - origin_y
        x, y = math.floor(origin_x), math.floor(origin_y)
        last_x, last_y = math.floor(ends[k, 0]), math.floor(ends[k, 1])
        step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
        next_x = ((x + 1 if dx > 0 else x) - origin_x) / dx if dx != 0 else np.inf
        next_y = ((y + 1 if dy > 0 else y) - origin_y) / dy if dy != 0 else np.inf
        wide_x = abs(1.0 / dx) if dx != 0 else np.inf
        wide_y = abs(1.0 / dy) if dy != 0 else np.inf
        while (x != last_x or y != last_y) and min(next_x, next_y) <= 1.0:
            if 0 <= x < nx and 0 <= y < ny:
                seen_free[x, y] = True
            if next_x < next_y:
                x += step_x
                next_x += wide_x
            else:
                y += step_y
                next_y += wide_y
        if 0 <= last_x < nx and 0 <= last_y < ny:
            if hits[k]:
                seen_hit[last_x, last_y] = True
            else:
                seen_free[last_x, last_y] = True
