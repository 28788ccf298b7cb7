"""The loop behind the risk field: every point against every splat, boxes of splats at a time."""

import numpy as np
from numba import njit

BLOCK = 16  # splats a box
ON = 1e-12  # [m] no line of sight leads to a mean as near as this


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
def lowest(means, std, posterior, factor, points):
    """min over splats of |point − mean| − factor · σ: means (n, d), std (n,), points (k, d) → (k,), all [m].

    posterior (n, d): variances of each mean [m²], or (0, d) for none. With them σ² = std² + Σ n_j² posterior_j along
    the line of sight n; on a mean the largest. A box whose nearest corner and largest σ cannot beat the best so far is
    passed over; the splat that won at the last point is tried first. Exact whatever the order of the splats, fast if
    neighbours share a box.
    """
    n, dim = means.shape
    most = factor * std  # of each splat, whatever the line of sight, and of each box
    for s in range(len(posterior)):
        most[s] = factor * np.sqrt(std[s] ** 2 + (posterior[s].max() if factor > 0 else posterior[s].min()))
    n_boxes = (n + BLOCK - 1) // BLOCK
    low, high, box_most = np.empty((n_boxes, dim)), np.empty((n_boxes, dim)), np.empty(n_boxes)
    for b in range(n_boxes):
        part = slice(b * BLOCK, min(n, (b + 1) * BLOCK))
        box_most[b] = most[part].max()
        for a in range(dim):
            low[b, a], high[b, a] = means[part, a].min(), means[part, a].max()
    result = np.empty(len(points))
    winner = 0
    for k in range(len(points)):
        best = _gap(means, std, posterior, factor, points, winner, k)
        for b in range(n_boxes):
            square = 0.0
            for a in range(dim):
                gap = max(low[b, a] - points[k, a], points[k, a] - high[b, a], 0.0)
                square += gap * gap
            if np.sqrt(square) - box_most[b] >= best:
                continue
            for s in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
                square = 0.0
                for a in range(dim):
                    square += (means[s, a] - points[k, a]) ** 2
                gap = np.sqrt(square) - most[s]
                if gap < best and len(posterior):
                    gap = _gap(means, std, posterior, factor, points, s, k)
                if gap < best:
                    best, winner = gap, s
        result[k] = best
    return result


@njit(cache=True, nogil=True)
def _gap(means, std, posterior, factor, points, s, k):
    """|point k − mean s| − factor · σ."""
    square = across = widest = 0.0
    for a in range(means.shape[1]):
        part = (means[s, a] - points[k, a]) ** 2
        square += part
        if len(posterior):
            across += part * posterior[s, a]
            widest = max(widest, posterior[s, a])
    if not len(posterior):
        return np.sqrt(square) - factor * std[s]
    wider = across / square if square > ON**2 else widest
    return np.sqrt(square) - factor * np.sqrt(std[s] ** 2 + wider)
