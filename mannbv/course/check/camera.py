"""Checks of notebook 02: projection, its Jacobian, compositing weights, the mapping loss, a splat placed by image."""

import math

import numpy as np
import torch

from mannbv.camera import LOW_PASS, Camera
from mannbv.course.check.verdict import compare, side


def project(mine) -> bool:
    """mine(x [m], z [m], focal [px], width [px]) → image position [px] of a point x to the right, z ahead."""

    def true(x, z, focal, width):
        return Camera(width, None, focal).project(torch.tensor([[x, z]], dtype=torch.float64))[0].item()

    whole = "a position need not be a whole pixel"
    return compare(
        mine, true, [(0.3, 0.7, 32.0, 64), (0.5, 2.0, 32.0, 64), (-1.5, 1.0, 40.0, 51)],
        [
            (lambda *case: round(true(*case)), whole),
            (lambda *case: math.floor(true(*case)), whole),
            (lambda *case: math.ceil(true(*case)), whole),
            (lambda *case: int(true(*case)), whole),
            (lambda x, z, f, w: f * x // z + w / 2, whole),
            (lambda x, z, f, w: f * x / z + w // 2, "half of an odd width is no whole number of pixels"),
            (lambda x, z, f, w: f * x / z + (w - 1) / 2, "half a pixel off: positions count from the left edge"),
            (lambda x, z, f, w: f * x / z + w, "straight ahead lies the middle of the image, not its right edge"),
            (lambda x, z, f, w: f * z / x + w / 2, "upside down: what is twice as far away looks half as far aside"),
            (lambda x, z, f, w: f * x / z, "position 0 is the left edge of the image, not its middle"),
            (lambda x, z, f, w: w / 2 - f * x / z, "the sign: what lies to the right has the larger position"),
            (lambda x, z, f, w: f * math.atan2(x, z) + w / 2, "an image is flat: the slope of the ray, not its angle"),
            (lambda x, z, f, w: f * x / math.hypot(x, z) + w / 2, "divide by the depth along the axis, not the range"),
            (lambda x, z, f, w: x / z + w / 2, "the unit: a slope becomes pixels by the focal length"),
        ],
    )  # fmt: skip


def jacobian(mine) -> bool:
    """mine(x [m], z [m], focal [px]) → (∂u/∂x, ∂u/∂z) [px/m], inside the view."""

    def true(x, z, focal):
        return Camera(1000, None, focal).project(torch.tensor([[x, z]], dtype=torch.float64))[1].flatten()

    return compare(
        mine, true, [(0.5, 2.0, 32.0), (-0.9, 1.5, 40.0), (2.0, 5.0, 32.0)],
        [
            (lambda x, z, f: (f / z, f * x / z**2), "the sign of ∂u/∂z: what moves away moves towards the middle"),
            (lambda x, z, f: (f / z, abs(f * x / z**2)), "the sign of ∂u/∂z: what moves away moves towards the middle"),
            (lambda x, z, f: (-f * x / z**2, f / z), "x first, then z"),
            (lambda x, z, f: (f / z, -f * x / z), "∂u/∂z must fall with the square of z"),
            (lambda x, z, f: (1 / z, -x / z**2), "the unit is px/m: where is the focal length?"),
            (lambda x, z, f: (f / z, 0 * x), "u changes with z, too"),
        ],
    )  # fmt: skip


def weights(mine) -> bool:
    """mine(blend (v,), front to back) → what each splat contributes to the pixel, Eq. (1): (v,)."""

    def true(blend):
        through = torch.cumprod(1 - blend, 0)
        return blend * torch.cat([torch.ones(1).to(blend), through[:-1]])

    def added(blend):
        return blend * (1 - torch.cumsum(blend, 0) + blend)

    cases = [(torch.tensor(values, dtype=torch.float64),) for values in ([0.5], [0.3, 0.6, 0.2], [0.1, 0.8, 0.9, 0.4])]
    return compare(
        mine, true, cases,
        [
            (lambda b: b, "nobody hides anybody: where is the product?"),
            (lambda b: true(b.flip(0)).flip(0), "the last splat is in front: the product must run over those before"),
            (lambda b: b * torch.cumprod(1 - b, 0), "a splat hides itself: the product ends before i"),
            (lambda b: true(b) / b, "that is the transmittance; how much of it does the splat take?"),
            (added, "two veils do not add up to one darker veil: multiply what each lets through"),
            (lambda b: torch.cumprod(b, 0), "multiply what the splats before let through, not what they take"),
            (lambda b: b / b.sum(), "the weights need not sum to one: the rest shines through"),
            (lambda b: true(b) / true(b).sum(), "the weights need not sum to one: the rest shines through"),
        ],
    )  # fmt: skip


def loss(mine) -> bool:
    """mine(color (P, 3), true_color, depth (P,) [m], true_depth, psi) → Eq. (2), a mean over pixels with a depth."""

    def true(color, true_color, depth, true_depth, psi, power=1, seen=None):
        seen = true_depth > 0 if seen is None else seen
        terms = ((color - true_color).abs() ** power).sum(1) + psi * (depth - true_depth).abs() ** power
        return terms[seen].sum() / seen.sum()

    def total(c, tc, d, td, psi):
        return true(c, tc, d, td, psi) * (td > 0).sum()

    def everywhere(c, tc, d, td, psi):
        return true(c, tc, d, td, psi, seen=torch.ones_like(td, dtype=torch.bool))

    def colours_everywhere(c, tc, d, td, psi):
        return (c - tc).abs().sum(1).mean() + psi * (d - td).abs()[td > 0].mean()

    def by_rendered(c, tc, d, td, psi):
        return true(c, tc, d, td, psi, seen=d > 0)

    def signed(c, tc, d, td, psi):
        return ((c - tc).sum(1) + psi * (d - td))[td > 0].mean()

    def channels(c, tc, d, td, psi):
        return ((c - tc).abs().mean(1) + psi * (d - td).abs())[td > 0].mean()

    def swapped(c, tc, d, td, psi):
        return (psi * (c - tc).abs().sum(1) + (d - td).abs())[td > 0].mean()

    def case(seed, psi, missing):
        draw = torch.Generator().manual_seed(seed)
        a, b, d, e = (torch.rand(6, k, generator=draw, dtype=torch.float64) for k in (3, 3, 1, 1))
        truth, depth = 1 + e[:, 0], 1 + 2 * d[:, 0]
        truth[:missing] = 0.0
        depth[4:] *= missing == 0  # rendered where nothing is
        return a, b, depth, truth, psi

    return compare(
        mine, true, [case(0, 0.5, 0), case(1, 0.2, 2), case(2, 0.9, 1)],
        [
            (total, "that is the sum over pixels, as Eq. (2) writes it; the library takes the mean"),
            (everywhere, "a pixel without a depth, 0 m, counts for neither colour nor depth"),
            (colours_everywhere, "a pixel without a depth counts for neither term: drop its colour, too"),
            (lambda *c: total(*c) / len(c[3]), "divide by the pixels that count, not by all of them"),
            (by_rendered, "it is the *true* depth that says which pixels count"),
            (lambda *c: true(*c, power=2), "those are squares: L1 takes absolute values"),
            (signed, "too much and too little must not cancel: where are the absolute values?"),
            (swapped, "ψ weighs the depth, not the colour"),
            (channels, "the three channels of a colour are added, not averaged"),
        ],
    )  # fmt: skip


def place(mine) -> bool:
    """mine(pixel, depth [m], std [px], camera) → (x [m], scale [m]) of the round splat that looks so."""

    def true(pixel, depth, std, camera, low_pass=LOW_PASS, stretch=math.hypot, half=0.5):
        slope = (pixel - half * camera.width) / camera.focal
        return depth * slope, depth / camera.focal * math.sqrt(max(std**2 - low_pass, 0.0)) / stretch(1, slope)

    def middle(*slopes):
        return 1.0

    def added(*slopes):
        return sum(map(abs, slopes))

    def moved(pixels):
        return lambda pixel, *rest: true(pixel + pixels, *rest)

    def resized(change):
        """Another size in the right place; change: a function of the right size and the case."""
        return lambda *case: (true(*case)[0], change(true(*case)[1], *case))

    def gap(case, answer, wanted):
        pixel, depth, std, camera = case
        asked = f"pixel {pixel:g} of {camera.width}, {depth:g} m ahead, {std:g} px wide"
        part = int(np.argmax(np.abs(answer - wanted)))
        return f"the {('place', 'size')[part]} is {side(float(answer[part]), float(wanted[part]))} for {asked},"

    wide, narrow = Camera.from_fov(64), Camera.from_fov(80, fov=1.2)
    variance = "the low pass is a variance [px²]: it belongs to the square of `std`"
    edge = "pixels count from the left edge, x from the middle"
    return compare(
        mine, true, [(32.0, 2.0, 3.0, wide), (10.0, 1.5, 2.0, wide), (60.0, 4.0, 1.0, narrow)],
        [
            (lambda *c: true(*c, half=0.0), edge),
            (lambda *c: (true(*c, half=0.0)[0], true(*c)[1]), edge),
            (lambda *c: true(*c, low_pass=0.0), "it comes out too wide: the camera adds its low pass to the variance"),
            (lambda *c: true(*c, low_pass=-LOW_PASS), "the camera adds the low pass itself: take it off first"),
            (lambda *c: true(*c, stretch=middle), "too wide away from the middle: J has two entries"),
            (lambda *c: true(*c, low_pass=0.0, stretch=middle), "right only in the middle and without the low pass"),
            (lambda *c: true(*c, stretch=added), "the two entries of J do not add up: how long is a vector?"),
            (lambda *c: true(*c, low_pass=math.sqrt(LOW_PASS)), variance),
            (lambda *c: true(*c, low_pass=LOW_PASS**2), variance),
            (resized(lambda size, p, d, s, c: size * (s - LOW_PASS) / math.sqrt(s**2 - LOW_PASS)), variance),
            (lambda *c: (-true(*c)[0], true(*c)[1]), "it lands on the other side: a sign"),
            (moved(0.5), "half a pixel off: `pixel` is a position already"),
            (moved(-0.5), "half a pixel off: `pixel` is a position already"),
            (resized(lambda size, *c: size**2), "the size is squared: a standard deviation [m] is wanted"),
            (resized(lambda size, *c: math.log(size)), "the size in metres is wanted, not its logarithm"),
            (lambda *c: true(*c)[::-1], "swapped: first the place, then the size"),
        ],
        gap=gap,
    )  # fmt: skip
