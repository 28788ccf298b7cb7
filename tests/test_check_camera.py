"""The checks of notebook 02: right answers agree, empty ones are to do, plausible wrong ones get the right hint."""

import math

import numpy as np
import pytest
import torch

from mannbv import geometry, mapping, render
from mannbv.camera import Camera, Frame
from mannbv.course.check import camera as check
from mannbv.splats import SplatMap


def weights(blend):
    through, result = 1.0, []
    for rho in blend.tolist():
        result.append(rho * through)
        through *= 1 - rho
    return np.array(result)


def loss(color, true_color, depth, true_depth, psi):
    terms = (color - true_color).abs().sum(1) + psi * (depth - true_depth).abs()
    return terms[true_depth > 0].mean()


def place(pixel, depth, std, camera):
    slope = (pixel - camera.width / 2) / camera.focal
    return depth * slope, depth / camera.focal * math.sqrt((std**2 - 0.3) / (1 + slope**2))


EXERCISES = {
    "project": lambda x, z, f, w: w / 2 + f * x / z,
    "jacobian": lambda x, z, f: (f / z, -f * x / z**2),
    "weights": weights,
    "loss": loss,
    "place": place,
}


@pytest.mark.parametrize("exercise", EXERCISES)
def test_right_answers_agree_and_empty_ones_are_to_do(capsys, exercise):
    assert getattr(check, exercise)(EXERCISES[exercise]) is True
    assert capsys.readouterr().out == "agrees with the library\n"
    assert getattr(check, exercise)(lambda *case: None) is False
    assert getattr(check, exercise)(lambda *case: ...) is False
    assert capsys.readouterr().out == "to do\nto do\n"


def behind(blend):
    return np.array(weights(blend.flip(0))[::-1])


def colour_of_all(color, true_color, depth, true_depth, psi):
    seen = true_depth > 0
    return (color - true_color).abs().sum(1).mean() + psi * (depth - true_depth)[seen].abs().mean()


def entries_added(pixel, depth, std, camera):
    slope = (pixel - camera.width / 2) / camera.focal
    return depth * slope, depth / camera.focal * math.sqrt(std**2 - 0.3) / (1 + abs(slope))


def scale_only(pixel, depth, std, camera):
    return place(pixel, depth, std, camera)[0], depth / camera.focal * std


