"""Compositing tile by tile, Eq. (1): the image, its gradient, and the moments that information is made of.

Splats are the outer loop and a tile's pixels, in one flat row, the inner one, so that the processor handles several
pixels at once. Every pair has a row of its own in the buffers, summed splat by splat afterwards: no races, and the same
bits whatever the number of threads.
"""

import numpy as np
from numba import njit, prange

from mannbv.kernels.arithmetic import KERNEL, PARALLEL, exp2
from mannbv.kernels.limits import MAX_BLEND
from mannbv.kernels.space.projection import LOG_OPACITY, LXX, LXY, LYY, REACH, TERMS, U, V
from mannbv.kernels.space.tiles import TILE, rows

PIXELS = TILE * TILE
CHANNELS = 4  # colour and depth
GROUP = 16  # splats between two looks whether a tile is full
SUMS = TERMS + CHANNELS  # of a pair: Σ push · (1, p, q, p², pq, q²), Σ weight · slope of each channel
MOMENTS = 15 + TERMS + 1  # of a pair: energy by p and q to the fourth order, cross to the second, Σ weight²


@njit(**KERNEL)
def tile_centers(like):
    """Pixel centres of a tile from its corner, (2, PIXELS) [px]."""
    centers = np.empty((2, PIXELS), like.dtype)
    for k in range(PIXELS):
        centers[0, k], centers[1, k] = k % TILE + 0.5, k // TILE + 0.5
    return centers


@njit(**KERNEL)
def _composite(splats, values, pairs, begin, end, left, top, centers, floor, spans, sheet):
    """Fill sheet (CHANNELS + 1, PIXELS): what is seen, and the transmittance left; returns where the tile was full."""
    F = splats.dtype.type
    sheet[:CHANNELS] = F(0)
    sheet[CHANNELS] = F(1)
    at = begin
    while at < end:
        stop = min(end, at + GROUP)
        for pair in range(at, stop):
            s = pairs[pair]
            first, last = rows(splats[s], left, top)
            spans[pair, 0], spans[pair, 1] = first, last
            u, v = splats[s, U] - left, splats[s, V] - top
            a, b, c = splats[s, LXX], splats[s, LXY], splats[s, LYY]
            reach, shown = splats[s, REACH], splats[s, LOG_OPACITY]
            red, green, blue, depth = values[s, 0], values[s, 1], values[s, 2], values[s, 3]
            start, count = np.uint64(first * TILE), np.uint64((last - first) * TILE)
            for i in range(count):
                k = start + i
                dx, dy = centers[0, k] - u, centers[1, k] - v
                p, q = a * dx + b * dy, c * dy
                away = p * p + q * q
                rho = min(exp2(shown - away), F(MAX_BLEND))
                through = sheet[4, k]
                weight = rho * through if (away <= reach and through >= floor) else F(0)
                sheet[0, k] += weight * red
                sheet[1, k] += weight * green
                sheet[2, k] += weight * blue
                sheet[3, k] += weight * depth
                sheet[4, k] = through - weight
        at = stop
        clearest = F(0)
        for k in range(PIXELS):
            clearest = max(clearest, sheet[4, k])
        if clearest < floor:
            break
    return at


