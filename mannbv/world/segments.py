"""The surfaces of a plan: coloured segments, and the rays that meet them."""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from jaxtyping import Float

from mannbv.camera import Camera
from mannbv.geometry import Pose
from mannbv.kernels.flat import rays
from mannbv.world.errors import SceneError

SUBRAYS = 5  # rays across a pixel whose colours are averaged; odd: the middle one gives the depth
TEXTURES = {"plain": rays.PLAIN, "stripes": rays.STRIPES, "noise": rays.NOISE}


@dataclass(frozen=True, eq=False)
class Segments:
    """What a camera meets in flatland; `Surfaces` offers the same in space.

    ends (s, 4): x0, y0, x1, y1 [m]. colors (s, 3) in [0, 1]. textures (s, 4): kind (a value of `TEXTURES`), period [m],
    contrast, phase [m]. Raises SceneError for no segment, and for numbers that are not finite.
    """

    ends: Float[np.ndarray, "s 4"]
    colors: Float[np.ndarray, "s 3"]
    textures: Float[np.ndarray, "s 4"]
    dim: ClassVar[Literal[2]] = 2

    def __post_init__(self):
        if len(self.ends) == 0:
            raise SceneError("no wall borders on free space; a scene needs rooms and walls")
        if not all(np.isfinite(values).all() for values in (self.ends, self.colors, self.textures)):
            raise SceneError("the ends, colours and textures of walls must be finite numbers")

    @property
    def lower(self) -> np.ndarray:
        """Lower corner (2,) of the box around all segments [m]."""
        return self.ends.reshape(-1, 2).min(0)

    @property
    def upper(self) -> np.ndarray:
        """Upper corner (2,) of the box around all segments [m]."""
        return self.ends.reshape(-1, 2).max(0)

    def sampled(self, spacing: float = 0.02) -> np.ndarray:
        """Points (n, 2) [m] on all segments, no further than `spacing` [m] apart along each."""
        a, b = self.ends[:, :2], self.ends[:, 2:]
        counts = np.maximum(np.ceil(np.linalg.norm(b - a, axis=1) / spacing), 1).astype(int)
        which = np.repeat(np.arange(len(a)), counts)
        order = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        return a[which] + ((order + 0.5) / counts[which])[:, None] * (b - a)[which]

    def view(self, camera: Camera, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
        """Colours (width, 3) in [0, 1] and depths (width,) [m] along the axis; black and inf where there is nothing.

        Depth is that of the pixel's centre, colour the mean of `SUBRAYS` rays across the pixel.
        """
        fine = (np.arange(camera.width * SUBRAYS) + 0.5) / SUBRAYS
        slopes = (fine - camera.width / 2) / camera.focal
        right, forward = np.ascontiguousarray(pose.rotation.numpy(force=True).T)
        depth, which, along = rays.cast(self.ends, pose.position.numpy(force=True), right, forward, slopes)
        color = rays.shade(self.ends, self.colors, self.textures, which, along, SUBRAYS)
        return color, depth[SUBRAYS // 2 :: SUBRAYS]
