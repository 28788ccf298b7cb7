import math
import struct
import tracemalloc
import warnings
from pathlib import Path

import numpy as np
import pytest
import torch
from helpers import random_map, shifted
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from mannbv import geometry, render, splats
from mannbv.camera import Camera
from mannbv.splats import FormatError, SplatMap

SCENES = Path(__file__).resolve().parents[1] / ".." / "shared" / "scenes"


def same(one: SplatMap, other: SplatMap):
    return all(torch.equal(a, b) for a, b in zip(one.tensors(), other.tensors(), strict=True))


def fields_of(splat_map):
    names = ["means", "log_scales", "rotations", "opacity_logits", "colors"]
    return dict(zip(names, (t.numpy() for t in splat_map.tensors()), strict=True))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("n", [0, 1, 7])
def test_npz_keeps_every_bit(dim, dtype, n, rng, tmp_path):
    before = random_map(rng, n, dim, dtype)
    splats.save(before, tmp_path / "map.npz")
    after = splats.load(tmp_path / "map.npz")
    assert after.means.dtype == dtype
    assert (after.dim, after.n_splats) == (dim, n)
    assert same(before, after)


@pytest.mark.parametrize("n", [0, 1, 7])
def test_ply_keeps_single_precision(n, rng, tmp_path):
    before = random_map(rng, n, 3, torch.float32)
    splats.save(before, tmp_path / "map.ply")
    after = splats.load(tmp_path / "map.ply")
    for a, b in zip(before.tensors(), after.tensors(), strict=True):
        assert_allclose(a, b, rtol=1e-6, atol=1e-6)
    assert torch.equal(before.means, after.means)


def test_a_saved_ply_has_the_standard_columns(rng, tmp_path):
    """Read back by hand: what other tools will find."""
    before = random_map(rng, 3, 3, torch.float32)
    splats.save(before, str(tmp_path / "map.ply"))
    head, body = (tmp_path / "map.ply").read_bytes().split(b"end_header\n")
    names = [line.split()[2].decode() for line in head.splitlines() if line.startswith(b"property float ")]
    table = np.frombuffer(body, "<f4").reshape(3, len(names))
    column = {name: table[:, k] for k, name in enumerate(names)}
    assert_allclose(column["y"], before.means[:, 1])
    assert_allclose(0.5 + 0.28209479177387814 * column["f_dc_2"], before.colors[:, 2], rtol=1e-5)
    assert_allclose(1 / (1 + np.exp(-column["opacity"])), before.opacities, rtol=1e-5)
    assert_allclose(np.exp(column["scale_1"]), before.scales[:, 1], rtol=1e-5)
    assert_allclose(column["rot_0"], before.rotations[:, 0])
    assert not np.any([column["nx"], column["ny"], column["nz"]])


def test_a_third_party_ply_loads():
    path = SCENES / "splats" / "cvlab_pc_short.ply"
    if not path.exists():
        pytest.skip("third-party scenes are not beside this checkout")
    with (
        pytest.warns(UserWarning, match="spherical harmonics"),
        pytest.warns(UserWarning, match="100 splats .* of 156"),
    ):
        found = splats.load(path)
    assert (found.dim, found.n_splats) == (3, 100)
    body = path.read_bytes().split(b"end_header\n")[1]
    table = np.frombuffer(body[: 100 * 62 * 4], "<f4").reshape(100, 62)
    assert_allclose(found.means, table[:, :3])
    assert_allclose(found.rotations, table[:, -4:])
    assert_allclose(found.opacity_logits, table[:, -8])
    eigenvalues = torch.linalg.eigvalsh(found.to(torch.float64).covariances())
    assert_allclose(eigenvalues.sqrt(), np.sort(np.exp(table[:, -7:-4]), 1), rtol=1e-5)


