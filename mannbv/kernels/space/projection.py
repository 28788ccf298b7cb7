"""Splats of space before a pinhole camera: what the image sees of each, and how that answers to its parameters.

A splat's image has a centre and a covariance Σ_I = (L Lᵀ)⁻¹. With w = √κ Lᵀ δ for a pixel at δ from the centre, and
κ = ½ log₂ e, the splat's blend is o · 2^(−w·w). Each of its parameters moves log ρ by a polynomial in w, and six
coefficients a parameter are all that gradients and information need. L keeps the digits of needles, which Σ_I⁻¹ loses.
"""

import math

import numpy as np
from numba import njit, prange

from mannbv.kernels.arithmetic import KERNEL, PARALLEL

# columns of a splat's image: centre [px], w = (LXX δx + LXY δy, LYY δy), the largest w·w that shows, opacity, its
# binary logarithm, depth along the axis [m], squared range [m²]
U, V, LXX, LXY, LYY, REACH, OPACITY, LOG_OPACITY, DEPTH, FAR = range(10)
COLUMNS = 10
TERMS = 6  # of a polynomial in w = (p, q): 1, p, q, p², pq, q²
KAPPA = 0.5 * math.log2(math.e)
EVERYTHING = 120.0  # reach without a cut-off: less than 2⁻¹²⁰ is nothing, even in float64
CHUNKS = 64  # pieces that threads share; their number never changes a result


@njit(**KERNEL)
def workspace(like):
    """A thread's scratch: local (3), ray (2), scales (3), turn (3, 3), slopes, spread (2, 3), carried (3, 2)."""
    t = like.dtype
    square, flat, tall = np.empty((3, 3), t), np.empty((2, 3), t), np.empty((3, 2), t)
    return np.empty(3, t), np.empty(2, t), np.empty(3, t), square, flat, np.empty((2, 3), t), tall


@njit(**KERNEL)
def look(s, means, log_scales, rotations, rotation, position, lens, work):
    """Fill the workspace for a splat: its place in the camera's frame, and its axes as the image sees them."""
    local, ray, scales, turn, slopes, spread, _ = work
    F = means.dtype.type
    for a in range(3):
        local[a] = F(0)
        for k in range(3):
            local[a] += (means[s, k] - position[k]) * rotation[k, a]
        scales[a] = math.exp(log_scales[s, a])
    ray[0], ray[1] = local[0] / local[2], local[1] / local[2]
    w, x, y, z = rotations[s, 0], rotations[s, 1], rotations[s, 2], rotations[s, 3]
    two = F(2) / (w * w + x * x + y * y + z * z)
    turn[0, 0], turn[0, 1], turn[0, 2] = F(1) - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)
    turn[1, 0], turn[1, 1], turn[1, 2] = two * (x * y + w * z), F(1) - two * (x * x + z * z), two * (y * z - w * x)
    turn[2, 0], turn[2, 1], turn[2, 2] = two * (x * z - w * y), two * (y * z + w * x), F(1) - two * (x * x + y * y)
    for i in range(2):
        held = min(max(ray[i], -lens[1 + i]), lens[1 + i])
        for a in range(3):
            across = turn[0, a] * rotation[0, i] + turn[1, a] * rotation[1, i] + turn[2, a] * rotation[2, i]
            ahead = turn[0, a] * rotation[0, 2] + turn[1, a] * rotation[1, 2] + turn[2, a] * rotation[2, 2]
            slopes[i, a] = lens[0] / local[2] * (across - held * ahead)
            spread[i, a] = slopes[i, a] * scales[a]


