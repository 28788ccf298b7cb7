"""What kernels share with the twin that judges them; `render.limits` says what is refused, and how to mend it."""

import math

from numba import njit

MAX_BLEND = 0.99  # a splat lets at least one percent through, so that what lies behind keeps a slope
MAX_MEAN, MAX_LOG_SCALE = 1e12, 14.0  # [m], and e¹⁴ m are a thousand kilometres
SHORTEST, LONGEST = 1e-15, 1e15  # lengths of a rotation


@njit(cache=True, nogil=True)
def fine(means, log_scales, rotations, logits, colors):
    """Whether splats are numbers of reasonable size, for which kernels are compiled. Arrays without holes."""
    faults = 0
    for value in means.reshape(-1):
        faults += not abs(value) <= MAX_MEAN
    for value in log_scales.reshape(-1):
        faults += not -math.inf < value <= MAX_LOG_SCALE
    for value in logits:
        faults += not abs(value) < math.inf
    for value in colors.reshape(-1):
        faults += not abs(value) < math.inf
    for row in range(len(rotations)):
        square = 0.0
        for k in range(rotations.shape[1]):
            square += rotations[row, k] * rotations[row, k]
        faults += not SHORTEST**2 < square < LONGEST**2
    return faults == 0
