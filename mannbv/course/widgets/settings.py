"""What a hand can set in an explorer: numbers, choices, switches, places and directions, each with its range."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import ipywidgets
import numpy as np
import traitlets

_LOOK = {"style": {"description_width": "initial"}}


class _Play(ipywidgets.Play):
    value = traitlets.CFloat(0.0).tag(sync=True)  # a whole one would pull a scrubbed slider back


@dataclass(frozen=True)
class Range:
    """A number from `low` to `high` on a slider, whole if all four are; `log`: even steps of its logarithm.

    live: moves while the slider is held; false for slow pictures. play: [ms] a step of a play button, if there is one.
    """

    label: str
    low: int | float
    high: int | float
    value: int | float
    step: int | float = 1
    log: bool = False
    live: bool = True
    play: int | None = None

    def control(self) -> ipywidgets.Widget:
        """The slider."""
        options = {"value": self.value, "step": self.step, "description": self.label, "continuous_update": self.live}
        options |= _LOOK | {"layout": {"width": "340px"}}
        if self.log:
            bounds = {"min": math.log10(self.low), "max": math.log10(self.high)}
            return ipywidgets.FloatLogSlider(**bounds, readout_format=".3r", **options)
        kind = ipywidgets.IntSlider if self._whole else ipywidgets.FloatSlider
        return kind(min=self.low, max=self.high, **options)

    def button(self) -> ipywidgets.Widget | None:
        """The play button, to be linked with the slider."""
        if not self.play:
            return None
        return _Play(value=self.value, min=self.low, max=self.high, interval=self.play)

    def slid(self, along: float) -> int | float:
        """The value when a handle was slid to `along`."""
        near = min(max(along, self.low), self.high)
        return round(near) if self._whole else near

    def sweep(self) -> list:
        """Values from end to end, for tests."""
        if self._whole:
            low, high = int(self.low), int(self.high)
            return sorted({*range(low, high + 1, max(1, (high - low) // 12)), high})
        return [float(value) for value in (np.geomspace if self.log else np.linspace)(self.low, self.high, 7)]

    @property
    def _whole(self) -> bool:
        return all(isinstance(number, int) for number in (self.low, self.high, self.value, self.step))


@dataclass(frozen=True)
class Choice:
    """One of some options: a list, or a mapping from what is shown to what is meant."""

    label: str
    options: tuple | Mapping
    value: object

    def control(self) -> ipywidgets.Widget:
        """The drop-down list."""
        options = list(self.options.items()) if isinstance(self.options, Mapping) else list(self.options)
        layout = {"width": "max-content"}
        return ipywidgets.Dropdown(options=options, value=self.value, description=self.label, layout=layout, **_LOOK)

    def sweep(self) -> list:
        """Every option."""
        return list(self.options.values() if isinstance(self.options, Mapping) else self.options)


@dataclass(frozen=True)
class Switch:
    """Yes or no."""

    label: str
    value: bool = False

    def control(self) -> ipywidgets.Widget:
        """The box to tick."""
        return ipywidgets.Checkbox(
            value=self.value, description=self.label, indent=False, layout={"width": "max-content"}
        )

    def sweep(self) -> list:
        """Both."""
        return [False, True]


@dataclass(frozen=True)
class Point:
    """A point of the plane within [low, high], (2,) [m] each: a handle on the canvas, no control beside it."""

    value: tuple
    low: tuple
    high: tuple

    def moved(self, x: float, y: float, values: Mapping) -> tuple:
        """The value when the handle is at (x, y)."""
        return tuple(float(v) for v in np.clip((x, y), self.low, self.high))

    def sweep(self) -> list:
        """A lattice of places, corners included."""
        across, up = (np.linspace(a, b, 4) for a, b in zip(self.low, self.high, strict=True))
        return [(float(x), float(y)) for x in across for y in up]


@dataclass(frozen=True)
class Turn:
    """A direction in [−π, π) [rad] about the place of the setting `about`: a handle on the canvas."""

    value: int | float
    about: str

    def moved(self, x: float, y: float, values: Mapping) -> float:
        """The direction from the place `about` to (x, y)."""
        cx, cy = values[self.about]
        return math.atan2(y - cy, x - cx)

    def slid(self, along: float) -> float:
        """The value when a handle was slid to `along` on an axis of angles."""
        return along

    def sweep(self) -> list:
        """All around."""
        return [float(angle) for angle in np.linspace(-math.pi, math.pi, 9)]


Control = Range | Choice | Switch  # what has a control beside the canvas
Setting = Control | Point | Turn
