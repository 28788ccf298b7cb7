"""The explorer that walks through a map of space: each surface stands where it should in picture, row and plan."""

import math

import numpy as np
import pytest
import torch
from helpers import random_map

from mannbv import geometry, render, splats, world
from mannbv.camera import Camera
from mannbv.course import widgets
from mannbv.course.widgets.walk import _CAMERA, flat_with_a_height
from mannbv.splats import SplatMap

RED, GREEN, BLUE, GREY = (1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0), (0xE4,) * 3
# balls around the middle of a square, each of its own colour: along +x, along +y, and over the first one
BALLS = [((2.0, 0.0, 1.0), RED), ((0.0, 3.0, 1.0), GREEN), ((2.0, 0.0, 1.9), BLUE)]


def balls(std=0.1, corners=3.0) -> SplatMap:
    """The balls, and invisible splats in the corners, so that the plan is a square and the heights go from 0 to 2 m."""
    ends = [(x, y, z) for x in (-corners, corners) for y in (-corners, corners) for z in (0.0, 2.0)]
    means = torch.tensor([place for place, _ in BALLS] + ends)
    n = len(means)
    logits = torch.tensor([6.0] * 3 + [-12.0] * len(ends))
    colors = torch.tensor([color for _, color in BALLS] + [(0.0, 0, 0)] * len(ends))
    return SplatMap(means, torch.full((n, 3), math.log(std)), geometry.identity_rotations(n, 3), logits, colors)


@pytest.fixture(scope="module")
def among_balls():
    return widgets.walk(balls())


def shown(explorer, **values):
    """Pixels of the plan and of the picture, top row first, the points of the row's curve, and the line."""
    panels, says = explorer.picture(**explorer.values | {"camera": (0.0, 0.0), "yaw": 0.0, "height": 1.0} | values)
    images = [item for panel in panels[:3] for item in panel["items"] if item["kind"] == "image"]
    above, seen = (np.frombuffer(item["rgba"], np.uint8).reshape(*item["shape"], 4)[..., :3] for item in images)
    (curve,) = panels[1]["items"]
    return above, seen, np.frombuffer(curve["points"], np.float32).reshape(-1, 2)[:, 1], says


def center(pixels, color) -> tuple[float, float]:
    """Middle (right, down) [px] of what has nearly a colour of 0 and 1."""
    rows, columns = np.nonzero(np.abs(pixels - 255.0 * np.array(color)).max(-1) < 60)
    assert len(rows), "nothing of that colour"
    return columns.mean() + 0.5, rows.mean() + 0.5


def test_a_ball_ahead_is_in_the_middle_and_one_above_it_is_above(among_balls):
    _, seen, _, _ = shown(among_balls)
    assert center(seen, RED) == pytest.approx((110, 82.5), abs=1)
    assert center(seen, BLUE) == pytest.approx((110, 82.5 - 110 * 0.9 / 2), abs=2)  # focal length 110 px
    assert not (np.abs(seen - 255.0 * np.array(GREEN)).max(-1) < 60).any()  # it is beside the camera
    assert (seen[5, 5] == GREY).all()


@pytest.mark.parametrize("degrees", [-20, 10, 30])
def test_turning_and_pitching_move_the_ball_as_a_pinhole_does(among_balls, degrees):
    shift = 110 * math.tan(math.radians(degrees))
    turned = center(shown(among_balls, yaw=math.radians(degrees))[1], RED)
    assert turned == pytest.approx((110 + shift, 82.5), abs=2)  # turned to the left, it moves to the right
    pitched = center(shown(among_balls, pitch=degrees)[1], RED)
    assert pitched == pytest.approx((110, 82.5 + shift), abs=2)  # raised, it moves down
    assert center(shown(among_balls, yaw=math.pi / 2 - math.radians(degrees))[1], GREEN)[0] < 110 - shift + 2


def test_the_row_and_the_line_say_how_far(among_balls):
    _, _, row, says = shown(among_balls)
    assert row[110] == pytest.approx(2.0, abs=0.05) and np.isnan(row[:80]).all()
    assert "a surface 2.0" in says and says.startswith("11 splats; facing 0°")
    _, _, row, says = shown(among_balls, yaw=-math.pi / 2)
    assert np.isnan(row).all() and "nothing to see" in says and "100% of the pixels" in says
    nearer = shown(among_balls, camera=(0.5, 0.0))[2]
    assert nearer[110] == pytest.approx(1.5, abs=0.05)


