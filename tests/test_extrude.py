"""Plans raised to buildings: closed, without doubled faces, as large as closed forms say, and alike to flatland."""

import dataclasses
import json
import math

import numpy as np
import pytest
import trimesh

from mannbv import geometry, world
from mannbv.camera import Camera
from mannbv.kernels.flat import rays
from mannbv.world import bodies, extrude, library
from mannbv.world.formats import mesh, plan
from mannbv.world.surfaces import Surfaces

NAMES = ["flat", "openplan", "corridor", "wings"]
RED, BLUE, PANE, LEAF = [0.7, 0.2, 0.2], [0.2, 0.3, 0.7], [0.6, 0.8, 0.9], [0.4, 0.2, 0.1]


@pytest.fixture(scope="module")
def plans():
    return {name: plan.read(library.folder() / f"{name}.json") for name in NAMES}


@pytest.fixture(scope="module")
def buildings(plans):
    return {name: extrude.surfaces(scene) for name, scene in plans.items()}


def box(center, size, height, elevation=0.0, yaw=0.0):
    shape = {"center": center, "size": size, "yaw": yaw}
    return {"name": "box", "box": shape, "height": height, "elevation": elevation, "color": RED}


def room(polygon, color=BLUE, texture=None):
    texture = texture or {"kind": "plain"}
    return {"name": "room", "polygon": polygon, "floor_color": RED, "wall_color": color, "texture": texture}


def built(tmp_path, rooms, furniture=(), walls=(), **openings) -> Surfaces:
    """Rooms 2.5 m high, with walls 0.2 m thick around each, and `walls` in full."""
    around = [
        {"from": a, "to": b, "thickness": 0.2}
        for one in rooms
        for a, b in zip(one["polygon"], one["polygon"][1:] + one["polygon"][:1], strict=True)
    ]
    document = {"format": plan.FORMAT, "name": "hut", "description": "a hut", "wall_height": 2.5, "rooms": rooms}
    document |= {"walls": around + list(walls), "furniture": list(furniture), "starts": [], "goals": []} | openings
    path = tmp_path / "hut.json"
    path.write_text(json.dumps(document))
    return extrude.surfaces(plan.read(path))


HUT = [[0, 0], [4, 0], [4, 3], [0, 3]]  # 3.8 × 2.8 m between its walls
BARE = 2 * 12.0 + 2 * (3.8 + 2.8) * 2.5  # [m²] floor and ceiling to the centre lines, walls between the corners


def area(surfaces: Surfaces) -> float:
    a, b = (surfaces.corners[:, k] - surfaces.corners[:, 0] for k in (1, 2))
    return float(np.linalg.norm(np.cross(a, b), axis=1).sum() / 2)


def look(surfaces: Surfaces, origin, direction) -> tuple[float, np.ndarray, np.ndarray]:
    """Distance [m], colour (3,) and place (3,) of what one sees from a point in a direction."""
    origin, direction = np.array([origin], float), np.array([direction], float)
    direction /= np.linalg.norm(direction)
    depth, face = surfaces.cast(origin, direction)
    return depth[0], surfaces.shaded(origin[0], direction, face, 1e-6)[0], (origin + min(depth[0], 1e3) * direction)[0]


