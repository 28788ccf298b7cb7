"""Mapping in both dimensions by the same laws: growth, memory, files; a furnished room; a real sequence."""

import dataclasses
import itertools
import math
from pathlib import Path

import numba
import numpy as np
import pytest
import torch
from helpers import box_frame, camera_for, random_map
from numpy.testing import assert_allclose
from PIL import Image
from rooms import room_frame, stroll

from mannbv import information, mapping, render, splats
from mannbv.camera import Camera, Frame
from mannbv.config import SPACE, Config
from mannbv.geometry import Pose
from mannbv.mapping import LocalMap, Moments

RGBD = Path(__file__).resolve().parents[2] / "shared" / "scenes" / "rgbd" / "open3d_rgbd"
COARSE = SPACE.replace(fit_steps=12)


def empty(dim: int) -> LocalMap:
    return LocalMap.empty(dim, information.n_parameters(dim))


def camera_of(dim: int) -> Camera:
    return camera_for(dim, 64 if dim == 2 else 32, 24)


@pytest.fixture(autouse=True)
def _one_thread():
    """Side by side with other work, threads that wait for each other are slower than one."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(before)


def walk(dim: int, n: int) -> list[Frame]:
    """n frames of a robot that looks around in the flat box or in the furnished room."""
    if dim == 2:
        return [box_frame(camera_of(2), (1.0 + 0.2 * k, 1.2), 0.6 * k) for k in range(n)]
    return [room_frame(camera_of(3), *view) for view in stroll(24)[:n]]


def mapped(dim: int, frames, config: Config, local: LocalMap | None = None) -> LocalMap:
    """The map after these frames, each with a generator of its own, as a team's robots have it."""
    local = local or empty(dim)
    for frame in frames:
        rng = np.random.default_rng([1, len(local.keyframes)])
        local = mapping.observe(local, camera_of(dim), frame, config, rng)
    return local


def quality(splat_map, camera: Camera, frames) -> tuple[float, float]:
    """Mean PSNR [dB] and mean depth error [m] where there is a depth."""
    psnr, mae = [], []
    for frame in frames:
        drawn, valid = render.render(splat_map, camera, frame.pose), frame.valid
        psnr.append(-10 * math.log10(float(((drawn.color.clamp(0, 1) - frame.color)[valid] ** 2).mean())))
        mae.append(float((drawn.depth - frame.depth)[valid].abs().mean()))
    return float(np.mean(psnr)), float(np.mean(mae))


def turned(dim: int, frame: Frame) -> Frame:
    """What the camera of a frame sees when it turns round."""
    place, yaw = frame.pose.position.double(), frame.pose.yaw + math.pi
    return box_frame(camera_of(2), place, yaw) if dim == 2 else room_frame(camera_of(3), place, yaw)


# ---- growth ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
def test_only_what_is_unexplained_gets_splats(dim):
    frame, config = walk(dim, 1)[0], SPACE.replace(insert_spacing=1, densify_error=1.0)
    first = mapped(dim, [frame], config)
    assert first.born == frame.depth.numel()
    second = mapped(dim, [frame], config, first)
    assert second.born - first.born < 0.05 * first.born
    behind = mapped(dim, [turned(dim, frame)], config, first)
    assert behind.born > 1.95 * first.born


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("spacing", [1, 2, 3])
def test_a_block_of_pixels_gets_one_splat_nearest_to_its_middle(dim, spacing, rng):
    pixels = torch.from_numpy(rng.random((17,) if dim == 2 else (11, 17)) < 0.4)
    chosen = mapping.thinned(pixels, spacing)
    middle = (spacing - 1) / 2
    count = 0
    for corner in itertools.product(*(range(0, n, spacing) for n in pixels.shape)):
        block = tuple(slice(c, c + spacing) for c in corner)
        away = {tuple(p): sum((c - middle) ** 2 for c in p) for p in pixels[block].nonzero().tolist()}
        found = [tuple(p) for p in chosen[block].nonzero().tolist()]
        assert len(found) == min(len(away), 1)
        assert all(away[p] == min(away.values()) for p in found)
        count += len(found)
    assert count == int(chosen.sum()) > 0
    assert spacing > 1 or torch.equal(chosen, pixels)


