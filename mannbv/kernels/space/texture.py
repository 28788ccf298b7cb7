"""What a ray sees on textured triangles: the exact hit, and its colour from an image no finer than the pixel."""

import math

import numpy as np
from numba import njit


@njit(cache=True)
def depths(origins, directions, corners, faces):
    """Depth (k,), in lengths of the direction, at which ray k meets the plane of its face; inf where the face is −1.

    origins, directions (k, 3); corners (f, 3, 3). Where a triangle is seen on edge its plane may be met anywhere: the
    depth is then kept within the triangle's own.
    """
    found = np.full(len(faces), np.inf)
    for k in range(len(faces)):
        if faces[k] >= 0:
            triangle, least, most, square = corners[faces[k]], np.inf, -np.inf, 0.0
            for c in range(3):
                square += directions[k, c] ** 2
            for corner in range(3):
                along = 0.0
                for c in range(3):
                    along += (triangle[corner, c] - origins[k, c]) * directions[k, c]
                least, most = min(least, along / square), max(most, along / square)
            found[k] = min(max(_meet(origins[k], directions[k], triangle)[0], least), most)
    return found


@njit(cache=True)
def _meet(origin, direction, triangle):
    """(depth, u, v) of a ray on a triangle, the point being (1 − u − v) a + u b + v c: Möller and Trumbore (1997)."""
    ax, ay, az = triangle[0]
    bx, by, bz = triangle[1, 0] - ax, triangle[1, 1] - ay, triangle[1, 2] - az
    cx, cy, cz = triangle[2, 0] - ax, triangle[2, 1] - ay, triangle[2, 2] - az
    dx, dy, dz = direction
    px, py, pz = dy * cz - dz * cy, dz * cx - dx * cz, dx * cy - dy * cx
    det = bx * px + by * py + bz * pz
    if det == 0.0:
        square = dx * dx + dy * dy + dz * dz
        return ((ax - origin[0]) * dx + (ay - origin[1]) * dy + (az - origin[2]) * dz) / square, 0.0, 0.0
    tx, ty, tz = origin[0] - ax, origin[1] - ay, origin[2] - az
    u = (tx * px + ty * py + tz * pz) / det
    qx, qy, qz = ty * bz - tz * by, tz * bx - tx * bz, tx * by - ty * bx
    v = (dx * qx + dy * qy + dz * qz) / det
    return (cx * qx + cy * qy + cz * qz) / det, u, v


@njit(cache=True)
def shade(origin, directions, faces, corners, colors, uv, image, wrapped, texel, levels, texels, spread):
    """Colours (k, 3) in [0, 1] of what rays from `origin` (3,) hit; black where the face is −1.

    colors, uv: of each corner (f, 3, ·). image (f,): −1 for none. wrapped (f,): the image repeats. texel (f,): edge of
    a texel on the face [m]. levels (images, L, 3): offset, width, height of each half-size copy in `texels` (t, 3)
    uint8. spread: width of a pixel at depth 1 along the axis. Two copies, and four texels of each, are mixed, so that
    detail finer than a pixel is averaged: Williams (1983).
    """
    seen = np.zeros((len(faces), 3))
    for k in range(len(faces)):
        f = faces[k]
        if f < 0:
            continue
        depth, u, v = _meet(origin, directions[k], corners[f])
        w = 1.0 - u - v
        for c in range(3):
            seen[k, c] = w * colors[f, 0, c] + u * colors[f, 1, c] + v * colors[f, 2, c]
        i = image[f]
        if i >= 0:
            x = w * uv[f, 0, 0] + u * uv[f, 1, 0] + v * uv[f, 2, 0]
            y = 1.0 - (w * uv[f, 0, 1] + u * uv[f, 1, 1] + v * uv[f, 2, 1])
            most = levels.shape[1] - 1.0
            fine = min(max(math.log2(max(depth * spread / texel[f], 1e-9)), 0.0), most)
            low = int(fine)
            part = fine - low
            red, green, blue = _texel(x, y, wrapped[f], levels[i, low], texels)
            if part > 0.0:
                next_red, next_green, next_blue = _texel(x, y, wrapped[f], levels[i, low + 1], texels)
                red += part * (next_red - red)
                green += part * (next_green - green)
                blue += part * (next_blue - blue)
            seen[k, 0] *= red
            seen[k, 1] *= green
            seen[k, 2] *= blue
        for c in range(3):
            seen[k, c] = min(max(seen[k, c], 0.0), 1.0)
    return seen


@njit(cache=True)
def _texel(x, y, wrapped, level, texels):
    """The colour at (x, y), the image's edges being 0 and 1 and y downwards, between the four texels around."""
    offset, width, height = level
    x, y = x * width - 0.5, y * height - 0.5
    column, row = math.floor(x), math.floor(y)
    right, lower = x - column, y - row
    red, green, blue = 0.0, 0.0, 0.0
    for a in range(2):
        for b in range(2):
            r, c = int(row) + a, int(column) + b
            r = r % height if wrapped else min(max(r, 0), height - 1)
            c = c % width if wrapped else min(max(c, 0), width - 1)
            share = (lower if a else 1.0 - lower) * (right if b else 1.0 - right) / 255.0
            place = offset + r * width + c
            red += share * texels[place, 0]
            green += share * texels[place, 1]
            blue += share * texels[place, 2]
    return red, green, blue
