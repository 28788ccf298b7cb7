"""The flatland world against closed forms and brute force; discrete motion; ROS maps and bad files."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from mannbv import geometry, grid, world
from mannbv.camera import Camera
from mannbv.kernels.flat import rays
from mannbv.world import bodies, cells, faces
from mannbv.world.formats import plan, rosmap

CAMERA = Camera.from_fov(64)
MAPS = Path(__file__).resolve().parents[2] / "shared" / "scenes" / "maps"
TURN = math.radians(5)


def box_plan(**changes) -> dict:
    """A room of 4 × 3 m (between wall faces), without furniture."""
    wall = {"thickness": 0.2}
    document = {
        "format": plan.FORMAT,
        "name": "box",
        "description": "an empty room",
        "wall_height": 2.5,
        "rooms": [
            {
                "name": "room",
                "polygon": [[-0.1, -0.1], [4.1, -0.1], [4.1, 3.1], [-0.1, 3.1]],
                "floor_color": [0.5, 0.5, 0.5],
                "wall_color": [0.6, 0.4, 0.2],
                "texture": {"kind": "plain"},
            }
        ],
        "walls": [
            {"from": [-0.1, -0.1], "to": [4.1, -0.1], **wall},
            {"from": [4.1, -0.1], "to": [4.1, 3.1], **wall},
            {"from": [4.1, 3.1], "to": [-0.1, 3.1], **wall},
            {"from": [-0.1, 3.1], "to": [-0.1, -0.1], **wall},
        ],
        "starts": [[1.0, 1.0, 0.0], [1.0, 2.0, 0.0]],
        "goals": [[3.0, 2.0], [3.0, 1.0]],
    }
    return {**document, **changes}


@pytest.fixture
def load(tmp_path):
    """Write a plan (a dict or a text) and load it."""

    def write(document) -> world.World:
        path = tmp_path / "plan.json"
        path.write_text(document if isinstance(document, str) else json.dumps(document))
        return world.load(path)

    return write


def brute_depth(segments, camera, pose) -> np.ndarray:
    """Every ray with every segment, by Cramer's rule in the world's frame."""
    directions = camera.rays(pose.position).numpy() @ pose.rotation.numpy().T
    a, d = segments[:, :2] - pose.position.numpy(), segments[:, 2:] - segments[:, :2]
    det = directions[:, None, 0] * -d[:, 1] + directions[:, None, 1] * d[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (a[:, 0] * -d[:, 1] + a[:, 1] * d[:, 0]) / det
        share = (directions[:, None, 0] * a[:, 1] - directions[:, None, 1] * a[:, 0]) / det
    return np.where((depth > 0) & (share >= 0) & (share <= 1), depth, np.inf).min(1)


def brute_distance(points, segments) -> np.ndarray:
    a, d = segments[:, :2], segments[:, 2:] - segments[:, :2]
    t = np.clip(((points[:, None] - a) * d).sum(-1) / (d**2).sum(-1), 0, 1)
    return np.linalg.norm(points[:, None] - a - t[..., None] * d, axis=-1).min(1)


def bare_world(segments, kind="plain", period=1.0, contrast=0.0) -> world.World:
    """Segments that stand in the middle of nowhere."""
    n = len(segments)
    texture = [float(world.TEXTURES[kind]), period, contrast, 0.0]
    walls = world.Segments(np.asarray(segments, float), np.full((n, 3), 0.5), np.tile(texture, (n, 1)))
    everywhere = bodies.Polygons((np.array([[-99.0, -99], [99, -99], [99, 99], [-99, 99]]),))
    ground = world.Ground(walls, solids=bodies.Polygons(()), rooms=everywhere)
    return world.World("bare", "", walls, ground, np.zeros((0, 3)), np.zeros((0, 2)))


# --- sensing ---


def test_depths_in_a_rectangular_room_follow_the_closed_form(load):
    room = load(box_plan())
    x, y, yaw = 1.3, 1.1, 0.4
    frame = room.sense(CAMERA, geometry.yaw_pose([x, y], yaw), max_depth=100.0)
    bearing = yaw - np.arctan((np.arange(64) + 0.5 - 32) / CAMERA.focal)  # pixel 0 looks left
    along_x = np.where(np.cos(bearing) > 0, 4 - x, -x) / np.cos(bearing)
    along_y = np.where(np.sin(bearing) > 0, 3 - y, -y) / np.sin(bearing)
    ranges = np.minimum(along_x, along_y)
    np.testing.assert_allclose(frame.depth.numpy(), ranges * np.cos(bearing - yaw), atol=1e-5)
    assert not np.allclose(frame.depth.numpy(), ranges, atol=0.1)  # a range is no depth
    assert frame.color.dtype == frame.depth.dtype == torch.float32
    np.testing.assert_allclose(frame.color.numpy(), np.tile([0.6, 0.4, 0.2], (64, 1)), atol=1e-6)


def test_depth_equals_brute_force_over_random_segments_and_poses(rng):
    segments = rng.uniform(-5, 5, (60, 4))
    scene = bare_world(segments)
    for _ in range(40):
        pose = geometry.yaw_pose(rng.uniform(-4, 4, 2), rng.uniform(-4, 4))
        expected = brute_depth(segments, CAMERA, pose)
        seen = scene.sense(CAMERA, pose, max_depth=1e9).depth.numpy()
        np.testing.assert_allclose(seen, np.where(np.isfinite(expected), expected, 0.0), rtol=1e-6, atol=1e-6)


def test_depth_is_cut_along_the_axis_and_empty_rays_are_black():
    scene = bare_world([[2.0, -50.0, 2.0, 0.0]])  # a wall ahead, to the right only
    pose = geometry.yaw_pose([0.0, 0.0], 0.0)
    frame = scene.sense(CAMERA, pose, max_depth=2.0 + 1e-9)
    assert (frame.depth[:32] == 0).all()
    assert (frame.color[:32] == 0).all()
    assert torch.allclose(frame.depth[32:], torch.tensor(2.0))  # edge rays are 2.8 m long and still within range
    assert (scene.sense(CAMERA, pose, max_depth=1.9).depth == 0).all()
    assert (scene.sense(CAMERA, pose, max_depth=1.9).color[32:] > 0).all()


def test_no_sight_line_slips_between_segments_that_share_an_end():
    corners = np.stack([np.cos(np.arange(97) / 97 * 2 * np.pi), np.sin(np.arange(97) / 97 * 2 * np.pi)], 1)
    scene = bare_world(np.concatenate([corners, np.roll(corners, -1, 0)], 1))
    for corner in corners[::8]:  # the middle subray of some pixel aims exactly at a corner
        yaw = math.atan2(corner[1], corner[0])
        for camera in (Camera.from_fov(63), CAMERA):
            assert (scene.sense(camera, geometry.yaw_pose([0.0, 0.0], yaw)).depth > 0.65).all()


def test_a_pixel_averages_what_it_covers():
    """Stripes much finer than a pixel blur to the mean; one ray a pixel would alias."""
    scene = bare_world([[5.0, -50.0, 5.0, 50.0]], "stripes", period=0.137, contrast=0.8)
    camera, pose = Camera.from_fov(8), geometry.yaw_pose([0.0, 0.0], 0.0)
    color = scene.sense(camera, pose).color[:, 0].numpy()
    u = np.arange(8) + 0.5 - 4
    single = 0.5 * (1 + 0.8 * np.sin(2 * np.pi * (50 - 5 * u / camera.focal) / 0.137))
    assert np.abs(color - 0.5).max() < 0.75 * np.abs(single - 0.5).max()
    # and stripes wider than a pixel are the exact mean of the sine across it
    wide = bare_world([[5.0, -50.0, 5.0, 50.0]], "stripes", period=2.0, contrast=0.8)
    fine = (np.arange(64 * 400) + 0.5) / 400
    mean = 0.5 * (1 + 0.8 * np.sin(2 * np.pi * (50 - 5 * (fine - 32) / CAMERA.focal) / 2.0)).reshape(64, 400).mean(1)
    np.testing.assert_allclose(wide.sense(CAMERA, pose).color[:, 0].numpy(), mean, atol=2e-3)


def test_noise_texture_is_smooth_fixed_by_place_and_not_flat():
    wall = bare_world([[2.0, -9.0, 2.0, 9.0]], "noise", period=0.8, contrast=0.6)
    halves = bare_world([[2.0, -9.0, 2.0, 0.31], [2.0, 9.0, 2.0, 0.31]], "noise", period=0.8, contrast=0.6)
    for yaw in (-0.2, 0.0, 0.2):
        pose = geometry.yaw_pose([0.0, 0.2], yaw)
        a, b = wall.sense(CAMERA, pose).color, halves.sense(CAMERA, pose).color
        assert torch.allclose(a, b, atol=1e-6)
        assert a.std(0).min() > 0.03
        assert (a[1:] - a[:-1]).abs().max() < 0.15


@pytest.mark.parametrize("dim", [2, 3])
def test_one_sensor_serves_both_worlds(dim):
    """Noise of the asked spread, from the generator alone; the range cuts depths and no colours."""
    flat, camera = world.load("flat", dim=dim), Camera.of_dim(dim, 48, 48, math.pi / 2)
    pose = geometry.yaw_pose([2.9, 5.0, 1.25][:dim], 0.4)
    clean, near = flat.sense(camera, pose), flat.sense(camera, pose, max_depth=2.0)
    assert torch.equal(near.depth, torch.where(clean.depth <= 2.0, clean.depth, 0.0))
    assert (near.depth == 0).any() and torch.equal(near.color, clean.color)
    noise = {"depth_noise": 0.02, "color_noise": 0.1}
    noisy, again, other = (flat.sense(camera, pose, **noise, rng=np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert torch.equal(noisy.depth, again.depth) and torch.equal(noisy.color, again.color)
    assert not torch.equal(noisy.depth, other.depth)
    assert noisy.color.min() >= 0 and noisy.color.max() <= 1
    rng = np.random.default_rng(0)
    frames = [flat.sense(camera, pose, depth_noise=0.02, rng=rng) for _ in range({2: 400, 3: 9}[dim])]
    relative = torch.stack([f.depth for f in frames]) / clean.depth - 1
    assert float(relative.std()) == pytest.approx(0.02, rel=0.03)
    with pytest.raises(ValueError, match="rng"):
        flat.sense(camera, pose, depth_noise=0.02)
    other = 5 - dim
    with pytest.raises(
        ValueError, match=f"flat has {dim} dimensions, but the camera {other} and the pose {dim}; a cam"
    ):
        flat.sense(Camera.of_dim(other, 8, 8, math.pi / 2), pose)
    with pytest.raises(ValueError, match=f"the camera {dim} and the pose {other}"):
        flat.sense(camera, geometry.yaw_pose(np.ones(other), 0.0))


# --- surfaces and free space ---


def test_clearance_equals_brute_force(rng):
    for segments in (rng.uniform(-3, 3, (50, 4)), np.array([[0.0, 0.0, 0.0, 7.0]])):
        points = rng.uniform(-8, 8, (500, 2))
        np.testing.assert_allclose(
            bare_world(segments).ground.clearance(points), brute_distance(points, segments), atol=1e-12
        )


def test_solid_inside_and_clearance_of_a_furnished_room(load):
    box = {"name": "box", "box": {"center": [2, 1.5], "size": [1, 0.5], "yaw": math.pi / 2}, "height": 1}
    rug = {"name": "rug", "box": {"center": [1, 1], "size": [1, 1]}, "height": 0.01, "color": [0, 0, 0]}
    lamp = {**rug, "name": "lamp", "elevation": 1.5, "height": 0.5}
    room = load(box_plan(furniture=[{**box, "color": [1, 0, 0]}, rug, lamp]))
    points = np.array([[2.0, 1.9], [2.4, 1.5], [1.0, 1.0], [-0.05, 1.0], [9.0, 9.0]])
    assert room.ground.solid(points).tolist() == [True, False, False, True, False]  # turned: long along y
    assert room.ground.inside(points).tolist() == [True, True, True, True, False]
    np.testing.assert_allclose(room.ground.clearance(points)[:4], [0, 0.15, 0.75, 0], atol=1e-9)
    assert room.ground.area == pytest.approx(4.2 * 3.2)
    np.testing.assert_allclose([*room.seen.lower, *room.seen.upper], [0, 0, 4, 3], atol=1e-9)


def test_surface_points_cover_the_walls_and_nothing_hidden(load):
    block = {"name": "b", "box": {"center": [0.5, 0.25], "size": [1.0, 0.5]}, "height": 1, "color": [1, 0, 0]}
    room = load(box_plan(furniture=[block]))  # stands in a corner: two of its sides lie on walls
    points = room.seen.sampled(0.01)
    assert brute_distance(points, room.seen.ends).max() < 1e-12
    assert len(points) == pytest.approx(14 / 0.01, abs=20)  # 4 + 3 + 4 + 3, what is hidden is what is added
    assert not ((points[:, 0] < 0.999) & (points[:, 1] < 0.499)).any()


def test_faces_of_one_wall_take_the_colours_of_the_rooms_they_look_on(load):
    half = lambda x0, x1, color: {  # noqa: E731
        **box_plan()["rooms"][0],
        "polygon": [[x0, -0.1], [x1, -0.1], [x1, 3.1], [x0, 3.1]],
        "wall_color": color,
    }
    document = box_plan(rooms=[half(-0.1, 2.0, [1, 0, 0]), half(2.0, 4.1, [0, 0, 1])])
    document["walls"].append({"from": [2, 0], "to": [2, 3], "thickness": 0.1})
    document["doors"] = [{"at": [2.0, 1.0], "width": 1.0, "height": 2.0}]
    room = load(document)
    left = room.sense(CAMERA, geometry.yaw_pose([1.0, 2.2], 0.0)).color[32]
    right = room.sense(CAMERA, geometry.yaw_pose([3.0, 2.2], math.pi)).color[32]
    through = room.sense(CAMERA, geometry.yaw_pose([1.0, 1.0], 0.0))
    assert left.tolist() == [1, 0, 0]
    assert right.tolist() == [0, 0, 1]
    assert through.color[32].tolist() == [0, 0, 1]
    assert float(through.depth[32]) == pytest.approx(3.0)


def test_visible_faces_are_the_outline_of_the_union():
    """Two overlapping squares: 14 of the 16 units of outline remain, and no piece lies inside a square."""
    squares = [np.array([[0.0, 0], [2, 0], [2, 2], [0, 2]]), np.array([[1.0, 1], [3, 1], [3, 3], [1, 3]])]
    rooms = bodies.Polygons((np.array([[-5.0, -5], [5, -5], [5, 5], [-5, 5]]),))
    segments, owner, room, begin = faces.visible(squares, rooms)
    lengths = np.linalg.norm(segments[:, 2:] - segments[:, :2], axis=1)
    assert lengths.sum() == pytest.approx(12.0)
    assert lengths[owner == 0].sum() == pytest.approx(6.0)
    assert (room == 0).all()
    assert sorted(begin.round(9))[-1] == 1.0
    same, _, _, _ = faces.visible([squares[0], squares[0]], rooms)
    assert np.linalg.norm(same[:, 2:] - same[:, :2], axis=1).sum() == pytest.approx(8.0)


def test_free_cells_and_shortest_paths(load):
    room = load(box_plan())
    lattice, free = room.ground.free_grid(0.05, 0.25)
    centers = lattice.centers()
    inside = (np.abs(centers[..., 0] - 2) <= 1.75 + 1e-9) & (np.abs(centers[..., 1] - 1.5) <= 1.25 + 1e-9)
    assert (free == inside).all()
    path = room.ground.shortest_path([1.0, 1.0], [3.0, 2.0], 0.25)
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert path[0].tolist() == [1, 1]
    assert path[-1].tolist() == [3, 2]
    assert length == pytest.approx(1 + math.sqrt(2), abs=0.1)  # octile distance
    divided = box_plan()
    divided["walls"].append({"from": [2, 0], "to": [2, 3], "thickness": 0.1})
    divided["doors"] = [{"at": [2.0, 1.5], "width": 0.9, "height": 2.0}]
    two = load(divided)
    assert two.ground.reachable_free(0.05, 0.25, [1.0, 1.0]).sum() == two.ground.free_grid(0.05, 0.25)[1].sum()
    with pytest.raises(ValueError, match=r"^no way .* from \(1\.00, 1\.00\) to \(3\.00, 2\.00\)"):
        two.ground.shortest_path([1.0, 1.0], [3.0, 2.0], 0.5)
    reached = two.ground.reachable_free(0.05, 0.5, [1.0, 1.0])
    assert 0 < reached.sum() < two.ground.free_grid(0.05, 0.5)[1].sum()
    with pytest.raises(ValueError, match="no place for a robot"):
        room.ground.shortest_path([1.0, 1.0], [9.0, 2.0], 0.1)


@pytest.mark.parametrize(
    ("changes", "robots", "message"),
    [
        ({}, 0, "at least one robot"),
        ({}, 3, "3 robots, but only 2"),
        ({"starts": [[1, 1, 0], [-0.05, 1, 0]]}, 2, r"starts\[1\] at \(-0\.05, 1\.00\) lies inside a wall"),
        ({"starts": [[0.05, 1, 0], [1, 1, 0]]}, 2, r"starts\[0\] .* too near to a wall"),
        ({"goals": [[9, 9], [3, 1]]}, 1, r"goals\[0\] .* outside the building"),
    ],
)
def test_a_team_that_cannot_start_is_refused(load, changes, robots, message):
    room = load(box_plan(**changes))
    with pytest.raises(ValueError, match=message) as error:
        room.check_team(robots)
    assert "\n" not in str(error.value)
    load(box_plan()).check_team(2)


def test_an_unreachable_goal_is_refused(load):
    document = box_plan()
    document["walls"].append({"from": [2, 0], "to": [2, 3], "thickness": 0.1})
    with pytest.raises(ValueError, match=r"box: no way .* from \(1\.00, 1\.00\) to \(3\.00, 2\.00\)"):
        load(document).check_team(1)


# --- motion ---


def offtrack(points, path) -> float:
    path = np.asarray(path)
    segments = np.concatenate([path[:-1], path[1:]], 1)
    return float(
        brute_distance(np.asarray(points), segments[np.ptp(segments.reshape(-1, 2, 2), axis=1).sum(1) > 0]).max()
    )


def random_cells(rng) -> np.ndarray:
    """A cheapest path through a random field of costs on a 5 cm grid: many turns of 45° and 90°."""
    cost = np.exp(rng.normal(0, 0.8, (60, 60)))
    return grid.path(cost, rng.integers(0, 20, 2), rng.integers(40, 60, 2)) * 0.05


def test_the_follower_stays_on_its_path_and_on_its_quanta(rng):
    for _ in range(20):
        path, first = random_cells(rng), rng.uniform(-3, 3)
        states = list(world.follow(path[0], first, path, 0.05, TURN))
        points, yaws = np.array([p for p, _ in states]), np.array([y for _, y in states])
        assert offtrack(points, path) < 0.025
        assert offtrack(path, np.concatenate([path[:1], points])) < 0.05  # and leaves out no part of it
        assert math.dist(points[-1], path[-1]) <= 0.05
        turns = geometry.wrap(yaws - first) / TURN
        np.testing.assert_allclose(turns, turns.round(), atol=1e-9)
        # one action at a time: a step along the yaw, or a turn on the spot
        before = [(path[0], first), *states[:-1]]
        for (p, y), (q, z) in zip(before, states, strict=True):
            moved, turned = math.dist(p, q), abs(geometry.wrap(z - y))
            step = np.allclose(q - p, 0.05 * np.array([math.cos(y), math.sin(y)]), atol=1e-12) and turned < 1e-9
            assert step or (moved == 0 and turned == pytest.approx(TURN))


def test_aiming_far_ahead_would_cut_corners():
    """The bound above is no triviality: a pursuit with a fixed look-ahead of 0.4 m leaves the path by more."""
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    position, worst = np.zeros(2), 0.0
    for k in range(38):
        s = min(k * 0.05 + 0.4, 2.0)
        target = np.array([min(s, 1.0), max(s - 1.0, 0.0)])
        position = position + 0.05 * (target - position) / max(math.dist(target, position), 0.05)
        worst = max(worst, offtrack([position], path))
    assert worst > 0.06
    assert offtrack([p for p, _ in world.follow(path[0], 0.0, path)], path) < 0.025


@pytest.mark.parametrize("path", [[[0.0, 0.0]], [[0.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.02, 0.0]]])
def test_a_path_that_is_already_walked_needs_no_action(path):
    assert list(world.follow([0.0, 0.0], 1.0, path)) == []


def test_following_ends_on_paths_that_cross_themselves_or_start_elsewhere():
    back = [[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]]
    states = list(world.follow([0.0, 0.0], 0.0, back))
    assert max(p[0] for p, _ in states) > 0.9
    assert math.dist(states[-1][0], [0, 0]) <= 0.05
    eight = [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]
    assert math.dist(list(world.follow([0.2, 0.0], 2.0, eight))[-1][0], [0, 1]) <= 0.05
    with pytest.raises(ValueError, match="at least one point"):
        list(world.follow([0.0, 0.0], 0.0, np.zeros((0, 2))))


def test_turning_takes_the_short_way_in_whole_turns():
    yaws = list(world.turn_to(3.0, -3.0, TURN))
    assert len(yaws) == round((2 * math.pi - 6) / TURN)
    assert abs(geometry.wrap(yaws[-1] + 3.0)) <= TURN / 2
    np.testing.assert_allclose(np.diff(np.unwrap([3.0, *yaws])), TURN)
    assert list(world.turn_to(0.0, 0.02, TURN)) == []
    assert len(list(world.turn_to(0.0, -1.0, TURN))) == 11


# --- ROS maps ---

PIXELS = np.full((40, 60), 254, np.uint8)  # a room of 60 × 40 cells, walls all around, a block inside
PIXELS[[0, -1], :] = PIXELS[:, [0, -1]] = 0
PIXELS[10:14, 20:30] = 0  # rows are counted from the top
PIXELS[1:6, 1:6] = 205
STATE = np.where(PIXELS == 254, grid.FREE, np.where(PIXELS == 0, grid.OCCUPIED, grid.UNKNOWN))[::-1].T


def ros_map(folder, picture=None, name="map.png", **keys) -> Path:
    """Write a picture (unless it is False) and the yaml file beside it; a key that is None is left out."""
    picture = Image.fromarray(PIXELS) if picture is None else picture
    if picture is not False:
        picture.save(folder / name)
    keys = {"image": name, "resolution": 0.1, "origin": "[1.0, 2.0, 0.0]", "negate": 0} | keys
    keys = {"occupied_thresh": 0.65, "free_thresh": 0.196} | keys
    path = folder / "map.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in keys.items() if value is not None))
    return path


def test_a_map_becomes_walls_where_its_cells_say(tmp_path):
    scene = world.load(ros_map(tmp_path))
    cells = np.argwhere(np.ones_like(STATE))
    centers = (cells + 0.5) * 0.1 + [1.0, 2.0]
    free = STATE[tuple(cells.T)] == grid.FREE
    assert (scene.ground.solid(centers) == ~free).all()
    assert (scene.ground.inside(centers) == free).all()
    assert scene.ground.solid([[0.0, 0.0]]).all()
    # the room's outline with the unknown corner, and the block's: twelve straight walls in all
    assert len(scene.seen.ends) == 6 + 4
    lengths = np.abs(scene.seen.ends[:, 2:] - scene.seen.ends[:, :2]).sum(1)
    assert lengths.sum() == pytest.approx(2 * (5.8 + 3.8) + 2 * (1.0 + 0.4))
    scene.check_team(len(scene.starts))


@pytest.mark.parametrize("yaw", [3.14, 0.7, -1.2])
def test_a_rotated_origin_turns_the_cells_about_it(tmp_path, yaw):
    scene = world.load(ros_map(tmp_path, origin=f"[1.0, 2.0, {yaw}]"))
    u, v = 25.5 * 0.1, (40 - 12 + 0.5) * 0.1  # middle of a block cell, in the map's frame
    x, y = 1 + math.cos(yaw) * u - math.sin(yaw) * v, 2 + math.sin(yaw) * u + math.cos(yaw) * v
    assert scene.ground.solid([[x, y]]).all()
    assert scene.ground.inside(
        [[1 + math.cos(yaw) * 1.5 - math.sin(yaw) * 1.5, 2 + math.sin(yaw) * 1.5 + math.cos(yaw) * 1.5]]
    )
    # straight at the block's lower side from 1 m below, in the map's frame: bearing yaw + 90°
    a, b = 2.5, (40 - 14) * 0.1 - 1.0
    eye = [1 + math.cos(yaw) * a - math.sin(yaw) * b, 2 + math.sin(yaw) * a + math.cos(yaw) * b]
    frame = scene.sense(Camera.from_fov(9), geometry.yaw_pose(eye, yaw + math.pi / 2))
    assert float(frame.depth[4]) == pytest.approx(1.0, abs=1e-6)


def layers(mode: str) -> Image.Image:
    """The map as an opaque image of a mode."""
    gray, opaque = Image.fromarray(PIXELS), Image.fromarray(np.full_like(PIXELS, 255))
    if mode in ("L", "P"):
        return gray.convert(mode)
    return Image.merge(mode, [gray] * len(mode.rstrip("A")) + [opaque] * mode.endswith("A"))


@pytest.mark.parametrize("mode", ["L", "LA", "RGB", "RGBA", "P"])
def test_every_kind_of_image_gives_the_same_cells(tmp_path, mode):
    state, resolution, origin = rosmap.read(ros_map(tmp_path, layers(mode)))
    assert (state == STATE).all()
    assert (resolution, origin.tolist()) == (0.1, [1.0, 2.0, 0.0])


def test_pgm_files_text_and_binary(tmp_path):
    rows = "\n".join(" ".join(map(str, row)) for row in PIXELS)
    (tmp_path / "text.pgm").write_text(f"P2\n# made by hand\n60 40\n255\n{rows}\n")
    (tmp_path / "binary.pgm").write_bytes(b"P5\n# CREATOR: map_saver\n60 40\n255\n" + PIXELS.tobytes())
    for name in ("text.pgm", "binary.pgm"):
        assert (rosmap.read(ros_map(tmp_path, False, name))[0] == STATE).all()


def test_transparent_pixels_are_unknown(tmp_path):
    opaque = np.full_like(PIXELS, 255)
    opaque[20:25, 40:45] = 128
    image = Image.merge("LA", [Image.fromarray(PIXELS), Image.fromarray(opaque)])
    expected = np.where((opaque == 255)[::-1].T, STATE, grid.UNKNOWN)
    for mode in rosmap.MODES[:2]:
        state = rosmap.read(ros_map(tmp_path, image, mode=mode, free_thresh=0.1, occupied_thresh=0.25))[0]
        assert (state[opaque[::-1].T < 255] == grid.UNKNOWN).all()
        assert (state == expected).all() or mode == "scale"


SHADES = np.array([0, 60, 128, 180, 205, 254], np.uint8)  # p = 1, 0.76, 0.50, 0.29, 0.196, 0.004
FREE, TAKEN, DARK = grid.FREE, grid.OCCUPIED, grid.UNKNOWN


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({}, [TAKEN, TAKEN, DARK, DARK, DARK, FREE]),
        ({"mode": "trinary"}, [TAKEN, TAKEN, DARK, DARK, DARK, FREE]),
        ({"mode": "Trinary", "free_thresh": 0.25}, [TAKEN, TAKEN, DARK, DARK, FREE, FREE]),
        ({"occupied_thresh": 0.9, "free_thresh": 0.5}, [TAKEN, DARK, FREE, FREE, FREE, FREE]),
        ({"negate": 1}, [FREE, DARK, DARK, TAKEN, TAKEN, TAKEN]),
        ({"negate": "true"}, [FREE, DARK, DARK, TAKEN, TAKEN, TAKEN]),
        # linear between the thresholds, one half at p = 0.423
        ({"mode": "scale"}, [TAKEN, TAKEN, TAKEN, FREE, FREE, FREE]),
        # the pixel itself in percent, above 100 unknown; negate has no effect
        ({"mode": "raw"}, [FREE, TAKEN, DARK, DARK, DARK, DARK]),
        ({"mode": "raw", "negate": 1}, [FREE, TAKEN, DARK, DARK, DARK, DARK]),
        ({"occupied_thresh": None, "free_thresh": None, "negate": None}, [TAKEN, TAKEN, DARK, DARK, DARK, FREE]),
    ],
)
def test_modes_thresholds_and_negate(tmp_path, keys, expected):
    state = rosmap.read(ros_map(tmp_path, Image.fromarray(SHADES[None]), **keys))[0]
    assert state[:, 0].tolist() == expected


@pytest.mark.parametrize(
    ("origin", "expected"),
    [("[-1, 2, 0.5]", [-1, 2, 0.5]), ("\n- -1.5\n- 2e-1\n- 0.0", [-1.5, 0.2, 0]), ("[3.0, 4.0]", [3, 4, 0])],
)
def test_ways_to_write_the_origin(tmp_path, origin, expected):
    path = ros_map(tmp_path, origin=origin, resolution="5e-2")  # YAML 1.1 reads 5e-2 as a text
    assert rosmap.read(path)[2].tolist() == expected
    assert rosmap.read(path)[1] == 0.05


def test_the_image_is_found_beside_its_yaml_file(tmp_path, monkeypatch):
    (tmp_path / "images").mkdir()
    ros_map(tmp_path, name="images/map.png")
    monkeypatch.chdir(tmp_path.parent)
    assert len(world.load(Path(tmp_path.name) / "map.yaml").starts) == 10


def test_cell_edges_against_a_count_of_neighbours(rng):
    free = rng.random((23, 31)) < 0.6
    edges = cells.cell_edges(free)
    padded = np.pad(free, 1)
    count = (padded[1:] != padded[:-1]).sum() + (padded[:, 1:] != padded[:, :-1]).sum()
    lengths = np.abs(edges[:, 1] - edges[:, 0])
    assert lengths.sum() == count
    assert (lengths.min(1) == 0).all()
    for a, b in edges:  # free on one side all along, not on the other
        along = (b - a) / np.abs(b - a).sum()
        for s in np.arange(0.5, np.abs(b - a).sum()):
            sides = [np.floor(a + along * s + side * along[::-1] * 0.5).astype(int) + 1 for side in (1, -1)]
            assert padded[tuple(sides[0])] != padded[tuple(sides[1])]
    starts = {(tuple(a), tuple(np.sign(b - a)), tuple(b)) for a, b in edges}
    assert len(starts) == len(edges)


def test_starts_and_goals_of_a_map_are_fixed_clear_and_apart(tmp_path):
    scene, again = (world.load(ros_map(tmp_path)) for _ in range(2))
    assert np.array_equal(scene.starts, again.starts)
    assert np.array_equal(scene.goals, again.goals)
    assert len(scene.starts) == len(scene.goals) == 10
    assert scene.ground.clearance(scene.starts).min() >= 0.3
    assert scene.ground.clearance(scene.goals).min() >= 0.3
    for places in (scene.starts[:, :2], scene.goals):
        gaps = np.linalg.norm(places[:, None] - places[None], axis=-1) + 9 * np.eye(10)
        assert gaps.min() >= 0.5


@pytest.mark.skipif(not MAPS.is_dir(), reason="third-party scenes are not beside this checkout")
@pytest.mark.parametrize(
    ("name", "area"),
    [("aws_small_house/map", 155.8), ("nav2_depot/depot", 436.7), ("willow/willow-2010-02-18-0.10", 1086.7)],
)
def test_real_maps(name, area, rng):
    scene = world.load(MAPS / f"{name}.yaml")
    assert scene.ground.area == pytest.approx(area, abs=0.1)
    assert len(scene.starts) == 10
    assert len(scene.seen.ends) < 20_000
    for start, goal in zip(scene.starts, scene.goals, strict=True):
        path = scene.ground.shortest_path(start, goal, 0.1, cell=0.1)
        assert 5 < np.linalg.norm(np.diff(path, axis=0), axis=1).sum() < 16
        pose = geometry.yaw_pose(start[:2], float(rng.uniform(-3, 3)))
        expected = brute_depth(scene.seen.ends, CAMERA, pose)
        assert np.isfinite(expected).all()  # every sight line ends
        np.testing.assert_allclose(scene.sense(CAMERA, pose, max_depth=1e3).depth.numpy(), expected, rtol=1e-5)
    points = scene.starts[:, :2] + rng.normal(0, 0.1, (10, 2))
    np.testing.assert_allclose(scene.ground.clearance(points), brute_distance(points, scene.seen.ends), atol=1e-9)


# --- what is wrong with a file ---


def broken(*keys_and_value) -> dict:
    """The plan with one entry, named by its keys, replaced; or removed where the value is ..."""
    *keys, value = keys_and_value
    document = json.loads(json.dumps(box_plan()))
    inner = document
    for key in keys[:-1]:
        inner = inner[key]
    if value is ...:
        del inner[keys[-1]]
    else:
        inner[keys[-1]] = value
    return document


BAD_PLANS = {
    "not valid JSON": [json.dumps(box_plan())[:-40], "", json.dumps(broken("starts", [[1, math.nan, 0]]))],
    '"format" must be': ["[1, 2]", broken("format", "other"), broken("format", ...)],
    r"walls is missing": [broken("walls", ...)],
    r"walls\[1\].thickness is missing": [broken("walls", 1, "thickness", ...)],
    r"walls\[1\].thickness must be": [broken("walls", 1, "thickness", v) for v in (-0.1, 0, "thick", 1e9, None, True)],
    r"walls\[0\].from must be 2 finite": [broken("walls", 0, "from", v) for v in ([1], [1, "2"], 3, [1, 2, 3])],
    r"walls\[0\].to must be another": [broken("walls", 0, "to", [-0.1, -0.1])],
    r"walls\[0\] must be a JSON object": [broken("walls", 0, 5)],
    "rooms must be a list": [broken("rooms", {})],
    "at least one": [broken("rooms", []), broken("walls", [])],
    "no wall borders on free space": [broken("rooms", 0, "polygon", [[8, 8], [9, 8], [9, 9]])],
    r"rooms\[0\].polygon": [broken("rooms", 0, "polygon", v) for v in ([[0, 0], [1, 1]], [[0, 0], [1, 1], [2, 2]])],
    r"rooms\[0\].wall_color": [broken("rooms", 0, "wall_color", v) for v in ([1, 2, 0], "red", [0, 0])],
    r"rooms\[0\].texture.kind must be one of": [broken("rooms", 0, "texture", {"kind": "marble"})],
    r"starts must be n × 3": [broken("starts", [[1, 2]])],
    r"doors\[0\].at lies on no wall": [broken("doors", [{"at": [2, 2], "width": 1, "height": 2}])],
    r"doors\[0\] overlaps": [broken("doors", [{"at": [4.0, -0.1], "width": 1, "height": 2}])],
    r"windows\[0\].sill is missing": [
        broken("windows", [{"at": [2, -0.1], "width": 1, "height": 1, "color": [0, 0, 1]}])
    ],
    r"furniture\[0\].box is missing": [broken("furniture", [{"name": "x", "height": 1, "color": [0, 0, 0]}])],
    "name must be a line": [broken("name", 5), *(broken("name", name) for name in ("", "two\nlines", "\x1b[31mred"))],
}


@pytest.mark.parametrize(
    ("message", "document"), [(message, document) for message, many in BAD_PLANS.items() for document in many]
)
def test_a_bad_plan_is_refused_in_one_line(load, tmp_path, message, document):
    with pytest.raises(world.SceneError, match=message) as error:
        load(document)
    assert str(tmp_path / "plan.json") in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"image": None}, "image is missing"),
        ({"image": "other.png"}, "image other.png cannot be read"),
        ({"resolution": None}, "resolution is missing"),
        ({"resolution": -0.05}, "resolution must be positive"),
        ({"resolution": 0}, "resolution must be positive"),
        ({"resolution": ".nan"}, "resolution must be a finite number"),
        ({"resolution": "fine"}, "resolution must be a finite number"),
        ({"origin": None}, "origin is missing"),
        ({"origin": "[1.0, .inf, 0]"}, "origin must be finite numbers"),
        ({"origin": "[1.0]"}, "origin must be finite numbers"),
        ({"origin": "{x: 1}"}, "origin must be finite numbers"),
        ({"mode": "fuzzy"}, "mode must be one of trinary, scale, raw"),
        ({"occupied_thresh": 0.1}, "free_thresh"),
        ({"occupied_thresh": 65}, "free_thresh"),
        ({"free_thresh": 0.0}, "no cell is free"),
        ({"resolution": 0.001}, "wide enough"),
        ({"resolution": 9e5}, r"m is too large for a grid of 0\.1 m cells; are the units"),
        ({"resolution": "!!python/object/apply:os.getcwd []"}, "not valid YAML"),
        ({"resolution": "[1, 2"}, "not valid YAML"),
    ],
)
def test_a_bad_map_is_refused_in_one_line(tmp_path, keys, message):
    path = ros_map(tmp_path, **keys)
    with pytest.raises(world.SceneError, match=message) as error:
        world.load(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_bad_images_are_refused(tmp_path):
    path = ros_map(tmp_path)
    whole = (tmp_path / "map.png").read_bytes()
    for content in (whole[: len(whole) // 2], b"no image", b""):
        (tmp_path / "map.png").write_bytes(content)
        with pytest.raises(world.SceneError, match=r"map\.png cannot be read"):
            world.load(path)
    deep = Image.fromarray(PIXELS.astype(np.uint16) * 257)
    for name in ("map.png", "map.pgm"):
        with pytest.raises(world.SceneError, match="8 bits"):
            world.load(ros_map(tmp_path, deep, name))


def test_a_scene_that_does_not_exist_is_named(tmp_path):
    for scene, message in [
        ("palace", "no such scene; give one of flat"),
        ("../flat", "no such scene"),
        (tmp_path / "house.xyz", "no such scene"),
        (tmp_path / "none.json", "cannot be read"),
        (tmp_path / "none.yaml", "cannot be read"),
        (tmp_path, "no such scene"),
    ]:
        with pytest.raises(world.SceneError, match=message):
            world.load(scene)
    with pytest.raises(world.SceneError, match="flat: starts must be finite numbers"):
        world.load("flat", starts=[[1.0, math.nan, 0.0]])
    assert world.load("flat", starts=[[2.0, 1.0, 0.0]]).starts.shape == (1, 3)
    with pytest.raises(world.SceneError, match="finite"):
        dataclasses.replace(world.load("flat").seen, colors=np.full((186, 3), np.nan))


def test_noise_is_the_same_on_every_machine():
    """The texture is arithmetic on integers: these values were computed once and must never change."""
    values = rays.noise_at(np.array([[0.0, 0.0], [3.0, -7.0], [-2.5, 11.25]]), 1.0)
    np.testing.assert_allclose(
        values,
        [[-0.94194, 0.875832, -0.44626], [-0.866137, -0.130852, -0.82006], [-0.600168, -0.10018, 0.528989]],
        atol=1e-6,
    )
