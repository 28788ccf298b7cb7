"""A pinhole camera whose image has one axis fewer than its world (Section III-A), and what it takes: frames.

In flatland the image is one row of pixels. Images are row-major, pixel centres lie at half-integers,
focal = (width / 2) / tan(fov / 2).
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from mannbv.geometry import Pose

# as in the common 3DGS renderers; the paper is silent
LOW_PASS = 0.3  # [px²] added to every projected covariance, so that no splat is thinner than a pixel
EDGE = 1.3  # the Jacobian's viewing ray is clamped to this multiple of the half image
NEAR = 0.1  # [m] splats nearer than this along the axis are not drawn


@dataclass(frozen=True)
class Camera:
    """Image size [px] and focal length [px]; `height` None makes a one-row flatland camera."""

    width: int
    height: int | None
    focal: float

    @staticmethod
    def from_fov(width: int, height: int | None = None, fov: float = math.pi / 2) -> "Camera":
        """A camera with horizontal field of view `fov` [rad]. Raises ValueError for an impossible size or angle."""
        if width < 1 or (height is not None and height < 1):
            raise ValueError(f"camera: image size must be at least 1 px, got {width} × {height}")
        if not 0 < fov < math.pi:
            raise ValueError(f"camera: field of view must lie between 0 and π rad, got {fov}")
        return Camera(width, height, width / 2 / math.tan(fov / 2))

    @staticmethod
    def of_dim(dim: int, width: int, height: int, fov: float) -> "Camera":
        """A camera for a world of `dim` dimensions; flatland leaves the height out."""
        return Camera.from_fov(width, None if dim == 2 else height, fov)

    @property
    def dim(self) -> int:
        """Dimension of the world that this camera looks at."""
        return len(self.size) + 1

    @property
    def size(self) -> tuple[int, ...]:
        """Pixels along each image axis, x first."""
        return (self.width,) if self.height is None else (self.width, self.height)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of an image, row-major: (width,) in flatland, (height, width) in 3-D."""
        return self.size[::-1]

    @property
    def fov(self) -> float:
        """Horizontal field of view [rad]."""
        return 2 * math.atan(self.width / 2 / self.focal)

    def pixels(self, like: Tensor) -> Float[Tensor, "pixels axes"]:
        """Pixel centres [px], row-major, x first; device and precision of `like`."""
        axes = [torch.arange(n).to(like) + 0.5 for n in self.size]
        mesh = torch.meshgrid(*axes[::-1], indexing="ij")
        return torch.stack([grid.reshape(-1) for grid in mesh[::-1]], -1)

    def rays(self, like: Tensor) -> Float[Tensor, "pixels d"]:
        """Direction of each pixel in the camera's frame, scaled to reach depth 1 along the axis."""
        half = torch.tensor(self.size).to(like) / 2
        slopes = (self.pixels(like) - half) / self.focal
        return torch.cat([slopes, torch.ones(len(slopes), 1).to(like)], 1)

    def project(self, local: Float[Tensor, "n d"]) -> tuple[Float[Tensor, "n m"], Float[Tensor, "n m d"]]:
        """π and its Jacobian at points in the camera's frame with positive depth.

        Returns image positions [px] and J [px/m]. J uses the viewing ray clamped to `EDGE` half images:
        without the clamp, splats beside the view grow huge in the image and leak into it.
        """
        depth = local[:, -1:]
        ray = local[:, :-1] / depth
        half = torch.tensor(self.size).to(local) / 2
        limit = EDGE * half / self.focal
        clamped = torch.minimum(torch.maximum(ray, -limit), limit)
        eye = torch.eye(len(half)).to(local).expand(len(local), -1, -1)
        jacobian = self.focal / depth[..., None] * torch.cat([eye, -clamped[..., None]], -1)
        return self.focal * ray + half, jacobian

    def differentials(self, local: Float[Tensor, "n d"]) -> tuple[Float[Tensor, "n m d"], Float[Tensor, "n m d d"]]:
        """Derivatives of `project`'s two results with respect to the point, the last axis."""
        depth, axes = local[:, -1], local.shape[1] - 1
        ray = local[:, :-1] / depth[:, None]
        limit = EDGE * torch.tensor(self.size).to(local) / 2 / self.focal
        eye = torch.eye(axes).to(local).expand(len(local), -1, -1)
        ray_slope = torch.cat([eye, -ray[..., None]], -1) / depth[:, None, None]
        _, jacobian = self.project(local)
        turn = torch.zeros(len(local), axes, axes + 1, axes + 1).to(local)
        turn[..., -1] = -jacobian / depth[:, None, None]
        inside = (ray.abs() < limit)[..., None]
        turn[..., -1, :] += torch.where(inside, -ray_slope, 0.0) * (self.focal / depth)[:, None, None]
        return self.focal * ray_slope, turn


@dataclass(frozen=True)
class Frame:
    """What an RGB-D camera took at `pose`: color (…, 3) in [0, 1], depth (…) along the axis [m], 0 where none."""

    color: Tensor
    depth: Tensor
    pose: Pose

    @property
    def valid(self) -> Tensor:
        """Where the sensor returned a depth."""
        return (self.depth > 0) & torch.isfinite(self.depth)


def back_project(frame: Frame, camera: Camera) -> Float[Tensor, "pixels d"]:
    """World points (pixels, d) [m] of a frame; meaningless where `frame.valid` is false."""
    depth = frame.depth.reshape(-1)
    pose = frame.pose.to(depth)
    return (camera.rays(depth) * depth[:, None]) @ pose.rotation.T + pose.position
