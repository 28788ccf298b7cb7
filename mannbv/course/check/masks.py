"""Exercises of notebook 05: masks, Eqs. (10)-(13)."""

import math
from collections import deque
from collections.abc import Callable

import numpy as np
import torch

from mannbv import geometry, grid, mask
from mannbv.course.check.verdict import Fault, ask, compare, say, side
from mannbv.splats import SplatMap

_RADII = [(0.9, 0.5, 1.0, 2.0), (2.5, 0.5, 1.0, 2.0), (0.45, 0.2, 0.8, 3.0)]
_SIDES = ((1, 0), (-1, 0), (0, 1), (0, -1))
_CORNERS = ((1, 1), (1, -1), (-1, 1), (-1, -1))
_WIDE = (40, 30)  # cells of 0.1 m


def _rooms() -> grid.Occupancy:
    """Two rooms of 2 m × 3 m, a wall between them, and a door in its upper end."""
    log_odds = np.full(_WIDE, -1.0, np.float32)
    log_odds[19:21, :24] = 1.0
    return grid.Occupancy(grid.Lattice((0.0, 0.0), 0.1, _WIDE), log_odds)


def _splats(n: int) -> SplatMap:
    """Splats all over the two rooms, some long, some inside the wall; the same ones every time."""
    rng = np.random.default_rng(5)
    means, stds = (
        torch.from_numpy(rng.uniform(0.1, (3.9, 2.9), (n, 2))),
        torch.from_numpy(rng.uniform(0.02, 0.4, (n, 2))),
    )
    upright = geometry.identity_rotations(n, 2).double()
    return SplatMap(means, stds.log(), upright, torch.zeros(n).double(), torch.zeros(n, 3).double())


_PATH = torch.tensor([[0.5, 0.5], [1.0, 1.0], [1.2, 2.7], [2.6, 2.7]], dtype=torch.float64)
_BALLS = torch.tensor([0.6, 0.9, 0.5, 0.5], dtype=torch.float64)


def risk_of(mine: Callable) -> bool:
    """my_risk(radius, r_min, beta1, beta2): the α at which Eq. (10) gives this radius."""

    def truth(radius, r_min, beta1, beta2):
        return -math.log((radius - r_min) / beta1) / beta2

    return compare(
        mine,
        truth,
        _RADII,
        [
            (lambda *case: -truth(*case), "a larger mask belongs to a smaller α: a sign"),
            (
                lambda radius, r_min, beta1, beta2: truth(radius, 0.0, beta1, beta2),
                "what of the radius is left at α = ∞?",
            ),
            (lambda radius, r_min, beta1, beta2: truth(radius, r_min, 1.0, beta2), "where is β₁?"),
            (
                lambda radius, r_min, beta1, beta2: truth(radius, r_min, beta1, 1.0),
                "where is β₂? Look at the units: α is in m",
            ),
            (lambda radius, r_min, beta1, beta2: truth(radius, r_min, beta2, beta1), "β₁ is the length, β₂ the rate"),
            (lambda *case: truth(*case) * case[3] ** 2, "α is a length [m], and β₂ one over a length: times, or over?"),
            (lambda *case: truth(*case) / math.log(10), "the natural logarithm, not that to base 10"),
            (lambda *case: max(truth(*case), 0.0), "α may be negative: then the worst cases reach beyond contact"),
        ],
    )


def body(mine: Callable) -> bool:
    """my_zone(splat_map, path, radii): splats that reach into a ball with two of their largest standard deviations."""

    def zone(reach):
        def select(splat_map, path, radii):
            away = torch.linalg.norm(splat_map.means[:, None] - path, dim=-1)
            return (away - reach(splat_map)[:, None] <= radii).any(1)

        return select

    right = zone(lambda m: 2 * m.scales.amax(1))

    def every(splat_map, path, radii):
        return torch.stack([right(splat_map, p[None], r[None]) for p, r in zip(path, radii, strict=True)]).all(0)

    def gap(case, answer, wanted):
        k = int(np.argmax(np.abs(answer - wanted)))
        return f"splat {k} {'is missing' if wanted[k] else 'is in, though it reaches into no ball,'}"

    return compare(
        mine,
        right,
        [(_splats(80), _PATH, _BALLS), (_splats(80), _PATH[1:3], 0.5 * _BALLS[1:3])],
        [
            (mask.zone, "that is Eq. (11) itself: a mean outside the ball is out, however far its splat reaches"),
            (zone(lambda m: m.scales.amax(1)), "two standard deviations are wanted, not one"),
            (zone(lambda m: 2 * m.scales.amin(1)), "that is the splat's narrow side"),
            (zone(lambda m: 2 * m.scales.mean(1)), "that is the mean of a splat's standard deviations"),
            (lambda m, path, radii: right(m, path[:1], radii[:1]), "every ball counts, not the first alone"),
            (every, "one ball is enough: a splat need not reach into all of them"),
            (zone(lambda m: -2 * m.scales.amax(1)), "a longer splat must not be harder to reach: a sign"),
            (zone(lambda m: 2 * m.log_scales.amax(1)), "log_scales are logarithms; scales are metres"),
            (zone(lambda m: 2 * m.scales.amax(1) ** 2), "a length [m] is wanted, not a variance [m²]"),
        ],
        gap=gap,
    )


