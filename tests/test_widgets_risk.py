"""The explorer of the risk field against Gaussian tails of scipy, one splat after the other."""

import math

import matplotlib as mpl
import numpy as np
import pytest
from scipy import integrate, stats

from mannbv import risk
from mannbv.course import widgets
from mannbv.lab import draw

FIXED = {"orange": (2.5, 1.75), "blue": (1.1, 1.5)}
NAMES = ("orange", "blue", "left", "right")


@pytest.fixture(scope="module")
def explorer():
    return widgets.risk_field()


def shown(explorer, **values):
    """The picture's plane, tail panel and line."""
    (plane, _bar, tail), says = explorer.picture(**explorer.values | values)
    return plane, tail, says


def points(item):
    return np.frombuffer(item["points"], np.float32).reshape(-1, 2)


def lines(panel, **wanted):
    return [i for i in panel["items"] if i["kind"] == "line" and all(i[key] == v for key, v in wanted.items())]


def avar(mean, std, level):
    """The mean below the quantile, by quadrature."""
    quantile = stats.norm.ppf(level)
    tail = integrate.quad(lambda z: z * stats.norm.pdf(z), -12, quantile)[0] / level
    return mean + std * tail


def distances(spots, orange=FIXED["orange"], blue=FIXED["blue"], long=0.4, spread="largest"):
    """Means and standard deviations (k, 4) [m] of the distances from spots (k, 2) to the four splats."""
    away = np.asarray(spots, float)[:, None] - np.array([orange, blue, (0.7, 0.6), (3.5, 2.5)])
    mean = np.linalg.norm(away, axis=-1)
    std = np.tile([max(long, 0.06), 0.12, 0.06, 0.2], (len(mean), 1))
    if spread == "along":
        angle = np.arctan2(away[:, 0, 1], away[:, 0, 0]) - math.radians(35)
        std[:, 0] = np.hypot(long * np.cos(angle), 0.06 * np.sin(angle))
    return mean, std


@pytest.mark.parametrize("spread", ["largest", "along"])
@pytest.mark.parametrize(
    ("measure", "rule"),
    [("avar", avar), ("var", lambda m, s, e: stats.norm.ppf(e, m, s)), ("mean", lambda m, s, e: m)],
)
def test_the_heat_map_and_its_white_line_are_the_field(explorer, measure, rule, spread):
    plane, _, _ = shown(explorer, measure=measure, spread=spread, level=0.05)
    image = next(item for item in plane["items"] if item["kind"] == "image")
    rgba = np.frombuffer(image["rgba"], np.uint8).reshape(*image["shape"], 4)[::-1].astype(int)
    assert image["extent"] == [0, 4, 0, 3] and image["shape"] == [75, 100]
    x, y = np.meshgrid(np.arange(100) * 0.04 + 0.02, np.arange(75) * 0.04 + 0.02)
    mean, std = distances(np.column_stack([x.ravel(), y.ravel()]), spread=spread)
    alpha = rule(mean, std, 0.05).min(1).reshape(75, 100)
    expected = mpl.colormaps["cividis"](np.clip((alpha + 0.5) / 2, 0, 1), bytes=True).astype(int)
    assert (np.abs(rgba - expected).max(-1) <= 3).mean() > 0.995  # one colour up or down
    rims = [points(line) for line in lines(plane, color="white", dash=[])]
    assert (len(rims) > 0) == (alpha.min() <= 0)
    for rim in rims:
        mean, std = distances(rim, spread=spread)
        assert np.abs(rule(mean, std, 0.05).min(1)).max() < 0.03  # less than a cell


@pytest.mark.parametrize("spread", ["largest", "along"])
def test_the_line_names_the_culprit_and_the_nearest_if_that_is_another(explorer, spread):
    others = 0
    for spot in [(1.6, 0.95), (0.2, 2.9), (3.4, 1.6), (2.4, 0.4), (1.0, 1.0), (3.0, 2.2), (1.7, 1.75)]:
        mean, std = (part[0] for part in distances([spot], spread=spread))
        alone = avar(mean, std, 0.1)
        culprit, nearest = int(alone.argmin()), int(mean.argmin())
        plane, _, says = shown(explorer, point=spot, spread=spread)
        expected = f"α = {alone.min():.2f} m, set by the {NAMES[culprit]} splat, "
        assert says.startswith(f"{expected}{mean[culprit]:.2f} m away, σ {std[culprit]:.2f} m")
        centers = [FIXED["orange"], FIXED["blue"], (0.7, 0.6), (3.5, 2.5)]
        (sight,) = [points(line) for line in lines(plane, width=2.5)]
        assert sight == pytest.approx(np.array([spot, centers[culprit]]), abs=1e-6)
        dashed = lines(plane, color="white", dash=[4, 4])
        assert len(dashed) == (culprit != nearest)
        if dashed:
            others += 1
            assert points(dashed[0])[1] == pytest.approx(centers[nearest], abs=1e-6)
            words = f"the {NAMES[nearest]} one at {mean[nearest]:.2f} m, alone gives {alone[nearest]:.2f} m"
            assert says.endswith(words)
    assert others >= 1


