"""Habitat PointNav files: poses in this project's axes, the right mesh and storey, and complaints in a line."""

import gzip
import json
import math

import numpy as np
import pytest
import test_mesh
import torch
from scipy.spatial.transform import Rotation

from mannbv import geometry
from mannbv.camera import Camera
from mannbv.world import SceneError
from mannbv.world.formats import pointnav

TO_HABITAT = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # world z up → Habitat y up
COLORS = {"north": test_mesh.RED, "south": test_mesh.GREEN, "west": test_mesh.BLUE, "east": test_mesh.YELLOW}
TURNS = {"north": 0.0, "west": math.pi / 2, "south": math.pi, "east": -math.pi / 2}  # about Habitat's y axis


def episode(start, goal, turn=0.0, scene="gibson/Room.glb", **changes) -> dict:
    """As Habitat writes it; start and goal (x, y, z) of the world."""
    return {
        "episode_id": "0",
        "scene_id": scene,
        "start_position": (TO_HABITAT @ start).tolist(),
        "start_rotation": Rotation.from_rotvec([0, turn, 0]).as_quat().tolist(),
        "goals": [{"position": (TO_HABITAT @ goal).tolist(), "radius": None}],
        "info": {"geodesic_distance": math.dist(start, goal)},
        **changes,
    }


def packed(path, document):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(gzip.compress(json.dumps(document).encode()))
    return path


@pytest.fixture
def scenes(tmp_path):
    folder = tmp_path / "scene_datasets"
    (folder / "gibson").mkdir(parents=True)
    test_mesh.written(test_mesh.room(), folder / "gibson" / "Room.glb")
    return folder


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("side", COLORS)
def test_a_turned_camera_sees_the_wall_that_habitat_would_show(tmp_path, scenes, up, side):
    """The heading by matrices: the camera's −z axis, turned in Habitat's frame, then into the world's."""
    test_mesh.written(test_mesh.room(), scenes / "gibson" / "Room.glb", up)
    start, goal, eye = np.array([[3.0, 2.0, 0.0], [5.0, 3.0, 0.0], [0.0, 0.0, 1.25]])
    path = packed(tmp_path / "val.json.gz", {"episodes": [episode(start, goal, TURNS[side])]})
    space = pointnav.load(path, scenes)
    np.testing.assert_allclose(space.starts[0, :3], start + eye, atol=1e-6)
    np.testing.assert_allclose(space.goals, [goal + eye], atol=1e-6)
    matrix = Rotation.from_rotvec([0, TURNS[side], 0]).as_matrix()
    ahead = TO_HABITAT.T @ matrix @ [0, 0, -1]
    yaw = space.starts[0, 3]
    np.testing.assert_allclose([math.cos(yaw), math.sin(yaw), 0], ahead, atol=1e-9)
    pose = geometry.yaw_pose(torch.tensor(space.starts[0, :3]), yaw)
    color = space.sense(Camera.from_fov(9, 9), pose).color[4, 4]
    np.testing.assert_allclose(color, COLORS[side], atol=0.01)
    space.check_team(1)


def test_a_tilted_head_keeps_its_heading(rng):
    for _ in range(20):
        turn, tilt = rng.uniform(-3, 3), rng.uniform(-1, 1)
        rotation = Rotation.from_rotvec([0, turn, 0]) * Rotation.from_rotvec([tilt, 0, 0])
        assert pointnav._yaw(rotation.as_quat()) == pytest.approx(
            (turn + math.pi / 2 + math.pi) % (2 * math.pi) - math.pi
        )


