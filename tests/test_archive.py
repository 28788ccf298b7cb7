"""Files: a write that fails leaves the old file and no other; a reader believes nothing; numpy and json are oracles."""

import contextlib
import dataclasses
import importlib.util
import io
import json
import math
import pickle
import resource
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from mannbv import archive, episode, mapping, splats, world
from mannbv.camera import Frame
from mannbv.config import Config
from mannbv.course import grade
from mannbv.course.widgets.recording import Recording
from mannbv.lab import draw, report, study
from mannbv.messages import Ledger
from mannbv.metrics import Row
from mannbv.splats import SplatMap

HERE = Path(__file__).parent
OLD = HERE / "old_record.npz"  # of two robots, centralized, after a cycle; written before there was `archive`

_spec = importlib.util.spec_from_file_location("notebooks", HERE.parent / "tools" / "notebooks.py")
notebooks = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(notebooks)


@contextlib.contextmanager
def full_disk(room: int):
    """No file can grow beyond `room` bytes, as on a disk that is full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def old_map() -> SplatMap:
    """The splats of a robot of the old record."""
    with np.load(OLD) as file:
        return SplatMap(*(torch.from_numpy(file[f"0/own_{f.name}"]) for f in dataclasses.fields(SplatMap)))


def small_recording() -> Recording:
    ground, views = np.zeros((1, 1, 2, 2), np.int8), np.zeros((1, 1, 3, 8, 8, 3), np.uint8)
    return Recording(ground, views, np.zeros((1, 1, 2), np.float32))


def some_results() -> study.Results:
    rows = tuple(Row("single", seed, 0) for seed in range(100))
    return study.Results("0", "flat", 2, 1, tuple(range(100)), {}, rows, {})


# ---- writing --------------------------------------------------------------------------------------------------------

TABLE = report.Table("A table", (("", "strategy"), ("gain", "[m]")), (("single", "1.0"),), name="table")
WRITERS = {
    "run.npz": lambda path: episode.load(OLD).save(path),
    "local.npz": lambda path: mapping.save(episode.load(OLD).robots[0].local, path),
    "map.npz": lambda path: splats.save(old_map(), path),
    "map.ply": lambda path: splats.save(splats.lifted(old_map(), [0.0, 1.0], 0.1), path),
    "recording.npz": lambda path: small_recording().save(path),
    "results.json": lambda path: study.save(some_results(), path),
    "table.txt": lambda path: report.write([TABLE], path.parent),
    "grades.csv": lambda path: grade.write_table(path, {"a": [dict.fromkeys(grade.COLUMNS, "x")]}),
    "figure.png": lambda path: draw.save(Figure((1, 1)), path),
    "notebook.ipynb": lambda path: notebooks.write(path, b"x" * 1000),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_leaves_the_old_file_and_no_other(name, tmp_path):
    path = tmp_path / name
    WRITERS[name](tmp_path / "elsewhere" / name if name != "notebook.ipynb" else path)  # all is imported and compiled
    path.write_text("precious")
    before = {file: file.read_bytes() for file in tmp_path.glob("*.*")}
    with pytest.raises(OSError), full_disk(30):
        WRITERS[name](path)
    assert {file: file.read_bytes() for file in tmp_path.glob("*.*")} == before
    WRITERS[name](path)
    assert path.read_bytes() != b"precious"


def interrupted(path: Path, error) -> None:
    with archive.whole(path) as file:
        file.write(b"half")
        raise error


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit, ValueError("no such number"), MemoryError])
def test_whatever_interrupts_leaves_what_was(error, tmp_path):
    for path, old in ((tmp_path / "new", None), (tmp_path / "old", b"precious")):
        if old:
            path.write_bytes(old)
        before = set(tmp_path.iterdir())
        with pytest.raises(error if isinstance(error, type) else ValueError):
            interrupted(path, error)
        assert set(tmp_path.iterdir()) == before
        assert old is None or path.read_bytes() == old


def test_nothing_is_there_before_all_is(tmp_path):
    path = tmp_path / "folder" / "in a folder" / "file"
    with archive.whole(path) as file:
        file.write(b"all")
        assert not path.exists()
    assert path.read_bytes() == b"all" and list(path.parent.iterdir()) == [path]


def test_what_a_killed_process_left_is_swept_up_and_nothing_else(tmp_path):
    with archive.whole(tmp_path / "run.npz"):
        (left,) = tmp_path.iterdir()  # a kill would stop here
        for name in (left.name.replace("run", "other"), "run.tmp", ".hidden", "run.npz"):
            (tmp_path / name).touch()
        archive.tidy(tmp_path)
        assert {path.name for path in tmp_path.iterdir()} == {"run.tmp", ".hidden", "run.npz"}
        left.touch()


def test_a_folder_is_no_place_for_a_file(tmp_path):
    (tmp_path / "taken").mkdir()
    with pytest.raises(OSError):
        archive.write_text(tmp_path / "taken", "text")
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_lines_end_as_they_did(tmp_path):
    archive.write_text(tmp_path / "lines", "ä\nb\r\nc")
    assert (tmp_path / "lines").read_bytes() == "ä\nb\r\nc".encode()


def test_what_only_a_pickle_holds_is_not_written(tmp_path):
    with pytest.raises(TypeError, match=r"a\.npz: b is neither numbers nor text"):
        archive.write(tmp_path / "a.npz", {"a": np.ones(2), "b": np.array([{}], object)})
    assert not list(tmp_path.iterdir())


# ---- reading --------------------------------------------------------------------------------------------------------

ARRAYS = {
    "whole": np.arange(6, dtype=np.int16).reshape(2, 3),
    "columns": np.asfortranarray(np.random.default_rng(0).normal(size=(3, 4))),
    "turned": np.arange(24.0).reshape(2, 3, 4).transpose(2, 0, 1),
    "one": np.array(3.5, np.float32),
    "none": np.zeros((0, 4), np.float32),
    "far": np.array([1.5, -2.0], ">f4"),
    "truth": np.array([True, False]),
    "words": np.array(["flat", "open plan"]),
    "nothing": np.array([], np.uint8),
}


@pytest.mark.parametrize("compressed", [False, True])
def test_arrays_come_back_to_the_last_bit(compressed, tmp_path):
    path = tmp_path / "a.npz"
    archive.write(path, ARRAYS, compressed)
    ours = archive.read(path)
    with np.load(path) as theirs:  # the oracle
        assert set(ours) == set(theirs.files) == set(ARRAYS)
        for name in ours:
            assert ours[name].dtype == theirs[name].dtype.newbyteorder("=") and ours[name].flags.writeable
            assert ours[name].tobytes() == theirs[name].astype(ours[name].dtype).tobytes()
            assert ours[name].shape == theirs[name].shape
            assert ours[name].flags.c_contiguous == theirs[name].flags.c_contiguous
    with pytest.raises(archive.ArchiveError, match="holds no rivers"):
        ours["rivers"]


class Trap:
    """Unpickling one writes a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.write_text, (self.path, "executed")


