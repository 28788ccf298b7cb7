"""The paper's figures show what records and ledgers hold, in the plane and in space."""

import dataclasses
import itertools
import math

import matplotlib as mpl
import numpy as np
import pytest
import torch
from helpers import at_goal, crowd
from matplotlib.collections import EllipseCollection, LineCollection, PatchCollection
from matplotlib.colors import to_hex
from matplotlib.patches import Wedge

from mannbv import episode, world
from mannbv.config import PRESETS
from mannbv.lab import draw, report, study
from mannbv.lab.draw.canvas import PALE
from mannbv.lab.draw.paper import proposals
from mannbv.team import SuggestionLog

NAMES = ("centralized", "limited", "distributed")
SMALL = {"max_cycles": 3, "fit_steps": 4, "image_width": 32, "image_height": 32}


@pytest.fixture(scope="module", params=[2, 3])
def records(request):
    """Three strategies of two robots; the last cycle with a view suggested by each to the other."""
    dim = request.param
    place, config = world.load("flat", dim=dim), PRESETS[dim]["quick"].replace(**SMALL)
    made = {name: episode.run(place, name, config, 0, 2) for name in NAMES}
    return {name: suggesting(record) for name, record in made.items()}


def suggesting(record):
    views = {1: (SuggestionLog(0, 1, 0.5, 30.0), SuggestionLog(1, 0, -2.0, 20.0))}
    return with_suggestions(record, views)


def with_suggestions(record, views: dict):
    """The record with other suggestions in some of its cycles."""
    cycles = (dataclasses.replace(log, suggestions=views.get(log.cycle, log.suggestions)) for log in record.cycles)
    return dataclasses.replace(record, cycles=tuple(cycles))


def titled(made, word: str) -> list:
    return [ax for ax in made.axes if word in ax.get_title(loc="left")]


def ellipses(ax) -> list[EllipseCollection]:
    return [c for c in ax.collections if isinstance(c, EllipseCollection)]


def by_color(drawn: EllipseCollection) -> dict[str, int]:
    """How many ellipses there are of each colour."""
    names, counts = np.unique([to_hex(color) for color in drawn.get_facecolors()], return_counts=True)
    written = {color.lower(): color for color in (*draw.COLORS, PALE)}
    return {written[name]: int(n) for name, n in zip(names, counts, strict=True)}


def in_body(splat_map, robot, config) -> np.ndarray:
    """The splats between ankle and head of a robot, opaque enough; in the plane all of them."""
    above = splat_map.means[:, 2:].numpy() - (robot.position[2:] - config.camera_height)
    there = ((above >= config.body_low) & (above <= config.body_high)).all(1)
    return there & (splat_map.opacities.numpy() >= config.risk_opacity)


# ---- what they show -------------------------------------------------------------------------------------------------


def test_the_overview_tells_one_cycle_with_the_ledgers_bytes(records):
    record = records["distributed"]
    made = draw.overview_figure(record, 1)
    words = [text.get_text() for ax in made.axes for text in ax.texts] + [text.get_text() for text in made.texts]
    for k in (0, 1):
        for place, verb in ((0, "sends"), (1, "receives")):
            rows = [n for key, (_, n) in record.ledger.rows.items() if key[4] == 1 and key[place] == k]
            assert f"{verb} {report.digits(sum(rows) / 1000)} KB" in words
    (said,) = (text for text in words if "copies of the team's yaws" in text)
    plans = sum(n for key, (_, n) in record.ledger.rows.items() if key[3:] == ("Plan", 1))
    assert f"plans (path, view, yaw) {report.digits(plans / 1000)} KB" in said
    assert "no splat, no image" in said
    for k, robot in enumerate(record.robots):
        (ax,) = titled(made, f"robot {k}: {record.cycles[1].robots[k].splats:,} splats")
        held = robot.local.splats.select(torch.arange(record.cycles[1].robots[k].splats))
        assert sum(len(c.get_offsets()) for c in ellipses(ax)) == in_body(held, robot, record.config).sum() > 0
    wedges = [patch for ax in made.axes for patch in ax.patches if isinstance(patch, Wedge)]
    for wedge, log in zip(wedges, record.cycles[1].robots, strict=True):
        middle = math.radians((wedge.theta1 + wedge.theta2) / 2)
        assert math.cos(middle - log.chosen) == pytest.approx(1.0)
        np.testing.assert_allclose(wedge.center, log.view[:2])


