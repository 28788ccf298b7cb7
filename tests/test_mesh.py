"""Meshes as scenes: what is read, which way is up, how large, where the floors are; against rooms built here."""

import json
import logging
import math
import pickle
import struct
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image
from scipy import ndimage, optimize

from mannbv import geometry, grid
from mannbv.camera import Camera
from mannbv.kernels.space import cover
from mannbv.world import SceneError
from mannbv.world.formats import mesh, rosmap, storeys, upright
from mannbv.world.surfaces import Surfaces

SCENES = Path(__file__).parents[1].parent / "shared" / "scenes"
HERE = pytest.mark.skipif(not SCENES.is_dir(), reason="third-party scenes are not beside this checkout")
SIZE = np.array([6.0, 4.0, 2.6])
RED, GREEN, BLUE, YELLOW, WHITE, BROWN = [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0.9, 0.9, 0.9], [0.5, 0.3, 0.1]
TO_FILE = {  # a point of the world, z up, in a file whose axis of that name points up
    "z": lambda p: p,
    "y": lambda p: p[:, [0, 2, 1]] * [1, 1, -1],
    "x": lambda p: p[:, [2, 0, 1]],
    "-z": lambda p: p * [1, -1, -1],
    "-y": lambda p: p[:, [0, 2, 1]] * [1, -1, 1],
    "-x": lambda p: p[:, [2, 0, 1]] * [-1, 1, -1],
}


