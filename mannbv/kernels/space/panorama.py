"""One look in all directions: what a pixel would gain wherever it looked, on a cylinder around the camera's place.

Columns are equal angles, to the right from −π; rows are equal steps of the tangent of elevation, downwards. The image
of a splat is the one in a level pinhole turned straight at it, so `space` answers for its parameters. A camera's low
pass covers less of the cylinder the farther off its axis, hence images for several low passes, its places. The order by
range does not depend on the yaw, and depth along an axis is linear in it: six densities of depth serve every axis.
"""

import math

import numpy as np
from numba import njit, prange

from mannbv.kernels.arithmetic import KERNEL, PARALLEL, exp2
from mannbv.kernels.limits import MAX_BLEND
from mannbv.kernels.space.blend import GROUP, PIXELS, tile_centers
from mannbv.kernels.space.gather import GRAM, SHAPE
from mannbv.kernels.space.projection import (
    CHUNKS,
    COLUMNS,
    DEPTH,
    EVERYTHING,
    FAR,
    KAPPA,
    LOG_OPACITY,
    LXX,
    LXY,
    LYY,
    OPACITY,
    REACH,
    TERMS,
    U,
    V,
    look,
    response,
    workspace,
)
from mannbv.kernels.space.tiles import TILE, rows

CHANNELS = 6  # colour, and where the splat is from here
QUANTITIES = 7  # colour's density, and depth's xx, xy, xz, yy, yz, zz in the camera's axis
BIN = 4  # rows of pixels that share a row of the densities
# what a splat's answer is worth: a polynomial of fourth order in w, one of second order for the mean along x, y and z,
# and of the squared weight: colour, mean along x, y and z
QUARTIC = 15
WORTHS = QUARTIC + 3 * TERMS + 4


@njit(**KERNEL)
def _facing(s, means, position, rotation):
    """Turn a level camera straight at a splat: fills rotation (3, 3), returns its angle to the right of +x."""
    x, y = means[s, 0] - position[0], means[s, 1] - position[1]
    angle = math.atan2(y, x)
    cos, sin = math.cos(angle), math.sin(angle)
    rotation[0, 0], rotation[1, 0], rotation[2, 0] = sin, -cos, 0
    rotation[0, 1], rotation[1, 1], rotation[2, 1] = 0, 0, -1
    rotation[0, 2], rotation[1, 2], rotation[2, 2] = cos, sin, 0
    return -angle