def test_depth_is_shown_in_the_bar_s_colours(among_balls):
    panels, _ = among_balls.picture(
        **among_balls.values | {"camera": (0.0, 0.0), "yaw": 0.0, "height": 1.0, "show": "depth"}
    )
    image, bar = panels[2]["items"][0], panels[3]["items"][0]
    depth = np.frombuffer(image["rgba"], np.uint8).reshape(165, 220, 4)[82, 110, :3].astype(int)
    ramp = np.frombuffer(bar["rgba"], np.uint8).reshape(*bar["shape"], 4)[::-1, 0, :3].astype(int)  # the lowest first
    place = np.abs(ramp - depth).sum(1).argmin() / (len(ramp) - 1)
    assert place * panels[3]["y"][1] == pytest.approx(2.0, abs=0.1)
    assert panels[3]["y"][0] == 0 and "depth [m]" in panels[3]["ylabel"]


def test_the_plan_shows_balls_where_they_are_and_is_cut_at_the_camera(among_balls):
    def where(above, color):
        x0, x1, y0, y1 = among_balls.picture(**among_balls.values)[0][0]["items"][0]["extent"]
        right, down = center(above, color)
        return x0 + right / above.shape[1] * (x1 - x0), y1 - down / above.shape[0] * (y1 - y0)

    above = shown(among_balls, height=1.5)[0]
    assert where(above, RED) == pytest.approx((2.0, 0.0), abs=0.06)
    assert where(above, GREEN) == pytest.approx((0.0, 3.0), abs=0.06)
    with pytest.raises(AssertionError, match="nothing of that colour"):
        center(above, BLUE)
    assert (shown(among_balls, height=0.5)[0] == GREY).all()  # below the balls there is nothing
    tall = balls()
    lower = widgets.walk(tall.select(torch.arange(tall.n_splats) != 0))  # without the red one
    assert where(shown(lower, height=1.95)[0], BLUE) == pytest.approx((2.0, 0.0), abs=0.06)


def test_the_picture_is_the_dense_reference_s(among_balls):
    explorer = widgets.walk(splats.union(balls(), random_map(np.random.default_rng(1), 40, 3, torch.float32, 2.0)))
    place, yaw, pitch = (0.3, -0.4), 0.7, 15
    _, seen, _, _ = shown(explorer, camera=place, yaw=yaw, pitch=pitch)
    (map_,) = explorer.picture.args[:1]
    ahead = [math.cos(math.radians(pitch)) * part for part in (math.cos(yaw), math.sin(yaw))]
    forward = torch.tensor([*ahead, math.sin(math.radians(pitch))])
    right = torch.tensor([math.sin(yaw), -math.cos(yaw), 0.0])
    rotation = torch.stack([right, torch.linalg.cross(forward, right), forward], 1)
    pose = geometry.Pose(rotation, torch.tensor([*place, 1.0]))
    drawn = render.render(map_, _CAMERA, pose, method="dense")
    expected = 255 * (drawn.color + (1 - drawn.opacity[..., None]) * (0xE4 / 255)).clamp(0, 1)
    assert np.abs(seen - expected.numpy()).max() < 4 and np.abs(seen - expected.numpy()).mean() < 0.5


def test_without_a_map_it_walks_through_the_flat():
    home = flat_with_a_height()
    flat = world.load("flat")
    on_floor = home.means[:, 2] == 0
    assert (flat.ground.clearance(home.means[~on_floor].numpy()) < 0.03).all()  # what is not floor stands on a wall
    assert (flat.ground.clearance(home.means[on_floor].numpy()) > 0).all()
    assert home.means[:, 2].max() < 2.4 and home.n_splats > 40_000
    explorer = widgets.walk()
    depth = flat.sense(
        Camera.from_fov(220),
        geometry.yaw_pose(explorer.values["camera"], explorer.values["yaw"]),
    ).depth.numpy()
    panels, _ = explorer.picture(**explorer.values)
    row = np.frombuffer(panels[1]["items"][0]["points"], np.float32).reshape(-1, 2)[:, 1]
    assert np.nanmedian(np.abs(row - depth)) < 0.1 and np.isfinite(row).mean() > 0.95


def test_handles_stay_on_the_plan_at_its_corners(among_balls):
    place = among_balls.settings["camera"]
    for corner in (place.low, place.high):
        panel = among_balls.picture(**among_balls.values | {"camera": corner})[0][0]
        for item in (item for item in panel["items"] if item["kind"] == "handle"):
            assert panel["x"][0] < item["at"][0] < panel["x"][1] and panel["y"][0] < item["at"][1] < panel["y"][1]


@pytest.mark.parametrize("wrong", [random_map(np.random.default_rng(0), 5, 2), SplatMap.empty(3)])
def test_what_it_cannot_walk_through_is_named(wrong):
    with pytest.raises(ValueError, match=r"walk: needs a 3-D map .*splats\.lifted"):
        widgets.walk(wrong)
