"""The gain of all yaws at one position, from one look in all directions."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike
from torch import Tensor

from mannbv import consensus, geometry, render, splats
from mannbv.camera import Camera
from mannbv.config import Config, Noise
from mannbv.geometry import Pose
from mannbv.information.fisher import n_parameters
from mannbv.information.gain import gain, view_gain, worth_of
from mannbv.render import panorama
from mannbv.splats import SplatMap

_DEFAULT = Config()


@dataclass(frozen=True)
class YawProfile:
    """The gain of every yaw at one position: gains (M,) at yaws (M,) = −π + 2π m / M [rad]."""

    yaws: np.ndarray
    gains: np.ndarray
    evaluate: Callable[[float], tuple[float, float]]

    @torch.no_grad()  # so that separate views take the renderer that `gains` took
    def gain_at(self, yaw: float) -> float:
        return self.evaluate(yaw)[0]

    @torch.enable_grad()
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


uniform_yaws = consensus.grid  # profiles and what robots agree on have one grid of yaws


def yaw_profile(
    splat_map: SplatMap,
    camera: Camera,
    position: ArrayLike,
    prior: Float[Tensor, "n p"],
    weights: Float[Tensor, " n"] | None = None,
    selected: Bool[Tensor, " n"] | None = None,
    damping: ArrayLike | None = None,
    n_yaws: int = _DEFAULT.n_yaws,
    others: SplatMap | None = None,
    method: str = "auto",
    sigma_color: float = _DEFAULT.sigma_color,
    sigma_depth: float = _DEFAULT.sigma_depth,
    pitch: float = 0.0,
    weigh_prior: bool = False,
    literal_views: int | None = None,
) -> YawProfile:
    """Gain (15) of all yaws at `position` (d,) [m], and in 3-D at a fixed `pitch` [rad], upwards; arguments as in
    `fisher` and `gain`.

    method "views" takes one Fisher a yaw. "panorama" looks once in all directions: the information density over
    direction, read by the pixels of every yaw, a circular correlation. Depth along the camera's axis is linear in the
    axis, so one density for each product of two of its components gives the depth channel. A pinhole stretches what it
    sees towards the image's edge, hence densities for several places in the image. What is left to differ from
    separate views: the near plane, what lies between those places and directions, in 3-D also how splats fall between
    pixels and how an image stretches the largest. "auto": the panorama, but for cameras that see nearly straight up or
    down. Raises ValueError for a method that does not serve, and for a pitch in flatland.
    """
    pitch = float(pitch)
    view = _view(position, 0.0, pitch, camera)
    render.check(splat_map, camera, view)
    if method not in ("auto", "panorama", "views"):
        raise ValueError(f"yaw_profile: unknown method '{method}'; use auto, panorama or views")
    served = panorama.serves(camera, pitch)
    if method == "panorama" and not served:
        steepest = math.degrees(panorama.STEEPEST)
        raise ValueError(f"yaw_profile: a panorama ends {steepest:.0f}° above and below the horizon; use views")
    p = n_parameters(splat_map.dim)
    if not (sigma_color > 0 and sigma_depth > 0):
        raise ValueError(f"yaw_profile: sigma_color and sigma_depth must be positive, got {sigma_color}, {sigma_depth}")
    if prior.shape[1:] != (p,) and (prior.shape[1:] != (p, p) or (served and method != "views")):
        text = f"yaw_profile: needs a prior of {p} columns, got {tuple(prior.shape)}; for blocks use method='views'"
        raise ValueError(text)
    if len(prior) != splat_map.n_splats or n_yaws < 1:
        rows = f"{len(prior)} rows of prior for {splat_map.n_splats} splats"
        raise ValueError(f"yaw_profile: needs a row a splat and at least one yaw, got {rows} and {n_yaws} yaws")
    yaws = uniform_yaws(n_yaws)
    options = {"weights": weights, "selected": selected, "damping": damping}
    options |= {"weigh_prior": weigh_prior, "literal_views": literal_views}
    if method == "views" or not served:
        noise = Noise(sigma_color=sigma_color, sigma_depth=sigma_depth)

        def look(yaw: float) -> tuple[float, float]:
            angle = torch.tensor(float(yaw), dtype=splat_map.means.dtype, requires_grad=torch.is_grad_enabled())
            pose = _view(torch.as_tensor(position).to(splat_map.means), angle, pitch, camera)
            value = view_gain(splat_map, camera, pose, prior, others, noise, **options)
            slope = torch.autograd.grad(value, angle)[0] if value.requires_grad else 0.0
            return value.item(), float(slope)

        with torch.no_grad():
            return YawProfile(yaws, np.array([look(yaw)[0] for yaw in yaws]), look)
    worth = worth_of(prior, **options)
    still = gain(torch.zeros_like(prior), prior, **options).item()  # what "+λI" gains in a view of nothing
    if others is not None:
        worth = torch.cat([worth, torch.zeros(others.n_splats, worth.shape[1]).to(worth)])
        splat_map = splats.union(splat_map, others)
    around = panorama.look(splat_map, camera, position, worth, pitch, sigma_color, sigma_depth)
    up = view.rotation[2:, -1].numpy()  # of the axis: nothing in flatland

    def evaluate(yaw: float) -> tuple[float, float]:
        angle = np.array([float(yaw)])
        (seen, rates), (turn, turn_rate) = around.read(angle), _axis_terms(angle, up)
        return still + max(float((seen * turn).sum()), 0.0), float((rates * turn + seen * turn_rate).sum())

    gains = (around.uniform(n_yaws) * _axis_terms(yaws, up)[0]).sum(0)
    return YawProfile(
        yaws, still + np.maximum(gains, 0.0), evaluate
    )  # what lies between columns may dip a hair below zero


def _view(position, yaw, pitch: float, camera: Camera) -> Pose:
    """A camera along `yaw`, tilted upwards by `pitch` [rad]."""
    level = geometry.yaw_pose(position, yaw)
    if not pitch:
        return level
    if camera.height is None:
        raise ValueError(f"yaw_profile: a flatland camera cannot look up; pitch must be 0, got {pitch}")
    tilt = geometry.so_exp(torch.tensor([pitch, 0.0, 0.0]).to(level.rotation))
    return Pose(level.rotation @ tilt, level.position)


def _axis_terms(yaw: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What multiplies the quantities of a camera along `yaw` (k,), and its slope, (quantities, k).

    1 for colour, then the products of the axis with itself, the upper triangle of a matrix. up: the axis's components
    above the ground.
    """
    level = math.sqrt(1 - float(up @ up))
    flat, zero = np.ones_like(yaw), np.zeros_like(yaw)
    axis = np.stack([level * np.cos(yaw), level * np.sin(yaw), *(u * flat for u in up)])
    rate = np.stack([-level * np.sin(yaw), level * np.cos(yaw), *(zero for _ in up)])
    first, second = np.triu_indices(len(axis))
    twice = np.where(first == second, 1.0, 2.0)[:, None]
    terms = twice * axis[first] * axis[second]
    slopes = twice * (rate[first] * axis[second] + axis[first] * rate[second])
    return np.concatenate([flat[None], terms]), np.concatenate([zero[None], slopes])