@pytest.mark.parametrize(
    ("furniture", "more"),
    [
        ([], 0.0),
        ([box([2, 1.5], [1.0, 0.6], 0.7)], 0.6 + 3.2 * 0.7),  # no underside
        ([box([2, 1.5], [1.0, 0.6], 0.7, yaw=0.4)], 0.6 + 3.2 * 0.7),
        ([box([2, 1.5], [1.0, 0.6], 0.7, elevation=1.0)], 2 * 0.6 + 3.2 * 0.7),
        ([box([2, 1.5], [1.0, 0.6], 2.5)], 3.2 * 2.5),  # up to the ceiling: no top
        ([box([2, 1.5], [1.0, 0.6], 9.0)], 3.2 * 2.5),  # and through it
        ([box([2, 0.4], [1.0, 0.6], 0.7)], 0.6 + 2 * 0.6 * 0.7),  # against a wall that it hides as much of
        ([box([2, 0.3], [1.0, 0.6], 0.7)], 0.5 + 2 * 0.5 * 0.7),  # reaching into the wall
        ([box([2, 1.5], [1.0, 0.6], 0.7), box([2, 1.5], [0.4, 0.4], 0.5, 0.7)], 0.6 + 3.2 * 0.7 + 1.6 * 0.5),  # stacked
        ([box([2, 1.5], [1.0, 0.6], 0.7), box([2.5, 1.5], [1.0, 0.4], 0.7)], 0.8 + 3.2 * 0.7 + 1.0 * 0.7),  # joined
        ([box([2, 1.5], [1.0, 0.6], 0.7), box([2.5, 1.5], [1.0, 0.6], 0.7, 0.7)], 1.2 + 6.4 * 0.7),  # overhanging
    ],
)
def test_areas_are_those_of_what_one_can_see(tmp_path, furniture, more):
    assert area(built(tmp_path, [room(HUT)], furniture)) == pytest.approx(BARE + more, rel=1e-6)


def test_rooms_and_furniture_may_have_notches(tmp_path):
    corner = [[0, 0], [4, 0], [4, 1.5], [2, 1.5], [2, 3], [0, 3]]
    piece = {"name": "L", "polygon": [[0.5, 0.5], [1.5, 0.5], [1.5, 0.8], [0.8, 0.8], [0.8, 1.5], [0.5, 1.5]]}
    surfaces = built(tmp_path, [room(corner)], [piece | {"height": 0.6, "color": RED}])
    inner = 2 * (3.8 + 2.8) * 2.5  # a notch leaves the way around as long
    assert area(surfaces) == pytest.approx(2 * 9.0 + inner + 0.51 + 4.0 * 0.6, rel=1e-6)
    assert look(surfaces, [1.2, 1.2, 2.0], [0, 0, -1])[0] == pytest.approx(2.0)  # past the piece's notch to the floor
    assert look(surfaces, [0.6, 1.2, 2.0], [0, 0, -1])[0] == pytest.approx(1.4)


def two_rooms(tmp_path, **openings) -> Surfaces:
    """Two rooms on both sides of a wall along x = 4, 0.2 m thick, with a door from y = 1 to 2 in it."""
    right = [[4, 0], [8, 0], [8, 3], [4, 3]]
    door = {"at": [4, 1.5], "width": 1.0, "height": 2.1} | openings.pop("door", {})
    rooms = [room(HUT, RED), room(right, BLUE)]
    return built(tmp_path, rooms, doors=[door], **openings)


def test_an_open_door_lets_pass_below_its_lintel(tmp_path):
    surfaces = two_rooms(tmp_path)
    assert look(surfaces, [1, 1.5, 1.25], [1, 0, 0])[0] == pytest.approx(6.9)
    distance, color, _ = look(surfaces, [1, 1.5, 2.2], [1, 0, 0])
    assert distance == pytest.approx(2.9) and color == pytest.approx(RED, abs=0.01)
    for x, wall in ((3.95, RED), (4.05, BLUE)):  # a jamb and the lintel's underside: half of it in each room
        distance, color, _ = look(surfaces, [x, 1.5, 1.25], [0, 1, 0])
        assert distance == pytest.approx(0.5) and color == pytest.approx(wall, abs=0.01)
        distance, color, _ = look(surfaces, [x, 1.5, 1.25], [0, 0, 1])
        assert distance == pytest.approx(0.85) and color == pytest.approx(0.8 * np.array(wall), abs=0.01)
    assert look(surfaces, [4, 1.6, 1.25], [0, 0, -1])[0] == pytest.approx(1.25)  # the floor goes through


def test_a_closed_door_has_a_leaf(tmp_path):
    surfaces = two_rooms(tmp_path, door={"open": False, "color": LEAF})
    distance, color, _ = look(surfaces, [1, 1.5, 1.25], [1, 0, 0])
    assert distance == pytest.approx(2.9) and color == pytest.approx(LEAF, abs=0.01)