@pytest.mark.parametrize("dim", [2, 3])
def test_new_splats_are_as_wide_as_their_spacing(dim):
    camera, frame = camera_of(dim), walk(dim, 1)[0]
    fresh = mapping.newborn(camera, frame, frame.valid, SPACE.replace(insert_spacing=4, insert_scale=0.5))
    assert_allclose(
        fresh.scales, (2.0 * frame.pose.local(fresh.means)[:, -1:] / camera.focal).expand(-1, dim), rtol=1e-4
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_what_coarse_splats_cannot_show_gets_finer_ones(dim):
    camera, frame = camera_of(dim), walk(dim, 1)[0]
    marks = torch.zeros_like(frame.depth)
    marks[..., 12:20] = 0.4 * torch.tensor([1.0, 1, -1, -1]).repeat(2)  # stripes two pixels wide
    frame = dataclasses.replace(frame, color=(0.5 + marks)[..., None].expand(*marks.shape, 3).contiguous())
    config = SPACE.replace(insert_spacing=4)
    coarse, finer = (mapped(dim, [frame], config.replace(densify_error=error)) for error in (1.0, 0.05))
    wrong = mapping.mistaken(coarse.splats, camera, frame, config)
    drawn = render.render(coarse.splats, camera, frame.pose).color
    for place in np.ndindex(*frame.depth.shape):
        error = sum(abs(float(drawn[place][c] - frame.color[place][c])) for c in range(3)) / 3
        assert bool(wrong[place]) == (error > 0.05) or abs(error - 0.05) < 1e-5
    added = finer.splats.means[finer.ids >= coarse.born]
    assert 0 < len(added) < 0.4 * frame.depth.numel()
    column = camera.project(frame.pose.local(added))[0][:, 0]
    assert ((column > 8) & (column < 24)).float().mean() > 0.9
    assert mapping.loss(finer.splats, camera, frame, 0.5) < 0.8 * mapping.loss(coarse.splats, camera, frame, 0.5)
    assert ((finer.splats.colors >= 0) & (finer.splats.colors <= 1)).all()  # which stripes drive them to leave


@pytest.mark.parametrize("dim", [2, 3])
def test_rows_stay_with_their_splats(dim, rng):
    splat_map = random_map(rng, 30, dim, torch.float32)
    mark = torch.arange(30.0)
    rows = lambda k: mark[:, None].expand(-1, k).contiguous()  # noqa: E731
    moments = Moments(rows(10), rows(10), mark.long())
    local = LocalMap(splat_map, mark.long(), rows(9), (), 30, moments)
    keep = mapping.survivors(splat_map, Config(prune_opacity=0.4, prune_scale=0.3))
    assert torch.equal(keep, (splat_map.opacities >= 0.4) & (splat_map.scales.amax(1) <= 0.3))
    after = local.grown(splat_map.select([0, 1])).select(torch.cat([keep, torch.tensor([True, True])]))
    kept = mark[keep].long().tolist()
    assert 0 < len(kept) < 30 and after.ids.tolist() == [*kept, 30, 31] and after.born == 32
    assert torch.equal(after.splats.means[:-2], splat_map.means[kept])
    for part in (after.prior, after.moments.first, after.moments.second, after.moments.steps[:, None]):
        assert part[:, 0].tolist() == [*kept, 0, 0]


# ---- the fit --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("moments", ["fresh", "kept"])
@pytest.mark.parametrize("dim", [2, 3])
def test_the_loss_falls(dim, moments):
    camera, frames = camera_of(dim), walk(dim, 3)
    config = COARSE.replace(moments=moments, densify_error=1.0)
    rough, fitted = (mapped(dim, frames, config.replace(fit_steps=steps)) for steps in (0, 24))
    before, after = (sum(float(mapping.loss(m.splats, camera, f, 0.5)) for f in frames) for m in (rough, fitted))
    assert after < 0.6 * before
    assert (fitted.moments is None) == (moments == "fresh")


@pytest.mark.parametrize("dim", [2, 3])
def test_a_kept_memory_moves_only_what_is_seen(dim):
    frame = walk(dim, 1)[0]
    seen = mapped(dim, [frame, turned(dim, frame)], COARSE)
    camera = camera_of(dim)
    for moments, rest in ((seen.moments, True), (None, False)):
        after, _ = mapping.refine(seen.splats, moments, camera, [frame], SPACE, 5)
        behind = camera.project(frame.pose.local(seen.splats.means))[0][:, 0].isnan()
        behind |= frame.pose.local(seen.splats.means)[:, -1] < -0.5
        assert behind.sum() > 0.3 * seen.splats.n_splats
        still = [torch.equal(a[behind], b[behind]) for a, b in zip(seen.splats.tensors(), after.tensors(), strict=True)]
        assert all(still[:2]) and not torch.equal(seen.splats.means[~behind], after.means[~behind])
        if rest:
            assert torch.equal(seen.splats.opacity_logits[behind], after.opacity_logits[behind])


# ---- files ----------------------------------------------------------------------------------------------------------


def same(one: LocalMap, other: LocalMap) -> bool:
    one, other = mapping.to_arrays(one), mapping.to_arrays(other)
    return one.keys() == other.keys() and all(np.array_equal(one[name], other[name]) for name in one)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_resumed_map_goes_on_as_if_it_had_never_stopped(dim, tmp_path):
    frames, config = walk(dim, 4), SPACE.replace(fit_steps=8)
    half = mapped(dim, frames[:2], config)
    mapping.save(half, tmp_path / "half.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["half.npz"]
    resumed = mapping.load(tmp_path / "half.npz")
    assert same(half, resumed)
    through = mapped(dim, frames[2:], config, half)
    assert same(through, mapped(dim, frames[2:], config, resumed))
    assert not same(through, mapped(dim, frames[2:], config, resumed.replace(moments=None)))


@pytest.mark.parametrize("dim", [2, 3])
def test_a_map_without_keyframes_or_memory_is_a_file_too(dim, tmp_path):
    mapping.save(empty(dim), tmp_path / "none.npz")
    back = mapping.load(tmp_path / "none.npz")
    assert same(back, empty(dim)) and back.keyframes == () and back.moments is None


def test_what_is_no_local_map_is_refused(tmp_path):
    path = tmp_path / "map.npz"
    with pytest.raises(splats.FormatError, match="no such file"):
        mapping.load(path)
    arrays = mapping.to_arrays(mapped(2, walk(2, 1), SPACE.replace(fit_steps=1)))
    broken = {
        "prior": {name: part for name, part in arrays.items() if name != "prior"},
        "rows beside": arrays | {"ids": arrays["ids"][1:]},
        "have 0 and 1 rows": arrays | {"keyframe_depth": arrays["keyframe_depth"][1:]},
    }
    for message, content in broken.items():
        np.savez(path, **content)
        with pytest.raises(splats.FormatError, match=message) as error:
            mapping.load(path)
        assert str(path) in str(error.value) and "\n" not in str(error.value)


# ---- a room and a real sequence -------------------------------------------------------------------------------------


def test_a_furnished_room_is_mapped_well():
    """Half of the walk's frames are fitted, those between them are not."""
    camera, frames = Camera.from_fov(48, 48), [room_frame(Camera.from_fov(48, 48), *view) for view in stroll(48)[:13]]
    local = empty(3)
    for frame in frames[::2]:
        local = mapping.observe(local, camera, frame, COARSE.replace(fit_steps=24), np.random.default_rng(0))
    (fitted, fitted_depth), (held, held_depth) = (quality(local.splats, camera, frames[k::2]) for k in (0, 1))
    assert fitted > 34 and held > 32
    assert fitted_depth < 0.065 and held_depth < 0.07
    assert local.splats.n_splats < 0.5 * 7 * 48 * 48


def real_frames(size: int) -> tuple[Camera, list[Frame]]:
    """The sequence's middle square, `size` pixels a side: colours averaged, depths picked; poses camera to world."""
    lines = [line.split() for line in (RGBD / "trajectory.log").read_text().splitlines()]
    square, frames = (80, 0, 560, 480), []
    for k in range(len(lines) // 5):
        matrix = torch.tensor([[float(x) for x in row] for row in lines[5 * k + 1 : 5 * k + 4]])
        with Image.open(RGBD / f"color/{k:05d}.jpg") as color, Image.open(RGBD / f"depth/{k:05d}.png") as depth:
            color = np.asarray(color.resize((size, size), Image.Resampling.BOX, square), np.float32) / 255
            depth = np.asarray(depth.resize((size, size), Image.Resampling.NEAREST, square), np.float32) / 1000
        frames.append(Frame(torch.from_numpy(color), torch.from_numpy(depth), Pose(matrix[:, :3], matrix[:, 3])))
    return Camera(size, size, 525.0 * size / 480), frames


@pytest.mark.skipif(not RGBD.is_dir(), reason="third-party scenes are not beside this checkout")
def test_a_real_sequence_shows_the_frame_that_was_left_out():
    camera, frames = real_frames(96)
    local = empty(3)
    for frame in (frames[k] for k in (0, 1, 3, 4)):
        local = mapping.observe(local, camera, frame, SPACE.replace(fit_steps=24), np.random.default_rng(0))
    psnr, mae = quality(local.splats, camera, [frames[2]])
    assert psnr > 34
    assert mae < 0.025
