"""Explorers in a real browser: headless Chromium opens JupyterLab and Voilà, moves them, sees the picture change."""

import json
import shutil
from importlib.util import find_spec

import browser
import pytest

NOTEBOOKS = browser.ROOT / "notebooks"


def explorers(name: str) -> list[int]:
    """The places of a notebook's explorer cells."""
    cells = json.loads((NOTEBOOKS / name).read_text(encoding="utf-8"))["cells"]
    return [number for number, cell in enumerate(cells) if "explorer" in cell["metadata"].get("tags", ())]


EVERYTHING = "explore.ipynb"
TAUGHT = [path.name for path in sorted(NOTEBOOKS.glob("[0-9]*.ipynb")) if explorers(path.name)]

pytestmark = pytest.mark.skipif(
    not browser.CHROMIUM or find_spec("playwright") is None, reason="no Chromium with playwright on this machine"
)


@pytest.fixture(scope="module")
def page():
    with browser.chromium() as page:
        yield page


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """JupyterLab on a copy of the notebooks."""
    home = tmp_path_factory.mktemp("lab")
    shutil.copytree(NOTEBOOKS, home / "notebooks")
    with browser.served([*browser.LAB, f"--ServerApp.root_dir={home / 'notebooks'}"], home / "home") as address:
        yield address


@pytest.mark.parametrize("name", TAUGHT)
def test_in_jupyterlab_an_explorer_is_moved_and_its_picture_changes(name, lab, page):
    browser.open_lab(page, lab, name, explorers(name)[0])
    found = browser.boxes(page)
    assert len(found) == 1
    before = browser.pixels(found[0])
    print(f"{browser.move(found[0], 7):.0f} ms a step")  # to the right once more than back
    assert browser.pixels(found[0]) != before


def test_under_voila_all_explorers_stand_on_one_page_without_code_and_move(tmp_path, page):
    with browser.served([*browser.VOILA, str(NOTEBOOKS / EVERYTHING)], tmp_path / "home") as address:
        page.goto(address)
        browser.wait(lambda: len(browser.boxes(page)) == len(explorers(EVERYTHING)), browser.RUN, "every explorer")
        assert page.locator("text=from mannbv import").count() == 0
        for box in browser.boxes(page):
            print(f"{browser.move(box):.0f} ms a step")


def test_a_handle_is_dragged_by_the_mouse(tmp_path, page):
    with browser.served([*browser.VOILA, str(NOTEBOOKS / EVERYTHING)], tmp_path / "home") as address:
        page.goto(address)
        page.wait_for_selector(browser.BOX, timeout=1000 * browser.RUN)
        box = browser.boxes(page)[0]
        start = browser.middle(box)
        print(f"{browser.drag(page, box):.0f} ms a step")
        assert browser.middle(box) == pytest.approx((start[0] + 40, start[1] + 24), abs=3)


def test_a_picture_that_does_not_change_is_noticed(page):
    page.set_content('<div class="mannbv-canvas" data-step="1"><canvas></canvas></div>')
    (box,) = browser.boxes(page)
    with pytest.raises(TimeoutError, match="the explorer to answer"):
        browser.changed(box, [lambda: None], patience=0.5)
    with pytest.raises(TimeoutError, match="1 moves, and the picture is the same"):
        browser.changed(box, [lambda: box.evaluate("box => { box.dataset.step = 2; }")])
