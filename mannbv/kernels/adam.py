"""One fused step of Adam on the splats that a view has shown: each number is read and written once."""

import math

from numba import njit

from mannbv.kernels.arithmetic import KERNEL


@njit(**KERNEL)
def step(rows, slopes, first, second, steps, rates, beta1, beta2, epsilon):
    """Change rows, first and second (n, w), and steps (n,), in place, wherever a row of slopes is not all zero.

    rates: (w,). Moments are debiased by each splat's own number of steps. On one thread, since waiting for a second
    one would cost more than the few numbers a splat has.
    """
    F = rows.dtype.type
    n, width = rows.shape
    for s in range(n):
        seen = False
        for k in range(width):
            seen |= slopes[s, k] != F(0)
        if not seen:
            continue
        steps[s] += 1
        size, spread = F(1 / (1 - beta1 ** steps[s])), F(1 / math.sqrt(1 - beta2 ** steps[s]))
        for k in range(width):
            slope = slopes[s, k]
            first[s, k] += F(1 - beta1) * (slope - first[s, k])
            second[s, k] += F(1 - beta2) * (slope * slope - second[s, k])
            rows[s, k] -= rates[k] * size * first[s, k] / (math.sqrt(second[s, k]) * spread + F(epsilon))
