"""One look in all directions, for the gain of every yaw at once: densities of gain, and how a camera reads them.

Flatland's panorama is a circle, seen as from several places in a row of pixels; the panorama of space is a cylinder.
"""

import functools
import itertools
import math
from dataclasses import dataclass

import numpy as np
import scipy.fft
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from mannbv.camera import EDGE, LOW_PASS, NEAR, Camera
from mannbv.kernels.space import panorama, projection
from mannbv.kernels.space import tiles as pairs_of
from mannbv.render import flat as rows
from mannbv.render.limits import CUTOFF, FLOOR, refuse
from mannbv.render.space import array, by_range
from mannbv.splats import SplatMap

STEEPEST = math.radians(65)  # nearer to the poles a cylinder stretches splats too much

_OVERSAMPLING = 4  # flatland: directions for each pixel on the axis
_PLACES = 5  # flatland: in the image
_SMALLEST = 16.0  # [px] least radius of a cylinder: a few columns cost nothing


@dataclass(frozen=True)
class Panorama:
    """What a camera reads along every yaw: spectra (quantities, frequencies) of colour's gain, and of depth's by the
    products of two components of the camera's axis, the upper triangle of a matrix.
    """

    spectra: np.ndarray

    def read(self, yaw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The quantities along `yaw` (k,) [rad], and their slopes, (quantities, k)."""
        wave = np.exp(1j * np.arange(self.spectra.shape[1])[:, None] * (yaw + math.pi))
        rate = 1j * np.arange(self.spectra.shape[1])
        return (self.spectra @ wave).real, (self.spectra * rate @ wave).real

    def uniform(self, n: int) -> np.ndarray:
        """The quantities along −π + 2π m / n, (quantities, n)."""
        folded = np.zeros((n, len(self.spectra)), complex)
        np.add.at(folded, np.arange(self.spectra.shape[1]) % n, self.spectra.T)
        return n * scipy.fft.ifft(folded, axis=0).real.T


def _correlated(densities: np.ndarray, reader: np.ndarray) -> Panorama:
    """What a camera finds in densities (quantities, rows, columns), whatever its yaw; reader (rows, frequencies).

    Columns are equal angles from −π to the right. Waves are kept, not values at columns: yaws fall between them.
    """
    columns = densities.shape[-1]
    spectra = (np.conj(scipy.fft.rfft(densities)) * reader).sum(1).astype(complex) / columns
    spectra[:, 1:] *= 2
    return Panorama(spectra[:, : (columns + 1) // 2])  # without the last wave of an even number, which has no phase


def serves(camera: Camera, pitch: float) -> bool:
    """Whether a panorama holds all that the camera sees at `pitch` [rad]."""
    return camera.height is None or abs(pitch) + math.atan(camera.height / 2 / camera.focal) <= STEEPEST


def look(
    joint: SplatMap, camera: Camera, position: ArrayLike, worth: Tensor, pitch: float, sigma_color: float,
    sigma_depth: float, cutoff: float = CUTOFF, floor: float = FLOOR,
) -> Panorama:  # fmt: skip
    """The panorama at `position` (d,) [m] of a map, for cameras like this one.

    worth (n, p): v / (H + λ), 0 for splats that only occlude; with rows for the whole of `joint`. pitch [rad]: upwards.
    cutoff: blends below it are dropped. floor: where less is let through, nothing is looked for behind.
    """
    noise = np.array([sigma_color, sigma_depth], float)
    if camera.height is None:
        return _circle(joint, camera, position, worth, noise, cutoff)
    return _cylinder(joint, camera, position, worth, pitch, noise, cutoff, floor)


# flatland


def _circle(joint, camera, position, worth, noise, cutoff) -> Panorama:
    columns = scipy.fft.next_fast_len(math.ceil(_OVERSAMPLING * 2 * math.pi * camera.focal), real=True)
    densities = rows.densities(
        joint, camera, position, worth, np.tan(_angles(camera.fov)), columns, noise[0], noise[1], cutoff
    )
    return _correlated(densities, _circle_reader(camera, columns))


def _angles(fov: float) -> np.ndarray:
    """Angles to the axis [rad] of the places in an image for which densities are computed."""
    return np.linspace(-fov / 2, fov / 2, _PLACES)


@functools.lru_cache(maxsize=8)
def _circle_reader(camera: Camera, columns: int) -> np.ndarray:
    """How the pixels of a one-row camera read the places and columns.

    A pixel looks along its centre, between columns, and between the places in the image (Lagrange), so that what a
    splat gains or loses by falling between two pixels is kept.
    """
    right = np.arctan((np.arange(camera.width) + 0.5 - camera.width / 2) / camera.focal)
    nodes = _angles(camera.fov)
    shares = np.ones((_PLACES, camera.width))
    for a, b in itertools.permutations(range(_PLACES), 2):
        shares[a] *= (right - nodes[b]) / (nodes[a] - nodes[b])
    waves = np.arange(columns // 2 + 1)
    return shares @ np.exp(-1j * (right[:, None] - math.pi / columns) * waves)


# space


@dataclass(frozen=True)
class Cylinder:
    """A cylinder for a camera: its radius, columns, rows and row of the horizon [px], and the reader's spectrum.

    low_pass (2, 2) [px²]: what a pixel's low pass is on the cylinder, across and down, for two places in the image.
    """

    radius: float
    columns: int
    height: int
    horizon: float
    low_pass: np.ndarray
    reader: np.ndarray


@functools.lru_cache(maxsize=8)
def cylinder(camera: Camera, pitch: float) -> Cylinder:
    """The cylinder that holds all that a camera sees at `pitch` [rad], whatever its yaw.

    Off the axis a camera's pixels, and so its low pass, are smaller on the cylinder. They follow the square of the
    cosine to the axis nearly linearly: densities for two places, where a two-point quadrature over the image has them,
    serve all pixels.
    """
    (across, down), tile = camera.size, pairs_of.TILE
    half = math.atan(down / 2 / camera.focal)
    radius = max(camera.focal, _SMALLEST)
    columns = tile * scipy.fft.next_fast_len(math.ceil(2 * math.pi * radius / tile), real=True)
    radius = columns / (2 * math.pi)
    top, bottom = math.tan(half + pitch), math.tan(half - pitch)
    height = tile * math.ceil(radius * (top + bottom) / tile)
    horizon = radius * top + (height - radius * (top + bottom)) / 2

    squares, passed = _low_pass(camera, pitch)
    mean, spread = squares.mean(), squares.std()
    nodes = mean + spread * np.array([1.0, -1.0])
    slope = ((squares - mean)[:, None] * passed).mean(0) / spread**2
    low_pass = LOW_PASS * (radius / camera.focal) ** 2 * (passed.mean(0) + np.outer(nodes - mean, slope))
    pixels, squared = panorama.pixels(
        columns, height // panorama.BIN, horizon, radius, float(across), float(down), camera.focal, pitch
    )
    shares = [squared - nodes[1] * pixels, nodes[0] * pixels - squared]
    reader = scipy.fft.rfft(np.concatenate(shares) / (nodes[0] - nodes[1])).astype(np.complex64)
    return Cylinder(radius, columns, height, horizon, low_pass, reader)


def _low_pass(camera: Camera, pitch: float, samples: int = 33) -> tuple[np.ndarray, np.ndarray]:
    """Over the image: the squared cosine to the axis, on the scale of a cylinder of radius 1; and for a round spot of
    1 / focal² around a pixel, its variances there across and down.
    """
    ticks = (np.arange(samples) + 0.5) / samples - 0.5
    x, y = np.meshgrid(*(ticks * n / camera.focal for n in camera.size))
    cos, sin = math.cos(pitch), math.sin(pitch)
    down, forward = y * cos - sin, cos + y * sin  # of the ray (x, y, 1), in a level frame
    level = np.hypot(x, forward)
    across = (forward**2 + (x * sin) ** 2) / level**4
    below = (x * down / level**3) ** 2 + (cos / level - down * forward * sin / level**3) ** 2
    return (1 / level**2).reshape(-1), np.stack([across, below], -1).reshape(-1, 2)


def _cylinder(joint, camera, position, worth, pitch, noise, cutoff, floor) -> Panorama:
    refuse(joint)
    around, like = cylinder(camera, pitch), joint.means.detach().cpu()
    means, log_scales, rotations, logits, colors = (array(part.cpu(), like) for part in joint.tensors())
    dtype = means.dtype
    position = np.asarray(torch.as_tensor(position).detach().cpu(), dtype)
    worth, noise = array(worth.cpu(), like), noise.astype(dtype)
    steepest = EDGE * max(around.horizon, around.height - around.horizon) / around.radius
    lens = np.array([around.radius, steepest, steepest], dtype)
    size, low_pass = np.array([around.height, around.horizon], dtype), around.low_pass.astype(dtype)
    images = panorama.project(
        means, log_scales, rotations, logits, position, lens, size, dtype.type(NEAR), low_pass, dtype.type(cutoff)
    )
    index = np.flatnonzero(images[0, :, projection.REACH] > 0)
    index = index[by_range(images[0, index, projection.FAR])]
    copies, shift = _around_the_seam(images[0, index], around.columns)
    values = np.concatenate([colors[index] / noise[0], (means[index] - position) / noise[1]], 1)[copies]
    shape = means, log_scales, rotations, position, lens
    table = panorama.worths(index, images[0, index], *shape, worth, *noise)[copies]
    images = images[:, index[copies]]
    images[:, :, projection.U] += shift
    pairs, starts, _, _ = pairs_of.sort(images[0], around.columns, around.height)
    order = np.argsort(-np.diff(starts), kind="stable")
    common = images[0], values, table, pairs, starts, order, around.columns, around.height, dtype.type(floor)
    fields = [panorama.densities(image, *common) for image in images]
    return _correlated(np.concatenate(fields, 1), around.reader)


def _around_the_seam(image: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows (m,) of splats, those across the seam twice or thrice, and how far to shift each [px]."""
    a, b, c = image[:, projection.LXX], image[:, projection.LXY], image[:, projection.LYY]
    side = np.sqrt(image[:, projection.REACH] * (b * b + c * c)) / (a * c) + 1
    left, right = image[:, projection.U] < side, image[:, projection.U] > columns - side
    copies = np.concatenate([np.arange(len(image)), np.flatnonzero(left), np.flatnonzero(right)])
    shift = np.repeat(np.array([0, columns, -columns], image.dtype), [len(image), left.sum(), right.sum()])
    order = np.argsort(copies, kind="stable")
    return copies[order], shift[order]