@njit(**PARALLEL)
def project(means, log_scales, rotations, logits, rotation, position, lens, size, near, low_pass, cutoff):
    """The image of every splat (n, COLUMNS); REACH is 0 where it does not touch the image.

    rotation: (3, 3), columns right, down, forward. lens: focal [px], and the largest slopes of the Jacobian's ray along
    x and y. size: width, height [px]. near [m], low_pass [px²], cutoff: as in `camera`, all of the data's type.
    """
    n = len(means)
    F = means.dtype.type
    image = np.empty((n, COLUMNS), means.dtype)
    for chunk in prange(CHUNKS):
        work = workspace(means)
        local, ray, spread = work[0], work[1], work[5]
        for s in range(n * chunk // CHUNKS, n * (chunk + 1) // CHUNKS):
            image[s, REACH] = F(0)
            depth, opacity = F(0), F(1) / (F(1) + math.exp(-logits[s]))
            for k in range(3):
                depth += (means[s, k] - position[k]) * rotation[k, 2]
            if depth <= near or opacity <= cutoff:
                continue
            look(s, means, log_scales, rotations, rotation, position, lens, work)
            xx, xy, yy, cross = low_pass, F(0), low_pass, F(0)
            for a in range(3):
                b, c = (a + 1) % 3, (a + 2) % 3
                xx += spread[0, a] * spread[0, a]
                xy += spread[0, a] * spread[1, a]
                yy += spread[1, a] * spread[1, a]
                area = spread[0, b] * spread[1, c] - spread[0, c] * spread[1, b]
                cross += area * area
            determinant = cross + low_pass * (xx + yy - low_pass)  # xx·yy − xy² would cancel for a needle
            u, v = lens[0] * ray[0] + F(0.5) * size[0], lens[0] * ray[1] + F(0.5) * size[1]
            shown = math.log2(opacity)
            reach = shown - math.log2(cutoff) if cutoff > F(0) else F(EVERYTHING)
            wide, high = math.sqrt(reach * xx / F(KAPPA)), math.sqrt(reach * yy / F(KAPPA))
            if u + wide < F(0) or u - wide > size[0] or v + high < F(0) or v - high > size[1]:
                continue
            image[s, U], image[s, V], image[s, REACH] = u, v, reach
            image[s, LXX] = math.sqrt(F(KAPPA) * yy / determinant)
            image[s, LXY] = -xy * math.sqrt(F(KAPPA) / (yy * determinant))
            image[s, LYY] = math.sqrt(F(KAPPA) / yy)
            image[s, OPACITY], image[s, LOG_OPACITY], image[s, DEPTH] = opacity, shown, depth
            image[s, FAR] = local[0] * local[0] + local[1] * local[1] + depth * depth
    return image


@njit(**KERNEL)
def _add(terms, row, times, seen, du, dv, dxx, dxy, dyy):
    """Add to a parameter's polynomial `times` what its slopes of centre and covariance bring.

    log ρ = log o − ½ wᵀw / κ moves by (Lᵀ du) · w / κ + ½ wᵀ (Lᵀ dΣ L) w / κ².
    """
    F = terms.dtype.type
    a, b, c = seen[LXX], seen[LXY], seen[LYY]
    linear, square = times / F(KAPPA), times * F(0.5 / KAPPA**2)
    terms[row, 1] += linear * (a * du + b * dv)
    terms[row, 2] += linear * c * dv
    terms[row, 3] += square * (a * a * dxx + F(2) * a * b * dxy + b * b * dyy)
    terms[row, 4] += F(2) * square * c * (a * dxy + b * dyy)
    terms[row, 5] += square * c * c * dyy


@njit(**KERNEL)
def response(s, seen, means, log_scales, rotations, rotation, position, lens, work, terms):
    """terms (10, TERMS): ∂ log ρ / ∂(mean, log-scales, rotation in the body's tangent, logit), polynomials in w.

    seen (COLUMNS,): the splat s as `project` gives it.
    """
    F = means.dtype.type
    local, ray, scales, turn, slopes, spread, carried = work
    look(s, means, log_scales, rotations, rotation, position, lens, work)
    depth = local[2]
    terms[:] = F(0)
    for a in range(3):
        x, y = spread[0, a], spread[1, a]
        _add(terms, 3 + a, F(1), seen, F(0), F(0), F(2) * x * x, F(2) * x * y, F(2) * y * y)
        b, c = (a + 1) % 3, (a + 2) % 3  # a turn about axis a mixes the other two
        mix = scales[b] * scales[b] - scales[c] * scales[c]
        bx, by, cx, cy = slopes[0, b], slopes[1, b], slopes[0, c], slopes[1, c]
        _add(terms, 6 + a, mix, seen, F(0), F(0), F(2) * bx * cx, bx * cy + cx * by, F(2) * by * cy)
    terms[9, 0] = F(1) - seen[OPACITY]
    # the mean, first along the camera's axes: the centre moves, and so does the Jacobian that carries Σ into the image
    scale = lens[0] / (depth * depth)
    for k in range(3):
        for i in range(2):
            carried[k, i] = F(0)
            for a in range(3):  # Σ between the camera's axes and the image's
                axis = turn[0, a] * rotation[0, k] + turn[1, a] * rotation[1, k] + turn[2, a] * rotation[2, k]
                carried[k, i] += axis * scales[a] * spread[i, a]
    held_x, held_y = min(max(ray[0], -lens[1]), lens[1]), min(max(ray[1], -lens[2]), lens[2])
    open_x, open_y = F(abs(ray[0]) < lens[1]), F(abs(ray[1]) < lens[2])
    step, sx, sy = lens[0] / depth, scale * carried[2, 0], scale * carried[2, 1]
    lean_x, lean_y = scale * (held_x + open_x * ray[0]), scale * (held_y + open_y * ray[1])
    xx = -scale * carried[0, 0] + lean_x * carried[2, 0]
    xy = -scale * carried[0, 1] + lean_x * carried[2, 1] - scale * carried[1, 0] + lean_y * carried[2, 0]
    yy = -scale * carried[1, 1] + lean_y * carried[2, 1]
    for a in range(3):
        right, down, ahead = rotation[a, 0], rotation[a, 1], rotation[a, 2]
        _add(terms, a, right, seen, step, F(0), -F(2) * open_x * sx, -open_x * sy, F(0))
        _add(terms, a, down, seen, F(0), step, F(0), -open_y * sx, -F(2) * open_y * sy)
        _add(terms, a, ahead, seen, -scale * local[0], -scale * local[1], F(2) * xx, xy, F(2) * yy)
