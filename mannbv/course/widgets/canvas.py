"""The canvas that explorers draw on, in the browser: Python sends panels of items, the browser sends moved handles."""

from collections.abc import Callable
from pathlib import Path

import anywidget
import traitlets


class Canvas(anywidget.AnyWidget):
    """Panels on a canvas of `size` (width, height) [px]; handles on it can be dragged, or moved by the arrow keys.

    picture: {"panels": […], "says": a line for screen readers, "step": a number that grows}. Panels and items are
    those of `widgets.items`.
    """

    _esm = Path(__file__).with_name("canvas.js")
    size = traitlets.List([860, 380]).tag(sync=True)
    picture = traitlets.Dict({}).tag(sync=True)

    def draw(self, panels: list[dict], says: str = "") -> None:
        """Show panels in place of what is there, in one stroke."""
        self.picture = {"panels": panels, "says": says, "step": self.picture.get("step", 0) + 1}

    def on_move(self, callback: Callable[[dict], None]) -> None:
        """Call callback({"name", "x", "y", "along"}) whenever a handle was moved, x and y in its panel's units."""
        self.on_msg(lambda _canvas, move, _buffers: callback(move))
