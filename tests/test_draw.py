import dataclasses
import itertools
import math
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
import torch
from helpers import at_goal, box_frame, box_map, camera_for, crowd, random_map
from matplotlib.collections import EllipseCollection, PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Wedge

from mannbv import episode, grid, information, render, risk, world
from mannbv.config import Config
from mannbv.lab import draw, study
from mannbv.lab.draw import team as team_picture

TINY = Config(max_cycles=3, fit_steps=4, image_width=32)


@pytest.fixture(scope="module")
def place():
    return world.load("flat")


@pytest.fixture(scope="module")
def record(place):
    return episode.run(place, "distributed", TINY, 0, 2)


@pytest.fixture(scope="module")
def results(record):
    others = [dataclasses.replace(r, strategy="single", psnr_db=r.psnr_db + 1, bytes_sent=0) for r in record.rows]
    return study.assemble("flat", 2, 2, TINY, [*record.rows, *others])


@pytest.fixture
def ax():
    return draw.figure(4, 3)[1]


# ---- building blocks ----------------------------------------------------------------------------------------------


def test_ellipses_show_two_standard_deviations(ax, rng):
    splat_map = random_map(rng, 40, 2)
    drawn = draw.splats(ax, splat_map)
    assert isinstance(drawn, EllipseCollection)
    np.testing.assert_allclose(drawn.get_offsets(), splat_map.means)
    for k, covariance in enumerate(splat_map.covariances().numpy()):
        turn = math.radians(drawn.get_angles()[k])
        rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
        axes = np.array([drawn.get_widths()[k], drawn.get_heights()[k]]) / 4  # whole width: four deviations
        np.testing.assert_allclose(rotation @ np.diag(axes**2) @ rotation.T, covariance, rtol=1e-6, atol=1e-12)
    colors = drawn.get_facecolors()
    np.testing.assert_allclose(colors[:, :3], splat_map.colors.clamp(0, 1))
    np.testing.assert_allclose(colors[:, 3], splat_map.opacities)


def test_an_empty_map_draws_nothing(ax):
    assert len(draw.splats(ax, random_map(np.random.default_rng(0), 0, 2)).get_offsets()) == 0


def test_splats_in_space_are_seen_from_above(ax, rng):
    splat_map = random_map(rng, 5, 3)
    drawn = draw.splats(ax, splat_map)
    np.testing.assert_allclose(drawn.get_offsets(), splat_map.means[:, :2])
    k = 3
    width = np.sqrt(np.linalg.eigvalsh(splat_map.covariances()[k, :2, :2].numpy()))
    np.testing.assert_allclose(sorted([drawn.get_widths()[k], drawn.get_heights()[k]]), 4 * width)


def test_a_view_opens_around_its_yaw(ax):
    wedge = draw.view(ax, np.array([1.0, 2.0]), math.pi / 2, fov=math.radians(60), length=0.7)
    assert isinstance(wedge, Wedge)
    assert (wedge.theta1, wedge.theta2) == pytest.approx((60, 120))
    assert (*wedge.center, wedge.r) == (1.0, 2.0, 0.7)


def test_a_zone_is_its_balls_and_overlaps_are_no_darker(ax):
    drawn = draw.zone(ax, np.array([[0.0, 0.0], [0.1, 0.0]]), torch.tensor([0.5, 0.6]))
    assert isinstance(drawn, PatchCollection)
    boxes = [path.get_extents().width for path in drawn.get_paths()]
    assert boxes == pytest.approx([1.0, 1.2], rel=1e-3)
    assert drawn.get_facecolor()[0, 3] == 1.0  # opaque


