"""The explorer of messages: its account against messages that a team really sends, its picture against the account."""

import math

import numpy as np
import pytest

from mannbv import episode, messages, network, team, world
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.course import widgets
from mannbv.course.widgets.traffic import cycle_ledger, size_of

CONFIG = Config(image_width=32, fit_steps=2, n_yaws=36, n_subgoals=1, rounds=4)
ASKED = {"graph": "complete", "robots": 5, "splats": 400, "rounds": 30, "waypoints": 20, "codec": "binary"}


@pytest.fixture(scope="module")
def started():
    """Three robots that have looked around, on a line: 0 and 2 hear each other through 1 only."""
    flat = episode.draw_team(world.load("flat"), 3, 0, CONFIG)
    camera = Camera.of_dim(2, CONFIG.image_width, CONFIG.image_height, CONFIG.fov)
    mission = team.Mission(flat, camera, CONFIG, network.build("line", 3), "distributed", 0)
    return mission, [
        team.start(k, flat.starts[k, :2], float(flat.starts[k, 2]), flat.goals[k], mission) for k in range(3)
    ]


@pytest.mark.parametrize("strategy", ["distributed", "limited", "centralized"])
def test_the_account_lists_the_messages_that_a_team_sends(started, strategy):
    mission, robots = started
    post = messages.Mailbox("binary", network=mission.network)
    mission = team.Mission(mission.world, mission.camera, CONFIG, mission.network, strategy, 0)
    _, log = team.cycle(robots, mission, post, 0)
    rounds = len(log.residuals)
    ours = cycle_ledger(strategy, "line", 3, 500, rounds, 20, "binary")

    assert {key: row[0] for key, row in ours.rows.items()} == {key: row[0] for key, row in post.ledger.rows.items()}


@pytest.mark.parametrize("robots", [2, 5, 10])
def test_binary_bytes_are_those_of_the_layouts(robots):
    sums = cycle_ledger("limited", **ASKED | {"robots": robots}).by_kind()
    pairs = robots * (robots - 1)
    assert sums["Plan"] == pairs * (46 + 8 * 20) and sums["Suggestion"] == pairs * 44
    assert sums["Copies"] == 30 * pairs * (18 + 8 * robots)
    assert sums["Splats"] == pairs * (31 + 112 * 400)  # mean, scale, turn, opacity, colour, prior: 27 numbers; id


def test_letters_pay_for_every_link_of_their_way_and_news_to_all_do_not():
    ring = cycle_ledger("limited", **ASKED | {"graph": "ring", "robots": 6, "rounds": 0})
    complete = cycle_ledger("limited", **ASKED | {"robots": 6, "rounds": 0})
    assert ring.by_kind()["Plan"] == complete.by_kind()["Plan"]
    assert ring.by_kind()["Splats"] * 30 == complete.by_kind()["Splats"] * 6 * (1 + 1 + 2 + 2 + 3)


def test_nothing_but_splats_and_grids_grows_with_the_map_and_guests_are_four_hundred():
    talking = ("distributed", "limited", "centralized")
    few, many = ({name: cycle_ledger(name, **ASKED | {"splats": n}).total() for name in talking} for n in (400, 4000))
    assert few["distributed"] == many["distributed"] and few["limited"] == many["limited"]
    assert many["centralized"] - few["centralized"] == 20 * 3600 * 112


# ---- the picture ----------------------------------------------------------------------------------------------------


def points(item) -> np.ndarray:
    return np.frombuffer(item["points"], np.float32).reshape(-1, 2)


def pictured(**values):
    explorer = widgets.messages()
    explorer.move(**values)
    team_panel, bars = explorer.canvas.picture["panels"]
    return team_panel, bars, explorer.says.value


def ends(bars) -> dict:
    """(row, binary) → bytes where a bar ends."""
    names = dict(bars["yticks"])
    found = {}
    for item in bars["items"]:
        if item["kind"] == "line" and item["color"] and len(points(item)) == 5:
            middle = points(item)[:, 1].mean()
            found[names[round(middle)], middle < round(middle)] = 10 ** points(item)[:, 0].max()
    return found


def test_a_bar_ends_at_the_bytes_of_its_kind_and_codec():
    values = {"strategy": "limited", "graph": "star", "robots": 4, "splats": 1000.0, "rounds": 7, "waypoints": 3}
    _, bars, says = pictured(**values)
    found = ends(bars)
    for codec in messages.CODECS:
        ledger = cycle_ledger(**values | {"splats": 1000}, codec=codec)
        sums = ledger.by_kind() | {"all": ledger.total()}
        for kind, n_bytes in sums.items():
            assert found.pop((kind, codec == "binary")) == pytest.approx(n_bytes / 4, rel=1e-4)
        assert size_of(ledger.total() / 4) in says
    assert not found  # and no other bar


def test_dashed_lines_stand_at_the_papers_numbers():
    _, bars, _ = pictured(robots=7, splats=1000.0)
    dashed = [10 ** points(item)[0, 0] for item in bars["items"] if item["kind"] == "line" and item["dash"]]
    assert dashed == pytest.approx([136, 6 * 25_000, 56_000], rel=1e-4)


def test_a_link_is_thicker_by_as_much_for_every_tenfold_and_the_hub_of_a_star_sends_most():
    panel, _, _ = pictured(graph="star", robots=5, strategy="limited")
    ledger = cycle_ledger("limited", "star", 5, 1000, 30, 20, "json")
    lines = (item for item in panel["items"] if item["kind"] == "line" and len(points(item)) == 2)
    links = [item for item in lines if np.any(np.all(points(item) == 0, axis=1))]  # the hub stands at the origin
    carried = [sum(n for link, n in ledger.by_link().items() if set(link) == {0, k}) for k in range(1, 5)]
    assert [item["width"] for item in links] == pytest.approx([1 + 2.5 * math.log10(n / 1000) for n in carried])
    words = [item["text"] for item in panel["items"] if item["kind"] == "text"]
    assert size_of(ledger.sent_by(0)) in words and size_of(ledger.sent_by(1)) in words
    assert ledger.sent_by(0) > 4 * ledger.sent_by(1)


def test_extremes_stay_on_the_axis_and_silence_is_named():
    _, bars, _ = pictured(strategy="centralized", robots=10, splats=30_000.0)
    assert all(10 ** bars["x"][0] < n < 10 ** bars["x"][1] for n in ends(bars).values())
    _, bars, says = pictured(rounds=0, robots=2, graph="ring")
    assert ("Copies", True) not in ends(bars) and "in 4 messages" in says
    assert [item["text"] for item in bars["items"] if item["kind"] == "text"].count("none") == 3


@pytest.mark.parametrize(
    ("n_bytes", "words"),
    [(0, "0 B"), (136, "136 B"), (999.4, "999 B"), (999.6, "1 kB"), (8032, "8.03 kB"), (2.5e7, "25 MB")],
)
def test_sizes_in_words(n_bytes, words):
    assert size_of(n_bytes) == words
