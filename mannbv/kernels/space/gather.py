"""From pairs to splats: gradients and information, through each splat's response (`space.response`)."""

import numpy as np
from numba import njit, prange

from mannbv.kernels.arithmetic import PARALLEL
from mannbv.kernels.space.blend import MOMENTS, SUMS
from mannbv.kernels.space.projection import CHUNKS, TERMS, response, workspace

SHAPE = 10  # parameters through which a splat's blend moves: mean, log-scales, rotation, logit
PARAMETERS = SHAPE + 3  # and its colour

_ORDERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]  # of the polynomial's terms, in p and q
_PLACE = {(a - b, b): a * (a + 1) // 2 + b for a in range(5) for b in range(a + 1)}  # of a moment among MOMENTS
GRAM = np.array([[_PLACE[i[0] + j[0], i[1] + j[1]] for j in _ORDERS] for i in _ORDERS])


@njit(**PARALLEL)
def gradient(sums, places, starts, index, splats, means, log_scales, rotations, rotation, position, lens):
    """The gradient (n, PARAMETERS) from SUMS: mean, log-scales, rotation in the body's tangent, logit, colour."""
    F = means.dtype.type
    grads = np.zeros((len(means), PARAMETERS), means.dtype)
    k = len(index)
    for chunk in prange(CHUNKS):
        work, terms, total = workspace(means), np.empty((SHAPE, TERMS), means.dtype), np.empty(SUMS, means.dtype)
        for i in range(k * chunk // CHUNKS, k * (chunk + 1) // CHUNKS):
            total[:] = F(0)
            for place in range(starts[i], starts[i + 1]):
                for j in range(SUMS):
                    total[j] += sums[places[place], j]
            s = index[i]
            response(s, splats[i], means, log_scales, rotations, rotation, position, lens, work, terms)
            for a in range(SHAPE):
                slope = F(0)
                for j in range(TERMS):
                    slope += terms[a, j] * total[j]
                grads[s, a] = slope
            for a in range(3):
                grads[s, a] += rotation[a, 2] * total[TERMS + 3]  # nearer or farther shows in the depth itself
                grads[s, SHAPE + a] = total[TERMS + a]
    return grads


@njit(**PARALLEL)
def information(
    table, places, starts, index, splats, n, means, log_scales, rotations, rotation, position, lens, sigma_color,
    sigma_depth,
):  # fmt: skip
    """diag(JᵀJ) (n, PARAMETERS) of the first n splats from MOMENTS, one splat's small Gram matrix at a time."""
    F = means.dtype.type
    rows = np.zeros((n, PARAMETERS), means.dtype)
    k = len(index)
    for chunk in prange(CHUNKS):
        work, terms, total = workspace(means), np.empty((SHAPE, TERMS), means.dtype), np.empty(MOMENTS, means.dtype)
        gram = np.empty((TERMS, TERMS), means.dtype)
        for i in range(k * chunk // CHUNKS, k * (chunk + 1) // CHUNKS):
            s = index[i]
            if s >= n:
                continue
            total[:] = F(0)
            for place in range(starts[i], starts[i + 1]):
                for j in range(MOMENTS):
                    total[j] += table[places[place], j]
            response(s, splats[i], means, log_scales, rotations, rotation, position, lens, work, terms)
            squares = total[MOMENTS - 1]
            for j in range(TERMS):
                for m in range(TERMS):
                    gram[j, m] = total[GRAM[j, m]]
            for a in range(SHAPE):
                square = F(0)
                for j in range(TERMS):
                    along = F(0)
                    for m in range(TERMS):
                        along += gram[j, m] * terms[a, m]
                    square += terms[a, j] * along
                rows[s, a] = max(square, F(0))  # it is, but for rounding
            for a in range(3):
                ahead, cross = rotation[a, 2] / sigma_depth, F(0)
                for j in range(TERMS):
                    cross += terms[a, j] * total[15 + j]
                rows[s, a] = max(rows[s, a] + F(2) * ahead * cross + ahead * ahead * squares, F(0))
                rows[s, SHAPE + a] = squares / (sigma_color * sigma_color)
    return rows