@pytest.mark.parametrize("level", [0.001, 0.1, 0.5, 0.9])
@pytest.mark.parametrize("measure", ["avar", "var", "mean"])
def test_the_second_panel_marks_the_tail_of_the_culprit(explorer, level, measure):
    spot = (2.3, 0.9)  # the orange one is nearest and vaguest
    mean, std = (part[0, 0] for part in distances([spot]))
    _, panel, _ = shown(explorer, point=spot, level=level, measure=measure)
    (var,), (worst,) = lines(panel, dash=[5, 3]), lines(panel, color=draw.COLORS[1])
    expected = stats.norm.ppf(level, mean, std), avar(mean, std, level)
    assert (points(var)[0, 0], points(worst)[0, 0]) == pytest.approx(expected, abs=1e-4)
    (dot,) = [points(item)[0] for item in panel["items"] if item["kind"] == "dots"]
    assert dot[0] == pytest.approx({"var": expected[0], "avar": expected[1], "mean": mean}[measure], abs=1e-4)
    (bell,) = [points(line) for line in lines(panel, color="#222222")]
    assert bell[:, 1] == pytest.approx(stats.norm.pdf(bell[:, 0], mean, std) * std * math.sqrt(2 * math.pi), abs=1e-4)
    (tail,) = [points(line) for line in panel["items"] if line["kind"] == "line" and line["fill"]]
    area = np.trapezoid(tail[:, 1], tail[:, 0]) / (std * math.sqrt(2 * math.pi))
    assert area == pytest.approx(level, abs=0.02) and tail[:, 0].max() == pytest.approx(expected[0], abs=1e-4)


def test_a_splat_pushed_on_the_point_turns_the_risk_negative(explorer):
    for spread in ("largest", "along"):  # on a mean every line of sight is one: the worst counts
        _, panel, says = shown(explorer, point=FIXED["orange"], spread=spread, long=0.6, level=0.001)
        assert says.startswith(f"α = {avar(0.0, 0.6, 0.001):.2f} m, set by the orange splat, 0.00 m away, σ 0.60 m")
        assert all(np.isfinite(points(line)).all() for line in lines(panel))


def test_a_longer_splat_is_never_safer_and_the_sharper_sigma_never_more_dangerous(explorer):
    def alpha(**values):
        return float(shown(explorer, **values)[2].split()[2])

    for spot in ((1.6, 0.95), (2.9, 1.2), (2.1, 2.4)):
        by_length = [alpha(point=spot, long=long) for long in (0.06, 0.2, 0.4, 0.6)]
        assert by_length == sorted(by_length, reverse=True)
        assert alpha(point=spot, spread="along") >= alpha(point=spot)


def test_a_measure_of_ones_own_can_be_chosen(monkeypatch):
    monkeypatch.setattr(risk, "MEASURES", dict(risk.MEASURES))
    risk.register("chernoff", lambda mean, std, level: mean - std * math.sqrt(2 * math.log(1 / level)))
    explorer = widgets.risk_field()
    assert explorer.controls["measure"].options[-1] == ("chernoff", "chernoff")
    explorer.move(measure="chernoff", point=(2.5, 1.0))
    assert explorer.says.value.startswith(f"α = {0.75 - 0.4 * math.sqrt(2 * math.log(10)):.2f} m, set by the orange")


def test_the_handles_move_what_they_name(explorer):
    for name in ("point", "orange", "blue"):
        explorer.canvas._handle_custom_msg({"name": name, "x": 9.0, "y": 0.5, "along": None}, [])
        assert explorer.values[name] == (4.0, 0.5)
        handles = {i["name"]: i["at"] for i in explorer.canvas.picture["panels"][0]["items"] if i["kind"] == "handle"}
        assert handles[name] == [4.0, 0.5]
    explorer.move(**{name: setting.value for name, setting in explorer.settings.items()})
