"""Loops over the segments of a flatland world: sight lines, textures, distances, point-in-polygon tests."""

import math

import numpy as np
from numba import njit

PLAIN, STRIPES, NOISE = 0, 1, 2  # kinds of texture


@njit(cache=True)
def cast(segments, origin, right, forward, slopes):
    """The first segment along each ray forward + slope · right from `origin`.

    segments (s, 4): x0, y0, x1, y1 [m]. slopes (n,): ascending, evenly spaced, n ≥ 2. A segment visits only the rays
    between its two ends, so the cost grows with s plus the rays covered, not with s · n.
    Returns depth (n,) along `forward` [m], inf where nothing is hit; index (n,) of the segment, −1 where none; and
    share (n,) in [0, 1], how far along the segment.
    """
    n = len(slopes)
    depth, index, share = np.full(n, np.inf), np.full(n, -1), np.zeros(n)
    first, spacing, tiny = slopes[0], slopes[1] - slopes[0], 1e-9
    for s in range(len(segments)):
        x0, y0 = segments[s, 0] - origin[0], segments[s, 1] - origin[1]
        x1, y1 = segments[s, 2] - origin[0], segments[s, 3] - origin[1]
        r0, f0 = x0 * right[0] + y0 * right[1], x0 * forward[0] + y0 * forward[1]
        r1, f1 = x1 * right[0] + y1 * right[1], x1 * forward[0] + y1 * forward[1]
        if f0 <= tiny and f1 <= tiny:
            continue
        dr, df = r1 - r0, f1 - f0
        left = _slope(r0, f0, r0, f0, dr, df, tiny)
        last = _slope(r1, f1, r0, f0, dr, df, tiny)
        if left > last:
            left, last = last, left
        # a millionth of a ray of tolerance: no sight line slips between two segments that share an end
        low = max(0.0, math.ceil((left - first) / spacing - 1e-6))
        high = min(n - 1.0, math.floor((last - first) / spacing + 1e-6))
        if not low <= high:
            continue
        for k in range(int(low), int(high) + 1):
            across = dr - slopes[k] * df
            if across == 0.0:
                continue
            t = min(1.0, max(0.0, (slopes[k] * f0 - r0) / across))
            f = f0 + t * df
            if tiny < f < depth[k]:
                depth[k], index[k], share[k] = f, s, t
    return depth, index, share


@njit(cache=True)
def _slope(r, f, r0, f0, dr, df, tiny):
    """Slope at which an end (r, f) of a segment is seen; where it lies behind, that of the crossing with f = tiny."""
    if f > tiny:
        return r / f
    return (r0 + (tiny - f0) / df * dr) / tiny


@njit(cache=True)
def _knot(i, j, channel):
    """A fixed pseudo-random number in [−1, 1] for an integer place and a channel."""
    mask = 0xFFFFFFFF
    h = ((i * 73856093) ^ (j * 19349663) ^ ((channel + 1) * 83492791)) & mask
    h = ((h ^ (h >> 15)) * 668265263) & mask
    h = ((h ^ (h >> 13)) * 374761393) & mask
    return 2.0 * (h ^ (h >> 16)) / mask - 1.0


@njit(cache=True)
def noise(x, y, channel):
    """Smooth value noise in [−1, 1] with knots at integer places."""
    i, j = math.floor(x), math.floor(y)
    u, v = x - i, y - j
    u, v = u * u * (3.0 - 2.0 * u), v * v * (3.0 - 2.0 * v)
    i, j = int(i), int(j)
    low = (1 - u) * _knot(i, j, channel) + u * _knot(i + 1, j, channel)
    high = (1 - u) * _knot(i, j + 1, channel) + u * _knot(i + 1, j + 1, channel)
    return (1 - v) * low + v * high


@njit(cache=True)
def noise_at(points, period):
    """Noise (k, 3), a value per colour channel, at points (k, 2) [m] with features of `period` [m]."""
    values = np.empty((len(points), 3))
    for k in range(len(points)):
        for c in range(3):
            values[k, c] = noise(points[k, 0] / period, points[k, 1] / period, c)
    return values


