"""Exercises of notebook 09: the team's objective, the central zone, both sides of Lemma 1, a counterexample."""

import math
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import torch

from mannbv import geometry, information, mask, objective
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.course.check.verdict import AGREES, Fault, ask, exercise, judged, plain
from mannbv.splats import SplatMap

_rng = np.random.default_rng(0)


@exercise(cases=[(_rng.uniform(0, 5, (n, n, 12)), _rng.integers(0, 12, n)) for n in (2, 3, 5)])
def team(gains, choice):
    """my_team(gains (N, N, M), choice (N,)) → Σ_k Σ_i f_ik at the chosen yaws, Eq. (24)."""
    n, everyone = len(choice), np.arange(len(choice))
    truth = objective.team(gains, -math.pi + 2 * math.pi * choice / gains.shape[-1])
    return {
        AGREES: truth,
        "every robot counts its own map only here": gains[everyone, everyone, choice].sum(),
        "maps and views are mixed up": gains[everyone, :, choice].sum(),
        "that is a mean, the objective is a sum": [truth / n, truth / n**2],
        "every map has a yaw of its own here, but a robot has one camera": gains.max(2).sum(),
        "that is the optimum; the yaws are given": gains.sum(0).max(1).sum(),
        "every view takes everyone's yaw here; each has one of its own": gains[:, :, choice].sum(),
    }


def _ball(alpha):
    return mask.radius(
        np.asarray(alpha), r_max=0.0
    )  # Eq. (10) as it stands, so that mistakes are told beyond any bound


@exercise(cases=[(_rng.uniform(-0.2, 2.0, shape),) for shape in ((2, 3), (4, 5), (3, 3))])
def radii(risks):
    """my_radii(risks (N, K) [m]) → radii (K,) [m] of the central zone, Eqs. (9), (10), at the default constants."""
    return {
        AGREES: _ball(risks.min(0)),
        "that follows the safest map; a larger map is never safer": _ball(risks.max(0)),
        "a mean belongs to no map: what does a union do to a minimum over splats?":
            [_ball(risks.mean(0)), _ball(risks).mean(0)],
        "distances of different maps do not add up": _ball(risks.sum(0)),
        "the balls of different maps do not add up": _ball(risks).sum(0),
        "a safer waypoint gets the smaller ball: look at the sign": _ball(-risks.min(0)),
        "these are the risks [m]; the radii are wanted": risks.min(0),
        "one radius a waypoint is wanted, this is one a robot": _ball(risks.min(1)),
        "one radius a waypoint is wanted, this is one for each robot as well": _ball(risks),
    }  # fmt: skip


def _zones(n: int) -> tuple:
    whole = _rng.random(n) < 0.7
    return _rng.uniform(0, 3, n), whole & (_rng.random(n) < 0.6), whole


def _gain(worth, zone):
    """The library's, of splats with one parameter of which nothing is known but a damping of 1."""
    acquired = torch.from_numpy(worth)[:, None]
    return float(information.gain(acquired, 0 * acquired, selected=torch.from_numpy(zone), damping=1.0))


@exercise(cases=[_zones(n) for n in (10, 20, 30)])
def sides(worth, own, whole):
    """my_sides(worth (n,), in_own (n,), in_central (n,)) → (distributed, central) of a map's block, Eqs. (19), (21)."""
    return {
        AGREES: (_gain(worth, own), _gain(worth, whole)),
        "the two are in the wrong order": (worth[whole].sum(), worth[own].sum()),
        "the centre has a zone too: splats far from the path do not count": (worth[own].sum(), worth.sum()),
        "the centre also counts what the owner counts": (worth[own].sum(), worth[whole & ~own].sum()),
        "both sides use the owner's zone": (worth[own].sum(), worth[own].sum()),
        "both sides use the central zone": (worth[whole].sum(), worth[whole].sum()),
        "a gain is a sum over splats, not a mean": (worth[own].mean(), worth[whole].mean()),
        "these are numbers of splats, not their worth": (own.sum(), whole.sum()),
    }


@judged(
    truth=lambda: (2.0, 0.0, 0.0),
    mistakes=[
        (lambda: (-1.0, 0.0, 0.0), "robot 0 stands there: from where else does a camera see the same of the splat?",
         lambda seen: seen.apart < 2 * Config().robot_radius),
        (lambda: (2.5, 0.0, math.pi), "robot 1 learned next to nothing of the splat: does its camera show it?",
         lambda seen: not seen.factor > 1.05),
        (lambda: (3.0, 1.0, -math.pi / 2),
         "robot 1 saw the splat, but learned other things of it than your view would tell",
         lambda seen: not seen.factor > 100),
    ],
)  # fmt: skip
def look(mine: Callable) -> SimpleNamespace:
    """my_look() → (x, y, yaw): a teammate's earlier look for which a joint prior makes central < distributed / 100."""
    camera, config = Camera.from_fov(64), Config()
    view = geometry.yaw_pose(torch.tensor([-1.0, 0.0]), 0.0)
    fields = [[3.0, 0.0]], [[-3.0, -3.0]], [[1.0, 0.0]], [3.0], [[0.0, 0.45, 0.7]]
    splat = SplatMap(*map(torch.tensor, fields))
    look = plain(ask(mine))
    if look.shape != (3,) or not np.isfinite(look).all():
        raise Fault(f"three finite numbers are wanted, x [m], y [m], yaw [rad]; got shape {look.shape}")
    x, y, yaw = look.tolist()
    acquired = information.prior(splat, camera, [geometry.yaw_pose(torch.tensor([x, y]), yaw)])
    beliefs = [objective.Belief(splat, torch.zeros_like(acquired))]
    sides = objective.lower_bound(beliefs, camera, view, np.array([[2.5, 0.0]]), config, joint_priors=[acquired])
    return SimpleNamespace(factor=float(sides[0] / sides[1]), apart=math.hypot(x + 1.0, y))