def test_what_limited_sharing_sends_is_named(records):
    made = draw.overview_figure(records["limited"], 1)
    words = "\n".join(text.get_text() for ax in made.axes for text in ax.texts)
    assert "splats" in words
    assert "no splat, no image" not in words


def test_splats_in_the_mask_are_coloured_by_their_weight(records):
    record = records["distributed"]
    made = draw.mask_figure(record, 1)
    (ax,) = titled(made, "path, mask and weights")
    robot = study.snapshot(record, 1).robots[0]
    zone, splat_map = robot.zone, robot.belief.splats
    shown = in_body(splat_map, record.robots[0], record.config)
    inside = shown & zone.selected.numpy()
    assert 0 < inside.sum() < shown.sum()
    grey, coloured = ellipses(ax)
    assert len(grey.get_offsets()) == (shown & ~inside).sum()
    expected = mpl.colormaps["viridis"](zone.weights.numpy()[inside] / record.config.gamma1)[:, :3]
    np.testing.assert_allclose(coloured.get_facecolors()[:, :3], expected, atol=1e-6)
    np.testing.assert_allclose(coloured.get_offsets(), splat_map.means.numpy()[inside, :2])
    balls = next(c for c in ax.collections if isinstance(c, PatchCollection))
    assert len(balls.get_paths()) == len(robot.path)
    assert any(axis.get_ylabel() == "weight v of a splat, Eq. (13) [1]" for axis in made.axes)


def test_each_robot_proposes_a_view_for_itself_and_one_for_its_teammate(records):
    record = records["distributed"]
    made = draw.mask_figure(record, 1)
    logs = record.cycles[1].robots
    for me, mate, yaw, gain in ((0, 1, 0.5, 30), (1, 0, -2.0, 20)):
        (ax,) = titled(made, f"robot {me}'s own map and views; gain for robot {mate}: {gain}")
        own, other = (patch for patch in ax.patches if isinstance(patch, Wedge))
        for wedge, place, angle in ((own, logs[me].view, logs[me].announced), (other, logs[mate].view, yaw)):
            np.testing.assert_allclose(wedge.center, place[:2])
            assert math.cos(math.radians((wedge.theta1 + wedge.theta2) / 2) - angle) == pytest.approx(1.0)
        assert other.get_hatch()
        assert not own.get_hatch()


def test_a_telling_cycle_has_views_suggested_both_ways(records):
    record = records["distributed"]
    assert proposals.cycle_and_pair(record, 1) == (1, 0, 1)
    record = with_suggestions(record, {0: (), 1: (SuggestionLog(1, 0, 0.1, 5.0),), 2: ()})
    assert proposals.cycle_and_pair(record) == (1, 1, 0)
    first, second, *rest = record.cycles  # robot 1 still suggests a view, but plans no more
    record = dataclasses.replace(record, cycles=(first, at_goal(second, 1), *rest))
    with pytest.raises(ValueError, match="no robot suggests a view; give a distributed or limited run"):
        draw.mask_figure(record)


def test_growth_shows_ever_more_splats_and_the_bytes_of_the_ledger(records):
    record = records["centralized"]
    made = draw.growth_figure(record)
    each = 14 * 4 if record.robots[0].local.splats.dim > 2 else 10 * 4
    for cycle, log in enumerate(record.cycles):
        counts = [robot.splats for robot in log.robots]
        size = report.digits(sum(counts) * each / 2**20)
        (ax,) = titled(made, f"cycle {cycle + 1}: {sum(counts):,} splats\none uplink {size} MiB")
        held = [
            in_body(robot.local.splats.select(torch.arange(count)), robot, record.config).sum()
            for robot, count in zip(record.robots, counts, strict=True)
        ]
        (drawn,) = ellipses(ax)
        assert by_color(drawn) == {draw.robot_color(k): n for k, n in enumerate(held)}
        widest = np.maximum(drawn.get_widths(), drawn.get_heights())
        assert (np.diff(widest) <= 1e-6).all() or record.robots[0].local.splats.dim > 2  # small ones on top
    (ax,) = titled(made, "Bytes of the whole team")
    really, paper = (line.get_ydata() for line in ax.lines)
    assert really[-1] == pytest.approx(record.ledger.total() / 1e6)
    assert paper[-1] == pytest.approx(record.ledger.paper_total("centralized") / 1e6)
    (sizes,) = titled(made, "Size of the global map")
    (right,) = sizes.child_axes
    made.draw_without_rendering()
    assert right.get_ylim()[1] == pytest.approx(sizes.get_ylim()[1] * each / 2**20)