@njit(cache=True)
def shade(segments, colors, textures, index, share, rays_per_pixel):
    """Colours (n / rays_per_pixel, 3) of what `cast` hit, averaged over the rays of a pixel; black where nothing is.

    textures (s, 4): kind, period [m], contrast, phase [m]. Stripes run with the length along the segment, noise with
    the place in the world, so that it goes on around corners.
    """
    image = np.zeros((len(index) // rays_per_pixel, 3))
    for k in range(len(index)):
        s = index[k]
        if s < 0:
            continue
        x0, y0, x1, y1 = segments[s]
        x, y = x0 + share[k] * (x1 - x0), y0 + share[k] * (y1 - y0)
        kind, period, contrast, phase = textures[s]
        for c in range(3):
            wave = 0.0
            if kind == STRIPES:
                wave = math.sin(2 * math.pi * (math.hypot(x - x0, y - y0) + phase) / period)
            elif kind == NOISE:
                wave = noise((x + phase) / period, (y - phase) / period, c)
            value = colors[s, c] * (1.0 + contrast * wave)
            image[k // rays_per_pixel, c] += min(1.0, max(0.0, value)) / rays_per_pixel
    return image


@njit(cache=True)
def bins(segments, lower, size, shape):
    """Which segments touch each square bin: (offsets (nx · ny + 1,), items), bin by bin, by their bounding boxes."""
    nx, ny = shape
    offsets = np.zeros(nx * ny + 1, np.int64)
    items = np.zeros(0, np.int64)
    for turn in range(2):  # count, then fill
        for s in range(len(segments)):
            i0 = int((min(segments[s, 0], segments[s, 2]) - lower[0]) / size)
            i1 = int((max(segments[s, 0], segments[s, 2]) - lower[0]) / size)
            j0 = int((min(segments[s, 1], segments[s, 3]) - lower[1]) / size)
            j1 = int((max(segments[s, 1], segments[s, 3]) - lower[1]) / size)
            for i in range(i0, min(i1, nx - 1) + 1):
                for j in range(j0, min(j1, ny - 1) + 1):
                    if turn == 1:
                        items[offsets[i * ny + j]] = s
                    offsets[i * ny + j] += 1
        if turn == 0:
            total = 0
            for b in range(nx * ny):
                offsets[b], total = total, total + offsets[b]
            items = np.zeros(total, np.int64)
    for b in range(nx * ny, 0, -1):  # filling moved every offset to the next bin's
        offsets[b] = offsets[b - 1]
    offsets[0] = 0
    return offsets, items


@njit(cache=True)
def clearance(points, segments, lower, size, shape, offsets, items):
    """Distance (k,) [m] from points (k, 2) to the nearest segment, searching `bins` in growing square rings."""
    nx, ny = shape
    result = np.full(len(points), np.inf)
    for k in range(len(points)):
        x, y = points[k]
        i = math.floor((x - lower[0]) / size)
        j = math.floor((y - lower[1]) / size)
        # rings before `ring` do not touch the lattice; after ring r everything nearer than r bins has been seen
        ring = max(0, -i, -j, i - nx + 1, j - ny + 1)
        while result[k] > (ring - 1) * size and ring <= max(abs(i), abs(j), abs(nx - i), abs(ny - j)):
            for u in range(max(0, i - ring), min(nx - 1, i + ring) + 1):
                step = 1 if abs(u - i) == ring or ring == 0 else 2 * ring
                for v in range(j - ring, j + ring + 1, step):
                    if v < 0 or v >= ny:
                        continue
                    for m in range(offsets[u * ny + v], offsets[u * ny + v + 1]):
                        result[k] = min(result[k], _distance(x, y, segments[items[m]]))
            ring += 1
    return result


@njit(cache=True)
def _distance(x, y, segment):
    dx, dy = segment[2] - segment[0], segment[3] - segment[1]
    square = dx * dx + dy * dy
    t = ((x - segment[0]) * dx + (y - segment[1]) * dy) / square if square > 0 else 0.0
    t = min(1.0, max(0.0, t))
    return math.hypot(x - segment[0] - t * dx, y - segment[1] - t * dy)


@njit(cache=True)
def which_polygon(points, vertices, offsets):
    """Index (k,) of the first polygon that holds each point (k, 2), −1 where none; even-odd rule.

    Polygon p has the vertices offsets[p] … offsets[p + 1] − 1.
    """
    found = np.full(len(points), -1)
    for p in range(len(offsets) - 1):
        corners = vertices[offsets[p] : offsets[p + 1]]
        x_min, x_max = corners[:, 0].min(), corners[:, 0].max()
        y_min, y_max = corners[:, 1].min(), corners[:, 1].max()
        for k in range(len(points)):
            x, y = points[k]
            if found[k] >= 0 or x < x_min or x > x_max or y < y_min or y > y_max:
                continue
            odd = False
            for a in range(len(corners)):
                b = a - 1
                if (corners[a, 1] > y) != (corners[b, 1] > y):
                    part = (y - corners[a, 1]) / (corners[b, 1] - corners[a, 1])
                    if x < corners[a, 0] + part * (corners[b, 0] - corners[a, 0]):
                        odd = not odd
            if odd:
                found[k] = p
    return found
