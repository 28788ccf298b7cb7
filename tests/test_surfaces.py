"""Rays and textures in space, against brute force and closed forms."""

import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mannbv.world import Surfaces
from mannbv.world.surfaces import _halved


def brute_force(corners, origins, directions):
    """Nearest depth of each ray on all triangles, by solving for the point in each plane, without embree."""
    best, face = np.full(len(origins), np.inf), np.full(len(origins), -1)
    for f, (a, b, c) in enumerate(corners):
        for k, (o, d) in enumerate(zip(origins, directions, strict=True)):
            system = np.stack([d, a - b, a - c], 1)
            if abs(np.linalg.det(system)) < 1e-12:
                continue
            t, u, v = np.linalg.solve(system, a - o)
            if t > 0 and min(u, v, 1 - u - v) >= 0 and t < best[k]:
                best[k], face[k] = t, f
    return best, face


def square(x=2.0, side=2.0, **options):
    """A square across the x axis, its image's lower left corner at y, z = −side / 2."""
    corner = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    points = np.column_stack([np.full(4, x), (corner - 0.5) * side])
    faces = [[0, 1, 2], [0, 2, 3]]
    return points[faces], corner[faces].astype(np.float32)


def pictured(image, side=2.0, repeat=1.0):
    corners, uv = square(side=side)
    return Surfaces(corners, np.ones((2, 3, 3), np.float32), uv * np.float32(repeat), np.zeros(2, np.int32), (image,))


@pytest.mark.parametrize("offset", [0.0, 5000.0])
def test_the_depth_of_a_ray_is_that_of_brute_force(offset):
    rng = np.random.default_rng(3)
    corners = rng.uniform(-1, 1, (60, 1, 3)) * 3 + rng.uniform(-1.6, 1.6, (60, 3, 3)) + offset
    origins = rng.uniform(-1, 1, (300, 3)) + offset
    directions = rng.normal(size=(300, 3)) * rng.uniform(0.1, 5, (300, 1))
    depth, face = Surfaces.plain(corners).cast(origins, directions)
    expected, which = brute_force(corners, origins, directions)
    assert (which >= 0).sum() > 100 and (which < 0).any()
    same = face == which
    assert same.mean() > 0.99  # embree decides in single precision: a ray on an edge may differ
    assert_allclose(depth[same], expected[same], rtol=1e-9)
    assert np.isinf(depth[face < 0]).all()


def test_no_ray_slips_through_the_seam_of_two_triangles():
    corners, _ = square()
    rng = np.random.default_rng(0)
    along = rng.uniform(-1, 1, 20_000)
    directions = np.column_stack([np.full(20_000, 2.0), along, along])  # at the diagonal, shared by both
    depth, _ = Surfaces.plain(corners).cast(np.zeros((20_000, 3)), directions)
    assert_allclose(depth, 1.0, rtol=1e-12)


def test_an_image_stands_upright_and_not_mirrored():
    image = np.zeros((2, 2, 3), np.uint8)
    image[0, 0], image[0, 1], image[1, 0], image[1, 1] = [255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]
    surfaces = pictured(image)
    # texel centres: a quarter of the side from the edges; y to the right in the image, z upwards
    spots = np.array([[2, -0.5, 0.5], [2, 0.5, 0.5], [2, -0.5, -0.5], [2, 0.5, -0.5]])
    depth, faces = surfaces.cast(np.zeros((4, 3)), spots)
    seen = surfaces.shaded(np.zeros(3), spots, faces, spread=1e-6)
    assert_allclose(depth, 1.0)
    assert_allclose(seen, [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], atol=1e-6)


def test_between_texels_colours_are_mixed_and_times_the_corners():
    image = np.array([[[0, 0, 0], [200, 100, 50]]], np.uint8)
    corners, uv = square()
    tint = np.full((2, 3, 3), 0.5, np.float32)
    surfaces = Surfaces(corners, tint, uv, np.zeros(2, np.int32), (image,))
    shares = np.array([0.0, 0.25, 0.5, 1.0])
    spots = np.column_stack([np.full(4, 2.0), shares - 0.5, np.full(4, 0.3)])
    _, faces = surfaces.cast(np.zeros((4, 3)), spots)
    seen = surfaces.shaded(np.zeros(3), spots, faces, 1e-6)
    assert_allclose(seen, 0.5 * shares[:, None] * np.array([200, 100, 50]) / 255, atol=1e-6)


