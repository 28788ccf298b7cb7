"""Which renderer draws: the fast kernel where it applies, the dense reference elsewhere."""

import warnings
from types import ModuleType

import torch
from torch import Tensor

from mannbv.camera import Camera
from mannbv.geometry import Pose
from mannbv.render import dense, flat, space
from mannbv.render.dense import Rendering
from mannbv.splats import SplatMap

METHODS = ("auto", "dense", "tiled")


def engine(method: str, splat_map: SplatMap, *others: Tensor) -> ModuleType | None:
    """The kernel's module that `method` means here (`flat` or `space`), or None for the dense twin.

    A kernel serves float32 on the CPU, with no gradient asked of `others`. "tiled" on another device warns and leaves
    it to the twin. Raises ValueError for an unknown method, and for "tiled" where no kernel applies.
    """
    if method not in METHODS:
        raise ValueError(f"render: unknown method '{method}'; use {', '.join(METHODS)}")
    fitting = next((kernel for kernel in (flat, space) if kernel.serves(splat_map, *others)), None)
    device = splat_map.means.device.type
    if method == "tiled" and device != "cpu":
        text = f"render: the kernel runs on the CPU, this map is on {device}: the dense twin draws it"
        warnings.warn(text, stacklevel=3)
    elif method == "tiled" and fitting is None:
        raise ValueError(
            "render: the kernel serves float32 on the CPU; for gradients in the pose, or of information, use dense"
        )
    return None if method == "dense" else fitting


def render(splat_map: SplatMap, camera: Camera, pose: Pose, method: str = "auto") -> Rendering:
    """Draw a map: C_p = Σ c_i ρ_i Π_{j<i} (1 − ρ_j), Eq. (1), and likewise depth [m] and opacity.

    Differentiable in the map. method: "dense", the reference, also differentiable in the pose, and twice;
    "tiled", the kernel, which drops blends under 1/255 and ends a pixel at transmittance 1e-4; "auto", the kernel
    where it applies. Raises ValueError if map, camera and pose disagree about the dimension.
    """
    dense.check(splat_map, camera, pose)
    kernel = engine(method, splat_map, *((pose.rotation, pose.position) if torch.is_grad_enabled() else ()))
    if kernel is None:
        return dense.render(splat_map, camera, pose)
    image = kernel.render(splat_map, camera, pose)
    return Rendering(image[:3].movedim(0, -1), image[3], image[4])