@njit(**PARALLEL)
def project(means, log_scales, rotations, logits, position, lens, size, near, low_pass, cutoff):
    """The image of every splat for every place (places, n, COLUMNS); REACH is 0 where it does not touch the first.

    lens: radius of the cylinder [px], and the largest slopes of the Jacobian's ray along x and y. size: rows of the
    cylinder, row of the horizon. low_pass (places, 2) [px²], the largest first: across and down. DEPTH is the level
    distance.
    """
    n = len(means)
    F = means.dtype.type
    image = np.empty((len(low_pass), n, COLUMNS), means.dtype)
    for chunk in prange(CHUNKS):
        work, rotation = workspace(means), np.empty((3, 3), means.dtype)
        ray, spread = work[1], work[5]
        for s in range(n * chunk // CHUNKS, n * (chunk + 1) // CHUNKS):
            image[0, s, REACH] = F(0)
            opacity = F(1) / (F(1) + math.exp(-logits[s]))
            x, y, z = means[s, 0] - position[0], means[s, 1] - position[1], means[s, 2] - position[2]
            level = math.sqrt(x * x + y * y)
            if level <= near or opacity <= cutoff:
                continue
            right = _facing(s, means, position, rotation)
            look(s, means, log_scales, rotations, rotation, position, lens, work)
            across, slant, high, cross = F(0), F(0), F(0), F(0)
            for a in range(3):
                b, c = (a + 1) % 3, (a + 2) % 3
                across += spread[0, a] * spread[0, a]
                slant += spread[0, a] * spread[1, a]
                high += spread[1, a] * spread[1, a]
                area = spread[0, b] * spread[1, c] - spread[0, c] * spread[1, b]
                cross += area * area
            shown = math.log2(opacity)
            reach = shown - math.log2(cutoff) if cutoff > F(0) else F(EVERYTHING)
            u, v = lens[0] * (right + F(math.pi)), lens[0] * ray[1] + size[1]
            far = math.sqrt(reach * (high + low_pass[0, 1]) / F(KAPPA))
            if v + far < F(0) or v - far > size[0]:
                continue
            for place in range(len(low_pass)):
                seen = image[place, s]
                xx, yy = across + low_pass[place, 0], high + low_pass[place, 1]
                determinant = cross + low_pass[place, 0] * high + low_pass[place, 1] * xx
                seen[U], seen[V], seen[REACH] = u, v, reach
                seen[LXX] = math.sqrt(F(KAPPA) * yy / determinant)
                seen[LXY] = -slant * math.sqrt(F(KAPPA) / (yy * determinant))
                seen[LYY] = math.sqrt(F(KAPPA) / yy)
                seen[OPACITY], seen[LOG_OPACITY] = opacity, shown
                seen[DEPTH], seen[FAR] = level, level * level + z * z
    return image


@njit(**PARALLEL)
def worths(index, splats, means, log_scales, rotations, position, lens, worth, sigma_color, sigma_depth):
    """What the answers of splats (k, COLUMNS) are worth (k, WORTHS), given worth (n, 13) of the whole map."""
    F = means.dtype.type
    k = len(index)
    table = np.zeros((k, WORTHS), means.dtype)
    for chunk in prange(CHUNKS):
        work, terms, gram = (
            workspace(means),
            np.empty((SHAPE, TERMS), means.dtype),
            np.empty((TERMS, TERMS), means.dtype),
        )
        rotation = np.empty((3, 3), means.dtype)
        for i in range(k * chunk // CHUNKS, k * (chunk + 1) // CHUNKS):
            s = index[i]
            total = F(0)
            for a in range(SHAPE + 3):
                total += worth[s, a]
            if total == F(0):
                continue
            _facing(s, means, position, rotation)
            response(s, splats[i], means, log_scales, rotations, rotation, position, lens, work, terms)
            gram[:] = F(0)
            for a in range(SHAPE):
                for j in range(TERMS):
                    along = worth[s, a] * terms[a, j]
                    for m in range(TERMS):
                        gram[j, m] += along * terms[a, m]
            for j in range(TERMS):
                for m in range(TERMS):
                    table[i, GRAM[j, m]] += gram[j, m]
            for a in range(3):
                for j in range(TERMS):
                    table[i, QUARTIC + a * TERMS + j] = worth[s, a] * terms[a, j] / sigma_depth
                table[i, WORTHS - 3 + a] = worth[s, a] / (sigma_depth * sigma_depth)
                table[i, WORTHS - 4] += worth[s, SHAPE + a] / (sigma_color * sigma_color)
    return table


@njit(**KERNEL)
def _until_full(splats, pairs, begin, end, left, top, centers, floor, spans, through):
    """Where the last pair ends that a tile's pixels see; fills spans, the rows each pair touches. through: all 1."""
    F = splats.dtype.type
    at = begin
    while at < end:
        stop = min(end, at + GROUP)
        for pair in range(at, stop):
            s = pairs[pair]
            first, last = rows(splats[s], left, top)
            spans[pair - begin, 0], spans[pair - begin, 1] = first, last
            u, v = splats[s, U] - left, splats[s, V] - top
            a, b, c = splats[s, LXX], splats[s, LXY], splats[s, LYY]
            reach, shown = splats[s, REACH], splats[s, LOG_OPACITY]
            start, count = np.uint64(first * TILE), np.uint64((last - first) * TILE)
            for i in range(count):
                k = start + i
                dx, dy = centers[0, k] - u, centers[1, k] - v
                p, q = a * dx + b * dy, c * dy
                away = p * p + q * q
                rho = min(exp2(shown - away), F(MAX_BLEND))
                through[k] *= F(1) - (rho if away <= reach else F(0))
        at = stop
        clearest = F(0)
        for k in range(PIXELS):
            clearest = max(clearest, through[k])
        if clearest < floor:
            break
    return at


@njit(**PARALLEL)
def densities(splats, base, values, table, pairs, tiles, order, columns, height, floor):
    """What BIN pixels one above the other would gain, at every direction: (QUANTITIES, height / BIN, columns).

    values (k, CHANNELS) over their noise. base (k, COLUMNS): the splats for which table is what `worths` gives. pairs,
    tiles, order as in `blend`. columns and height are whole tiles.

    Splats are added from the back: one in front lets 1 − ρ of every later lift and weight through, so (1 − ρ)² of
    what had been gained.
    """
    F = splats.dtype.type
    across = columns // TILE
    field = np.empty((QUANTITIES, height // BIN, columns), splats.dtype)
    for turn in prange(len(order)):
        tile = order[turn]
        row, column = TILE * (tile // across), TILE * (tile % across)
        left, top, centers = F(column), F(row), tile_centers(splats)
        behind, gain = np.zeros((CHANNELS, PIXELS), splats.dtype), np.zeros((QUANTITIES, PIXELS), splats.dtype)
        begin, end = tiles[tile], tiles[tile + 1]
        spans, through = np.empty((end - begin, 2), np.uint8), np.ones(PIXELS, splats.dtype)
        full = _until_full(splats, pairs, begin, end, left, top, centers, floor, spans, through)
        for pair in range(full - 1, begin - 1, -1):
            s = pairs[pair]
            u, v = splats[s, U] - left, splats[s, V] - top
            a, b, c = splats[s, LXX], splats[s, LXY], splats[s, LYY]
            # L w is what a splat answers to: with L of the base, w is another
            f, e = a / base[s, LXX], c / base[s, LYY]
            d = (b - base[s, LXY] * f) / base[s, LYY]
            reach, shown = splats[s, REACH], splats[s, LOG_OPACITY]
            red, green, blue = values[s, 0], values[s, 1], values[s, 2]
            x, y, z = values[s, 3], values[s, 4], values[s, 5]
            t = table[s]
            w0, w1, w2, w3, w4, w5, w6, w7 = t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7]
            w8, w9, w10, w11, w12, w13, w14 = t[8], t[9], t[10], t[11], t[12], t[13], t[14]
            x0, x1, x2, x3, x4, x5 = t[15], t[16], t[17], t[18], t[19], t[20]
            y0, y1, y2, y3, y4, y5 = t[21], t[22], t[23], t[24], t[25], t[26]
            z0, z1, z2, z3, z4, z5 = t[27], t[28], t[29], t[30], t[31], t[32]
            direct, direct_x, direct_y, direct_z = t[33], t[34], t[35], t[36]
            first, last = spans[pair - begin]
            start, count = np.uint64(first * TILE), np.uint64((last - first) * TILE)
            for i in range(count):
                k = start + i
                dx, dy = centers[0, k] - u, centers[1, k] - v
                p, q = a * dx + b * dy, c * dy
                away = p * p + q * q
                raw = exp2(shown - away)
                rho = min(raw, F(MAX_BLEND)) if away <= reach else F(0)
                active = rho if raw <= F(MAX_BLEND) else F(0)
                # ∂value / ∂ρ: the splat instead of what lies behind it
                dr, dg, db = red - behind[0, k], green - behind[1, k], blue - behind[2, k]
                ax, ay, az = x - behind[3, k], y - behind[4, k], z - behind[5, k]
                behind[0, k] += rho * dr
                behind[1, k] += rho * dg
                behind[2, k] += rho * db
                behind[3, k] += rho * ax
                behind[4, k] += rho * ay
                behind[5, k] += rho * az
                p, q = f * p, d * p + e * q
                inner = w5 + p * (w8 + p * w12) + q * (w9 + p * w13 + q * w14)
                inner = w2 + p * (w4 + p * (w7 + p * w11)) + q * inner
                inner = w0 + p * (w1 + p * (w3 + p * (w6 + p * w10))) + q * inner
                shape, cross, square = active * active * inner, active * rho, rho * rho
                sx = cross * (x0 + p * (x1 + p * x3) + q * (x2 + p * x4 + q * x5))
                sy = cross * (y0 + p * (y1 + p * y3) + q * (y2 + p * y4 + q * y5))
                sz = cross * (z0 + p * (z1 + p * z3) + q * (z2 + p * z4 + q * z5))
                kept = (F(1) - rho) * (F(1) - rho)
                gain[0, k] = kept * gain[0, k] + (dr * dr + dg * dg + db * db) * shape + square * direct
                gain[1, k] = kept * gain[1, k] + ax * (ax * shape + F(2) * sx) + square * direct_x
                gain[2, k] = kept * gain[2, k] + ax * (ay * shape + sy) + ay * sx
                gain[3, k] = kept * gain[3, k] + ax * (az * shape + sz) + az * sx
                gain[4, k] = kept * gain[4, k] + ay * (ay * shape + F(2) * sy) + square * direct_y
                gain[5, k] = kept * gain[5, k] + ay * (az * shape + sz) + az * sy
                gain[6, k] = kept * gain[6, k] + az * (az * shape + F(2) * sz) + square * direct_z
        for quantity in range(QUANTITIES):
            for k in range(PIXELS // BIN):
                line, place = k // TILE, k % TILE
                total = F(0)
                for i in range(BIN):
                    total += gain[quantity, (BIN * line + i) * TILE + place]
                field[quantity, row // BIN + line, column + place] = total
    return field


@njit(**PARALLEL)
def pixels(columns, rows, horizon, radius, width, height, focal, pitch):
    """How many pixels of a pinhole a pixel of the cylinder stands for, a mean over BIN rows: (2, rows, columns).

    Column 0 is on its axis. The second is times the square of the cosine to the axis. pitch [rad]: upwards.
    """
    table = np.zeros((2, rows, columns))
    cos, sin, share = math.cos(pitch), math.sin(pitch), (focal / radius) ** 2 / BIN
    for row in prange(rows):
        for i in range(BIN):
            down = (BIN * row + i + 0.5 - horizon) / radius
            for step in range(columns * BIN):
                angle = (step + 0.5) / (BIN * radius)
                right, forward = math.sin(angle), math.cos(angle)
                ahead = forward * cos - down * sin
                if ahead <= 0.0:
                    continue
                below = down * cos + forward * sin
                if 2.0 * focal * abs(right) <= width * ahead and 2.0 * focal * abs(below) <= height * ahead:
                    count = share / (BIN * ahead**3)
                    table[0, row, step // BIN] += count
                    table[1, row, step // BIN] += count * ahead**2
    return table
