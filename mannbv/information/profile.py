"""The gain of all yaws at one position, from one look in all directions."""

import functools
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.sparse import csr_array
from torch import Tensor

from mannbv import geometry, render, splats
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.information.gain import gain_and_slope, worth_of
from mannbv.render import row
from mannbv.splats import SplatMap

_DEFAULT = Config()
_OVERSAMPLING = 4  # directions for each pixel on the axis
_PLACES = 5  # in the image


@dataclass(frozen=True)
class YawProfile:
    """The gain of every yaw at one position: gains (M,) at yaws (M,) = −π + 2π m / M [rad]."""

    yaws: np.ndarray
    gains: np.ndarray
    evaluate: Callable[[float], tuple[float, float]]

    @torch.no_grad()  # so that separate views take the renderer that `gains` took
    def gain_at(self, yaw: float) -> float:
        return self.evaluate(yaw)[0]

    def slope_at(self, yaw: float) -> float:
        """Derivative of the gain [1/rad]."""
        return self.evaluate(yaw)[1]

    @property
    def best(self) -> float:
        """The yaw of the largest gain [rad]."""
        return float(self.yaws[int(np.argmax(self.gains))])

    def leading(self, count: int = 8, apart: float = math.radians(0.9)) -> np.ndarray:
        """Up to `count` yaws of the largest gains, no two nearer than `apart` [rad]; the largest first."""
        chosen: list[float] = []
        for yaw in self.yaws[np.argsort(-self.gains, kind="stable")]:
            if all(abs(geometry.wrap(yaw - other)) >= apart for other in chosen):
                chosen.append(float(yaw))
            if len(chosen) == count:
                break
        return np.array(chosen)


def uniform_yaws(n: int) -> np.ndarray:
    """−π + 2π m / n, m = 0 … n − 1 [rad]."""
    return -math.pi + 2 * math.pi * np.arange(n) / n


def yaw_profile(
    splat_map: SplatMap,
    camera: Camera,
    position,
    prior: Float[Tensor, "n p"],
    weights: Float[Tensor, " n"] | None = None,
    selected: Bool[Tensor, " n"] | None = None,
    damping=None,
    n_yaws: int = _DEFAULT.n_yaws,
    others: SplatMap | None = None,
    method: str = "auto",
    sigma_color: float = _DEFAULT.sigma_color,
    sigma_depth: float = _DEFAULT.sigma_depth,
) -> YawProfile:
    """Gain (15) of all yaws at `position` (d,) [m]; arguments as in `fisher` and `gain`.

    method "views" takes one Fisher a yaw. "panorama" (flatland) looks once in all directions: the information density
    over direction, read at the pixels of every yaw. Depth along the camera's axis is linear in the axis, so three
    densities (xx, xy, yy) give the depth channel. A pinhole stretches what it sees towards the image's edge, hence
    densities for several places in the image. What is left to differ from separate views: the near plane, and what
    lies between those places and directions. "auto": panorama in flatland, views in 3-D.
    """
    if method not in ("auto", "panorama", "views") or (method == "panorama" and splat_map.dim != 2):
        raise ValueError(f"yaw_profile: method '{method}' does not serve {splat_map.dim}-D maps; use auto or views")
    render.check(splat_map, camera, geometry.yaw_pose(position, 0.0))
    if len(prior) != splat_map.n_splats or n_yaws < 1:
        rows = f"{len(prior)} rows of prior for {splat_map.n_splats} splats"
        raise ValueError(f"yaw_profile: needs a row a splat and at least one yaw, got {rows} and {n_yaws} yaws")
    yaws = uniform_yaws(n_yaws)
    if method == "views" or splat_map.dim != 2:
        noise = {"sigma_color": sigma_color, "sigma_depth": sigma_depth}
        options = {"weights": weights, "selected": selected, "damping": damping}

        def evaluate(yaw: float) -> tuple[float, float]:
            return gain_and_slope(splat_map, camera, position, float(yaw), prior, others, noise, **options)

        with torch.no_grad():
            gains = np.array([evaluate(yaw)[0] for yaw in yaws])
        return YawProfile(yaws, gains, evaluate)
    worth = worth_of(prior, weights, selected, damping)
    if others is not None:
        worth = torch.cat([worth, torch.zeros(others.n_splats, worth.shape[1]).to(worth)])
        splat_map = splats.union(splat_map, others)
    columns = math.ceil(_OVERSAMPLING * 2 * math.pi * camera.focal)
    slants = np.tan(_places(camera.fov))
    densities = row.densities(splat_map, camera, position, worth, slants, columns, sigma_color, sigma_depth)

    def evaluate(yaw: float) -> tuple[float, float]:
        pixels, rates = _pixels((camera.width, camera.focal), columns, np.array([float(yaw)]))
        turn, turn_rate = _axis_terms(np.array([float(yaw)]))
        seen = pixels @ densities
        return max(float((seen * turn).sum()), 0.0), float((rates @ densities * turn + seen * turn_rate).sum())

    seen = _uniform_pixels((camera.width, camera.focal), columns, n_yaws) @ densities
    gains = (seen * _axis_terms(yaws)[0]).sum(1)
    return YawProfile(yaws, np.maximum(gains, 0.0), evaluate)  # interpolation may dip a hair below zero