def packed(header: bytes, body: bytes = b"", kind=zipfile.ZIP_STORED, times: int = 1) -> bytes:
    """An archive of one array with that header, listed so many times."""
    start = b"\x93NUMPY\x01\x00" + (len(header) + 1).to_bytes(2, "little") + header + b"\n"
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", kind) as file:
        file.writestr("a.npy", start + body)
        file.filelist *= times
    return out.getvalue()


def header(shape, descr="'<f4'") -> bytes:
    return f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".encode()


def saved(**arrays) -> bytes:
    out = io.BytesIO()
    np.savez_compressed(out, **arrays)
    return out.getvalue()


def changed(data: bytes, at: int, new: bytes) -> bytes:
    return data[:at] + new + data[at + len(new) :]


GOOD = saved(a=np.random.default_rng(0).normal(size=500))
DIRECTORY = GOOD.index(b"PK\x01\x02")
BAD = {
    "empty": b"",
    "text": b"not an archive",
    "cut": GOOD[:-30],
    "damaged": changed(GOOD, 300, bytes(40)),
    "a bare array": GOOD[GOOD.index(b"a.npy") :],
    "a pickle": pickle.dumps({"a": 1}),
    "stacked brackets": packed(b"{" * 190 + b"-" * 9000),
    "locked": changed(GOOD, DIRECTORY + 8, b"\x01"),
    "packed by another": changed(GOOD, DIRECTORY + 10, b"\x63"),
    "lies about its size": changed(GOOD, DIRECTORY + 24, (2**29).to_bytes(4, "little")),
    "promises too much": packed(header("(900000000000, 3)")),
    "promises too little": packed(header("(2,)"), bytes(12)),
    "less than nothing": packed(header("(-2, -3)"), bytes(24)),
    "endless shape": packed(header(f"({'9' * 6000},)")),
    "brackets": packed(b"(" * 9000),
    "code": packed(header("(__import__('os').getpid(),)"), bytes(4)),
    "no size at all": packed(header("(7,)", "'<U0'")),
    "records of several types": packed(header("(2,)", "[('x', '<f4'), ('y', '<i4')]"), bytes(16)),
    "times": packed(header("(1,)", "'<M8[s]'"), bytes(8)),
}


