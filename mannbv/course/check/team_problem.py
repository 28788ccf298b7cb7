"""Checks of notebook 09: the team's objective, the central zone, both sides of Lemma 1, a counterexample."""

import math
from collections.abc import Callable

import numpy as np
import torch

from mannbv import geometry, information, mask, objective
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.course.check.verdict import compare
from mannbv.splats import SplatMap


def team(mine: Callable) -> bool:
    """mine(gains (N, N, M), choice (N,)) → Σ_k Σ_i f_ik at the chosen yaws, Eq. (24)."""
    rng = np.random.default_rng(0)
    cases = [(rng.uniform(0, 5, (n, n, 12)), rng.integers(0, 12, n)) for n in (2, 3, 5)]

    def truth(gains, choice):
        return objective.team(gains, -math.pi + 2 * math.pi * choice / gains.shape[-1])

    mistakes = [
        (lambda g, c: sum(g[k, k, m] for k, m in enumerate(c)), "every robot counts its own map only here"),
        (lambda g, c: sum(g[k, :, m].sum() for k, m in enumerate(c)), "maps and views are mixed up"),
        (lambda g, c: truth(g, c) / len(c), "that is a mean, the objective is a sum"),
        (lambda g, c: truth(g, c) / len(c) ** 2, "that is a mean, the objective is a sum"),
        (lambda g, c: g.max(2).sum(), "every map has a yaw of its own here, but a robot has one camera"),
        (lambda g, c: g.sum(0).max(1).sum(), "that is the optimum; the yaws are given"),
        (lambda g, c: g[:, :, c].sum(), "every view takes everyone's yaw here; each has one of its own"),
    ]  # fmt: skip
    return compare(mine, truth, cases, mistakes)


def radii(mine: Callable) -> bool:
    """mine(risks (N, K) [m]) → radii (K,) [m] of the central zone, Eqs. (9), (10), at the default constants."""
    rng = np.random.default_rng(0)
    cases = [(rng.uniform(-0.2, 2.0, (n, k)),) for n, k in ((2, 3), (4, 5), (3, 3))]

    def ball(alpha):
        return mask.radius(np.asarray(alpha))

    mistakes = [
        (lambda r: ball(r.max(0)), "that follows the safest map; a larger map is never safer"),
        (lambda r: ball(r.mean(0)), "a mean belongs to no map: what does a union do to a minimum over splats?"),
        (lambda r: ball(r).mean(0), "a mean belongs to no map: what does a union do to a minimum over splats?"),
        (lambda r: ball(r.sum(0)), "distances of different maps do not add up"),
        (lambda r: ball(r).sum(0), "the balls of different maps do not add up"),
        (lambda r: ball(-r.min(0)), "a safer waypoint gets the smaller ball: look at the sign"),
        (lambda r: r.min(0), "these are the risks [m]; the radii are wanted"),
        (lambda r: ball(r.min(1)), "one radius a waypoint is wanted, this is one a robot"),
        (ball, "one radius a waypoint is wanted, this is one for each robot as well"),
    ]
    return compare(mine, lambda r: ball(r.min(0)), cases, mistakes)


def sides(mine: Callable) -> bool:
    """mine(worth (n,), in_own (n,), in_central (n,)) → (distributed, central) of one map's block, Eqs. (19), (21)."""
    rng, cases = np.random.default_rng(0), []
    for n in (6, 20, 30):
        whole = rng.random(n) < 0.7
        cases.append((rng.uniform(0, 3, n), whole & (rng.random(n) < 0.6), whole))

    def truth(worth, own, whole):
        # the library's gain, of splats with one parameter of which nothing is known but a damping of 1
        told = torch.from_numpy(worth)[:, None]
        return [
            float(information.gain(told, 0 * told, selected=torch.from_numpy(s), damping=1.0)) for s in (own, whole)
        ]

    mistakes = [
        (lambda w, o, c: truth(w, o, c)[::-1], "the two are in the wrong order"),
        (lambda w, o, c: (w[o].sum(), w.sum()), "the centre has a zone too: splats far from the path do not count"),
        (lambda w, o, c: (w[o].sum(), w[c & ~o].sum()), "the centre also counts what the owner counts"),
        (lambda w, o, c: (w[o].sum(), w[o].sum()), "both sides use the owner's zone"),
        (lambda w, o, c: (w[c].sum(), w[c].sum()), "both sides use the central zone"),
        (lambda w, o, c: (w[o].mean(), w[c].mean()), "a gain is a sum over splats, not a mean"),
        (lambda w, o, c: (o.sum(), c.sum()), "these are numbers of splats, not their worth"),
    ]
    return compare(mine, truth, cases, mistakes)


def look(mine: Callable) -> bool:
    """mine() → (x, y, yaw): the teammate's earlier look for which a joint prior makes central < distributed / 100."""
    camera, config = Camera.from_fov(64), Config()
    view = geometry.yaw_pose(torch.tensor([-1.0, 0.0]), 0.0)
    fields = [[3.0, 0.0]], [[-3.0, -3.0]], [[1.0, 0.0]], [3.0], [[0.0, 0.45, 0.7]]
    splat = SplatMap(*map(torch.tensor, fields))

    def outcome() -> int | None:
        answer = mine()
        if answer is None or answer is ...:
            return None
        x, y, yaw = (float(part) for part in answer)
        told = information.prior(splat, camera, [geometry.yaw_pose(torch.tensor([x, y]), yaw)])
        beliefs = [objective.Belief(splat, torch.zeros_like(told))]
        sides = objective.lower_bound(beliefs, camera, view, np.array([[2.5, 0.0]]), config, joint_priors=[told])
        factor = sides[0] / sides[1]
        return 0 if factor > 100 else 1 if factor > 1.05 else 2

    mistakes = [
        (lambda: 1, "robot 1 saw the splat, but learned other things of it than your view would tell"),
        (lambda: 2, "robot 1 learned next to nothing of the splat: does its camera show it?"),
    ]
    return compare(outcome, lambda: 0, [()], mistakes)