def _axis_terms(yaw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What multiplies the four densities (colour, xx, xy, yy) of a camera along `yaw` (k,), and its slope: (k, 4)."""
    cos, sin, zero = np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)
    terms = np.stack([zero + 1, cos * cos, 2 * cos * sin, sin * sin], -1)
    slopes = np.stack([zero, -2 * cos * sin, 2 * (cos * cos - sin * sin), 2 * cos * sin], -1)
    return terms, slopes


def _places(fov: float) -> np.ndarray:
    """Angles to the axis [rad] of the places in an image for which densities are computed."""
    return np.linspace(-fov / 2, fov / 2, _PLACES)


def _pixels(camera_size: tuple[int, float], columns: int, yaw: np.ndarray) -> tuple[csr_array, csr_array]:
    """How the pixels of a pinhole (width, focal) along `yaw` (k,) read the densities, and the slope: (k, all columns).

    A pixel looks along its centre, between columns (cubic convolution, which has a slope everywhere), and between the
    places in the image (Lagrange), so that what a splat gains or loses by falling between two pixels is kept.
    """
    width, focal = camera_size
    right = np.arctan((np.arange(width) + 0.5 - width / 2) / focal)
    nodes = _places(2 * math.atan(width / 2 / focal))
    shares = np.ones((_PLACES, width))
    for a, b in itertools.permutations(range(_PLACES), 2):
        shares[a] *= (right - nodes[b]) / (nodes[a] - nodes[b])
    place = (right - yaw[:, None] + math.pi) * columns / (2 * math.pi) - 0.5
    low = np.floor(place)
    x = (place - low)[..., None] + np.array([1.0, 0.0, -1.0, -2.0])  # signed distance to the four columns around
    far = np.abs(x)
    near = far < 1
    read = np.where(near, 1.5 * far**3 - 2.5 * far**2 + 1, -0.5 * far**3 + 2.5 * far**2 - 4 * far + 2)
    rate = np.sign(x) * np.where(near, 4.5 * far**2 - 5 * far, -1.5 * far**2 + 5 * far - 4)
    column = (low[..., None].astype(np.int64) + np.array([-1, 0, 1, 2])) % columns
    rows = np.broadcast_to(np.arange(len(yaw))[:, None, None, None], (*place.shape, 4, _PLACES))
    cells = rows.ravel(), (column[..., None] + columns * np.arange(_PLACES)).ravel()

    def matrix(values: np.ndarray) -> csr_array:
        return csr_array(((values[..., None] * shares.T[:, None]).ravel(), cells), (len(yaw), _PLACES * columns))

    return matrix(read), matrix(-rate * columns / (2 * math.pi))


@functools.lru_cache(maxsize=4)
def _uniform_pixels(camera_size: tuple[int, float], columns: int, n_yaws: int) -> csr_array:
    """`_pixels` of uniform yaws: the same for every position, so kept."""
    return _pixels(camera_size, columns, uniform_yaws(n_yaws))[0]
