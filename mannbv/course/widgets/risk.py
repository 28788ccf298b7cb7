"""Risk field: how dangerous every place is, and which splat makes it so (Eqs. (6)-(9))."""

import math

import contourpy
import numpy as np
import torch

from mannbv import grid, risk
from mannbv.course.widgets import items
from mannbv.course.widgets.explorer import Explorer
from mannbv.course.widgets.settings import Choice, Point, Range
from mannbv.lab import draw
from mannbv.lab.draw.canvas import INK, PALE
from mannbv.splats import SplatMap

_LOW, _HIGH = (0.0, 0.0), (4.0, 3.0)  # [m]
_LATTICE = grid.Lattice.around(_LOW, _HIGH, 0.04)
_POINTS = torch.from_numpy(_LATTICE.centers().reshape(-1, 2))
_BAR = (-0.5, 1.5)  # α [m] of the darkest and of the brightest colour
_NAMES = ("orange", "blue", "left", "right")
_FIXED, _THIN, _TILT = [(0.7, 0.6), (3.5, 2.5)], 0.06, math.radians(35)
_MEASURES = {"avar": "AV@R", "var": "V@R"}  # a measure of the reader's own keeps its name
_SPREADS = {"its largest σ": "largest", "σ along the line of sight": "along"}
_ONE_SIGMA = 0.5 * math.erfc(math.sqrt(0.5))  # the level whose V@R lies one standard deviation below the mean


def risk_field() -> Explorer:
    """Drag a point and two splats: α there, the splat that sets it, and the tail of its distance."""
    return Explorer(
        _picture,
        {
            "point": Point((1.6, 0.95), _LOW, _HIGH),
            "orange": Point((2.5, 1.75), _LOW, _HIGH),
            "blue": Point((1.1, 1.5), _LOW, _HIGH),
            "long": Range("orange: long σ [m]", 0.06, 0.6, 0.4, 0.01),
            "level": Range("level ε [1]", 0.001, 0.9, 0.1, 0.05, log=True),
            "measure": Choice("measure:", {_MEASURES.get(name, name): name for name in risk.MEASURES}, "avar"),
            "spread": Choice("a splat's σ is", _SPREADS, "largest"),
        },
    )


def _room(orange, blue, long) -> SplatMap:
    """The orange splat, long and thin; the blue one and two grey ones, round."""
    scales = [[long, _THIN], [0.12, 0.12], [0.06, 0.06], [0.2, 0.2]]
    turned = [[math.cos(_TILT), math.sin(_TILT)], *[[1.0, 0.0]] * 3]
    colors = [[0.84, 0.37, 0.0], [0.0, 0.45, 0.7], *[[0.6] * 3] * 2]
    parts = [orange, blue, *_FIXED], np.log(scales), turned, [2.0] * 4, colors
    return SplatMap(*(torch.tensor(np.array(part, float)) for part in parts))


def _picture(point, orange, blue, long, level, measure, spread):
    room, here = _room(orange, blue, long), torch.tensor([point], dtype=torch.float64)
    options = {"level": level, "measure": measure, "spread": spread}
    field = risk.field(room, _POINTS, **options).numpy().reshape(_LATTICE.shape)
    alpha = risk.field(room, here, **options).item()

    def each(**options):
        """What every splat alone would make of the point."""
        return np.array([risk.field(room.select([k]), here, **options).item() for k in range(room.n_splats)])

    mean, alone = each(measure="mean"), each(**options)
    std = mean - each(measure="var", level=_ONE_SIGMA, spread=spread)
    culprit, nearest = int(alone.argmin()), int(mean.argmin())
    says = f"α = {alpha:.2f} m, set by the {_NAMES[culprit]} splat, {mean[culprit]:.2f} m away, σ {std[culprit]:.2f} m"
    if culprit != nearest:
        says += f"; the nearest, the {_NAMES[nearest]} one at {mean[nearest]:.2f} m, alone gives {alone[nearest]:.2f} m"
    plane = _plane(room, field, point, culprit, nearest)
    tail = _tail([(mean[k], std[k]) for k in dict.fromkeys((culprit, nearest))], level, alpha)
    return [plane, items.color_bar((522, 30, 12, 300), *_BAR, "α [m]"), tail], says


def _plane(room, field, point, culprit, nearest):
    """The field, its line α = 0, the splats, and lines from the point to the culprit and to the nearest."""
    x, y = _LATTICE.centers().transpose(2, 0, 1)
    rims = contourpy.contour_generator(x, y, field).lines(0.0)
    means = room.means.numpy()
    sights = [items.line([point, means[nearest]], "white", 1.5, (4, 4))] * (nearest != culprit)
    return items.plan(
        (55, 30, 400, 300), _LOW, _HIGH,
        [
            items.cells(field, _LATTICE, *_BAR),
            items.splats(room, 0.6, edge=INK),
            *(items.line(np.asarray(rim), "white", 1.5) for rim in rims),
            *sights,
            items.line([point, means[culprit]], draw.COLORS[1], 2.5),
            items.handle("orange", means[0], "the orange splat", draw.COLORS[1]),
            items.handle("blue", means[1], "the blue splat", draw.COLORS[0]),
            items.handle("point", point, "the point", INK),
        ],
        title="the risk field: white line α = 0, orange line to the culprit",
    )  # fmt: skip


def _tail(gaussians, level, alpha):
    """The distance to the culprit and, if it is another, to the nearest splat, as Eq. (8) takes them."""
    (mean, std), *other = gaussians
    z = np.linspace(-1.0, 3.0, 401)

    def bell(z, mean, std):
        return np.exp(-0.5 * ((z - mean) / std) ** 2)

    var, avar = risk.value_at_risk(mean, std, level), risk.average_value_at_risk(mean, std, level)
    worst = np.append(z[z < var], var)
    tail = np.vstack([[z[0], 0.0], np.column_stack([worst, bell(worst, mean, std)]), [var, 0.0]])
    marks = [
        items.line([[0, 0], [0, 1.2]], PALE, 1.0),
        items.text((-0.08, 1.13), "contact", PALE, "right"),
        items.line(tail, None, fill=draw.COLORS[1], strength=0.4),
        *(items.curve(z, bell(z, *gaussian), PALE) for gaussian in other),
        items.curve(z, bell(z, mean, std), INK),
        items.line([[var, 0], [var, 1.1]], draw.COLORS[0], dash=(5, 3)),
        items.line([[avar, 0], [avar, 1.1]], draw.COLORS[1]),
        items.dots([[alpha, 0.04]], INK, 9),
    ]
    legend = [("V@R", draw.COLORS[0], "dash"), ("AV@R", draw.COLORS[1], "line"), ("α", INK, "dot")]
    return items.panel(
        (612, 48, 233, 282), (-1, 3), (0, 1.2), marks, title="the culprit's distance", xlabel="distance [m]",
        ylabel="density, 1 at its peak", xticks=[[k, str(k).replace("-", "−")] for k in range(-1, 4)],
        legend=legend + [("nearest", PALE, "line")] * bool(other),
    )  # fmt: skip