@pytest.mark.filterwarnings("ignore:.*(only the|spherical harmonics).*:UserWarning")
@pytest.mark.parametrize("path", sorted((SCENES / "splats").glob("*.ply")) or [None], ids=lambda p: p and p.name)
def test_third_party_splats_round_trip_and_render(path, tmp_path):
    """Written and read again they stay what they are; the tile kernel draws them as its dense twin does."""
    if path is None:
        pytest.skip("third-party scenes are not beside this checkout")
    before = splats.load(path)
    splats.save(before, tmp_path / "again.ply")
    after = splats.load(tmp_path / "again.ply")
    for name, a, b in zip(fields_of(before), before.tensors(), after.tensors(), strict=True):
        assert torch.equal(a, b) if name != "colors" else torch.allclose(a, b, rtol=1e-6, atol=1e-6)
    middle, spread = before.means.median(0).values, before.means.std(0).norm()
    camera, pose = Camera.from_fov(48, 36), geometry.yaw_pose(middle - torch.tensor([1.5, 0, 0]) * spread, 0.0)
    fast = render.render(after, camera, pose, "tiled")
    slow = render.render(before.to(torch.float64), camera, pose, "dense")
    assert slow.opacity.max() > 0.1
    for name in ("color", "depth", "opacity"):
        gap = (getattr(fast, name).double() - getattr(slow, name)).abs() / getattr(slow, name).abs().max()
        assert gap.mean() < 2e-3 and gap.max() < 0.05


@pytest.mark.parametrize("dim", [2, 3])
def test_unions_and_selections(dim, rng):
    a, b, c = (random_map(rng, n, dim) for n in (3, 1, 4))
    empty = SplatMap.empty(dim).to(torch.float64)
    whole = splats.union(a, b, c)
    assert whole.n_splats == 8
    assert same(splats.union(splats.union(a, b), c), whole)
    assert same(splats.union(empty, a, empty), a)
    assert same(whole.select(torch.arange(3)), a)
    assert same(whole.select(np.arange(8) >= 4), c)
    assert same(whole.select(torch.arange(8)), whole)
    order = rng.permutation(8)
    assert same(whole.select(order).select(np.argsort(order)), whole)
    assert whole.select(torch.zeros(8, dtype=torch.bool)).n_splats == whole.select([]).n_splats == 0
    assert_allclose(whole.select([6]).covariances(), geometry.covariances(c.log_scales, c.rotations)[2:3])
    assert_allclose(shifted(a, 1.0).covariances(), a.covariances())


def test_a_lifted_map_is_the_flat_one_at_every_height(rng):
    flat, heights = random_map(rng, 5, 2), [0.5, -1.0, 3.0]
    tall = splats.lifted(flat, heights, 0.2)
    assert (tall.dim, tall.n_splats, tall.means.dtype) == (3, 15, torch.float64)
    for k, height in enumerate(heights):
        layer = tall.select(torch.arange(5 * k, 5 * k + 5))
        assert torch.equal(layer.means[:, :2], flat.means) and (layer.means[:, 2] == height).all()
        sigma = layer.covariances()
        assert_allclose(sigma[:, :2, :2], flat.covariances(), atol=1e-12)
        assert_allclose(sigma[:, 2], torch.tensor([[0.0, 0.0, 0.04]]).expand(5, 3), atol=1e-12)
        assert torch.equal(layer.opacity_logits, flat.opacity_logits) and torch.equal(layer.colors, flat.colors)


@pytest.mark.parametrize("degrees", [-180, -179.9, -90, 0, 45, 179.9])
def test_a_lifted_splat_is_turned_about_the_vertical(degrees):
    angle = math.radians(degrees)
    turned = torch.tensor([[3 * math.cos(angle), 3 * math.sin(angle)]])  # of any length
    one = SplatMap(torch.zeros(1, 2), torch.tensor([[-1.0, -3.0]]), turned, torch.zeros(1), torch.zeros(1, 3))
    (w, x, y, z), expected = splats.lifted(one, [0.0], 0.1).rotations[0], Rotation.from_euler("z", degrees, True)
    assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), expected.as_matrix(), atol=1e-6)
    assert w**2 + z**2 == pytest.approx(1) and x == y == 0


def test_a_lifted_map_keeps_gradients_and_precision(rng):
    flat = random_map(rng, 4, 2, torch.float32)
    flat.means.requires_grad_(True)
    tall = splats.lifted(flat, torch.linspace(0, 1, 3, dtype=torch.float64), 0.1)
    assert tall.means.dtype == torch.float32
    tall.means.sum().backward()
    assert torch.equal(flat.means.grad, torch.full((4, 2), 3.0))