def quad(a, b, c, d, color, n=4) -> trimesh.Trimesh:
    """A rectangle in 2 n² triangles with one colour a corner."""
    a, b, c, d = (np.array(v, float) for v in (a, b, c, d))
    u, v = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij")
    u, v = u.reshape(-1, 1), v.reshape(-1, 1)
    points = (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d
    i = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    faces = np.concatenate([np.stack([i, i + n + 1, i + n + 2], 1), np.stack([i, i + n + 2, i + 1], 1)])
    colors = np.tile(np.array([*color, 1.0]) * 255, (len(points), 1)).astype(np.uint8)
    return trimesh.Trimesh(points, faces, vertex_colors=colors, process=False)


def box(low, high, color) -> trimesh.Trimesh:
    solid = trimesh.creation.box(bounds=[low, high])
    solid.visual.vertex_colors = np.tile(np.uint8([*(255 * np.array(color)), 255]), (len(solid.vertices), 1))
    return solid


def room(z=0.0, ceiling=True, table=True) -> list[trimesh.Trimesh]:
    """A room of `SIZE`, its floor at height z: walls red in the north (+y), green south, blue west, yellow east."""
    x, y, top = *SIZE[:2], z + SIZE[2]
    parts = [
        quad([0, 0, z], [x, 0, z], [x, y, z], [0, y, z], WHITE),
        quad([0, y, z], [x, y, z], [x, y, top], [0, y, top], RED),
        quad([0, 0, z], [x, 0, z], [x, 0, top], [0, 0, top], GREEN),
        quad([0, 0, z], [0, y, z], [0, y, top], [0, 0, top], BLUE),
        quad([x, 0, z], [x, y, z], [x, y, top], [x, 0, top], YELLOW),
    ]
    parts += [quad([0, 0, top], [x, 0, top], [x, y, top], [0, y, top], WHITE)] if ceiling else []
    parts += [box([0.5, 0.5, z + 0.7], [1.7, 1.3, z + 0.75], BROWN)] if table else []
    return parts


def written(parts, path: Path, up="z", unit=1.0) -> Path:
    """The parts in one file, with `up` upwards and `unit` metres a unit."""
    one = trimesh.util.concatenate(parts)
    one.vertices = TO_FILE[up](np.asarray(one.vertices)) / unit
    if path.suffix != ".gltf":
        one.export(path)
        return path
    for name, data in trimesh.exchange.gltf.export_gltf(one).items():
        (path if name == "model.gltf" else path.with_name(name)).write_bytes(data)
    return path


def seen(space, yaw) -> np.ndarray:
    """The colour in the middle of what a camera sees from the middle of the room."""
    position = torch.tensor([SIZE[0] / 2, SIZE[1] / 2, space.ground.floor + 1.25])
    frame = space.sense(Camera.from_fov(9, 9, math.radians(40)), geometry.yaw_pose(position, yaw))
    return frame.color[4, 4].numpy()


@pytest.mark.parametrize("suffix", [".glb", ".ply", ".obj"])
@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("unit", [1.0, 0.01])
def test_a_room_stands_as_it_was_built(tmp_path, suffix, up, unit):
    space = mesh.load(written(room(), tmp_path / f"room{suffix}", up, unit))
    np.testing.assert_allclose(space.seen.lower, [0, 0, 0], atol=1e-5)
    np.testing.assert_allclose(space.seen.upper, SIZE, atol=1e-5)
    assert abs(space.ground.floor) < 1e-5 and space.dim == 3
    for yaw, color in ((np.pi / 2, RED), (-np.pi / 2, GREEN), (np.pi, BLUE), (0.0, YELLOW)):
        np.testing.assert_allclose(seen(space, yaw), color, atol=0.01)
    space.check_team(len(space.starts))
    np.testing.assert_allclose(space.starts[:, 2], 1.25, atol=1e-5)
    note = space.notes[0]
    assert f"{up} is up" in note and ("metres" if unit == 1 else "centimetres") in note and "--scale" in note


@pytest.mark.parametrize("up", list(TO_FILE))
def test_every_axis_may_point_up(tmp_path, up):
    path = written(room(), tmp_path / "room.glb", up)
    surfaces, notes = mesh.read(path, up=up)
    original = np.sort(trimesh.util.concatenate(room()).triangles.reshape(-1, 9), axis=0)
    np.testing.assert_allclose(np.sort(surfaces.corners.reshape(-1, 9), axis=0), original, atol=1e-5)
    assert np.linalg.det(np.array(upright.UP[up])) == 1  # a rotation, no mirror
    assert "--up" not in notes[0]
    wrong = mesh.read(path, up="z" if up != "z" else "y")[0]  # another axis is another room
    assert np.abs(np.sort(wrong.corners.reshape(-1, 9), axis=0) - original).max() > 1


@pytest.mark.parametrize(
    ("unit", "ceiling", "word"),
    [(1, True, "metres"), (0.001, True, "millimetres"), (0.0254, False, "inches"), (0.3048, False, "feet")],
)
def test_the_unit_is_read_off_a_storey(tmp_path, unit, ceiling, word):
    surfaces, notes = mesh.read(written(room(ceiling=ceiling), tmp_path / "room.ply", "y", unit))
    np.testing.assert_allclose(surfaces.upper - surfaces.lower, SIZE, rtol=1e-5)
    assert f"in {word}," in notes[0]


def test_no_known_unit_makes_a_usual_storey_and_says_so(tmp_path):
    path = written(room(), tmp_path / "room.glb", "y", 0.55)
    surfaces, notes = mesh.read(path)
    assert np.ptp(surfaces.corners[..., 2]) == pytest.approx(upright.USUAL, rel=1e-3)
    assert "0.55 m a unit" in notes[0] and "--up and --scale would overrule" in notes[0]
    scaled, notes = mesh.read(path, scale=0.5)
    np.testing.assert_allclose(scaled.upper - scaled.lower, SIZE / 0.55 * 0.5, rtol=1e-5)
    assert "0.5 m a unit" in notes[0] and "--scale" not in notes[0]


def test_a_stray_object_is_left_out(tmp_path):
    away = np.array([343e3, 0, 0])
    surfaces, notes = mesh.read(written([*room(), box(away, away + 2, RED)], tmp_path / "room.ply"))
    np.testing.assert_allclose(surfaces.upper, SIZE, atol=1e-4)
    assert len(surfaces.corners) == sum(len(part.faces) for part in room())
    assert "12 of 216 triangles" in notes[1]
    assert len(mesh.read(written(room(), tmp_path / "room.ply"))[1]) == 1  # nothing to say


def test_a_detailed_plant_is_not_the_whole_scene(tmp_path):
    """Nearly all corners lie in one corner of the room, within a hand's breadth."""
    plant = trimesh.creation.icosphere(subdivisions=4, radius=0.1)
    plant.apply_translation([5.5, 3.5, 1.5])
    plant.visual.vertex_colors = [0, 128, 0, 255]
    surfaces, notes = mesh.read(written([*room(), plant], tmp_path / "room.ply"))
    assert len(surfaces.corners) == sum(len(part.faces) for part in [*room(), plant]) and len(notes) == 1


def test_a_plane_of_ground_is_cut_to_the_building(tmp_path):
    """It carries the house, but does not make the scene a kilometre wide."""
    ground = quad([-500, -500, 0], [500, -500, 0], [500, 500, 0], [-500, 500, 0], BROWN, n=1)
    space = mesh.load(written([*room()[1:], ground], tmp_path / "room.ply"))
    assert np.ptp(space.seen.corners[..., :2], axis=(0, 1)).max() < 40
    assert space.ground.floor == pytest.approx(0, abs=1e-4)
    inside = ((space.starts[:, :2] > 0) & (space.starts[:, :2] < SIZE[:2])).all(1)
    assert inside.all() and space.ground.area < SIZE[0] * SIZE[1]


# ---- colours -------------------------------------------------------------------------------------------------------


def textured(path: Path, image) -> Path:
    """A room whose north wall wears an image."""
    wall = quad([0, 4, 0], [6, 4, 0], [6, 4, 2.6], [0, 4, 2.6], WHITE, n=1)
    uv = wall.vertices[:, [0, 2]] / [6, 2.6]
    material = trimesh.visual.material.SimpleMaterial(image=image)
    if path.suffix in (".glb", ".gltf"):
        material = trimesh.visual.material.PBRMaterial(baseColorTexture=image, baseColorFactor=[255, 255, 255, 255])
    wall.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    parts = [*room()[:1], *room()[2:]]
    for part in parts:  # OBJ writes a texture or corner colours, not both
        part.visual = part.visual.to_texture() if path.suffix == ".obj" else part.visual
    scene = trimesh.Scene({"wall": wall, **{f"part{k}": part for k, part in enumerate(parts)}})
    if path.suffix != ".gltf":
        scene.export(path)
        return path
    files = trimesh.exchange.gltf.export_gltf(scene)
    document = json.loads(files.pop("model.gltf"))
    (picture,) = document["images"]  # trimesh packs it into a buffer
    picture.pop("bufferView")
    picture["uri"] = "wall%20paper.png"
    image.save(path.with_name("wall paper.png"))
    for name, data in {path.name: json.dumps(document).encode(), **files}.items():
        path.with_name(name).write_bytes(data)
    return path


def halves() -> Image.Image:
    """Red above, blue below."""
    pixels = np.zeros((16, 16, 3), np.uint8)
    pixels[:8, :, 0] = pixels[8:, :, 2] = 255
    return Image.fromarray(pixels)


def looked_up_and_down(surfaces: Surfaces) -> list:
    """Texels of the north wall at two heights, by the definition of `uv`."""
    colors = []
    for height in (2.0, 0.6):
        origin, ahead = np.array([[3.1, 2.0, height]]), np.array([[0.0, 1.0, 0.0]])
        _, face = surfaces.cast(origin, ahead)
        a, b, c = surfaces.corners[face[0]]
        mix = np.linalg.solve(np.stack([b - a, c - a], 1)[[0, 2]], (np.array([3.1, 4.0, height]) - a)[[0, 2]])
        u, v = np.array([1 - mix.sum(), *mix]) @ surfaces.uv[face[0]]
        image = surfaces.images[surfaces.image[face[0]]]
        colors.append(image[int((1 - v % 1) * image.shape[0]), int(u % 1 * image.shape[1])] / 255)
    return colors


@pytest.mark.parametrize("suffix", [".glb", ".gltf", ".obj"])
def test_a_texture_hangs_the_right_way_up(tmp_path, suffix):
    surfaces, notes = mesh.read(textured(tmp_path / f"room{suffix}", halves()), up="z", scale=1)
    np.testing.assert_allclose(looked_up_and_down(surfaces), [RED, BLUE], atol=0.02)
    assert len(notes) == 1


@pytest.mark.parametrize(
    ("suffix", "break_it"), [(".obj", "gone"), (".gltf", "gone"), (".obj", "cut"), (".glb", "cut")]
)
def test_a_missing_texture_becomes_a_plain_colour_and_a_note(tmp_path, suffix, break_it):
    path = textured(tmp_path / f"room{suffix}", halves())
    pictures = sorted(tmp_path.glob("*.png"))
    for picture in pictures:
        picture.unlink() if break_it == "gone" else picture.write_bytes(picture.read_bytes()[:60])
    if suffix == ".glb":
        data = path.read_bytes()
        start = data.index(b"IDAT") + 10
        path.write_bytes(data[:start] + bytes(20) + data[start + 20 :])
    surfaces, notes = mesh.read(path, up="z", scale=1)
    assert any("plain colour" in note for note in notes[1:]) and all("\n" not in note for note in notes)
    north = (surfaces.corners[..., 1] == 4).all(1)
    assert north.any() and (surfaces.image[north] == -1).all()


def test_trimesh_keeps_its_warnings_to_itself(tmp_path, capfd):
    path = written(room(), tmp_path / "room.ply")
    path.write_bytes(path.read_bytes().replace(b"element vertex", b"comment TextureFile wood.png\nelement vertex", 1))
    assert any("wood.png is not beside" in note for note in mesh.read(path)[1])
    assert logging.getLogger("trimesh").handlers  # without one Python would print to the screen
    assert capfd.readouterr() == ("", "")


def test_textures_of_unknown_kinds_are_noted(tmp_path):
    def change(document):
        document["images"][0]["mimeType"] = "image/ktx2"
        document["extensionsUsed"] = ["KHR_texture_transform"]

    notes = mesh.read(edited(textured(tmp_path / "room.glb", halves()), change))[1]
    assert any("image/ktx2" in note and "PNG" in note for note in notes)
    assert any("transforms" in note for note in notes)


def test_materials_factors_and_corner_colours(tmp_path):
    """A plain PBR colour, the colours of faces, and grey where there is none."""
    parts = dict(zip("abcdefg", room(), strict=True))
    pbr = trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 128, 0, 255])
    parts["b"].visual = trimesh.visual.TextureVisuals(material=pbr)
    parts["c"] = trimesh.Trimesh(parts["c"].vertices, parts["c"].faces, process=False)
    trimesh.Scene(parts).export(tmp_path / "room.glb")
    space = mesh.load(tmp_path / "room.glb")
    np.testing.assert_allclose(seen(space, np.pi / 2), [1, 0.5, 0], atol=0.01)
    np.testing.assert_allclose(seen(space, -np.pi / 2), [mesh.GREY] * 3, atol=0.01)
    one = trimesh.util.concatenate([trimesh.Trimesh(p.vertices, p.faces, process=False) for p in room()])
    one.visual.face_colors = np.tile(np.uint8([51, 102, 204, 255]), (len(one.faces), 1))
    one.export(tmp_path / "room.ply")
    np.testing.assert_allclose(seen(mesh.load(tmp_path / "room.ply"), 0.0), [0.2, 0.4, 0.8], atol=0.01)