def test_a_risk_field_lies_over_its_cells(ax):
    lattice = grid.Lattice((1.0, -2.0), 0.5, (4, 2))
    field = np.arange(8.0).reshape(4, 2) / 4
    field[3, 1] = np.nan
    field[0, 0] = np.inf  # no splat at all: as safe as it gets
    image = draw.risk(ax, field, lattice)
    assert image.get_extent() == [1.0, 3.0, -2.0, -1.0]
    shown = image.get_array()
    assert shown.shape == (2, 4)
    assert shown[0, 2] == field[2, 0]
    assert shown.mask[1, 3]
    assert shown.mask.sum() == 1
    assert shown[0, 0] == image.get_clim()[1] == field[3, 0]
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_aspect()) == ("x [m]", "y [m]", 1.0)
    assert image.origin == "lower"


def test_the_ground_tells_unknown_free_and_occupied_apart(ax):
    lattice = grid.Lattice((0.0, 0.0), 1.0, (3, 1))
    image = draw.ground(ax, grid.Occupancy(lattice, np.array([[0.0], [-1.0], [2.0]], np.float32)))
    colors = image.cmap(image.norm(image.get_array()))[0]
    assert len({tuple(color) for color in colors}) == 3
    assert tuple(colors[1]) == (1.0, 1.0, 1.0, 1.0)


def test_a_plan_shows_every_surface_in_its_colour(ax, place):
    lines = draw.plan(ax, place)
    np.testing.assert_allclose(lines.get_segments(), place.seen.ends.reshape(-1, 2, 2))
    np.testing.assert_allclose(lines.get_colors()[:, :3], place.seen.colors)
    assert ax.get_xlim()[0] < place.seen.lower[0]
    assert ax.get_xlim()[1] > place.seen.upper[0]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x [m]", "y [m]")


def test_a_path_is_its_waypoints(ax):
    waypoints = np.array([[0.0, 1.0], [2.0, 3.0]])
    np.testing.assert_array_equal(draw.path(ax, waypoints).get_xydata(), waypoints)


def test_a_profile_marks_its_best_yaw(ax, rng):
    splat_map, camera = box_map(rng), camera_for(2, 32)
    profile = information.yaw_profile(splat_map, camera, torch.tensor([1.0, 1.0]), torch.ones(splat_map.n_splats, 9))
    line = draw.profile(ax, profile, label="mine")
    np.testing.assert_array_equal(line.get_ydata(), profile.gains)
    mark = ax.lines[-1].get_xydata()[0]
    assert tuple(mark) == (profile.best, profile.gains.max())
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("yaw [rad]", "information gain [1]")
    assert [text.get_text() for text in ax.get_xticklabels()][::2] == ["−π", "0", "π"]


def test_a_strip_shows_colours_and_depth(ax, rng):
    camera = camera_for(2, 32)
    frame = box_frame(camera, [1.0, 1.0], 0.3)
    depth = frame.depth.clone()
    depth[5] = 0.0
    line = draw.strip(ax, dataclasses.replace(frame, depth=depth))
    assert np.isnan(line.get_ydata()[5])
    np.testing.assert_allclose(np.delete(line.get_ydata(), 5), np.delete(depth.numpy(), 5))
    np.testing.assert_allclose(line.get_xdata(), np.arange(32) + 0.5)
    np.testing.assert_allclose(ax.child_axes[0].images[0].get_array()[0], frame.color)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("pixel [px]", "depth [m]")
    drawn = render.render(box_map(rng, dtype=torch.float32), camera, frame.pose)
    assert len(draw.strip(draw.figure()[1], drawn).get_ydata()) == 32


# ---- figures ------------------------------------------------------------------------------------------------------


def axes_named(made: Figure, word: str) -> list:
    return [ax for ax in made.axes if word in ax.get_title(loc="left")]


