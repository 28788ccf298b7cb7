"""Explorers: every setting over its whole range, what stands on the canvas, and how a hand's moves arrive."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import torch
from helpers import random_map

from mannbv import grid
from mannbv.course import widgets
from mannbv.course.widgets import Explorer, items
from mannbv.course.widgets.settings import Choice, Point, Range, Switch, Turn

ROOT = Path(__file__).parent.parent
EXPLORERS = [name for name in widgets.__all__ if name != "Explorer"]
KINDS = {
    "image": {"rgba", "shape", "extent"},
    "ellipses": {"shapes", "rgba", "edge", "width"},
    "line": {"points", "color", "width", "dash", "fill", "strength"},
    "dots": {"points", "color", "size", "edge"},
    "text": {"at", "text", "color", "align"},
    "handle": {"name", "at", "label", "color", "about", "along"},
}


@pytest.fixture(scope="module")
def explorer_of():
    """Each explorer, made once."""
    made = {}
    return lambda name: made.setdefault(name, getattr(widgets, name)())


def plain(value):
    """The picture without its bytes, which must be as long as their shape says."""
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, dict):
        return {key: plain(part) for key, part in value.items()}
    return [plain(part) for part in value] if isinstance(value, (list, tuple)) else value


def look(explorer: Explorer, **values) -> list[dict]:
    """The panels for some settings, checked: known kinds, finite numbers, boxes on the canvas, handles in reach."""
    panels, says = explorer.picture(**explorer.values | values)
    assert isinstance(says, str) and says and not re.search(r"\bnan\b", says)
    width, height = explorer.canvas.size
    for panel in panels:
        left, top, across, down = panel["box"]
        assert left >= 0 and top >= 0 and left + across <= width and top + down <= height
        assert panel["x"][0] < panel["x"][1] and panel["y"][0] < panel["y"][1]
        for item in panel["items"]:
            assert item.keys() - {"kind"} == KINDS[item["kind"]]
            if item["kind"] == "handle":
                assert item["name"] in explorer.settings and item["label"]
                assert panel["x"][0] <= item["at"][0] <= panel["x"][1]
                assert panel["y"][0] <= item["at"][1] <= panel["y"][1]
    json.dumps(plain(panels), allow_nan=False)  # what the browser gets: a nan here would be no JSON
    return panels


@pytest.mark.parametrize("name", EXPLORERS)
def test_every_setting_over_its_whole_range(name, explorer_of):
    explorer = explorer_of(name)
    for setting, kind in explorer.settings.items():
        for value in kind.sweep():
            assert look(explorer, **{setting: value}), f"{setting} = {value}: an empty canvas"


@pytest.mark.parametrize("name", EXPLORERS)
def test_settings_in_any_combination(name, explorer_of, rng):
    explorer = explorer_of(name)
    for _ in range(12):
        values = {}
        for setting, kind in explorer.settings.items():
            sweep = kind.sweep()
            values[setting] = sweep[rng.integers(len(sweep))]
        assert look(explorer, **values), f"{values}: an empty canvas"


@pytest.mark.parametrize("name", EXPLORERS)
def test_the_same_settings_show_the_same_picture_and_each_setting_another_one(name, explorer_of):
    explorer = explorer_of(name)
    first = plain(look(explorer))
    for setting, kind in explorer.settings.items():
        assert any(plain(look(explorer, **{setting: value})) != first for value in kind.sweep()), setting
    assert plain(look(explorer)) == first


@pytest.mark.parametrize("name", EXPLORERS)
def test_what_has_no_control_has_a_handle(name, explorer_of):
    explorer = explorer_of(name)
    handles = {item["name"] for panel in look(explorer) for item in panel["items"] if item["kind"] == "handle"}
    assert handles | explorer.controls.keys() == explorer.settings.keys()


def test_each_explorer_is_on_the_page_of_all_and_in_a_notebook_of_the_course():
    cells = {}
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        notebook = json.loads(path.read_text(encoding="utf-8"))
        found = [c for c in notebook["cells"] if "explorer" in c["metadata"].get("tags", ())]
        assert all("nbval-ignore-output" in c["metadata"]["tags"] for c in found), path.name
        cells[path.stem] = re.findall(
            r"^widgets\.(\w+)\(", "\n".join("".join(c["source"]) for c in found), re.MULTILINE
        )
    everything = cells.pop("explore")
    assert sorted(everything) == sorted(EXPLORERS)
    assert {name for names in cells.values() for name in names} == set(EXPLORERS)


# ---- the explorer itself


def picture(number, open_, kind, place, turn):
    if number < 0:
        raise ValueError("below zero: take a larger number")
    here = items.handle("place", place, "the place")
    there = items.handle("turn", (place[0] + math.cos(turn), place[1] + math.sin(turn)), "its heading", about=place)
    along = items.handle("number", (number, 0), "the number", along="x")
    return [items.panel((60, 30, 300, 200), (-5, 5), (-5, 5), [here, there, along])], f"{number} {open_} {kind}"


SETTINGS = {
    "number": Range("number [1]", -2.0, 4.0, 1.0, 0.5),
    "open_": Switch("open"),
    "kind": Choice("kind", {"one": 1, "two": 2}, 1),
    "place": Point((1.0, 0.0), (-2, -2), (2, 2)),
    "turn": Turn(0.0, "place"),
}


@pytest.fixture
def toy():
    return Explorer(picture, SETTINGS)


def moved(explorer, name, x, y, along=None):
    """A message as canvas.js sends it."""
    explorer.canvas._handle_custom_msg({"name": name, "x": x, "y": y, "along": along}, [])


def test_a_control_redraws(toy):
    step = toy.canvas.picture["step"]
    toy.controls["number"].value = 2.0
    assert toy.values["number"] == 2.0 and toy.says.value == "2.0 False 1" and toy.canvas.picture["step"] == step + 1
    toy.controls["kind"].value = 2
    assert toy.says.value == "2.0 False 2"


def test_a_dragged_handle_sets_its_setting_and_is_always_answered(toy):
    moved(toy, "place", 1.5, 9.0)
    assert toy.values["place"] == (1.5, 2.0)  # clipped
    moved(toy, "turn", 1.5, 3.0)
    assert math.isclose(toy.values["turn"], math.pi / 2)
    moved(toy, "number", 3.0, 0.0, along="x")
    assert toy.values["number"] == 3.0 == toy.controls["number"].value
    moved(toy, "number", 9.0, 0.0, along="x")
    assert toy.values["number"] == 4.0  # not past its end
    moved(toy, "number", 3.0, 0.0, along="x")
    step = toy.canvas.picture["step"]
    moved(toy, "number", 3.0, 0.0, along="x")  # nothing new, yet the browser waits
    assert toy.canvas.picture["step"] == step + 1


def test_an_impossible_setting_says_so_and_keeps_the_picture(toy):
    before = toy.canvas.picture["panels"]
    toy.controls["number"].value = -1.0
    assert toy.says.value == "below zero: take a larger number" and toy.canvas.picture["panels"] == before


def test_start_over_and_unknown_settings(toy):
    toy.move(number=3.0, open_=True, place=(0.0, 0.0))
    assert toy.controls["open_"].value is True
    toy.children[0].children[-1].click()
    assert toy.values == {name: setting.value for name, setting in SETTINGS.items()}
    assert toy.controls["number"].value == 1.0 and toy.says.value == "1.0 False 1"
    with pytest.raises(ValueError, match=r"no setting volume here; there are number, open_"):
        toy.move(volume=3)
    with pytest.raises(ValueError, match=r"kind: 7 is none of \[1, 2\]"):
        toy.move(kind=7)
    assert toy.values["kind"] == 1


def test_its_text_has_no_address(toy):
    assert repr(toy) == "an explorer of number, open_, kind, place, turn: run this cell to move it"


@pytest.mark.parametrize(
    ("setting", "ends"),
    [
        (Range("n", 0, 50, 3), (0, 50)),
        (Range("x", 0.0, 1.0, 0.5, 0.1), (0.0, 1.0)),
        (Range("ε", 0.001, 1.0, 0.1, 0.1, log=True), (0.001, 1.0)),
    ],
)
def test_a_sweep_reaches_both_ends_and_the_slider_too(setting, ends):
    sweep, slider = setting.sweep(), setting.control()
    assert (sweep[0], sweep[-1]) == pytest.approx(ends) and sweep == sorted(sweep)
    bounds = (10**slider.min, 10**slider.max) if setting.log else (slider.min, slider.max)
    assert bounds == pytest.approx(ends) and slider.value == setting.value


def test_a_whole_number_stays_whole_when_its_handle_is_slid():
    assert [Range("n", 0, 5, 2).slid(along) for along in (-1.0, 2.6, 9.0)] == [0, 3, 5]


# ---- items


def test_splats_are_ellipses_at_two_standard_deviations(rng):
    splat_map = random_map(rng, 6, 2)
    item = items.splats(splat_map)
    shapes = np.frombuffer(item["shapes"], np.float32).reshape(-1, 5).astype(float)
    inverse = torch.linalg.inv(splat_map.covariances().double()).numpy()
    for (x, y, a, b, angle), mean, precision in zip(shapes, splat_map.means.numpy(), inverse, strict=True):
        assert np.allclose((x, y), mean, atol=1e-6)
        for t in np.linspace(0, 6, 7):
            u, v = a * math.cos(t), b * math.sin(t)
            away = np.array([u * math.cos(angle) - v * math.sin(angle), u * math.sin(angle) + v * math.cos(angle)])
            assert math.isclose(away @ precision @ away, 4.0, rel_tol=1e-4)


def test_a_heat_map_has_its_first_row_at_the_bottom_and_marks_what_is_missing():
    item = items.heat(
        [[0.0, 1.0], [math.nan, 0.5]], (0, 2, 0, 2), 0, 1, colors=["#000000", "#ffffff"], missing="#ff0000"
    )
    rgba = np.frombuffer(item["rgba"], np.uint8).reshape(*item["shape"], 4)  # as the browser gets it: top row first
    assert rgba[1, 0].tolist() == [0, 0, 0, 255] and rgba[1, 1].tolist() == [255, 255, 255, 255]
    assert rgba[0, 0].tolist() == [255, 0, 0, 255]


def test_cells_lie_where_the_lattice_has_them():
    lattice = grid.Lattice(origin=(1.0, -1.0), shape=(3, 2), cell=0.5)
    values = np.zeros((3, 2))
    values[2, 0] = 1.0  # the last along x, the first along y: right and at the bottom
    item = items.cells(values, lattice, 0, 1, colors=["#000000", "#ffffff"])
    rgba = np.frombuffer(item["rgba"], np.uint8).reshape(2, 3, 4)
    assert item["extent"] == [1.0, 2.5, -1.0, 0.0]
    assert np.argwhere(rgba[..., 0] == 255).tolist() == [[1, 2]]


def test_a_view_is_as_wide_as_its_field_of_view():
    points = np.frombuffer(items.view((1.0, 2.0), math.pi / 2, fov=1.0, length=2.0)["points"], np.float32).reshape(
        -1, 2
    )
    away = points[1:-1] - [1.0, 2.0]
    assert np.allclose(np.linalg.norm(away, axis=1), 2.0, atol=1e-6)
    bearing = np.arctan2(away[:, 1], away[:, 0])
    assert np.allclose((bearing.min(), bearing.max()), (math.pi / 2 - 0.5, math.pi / 2 + 0.5), atol=1e-6)


def test_the_browser_knows_every_kind_of_item():
    script = (ROOT / "mannbv" / "course" / "widgets" / "canvas.js").read_text(encoding="utf-8")
    table = script[script.index("const paint = {") : script.index("function axes(")]
    assert set(re.findall(r"^  (\w+)\(", table, flags=re.MULTILINE)) == KINDS.keys()
