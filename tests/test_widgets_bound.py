"""The explorer of the lower bound: bars, curve and verdict against the library's own sums and a sum by hand."""

import itertools
import math

import numpy as np
import pytest
import torch

from mannbv import geometry, information, objective, splats
from mannbv.course import widgets
from mannbv.course.widgets import bound

FLAGS = list(itertools.product((False, True), repeat=3))
PLACES = [{}, {"other": (1.75, -2.0)}, {"other": (-0.5, -1.6), "turned": 1.2, "viewer": (-1.0, 0.2), "yaw": -0.4}]


@pytest.fixture(scope="module")
def explorer():
    return widgets.lower_bound()


def both_sides(values):
    """(I_dist, I_cent) by `objective.lower_bound`."""
    beliefs, everything = bound._team(values["other"], values["turned"])
    path = np.linspace(values["viewer"], bound._GOAL, 6)
    pose = geometry.yaw_pose(np.array(values["viewer"]), values["yaw"])
    priors = everything if values["shared"] else None
    return objective.lower_bound(
        beliefs, bound._CAMERA, pose, path, bound._CONFIG, values["jointly"], priors, values["own"]
    )


def drawn(panel, kind="line"):
    """The points of each line of a panel."""
    return [np.frombuffer(i["points"], np.float32).reshape(-1, 2) for i in panel["items"] if i["kind"] == kind]


def bars(panel):
    """Lengths of the bars: (distributed, central) × (map A, map B)."""
    return np.array([np.ptp(box[:, 0]) for box in drawn(panel)[:4]]).reshape(2, 2)


@pytest.mark.parametrize("flags", FLAGS)
@pytest.mark.parametrize("place", PLACES)
def test_bars_curve_and_verdict_are_those_of_the_lemma(explorer, flags, place):
    values = explorer.values | place | dict(zip(("jointly", "shared", "own"), flags, strict=True))
    distributed, central = both_sides(values)
    (_, lengths, chart), says = explorer.picture(**values)
    assert np.allclose(bars(lengths).sum(1), [distributed, central], rtol=1e-4)
    framed = any(item.get("color") == bound._BROKEN and item["kind"] == "line" for item in lengths["items"])
    assert framed == (distributed > 1.001 * central) == ("is broken" in says)
    assert framed or "the bound holds" in says
    curve = drawn(chart)[2]
    at = np.abs(curve[:, 0] - values["yaw"]).argmin()
    assert math.isclose(10 ** curve[at, 1], min(max(distributed / central, 0.1), 10), rel_tol=1e-3)
    for yaw in (-0.6283185, 0.4188790):  # two of the others on the curve
        sides = both_sides(values | {"yaw": yaw})
        if sides[0] > 0.1 * sides[1] > 0:
            ratio = curve[np.abs(curve[:, 0] - yaw).argmin(), 1]
            assert math.isclose(10**ratio, min(sides[0] / sides[1], 10), rel_tol=1e-3)


def test_a_rendering_of_everything_cut_by_owner_is_the_joint_bar(explorer):
    values = explorer.values | {"jointly": True}
    beliefs, _ = bound._team(values["other"], values["turned"])
    whole = objective.pooled(beliefs)
    zone = objective.zone(whole, np.linspace(values["viewer"], bound._GOAL, 6), bound._CONFIG)
    pose = geometry.yaw_pose(np.array(values["viewer"]), values["yaw"])
    acquired = information.fisher(splats.union(*(b.splats for b in beliefs)), bound._CAMERA, pose)
    worth = (acquired / (whole.prior + information.damping(2))).sum(1)
    terms = torch.where(zone.selected, zone.weights * worth, 0.0).split([b.splats.n_splats for b in beliefs])
    panels, _ = explorer.picture(**values)
    assert np.allclose(bars(panels[1])[1], [float(term.sum()) for term in terms], rtol=1e-4)


def test_it_starts_in_a_state_that_holds_and_each_of_two_switches_breaks(explorer):
    assert "the bound holds" in explorer.picture(**explorer.values)[1]
    for switch in ("jointly", "shared"):
        assert "is broken" in explorer.picture(**explorer.values | {switch: True})[1]
    further_right = explorer.values | {"other": (1.75, -2.0)}  # own grids alone break it here
    assert "the bound holds" in explorer.picture(**further_right)[1]
    assert "is broken" in explorer.picture(**further_right | {"own": True})[1]


def test_map_b_moves_as_a_whole_with_what_its_robot_knows():
    (still, moved), pose = (bound._team(*at)[0][1] for at in (((0.5, -1.0), 0.3), ((-0.75, 0.25), 0.3))), (0.5, -1.0)
    assert torch.allclose(moved.splats.means, still.splats.means + torch.tensor([-1.25, 1.25]), atol=1e-6)
    assert torch.allclose(moved.prior, still.prior, rtol=1e-3, atol=1e-2)  # it looked from the same side
    turned = bound._team(pose, 0.3 + math.pi / 2)[0][1].splats
    away = still.splats.means - torch.tensor(pose)
    assert torch.allclose(turned.means - torch.tensor(pose), torch.stack([-away[:, 1], away[:, 0]], 1), atol=1e-5)
    steps = np.rint(np.array([-1.25, 1.25]) / bound._LATTICE.cell).astype(int)
    inner = (slice(12, -12),) * 2
    rolled = np.roll(still.ground.state, steps, (0, 1))
    assert np.mean(rolled[inner] == moved.ground.state[inner]) > 0.97


def test_each_robot_knows_of_its_map_what_its_own_look_told_and_a_joint_prior_what_both_did():
    beliefs, everything = bound._team((0.5, -1.0), 0.9)
    looks = [geometry.yaw_pose(np.array([-2.6, -0.2]), 0.0), geometry.yaw_pose(np.array([0.5, -1.0]), 0.9)]
    for j, (belief, both) in enumerate(zip(beliefs, everything, strict=True)):
        acquired = [information.fisher(belief.splats, bound._CAMERA, look) for look in looks]
        assert torch.allclose(belief.prior, acquired[j], rtol=1e-4, atol=1e-3)
        assert torch.allclose(both, acquired[0] + acquired[1], rtol=1e-4, atol=1e-3)
        assert (both.sum() - acquired[j].sum()) > 0.01 * acquired[j].sum()


def test_by_the_papers_definition_no_hand_breaks_it(explorer, rng):
    for _ in range(60):
        values = dict(explorer.values)
        for name in ("other", "viewer"):
            values[name] = tuple(rng.uniform(explorer.settings[name].low, explorer.settings[name].high))
        values |= {"turned": rng.uniform(-math.pi, math.pi), "yaw": rng.uniform(-math.pi, math.pi)}
        assert "the bound holds" in explorer.picture(**values)[1]


def test_a_view_into_the_void_promises_nothing(explorer):
    panels, says = explorer.picture(**explorer.values | {"viewer": (-2.4, 2.0), "yaw": math.pi / 2})
    assert says == "distributed gain 0.0, central gain 0.0: the bound holds: nothing is promised"
    assert not bars(panels[1]).any()