def test_a_team_figure_shows_what_each_robot_believes_and_chose(record, place):
    made = draw.team_figure(record, place)
    snapshot = study.snapshot(record)
    tops = axes_named(made, "robot ")
    assert [ax.get_title(loc="left").split(":")[0] for ax in tops] == ["robot 0", "robot 1"]
    for robot, top in zip(snapshot.robots, tops, strict=True):
        image = top.images[0]
        shown = image.get_array()
        np.testing.assert_array_equal(~np.ma.getmaskarray(shown).T, np.isfinite(robot.risk))
        below = made.axes[made.axes.index(top) + (2 if robot.index == 0 else 1)]
        shapes = [c for c in below.collections if isinstance(c, EllipseCollection)]
        assert sum(len(c.get_offsets()) for c in shapes) == robot.belief.splats.n_splats
        selected = int(robot.zone.selected.sum())
        assert sorted(len(c.get_offsets()) for c in shapes) == sorted([selected, len(robot.zone.selected) - selected])
        (wedge,) = (patch for patch in below.patches if isinstance(patch, Wedge))
        middle = math.radians((wedge.theta1 + wedge.theta2) / 2)
        assert math.cos(middle - robot.chosen) == pytest.approx(1.0)
        np.testing.assert_allclose(wedge.center, robot.view)
        balls = next(c for c in below.collections if isinstance(c, PatchCollection))
        assert len(balls.get_paths()) == len(robot.path)
        rays = [line for line in below.lines if np.allclose(line.get_xydata()[0], robot.view)]
        assert len(rays) >= len(robot.suggestions)
    labels = [ax.get_ylabel() for ax in made.axes]
    assert "α, AV@R distance [m]" in labels
    assert "straight distance [m]" in labels
    texts = [text.get_text() for text in made.texts]
    assert any("as planned in cycle" in text and "on the maps and with the risk of the end" in text for text in texts)
    (legend,) = made.legends
    assert "masked zone, Eq. (11)" in [text.get_text() for text in legend.get_texts()]


def test_the_plan_panel_shows_trails_starts_and_goals(record, place):
    (ax,) = axes_named(draw.team_figure(record, place), "Ways taken")
    drawn = [line.get_xydata() for line in ax.lines]
    for robot in record.robots:
        assert any(line.shape == robot.trail.shape and np.allclose(line, robot.trail) for line in drawn)
        assert any(len(line) == 1 and np.allclose(line[0], robot.goal) for line in drawn)
        assert any(len(line) == 1 and np.allclose(line[0], robot.trail[0]) for line in drawn)


def test_another_level_of_risk_can_be_shown(record, place):
    def shown(config):
        made = draw.team_figure(record, place, config, cycle=0)
        return axes_named(made, "robot 0")[0].images[0].get_array()

    assert shown(TINY.replace(level=0.01)).mean() < shown(None).mean()


def test_a_comparison_shows_every_strategys_scores(results, record, place):
    made = draw.compare_figure(results, record, place)
    (ax,) = axes_named(made, "PSNR")
    assert [text.get_text() for text in axes_named(made, "AV@R, true")[0].get_yticklabels()] == [
        "distributed",
        "single",
    ]
    means = sorted(line.get_xdata()[0] for line in ax.lines if line.get_marker() == "D")
    assert means == pytest.approx(sorted(means["psnr_db"].mean for means in results.summary.values()))
    assert ax.get_xlabel() == "[dB]"
    (sent,) = axes_named(made, "sent by a robot")
    assert sent.get_xscale() == "symlog"
    assert sent.get_xlabel() == "[B]"
    (longer,) = axes_named(made, "path overhead")  # nobody is at the goal after three cycles
    assert [text.get_text() for text in longer.texts] == ["none", "none"]
    assert any("dots robots" in text.get_text() for text in made.texts)


def test_intervals_are_drawn_and_cut_at_the_edge(results, record, place):
    rows = [
        dataclasses.replace(r, seed=seed, psnr_db=r.psnr_db + (3.0 if r.strategy == "single" else 0.1) * seed)
        for r in results.rows
        for seed in (0, 1, 2)
    ]
    several = study.assemble("flat", 2, 2, TINY, rows)
    made = draw.compare_figure(several, record, place)
    (ax,) = axes_named(made, "PSNR")
    low, high = several.summary["distributed"]["psnr_db"].interval
    bars = [line.get_xdata() for line in ax.lines if len(line.get_xdata()) == 2 and line.get_marker() == "None"]
    assert any(np.allclose(bar, [low, high]) for bar in bars)
    arrows = [line for line in ax.lines if line.get_marker() in "<>"]
    for arrow in arrows:
        assert arrow.get_xdata()[0] in ax.get_xlim()
    assert any("dots seeds, bars 95 % intervals" in text.get_text() for text in made.texts)


