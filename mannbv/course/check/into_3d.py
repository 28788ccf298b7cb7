"""Exercises of notebook 13: the quaternion of a yaw, the splats a robot can run into, the parameters of a splat."""

import math

import numpy as np
import torch

from mannbv import information, splats
from mannbv.course.check.verdict import AGREES, exercise, plain
from mannbv.splats import SplatMap


def _quaternion(yaw):
    turned = torch.tensor([[math.cos(yaw), math.sin(yaw)]], dtype=torch.float64)
    zero = torch.zeros(1, 2, dtype=torch.float64)
    flat = SplatMap(zero, zero, turned, zero[:, 0], torch.zeros(1, 3, dtype=torch.float64))
    return splats.lifted(flat, [0.0], 1.0).rotations[0]


def _one_sign(answer):
    """Of q and −q, one rotation, the one whose largest entry is positive."""
    q = plain([float(part) for part in answer] if isinstance(answer, tuple | list) else answer)
    return q * np.sign(q[np.argmax(np.abs(q))]) if q.shape == (4,) else q


@exercise(cases=[(0.4,), (-1.9,), (2.7,), (math.pi,)], read=_one_sign)
def quaternion(yaw):
    """my_quaternion(yaw [rad]) → (w, x, y, z) of the turn by `yaw` about the vertical; of ±q either one."""
    return {
        AGREES: _quaternion(yaw),
        "half of the angle stands in a quaternion: it acts from both sides": _quaternion(2 * yaw),
        "turned the wrong way: seen from above, a positive yaw is counter-clockwise": _quaternion(-yaw),
        "the order here is (w, x, y, z): the cosine stands first": _quaternion(yaw).roll(-1),
        "that turns about x, and would tip the splat over: the vertical is z": _quaternion(yaw)[[0, 3, 1, 2]],
        "that turns about y, and would tip the splat over: the vertical is z": _quaternion(yaw)[[0, 1, 3, 2]],
        "the yaw is in radians already": _quaternion(math.radians(yaw)),
        "sines and cosines are of radians, and the yaw is in radians": _quaternion(math.degrees(yaw)),
    }


def _room() -> SplatMap:
    rng = np.random.default_rng(3)
    means, logits = torch.from_numpy(rng.uniform(-0.5, 3.0, (60, 3))), torch.from_numpy(rng.normal(0.5, 1.5, 60))
    turned = torch.from_numpy(rng.normal(size=(60, 4)))
    return SplatMap(means, torch.full((60, 3), -2.0).double(), turned, logits, torch.zeros(60, 3).double())


def _chosen(case, answer, wanted):
    first = int(np.flatnonzero(answer != wanted)[0])
    return f"splat {first} should {'' if wanted[first] else 'not '}be chosen"


@exercise(cases=[(_room(), 0.05, 1.3, 0.5), (_room(), 0.6, 2.0, 0.3)], gap=_chosen)
def body(m, low, high, cut):
    """my_body(splat_map, low, high, cut) → which splats (n,) are between two heights [m] and more opaque than `cut`."""
    opaque, above, below = m.opacities > cut, m.means >= low, m.means <= high
    band = above & below
    return {
        AGREES: (m.means[:, 2] >= low) & (m.means[:, 2] <= high) & (m.opacities > cut),
        "that is y: heights stand in the last column": band[:, 1] & opaque,
        "that is x: heights stand in the last column": band[:, 0] & opaque,
        "the floor still counts: where is the lower end of the body?": below[:, 2] & opaque,
        "the ceiling still counts: where is the upper end of the body?": above[:, 2] & opaque,
        "splats that are hardly there count as well": band[:, 2],
        "that compares logits with the cut: where is sigmoid?": band[:, 2] & (m.opacity_logits > cut),
        "the faint ones are kept, and the opaque ones left out": band[:, 2] & ~opaque,
        "those are above and below the body: the band is turned inside out": ~band[:, 2] & opaque,
    }


@exercise(cases=[(2,), (3,), (4,)])
def parameters(dim):
    """my_parameters(dim) → how many numbers of a splat can be changed independently in `dim` dimensions."""
    true = information.n_parameters(dim)
    return {
        AGREES: information.n_parameters(dim),
        "one too many: a rotation is stored with a number more than it is free to change": true + 1,
        "three are missing: has it no colour?": true - 3,
        "two are missing: a colour has three numbers": true - 2,
        "one is missing: how opaque is it?": true - 1,
        "it may also be turned": 2 * dim + 4,
        "right in space only: a turn goes on in a plane, and how many planes have d axes?": 3 * dim + 4,
        "too many turns: an axis has no plane with itself": 2 * dim + dim * (dim + 1) // 2 + 4,
        "Σ is symmetric: turning x towards y and y towards x is one freedom, not two": dim + dim * dim + 4,
    }