def test_sharing_shows_what_each_robot_was_sent(records):
    central, limited = records["centralized"], records["limited"]
    made = draw.sharing_figure(central, limited)
    for record in (central, limited):
        for k, robot in enumerate(record.robots):
            own, guests = robot.local.splats, robot.guests.splats
            (ax,) = titled(made, f"robot {k}: {own.n_splats:,} own splats, {guests.n_splats:,} received")
            expected = {PALE: own, draw.robot_color(1 - k): guests}
            counts = {color: in_body(part, robot, record.config).sum() for color, part in expected.items()}
            assert by_color(*ellipses(ax)) == {color: n for color, n in counts.items() if n}
            assert guests.n_splats or record is limited
    (ax,) = titled(made, "What is shared")
    for line, record in zip(ax.lines, (central, limited), strict=True):
        assert line.get_ydata().sum() == pytest.approx(record.ledger.paper_total(record.strategy) / 1e6)


def test_beliefs_have_a_risk_field_and_a_map_a_robot(records):
    made = draw.beliefs_figure(records["limited"], 1)
    robots = study.snapshot(records["limited"], 1).robots
    tops = titled(made, "robot ")
    for robot, top in zip(robots, tops, strict=True):
        shown = top.images[0].get_array()
        np.testing.assert_array_equal(~np.ma.getmaskarray(shown).T, np.isfinite(robot.risk))


def test_the_plan_of_a_space_is_that_of_its_ground(records):
    dim = records["limited"].robots[0].local.splats.dim
    place = world.load("flat", dim=dim)
    made = draw.team_figure(records["limited"], place, cycle=1)
    (ax,) = titled(made, "Ways taken")
    walls = next(c for c in ax.collections if isinstance(c, LineCollection))
    np.testing.assert_allclose(walls.get_segments(), place.ground.walls.ends.reshape(-1, 2, 2))
    for robot in records["limited"].robots:
        assert any(np.array_equal(line.get_xydata(), robot.trail[:, :2]) for line in ax.lines)
    said = any("From above: splats 0.1 to 1.3 m over the floor" in text.get_text() for text in made.texts)
    assert said == (dim > 2)


@pytest.mark.parametrize("n_robots", [1, 2, 5, 7])
def test_nothing_overlaps_or_leaves_the_page(records, n_robots):
    team = {name: crowd(record, n_robots) for name, record in records.items()}
    figures = [draw.overview_figure(team["distributed"], 1), draw.growth_figure(team["centralized"])]
    figures += [draw.sharing_figure(team["centralized"], team["limited"]), draw.beliefs_figure(team["limited"], 1)]
    figures += [draw.mask_figure(team["distributed"], 1)] if n_robots > 1 else []
    for made in figures:
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


# ---- which record serves which figure -------------------------------------------------------------------------------


@pytest.fixture
def files(records, tmp_path):
    """Run files of two and, as it were, five robots."""
    found = []
    for name, record in records.items():
        for n_robots in (2, 5):
            path = tmp_path / f"{name}-{n_robots}.npz"
            (record if n_robots == 2 else crowd(record, n_robots)).save(path)
            found.append(path)
    return found


def test_every_figure_takes_the_team_that_the_paper_shows(files, records):
    dim = records["limited"].robots[0].local.splats.dim
    drawn = {name: (figure, why) for name, figure, why in draw.paper_figures(files)}
    assert list(drawn) == [f"{name}-flat-{dim}d" for name, *_ in draw.paper.FIGURES]
    assert all(figure is not None and why == "" for figure, why in drawn.values())
    said = {name.split("-")[0]: " ".join(t.get_text() for t in figure.texts) for name, (figure, _) in drawn.items()}
    assert "2 robots" in said["figure1"]  # two are as near to three as five are not
    assert "5 robots" in said["figure3"]
    assert "5 robots" in said["figure4"]
    assert "2 robots" in said["figure5"]


def test_what_cannot_be_drawn_says_why(files, tmp_path):
    (tmp_path / "torn.npz").write_bytes(files[0].read_bytes()[:100])
    chosen = [tmp_path / "torn.npz", *(file for file in files if file.name.startswith(("centralized-2", "limited-5")))]
    drawn = {name.split("-")[0]: (figure, why) for name, figure, why in draw.paper_figures(chosen)}
    assert "not a whole record" in drawn["torn.npz"][1]
    assert drawn["figure1"] == (None, "needs runs of one team: distributed; add them with compare")
    assert drawn["figure5"][1] == "needs runs of one team: centralized and limited; add them with compare"
    assert [name for name, (figure, _) in drawn.items() if figure is not None] == ["figure3", "figure4"]
