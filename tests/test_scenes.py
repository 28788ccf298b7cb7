"""The bundled buildings: fit for ten robots, and sound as buildings."""

import dataclasses
import itertools
import json
import math

import numpy as np
import pytest

from mannbv import geometry, world
from mannbv.camera import Camera
from mannbv.world import bodies, library
from mannbv.world.formats import plan

NAMES = ["flat", "openplan", "corridor", "wings"]
LONGEST = {"flat": 12, "openplan": 12, "corridor": 12, "wings": 18}
ROBOT = 0.25  # [m] every room can be reached by a robot of this radius


@pytest.fixture(scope="module")
def worlds():
    return {name: world.load(name) for name in NAMES}


@pytest.fixture(scope="module")
def plans():
    return {name: plan.read(library.folder() / f"{name}.json") for name in NAMES}


def length(path) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def test_the_list_of_scenes():
    scenes = world.scenes()
    assert [scene.name for scene in scenes] == NAMES
    assert [round(scene.area, 1) for scene in scenes] == [76.0, 124.8, 169.2, 240.0]
    assert all(scene.description and "\n" not in scene.description for scene in scenes)


@pytest.mark.parametrize("name", NAMES)
def test_ten_robots_start_and_arrive(worlds, name):
    scene = worlds[name]
    assert scene.starts.shape == (10, 3)
    assert scene.goals.shape == (10, 2)
    assert scene.ground.clearance(scene.starts).min() >= 0.3
    assert scene.ground.clearance(scene.goals).min() >= 0.3
    assert scene.ground.inside(np.concatenate([scene.starts[:, :2], scene.goals])).all()
    gaps = [math.dist(a[:2], b[:2]) for a, b in itertools.combinations(scene.starts, 2)]
    assert min(gaps) >= 0.5
    scene.check_team(10, radius=ROBOT)
    for start, goal in zip(scene.starts, scene.goals, strict=True):
        assert 4 <= length(scene.ground.shortest_path(start, goal, 0.1)) <= LONGEST[name]


@pytest.mark.parametrize("name", NAMES)
def test_routes_meet(worlds, name):
    """Every robot's way comes within a metre of the ways of at least three others."""
    scene = worlds[name]
    paths = [scene.ground.shortest_path(s, g, 0.1)[::4] for s, g in zip(scene.starts, scene.goals, strict=True)]
    near = [[np.linalg.norm(a[:, None] - b[None], axis=-1).min() < 1.0 for b in paths if b is not a] for a in paths]
    assert min(sum(row) for row in near) >= 3


@pytest.mark.parametrize("name", NAMES)
def test_every_room_can_be_entered(worlds, plans, name):
    scene = worlds[name]
    lattice, _ = scene.ground.free_grid(0.05, ROBOT)
    reached = scene.ground.reachable_free(0.05, ROBOT, scene.starts[0])
    room = scene.ground.rooms.which(lattice.centers().reshape(-1, 2)).reshape(lattice.shape)
    for k, one in enumerate(plans[name].rooms):
        assert (reached & (room == k)).sum() * 0.05**2 > 0.5, one.name


@pytest.mark.parametrize("name", NAMES)
def test_doors_are_wide_and_nothing_stands_in_them(worlds, name):
    scene = worlds[name]
    doors = [d for d in _document(name)["doors"] if d.get("open", True)]
    assert len(doors) >= 4
    for door in doors:
        assert door["width"] >= 0.9
        middle, half = np.array(door["at"]), door["width"] / 2 - 0.05
        u, v = np.meshgrid(np.linspace(-half, half, 15), np.linspace(-0.5, 0.5, 21))
        free = [
            ~scene.ground.solid(middle + np.stack(pair, -1).reshape(-1, 2)).any() for pair in ((u, v), (v, u))
        ]  # one way or the other
        assert any(free), door


@pytest.mark.parametrize("name", NAMES)
def test_furniture_stands_inside_and_apart(plans, name):
    """No piece pokes through a wall or into another; what hangs or lies flat does not count."""
    scene = plans[name]
    standing = [b for b in scene.furniture if b.elevation == 0 and b.height > 0.05]
    walls = [b for b in scene.walls if b.elevation < 1]
    for block in standing:
        corners = block.footprint
        inner = corners.mean(0) + 0.98 * (corners - corners.mean(0))
        for other in [*walls, *standing]:
            if other is block:
                continue
            assert not bodies.Polygons((other.footprint,)).contains(inner).any(), (block.name, other.name)


@pytest.mark.parametrize("name", NAMES)
def test_buildings_are_closed_and_their_views_rich(worlds, plans, name):
    """Every sight line from every start ends on a wall, and no two rooms have one colour."""
    scene = worlds[name]
    camera = Camera.from_fov(64)
    colors = []
    for x, y, _ in scene.starts:
        for yaw in np.arange(4) * math.pi / 2:
            frame = scene.sense(camera, geometry.yaw_pose([x, y], float(yaw)), max_depth=100.0)
            assert (frame.depth > 0).all()
            colors.append(frame.color.std(0).mean())
    assert np.mean(colors) > 0.1
    walls = [room.wall_color for room in plans[name].rooms]
    assert min(math.dist(a, b) for a, b in itertools.combinations(walls, 2)) > 0.05


def test_an_unclosed_building_would_be_noticed(worlds):
    """The check above sees a hole: without its outer walls' pieces, sight lines leave the flat."""
    scene = worlds["flat"]
    walls = scene.seen
    keep = np.abs(walls.ends[:, [0, 2]].mean(1) - walls.lower[0]) > 0.2
    opened = dataclasses.replace(scene, seen=world.Segments(walls.ends[keep], walls.colors[keep], walls.textures[keep]))
    frame = opened.sense(Camera.from_fov(64), geometry.yaw_pose(scene.starts[2, :2], math.pi), max_depth=100.0)
    assert (frame.depth == 0).any()


def _document(name: str) -> dict:
    return json.loads((library.folder() / f"{name}.json").read_text())
