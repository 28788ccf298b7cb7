"""The explorer of information over yaw shows what every view tells, by a dense Fisher and sums written out here."""

import math

import numpy as np
import pytest
import torch

from mannbv import geometry, information
from mannbv.course import widgets
from mannbv.course.widgets import information as module
from mannbv.lab import draw

YAWS = np.linspace(-3.0, 3.0, 7)
ROOM, CAMERA = module._room(), module._CAMERA
LAMBDA = np.array([100, 100, 1, 1, 1, 0.25, 10, 10, 10])  # default damping of mean, scale, rotation, logit, colour


@pytest.fixture(scope="module")
def explorer():
    return widgets.information_over_yaw()


def shown(explorer, **values):
    """The picture's plane, curve panel and line."""
    (plane, _bar, curve), says = explorer.picture(**explorer.values | values)
    return plane, curve, says


def points(item):
    return np.frombuffer(item["points"], np.float32).reshape(-1, 2)


def of_kind(panel, kind):
    return [item for item in panel["items"] if item["kind"] == kind]


def acquired(position, yaw):
    """Fisher (157, 9) of one view, from the dense renderer."""
    view = geometry.yaw_pose(torch.tensor(position, dtype=torch.float64), float(yaw))
    return information.fisher(ROOM.to(torch.float64), CAMERA, view, method="dense").numpy()


def paid(robot, yaw, before=(), near=False, times=1.0):
    """What each splat adds to Eq. (15), term by term."""
    known = sum((acquired(module._SEEN_FROM, look) for look in before), np.zeros((ROOM.n_splats, 9)))
    v = module._weights(True).numpy() if near else np.ones(ROOM.n_splats)
    return (v[:, None] * acquired(robot, yaw) / (known + times * LAMBDA)).sum(1)


@pytest.mark.parametrize(
    ("before", "near", "times"), [((), False, 1.0), ((0.0,), True, 1.0), (module._BEFORE["all around"], False, 20.0)]
)
def test_the_curve_and_the_dot_are_the_gains_of_single_views(explorer, before, near, times):
    options = {"before": before, "near": near, "times": times}
    robot = (2.2, 0.9)
    for yaw in YAWS:
        expected = paid(robot, yaw, **options).sum()
        _, panel, _says = shown(explorer, robot=robot, yaw=yaw, **options)
        curve = points(max(of_kind(panel, "line"), key=lambda line: len(line["points"])))
        top = curve[:, 1].max()
        dot = points(of_kind(panel, "dots")[-1])[0]
        assert dot == pytest.approx([yaw, expected], rel=0.01)  # tiled, it leaves out small contributions
        assert abs(np.interp(yaw, *curve.T) - expected) < 0.05 * top


def test_no_prior_and_a_larger_damping_divide_the_gain(explorer):
    small, large = (
        points(of_kind(shown(explorer, before=(), yaw=1.0, times=times)[1], "dots")[-1])[0, 1] for times in (0.1, 10.0)
    )
    assert small == pytest.approx(100 * large, rel=1e-4)  # Σ h / λ


def test_what_was_seen_from_here_is_worth_little_until_one_turns(explorer):
    here, there, never = (
        points(of_kind(shown(explorer, **values)[1], "dots")[-1])[0, 1]
        for values in ({}, {"yaw": math.pi / 2}, {"before": ()})
    )
    assert here < 0.05 * there and here < 0.05 * never


@pytest.mark.parametrize("yaw", [0.4, 2.0, -2.5])
def test_the_darkest_splat_on_top_pays_most_and_grey_ones_nothing(explorer, yaw):
    plane, _, says = shown(explorer, yaw=yaw)
    expected = paid(explorer.values["robot"], yaw, (0.0,))
    (item,) = of_kind(plane, "ellipses")
    centers = np.frombuffer(item["shapes"], np.float32).reshape(-1, 5)[:, :2]
    rgb = np.frombuffer(item["rgba"], np.uint8).reshape(-1, 4)[:, :3].astype(int)
    assert centers[-1] == pytest.approx(ROOM.means[int(expected.argmax())].numpy())
    assert rgb[-1].sum() == rgb.sum(1).min()
    unpaid = (rgb == 0xD0).all(1)
    for center, grey in zip(centers, unpaid, strict=True):
        share = expected[np.abs(ROOM.means.numpy() - center).sum(1).argmin()] / expected.max()
        assert share < 2e-3 if grey else share > 5e-4
    assert 10 < unpaid.sum() < ROOM.n_splats  # the camera sees a quarter of the room
    ordered = np.sort(expected)[::-1]
    payers = next(k for k in range(1, ROOM.n_splats) if ordered[:k].sum() >= 0.9 * expected.sum())
    assert f"; {payers} of 157 splats pay 90 % of this view's gain" in says


