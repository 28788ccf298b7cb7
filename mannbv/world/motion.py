"""Discrete motion: forward by a step, left or right by a turn (Section VI-B). Lengths [m], angles [rad].

Yaws stay multiples of the turn away from the first one, wrapped into [−π, π).
"""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from mannbv import geometry
from mannbv.config import Config

STEP, TURN = Config().step, Config().turn  # [m] [rad]
LOOKAHEAD = 0.4  # [m] the follower aims at most this far ahead …
TOLERANCE = 0.015  # [m] … and cuts no more than this off the path
_SAMPLE = 0.01  # [m] spacing of the path's points in the search


def turn_to(yaw: float, target: float, turn: float = TURN) -> Iterator[float]:
    """The yaws on the shorter way to `target`, a `turn` at a time, until within half a turn of it."""
    count = round(geometry.wrap(float(target) - float(yaw)) / turn)
    for k in range(1, abs(count) + 1):
        yield geometry.wrap(float(yaw) + math.copysign(k, count) * turn)


def follow(
    position: ArrayLike, yaw: float, path: ArrayLike, step: float = STEP, turn: float = TURN
) -> Iterator[tuple[np.ndarray, float]]:
    """The states (position (2,), yaw) of a robot after each action on its way along `path` (k, ≥ 2) [m].

    Each step aims at the furthest point ahead that a straight line reaches without leaving the path by more than
    `TOLERANCE`; it ends within a step of the path's end. Raises ValueError for a path without points.
    """
    points = _sampled(np.asarray(path, float))
    position, first, turns, here = np.asarray(position, float)[:2], float(yaw), 0, 0
    window = round(LOOKAHEAD / _SAMPLE)
    most = 2 * math.ceil((len(points) * _SAMPLE + math.dist(position, points[0])) / step) + 10
    for _ in range(most):
        ahead = points[here : here + window]
        here += int(np.argmin(np.linalg.norm(ahead - position, axis=1)))
        target = _aim(position, points[here : here + window], step)
        if here + window >= len(points) and math.dist(position, points[-1]) <= 0.55 * step:
            return
        heading = math.atan2(*(target - position)[::-1])
        count = round(geometry.wrap(heading - first - turns * turn) / turn)
        for _ in range(abs(count)):
            turns += int(math.copysign(1, count))
            yield position, geometry.wrap(first + turns * turn)
        yaw = first + turns * turn
        moved = position + step * np.array([math.cos(yaw), math.sin(yaw)])
        if len(points) - here <= step / _SAMPLE and math.dist(moved, points[-1]) >= math.dist(position, points[-1]):
            return
        position = moved
        yield position, geometry.wrap(yaw)


def _aim(position: np.ndarray, ahead: np.ndarray, step: float) -> np.ndarray:
    """The last of the path points `ahead` (k, 2) that a straight way from `position` reaches along the path."""
    offset, near = ahead - position, min(len(ahead) - 1, round(step / _SAMPLE))
    reach = np.linalg.norm(offset, axis=1)
    for k in range(len(ahead) - 1, near, -1):
        if reach[k] > 1e-9:
            line = offset[k] / reach[k]
            along = np.clip(offset[: k + 1] @ line, 0.0, reach[k])
            off = np.linalg.norm(offset[: k + 1] - along[:, None] * line, axis=1)
            if off.max() <= max(TOLERANCE, off[0]):
                return ahead[k]
    return ahead[near]


def _sampled(path: np.ndarray) -> np.ndarray:
    """Points every `_SAMPLE` [m] along a polyline, both ends included."""
    if path.ndim != 2 or len(path) == 0 or not np.isfinite(path).all():
        raise ValueError("follow: the path must have at least one point, all of finite coordinates")
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0.0, lengths[-1], max(2, math.ceil(lengths[-1] / _SAMPLE) + 1))
    return np.stack([np.interp(at, lengths, path[:, k]) for k in range(2)], 1)
