"""From overlapping bodies to the surfaces that one can see: cut every outline where bodies and rooms meet."""

from collections.abc import Sequence

import numpy as np

from mannbv.world import bodies

SKIN = 1e-4  # [m] a point this far in front of a surface tells what the surface borders on
_TOUCH = 1e-7  # [m] things nearer than this touch


def outline(polygons: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Edges (e, 4) of polygons, each (k, 2), one after the other, and the polygon (e,) each belongs to."""
    edges = [np.concatenate([corners, np.roll(corners, -1, 0)], 1) for corners in polygons]
    owner = np.repeat(np.arange(len(edges)), np.array([len(e) for e in edges], int))
    return np.concatenate([np.zeros((0, 4)), *edges]), owner


def cuts(edge: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Shares in [0, 1], ascending and 0 and 1 included, at which `edge` (4,) meets the segments `others` (m, 4)."""
    start, along = edge[:2], edge[2:] - edge[:2]
    length = float(np.hypot(*along))
    from_, to = others[:, :2] - start, others[:, 2:] - start
    away = [_cross(along, ends) / length for ends in (from_, to)]  # distances of both ends from the edge's line
    crosses = away[0] * away[1] < 0
    mix = away[0][crosses] / (away[0] - away[1])[crosses]
    points = [from_[crosses] + mix[:, None] * (to - from_)[crosses]]
    points += [ends[np.abs(off) < _TOUCH] for ends, off in zip((from_, to), away, strict=True)]
    shares = np.concatenate(points) @ along / length**2
    gap = _TOUCH / length
    shares = np.sort(np.concatenate([[0.0], shares[(shares > gap) & (shares < 1 - gap)], [1.0]]))
    return shares[np.concatenate([[True], np.diff(shares) > gap])]


def visible(
    polygons: Sequence[np.ndarray], rooms: bodies.Polygons
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The parts of the polygons' outlines that face the inside of a room.

    Returns segments (s, 4) [m]; the polygon (s,) each belongs to; the room (s,) it faces; and the distance (s,) [m]
    of its beginning from that of the whole edge. Where outlines coincide the first polygon's counts.
    """
    edges, owner = outline(polygons)
    if len(edges) == 0:
        return np.zeros((0, 4)), owner, owner, np.zeros(0)
    everything = np.concatenate([edges, outline(rooms.corners)[0]])
    shares = [cuts(edge, everything) for edge in edges]
    which = np.repeat(np.arange(len(edges)), [len(s) - 1 for s in shares])
    low = np.concatenate([s[:-1] for s in shares])[:, None]
    high = np.concatenate([s[1:] for s in shares])[:, None]
    start, along = edges[which, :2], edges[which, 2:] - edges[which, :2]
    parts = np.concatenate([start + low * along, start + high * along], 1)
    length = np.linalg.norm(along, axis=1)
    normal = np.stack([along[:, 1], -along[:, 0]], 1) / length[:, None]
    middle, solids = (parts[:, :2] + parts[:, 2:]) / 2, bodies.Polygons(tuple(polygons))
    room = np.full(len(parts), -1)
    for side in (middle + SKIN * normal, middle - SKIN * normal):
        room = np.where(solids.contains(side), room, np.maximum(room, rooms.which(side)))
    # parts never cross, so two with one middle coincide
    _, first = np.unique(np.round(middle, 6), axis=0, return_index=True)
    keep = np.zeros(len(parts), bool)
    keep[first] = True
    keep &= room >= 0
    return parts[keep], owner[which[keep]], room[keep], (low[:, 0] * length)[keep]


def _cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