@njit(**PARALLEL)
def composite(splats, values, pairs, tiles, order, width, height, floor):
    """The image (CHANNELS + 1, height, width): Σ value · ρ Π(1 − ρ) of values (k, CHANNELS), and what is left.

    order (t,): the tiles, the longest first. Also returns for each tile where its last useful pair ends (t,), and for
    each pair the rows of its tile that it touches (m, 2).
    """
    across = -(-width // TILE)
    image = np.empty((CHANNELS + 1, height, width), splats.dtype)
    full, spans = np.empty(len(order), np.int64), np.empty((len(pairs), 2), np.uint8)
    for turn in prange(len(order)):
        tile = order[turn]
        row, column = TILE * (tile // across), TILE * (tile % across)
        sheet = np.empty((CHANNELS + 1, PIXELS), splats.dtype)
        left, top = splats.dtype.type(column), splats.dtype.type(row)
        full[tile] = _composite(
            splats, values, pairs, tiles[tile], tiles[tile + 1], left, top, tile_centers(splats), floor, spans, sheet
        )
        for y in range(min(TILE, height - row)):
            for x in range(min(TILE, width - column)):
                for channel in range(CHANNELS + 1):
                    image[channel, row + y, column + x] = sheet[channel, y * TILE + x]
    return image, full, spans


@njit(**KERNEL)
def load_tile(picture, row, column, sheet):
    """Copy a tile of a picture (c, height, width) to a sheet (c, PIXELS); beyond the border stands 0."""
    channels, height, width = picture.shape
    for channel in range(channels):
        for k in range(PIXELS):
            sheet[channel, k] = 0
        for y in range(min(TILE, height - row)):
            for x in range(min(TILE, width - column)):
                sheet[channel, y * TILE + x] = picture[channel, row + y, column + x]


@njit(**KERNEL)
def light_tile(height, width, row, column, state):
    """Fill state (PIXELS,) with the transmittance before the first splat: 1 in the image, 0 beyond its border."""
    for k in range(PIXELS):
        state[k] = row + k // TILE < height and column + k % TILE < width


@njit(**PARALLEL)
def backward(splats, values, pairs, tiles, full, spans, order, image, slopes, floor):
    """SUMS of every pair (m, SUMS) for slopes (CHANNELS + 1, height, width) of colour, depth and opacity."""
    F = splats.dtype.type
    height, width = image.shape[1:]
    across = -(-width // TILE)
    sums = np.empty((len(pairs), SUMS), splats.dtype)
    for turn in prange(len(order)):
        tile = order[turn]
        row, column = TILE * (tile // across), TILE * (tile % across)
        left, top, centers = F(column), F(row), tile_centers(splats)
        slope, seen = np.empty((CHANNELS + 1, PIXELS), splats.dtype), np.empty((CHANNELS + 1, PIXELS), splats.dtype)
        state = np.zeros((2, PIXELS), splats.dtype)  # transmittance; what this and later splats bring, times the slopes
        load_tile(slopes, row, column, slope)
        load_tile(image, row, column, seen)
        for y in range(min(TILE, height - row)):
            for x in range(min(TILE, width - column)):
                k = y * TILE + x
                state[0, k], state[1, k] = F(1), slope[4, k] * (F(1) - seen[4, k])
                for channel in range(CHANNELS):
                    state[1, k] += slope[channel, k] * seen[channel, k]
        for pair in range(tiles[tile], full[tile]):
            s = pairs[pair]
            u, v = splats[s, U] - left, splats[s, V] - top
            a, b, c = splats[s, LXX], splats[s, LXY], splats[s, LYY]
            reach, shown = splats[s, REACH], splats[s, LOG_OPACITY]
            red, green, blue, depth = values[s, 0], values[s, 1], values[s, 2], values[s, 3]
            start, count = np.uint64(spans[pair, 0] * TILE), np.uint64((spans[pair, 1] - spans[pair, 0]) * TILE)
            m, mp, mq, mpp, mpq, mqq = F(0), F(0), F(0), F(0), F(0), F(0)
            to_red, to_green, to_blue, to_depth = F(0), F(0), F(0), F(0)
            for i in range(count):
                k = start + i
                dx, dy = centers[0, k] - u, centers[1, k] - v
                p, q = a * dx + b * dy, c * dy
                away = p * p + q * q
                raw = exp2(shown - away)
                through = state[0, k]
                rho = min(raw, F(MAX_BLEND)) if (away <= reach and through >= floor) else F(0)
                weight = rho * through
                to_red += weight * slope[0, k]
                to_green += weight * slope[1, k]
                to_blue += weight * slope[2, k]
                to_depth += weight * slope[3, k]
                worth = red * slope[0, k] + green * slope[1, k] + blue * slope[2, k] + depth * slope[3, k] + slope[4, k]
                behind = state[1, k] - weight * worth
                state[0, k], state[1, k] = through - weight, behind
                push = rho * (through * worth - behind / (F(1) - rho)) if raw <= F(MAX_BLEND) else F(0)
                pp, pq = push * p, push * q
                m += push
                mp += pp
                mq += pq
                mpp += pp * p
                mpq += pp * q
                mqq += pq * q
            sums[pair, 0], sums[pair, 1], sums[pair, 2] = m, mp, mq
            sums[pair, 3], sums[pair, 4], sums[pair, 5] = mpp, mpq, mqq
            sums[pair, 6], sums[pair, 7], sums[pair, 8], sums[pair, 9] = to_red, to_green, to_blue, to_depth
        sums[full[tile] : tiles[tile + 1]] = F(0)
    return sums


@njit(**PARALLEL)
def moments(splats, values, pairs, tiles, full, spans, order, image, counts, floor):
    """MOMENTS of every pair (m, MOMENTS): energy by (p, q) to the fourth order, cross to the second, Σ weight².

    Energy is Σ_channels (∂value / ∂ log ρ)²; cross is depth's ∂value / ∂ log ρ times the weight. values are over their
    noise, and image is their composite. counts (k,): the splats that are asked for.
    """
    F = splats.dtype.type
    height, width = image.shape[1:]
    across = -(-width // TILE)
    table = np.empty((len(pairs), MOMENTS), splats.dtype)
    for turn in prange(len(order)):
        tile = order[turn]
        row, column = TILE * (tile // across), TILE * (tile % across)
        left, top, centers = F(column), F(row), tile_centers(splats)
        behind, state = np.empty((CHANNELS + 1, PIXELS), splats.dtype), np.empty(PIXELS, splats.dtype)
        load_tile(image, row, column, behind)
        light_tile(height, width, row, column, state)
        for pair in range(tiles[tile], full[tile]):
            s = pairs[pair]
            u, v = splats[s, U] - left, splats[s, V] - top
            a, b, c = splats[s, LXX], splats[s, LXY], splats[s, LYY]
            reach, shown = splats[s, REACH], splats[s, LOG_OPACITY]
            red, green, blue, depth = values[s, 0], values[s, 1], values[s, 2], values[s, 3]
            start, count = np.uint64(spans[pair, 0] * TILE), np.uint64((spans[pair, 1] - spans[pair, 0]) * TILE)
            e00, e10, e01, e20, e11, e02 = F(0), F(0), F(0), F(0), F(0), F(0)
            e30, e21, e12, e03 = F(0), F(0), F(0), F(0)
            e40, e31, e22, e13, e04 = F(0), F(0), F(0), F(0), F(0)
            c00, c10, c01, c20, c11, c02, squares = F(0), F(0), F(0), F(0), F(0), F(0), F(0)
            for i in range(count):
                k = start + i
                dx, dy = centers[0, k] - u, centers[1, k] - v
                p, q = a * dx + b * dy, c * dy
                away = p * p + q * q
                raw = exp2(shown - away)
                through = state[k]
                rho = min(raw, F(MAX_BLEND)) if (away <= reach and through >= floor) else F(0)
                weight = rho * through
                left_over = F(1) / (F(1) - rho)
                r, g = behind[0, k] - weight * red, behind[1, k] - weight * green
                h, z = behind[2, k] - weight * blue, behind[3, k] - weight * depth
                behind[0, k], behind[1, k], behind[2, k], behind[3, k] = r, g, h, z
                state[k] = through - weight
                r, g = through * red - r * left_over, through * green - g * left_over
                h, z = through * blue - h * left_over, through * depth - z * left_over
                active = rho if raw <= F(MAX_BLEND) else F(0)
                e, f = (r * r + g * g + h * h + z * z) * active * active, z * active * weight
                squares += weight * weight
                ep, eq, fp, fq = e * p, e * q, f * p, f * q
                epp, epq, eqq = ep * p, ep * q, eq * q
                eppp, eppq, epqq, eqqq = epp * p, epp * q, eqq * p, eqq * q
                e00 += e
                e10 += ep
                e01 += eq
                e20 += epp
                e11 += epq
                e02 += eqq
                e30 += eppp
                e21 += eppq
                e12 += epqq
                e03 += eqqq
                e40 += eppp * p
                e31 += eppp * q
                e22 += eppq * q
                e13 += eqqq * p
                e04 += eqqq * q
                c00 += f
                c10 += fp
                c01 += fq
                c20 += fp * p
                c11 += fp * q
                c02 += fq * q
            table[pair] = F(0)
            if counts[s]:
                table[pair, 0], table[pair, 1], table[pair, 2] = e00, e10, e01
                table[pair, 3], table[pair, 4], table[pair, 5] = e20, e11, e02
                table[pair, 6], table[pair, 7], table[pair, 8], table[pair, 9] = e30, e21, e12, e03
                table[pair, 10], table[pair, 11], table[pair, 12], table[pair, 13] = e40, e31, e22, e13
                table[pair, 14], table[pair, 15], table[pair, 16], table[pair, 17] = e04, c00, c10, c01
                table[pair, 18], table[pair, 19], table[pair, 20], table[pair, 21] = c20, c11, c02, squares
        table[full[tile] : tiles[tile + 1]] = F(0)
    return table
