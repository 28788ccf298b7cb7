"""The loop behind the risk field: every point against every splat, boxes of splats at a time."""

import numpy as np
from numba import njit

BLOCK = 16  # splats a box


def ordered(means):
    """Rows (n,) such that runs of `BLOCK` lie close together: halved along the longest side, again and again."""
    parts = [np.arange(len(means))]
    while any(len(part) > BLOCK for part in parts):
        halves = []
        for part in parts:
            if len(part) <= BLOCK:
                halves.append(part)
                continue
            axis = np.argmax(np.ptp(means[part], axis=0))
            part = part[np.argsort(means[part, axis], kind="stable")]
            middle = (len(part) // 2 + BLOCK - 1) // BLOCK * BLOCK  # so that boxes stay full
            halves += [part[:middle], part[middle:]]
        parts = halves
    return np.concatenate(parts)


@njit(cache=True, nogil=True)
def lowest(means, offsets, points):
    """min over splats of |point − mean| − offset: means (n, d), offsets (n,), points (k, d) → (k,), all [m].

    A box whose nearest corner and largest offset cannot beat the best so far is passed over; the splat that won at the
    last point is tried first. Exact whatever the order of the splats, fast if neighbours share a box.
    """
    n, dim = means.shape
    n_boxes = (n + BLOCK - 1) // BLOCK
    low, high, most = np.empty((n_boxes, dim)), np.empty((n_boxes, dim)), np.empty(n_boxes)
    for b in range(n_boxes):
        part = slice(b * BLOCK, min(n, (b + 1) * BLOCK))
        most[b] = offsets[part].max()
        for a in range(dim):
            low[b, a], high[b, a] = means[part, a].min(), means[part, a].max()
    result = np.empty(len(points))
    winner = 0
    for k in range(len(points)):
        square = 0.0
        for a in range(dim):
            square += (means[winner, a] - points[k, a]) ** 2
        best = np.sqrt(square) - offsets[winner]
        for b in range(n_boxes):
            square = 0.0
            for a in range(dim):
                gap = max(low[b, a] - points[k, a], points[k, a] - high[b, a], 0.0)
                square += gap * gap
            if np.sqrt(square) - most[b] >= best:
                continue
            for s in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
                square = 0.0
                for a in range(dim):
                    square += (means[s, a] - points[k, a]) ** 2
                if np.sqrt(square) - offsets[s] < best:
                    best, winner = np.sqrt(square) - offsets[s], s
        result[k] = best
    return result
