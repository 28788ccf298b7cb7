"""The surfaces of a building in space: textured triangles, and the rays that meet them."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Float, Float32, Int32
from numpy.typing import ArrayLike

from mannbv.camera import Camera
from mannbv.geometry import Pose
from mannbv.kernels.space import texture

_LEVELS = 12  # half-size copies of an image, itself included


@dataclass(frozen=True, eq=False)
class Surfaces:
    """What a camera meets in space, as `Segments` is in flatland: textured triangles, z up.

    corners (f, 3, 3) [m]. colors (f, 3, 3) in [0, 1], of each corner. uv (f, 3, 2): each corner's place in its image,
    from the lower left corner, in image widths and heights; beyond 0 … 1 the image repeats. image (f,): which of
    `images`, −1 for none; images: (h, w, 3) of uint8. A point's colour is that of the corners times its texel.
    """

    corners: Float[np.ndarray, "f 3 3"]
    colors: Float32[np.ndarray, "f 3 3"]
    uv: Float32[np.ndarray, "f 3 2"]
    image: Int32[np.ndarray, " f"]
    images: tuple[np.ndarray, ...]
    dim: ClassVar[Literal[3]] = 3

    @staticmethod
    def plain(corners: ArrayLike, color: ArrayLike = (0.7, 0.7, 0.7)) -> "Surfaces":
        """Triangles (f, 3, 3) [m] of one colour."""
        triangles = np.asarray(corners, float)
        n = len(triangles)
        colors = np.broadcast_to(np.asarray(color, np.float32), (n, 3, 3)).copy()
        return Surfaces(triangles, colors, np.zeros((n, 3, 2), np.float32), np.full(n, -1, np.int32), ())

    @property
    def lower(self) -> np.ndarray:
        """Lower corner (3,) of the box around all triangles [m]."""
        return self.corners.reshape(-1, 3).min(0)

    @property
    def upper(self) -> np.ndarray:
        """Upper corner (3,) of the box around all triangles [m]."""
        return self.corners.reshape(-1, 3).max(0)

    def sampled(self, spacing: float = 0.05) -> np.ndarray:
        """Points (n, 3) [m] on all triangles, so close that none is further than `spacing` from the nearest."""
        edges = np.linalg.norm(self.corners - np.roll(self.corners, -1, 1), axis=2)
        counts = np.maximum(np.ceil(edges.max(1) / spacing), 1).astype(int)
        points = []
        for n in np.unique(counts):  # a triangle in n² small ones: their centres
            i, j = np.divmod(np.arange(n * n), n)
            upward = i + j < n
            u = np.where(upward, i + 1 / 3, n - i - 1 / 3) / n
            v = np.where(upward, j + 1 / 3, n - j - 1 / 3) / n
            weights = np.stack([1 - u - v, u, v], 1)
            points.append((weights @ self.corners[counts == n]).reshape(-1, 3))
        return np.concatenate(points) if points else np.zeros((0, 3))

    def __reduce__(self):  # what is worked out on the way stays at home: embree's tree cannot travel
        return Surfaces, (self.corners, self.colors, self.uv, self.image, self.images)

    @cached_property
    def _embree(self) -> tuple[EmbreeScene, TriangleMesh, np.ndarray]:
        """Its scene and mesh, in single precision and hence about the triangles' middle (3,)."""
        scene, middle = EmbreeScene(robust=True), (self.lower + self.upper) / 2
        return scene, TriangleMesh(scene, (self.corners - middle).astype(np.float32)), middle

    @cached_property
    def _pyramids(self):
        """(levels, texels) as `kernels.texture.shade` takes them."""
        levels, parts, total = np.zeros((len(self.images), _LEVELS, 3), np.int64), [], 0
        for i, picture in enumerate(self.images):
            for k in range(_LEVELS):
                levels[i, k] = total, picture.shape[1], picture.shape[0]
                if k == 0 or picture.shape[:2] != (1, 1) or levels[i, k - 1, 1:].max() > 1:
                    parts.append(picture.reshape(-1, 3))
                    total += len(parts[-1])
                else:
                    levels[i, k] = levels[i, k - 1]
                picture = _halved(picture)
        return levels, np.concatenate([*parts, np.zeros((0, 3), np.uint8)])

    @cached_property
    def _texel(self) -> np.ndarray:
        """Edge (f,) of a texel on each triangle [m]."""
        a, b = (self.corners[:, k] - self.corners[:, 0] for k in (1, 2))
        p, q = (self.uv[:, k] - self.uv[:, 0] for k in (1, 2))
        area = np.linalg.norm(np.cross(a, b), axis=1)
        sizes = np.array([[0, 0], *(picture.shape[:2] for picture in self.images)])[self.image + 1].prod(1)
        texels = np.abs(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]) * sizes
        return np.sqrt(np.maximum(area, 1e-12) / np.maximum(texels, 1e-12))

    @cached_property
    def _wrapped(self) -> np.ndarray:
        return np.any((self.uv < -1e-4) | (self.uv > 1 + 1e-4), axis=(1, 2))

    def cast(self, origins: ArrayLike, directions: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """The first triangle that each ray meets: depth (k,) in lengths of its direction, inf for none; face (k,), −1.

        origins (k, 3) [m], directions (k, 3) of any length but zero. embree finds the face, double precision the depth.
        """
        starts, along = np.ascontiguousarray(origins, float), np.ascontiguousarray(directions, float)
        if not (len(starts) and len(self.corners)):
            return np.full(len(starts), math.inf), np.full(len(starts), -1, np.int32)
        scene, _, middle = self._embree
        start = (starts - middle).astype(np.float32)
        faces = scene.run(start, along.astype(np.float32), output=1)["primID"].astype(np.int32)
        return texture.depths(starts, along, self.corners, faces), faces

    def view(self, camera: Camera, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
        """Colours (h, w, 3) in [0, 1] and depths (h, w) [m] along the axis; black and inf where there is nothing.

        Depth is exact at the pixels' centres; colour is the texture there, averaged over about a pixel.
        """
        origin = pose.position.numpy(force=True)
        directions = (camera.rays(pose.position) @ pose.rotation.T).numpy(force=True)
        depth, faces = self.cast(np.broadcast_to(origin, directions.shape), directions)
        color = self.shaded(origin, directions, faces, 1 / camera.focal)
        return color.reshape(*camera.shape, 3), depth.reshape(camera.shape)

    def shaded(self, origin: ArrayLike, directions: ArrayLike, faces: np.ndarray, spread: float) -> np.ndarray:
        """Colours (k, 3) in [0, 1] where rays from `origin` (3,) meet their `faces` (k,), black where −1.

        spread: width of a pixel at depth 1; finer detail is averaged.
        """
        levels, texels = self._pyramids
        return texture.shade(
            np.asarray(origin, float), np.ascontiguousarray(directions, float), faces, self.corners, self.colors,
            self.uv, self.image, self._wrapped, self._texel, levels, texels, float(spread),
        )  # fmt: skip


def _halved(picture: np.ndarray) -> np.ndarray:
    """An image of half the size, each texel the mean of (up to) four."""
    h, w = picture.shape[:2]
    even = np.pad(picture, ((0, h % 2 * (h > 1)), (0, w % 2 * (w > 1)), (0, 0)), mode="edge").astype(np.uint16)
    if h > 1:
        even = even[::2] + even[1::2]
    if w > 1:
        even = even[:, ::2] + even[:, 1::2]
    n = (2 if h > 1 else 1) * (2 if w > 1 else 1)
    return ((even + n // 2) // n).astype(np.uint8)
