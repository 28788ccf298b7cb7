"""What whole blocks need beyond the diagonal, in flatland: how a splat's colours and shape go together."""

import numpy as np
from numba import njit

from mannbv.kernels.arithmetic import KERNEL
from mannbv.kernels.flat.row import _span, composite
from mannbv.kernels.limits import MAX_BLEND

CHANNELS = 4  # three colours and depth
ROW_MOMENTS = 5 + 3 * CHANNELS + 1  # energy by δ to the fourth order, per channel cross to the second, Σ weight²


@njit(**KERNEL)
def row_moments(u, var, opacity, values, width, cutoff, floor):
    """ROW_MOMENTS of flatland's splats (v, ROW_MOMENTS), front to back; values (v, CHANNELS) are over their noise."""
    image = composite(u, var, opacity, values, width, cutoff, floor)
    table = np.zeros((len(u), ROW_MOMENTS))
    through, before, lift = np.ones(width), np.zeros((CHANNELS, width)), np.empty(CHANNELS)
    for s in range(len(u)):
        first, last = _span(u[s], var[s], opacity[s], width, cutoff)
        for p in range(first, last + 1):
            if through[p] < floor:
                continue
            delta = p + 0.5 - u[s]
            raw = opacity[s] * np.exp(-0.5 * delta * delta / var[s])
            rho = min(raw, MAX_BLEND)
            weight = rho * through[p]
            energy = 0.0
            for c in range(CHANNELS):
                before[c, p] += weight * values[s, c]
                lift[c] = through[p] * values[s, c] - (image[c, p] - before[c, p]) / (1.0 - rho)
                energy += lift[c] * lift[c]
            if raw <= MAX_BLEND:
                power = rho * rho * energy
                for j in range(5):
                    table[s, j] += power
                    power *= delta
                for c in range(CHANNELS):
                    power = rho * lift[c] * weight
                    for j in range(3):
                        table[s, 5 + 3 * c + j] += power
                        power *= delta
            table[s, ROW_MOMENTS - 1] += weight * weight
            through[p] -= weight
    return table
