"""Checks of notebook 13: the quaternion of a yaw, the splats a robot can run into, the parameters of a splat."""

import math
from collections.abc import Callable

import numpy as np
import torch

from mannbv import information, splats
from mannbv.course.check.verdict import compare
from mannbv.splats import SplatMap


def quaternion(mine: Callable) -> bool:
    """mine(yaw [rad]) → (w, x, y, z) of the turn by `yaw` about the vertical; of ±q either one."""

    def one_sign(answer):
        if not hasattr(answer, "__len__") or len(answer) != 4:
            return answer
        q = np.array([float(part) for part in answer])
        return q * np.sign(q[np.argmax(np.abs(q))])  # q and −q are one rotation

    def true(yaw):
        turned = torch.tensor([[math.cos(yaw), math.sin(yaw)]], dtype=torch.float64)
        zero = torch.zeros(1, 2, dtype=torch.float64)
        flat = SplatMap(zero, zero, turned, zero[:, 0], torch.zeros(1, 3, dtype=torch.float64))
        return splats.lifted(flat, [0.0], 1.0).rotations[0]

    def about(x, y):
        return lambda yaw: (math.cos(yaw / 2), x * math.sin(yaw / 2), y * math.sin(yaw / 2), 0.0)

    mistakes = [
        (lambda yaw: true(2 * yaw), "half of the angle stands in a quaternion: it acts from both sides"),
        (lambda yaw: true(-yaw), "turned the wrong way: seen from above, a positive yaw is counter-clockwise"),
        (lambda yaw: -true(yaw).roll(-1), "the order here is (w, x, y, z): the cosine stands first"),
        (about(1, 0), "that turns about x, and would tip the splat over: the vertical is z"),
        (about(0, 1), "that turns about y, and would tip the splat over: the vertical is z"),
        (lambda yaw: true(math.radians(yaw)), "the yaw is in radians already"),
        (lambda yaw: true(math.degrees(yaw)), "sines and cosines are of radians, and the yaw is in radians"),
    ]
    return compare(
        lambda yaw: one_sign(mine(yaw)),
        lambda yaw: one_sign(true(yaw)),
        [(0.4,), (-1.9,), (2.7,), (math.pi,)],
        [(lambda yaw, wrong=wrong: one_sign(wrong(yaw)), hint) for wrong, hint in mistakes],
        rtol=1e-4,
        atol=1e-6,
    )


def body(mine: Callable) -> bool:
    """mine(splat_map, low, high, cut) → which splats (n,) are between two heights [m] and more opaque than `cut`."""
    rng = np.random.default_rng(3)
    means, logits = torch.from_numpy(rng.uniform(-0.5, 3.0, (60, 3))), torch.from_numpy(rng.normal(0.5, 1.5, 60))
    scales, turned = torch.full((60, 3), -2.0).double(), torch.from_numpy(rng.normal(size=(60, 4)))
    room = SplatMap(means, scales, turned, logits, torch.zeros(60, 3).double())

    def chosen(axis=2, at_least=True, at_most=True, cut=lambda m, cut: m.opacities > cut):
        def select(splat_map, low, high, limit):
            height = splat_map.means[:, axis]
            kept = cut(splat_map, limit)
            kept = kept & (height >= low) if at_least else kept
            return kept & (height <= high) if at_most else kept

        return select

    def inside_out(splat_map, low, high, cut):
        height = splat_map.means[:, 2]
        return ((height < low) | (height > high)) & (splat_map.opacities > cut)

    def wrong_splat(case, answer, wanted):
        first = int(np.flatnonzero(answer != wanted)[0])
        return f"splat {first} should {'' if wanted[first] else 'not '}be chosen"

    return compare(
        mine,
        chosen(),
        [(room, 0.05, 1.3, 0.5), (room, 0.6, 2.0, 0.3)],
        [
            (chosen(axis=1), "that is y: heights stand in the last column"),
            (chosen(axis=0), "that is x: heights stand in the last column"),
            (chosen(at_least=False), "the floor still counts: where is the lower end of the body?"),
            (chosen(at_most=False), "the ceiling still counts: where is the upper end of the body?"),
            (chosen(cut=lambda m, cut: m.opacities > -1), "splats that are hardly there count as well"),
            (chosen(cut=lambda m, cut: m.opacity_logits > cut), "that compares logits with the cut: where is sigmoid?"),
            (chosen(cut=lambda m, cut: m.opacities < cut), "the faint ones are kept, and the opaque ones left out"),
            (inside_out, "those are above and below the body: the band is turned inside out"),
        ],
        gap=wrong_splat,
    )


def parameters(mine: Callable) -> bool:
    """mine(dim) → how many numbers of a splat can be changed independently in `dim` dimensions."""
    true = information.n_parameters
    return compare(
        mine,
        true,
        [(2,), (3,), (4,)],
        [
            (lambda d: true(d) + 1, "one too many: a rotation is stored with a number more than it is free to change"),
            (lambda d: true(d) - 3, "three are missing: has it no colour?"),
            (lambda d: true(d) - 2, "two are missing: a colour has three numbers"),
            (lambda d: true(d) - 1, "one is missing: how opaque is it?"),
            (lambda d: 2 * d + 4, "it may also be turned"),
            (lambda d: 3 * d + 4, "right in space only: a turn goes on in a plane, and how many planes have d axes?"),
            (lambda d: 2 * d + d * (d + 1) // 2 + 4, "too many turns: an axis has no plane with itself"),
            (lambda d: d + d * d + 4, "Σ is symmetric: turning x towards y and y towards x is one freedom, not two"),
        ],
    )