@pytest.mark.parametrize("fault", [*BAD, "missing", "a folder", "pickled arrays", "not only arrays"])
def test_what_is_no_archive_is_refused_in_one_line_and_nothing_runs(fault, tmp_path):
    path, trap = tmp_path / "a.npz", tmp_path / "trap"
    if fault == "a folder":
        path.mkdir()
    elif fault == "pickled arrays":
        np.savez(path, a=np.array([Trap(trap)], object))
    elif fault == "not only arrays":
        path.write_bytes(GOOD)
        with zipfile.ZipFile(path, "a") as file:
            file.writestr("__init__.py", "raise SystemExit")
    elif fault != "missing":
        path.write_bytes(BAD[fault])
    with pytest.raises(archive.ArchiveError) as caught:
        archive.read(path)
    assert "\n" not in str(caught.value) and "pickle" not in str(caught.value)
    assert not trap.exists()


def test_a_small_file_that_unpacks_to_gigabytes_is_refused_without_memory_for_it(tmp_path):
    path = tmp_path / "bomb.npz"
    path.write_bytes(packed(header(f"({2**20},)"), bytes(2**22), zipfile.ZIP_DEFLATED, times=1000))
    assert path.stat().st_size < 100_000
    tracemalloc.start()
    with pytest.raises(archive.ArchiveError, match=r"would unpack to 4,194,\d{3},\d{3} B"):
        archive.read(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2**22


@given(st.binary(max_size=300))
def test_random_bytes_are_no_archive(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("junk") / "a.npz"
    path.write_bytes(data)
    with pytest.raises(archive.ArchiveError):
        archive.read(path)


@given(st.lists(st.tuples(st.integers(0, len(GOOD) - 1), st.integers(0, 255)), min_size=1, max_size=4))
def test_damage_is_noticed_or_harmless(tmp_path_factory, changes):
    data = bytearray(GOOD)
    for at, value in changes:
        data[at] = value
    path = tmp_path_factory.mktemp("damage") / "a.npz"
    path.write_bytes(data)
    with contextlib.suppress(archive.ArchiveError):
        for values in archive.read(path).values():
            assert values.tobytes() == np.random.default_rng(0).normal(size=500).tobytes()


READERS = {
    "run": (episode.load, episode.RecordError),
    "local map": (mapping.load, splats.FormatError),
    "map": (splats.load, splats.FormatError),
    "recording": (Recording.load, ValueError),
}


@pytest.mark.parametrize("fault", BAD)
@pytest.mark.parametrize("reader", READERS)
def test_every_reader_names_the_file_and_its_fault_in_one_line(reader, fault, tmp_path):
    (path := tmp_path / "bad.npz").write_bytes(BAD[fault])
    read, error = READERS[reader]
    with pytest.raises(error, match=r"bad\.npz: ") as caught:
        read(path)
    assert "\n" not in str(caught.value)


def test_a_record_damaged_anywhere_is_refused_or_read_as_it_was(tmp_path):
    whole, path = OLD.read_bytes(), tmp_path / "run.npz"
    for at in range(0, len(whole), 997):
        path.write_bytes(changed(whole, at, bytes([whole[at] ^ 0x5A])))
        with contextlib.suppress(episode.RecordError):
            assert episode.load(path).rows == episode.load(OLD).rows


@pytest.mark.parametrize("about", [[], 3, {}, {"n_robots": "two"}, {"n_robots": 10**9}, {"n_robots": 0, "config": 3}])
def test_an_archive_of_something_else_is_no_record(about, tmp_path):
    path = tmp_path / "run.npz"
    for text in (json.dumps(about), "[" * 100_000):
        archive.write(path, {"about": np.frombuffer(text.encode(), np.uint8)})
        with pytest.raises(episode.RecordError, match=r"run\.npz: not a whole record \(.+\); delete it"):
            episode.load(path)


# ---- files of earlier versions --------------------------------------------------------------------------------------


def test_a_record_of_an_earlier_version_is_read_bit_for_bit():
    record = episode.load(OLD)
    with np.load(OLD) as file:
        about, arrays = json.loads(bytes(file["about"])), {name: file[name] for name in file.files}
    assert (record.scene, record.strategy, record.seed, record.n_robots) == ("flat", "centralized", 0, 2)
    ours = [row.to_json() for row in record.rows]
    assert [{name: row[name] for name in old} for row, old in zip(ours, about["rows"], strict=True)] == about["rows"]
    assert record.ledger.to_json() == about["ledger"]
    assert {k: getattr(record.config, k) for k in about["config"]} == about["config"]
    for k, robot in enumerate(record.robots):
        keyframes, frames, moments = robot.local.keyframes, robot.frames, robot.local.moments
        pairs = {"position": robot.position, "goal": robot.goal, "trail": robot.trail, "ground": robot.ground.log_odds}
        pairs |= {f"heard_{1 - k}": robot.grids[1 - k].log_odds, "own_prior": robot.local.prior}
        pairs |= {"own_ids": robot.local.ids, "guest_ids": robot.guests.ids, "guest_senders": robot.guests.senders}
        pairs |= {"own_moments_first": moments.first, "own_moments_second": moments.second}
        pairs |= {"own_keyframe_color": [f.color for f in keyframes], "frame_depth": [f.depth for f in frames]}
        pairs |= {"frame_rotation": [f.pose.rotation for f in frames]}
        pairs |= {"own_keyframe_position": [f.pose.position for f in keyframes]}
        for field in dataclasses.fields(SplatMap):
            pairs[f"own_{field.name}"] = getattr(robot.local.splats, field.name)
            pairs[f"guest_{field.name}"] = getattr(robot.guests.splats, field.name)
        for name, values in pairs.items():
            assert len(values) and np.array_equal(np.stack(list(values)), arrays[f"{k}/{name}"]), name


def test_an_earlier_record_saved_again_holds_the_same_arrays(tmp_path):
    episode.load(OLD).save(tmp_path / "again.npz")
    ours = archive.read(tmp_path / "again.npz")
    with np.load(OLD) as file:
        assert set(file.files) - set(ours) <= {f"{k}/{name}" for k in (0, 1) for name in ("frame_count", "guest_prior")}
        assert set(ours) - set(file.files) == {f"{k}/{name}" for k in (0, 1) for name in ("guest_sent", "guest_seen")}
        for k in (0, 1):  # what the holder had seen of its guests was not looked up then
            assert (
                np.array_equal(ours[f"{k}/guest_sent"], file[f"{k}/guest_prior"]) and not ours[f"{k}/guest_seen"].any()
            )
        for name in set(ours) & set(file.files) - {"about", "0/small", "1/small"}:
            assert np.array_equal(ours[name], file[name]) and ours[name].dtype == file[name].dtype, name


def test_a_record_is_json_that_others_can_read(tmp_path):
    record = episode.load(OLD)
    strange = dataclasses.replace(record, rows=(dataclasses.replace(record.rows[0], psnr_db=math.inf, spl=math.nan),))
    strange.save(tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as file:
        text = bytes(file["about"]).decode()
    json.loads(text, parse_constant=pytest.fail)
    (row,) = episode.load(tmp_path / "run.npz").rows
    assert row == dataclasses.replace(record.rows[0], psnr_db=None, spl=None)


def test_a_record_in_which_an_earlier_version_wrote_nan_is_read(tmp_path):
    with np.load(OLD) as file:
        arrays = {name: file[name] for name in file.files}
    about = json.loads(bytes(arrays["about"]))
    about["rows"][0]["psnr_db"] = math.inf
    arrays["about"] = np.frombuffer(json.dumps(about).encode(), np.uint8)
    np.savez_compressed(tmp_path / "run.npz", **arrays)
    assert episode.load(tmp_path / "run.npz").rows[0].psnr_db is None


# ---- records as arrays ----------------------------------------------------------------------------------------------


def test_records_become_arrays_and_records_again():
    robot = episode.load(OLD).robots[0]
    arrays = archive.pack(robot.guests, "guest_") | archive.stack(robot.frames, "frame_")
    assert archive.stack([], "none_") == {} and archive.unstack(Frame, arrays, "none_") == ()
    again, frames = archive.unpack(type(robot.guests), arrays, "guest_"), archive.unstack(Frame, arrays, "frame_")
    assert len(frames) == len(robot.frames) == 2
    again = archive.pack(again, "guest_") | archive.stack(frames, "frame_")
    assert again.keys() == arrays.keys() and all(np.array_equal(again[name], arrays[name]) for name in arrays)
    with pytest.raises(ValueError, match="frame_… have 1 and 2 rows"):
        archive.unstack(Frame, arrays | {"frame_depth": arrays["frame_depth"][1:]}, "frame_")
    del arrays["guest_ids"]
    with pytest.raises(archive.ArchiveError, match="holds no guest_ids"):
        archive.unpack(type(robot.guests), archive.Arrays(arrays), "guest_")


# ---- JSON -----------------------------------------------------------------------------------------------------------

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
)


@given(JSON)
def test_numbers_that_do_not_exist_are_null_and_all_else_comes_back(value):
    def known(value):
        if isinstance(value, list):
            return [known(part) for part in value]
        if isinstance(value, dict):
            return {key: known(part) for key, part in value.items()}
        return None if isinstance(value, float) and (value != value or abs(value) == math.inf) else value

    text = archive.to_json(value)
    assert archive.from_json(text) == json.loads(text, parse_constant=pytest.fail) == known(value)
    assert archive.plain(value) == known(value)


@pytest.mark.parametrize("text", ["NaN", "[-Infinity]", "1e999", '{"a": -2e400}', "[" * 100_000, "{", ""])
def test_what_is_no_json_is_refused_everywhere(text, tmp_path):
    with pytest.raises(ValueError):
        archive.from_json(text)
    with pytest.raises(ValueError, match="config: "):
        Config.from_json(text)
    with pytest.raises(ValueError, match="ledger: "):
        Ledger.from_json(text)
    (path := tmp_path / "plan.json").write_text(text)
    with pytest.raises(world.SceneError, match=r"plan\.json: not valid JSON"):
        world.load(path)
    with pytest.raises(study.StudyError, match=r"plan\.json: not valid JSON"):
        study.load(path)
