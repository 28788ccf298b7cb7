"""A real browser for tests: headless Chromium on JupyterLab or Voilà, with the explorers on it."""

import os
import shutil
import socket
import statistics
import subprocess
import sys
import time
import urllib.error
import urllib.request
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parent.parent
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
START, RUN, MOVE = 90, 180, 20  # [s] a server, all cells of a notebook, one step of an explorer
BOX = ".mannbv-canvas"
LAB = [
    "jupyterlab",
    "--LabApp.expose_app_in_browser=True",
    "--ServerApp.allow_root=True",
    "--IdentityProvider.token=",
    "--ServerApp.disable_check_xsrf=True",
]
# started before a move, it stops when the explorer has drawn its next picture
STOPWATCH = """box => {
    const start = performance.now();
    box.took = null;
    const watch = new MutationObserver(() => { watch.disconnect(); box.took = performance.now() - start; });
    watch.observe(box, { attributes: true, attributeFilter: ["data-step"] });
}"""
VOILA = ["voila", "--Voila.ip=127.0.0.1"]


def free_port() -> int:
    """A port of this machine that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextmanager
def served(what: list[str], home: Path):
    """Run `python -m what` on a free port, its settings under `home`; gives the address, stops it at the end."""
    address = f"http://127.0.0.1:{(port := free_port())}"
    settings = home / "lab" / "user-settings" / "@jupyterlab" / "apputils-extension"
    settings.mkdir(parents=True)
    (settings / "notification.jupyterlab-settings").write_text('{"fetchNews": "false", "checkForUpdates": false}')
    places = {"JUPYTER_CONFIG_DIR": home, "JUPYTER_RUNTIME_DIR": home / "runtime", "IPYTHONDIR": home / "ipython"}
    places |= {
        "JUPYTERLAB_SETTINGS_DIR": home / "lab" / "user-settings",
        "JUPYTERLAB_WORKSPACES_DIR": home / "workspaces",
    }
    command = [sys.executable, "-m", *what, "--no-browser", f"--port={port}"]
    with open(home / "server.log", "wb") as log:
        server = subprocess.Popen(
            command, stdout=log, stderr=log, env=os.environ | {k: str(v) for k, v in places.items()}
        )
        try:
            wait(lambda: answers(address) or server.poll() is not None, START, "the server to answer")
            if server.poll() is not None:
                raise RuntimeError(f"the server stopped: {(home / 'server.log').read_text()[-2000:]}")
            yield address
        finally:
            server.terminate()
            server.wait(20)


def answers(address: str) -> bool:
    """Whether somebody speaks HTTP there."""
    try:
        urllib.request.urlopen(address, timeout=5).close()
    except urllib.error.HTTPError:
        return True
    except OSError:
        return False
    return True


def wait(true, seconds: float, what: str):
    """Poll until true() is truthy, and return it. Raises TimeoutError that says what was waited for."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if value := true():
            return value
        time.sleep(0.05)
    raise TimeoutError(f"waited {seconds} s for {what}")


@contextmanager
def chromium():
    """A page of headless Chromium."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1400, "height": 1000})
        try:
            yield page
        finally:
            browser.close()


def open_lab(page, address: str, notebook: str, cell: int) -> None:
    """Open a notebook in JupyterLab, run all of its cells, and bring a cell into view."""
    kernel = "window.jupyterapp?.shell?.currentWidget?.sessionContext?.session?.kernel?.status"
    page.goto(f"{address}/lab/tree/{notebook}?reset")
    wait(lambda: page.evaluate(kernel) == "idle", START, "the kernel")
    page.evaluate("window.jupyterapp.commands.execute('notebook:run-all-cells')")
    # cells out of sight are not on the page
    page.evaluate("cell => window.jupyterapp.shell.currentWidget.content.scrollToItem(cell, 'start')", cell)
    page.wait_for_selector(BOX, timeout=1000 * RUN)
    wait(lambda: page.evaluate(kernel) == "idle", RUN, "all cells to run")


def boxes(page) -> list:
    """The canvases of the explorers in view, from top to bottom."""
    return page.locator(BOX).all()


def move(box, times: int = 8) -> float:
    """Nudge an explorer's first handle, or its first slider if it has none, by the keyboard; gives the median [ms]."""
    handle = box.locator("[data-handle]")
    if not handle.count():
        handle = box.locator("xpath=ancestor::*[contains(@class, 'widget-vbox')][1]").locator(".noUi-handle")
    handle = handle.first
    handle.focus()
    return changed(box, [lambda key=key: handle.press(f"Arrow{key}") for key in ("Right", "Left") * times][:times])


def middle(box) -> tuple[float, float]:
    """Where an explorer's first handle lies on the page [px]."""
    place = box.locator("[data-handle]").first.bounding_box()
    return place["x"] + place["width"] / 2, place["y"] + place["height"] / 2


def drag(page, box, steps: int = 8) -> float:
    """Drag an explorer's first handle by the mouse; gives the median [ms] a step."""
    x, y = middle(box)
    page.mouse.move(x, y)
    page.mouse.down()
    taken = changed(box, [lambda k=k: page.mouse.move(x + 5 * k, y + 3 * k) for k in range(1, steps + 1)])
    page.mouse.up()
    return taken


def changed(box, acts, patience: float = MOVE) -> float:
    """Do some acts, each answered by a picture, one of them at least another one; gives the median [ms] to draw it."""
    before, after, taken = pixels(box), set(), []
    for act in acts:
        box.evaluate(STOPWATCH)
        act()
        taken.append(wait(lambda: box.evaluate("box => box.took"), patience, "the explorer to answer"))
        after.add(pixels(box))
    if after <= {before}:
        raise TimeoutError(f"{len(acts)} moves, and the picture is the same")
    return statistics.median(taken)


def pixels(box) -> str:
    """The picture as the browser has it."""
    return box.evaluate("box => box.querySelector('canvas').toDataURL()")
