"""What whole blocks of information need beyond their diagonal: how a splat's colours and its shape go together.

Apart from `blend` and `gather`, so that the diagonal alone costs no more than it must.
"""

import numpy as np
from numba import njit, prange

from mannbv.kernels.arithmetic import PARALLEL, exp2
from mannbv.kernels.limits import MAX_BLEND
from mannbv.kernels.space.blend import CHANNELS, MOMENTS, PIXELS, light_tile, load_tile, tile_centers
from mannbv.kernels.space.gather import SHAPE
from mannbv.kernels.space.projection import (
    CHUNKS,
    LOG_OPACITY,
    LXX,
    LXY,
    LYY,
    REACH,
    TERMS,
    U,
    V,
    response,
    workspace,
)
from mannbv.kernels.space.tiles import TILE

COLORS = 3
CROSSES = COLORS * TERMS  # of a pair: per colour Σ lift · active · weight · (1, p, q, p², pq, q²)


@njit(**PARALLEL)
def crosses(splats, values, pairs, tiles, full, spans, order, image, counts, floor):
    """CROSSES of every pair (m, CROSSES); arguments as in `blend.moments`, which has those of depth."""
    F = splats.dtype.type
    height, width = image.shape[1:]
    across = -(-width // TILE)
    table = np.empty((len(pairs), CROSSES), splats.dtype)
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
            red, green, blue = values[s, 0], values[s, 1], values[s, 2]
            start, count = np.uint64(spans[pair, 0] * TILE), np.uint64((spans[pair, 1] - spans[pair, 0]) * TILE)
            r0, r1, r2, r3, r4, r5 = F(0), F(0), F(0), F(0), F(0), F(0)
            g0, g1, g2, g3, g4, g5 = F(0), F(0), F(0), F(0), F(0), F(0)
            h0, h1, h2, h3, h4, h5 = F(0), F(0), F(0), F(0), F(0), F(0)
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
                r, g, h = behind[0, k] - weight * red, behind[1, k] - weight * green, behind[2, k] - weight * blue
                behind[0, k], behind[1, k], behind[2, k] = r, g, h
                state[k] = through - weight
                active = rho * weight if raw <= F(MAX_BLEND) else F(0)
                r = active * (through * red - r * left_over)
                g = active * (through * green - g * left_over)
                h = active * (through * blue - h * left_over)
                pp, pq, qq = p * p, p * q, q * q
                r0 += r
                r1 += r * p
                r2 += r * q
                r3 += r * pp
                r4 += r * pq
                r5 += r * qq
                g0 += g
                g1 += g * p
                g2 += g * q
                g3 += g * pp
                g4 += g * pq
                g5 += g * qq
                h0 += h
                h1 += h * p
                h2 += h * q
                h3 += h * pp
                h4 += h * pq
                h5 += h * qq
            table[pair] = F(0)
            if counts[s]:
                table[pair, 0], table[pair, 1], table[pair, 2] = r0, r1, r2
                table[pair, 3], table[pair, 4], table[pair, 5] = r3, r4, r5
                table[pair, 6], table[pair, 7], table[pair, 8] = g0, g1, g2
                table[pair, 9], table[pair, 10], table[pair, 11] = g3, g4, g5
                table[pair, 12], table[pair, 13], table[pair, 14] = h0, h1, h2
                table[pair, 15], table[pair, 16], table[pair, 17] = h3, h4, h5
        table[full[tile] : tiles[tile + 1]] = F(0)
    return table


@njit(**PARALLEL)
def totals(
    moments, cross, places, starts, index, chosen, splats, means, log_scales, rotations, rotation, position, lens
):
    """From pairs to splats: sums (c, MOMENTS + CROSSES) and responses (c, SHAPE, TERMS) of the `chosen` (c,) seen."""
    c = len(chosen)
    sums = np.zeros((c, MOMENTS + CROSSES), means.dtype)
    terms = np.empty((c, SHAPE, TERMS), means.dtype)
    for chunk in prange(CHUNKS):
        work = workspace(means)
        for k in range(c * chunk // CHUNKS, c * (chunk + 1) // CHUNKS):
            i = chosen[k]
            for place in range(starts[i], starts[i + 1]):
                for j in range(MOMENTS):
                    sums[k, j] += moments[places[place], j]
                for j in range(CROSSES):
                    sums[k, MOMENTS + j] += cross[places[place], j]
            response(index[i], splats[i], means, log_scales, rotations, rotation, position, lens, work, terms[k])
    return sums, terms
