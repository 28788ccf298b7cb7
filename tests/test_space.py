"""A building in space: what a camera sees of it, and the ground that looks carve."""

import math

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from mannbv import geometry, grid, planner, world
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.grid import FREE, OCCUPIED, UNKNOWN, Lattice, Occupancy

LOW, HIGH = 0.1, 1.3


@pytest.fixture(scope="module")
def flat():
    return world.load("flat", dim=3)


def pose(x, y, z, yaw):
    return geometry.yaw_pose(torch.tensor([x, y, z], dtype=torch.float64), yaw)


def test_a_plan_is_one_building_in_two_dimensions(flat):
    plane = world.load("flat")
    assert flat.dim == 3 and flat.name == plane.name and flat.ground.area == plane.ground.area
    assert_allclose(np.delete(flat.starts, 2, 1), plane.starts)
    assert_allclose(flat.goals[:, :2], plane.goals)
    assert_allclose([*flat.starts[:, 2], *flat.goals[:, 2]], Config().camera_height)
    points = np.random.default_rng(0).uniform(plane.seen.lower, plane.seen.upper, (50, 2))
    raised = np.column_stack([points, np.full(50, 0.7)])
    for name in ("clearance", "solid", "inside"):
        assert_allclose(getattr(flat.ground, name)(raised), getattr(plane.ground, name)(points))
    way = flat.ground.shortest_path(flat.starts[0, :3], flat.goals[0], 0.1)
    assert_allclose(way[:, :2], plane.ground.shortest_path(plane.starts[0], plane.goals[0], 0.1))
    assert_allclose(way[:, 2], flat.starts[0, 2])


def test_depth_is_along_the_axis_and_ends_at_the_sensors_range(flat):
    camera, here = Camera.from_fov(31, 21), pose(2.0, 4.1, 1.25, 0.4)
    frame = flat.sense(camera, here, max_depth=2.0)
    rays = (camera.rays(here.position) @ here.rotation.T).numpy()
    depth, _ = flat.seen.cast(np.broadcast_to(here.position.numpy(), rays.shape), rays)
    expected = np.where(depth <= 2.0, depth, 0.0).reshape(21, 31)
    assert (expected == 0).any() and (expected > 0).any()
    assert_allclose(frame.depth, expected, rtol=1e-6)
    ahead = float(frame.depth[10, 15])
    spot = here.position.numpy() + ahead * here.rotation[:, 2].numpy()
    assert flat.ground.clearance(spot[None])[0] < 1e-5  # what stands ahead in 3-D stands there on the plan


def test_cameras_can_be_raised_and_places_replaced(flat):
    tall = flat.suited(Config(camera_height=2.0))
    assert_allclose([*tall.starts[:, 2], *tall.goals[:, 2]], 2.0)
    moved = world.load("flat", dim=3, starts=[[2.0, 4.1, 0.5]], goals=[[8.3, 6.0]])
    assert_allclose(moved.starts, [[2.0, 4.1, 1.25, 0.5]])
    assert_allclose(moved.goals, [[8.3, 6.0, 1.25]])
    with pytest.raises(ValueError, match=r"above starts\[0\] hangs something, below a camera at 3 m"):
        flat.suited(Config(camera_height=3.0))
    with pytest.raises(ValueError, match=r"a body from 0\.1 to 1\.3 m; leave body_low"):
        flat.suited(Config(body_high=0.6))
    with pytest.raises(ValueError, match="3 finite numbers"):
        world.load("flat", dim=3, starts=[[1.0, 2.0]])
    with pytest.raises(ValueError, match="only 1 starts"):
        moved.check_team(2)


@pytest.mark.parametrize("overrule", [{"up": "y"}, {"scale": 2.0}, {"floor": 1.0}, {"building": "x"}])
def test_what_only_meshes_know_is_refused_elsewhere(overrule):
    with pytest.raises(world.SceneError, match="PointNav episodes; leave it out"):
        world.load("flat", **overrule)
    with pytest.raises(TypeError, match="unexpected keyword argument 'flor'"):
        world.load("flat", flor=1.0)


# ---- the ground carved by rays in space -----------------------------------------------------------------------------


def empty():
    return Occupancy.unknown(Lattice((0.0, 0.0), 0.5, (12, 3)))


def looked(known, *rays, origin=(0.25, 0.75, 1.25), config=Config()):  # noqa: B008
    """After looks of one ray each: (x, z, hit) of its end in the middle row."""
    for x, z, hit in rays:
        known = known.carved_around(np.array(origin), np.array([[x, 0.75, z]]), [hit], LOW, HIGH, config)
    return known.state[:, 1].tolist()


def test_a_ray_to_the_floor_clears_the_way_it_runs_low():
    # 1.25 m above the floor, down to it at 5.25 m: below 0.3 m from 4.05 m on; before that nothing else is known
    assert looked(empty(), (5.25, 0.0, True)) == [FREE] * 11 + [UNKNOWN]


def test_a_surface_in_the_bodys_height_blocks_and_others_do_not():
    assert looked(empty(), (3.25, 0.7, True))[6] == OCCUPIED
    assert looked(empty(), (3.25, 2.0, True))[6] == UNKNOWN  # a lintel
    assert looked(empty(), (3.25, 0.05, True))[6] == FREE  # a rug
    assert looked(empty(), (3.25, 0.7, False))[6] == FREE  # in range, and nothing there


