"""What is called of a room in space: forward, forward and gradient, Fisher."""

from collections.abc import Callable
from functools import partial

import torch
from torch import Tensor

from mannbv import information, render
from mannbv.camera import Camera
from mannbv.geometry import Pose
from mannbv.lab.bench import scenes
from mannbv.splats import SplatMap


def gradient(splat_map: SplatMap, camera: Camera, pose: Pose, method: str = "auto") -> tuple[Tensor, ...]:
    """Gradients of the sum of every colour and depth by every field."""
    leaves = [part.detach().clone().requires_grad_() for part in splat_map.tensors()]
    drawn = render.render(SplatMap(*leaves), camera, pose, method)
    return torch.autograd.grad(drawn.color.sum() + drawn.depth.sum(), leaves)


def whole_calls(n_splats: int, size: int, method: str = "auto") -> list[Callable[[], object]]:
    """Forward, forward and gradient, Fisher of a room in space, from its parameters."""
    view = scenes.room(n_splats, 3), *scenes.view(size, 3)
    return [partial(call, *view, method=method) for call in (render.render, gradient, information.fisher)]