@pytest.mark.parametrize("n_robots", [1, 2, 5, 7, 10])
def test_nothing_overlaps_or_leaves_the_page(n_robots, record, results, place):
    team = crowd(record, n_robots)
    for made in (draw.team_figure(team, place), draw.compare_figure(results, team, place)):
        made.draw_without_rendering()
        page = made.bbox
        boxes = [ax.get_tightbbox() for ax in made.axes]
        boxes += [thing.get_window_extent() for thing in (*made.legends, *made.texts)]
        for box in boxes:
            assert page.x0 <= box.x0
            assert box.x1 <= page.x1
            assert page.y0 <= box.y0
            assert box.y1 <= page.y1
        for one, other in itertools.combinations(boxes, 2):
            width = min(one.x1, other.x1) - max(one.x0, other.x0)
            height = min(one.y1, other.y1) - max(one.y0, other.y0)
            assert min(width, height) <= 1, (one, other)


def test_windows_keep_their_shape_and_hold_everything(record, place):
    whole = team_picture.explored(record, place)
    for robot in record.robots:
        assert (robot.trail >= whole.lower).all()
        assert (robot.trail <= whole.upper).all()
    for robot in study.snapshot(record).robots:
        near = team_picture.closeup(robot, 0.5)
        assert near.aspect == pytest.approx(0.5)
        assert (robot.path >= near.lower).all()
        assert (robot.path <= near.upper).all()
    assert team_picture.Window(np.zeros(2), np.array([4.0, 1.0])).shaped(1.0).size.tolist() == [4.0, 4.0]


def test_a_robot_that_is_at_its_goal_has_a_panel_too(record, place):
    cycles = at_goal(record.cycles[0], 1, suggestions=()), *record.cycles[1:]
    made = draw.team_figure(dataclasses.replace(record, cycles=cycles), place, cycle=0)
    assert len(axes_named(made, "robot ")) == 2


# ---- files --------------------------------------------------------------------------------------------------------


def test_saved_figures_are_the_same_to_the_byte(tmp_path, place):
    def made():
        canvas, ax = draw.figure(3, 2)
        draw.plan(ax, place)
        return canvas

    for kind in ("png", "svg"):
        one, two = (draw.save(made(), tmp_path / f"{k}" / f"a.{kind}").read_bytes() for k in (1, 2))
        assert one == two
    assert ElementTree.fromstring(one).tag.endswith("svg")
    with pytest.raises(ValueError, match=r"a\.pdf: a figure is written as \.png or \.svg"):
        draw.save(made(), tmp_path / "a.pdf")


def test_figures_leave_no_state_behind(tmp_path):
    code = (
        "import matplotlib, sys; from mannbv.lab import draw;"
        "state = lambda: {k: matplotlib.rcParams[k] for k in matplotlib.rcParams if k != 'backend'}; before = state();"
        f"f, ax = draw.figure(2, 2); draw.path(ax, [[0, 0], [1, 1]]); draw.save(f, {str(tmp_path / 'a.png')!r});"
        "print('matplotlib.pyplot' in sys.modules, before == state())"
    )
    said = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.split() == ["False", "True"]


def test_robots_have_colours_of_their_own():
    assert len({draw.robot_color(k) for k in range(10)}) == 10
    assert draw.robot_color(np.int64(10)) == draw.robot_color(0)


def test_the_risk_that_is_drawn_is_the_field(record):
    robot = study.snapshot(record).robots[0]
    lattice = robot.belief.ground.lattice
    cells = np.argwhere(np.isfinite(robot.risk))[::97]
    expected = risk.field(robot.belief.splats, torch.from_numpy(lattice.centers(cells)), TINY.level)
    np.testing.assert_allclose(robot.risk[tuple(cells.T)], expected, atol=1e-6)