def test_lifting_nothing_or_to_nowhere_gives_an_empty_map(rng):
    assert splats.lifted(SplatMap.empty(2), [0.0, 1.0], 0.1).n_splats == 0
    nowhere = splats.lifted(random_map(rng, 4, 2), [], 0.1)
    assert (nowhere.dim, nowhere.n_splats) == (3, 0)


@pytest.mark.parametrize(
    ("dim", "heights", "std", "words"),
    [
        (3, [0.0], 0.1, "3-D already"),
        (2, 0.5, 0.1, "heights must be a list"),
        (2, [0.0, math.nan], 0.1, "heights must be a list of finite numbers"),
        (2, [0.0], 0.0, "std must be a positive number"),
        (2, [0.0], math.inf, "std must be a positive number"),
        (2, [0.0], math.nan, "std must be a positive number"),
    ],
)
def test_what_cannot_be_lifted_is_named(dim, heights, std, words, rng):
    with pytest.raises(ValueError, match=f"lifted: .*{words}"):
        splats.lifted(random_map(rng, 2, dim), heights, std)


def test_what_does_not_fit_is_named(rng, unchecked):
    flat, space = random_map(rng, 3, 2), random_map(rng, 3, 3)
    with pytest.raises(ValueError, match="union: maps must share one dimension"):
        splats.union(flat, space)
    with pytest.raises(ValueError, match="union"):
        splats.union()
    with pytest.raises(ValueError, match="splat map: means must be"):
        SplatMap(torch.zeros(3, 4), *flat.tensors()[1:])
    for k, name in enumerate(["log_scales", "rotations", "opacity_logits", "colors"], 1):
        wrong = [*flat.tensors()[:k], flat.tensors()[k][:2], *flat.tensors()[k + 1 :]]
        with pytest.raises(ValueError, match=f"splat map: {name} must be"):
            SplatMap(*wrong)
    with pytest.raises(ValueError, match="splat map: rotations must be"):
        SplatMap(space.means, space.log_scales, torch.zeros(3, 2), *space.tensors()[3:])


def bad_npz(kind, path, good):
    fields = fields_of(good)
    if kind == "a field missing":
        del fields["colors"]
        np.savez(path, **fields)
    elif kind == "whole numbers":
        np.savez(path, **{**fields, "colors": np.ones((4, 3), int)})
    elif kind == "a number":
        np.savez(path, **{**fields, "opacity_logits": np.array(1.0)})
    elif kind == "too few rows":
        np.savez(path, **{**fields, "opacity_logits": fields["opacity_logits"][:3]})
    elif kind == "four dimensions":
        np.savez(path, **{**fields, "means": np.zeros((4, 4))})
    elif kind == "NaN":
        fields["log_scales"] = np.where(np.arange(4)[:, None] == 2, np.nan, fields["log_scales"])
        np.savez(path, **fields)
    elif kind == "no rotation":
        np.savez(path, **{**fields, "rotations": np.zeros((4, 2))})
    elif kind == "infinite":
        np.savez(path, **{**fields, "means": np.where(np.eye(4)[:, :2] > 0, np.inf, 0.0)})