@pytest.mark.parametrize("repeat", [1.0, 3.0])
def test_detail_finer_than_a_pixel_is_averaged(repeat):
    checker = np.zeros((64, 64, 3), np.uint8)
    checker[::2, ::2] = checker[1::2, 1::2] = 200
    surfaces = pictured(checker, repeat=repeat)
    rng = np.random.default_rng(1)
    spots = np.column_stack([np.full(200, 2.0), rng.uniform(-0.9, 0.9, (200, 2))])
    _, faces = surfaces.cast(np.zeros((200, 3)), spots)
    coarse = surfaces.shaded(np.zeros(3), spots, faces, spread=0.5)  # a pixel of 1 m on an image of 2 m
    fine = surfaces.shaded(np.zeros(3), spots, faces, spread=1e-5)
    assert_allclose(coarse, 100 / 255, atol=2 / 255)
    assert fine.std() > 0.1


def test_an_image_repeats_where_its_places_go_beyond_it_and_else_ends_at_its_edge():
    image = np.array([[[255, 255, 255], [0, 0, 0]]], np.uint8)
    edge = np.array([[2.0, -0.999, 0.0]])  # left of the first texel's centre
    for repeat, expected in ((1.0, 1.0), (2.0, 0.5)):
        surfaces = pictured(image, repeat=repeat)
        _, faces = surfaces.cast(np.zeros((1, 3)), edge)
        assert_allclose(surfaces.shaded(np.zeros(3), edge, faces, 1e-9), expected, atol=0.01)


def test_half_size_copies_keep_the_mean():
    rng = np.random.default_rng(2)
    picture = rng.integers(0, 256, (32, 16, 3)).astype(np.uint8)
    while max(picture.shape[:2]) > 1:
        smaller = _halved(picture)
        assert smaller.shape[0] == max(1, picture.shape[0] // 2)
        assert_allclose(smaller.mean((0, 1)), picture.mean((0, 1)), atol=1.0)
        picture = smaller


@pytest.mark.parametrize("spacing", [0.05, 0.3])
def test_samples_lie_on_the_triangles_and_leave_no_hole(spacing):
    rng = np.random.default_rng(4)
    corners = rng.uniform(-1, 1, (5, 3, 3))
    samples = Surfaces.plain(corners).sampled(spacing)
    weights = rng.dirichlet(np.ones(3), (5, 200))
    anywhere = np.einsum("fkc,fcd->fkd", weights, corners).reshape(-1, 3)
    gaps = np.linalg.norm(anywhere[:, None] - samples, axis=-1).min(1)
    assert gaps.max() <= spacing
    heights = []
    for a, b, c in corners:
        normal = np.cross(b - a, c - a)
        heights.append(np.abs((samples - a) @ normal) / np.linalg.norm(normal))
    assert np.min(heights, axis=0).max() < 1e-12


def test_surfaces_travel_to_another_process_and_see_the_same():
    surfaces = pictured(np.arange(48, dtype=np.uint8).reshape(4, 4, 3))
    rays = np.zeros((1, 3)), np.array([[2.0, 0.1, 0.2]])
    before = surfaces.cast(*rays)
    there = pickle.loads(pickle.dumps(surfaces))
    assert_allclose(there.cast(*rays)[0], before[0])
    assert len(pickle.dumps(surfaces)) < 4000


def test_nothing_to_hit_and_no_rays():
    nothing = Surfaces.plain(np.zeros((0, 3, 3)))
    depth, face = nothing.cast(np.zeros((2, 3)), np.ones((2, 3)))
    assert np.isinf(depth).all() and (face == -1).all()
    assert nothing.sampled(0.1).shape == (0, 3)