def test_placed_copies_stand_where_the_scene_graph_says(tmp_path):
    scene = trimesh.Scene({f"part{k}": part for k, part in enumerate(room(table=False))})
    turned = trimesh.transformations.rotation_matrix(np.pi / 2, [0, 0, 1], [2, 2, 0])
    scene.add_geometry(box([1, 1, 0], [2, 3, 1], BROWN), geom_name="box", node_name="one")
    scene.graph.update(
        "two", "world", geometry="box", matrix=trimesh.transformations.translation_matrix([3, 0, 0]) @ turned
    )
    scene.export(tmp_path / "room.glb")
    ground = mesh.load(tmp_path / "room.glb", up="z", scale=1).ground
    # the copy fills (1 … 3) × (1 … 2) turned about (2, 2): x 1…3, y 1…2, then 3 m east
    inside = np.array([[1.5, 2.0], [4.5, 1.5], [5.5, 1.5]])
    outside = np.array([[3.0, 2.0], [4.5, 2.5], [5.0, 0.5]])
    assert ground.solid(inside).all() and not ground.solid(outside).any()


# ---- floors and ground ---------------------------------------------------------------------------------------------


def test_storeys_are_floors_not_tables_or_roofs():
    lower, upper = room(), room(2.9)
    roof = [quad([-1, -1, 5.7], [7, -1, 5.7], [7, 5, 5.7], [-1, 5, 5.7], BROWN)]
    roof += [box([-1, y, 5.7], [7, y + 0.1, 6.3], BROWN) for y in (-1, 4.9)]  # with a parapet
    roof += [box([x, -1, 5.7], [x + 0.1, 5, 6.3], BROWN) for x in (-1, 6.9)]
    surfaces = Surfaces.plain(trimesh.util.concatenate([*lower, *upper, *roof]).triangles)
    np.testing.assert_allclose(storeys.floors(surfaces), [0, 2.9], atol=1e-6)
    points, gaps, level = storeys.columns(surfaces, 0.2)
    roofs = points[level & (gaps >= storeys.STANDING) & (points[:, 2] > 5)]
    assert len(roofs) > len(points) / 20  # there is much to stand on up there; what rules it out is the open view
    open_top = Surfaces.plain(trimesh.util.concatenate(room(ceiling=False)).triangles)
    np.testing.assert_allclose(storeys.floors(open_top), [0], atol=1e-6)