def test_a_window_has_a_pane_between_sill_and_lintel(tmp_path):
    window = {"at": [8, 1.5], "width": 1.0, "sill": 0.9, "height": 1.3, "color": PANE}
    surfaces = two_rooms(tmp_path, windows=[window])
    for z, wanted in ((0.85, BLUE), (0.95, PANE), (2.15, PANE), (2.25, BLUE)):
        assert look(surfaces, [6, 1.5, z], [1, 0, 0])[1] == pytest.approx(wanted, abs=0.01)
    opened = two_rooms(tmp_path, windows=[window | {"open": True}])
    assert look(opened, [6, 1.5, 1.5], [1, 0, 0])[0] == math.inf
    _, color, place = look(opened, [6, 1.5, 1.5], [1.95, 0, -0.6])
    assert place == pytest.approx([7.95, 1.5, 0.9]) and color == pytest.approx(1.1 * np.array(BLUE), abs=0.01)


def inner_points(scene: plan.Plan, rng, n) -> np.ndarray:
    """Random points (≤ n, 3) inside a building and outside all bodies, a millimetre from floor and ceiling."""
    ground = plan.ground(scene)
    points = np.append(
        rng.uniform(ground.walls.lower, ground.walls.upper, (n, 2)),
        rng.uniform(0.001, scene.wall_height - 0.001, (n, 1)),
        1,
    )
    free = ground.inside(points)
    for block in (*scene.walls, *scene.furniture):
        x = points[:, 2] - block.elevation
        free &= ~(bodies.Polygons((block.footprint,)).contains(points[:, :2]) & (x > 0) & (x < block.height))
    return points[free]


def normals(surfaces: Surfaces) -> np.ndarray:
    a, b = (surfaces.corners[:, k] - surfaces.corners[:, 0] for k in (1, 2))
    cross = np.cross(a, b)
    return cross / np.linalg.norm(cross, axis=1)[:, None]


@pytest.mark.parametrize("name", NAMES)
def test_no_ray_leaves_a_building(plans, buildings, rng, name):
    """Every ray ends on a face, and on its front."""
    surfaces = buildings[name]
    points = inner_points(plans[name], rng, 400_000)
    directions = rng.standard_normal(points.shape)
    depth, face = surfaces.cast(points, directions)
    assert len(points) > 100_000 and (face >= 0).all()
    away = depth * np.linalg.norm(directions, axis=1) > 1e-5  # nearer, embree's single precision decides
    assert (np.einsum("ij,ij->i", normals(surfaces)[face], directions)[away] < 0).all()


def test_a_missing_face_would_be_noticed(plans, buildings, rng):
    surfaces = buildings["flat"]
    points = inner_points(plans["flat"], rng, 20_000)
    directions = rng.standard_normal(points.shape)
    largest = np.argmax(np.linalg.norm(np.ptp(surfaces.corners, axis=1), axis=1))
    assert (holed(surfaces, largest).cast(points, directions)[1] < 0).any()


def holed(surfaces: Surfaces, face) -> Surfaces:
    parts = {key: np.delete(getattr(surfaces, key), face, 0) for key in ("corners", "colors", "uv", "image")}
    return dataclasses.replace(surfaces, **parts)