def test_the_team_is_made_of_the_episodes_that_fit(tmp_path, scenes):
    listed = [
        episode([3.0, 2.0, 0.0], [5.0, 3.0, 0.0]),
        episode([1.0, 1.0, 0.0], [5.0, 1.0, 0.0]),  # under the table
        episode([3.1, 2.1, 0.0], [1.0, 3.0, 0.0]),  # on the first one's toes
        episode([3.0, 2.0, 0.0], [9.0, 2.0, 0.0]),  # a goal outside
        episode([3.0, 2.0, 2.9], [5.0, 2.0, 2.9]),  # upstairs
        episode([1.0, 2.5, 0.0], [4.0, 1.0, 0.0], scene="gibson/Other.glb"),
        episode([1.0, 3.0, 0.05], [4.0, 1.0, 0.0]),
        episode([5.0, 1.0, 0.0], [1.0, 2.5, 0.0]),
    ]
    space = pointnav.load(packed(tmp_path / "val.json.gz", {"episodes": listed}), scenes)
    np.testing.assert_allclose(space.starts[:, :2], [[3, 2], [1, 3], [5, 1]], atol=1e-6)
    np.testing.assert_allclose(space.starts[:, 2], [1.25, 1.30, 1.25], atol=1e-6)
    assert any("3 episodes skipped" in note for note in space.notes)
    assert any("1 episodes skipped: too near" in note for note in space.notes)
    space.check_team(3)
    two = pointnav.load(tmp_path / "val.json.gz", scenes, n_robots=2)
    assert len(two.starts) == 2


def test_the_storey_is_that_of_the_first_start(tmp_path, scenes):
    test_mesh.written([*test_mesh.room(), *test_mesh.room(2.9)], scenes / "gibson" / "Room.glb")
    up, down = episode([3.0, 2.0, 2.95], [5.0, 3.0, 2.9]), episode([3.0, 2.0, 0.0], [5.0, 3.0, 0.0])
    path = packed(tmp_path / "val.json.gz", {"episodes": [up, down]})
    space = pointnav.load(path, scenes)
    assert space.ground.floor == pytest.approx(2.9, abs=0.01) and len(space.starts) == 1
    assert space.starts[0, 2] == pytest.approx(2.95 + 1.25)
    assert pointnav.load(path, scenes, floor=0.2).ground.floor == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize(
    "name", ["gibson/Room.glb", "Room.glb", "data/scene_datasets/gibson/Room.glb", "gibson\\Room.glb"]
)
def test_a_scene_is_found_under_its_name_or_the_end_of_it(tmp_path, scenes, name):
    path = packed(tmp_path / "content" / "Room.json.gz", {"episodes": [episode([3, 2, 0], [5, 3, 0], scene=name)]})
    folder = scenes / "gibson" if name == "Room.glb" else scenes
    assert pointnav.load(path, folder).name == "Room"


def test_no_name_leaves_the_folder_of_scenes(tmp_path, scenes):
    test_mesh.written(test_mesh.room(), tmp_path / "Secret.glb")
    for name in ("../Secret.glb", str(tmp_path / "Secret.glb"), "gibson/../../Secret.glb"):
        path = packed(tmp_path / "val.json.gz", {"episodes": [episode([3, 2, 0], [5, 3, 0], scene=name)]})
        assert "Secret.glb is not in" in complaint(path, scenes)


def test_another_scene_of_the_file(tmp_path, scenes):
    test_mesh.written(test_mesh.room(), scenes / "gibson" / "Other.glb")
    listed = [episode([3, 2, 0], [5, 3, 0]), episode([1, 3, 0], [5, 3, 0], scene="gibson/Other.glb")]
    path = packed(tmp_path / "val.json.gz", {"episodes": listed})
    assert pointnav.load(path, scenes).name == "Room"
    other = pointnav.load(path, scenes, building="Other")
    assert other.name == "Other" and other.starts[0, 0] == 1
    with pytest.raises(SceneError, match="no episode in Third"):
        pointnav.load(path, scenes, building="Third")


# ---- files that cannot be used -------------------------------------------------------------------------------------


def complaint(path, scenes_dir) -> str:
    with pytest.raises(SceneError) as caught:
        pointnav.load(path, scenes_dir)
    text = str(caught.value)
    assert "\n" not in text and (text.startswith(str(path)) or text.startswith(str(scenes_dir)))
    return text


