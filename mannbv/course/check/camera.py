"""Exercises of notebook 02: projection and its Jacobian, compositing, the mapping loss, a splat placed by its image."""

import math
from collections.abc import Callable

import numpy as np
import torch

from mannbv.camera import LOW_PASS, Camera
from mannbv.course.check.verdict import AGREES, exercise, side


@exercise(cases=[(0.3, 0.7, 32.0, 64), (0.5, 2.0, 32.0, 64), (-1.5, 1.0, 40.0, 51)])
def project(x, z, f, w):
    """my_project(x [m], z [m], focal [px], width [px]) → image position [px] of a point x to the right, z ahead."""
    u = Camera(w, None, f).project(torch.tensor([[x, z]], dtype=torch.float64))[0].item()
    return {
        AGREES: u,
        "a position need not be a whole pixel": [round(u), math.floor(u), math.ceil(u), int(u), f * x // z + w / 2],
        "half of an odd width is no whole number of pixels": u - w / 2 + w // 2,
        "half a pixel off: positions count from the left edge": u - 0.5,
        "straight ahead lies the middle of the image, not its right edge": u + w / 2,
        "upside down: what is twice as far away looks half as far aside": f * z / x + w / 2,
        "position 0 is the left edge of the image, not its middle": u - w / 2,
        "the sign: what lies to the right has the larger position": w - u,
        "an image is flat: the slope of the ray, not its angle": f * math.atan2(x, z) + w / 2,
        "divide by the depth along the axis, not the range": f * x / math.hypot(x, z) + w / 2,
        "the unit: a slope becomes pixels by the focal length": x / z + w / 2,
    }


@exercise(cases=[(0.5, 2.0, 32.0), (-0.9, 1.5, 40.0), (2.0, 5.0, 32.0)])
def jacobian(x, z, f):
    """my_jacobian(x [m], z [m], focal [px]) → (∂u/∂x, ∂u/∂z) [px/m], inside the view."""
    return {
        AGREES: Camera(1000, None, f).project(torch.tensor([[x, z]], dtype=torch.float64))[1].flatten(),
        "the sign of ∂u/∂z: what moves away moves towards the middle":
            [(f / z, f * x / z**2), (f / z, abs(f * x / z**2))],
        "x first, then z": (-f * x / z**2, f / z),
        "∂u/∂z must fall with the square of z": (f / z, -f * x / z),
        "the unit is px/m: where is the focal length?": (1 / z, -x / z**2),
        "u changes with z, too": (f / z, 0.0),
    }  # fmt: skip


def _weights(blend):
    through = torch.cumprod(1 - blend, 0)
    return blend * torch.cat([torch.ones(1).to(blend), through[:-1]])


@exercise(
    cases=[(torch.tensor(blend, dtype=torch.float64),) for blend in ([0.5], [0.3, 0.6, 0.2], [0.1, 0.8, 0.9, 0.4])],
)
def weights(b):
    """my_weights(blend (v,), front to back) → what each splat contributes to the pixel, Eq. (1): (v,)."""
    return {
        AGREES: _weights(b),
        "nobody hides anybody: where is the product?": b,
        "the last splat is in front: the product must run over those before": _weights(b.flip(0)).flip(0),
        "a splat hides itself: the product ends before i": b * torch.cumprod(1 - b, 0),
        "that is the transmittance; how much of it does the splat take?": _weights(b) / b,
        "two veils do not add up to one darker veil: multiply what each lets through": b * (1 - torch.cumsum(b, 0) + b),
        "multiply what the splats before let through, not what they take": torch.cumprod(b, 0),
        "the weights need not sum to one: the rest shines through": [b / b.sum(), _weights(b) / _weights(b).sum()],
    }


def _pixels(seed: int, psi: float, missing: int) -> tuple:
    """Six pixels, the first few without a true depth."""
    draw = torch.Generator().manual_seed(seed)
    a, b, d, e = (torch.rand(6, k, generator=draw, dtype=torch.float64) for k in (3, 3, 1, 1))
    truth, depth = 1 + e[:, 0], 1 + 2 * d[:, 0]
    truth[:missing] = 0.0
    depth[4:] *= missing == 0  # rendered where nothing is
    return a, b, depth, truth, psi


@exercise(cases=[_pixels(0, 0.5, 0), _pixels(1, 0.2, 2), _pixels(2, 0.9, 1)])
def loss(color, true_color, depth, true_depth, psi):
    """my_loss(color (P, 3), true_color, depth (P,) [m], true_depth, psi) → Eq. (2), a mean over pixels with a depth."""
    red, deep, seen, mean = color - true_color, depth - true_depth, true_depth > 0, torch.mean
    terms = red.abs().sum(1) + psi * deep.abs()
    return {
        AGREES: mean(terms[seen]),
        "that is the sum over pixels, as Eq. (2) writes it; the library takes the mean": terms[seen].sum(),
        "a pixel without a depth, 0 m, counts for neither colour nor depth": terms.mean(),
        "a pixel without a depth counts for neither term: drop its colour, too":
            red.abs().sum(1).mean() + psi * deep.abs()[seen].mean(),
        "divide by the pixels that count, not by all of them": terms[seen].sum() / len(seen),
        "it is the *true* depth that says which pixels count": mean(terms[depth > 0]),
        "those are squares: L1 takes absolute values": mean(((red**2).sum(1) + psi * deep**2)[seen]),
        "too much and too little must not cancel: where are the absolute values?":
            mean((red.sum(1) + psi * deep)[seen]),
        "ψ weighs the depth, not the colour": mean((psi * red.abs().sum(1) + deep.abs())[seen]),
        "the three channels of a colour are added, not averaged": mean((red.abs().mean(1) + psi * deep.abs())[seen]),
    }  # fmt: skip


def _place(pixel, depth, std, camera, low_pass=LOW_PASS, stretch: Callable = math.hypot, half=0.5):
    slope = (pixel - half * camera.width) / camera.focal
    return depth * slope, depth / camera.focal * math.sqrt(max(std**2 - low_pass, 0.0)) / stretch(1, slope)


def _part(case, answer, wanted):
    pixel, depth, std, camera = case
    asked = f"pixel {pixel:g} of {camera.width}, {depth:g} m ahead, {std:g} px wide"
    part = int(np.argmax(np.abs(answer - wanted)))
    return f"the {('place', 'size')[part]} is {side(float(answer[part]), float(wanted[part]))} for {asked},"


_WIDE, _NARROW = Camera.from_fov(64), Camera.from_fov(80, fov=1.2)


@exercise(cases=[(32.0, 2.0, 3.0, _WIDE), (10.0, 1.5, 2.0, _WIDE), (60.0, 4.0, 1.0, _NARROW)], gap=_part)
def place(pixel, depth, std, camera):
    """my_place(pixel, depth [m], std [px], camera) → (x [m], scale [m]) of the round splat that looks so."""
    case = pixel, depth, std, camera
    (x, scale), axis = _place(*case), lambda *entries: 1.0
    return {
        AGREES: (x, scale),
        "pixels count from the left edge, x from the middle":
            [_place(*case, half=0.0), (_place(*case, half=0.0)[0], scale)],
        "it comes out too wide: the camera adds its low pass to the variance": _place(*case, low_pass=0.0),
        "the camera adds the low pass itself: take it off first": _place(*case, low_pass=-LOW_PASS),
        "too wide away from the middle: J has two entries": _place(*case, stretch=axis),
        "right only in the middle and without the low pass": _place(*case, low_pass=0.0, stretch=axis),
        "the two entries of J do not add up: how long is a vector?":
            _place(*case, stretch=lambda *entries: sum(map(abs, entries))),
        "the low pass is a variance [px²]: it belongs to the square of `std`": [
            _place(*case, low_pass=math.sqrt(LOW_PASS)),
            _place(*case, low_pass=LOW_PASS**2),
            (x, scale * (std - LOW_PASS) / math.sqrt(std**2 - LOW_PASS)),
        ],
        "it lands on the other side: a sign": (-x, scale),
        "half a pixel off: `pixel` is a position already": [_place(pixel + half, *case[1:]) for half in (0.5, -0.5)],
        "the size is squared: a standard deviation [m] is wanted": (x, scale**2),
        "the size in metres is wanted, not its logarithm": (x, math.log(scale)),
        "swapped: first the place, then the size": (scale, x),
    }  # fmt: skip
