"""Setting a building upright: without strays, z up, in metres, all of it read off the triangles."""

import numpy as np

from mannbv.world.surfaces import Surfaces

UP = {  # the world's x, y, z, each as a direction in the file
    "x": ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
    "y": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "z": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "-x": ((0, 1, 0), (0, 0, -1), (-1, 0, 0)),
    "-y": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "-z": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
}
UNITS = {"metres": 1.0, "centimetres": 0.01, "millimetres": 0.001, "inches": 0.0254, "feet": 0.3048}  # [m]
STOREY = (2.0, 4.2)  # [m] from floor to ceiling
USUAL = 2.6  # [m] a storey's height where no unit fits
_GIANT = 10.0  # a triangle this many times as large as all the rest is cut down to the part near the rest


def without_strays(surfaces: Surfaces) -> tuple[Surfaces, str]:
    """Without what lies far from the bulk of the triangles; and a note, "" if nothing does.

    The bulk grows from the middle half of all corners: what comes within its own size of it joins. A triangle many
    times larger, such as a plane of ground, is cut into quarters, and only those near the bulk remain.
    """
    corners = surfaces.corners
    low, high = np.quantile(corners.reshape(-1, 3), [0.25, 0.75], axis=0)
    least, most = corners.min(1), corners.max(1)
    size = (most - least).max(1)
    while True:
        reach = max((high - low).max(), np.median(size))
        near = ((least <= high + reach) & (most >= low - reach)).all(1)
        joins = near & (size <= _GIANT * reach)
        if not joins.any():
            return surfaces, ""
        grown = np.minimum(low, least[joins].min(0)), np.maximum(high, most[joins].max(0))
        if np.array_equal(grown, (low, high)):
            break
        low, high = grown
    if near.all() and (size <= _GIANT * reach).all():
        return surfaces, ""
    kept, away = _taken(surfaces, near), int((~near).sum())
    while (giant := np.ptp(kept.corners, axis=1).max(1) > _GIANT * reach).any():
        quarters = _quartered(_taken(kept, giant))
        close = (quarters.corners.min(1) <= high + reach) & (quarters.corners.max(1) >= low - reach)
        kept = _joined(_taken(kept, ~giant), _taken(quarters, close.all(1)))
    return kept, f"{away:,} of {len(corners):,} triangles lie far from the rest: left out" if away else ""


def _taken(s: Surfaces, which) -> Surfaces:
    return Surfaces(s.corners[which], s.colors[which], s.uv[which], s.image[which], s.images)


def _joined(a: Surfaces, b: Surfaces) -> Surfaces:
    fields = ("corners", "colors", "uv", "image")
    return Surfaces(*(np.concatenate([getattr(a, f), getattr(b, f)]) for f in fields), a.images)


def _quartered(s: Surfaces) -> Surfaces:
    """Every triangle as the four between its corners and the middles of its edges."""
    one, half = np.eye(3), (np.eye(3) + np.roll(np.eye(3), 1, 1)) / 2  # middles of 0–1, 1–2, 2–0
    mix = np.stack([[one[0], half[0], half[2]], [half[0], one[1], half[1]], [half[2], half[1], one[2]], half])
    split = [
        np.einsum("qij,fjk->fqik", mix, v).reshape(-1, 3, v.shape[2]).astype(v.dtype)
        for v in (s.corners, s.colors, s.uv)
    ]
    return Surfaces(*split, np.repeat(s.image, 4), s.images)


def moved(s: Surfaces, rotation: np.ndarray, factor: float) -> Surfaces:
    """Turned by `rotation` (3, 3), then `factor` times as large."""
    return Surfaces(s.corners @ rotation.T * factor, s.colors, s.uv, s.image, s.images)


def up(surfaces: Surfaces) -> str:
    """The axis across which most area is gathered in few places: floors and ceilings are larger than walls.

    y and z are far more usual than x, which must be much clearer.
    """
    a, b = (surfaces.corners[:, k] - surfaces.corners[:, 0] for k in (1, 2))
    normal = np.cross(a, b)
    area = np.linalg.norm(normal, axis=1)
    place = surfaces.corners.mean(1)
    bins = np.round((place - surfaces.lower) / (surfaces.upper - surfaces.lower).max() * 100).astype(int)
    scores = []
    for axis in range(3):
        across = np.abs(normal[:, axis]) > 0.95 * area
        heights = np.bincount(bins[across, axis], area[across])
        scores.append((np.convolve(heights, [1, 1]) ** 2).sum())
    return "xyz"[int(np.argmax(np.array(scores) * [0.25, 1, 1]))]


def unit(storey: float) -> tuple[float, str]:
    """Metres a unit, and why, from a storey's height in units."""
    if not storey > 0:
        return 1.0, "taken as metres, for no storey could be measured"
    for name, unit in UNITS.items():
        if STOREY[0] <= storey * unit <= STOREY[1]:
            return unit, f"in {name}, for a storey is then {storey * unit:.2f} m high"
    factor = USUAL / storey
    return factor, f"{factor:.3g} m a unit, which makes a storey {USUAL} m high (in metres it would be {storey:.3g} m)"