def test_the_line_says_the_best_yaw_and_the_marks_stand_on_maxima(explorer):
    _, panel, says = shown(explorer, robot=(4.0, 1.0))
    gains = np.array([paid((4.0, 1.0), yaw, (0.0,)).sum() for yaw in np.radians(np.arange(-180, 180, 3))])
    other, best, _dot = (points(item) for item in of_kind(panel, "dots"))
    value, degrees = (float(word) for word in says.split("best of all yaws ")[1].split("°")[0].split(", at "))
    assert best[0] == pytest.approx([math.radians(degrees), value], abs=0.6)
    assert value == pytest.approx(gains.max(), rel=0.02)
    assert gains[round((degrees + 180) / 3) % 120] > 0.95 * gains.max()
    curve = points(max(of_kind(panel, "line"), key=lambda line: len(line["points"])))[:-1]
    heights = np.concatenate([curve[-1:], curve, curve[:1]])[:, 1].tolist()
    maxima = [k - 1 for k in range(1, 361) if heights[k - 1] < heights[k] > heights[k + 1]]
    assert np.allclose(other, curve[maxima]) and len(maxima) > 10


def test_weights_are_those_of_the_way_round_the_wall():
    v = module._weights(True)
    behind = (ROOM.means - torch.tensor([5.0, 0.3])).norm(dim=1).argmin()  # 0.6 m beside and 2.3 m below the path's end
    beside = (ROOM.means - torch.tensor([0.6, 0.0])).norm(dim=1).argmin()  # 0.7 m below its start
    away = -torch.log(torch.stack([v[beside], v[behind]]))  # [m] with γ₁ = 1, γ₂ = 1 / m
    assert away.tolist() == pytest.approx([0.7, 0.6 * math.sqrt(2) + 1.7], abs=0.15)  # eight ways, cells of 0.1 m
    straight = torch.cdist(ROOM.means, torch.from_numpy(module._PATH).float()).amin(1)
    assert (v <= torch.exp(-straight) + 0.08).all()  # no way is shorter than the straight one, but for half a cell
    hidden = (ROOM.means[:, 1] < 0.05) & (ROOM.means[:, 0] > 3.1) & (ROOM.means[:, 0] < 3.6)
    assert (v[hidden] < 0.8 * torch.exp(-straight[hidden])).all()  # the wall is between them and the path


def test_the_ground_is_blocked_where_the_inner_walls_stand_and_nowhere_else(monkeypatch):
    grounds = []
    monkeypatch.setattr(module.mask, "proximity", lambda splat_map, path, occupancy: grounds.append(occupancy))
    module._weights.__wrapped__(True)
    solid = torch.from_numpy(grounds[0].lattice.centers()[grounds[0].state == 1]).float()
    inner = ROOM.means[((ROOM.means > 0.05) & (ROOM.means < torch.tensor([4.95, 4.35]))).all(1)]
    away = torch.cdist(inner, solid)
    assert len(inner) > 35 and away.amin(1).max() < 0.1 and away.amin(0).max() < 0.35  # the table is 0.6 m deep


def test_both_handles_turn_the_camera(explorer):
    for move, yaw in (
        ({"x": 2.5, "y": 0.0, "along": "x"}, 2.5),
        ({"x": 1.5, "y": 0.0, "along": None}, -math.pi / 2),
    ):
        explorer.canvas._handle_custom_msg({"name": "yaw"} | move, [])
        assert explorer.values["yaw"] == pytest.approx(yaw)
        plane, _, curve = explorer.canvas.picture["panels"]
        turn, slide = (next(h for h in of_kind(panel, "handle") if h["name"] == "yaw") for panel in (plane, curve))
        away = np.subtract(turn["at"], turn["about"])
        assert math.atan2(*away[::-1]) == pytest.approx(yaw) and slide["at"][0] == pytest.approx(yaw)
        cone = points(next(i for i in of_kind(plane, "line") if i["fill"] == draw.COLORS[2]))
        assert cone[13] - cone[0] == pytest.approx(0.8 * away / 0.55, abs=1e-5)
    explorer.move(yaw=0.0)


def test_a_full_turn_is_none_and_a_corner_is_a_place(explorer):
    gains = [points(of_kind(shown(explorer, yaw=yaw)[1], "dots")[-1])[0, 1] for yaw in (-math.pi, math.pi)]
    assert gains[0] == pytest.approx(gains[1], rel=1e-3)
    for robot in ((0.2, 0.2), (4.8, 4.2)):
        _, panel, _ = shown(explorer, robot=robot, yaw=-2.3)
        assert np.isfinite(points(of_kind(panel, "dots")[-1])).all()


def test_another_default_precision_shows_the_same(explorer):
    expected = shown(explorer)[2]
    torch.set_default_dtype(torch.float64)
    try:
        module._room.cache_clear(), module._prior.cache_clear(), module._weights.cache_clear()
        assert shown(widgets.information_over_yaw())[2] == expected
    finally:
        torch.set_default_dtype(torch.float32)