def ahead(mine: Callable) -> bool:
    """my_weights(splat_map, path, occupancy): Eq. (13) with p the first waypoint, where the robot stands."""
    return compare(
        mine,
        lambda splat_map, path, occupancy: mask.proximity(splat_map, path[:1], occupancy),
        [(_splats(20), _PATH, _rooms()), (_splats(20), _PATH[1:], _rooms())],
        [
            (mask.proximity, "that takes for p the nearest of all waypoints"),
            (
                lambda m, path, ground: mask.proximity(m, path[-1:], ground),
                "that is where the robot will stand at last",
            ),
            (lambda m, path, ground: mask.proximity(m, path[:1]), "that measures straight through the wall"),
            (
                lambda m, path, ground: mask.proximity(m, path.mean(0, keepdim=True), ground),
                "the middle of a path is no waypoint",
            ),
        ],
        rtol=1e-4,
    )


def walk(mine: Callable) -> bool:
    """my_distance(free, source, cell): metres from one cell over the sides of free cells; inf where there is no way."""

    def steps(free, source, cell, moves=_SIDES):
        distance, queue = np.full(free.shape, np.inf), deque([tuple(source)])
        distance[tuple(source)] = 0.0
        while queue:
            x, y = queue.popleft()
            for u, v in ((x + dx, y + dy) for dx, dy in moves):
                inside = 0 <= u < free.shape[0] and 0 <= v < free.shape[1]
                if inside and free[u, v] and np.isinf(distance[u, v]):
                    distance[u, v] = distance[x, y] + cell
                    queue.append((u, v))
        return distance

    def chess(free, source, cell):
        return steps(free, source, cell, moves=_SIDES + _CORNERS)

    def diagonal(free, source, cell):
        return cell * grid.geodesic(np.where(free, 1.0, np.inf), np.array([source]))

    def straight(free, source, cell):
        across = np.indices(free.shape) - np.reshape(source, (2, 1, 1))
        return np.where(free, cell * np.hypot(*across), np.inf)

    def open_plan(free, source, cell):
        return steps(np.ones_like(free), source, cell)

    def round_the_edge(free, source, cell):
        around, (nx, ny) = np.tile(free, (3, 3)), free.shape
        far = steps(around, (source[0] + nx, source[1] + ny), cell)
        return far.reshape(3, nx, 3, ny).min(axis=(0, 2))

    def started_late(free, source, cell):
        return steps(free, source, cell) + cell

    def gap(case, answer, wanted):
        source, off = tuple(case[1]), ~np.isclose(answer, wanted)
        at = tuple(int(k) for k in min(np.argwhere(off), key=lambda place: np.abs(place - source).sum()))
        if np.isinf(wanted[at]):
            return f"too near: no way leads from {source} to the cell {at}"
        if np.isinf(answer[at]):
            return f"not infinitely far: a way leads from {source} to the cell {at}"
        if np.isclose(answer[at], case[2] * math.sqrt(2)):
            return f"only the four sides count, but a diagonal step led to the cell {at}"
        return f"{side(float(answer[at]), float(wanted[at]))} at the cell {at}, seen from {source},"

    closed = np.array([[1, 1, 0, 1], [1, 1, 0, 1], [1, 0, 0, 1], [1, 1, 1, 0]], bool)
    turned = np.array([[1, 1, 1, 1, 1], [1, 0, 0, 0, 1], [1, 1, 1, 0, 1], [0, 1, 1, 0, 1]], bool)
    return compare(
        mine,
        steps,
        [(closed, (0, 0), 0.1), (turned, (2, 1), 0.05)],
        [
            (lambda free, source, cell: steps(free, source, 1.0), "that counts cells; metres are wanted"),
            (chess, "a diagonal step: only the four sides count"),
            (diagonal, "that also steps over corners; here only the four sides count"),
            (straight, "that is the straight distance; a wall lies between"),
            (open_plan, "it walks through walls"),
            (lambda *case: np.where(case[0], open_plan(*case), np.inf), "it walks through walls"),
            (
                lambda *case: np.nan_to_num(steps(*case), posinf=0.0),
                "what cannot be reached is infinitely far, not here",
            ),
            (started_late, "the source is no step away from itself"),
            (
                lambda free, source, cell: steps(free, source, cell**2),
                "`cell` is in it twice: metres are wanted, not m²",
            ),
            (round_the_edge, "it leaves over one edge and comes back over the opposite one"),
        ],
        gap=gap,
    )


def bounded(mine: Callable) -> bool:
    """my_radius(alpha): any radius [m] that falls with α from at most 2 m to at least 0.5 m; says what it breaks."""
    alphas = np.linspace(-3.0, 6.0, 91)
    try:
        radii = np.array([float(ask(mine, float(alpha))) for alpha in alphas])
    except Fault as fault:
        return say(str(fault))
    except (TypeError, ValueError, RuntimeError):
        return say("one number is wanted: a radius [m]")
    for kept, hint in [
        (np.isfinite(radii).all(), "not finite somewhere between α = −3 m and 6 m"),
        ((np.diff(radii) <= 1e-12).all(), "a safer waypoint, of larger α, must not get a larger mask"),
        (radii.max() <= 2.0 + 1e-9, "larger than 2 m where α is far below zero"),
        (radii.min() >= 0.5 - 1e-9, "smaller than 0.5 m where α is large"),
        (radii[0] - radii[-1] > 0.1, "it hardly depends on α"),
    ]:
        if not kept:
            return say(hint)
    return say("a mask radius: it never grows with α and keeps within its bounds, so Proposition 2 holds for it", True)