@pytest.mark.parametrize(
    "kind",
    [
        "a field missing", "whole numbers", "a number", "too few rows", "four dimensions", "NaN", "infinite",
        "no rotation", "missing",
    ],
)  # fmt: skip
def test_bad_npz_files_are_named_in_one_line(kind, rng, tmp_path, unchecked):
    path = tmp_path / "bad.npz"
    bad_npz(kind, path, random_map(rng, 4, 2))
    with pytest.raises(FormatError) as caught:
        splats.load(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    if kind == "NaN":
        assert "log_scales of splat 2" in message


def edited(path, old, new):
    raw = path.read_bytes()
    assert old in raw
    path.write_bytes(raw.replace(old, new, 1))


def bad_ply(kind, path, good):
    splats.save(good, path)
    if kind == "truncated":
        path.write_bytes(path.read_bytes()[:-5])
    elif kind == "truncated header":
        path.write_bytes(path.read_bytes()[:100])
    elif kind == "too many":
        edited(path, b"vertex 4", b"vertex 5")
    elif kind == "absurd count":
        edited(path, b"vertex 4", b"vertex 900000000000")
    elif kind == "endless count":
        edited(path, b"vertex 4", b"vertex " + b"9" * 5000)
    elif kind == "negative count":
        edited(path, b"vertex 4", b"vertex -4")
    elif kind == "no count":
        edited(path, b"element vertex 4\n", b"")
    elif kind == "ascii":
        edited(path, b"binary_little_endian", b"ascii")
    elif kind == "big endian":
        edited(path, b"binary_little_endian", b"binary_big_endian")
    elif kind == "faces first":
        edited(path, b"element vertex", b"element face 2\nelement vertex")
    elif kind == "a list":
        edited(path, b"property float nx", b"property list uchar int nx")
    elif kind == "unknown type":
        edited(path, b"property float nx", b"property quad nx")
    elif kind == "twice the same":
        edited(path, b"property float nx", b"property float x")
    elif kind == "a property missing":
        edited(path, b"property float scale_1", b"property float size")
    elif kind == "no magic":
        edited(path, b"ply\n", b"plo\n")
    elif kind == "no format":
        edited(path, b"format binary_little_endian 1.0\n", b"")
    elif kind == "vertices twice":
        edited(path, b"end_header", b"element vertex 4\nproperty float more\nend_header")
    elif kind == "only an end":
        path.write_bytes(b"end_header\n")
    elif kind == "empty":
        path.write_bytes(b"")
    elif kind == "NaN":
        table = np.frombuffer(path.read_bytes()[-4 * 17 * 4 :], "<f4").reshape(4, 17).copy()
        table[1, 0] = np.nan
        path.write_bytes(path.read_bytes()[: -4 * 17 * 4] + table.tobytes())
    elif kind == "too large for a float":
        edited(path, b"property float nx", b"property double x")
        edited(path, b"property float x", b"property float nx")
        head, body = path.read_bytes().split(b"end_header\n")
        rows = [
            body[k * 68 : k * 68 + 12] + struct.pack("<d", 1e300) + body[k * 68 + 16 : k * 68 + 68] for k in range(4)
        ]
        path.write_bytes(head + b"end_header\n" + b"".join(rows))


@pytest.mark.parametrize(
    "kind",
    [
        "truncated", "truncated header", "too many", "absurd count", "endless count", "negative count",
        "no count", "ascii", "big endian", "faces first", "a list", "unknown type", "twice the same",
        "a property missing", "no magic", "no format", "vertices twice", "only an end", "empty", "NaN",
        "too large for a float",
    ],
)  # fmt: skip
def test_bad_ply_files_are_named_in_one_line(kind, rng, tmp_path):
    path = tmp_path / "bad.ply"
    bad_ply(kind, path, random_map(rng, 4, 3, torch.float32))
    with pytest.raises(FormatError) as caught:
        splats.load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    if kind == "NaN":
        assert "means of splat 1" in str(caught.value)
    if kind == "too large for a float":
        assert "means of splat 0 is not finite" in str(caught.value)


@pytest.mark.parametrize("count", [60, 10**7, 10**12, 10**18 - 1])
def test_a_count_that_the_file_cannot_hold_is_refused_without_memory_for_it(count, rng, tmp_path):
    path = tmp_path / "map.ply"
    splats.save(random_map(rng, 10, 3, torch.float32), path)
    edited(path, b"vertex 10", b"vertex %d" % count)
    assert path.stat().st_size < 1200
    tracemalloc.start()
    try:
        with pytest.raises(FormatError, match=f"promises {count} splats, the file has room for 10"):
            splats.load(path)
        assert tracemalloc.get_traced_memory()[1] < 300_000  # the header's 64 kB, no more
    finally:
        tracemalloc.stop()


def test_more_splats_than_any_map_has_are_refused_though_the_file_is_long_enough(rng, tmp_path):
    path = tmp_path / "map.ply"
    splats.save(random_map(rng, 1, 3, torch.float32), path)
    edited(path, b"vertex 1", b"vertex 50000001")
    with path.open("r+b") as file:
        file.truncate(50_000_001 * 17 * 4 + 1000)  # a hole: no disk is used
    with pytest.raises(FormatError, match="promises 50000001 splats"):
        splats.load(path)


@pytest.mark.parametrize("beyond", [0.0, 0.25])
def test_spherical_harmonics_beyond_degree_0_are_dropped_with_a_warning(beyond, rng, tmp_path):
    """The full layout of 62 properties, with and without anything in the 45 that are dropped."""
    path, before = tmp_path / "map.ply", random_map(rng, 5, 3, torch.float32)
    splats.save(before, path)
    head, body = path.read_bytes().split(b"end_header\n")
    table = np.frombuffer(body, "<f4").reshape(5, 17)
    rest = np.where(np.arange(45) == 44, beyond, 0.0) * np.ones((5, 1))
    names = b"".join(b"property float f_rest_%d\n" % k for k in range(45))
    head = head.replace(b"property float opacity\n", names + b"property float opacity\n")
    full = np.concatenate([table[:, :9], rest, table[:, 9:]], 1).astype("<f4")
    path.write_bytes(head + b"end_header\n" + full.tobytes())
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        after = splats.load(path)
    assert [str(one.message) for one in caught] == (
        [f"{path}: spherical harmonics beyond degree 0 are dropped"] if beyond else []
    )
    for a, b in zip(before.tensors(), after.tensors(), strict=True):
        assert_allclose(a, b, rtol=1e-6, atol=1e-6)


def test_a_comment_may_speak_of_the_header_s_end(rng, tmp_path):
    path, before = tmp_path / "map.ply", random_map(rng, 4, 3, torch.float32)
    splats.save(before, path)
    edited(path, b"element vertex", b"comment what follows end_header\nelement vertex")
    assert torch.equal(splats.load(path).means, before.means)


def test_what_a_ply_holds_beyond_its_header_is_told(rng, tmp_path):
    path, before = tmp_path / "map.ply", random_map(rng, 4, 3, torch.float32)
    splats.save(before, path)
    edited(path, b"vertex 4", b"vertex 3")
    with pytest.warns(UserWarning, match="only the 3 splats its header promises are read, of 4"):
        after = splats.load(path)
    assert torch.equal(after.means, before.means[:3])


@pytest.mark.filterwarnings("ignore:.*(only the|spherical harmonics).*:UserWarning")
def test_noise_in_a_file_never_leads_past_a_format_error(rng, tmp_path, unchecked):
    path = tmp_path / "map.ply"
    splats.save(random_map(rng, 3, 3, torch.float32), path)
    good = np.frombuffer(path.read_bytes(), np.uint8)
    refused = 0
    for _ in range(300):
        bad = good.copy()
        bad[rng.integers(len(bad), size=3)] = rng.integers(256, size=3)
        path.write_bytes(bad[: rng.integers(1, len(bad) + 1)].tobytes())
        try:
            splats.load(path)
        except FormatError:
            refused += 1
    assert refused > 100


@pytest.mark.parametrize("name", ["map.txt", "map", "map.NPZX"])
def test_unknown_endings_are_named(name, rng, tmp_path):
    with pytest.raises(FormatError, match="unknown ending"):
        splats.save(random_map(rng, 2, 2), tmp_path / name)
    assert not (tmp_path / name).exists()
    (tmp_path / name).write_bytes(b"")
    with pytest.raises(FormatError, match="unknown ending"):
        splats.load(tmp_path / name)


def test_a_missing_file_and_a_folder_are_named(tmp_path):
    for path in (tmp_path / "none.npz", tmp_path):
        with pytest.raises(FormatError, match="no such file"):
            splats.load(path)


def test_a_flat_map_is_no_ply(rng, tmp_path):
    path = tmp_path / "map.ply"
    path.write_bytes(b"precious")
    with pytest.raises(FormatError, match=r"save a flatland map as \.npz"):
        splats.save(random_map(rng, 2, 2), path)
    assert path.read_bytes() == b"precious"


def test_maps_move_between_precisions(rng):
    assert random_map(rng, 2, 3).to(torch.float32).means.dtype == torch.float32


def test_arrays_and_lists_become_tensors(unchecked):
    made = SplatMap([[0.0, 1.0]], np.zeros((1, 2)), [[1, 0]], [0], np.ones((1, 3)))
    assert all(isinstance(t, torch.Tensor) and t.dtype == torch.float32 for t in made.tensors())
    assert made.select([0]).covariances().shape == (1, 2, 2)
