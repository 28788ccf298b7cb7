"""Exercises of notebook 05: masks, Eqs. (10)-(13)."""

import math
from collections import deque
from collections.abc import Callable

import numpy as np
import torch

from mannbv import geometry, grid, mask
from mannbv.course.check.verdict import AGREES, ask, exercise, judged, number, side
from mannbv.splats import SplatMap


def _risk(radius, r_min, beta1, beta2):
    return -math.log((radius - r_min) / beta1) / beta2


@exercise(cases=[(0.9, 0.5, 1.0, 2.0), (2.5, 0.5, 1.0, 2.0), (0.45, 0.2, 0.8, 3.0)])
def risk_of(radius, r_min, beta1, beta2):
    """my_risk(radius, r_min, beta1, beta2): the α at which Eq. (10) gives this radius."""
    return {
        AGREES: _risk(radius, r_min, beta1, beta2),
        "a larger mask belongs to a smaller α: a sign": -_risk(radius, r_min, beta1, beta2),
        "what of the radius is left at α = ∞?": _risk(radius, 0.0, beta1, beta2),
        "where is β₁?": _risk(radius, r_min, 1.0, beta2),
        "where is β₂? Look at the units: α is in m": _risk(radius, r_min, beta1, 1.0),
        "β₁ is the length, β₂ the rate": _risk(radius, r_min, beta2, beta1),
        "α is a length [m], and β₂ one over a length: times, or over?": _risk(radius, r_min, beta1, 1 / beta2),
        "the natural logarithm, not that to base 10": _risk(radius, r_min, beta1, beta2) / math.log(10),
        "α may be negative: then the worst cases reach beyond contact": max(_risk(radius, r_min, beta1, beta2), 0.0),
    }


def _rooms() -> grid.Occupancy:
    """Two rooms of 2 m × 3 m, a wall between them, and a door in its upper end."""
    log_odds = np.full((40, 30), -1.0, np.float32)
    log_odds[19:21, :24] = 1.0
    return grid.Occupancy(grid.Lattice((0.0, 0.0), 0.1, log_odds.shape), log_odds)


def _splats(n: int) -> SplatMap:
    """Splats all over the two rooms, some long, some inside the wall; the same ones every time."""
    rng = np.random.default_rng(5)
    means = torch.from_numpy(rng.uniform(0.1, (3.9, 2.9), (n, 2)))
    stds = torch.from_numpy(rng.uniform(0.02, 0.4, (n, 2)))
    upright = geometry.identity_rotations(n, 2).double()
    return SplatMap(means, stds.log(), upright, torch.zeros(n).double(), torch.zeros(n, 3).double())


def _zone(m, path, radii, reach, join=torch.any):
    return join(torch.linalg.norm(m.means[:, None] - path, dim=-1) - reach[:, None] <= radii, dim=1)


def _splat(case, answer, wanted):
    k = int(np.argmax(np.abs(answer - wanted)))
    return f"splat {k} {'is missing' if wanted[k] else 'is in, though it reaches into no ball,'}"


_PATH = torch.tensor([[0.5, 0.5], [1.0, 1.0], [1.2, 2.7], [2.6, 2.7]], dtype=torch.float64)
_BALLS = torch.tensor([0.6, 0.9, 0.5, 0.5], dtype=torch.float64)


@exercise(cases=[(_splats(80), _PATH, _BALLS), (_splats(80), _PATH[1:3], 0.5 * _BALLS[1:3])], gap=_splat)
def body(m, path, radii):
    """my_zone(splat_map, path, radii): splats that reach into a ball with two of their largest standard deviations."""
    return {
        AGREES: _zone(m, path, radii, 2 * m.scales.amax(1)),
        "that is Eq. (11) itself: a mean outside the ball is out, however far its splat reaches":
            mask.zone(m, path, radii),
        "two standard deviations are wanted, not one": _zone(m, path, radii, m.scales.amax(1)),
        "that is the splat's narrow side": _zone(m, path, radii, 2 * m.scales.amin(1)),
        "that is the mean of a splat's standard deviations": _zone(m, path, radii, 2 * m.scales.mean(1)),
        "every ball counts, not the first alone": _zone(m, path[:1], radii[:1], 2 * m.scales.amax(1)),
        "one ball is enough: a splat need not reach into all of them":
            _zone(m, path, radii, 2 * m.scales.amax(1), torch.all),
        "a longer splat must not be harder to reach: a sign": _zone(m, path, radii, -2 * m.scales.amax(1)),
        "log_scales are logarithms; scales are metres": _zone(m, path, radii, 2 * m.log_scales.amax(1)),
        "a length [m] is wanted, not a variance [m²]": _zone(m, path, radii, 2 * m.scales.amax(1) ** 2),
    }  # fmt: skip