@pytest.mark.parametrize(
    ("exercise", "mine", "hint"),
    [
        ("project", lambda x, z, f, w: f * x / z, "left edge of the image"),
        ("project", lambda x, z, f, w: w / 2 - f * x / z, "the sign"),
        ("project", lambda x, z, f, w: w / 2 + f * math.atan(x / z), "not its angle"),
        ("project", lambda x, z, f, w: w / 2 + f * x / math.sqrt(x * x + z * z), "not the range"),
        ("project", lambda x, z, f, w: w / 2 + x / z, "the unit"),
        ("project", lambda x, z, f, w: int(f * x / z + w / 2), "a whole pixel"),
        ("project", lambda x, z, f, w: round(f * x / z + w / 2), "a whole pixel"),
        ("project", lambda x, z, f, w: math.ceil(f * x / z + w / 2), "a whole pixel"),
        ("project", lambda x, z, f, w: f * x // z + w / 2, "a whole pixel"),
        ("project", lambda x, z, f, w: f * x / z + w // 2, "an odd width"),
        ("project", lambda x, z, f, w: f * x / z + (w - 1) / 2, "half a pixel off"),
        ("project", lambda x, z, f, w: f * x / z + w, "its right edge"),
        ("project", lambda x, z, f, w: f * z / x + w / 2, "upside down"),
        ("project", lambda x, z, f, w: f * x / z + w / 3, "too small for x = 0.3, z = 0.7, f = 32, w = 64"),
        ("jacobian", lambda x, z, f: (f / z, f * x / z**2), "the sign of ∂u/∂z"),
        ("jacobian", lambda x, z, f: (f / z, abs(f * x / z**2)), "the sign of ∂u/∂z"),
        ("jacobian", lambda x, z, f: (-f * x / z**2, f / z), "x first"),
        ("jacobian", lambda x, z, f: (f / z, -f * x / z), "square of z"),
        ("jacobian", lambda x, z, f: (1 / z, -x / z**2), "px/m"),
        ("jacobian", lambda x, z, f: (f / z, 0.0), "with z, too"),
        ("weights", lambda b: b, "where is the product?"),
        ("weights", behind, "the last splat is in front"),
        ("weights", lambda b: b * torch.cumprod(1 - b, 0), "hides itself"),
        ("weights", lambda b: weights(b) / b.numpy(), "that is the transmittance"),
        ("weights", lambda b: b * (1 - (torch.cumsum(b, 0) - b)), "do not add up"),
        ("weights", lambda b: np.cumprod(b.numpy()), "let through, not"),
        ("weights", lambda b: b / b.sum(), "need not sum to one"),
        ("weights", lambda b: weights(b) / weights(b).sum(), "need not sum to one"),
        ("loss", lambda c, tc, d, td, p: loss(c, tc, d, td, p) * (td > 0).sum(), "the library takes the mean"),
        ("loss", lambda c, tc, d, td, p: ((c - tc).abs().sum(1) + p * (d - td).abs()).mean(), "counts for neither"),
        ("loss", lambda c, tc, d, td, p: (((c - tc) ** 2).sum(1) + p * (d - td) ** 2)[td > 0].mean(), "squares"),
        ("loss", lambda c, tc, d, td, p: ((c - tc).sum(1) + p * (d - td))[td > 0].mean(), "must not cancel"),
        ("loss", lambda c, tc, d, td, p: (p * (c - tc).abs().sum(1) + (d - td).abs())[td > 0].mean(), "ψ weighs"),
        ("loss", colour_of_all, "neither term"),
        ("loss", lambda c, tc, d, td, p: loss(c, tc, d, td, p) * (td > 0).sum() / len(d), "divide by the pixels"),
        ("loss", lambda c, tc, d, td, p: ((c - tc).abs().sum(1) + p * (d - td).abs())[d != 0].mean(), "*true* depth"),
        ("loss", lambda c, tc, d, td, p: loss(c / 3, tc / 3, d, td, p), "added, not averaged"),
        ("place", lambda p, d, s, c: (d * p / c.focal, place(p, d, s, c)[1]), "from the left edge"),
        ("place", scale_only, "only in the middle"),
        ("place", lambda p, d, s, c: place(p, d, math.sqrt(s * s + 0.3), c), "adds its low pass"),
        ("place", lambda p, d, s, c: (place(p, d, s, c)[0], place(c.width / 2, d, s, c)[1]), "J has two entries"),
        ("place", lambda p, d, s, c: place(p, d, math.sqrt(s * s + 0.6), c), "adds the low pass itself"),
        ("place", lambda p, d, s, c: place(p, d, math.hypot(s - 0.3, math.sqrt(0.3)), c), "square of `std`"),
        ("place", lambda p, d, s, c: place(p, d, math.sqrt(s * s + 0.3 - 0.09), c), "square of `std`"),
        ("place", lambda p, d, s, c: (-place(p, d, s, c)[0], place(p, d, s, c)[1]), "the other side"),
        ("place", lambda p, d, s, c: place(p + 0.5, d, s, c), "half a pixel off"),
        ("place", lambda p, d, s, c: (place(p, d, s, c)[0], place(p, d, s, c)[1] ** 2), "squared"),
        ("place", lambda p, d, s, c: (place(p, d, s, c)[0], math.log(place(p, d, s, c)[1])), "logarithm"),
        ("place", lambda p, d, s, c: place(p, d, s, c)[::-1], "swapped"),
        ("place", entries_added, "do not add up"),
        ("place", lambda p, d, s, c: place(2 * p, d, s, c), "the place is too large for pixel 32 of 64"),
        ("place", lambda p, d, s, c: place(p, d, 2 * s, c), "the size is too large for pixel 32 of 64, 2 m ahead"),
    ],
)  # fmt: skip
def test_a_plausible_wrong_answer_gets_its_hint(capsys, exercise, mine, hint):
    assert getattr(check, exercise)(mine) is False
    assert hint in capsys.readouterr().out


def test_the_right_answers_are_the_librarys(rng):
    """The weights, the loss and the placing against the renderer and the mapping themselves."""
    camera, pose = Camera.from_fov(64), geometry.yaw_pose(torch.zeros(2, dtype=torch.float64), 0.0)
    x, scale = place(10.0, 1.5, 2.0, camera)
    spot = SplatMap(*(torch.tensor(t, dtype=torch.float64) for t in (
        [[1.5, -x], [3.0, 0.2]], [[math.log(scale)] * 2, [-1.0, -2.0]], [[1.0, 0.0], [0.6, 0.8]], [0.0, 2.0],
        [[0.2, 0.5, 0.9], [0.7, 0.1, 0.3]],
    )))  # fmt: skip
    drawn = render.compose(spot, camera, pose)
    pixels = camera.pixels(spot.means)[:, 0]
    assert torch.allclose(drawn.blend[0], 0.5 * torch.exp(-((pixels - 10.0) ** 2) / (2 * 2.0**2)))
    assert np.allclose(drawn.weight[:, 20], weights(drawn.blend[:, 20]))
    image = render.render(spot, camera, pose)
    truth = torch.from_numpy(rng.uniform(1, 2, 64)) * (torch.arange(64) > 5)
    frame = Frame(torch.from_numpy(rng.uniform(0, 1, (64, 3))), truth, pose)
    assert torch.allclose(
        mapping.loss(spot, camera, frame, 0.5), loss(image.color, frame.color, image.depth, truth, 0.5)
    )