def test_a_ray_leaves_the_body_upwards_and_tells_no_more():
    # from 1.25 up to 2.75 m over 5 m: above 1.3 m after 0.17 m, in the first cell
    assert looked(empty(), (5.25, 2.75, True)) == [FREE, *[UNKNOWN] * 11]


def test_a_low_table_is_not_forgotten_when_rays_pass_above_it():
    table = (3.25, 0.4, True)
    above = (5.25, 0.75, True)  # 1 m high over the table
    assert looked(empty(), *[above] * 30, table)[6] == OCCUPIED
    assert looked(empty(), table, *[above] * 200)[6] == OCCUPIED


def test_rays_that_run_below_something_clear_it_only_slowly():
    top, beneath = (3.25, 0.7, True), (3.75, 0.0, True)
    assert looked(empty(), top, *[beneath] * 5)[6] == OCCUPIED
    assert looked(empty(), top, *[beneath] * 25)[6] == FREE  # a false hit need not stay for ever
    faster = Config(evidence_doubt=0.45)
    assert looked(empty(), top, *[beneath] * 4, config=faster)[6] == OCCUPIED
    assert looked(empty(), top, *[beneath] * 5, config=faster)[6] == FREE


def test_what_runs_low_is_the_configs():
    slope = (5.25, 0.0, True)
    known = Occupancy(empty().lattice, np.full((12, 3), 1.0, np.float32))  # where something stood, only low rays count
    states = [looked(known, slope, config=Config(low_ray=low, evidence_doubt=2.0)) for low in (0.15, 0.4, 0.9)]
    # it falls a quarter of a metre a metre: below 0.25 m from 4.25 m on, 0.5 m from 3.25 m on, 1.0 m from 1.25 m on
    assert [state.index(FREE) for state in states] == [8, 6, 2]
    hole = (5.25, -0.2, True)
    assert looked(empty(), hole, config=Config(low_ray=0.25)).count(OCCUPIED) == 1
    assert looked(empty(), hole, config=Config(low_ray=0.35)).count(OCCUPIED) == 0


def test_one_surface_outweighs_any_number_of_clear_looks():
    assert looked(empty(), *[(5.25, 0.0, True)] * 50, (4.75, 0.6, True))[9] == OCCUPIED


def test_splats_block_only_what_no_depth_has_shown():
    known = empty().carved_around(np.array([0.25, 0.75, 1.25]), np.array([[2.25, 0.75, 0.0]]), [True], LOW, HIGH)
    blocked = known.blocked(np.array([[1.25, 0.75, 0.5], [4.25, 0.75, 0.5], [99.0, 0.0, 0.0]]))
    assert blocked.state[2, 1] == FREE and blocked.state[8, 1] == OCCUPIED
    assert (blocked.state != known.state).sum() == 1


def test_looks_around_a_room_agree_with_its_plan(flat):
    """Cells that many looks from many places call occupied hold a surface of the plan, free ones none."""
    ground, camera = Occupancy.unknown(flat.ground.lattice(0.05)), Camera.from_fov(64, 64)
    rng = np.random.default_rng(5)
    _, free = flat.ground.free_grid(0.05, 0.2)
    spots = flat.ground.lattice(0.05).centers(rng.permutation(np.argwhere(free))[:40])
    for x, y in spots:
        for yaw in np.arange(8) * math.pi / 4:
            here = pose(x, y, 1.25, yaw)
            frame = flat.sense(camera, here)
            rays = (camera.rays(here.position) @ here.rotation.T).numpy()
            depth = frame.depth.double().numpy().reshape(-1, 1)
            ground = ground.carved_around(
                here.position.numpy(), here.position.numpy() + depth * rays, depth[:, 0] > 0, LOW, HIGH
            )
    clear = flat.ground.clearance(ground.lattice.centers().reshape(-1, 2)).reshape(ground.lattice.shape)
    inside = flat.ground.inside(ground.lattice.centers().reshape(-1, 2)).reshape(ground.lattice.shape)
    half = 0.05 * math.sqrt(0.5)
    occupied, open_ = (ground.state == OCCUPIED) & inside, ground.state == FREE
    assert occupied.sum() > 300 and open_.sum() > 5000
    assert (clear[occupied] <= half + 1e-6).all()
    # a ray over a table leaves cells open where none has met its top yet; a robot keeps away from those around
    fits = planner.traversable(ground, Config())
    assert fits.sum() > 5000 and (clear[fits] == 0).sum() == 0
    assert (grid.within(occupied, 0.11, 0.05)[inside & (clear > 0) & (clear < 0.04)]).mean() > 0.9


def test_a_ray_that_meets_no_floor_does_not_clear_the_ground_where_it_should_be():
    assert looked(empty(), (5.25, 0.0, False))[10] == UNKNOWN  # a pit


def test_a_ray_that_falls_to_the_storey_below_blocks_the_hole_that_it_fell_through():
    # down to 2.5 m below the floor at 5.25 m: at `low`, 0.1 m above the floor, after 1.15 / 3.75 of 5 m
    state = looked(empty(), (5.25, -2.5, True))
    assert state[3] == OCCUPIED and state[4:] == [UNKNOWN] * 8
    assert state[0] == FREE