@exercise(cases=[(_splats(20), _PATH, _rooms()), (_splats(20), _PATH[1:], _rooms())])
def ahead(m, path, ground):
    """my_weights(splat_map, path, occupancy): Eq. (13) with p the first waypoint, where the robot stands."""
    return {
        AGREES: mask.proximity(m, path[:1], ground),
        "that takes for p the nearest of all waypoints": mask.proximity(m, path, ground),
        "that is where the robot will stand at last": mask.proximity(m, path[-1:], ground),
        "that measures straight through the wall": mask.proximity(m, path[:1]),
        "the middle of a path is no waypoint": mask.proximity(m, path.mean(0, keepdim=True), ground),
    }


_SIDES = ((1, 0), (-1, 0), (0, 1), (0, -1))
_CORNERS = ((1, 1), (1, -1), (-1, 1), (-1, -1))


def _steps(free, source, cell, moves=_SIDES):
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


def _cell(case, answer, wanted):
    source, off = tuple(case[1]), ~np.isclose(answer, wanted)
    at = tuple(int(k) for k in min(np.argwhere(off), key=lambda place: np.abs(place - source).sum()))
    if np.isinf(wanted[at]):
        return f"too near: no way leads from {source} to the cell {at}"
    if np.isinf(answer[at]):
        return f"not infinitely far: a way leads from {source} to the cell {at}"
    if np.isclose(answer[at], case[2] * math.sqrt(2)):
        return f"only the four sides count, but a diagonal step led to the cell {at}"
    return f"{side(float(answer[at]), float(wanted[at]))} at the cell {at}, seen from {source},"


_CLOSED = np.array([[1, 1, 0, 1], [1, 1, 0, 1], [1, 0, 0, 1], [1, 1, 1, 0]], bool)
_TURNED = np.array([[1, 1, 1, 1, 1], [1, 0, 0, 0, 1], [1, 1, 1, 0, 1], [0, 1, 1, 0, 1]], bool)


@exercise(cases=[(_CLOSED, (0, 0), 0.1), (_TURNED, (2, 1), 0.05)], gap=_cell)
def walk(free, source, cell):
    """my_distance(free, source, cell): metres from one cell over the sides of free cells; inf where there is no way."""
    right, open_plan = _steps(free, source, cell), _steps(np.ones_like(free), source, cell)
    (nx, ny), straight = free.shape, cell * np.hypot(*(np.indices(free.shape) - np.reshape(source, (2, 1, 1))))
    around = _steps(np.tile(free, (3, 3)), (source[0] + nx, source[1] + ny), cell)
    return {
        AGREES: _steps(free, source, cell),
        "that counts cells; metres are wanted": _steps(free, source, 1.0),
        "a diagonal step: only the four sides count": _steps(free, source, cell, _SIDES + _CORNERS),
        "that also steps over corners; here only the four sides count":
            cell * grid.geodesic(np.where(free, 1.0, np.inf), np.array([source])),
        "that is the straight distance; a wall lies between": np.where(free, straight, np.inf),
        "it walks through walls": [open_plan, np.where(free, open_plan, np.inf)],
        "what cannot be reached is infinitely far, not here": np.nan_to_num(right, posinf=0.0),
        "the source is no step away from itself": right + cell,
        "`cell` is in it twice: metres are wanted, not m²": right * cell,
        "it leaves over one edge and comes back over the opposite one":
            around.reshape(3, nx, 3, ny).min(axis=(0, 2)),
    }  # fmt: skip


@judged(
    truth=lambda alpha: 0.5 + 1.5 / (1 + math.exp(2 * alpha)),
    mistakes=[
        (lambda alpha: math.nan, "not finite somewhere between α = −3 m and 6 m", lambda r: not np.isfinite(r).all()),
        (lambda alpha: 0.5 + 1.5 / (1 + math.exp(-2 * alpha)),
         "a safer waypoint, of larger α, must not get a larger mask", lambda r: np.diff(r).max() > 1e-12),
        (lambda alpha: 0.5 + math.exp(-2 * alpha), "larger than 2 m where α is far below zero",
         lambda r: r.max() > 2.0 + 1e-9),
        (lambda alpha: 2.0 / (1 + math.exp(2 * alpha)), "smaller than 0.5 m where α is large",
         lambda r: r.min() < 0.5 - 1e-9),
        (lambda alpha: 1.0, "it hardly depends on α", lambda r: r[0] - r[-1] <= 0.1),
        (lambda alpha: [alpha, alpha], "one number is wanted: a radius [m]"),
    ],
    praise="a mask radius: it never grows with α and keeps within its bounds, so Proposition 2 holds for it",
)  # fmt: skip
def bounded(mine: Callable) -> np.ndarray:
    """my_radius(alpha): any radius [m] that falls with α from at most 2 m to at least 0.5 m."""
    return np.array([number(ask(mine, alpha), "a radius [m]") for alpha in np.linspace(-3, 6, 91).tolist()])