def test_the_floor_may_be_chosen(tmp_path):
    wide = quad([6, 0, 0], [9, 0, 0], [9, 4, 0], [6, 4, 0], WHITE)
    path = written([*room(table=False), *room(2.9), *[wide]], tmp_path / "house.glb")
    low, high = mesh.load(path, floor=0.3), mesh.load(path, floor=3.2)
    assert (low.ground.floor, high.ground.floor) == (pytest.approx(0, abs=1e-5), pytest.approx(2.9, abs=1e-5))
    assert low.ground.area > high.ground.area + 0.5  # a table stands upstairs
    assert mesh.load(path).ground.floor == low.ground.floor
    assert any("0.00, 2.90 m" in note for note in low.notes)
    np.testing.assert_allclose(high.starts[:, 2], 2.9 + 1.25, atol=1e-5)


def test_the_height_of_a_storey_in_any_unit():
    for factor in (1.0, 100.0, 1 / 0.55):
        for ceiling in (True, False):
            surfaces = Surfaces.plain(trimesh.util.concatenate(room(ceiling=ceiling)).triangles * factor)
            assert storeys.height(surfaces) == pytest.approx(2.6 * factor, rel=0.02)


def test_the_ground_is_what_a_band_leaves_free():
    """A table on thin air blocks, a beam above heads and a threshold do not; a small hole in the floor closes."""
    floor = [
        quad([0, 0, 0], [6, 0, 0], [6, 2, 0], [0, 2, 0], WHITE),
        quad([0, 2.4, 0], [6, 2.4, 0], [6, 4, 0], [0, 4, 0], WHITE),
        quad([0.3, 2, 0], [6, 2, 0], [6, 2.4, 0], [0.3, 2.4, 0], WHITE),  # 0.3 × 0.4 m is missing
    ]
    things = [box([3, 0, 1.35], [3.2, 4, 2], BROWN), box([4, 0, 0], [4.2, 4, 0.08], BROWN)]
    surfaces = Surfaces.plain(trimesh.util.concatenate([*floor, *room()[1:], *things]).triangles)
    lattice, free = storeys.free_cells(surfaces, 0.0)
    free_at = lambda *points: lattice.at(free, np.array(points, float), False)  # noqa: E731
    assert free_at((2, 2), (3.1, 2), (4.1, 2), (0.15, 2.2), (1.85, 1)).all()
    assert not free_at((1, 1), (-0.1, 2), (6.1, 2), (1.65, 1)).any()
    assert free.sum() * lattice.cell**2 == pytest.approx(24 - 1.2 * 0.8, rel=0.04)  # less a cell along the walls