def test_folders_and_files_that_are_not_there(tmp_path, scenes):
    path = packed(tmp_path / "val.json.gz", {"episodes": [episode([3, 2, 0], [5, 3, 0], scene="gibson/Cantwell.glb")]})
    assert "--scenes-dir" in complaint(path, None) and "README" in complaint(path, None)
    text = complaint(path, scenes)
    assert "gibson/Cantwell.glb" in text and "licence" in text
    assert "is no folder" in complaint(path, scenes / "nothing")
    assert "cannot be read" in complaint(tmp_path / "none.json.gz", scenes)
    assert "cannot be read" in complaint(scenes, scenes)


def test_broken_files(tmp_path, scenes, monkeypatch):
    path = packed(tmp_path / "val.json.gz", {"episodes": [episode([3, 2, 0], [5, 3, 0])]})
    whole = path.read_bytes()
    path.write_bytes(whole[:-20])
    assert "download" in complaint(path, scenes)
    path.write_bytes(gzip.decompress(whole))
    assert "not packed by gzip" in complaint(path, scenes)
    for text in (b"[1, 2", b"\xff\xfe{", b"[" * 100_000):
        path.write_bytes(gzip.compress(text))
        assert "not valid JSON" in complaint(path, scenes)
    monkeypatch.setattr(pointnav, "MOST_BYTES", 2**20)
    path.write_bytes(gzip.compress(bytes(2**21)))
    assert "unpacks to more than 1 MB" in complaint(path, scenes)


def test_a_split_points_to_its_content(tmp_path, scenes):
    inner = packed(tmp_path / "train" / "content" / "Room.json.gz", {"episodes": [episode([3, 2, 0], [5, 3, 0])]})
    path = packed(tmp_path / "train" / "train.json.gz", {"episodes": []})
    assert str(inner) in complaint(path, scenes)
    assert "empty" in complaint(packed(tmp_path / "val.json.gz", {"episodes": []}), scenes)


@pytest.mark.parametrize(
    ("changes", "place"),
    [
        ({"start_position": [0, 0]}, "episodes[1].start_position must be 3 finite numbers, got [0, 0]"),
        ({"start_position": [0, 0, math.nan]}, "start_position"),
        ({"start_position": [0, 0, "1"]}, "start_position"),
        ({"start_rotation": [0, 0, 0]}, "start_rotation must be 4 finite numbers"),
        ({"start_rotation": [0, 0, 0, 0]}, "start_rotation must be a unit quaternion"),
        ({"goals": []}, "goals must be a list of at least one goal"),
        ({"goals": [{"position": None}]}, "episodes[1].goals[0].position must be 3 finite numbers, got null"),
        ({"scene_id": None}, "scene_id must be a line of printable text"),
        ({"scene_id": "a\nb"}, "scene_id"),
    ],
)
def test_every_entry_is_checked(tmp_path, scenes, changes, place):
    good = episode([3, 2, 0], [5, 3, 0])
    path = packed(tmp_path / "val.json.gz", {"episodes": [good, {**good, **changes}]})
    assert place in complaint(path, scenes)


@pytest.mark.parametrize("document", [[], {}, {"episodes": {}}, {"episodes": [7]}, None])
def test_what_is_no_data_set(tmp_path, scenes, document):
    assert "PointNav data set" in complaint(packed(tmp_path / "val.json.gz", document), scenes)


def test_starts_in_the_air_are_no_episodes(tmp_path, scenes):
    path = packed(tmp_path / "val.json.gz", {"episodes": [episode([30, 20, 0], [5, 3, 0])]})
    assert "no episode starts on a floor" in complaint(path, scenes)
    path = packed(tmp_path / "val.json.gz", {"episodes": [episode([3, 2, 0], [50, 3, 0])]})
    assert "goal within reach" in complaint(path, scenes)
