"""What is called of a room in space: forward, forward and gradient, Fisher."""

from collections.abc import Callable
from functools import partial

from torch import Tensor

from mannbv import information, render
from mannbv.lab.bench import scenes
from mannbv.splats import SplatMap


def gradient(splat_map: SplatMap, camera, pose, method: str = "auto") -> tuple[Tensor, ...]:
    """Gradients of the sum of every colour and depth by every field."""
    leaves = [part.detach().clone().requires_grad_() for part in splat_map.tensors()]
    drawn = render.render(SplatMap(*leaves), camera, pose, method)
    (drawn.color.sum() + drawn.depth.sum()).backward()
    return tuple(leaf.grad for leaf in leaves)


def whole_calls(n_splats: int, size: int, method: str = "auto") -> list[Callable[[], object]]:
    """Forward, forward and gradient, Fisher of a room in space, from its parameters."""
    view = scenes.room(n_splats, 3), *scenes.view(size, 3)
    return [partial(call, *view, method=method) for call in (render.render, gradient, information.fisher)]