def test_a_missing_wall_does_not_take_the_floor_along():
    """The east wall is a shop window without a pane; the pavement beyond counts for a short way only."""
    pavement = quad([6, -20, 0], [30, -20, 0], [30, 20, 0], [6, 20, 0], BROWN)
    surfaces = Surfaces.plain(trimesh.util.concatenate([*room()[:4], *room()[5:], pavement]).triangles)
    lattice, free = storeys.free_cells(surfaces, 0.0)
    assert lattice.at(free, np.array([[5.0, 2.0], [5.9, 2.0], [5.9, 0.5]]), False).all()
    assert not lattice.at(free, np.array([[10.0, 2.0], [15.0, 10.0]]), False).any()


def test_ground_beyond_a_gap_too_narrow_for_the_robot_is_not_free():
    for gap, reached in ((0.15, False), (0.3, True)):
        wall = [box([4, 0, 0], [4.1, 2, 2], BROWN), box([4, 2 + gap, 0], [4.1, 4, 2], BROWN)]
        surfaces = Surfaces.plain(trimesh.util.concatenate([*room(), *wall]).triangles)
        lattice, free = storeys.free_cells(surfaces, 0.0)
        assert bool(lattice.at(free, np.array([[5.0, 2.0]]), False)[0]) is reached


def touched(triangle, low, high, cell_low, cell_high) -> float:
    """How deep (in metres, negative for a distance) a triangle reaches into a box: a linear programme."""
    rows = np.concatenate([triangle.T, -triangle.T])
    bounds = np.array([*cell_high, high, *-np.array(cell_low), -low])
    ahead = optimize.linprog(
        [0, 0, 0, -1], np.column_stack([rows, np.ones(6)]), bounds, [[1, 1, 1, 0]], [1], [(0, 1)] * 3 + [(None, None)]
    )
    return -ahead.fun


