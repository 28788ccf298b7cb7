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
_FAR = 10.0  # sizes of all the rest away, or as large


def without_strays(surfaces: Surfaces) -> tuple[Surfaces, str]:
    """Without what lies far from the bulk of the triangles; and a note, "" if nothing does.

    The bulk grows from the middle half of all corners: what comes within `_FAR` times its size of it joins. Of a plane
    of ground, or another shell `_FAR` times as large as all the rest, only what lies near the rest remains.
    """
    least, most = surfaces.corners.min(1), surfaces.corners.max(1)
    low, high = np.quantile(surfaces.corners.reshape(-1, 3), [0.25, 0.75], axis=0)
    near = np.zeros(len(least), bool)
    while True:
        reach = _FAR * max((high - low).max(), 1e-9)
        joined = ((least <= high + reach) & (most >= low - reach)).all(1)
        if not joined.any() or np.array_equal(joined, near):
            break
        near = joined
        low, high = np.minimum(low, least[near].min(0)), np.maximum(high, most[near].max(0))
    if not near.any():
        return surfaces, ""
    kept, away = surfaces if near.all() else _taken(surfaces, near), int((~near).sum())
    kept, cut = _without_giants(kept)
    notes = [f"{away:,} of {len(near):,} triangles lie far from the rest: left out"] if away else []
    notes += [f"{cut:,} triangles, much larger than the rest: cut off beyond it"] if cut else []
    return kept, "; ".join(notes)


def _without_giants(surfaces: Surfaces) -> tuple[Surfaces, int]:
    """With only those parts of far too large triangles that lie near the others; and how many these were.

    Large triangles alone are no giants: a room may be of twelve, and a chair in it of thousands. Giants lie flat
    together, as ground does, or are `_FAR` times larger still.
    """
    least, most = surfaces.corners.min(1), surfaces.corners.max(1)
    size = (most - least).max(1)
    order = np.argsort(size)
    low, high = np.minimum.accumulate(least[order]), np.maximum.accumulate(most[order])
    extent = (high - low).max(1)
    jump = np.flatnonzero(size[order][1:] > _FAR * extent[:-1])
    jump = jump[jump >= len(order) // 2]  # most of a building is no giant
    if len(jump) == 0:
        return surfaces, 0
    giants = order[jump[0] + 1 :]
    spread = np.ptp(surfaces.corners[giants].reshape(-1, 3), axis=0)
    if spread.min() > 0.01 * spread.max() and size[giants].min() <= _FAR**2 * extent[jump[0]]:
        return surfaces, 0
    low, high, reach = low[jump[0]], high[jump[0]], extent[jump[0]]
    while (giant := np.ptp(surfaces.corners, axis=1).max(1) > reach).any():
        halves = _halved(_taken(surfaces, giant))
        close = (halves.corners.min(1) <= high + reach) & (halves.corners.max(1) >= low - reach)
        surfaces = _joined(_taken(surfaces, ~giant), _taken(halves, close.all(1)))
    return surfaces, len(giants)


def _taken(s: Surfaces, which) -> Surfaces:
    return Surfaces(s.corners[which], s.colors[which], s.uv[which], s.image[which], s.images)


def _joined(a: Surfaces, b: Surfaces) -> Surfaces:
    pairs = (a.corners, b.corners), (a.colors, b.colors), (a.uv, b.uv), (a.image, b.image)
    corners, colors, uv, image = (np.concatenate(pair) for pair in pairs)
    return Surfaces(corners, colors, uv, image, a.images)


def _halved(s: Surfaces) -> Surfaces:
    """Every triangle as the two on both sides of its longest edge's middle."""
    longest = np.linalg.norm(np.roll(s.corners, -1, 1) - s.corners, axis=2).argmax(1)
    order = (longest[:, None] + np.arange(3)) % 3  # which makes that edge the first

    def split(values):
        a, b, c = np.moveaxis(np.take_along_axis(values, order[..., None], 1), 1, 0)
        middle = (a + b) / 2
        return np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])

    return Surfaces(split(s.corners), split(s.colors), split(s.uv), np.tile(s.image, 2), s.images)


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
        heights = np.bincount(bins[across, axis], area[across], minlength=1)
        scores.append((np.convolve(heights, [1, 1]) ** 2).sum())
    return "xyz"[int(np.argmax(np.array(scores) * [0.25, 1, 1]))]


def unit(storey: float) -> tuple[float, str]:
    """Metres a unit, and why, from a storey's height in units."""
    if not storey > 0:
        return 1.0, "taken as metres, for no storey could be measured"
    for name, unit in UNITS.items():
        if STOREY[0] <= storey * unit <= STOREY[1]:
            else_ = "" if unit == 1 else f" (in metres it would be {storey:.3g} m)"
            return unit, f"in {name}, for a storey is then {storey * unit:.2f} m high{else_}"
    factor = USUAL / storey
    return factor, f"{factor:.3g} m a unit, which makes a storey {USUAL} m high (in metres it would be {storey:.3g} m)"