def layers(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How many of the triangles (f, 3, 3) hold each of the points (k, 3), by their barycentric coordinates."""
    a, b = (corners[:, k] - corners[:, 0] for k in (1, 2))
    frames = np.stack([a, b, np.cross(a, b) / np.linalg.norm(np.cross(a, b), axis=1)[:, None]], 2)
    counts = np.zeros(len(points), int)
    for origin, inverse in zip(corners[:, 0], np.linalg.inv(frames), strict=True):
        u, v, height = inverse @ (points - origin).T
        counts += (np.abs(height) < 1e-6) & (np.minimum(np.minimum(u, v), 1 - u - v) > 1e-6)
    return counts


@pytest.mark.parametrize("name", NAMES)
def test_no_two_faces_lie_in_one_place(buildings, rng, name):
    corners = buildings[name].corners
    points = np.einsum("kf,fkd->fd", rng.dirichlet([1, 1, 1], len(corners)).T, corners)
    assert (layers(corners, points) == 1).all()
    assert (layers(np.concatenate([corners, corners[:1]]), points)[0]) == 2  # a doubled one would be noticed


@pytest.mark.parametrize("name", NAMES)
def test_at_the_cut_a_building_looks_as_in_flatland(plans, buildings, name):
    """Depth and colour along a level line of sight equal flatland's, of what stands at that height."""
    scene = plans[name]
    walls = plan.ground(scene, (extrude.CUT, extrude.CUT)).walls
    yaws = np.linspace(-math.pi, math.pi, 60, endpoint=False)
    camera, errors = Camera.from_fov(33), []
    slopes = (np.arange(33) + 0.5 - 16.5) / camera.focal
    for x, y, _ in scene.starts:
        for yaw in yaws:
            right, forward = np.array([math.sin(yaw), -math.cos(yaw)]), np.array([math.cos(yaw), math.sin(yaw)])
            depth, index, share = rays.cast(walls.ends, np.array([x, y]), right, forward, slopes)
            color = rays.shade(walls.ends, walls.colors, walls.textures, index, share, 1)
            origin = np.array([x, y, extrude.CUT + 0.001])  # some furniture ends at the very cut
            directions = np.insert(forward + slopes[:, None] * right, 2, 0.0, 1)
            found, face = buildings[name].cast(np.broadcast_to(origin, directions.shape), directions)
            seen = buildings[name].shaded(origin, directions, face, 1e-6)
            errors.append(np.column_stack([np.abs(found - depth), np.abs(seen - color).max(1)]))
    errors = np.concatenate(errors)
    assert (errors[:, 0] < 1e-5).mean() > 0.9995  # a sight line along an edge may end on either side of it
    assert (errors[:, 1] < 0.02).mean() > 0.9995


def test_colors_away_from_the_cut_change_slowly_and_stay_near_the_walls_own(tmp_path):
    texture = {"kind": "noise", "period": 0.5, "contrast": 0.4}
    surfaces = built(tmp_path, [room(HUT, texture=texture)])
    column = np.array([look(surfaces, [2, 1.5, z], [1, 0, 0])[1] for z in np.arange(0.12, 2.5, 0.01)])
    steepest = 0.4 * 1.5 * 2 / 0.5 * np.array(BLUE)  # [1/m] contrast · slope of the blend · knots' gap / period
    assert (np.abs(np.diff(column, axis=0)) < 0.01 * steepest + 1 / 255).all()
    assert np.abs(column / BLUE - 1).max() < 0.42
    assert (column / BLUE).std(0).min() > 0.05


def test_stripes_stand_upright(tmp_path):
    surfaces = built(tmp_path, [room(HUT, texture={"kind": "stripes", "period": 0.4, "contrast": 0.3})])
    rows = np.array([[look(surfaces, [1, y, z], [1, 0, 0])[1] for y in np.arange(0.2, 2.8, 0.05)] for z in (0.3, 2.0)])
    assert rows[0] == pytest.approx(rows[1], abs=0.01)
    along = 3 - np.arange(0.2, 2.8, 0.05)  # a wall's outline comes back along its inner face
    wave = 1 + 0.3 * np.sin(2 * math.pi * along / 0.4)
    assert rows[0] == pytest.approx(np.outer(wave, BLUE), abs=0.01)


def test_walls_have_skirting_boards_and_closed_doors_none(tmp_path):
    surfaces = two_rooms(tmp_path, door={"open": False, "color": LEAF})
    seen = [look(surfaces, [3, y, z], [1, 0, 0])[1] for y in (0.5, 1.5) for z in (0.04, 0.14)]
    assert np.stack(seen) == pytest.approx(np.array([extrude.CEILING, RED, LEAF, LEAF]), abs=0.01)


@pytest.mark.parametrize("name", NAMES)
def test_a_plan_file_becomes_a_space(name):
    space, ground = extrude.load(library.folder() / f"{name}.json"), world.load(name)
    assert (space.name, space.description, space.dim, space.ground.floor) == (name, ground.description, 3, 0.0)
    assert np.array_equal(np.delete(space.starts, 2, 1), ground.starts)
    assert np.array_equal(space.goals[:, :2], ground.goals)
    assert (space.starts[:, 2] == 1.25).all() and (space.goals[:, 2] == 1.25).all()
    assert np.array_equal(space.ground.walls.ends, ground.seen.ends)
    frame = space.sense(Camera.from_fov(32, 24), geometry.yaw_pose(space.starts[0, :3], 0.3), max_depth=100.0)
    assert (frame.depth > 0).all() and frame.color.std() > 0.05
    assert sum(image.nbytes for image in space.seen.images) < 50e6


def test_a_body_in_space_runs_into_what_flatland_is_cut_below(tmp_path):
    """A shelf from 1.1 m up, above flatland's cut and in the height of the body; a sill of 8 cm is the reverse."""
    things = [box([1, 1.5], [0.5, 0.5], 0.4, elevation=1.1), box([3, 1.5], [0.5, 0.5], 0.08)]
    built(tmp_path, [room(HUT)], things)
    shelf, sill = np.array([[1.0, 1.5]]), np.array([[3.0, 1.5]])
    plane, space = (world.load(tmp_path / "hut.json", dim=dim) for dim in (2, 3))
    assert not plane.ground.solid(shelf) and plane.ground.solid(sill)
    assert space.ground.solid(shelf) and not space.ground.solid(sill)


def test_images_of_a_large_hall_stay_small(tmp_path):
    texture = {"kind": "stripes", "period": 2.0, "contrast": 0.3}
    surfaces = built(tmp_path, [room([[0, 0], [60, 0], [60, 50], [0, 50]], texture=texture)])
    assert max(max(image.shape) for image in surfaces.images) == extrude.MOST_TEXELS
    for y in (10.25, 47.7):
        wave = 1 + 0.3 * np.sin(math.pi * (50 - y))  # the outline of a wall comes back along its inner face
        assert look(surfaces, [30, y, 1.0], [1, 0, 0])[1] == pytest.approx(wave * np.array(BLUE), abs=0.01)


def test_where_rooms_overlap_the_first_has_the_floor(tmp_path):
    surfaces = built(tmp_path, [room(HUT), room([[3, 0], [8, 0], [8, 3], [3, 3]])])
    floor = surfaces.corners[(surfaces.corners[..., 2] == 0).all(1)]
    assert area(Surfaces.plain(floor)) == pytest.approx(24.0)
    assert np.ptp(floor[..., 0]) == 8.0


def test_an_exported_building_has_the_same_faces_and_colors(buildings, rng, tmp_path):
    surfaces = buildings["flat"]
    extrude.export(surfaces, tmp_path / "flat.glb")
    (file,) = trimesh.load_scene(tmp_path / "flat.glb").geometry.values()
    upright = file.vertices[file.faces] @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # y up → z up
    assert upright == pytest.approx(surfaces.corners, abs=1e-6)
    back, _ = mesh.read(tmp_path / "flat.glb")
    assert back.corners == pytest.approx(surfaces.corners, abs=1e-6)
    origin, directions = np.array([1.9, 3.5, 1.3]), rng.standard_normal((5000, 3))
    _, face = surfaces.cast(np.broadcast_to(origin, directions.shape), directions)
    for pixel, share in ((1e-6, 1.0), (0.02, 0.9)):  # exact near by; far off both see coarser copies of their images
        ours, theirs = (one.shaded(origin, directions, face, pixel) for one in (surfaces, back))
        assert (np.abs(ours - theirs).max(1) < 0.01).mean() >= share


def test_only_buildings_are_exported_and_only_as_glb(buildings, tmp_path):
    with pytest.raises(ValueError, match=r"flat.obj: buildings are written as binary glTF; let the name end in .glb"):
        extrude.export(buildings["flat"], tmp_path / "flat.obj")
    with pytest.raises(ValueError, match="only a plan's surfaces can be written"):
        extrude.export(Surfaces.plain(buildings["flat"].corners), tmp_path / "flat.glb")