def test_no_cell_is_missed_and_none_is_marked_in_vain(rng):
    origin, cell, shape = np.array([-0.5, -0.7]), 0.5, (6, 7)
    checked = 0
    for k in range(12):
        triangle = rng.uniform([-1, -1, -1], [3, 3, 2], (3, 3))
        if k % 3 == 0:
            triangle[2, :2] = 0.3 * triangle[0, :2] + 0.7 * triangle[1, :2]  # upright, as walls are
        marked = np.zeros(shape, bool)
        cover.cover(triangle[None], 0.1, 1.3, origin, cell, marked)
        for i, j in np.ndindex(shape):
            low = origin + cell * np.array([i, j])
            depth = touched(triangle, 0.1, 1.3, low, low + cell)
            if abs(depth) > 1e-6:
                assert marked[i, j] == (depth > 0)
                checked += marked[i, j]
    assert checked > 50


# ---- files that cannot be used -------------------------------------------------------------------------------------


def edited(path: Path, change) -> Path:
    """A .glb whose JSON was changed."""
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20 : 20 + length])
    change(document)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    path.write_bytes(struct.pack("<4s4I", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest)
    return path


class Bomb:
    """Would make a file if a reader unpickled it."""

    def __reduce__(self):
        return Path.touch, (Path("unpickled"),)


def complaint(path, **options) -> str:
    with pytest.raises(SceneError) as caught:
        mesh.load(path, **options)
    text = str(caught.value)
    assert text.startswith(str(path)) and "\n" not in text and "Traceback" not in text
    return text


@pytest.mark.parametrize("suffix", mesh.SUFFIXES)
def test_what_is_no_mesh_is_refused_in_a_line(tmp_path, monkeypatch, capfd, suffix):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / f"thing{suffix}"
    assert "cannot be read" in complaint(path)
    for content in (b"", b"hello", bytes(200), pickle.dumps(Bomb()), b"\xff\xd8" * 90, b"[" * 4000):
        path.write_bytes(content)
        complaint(path)
    path.unlink()
    path.mkdir()
    assert "cannot be read" in complaint(path)
    assert not (tmp_path / "unpickled").exists()
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("suffix", [".glb", ".ply", ".stl"])
def test_a_file_cut_short_is_refused(tmp_path, suffix):
    path = written(room(), tmp_path / f"room{suffix}")
    data = path.read_bytes()
    for share in (0.05, 0.5, 0.99):
        path.write_bytes(data[: int(share * len(data))])
        assert "not a complete" in complaint(path) or suffix == ".stl"  # half an .stl may hold no triangle


@pytest.mark.parametrize(
    "extension", ["EXT_meshopt_compression", "KHR_draco_mesh_compression", "KHR_mesh_quantization"]
)
def test_compression_is_named_with_a_remedy(tmp_path, extension):
    path = edited(written(room(), tmp_path / "room.glb"), lambda d: d.update(extensionsRequired=[extension]))
    text = complaint(path)
    assert extension in text and "without compression" in text


def test_counts_that_no_file_holds_are_refused(tmp_path):
    def grow(document):
        for accessor in document["accessors"]:
            accessor.pop("bufferView", None)
            accessor["count"] = 10**12

    assert "room.glb: " in complaint(edited(written(room(), tmp_path / "room.glb"), grow))
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000000\nproperty float x\nproperty float y\n"
    (tmp_path / "room.ply").write_text(
        header + "property float z\nelement face 0\nproperty list uchar int i\nend_header\n"
    )
    assert "room.ply: " in complaint(tmp_path / "room.ply")


def test_points_without_triangles_are_no_building(tmp_path):
    trimesh.PointCloud(np.random.default_rng(0).random((50, 3))).export(tmp_path / "cloud.ply")
    assert "no triangles" in complaint(tmp_path / "cloud.ply")
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    assert "area" in complaint(tmp_path / "flat.obj")
    (tmp_path / "odd.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 1 0\nf 1 2 900\n")
    complaint(tmp_path / "odd.obj")


@pytest.mark.parametrize(
    "uri", ["../secret.bin", "{}/secret.bin", "http://127.0.0.1:9/secret.bin", "file:///etc/passwd"]
)
def test_nothing_outside_the_folder_is_read(tmp_path, uri):
    """The geometry lies beside the folder: no name reaches it, relative or absolute, and no network is asked."""
    inner = tmp_path / "inner"
    inner.mkdir()
    path = written(room(), inner / "room.gltf")
    document = json.loads(path.read_text())
    for k, entry in enumerate(document["buffers"]):
        (inner / entry["uri"]).rename(tmp_path / f"{k}secret.bin")
        entry["uri"] = uri.format(tmp_path).replace("secret", f"{k}secret")
    path.write_text(json.dumps(document))
    assert "not beside it" in complaint(path)


def test_options_and_names(tmp_path):
    path = written(room(), tmp_path / "room.glb")
    assert "up must be one of x, y, z, -x, -y, -z, got up" in complaint(path, up="up")
    for scale in (0, -1.0, math.nan, math.inf):
        assert "scale must be a positive number" in complaint(path, scale=scale)
    assert "floor's height must be a finite number" in complaint(path, floor=math.nan)
    assert "not a mesh" in complaint(tmp_path / "room.dae")
    assert "--scale" in complaint(path, scale=0.01)
    walls = written(room(table=False)[1:5], tmp_path / "walls.glb")
    assert "no floor found between z = 0.00 and 2.60 m" in complaint(walls, up="z")
    assert "too large" in complaint(path, scale=5000.0)


# ---- real buildings ------------------------------------------------------------------------------------------------


def near(cells: np.ndarray, distance: float) -> np.ndarray:
    return ndimage.distance_transform_edt(~cells) <= distance


@HERE
def test_a_real_house_agrees_with_the_map_a_robot_made_of_it():
    """Of the mapped walls 97 % lie within 10 cm of the mesh, and what a laser would meet of the mesh is on the map."""
    space = mesh.load(SCENES / "meshes" / "aws_small_house_lite.glb")
    assert "y is up, in metres" in space.notes[0]
    state, cell, origin = rosmap.read(SCENES / "maps" / "aws_small_house" / "map.yaml")
    lattice = grid.Lattice(tuple(origin[:2]), cell, state.shape)
    free, mapped = state == grid.FREE, state == grid.OCCUPIED
    body, laser = np.zeros(state.shape, bool), np.zeros(state.shape, bool)
    cover.cover(space.seen.corners, 0.1, 1.3, origin[:2], cell, body)
    cover.cover(space.seen.corners, 0.15, 0.25, origin[:2], cell, laser)
    visible = laser & near(free, 1)
    ours = ~space.ground.solid(lattice.centers().reshape(-1, 2)).reshape(state.shape)

    def agreement(mapped, free):
        """Walls of the map near the mesh, of the mesh near the map; shared ground over all that either calls free."""
        walls = near(body, 0.1 / cell)[mapped].mean(), near(mapped, 0.1 / cell)[visible].mean()
        return *walls, (ours & free).sum() / (ours | free).sum()

    np.testing.assert_array_less([0.95, 0.95, 0.92], agreement(mapped, free))
    np.testing.assert_array_less(agreement(mapped[:, ::-1], free[:, ::-1]), [0.8, 0.8, 0.8])  # a mirrored map


@HERE
@pytest.mark.parametrize(
    ("name", "size", "tolerance"),
    [("aws_small_house_lite", [19, 11.4, 3], 0.05), ("aws_bookstore", [15.7, 14.6, 3.7], 0.05),
     ("luke_apartment_baked", [16.01 * 0.55, 9.911 * 0.55, 4.985 * 0.55], 0.2)],
)  # fmt: skip
def test_real_meshes_load_upright_and_in_metres(name, size, tolerance):
    space = mesh.load(SCENES / "meshes" / f"{name}.glb")
    np.testing.assert_allclose(space.seen.upper - space.seen.lower, size, atol=tolerance)
    assert space.ground.floor == pytest.approx(0, abs=0.02)
    space.check_team(5)
