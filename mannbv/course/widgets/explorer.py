"""An explorer: a picture that a function makes of some settings, redrawn whenever a hand changes one."""

from collections.abc import Callable, Mapping

import ipywidgets

from mannbv.course.widgets.canvas import Canvas
from mannbv.course.widgets.settings import Choice, Control, Point, Range, Setting, Turn

_CAPTION = {"min_height": "1.6em", "margin": "4px 0 0 4px"}


class Explorer(ipywidgets.VBox):
    """Controls, a canvas and a line of numbers below it.

    picture: a function of all settings by name that returns (panels, a line of text); it holds no state, so that the
    same settings always show the same. settings: name → `Range`, `Choice`, `Switch`, `Point` or `Turn`; handles on the
    canvas carry the name of the setting they move. size: (width, height) of the canvas [px].
    """

    def __init__(
        self,
        picture: Callable[..., tuple[list[dict], str]],
        settings: Mapping[str, Setting],
        size: tuple[int, int] = (860, 380),
    ):
        self.picture, self.settings = picture, dict(settings)
        self.values = {name: setting.value for name, setting in settings.items()}
        self.canvas = Canvas(size=list(size))
        self.says = ipywidgets.Label(layout=_CAPTION)
        self.controls = {name: s.control() for name, s in settings.items() if isinstance(s, Control)}
        self._draw()
        for name, control in self.controls.items():
            control.observe(lambda change, name=name: self.move(**{name: change.new}), "value")
        self.canvas.on_move(self._moved)
        again = ipywidgets.Button(
            description="start over", tooltip="every setting as it was", layout={"width": "6.5em"}
        )
        again.on_click(lambda _button: self.move(**{name: setting.value for name, setting in self.settings.items()}))
        row = ipywidgets.HBox([*self._shown(), again], layout={"flex_flow": "row wrap", "grid_gap": "4px 16px"})
        super().__init__([row, self.canvas, self.says])

    def move(self, **values: object) -> None:
        """Set some settings, as a hand would. Raises ValueError for one that is not here, or no option."""
        unknown = values.keys() - self.values.keys()
        if unknown:
            raise ValueError(f"no setting {', '.join(sorted(unknown))} here; there are {', '.join(self.values)}")
        for name, value in values.items():
            setting = self.settings[name]
            if isinstance(setting, Choice) and value not in setting.sweep():
                raise ValueError(f"{name}: {value!r} is none of {setting.sweep()}")
        changed = any(self.values[name] != value for name, value in values.items())
        self.values |= values
        for name in values.keys() & self.controls.keys():
            self.controls[name].value = values[name]  # comes back here as no change
        if changed:
            self._draw()

    def _shown(self) -> list[ipywidgets.Widget]:
        shown = []
        for name, control in self.controls.items():
            setting = self.settings[name]
            button = setting.button() if isinstance(setting, Range) else None
            if button is not None:
                ipywidgets.jslink((button, "value"), (control, "value"))
                shown.append(button)
            shown.append(control)
        return shown

    def _moved(self, move: dict) -> None:
        setting = self.settings[move["name"]]
        x, y, along = move["x"], move["y"], move["along"]
        if along:
            assert isinstance(setting, (Range, Turn))
            value = setting.slid(move[along])
        else:
            assert isinstance(setting, (Point, Turn))
            value = setting.moved(x, y, self.values)
        step = self.canvas.picture["step"]
        self.move(**{move["name"]: value})
        if self.canvas.picture["step"] == step:  # nothing changed, but the browser waits for an answer
            self.canvas.draw(self.canvas.picture["panels"], self.says.value)

    def _draw(self) -> None:
        try:
            panels, says = self.picture(**self.values)
        except ValueError as error:  # an impossible setting: the last picture stays
            panels, says = self.canvas.picture.get("panels", []), str(error)
        self.says.value = says
        self.canvas.draw(panels, says)

    def __repr__(self) -> str:
        return f"an explorer of {', '.join(self.values)}: run this cell to move it"
