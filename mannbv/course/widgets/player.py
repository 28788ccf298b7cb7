"""Player: an episode to wind to and fro, with what each robot knows, plans and chooses in a cycle (Section VI-A)."""

import functools
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from mannbv import episode, planner, risk
from mannbv.config import Config
from mannbv.course.widgets import items
from mannbv.course.widgets.explorer import Explorer
from mannbv.course.widgets.playback import Playback
from mannbv.course.widgets.settings import Choice, Point, Range
from mannbv.episode import Record
from mannbv.lab import draw
from mannbv.lab.draw.canvas import INK, PALE
from mannbv.world import World

_LAYERS = ("true plan", "ground it knows", "its splats", "risk on its map")
_TEAM = Config(image_width=48, fit_steps=12, n_yaws=120, max_cycles=20)


def player(record: Record | Sequence[Record] | str | Path | None = None, place: World | None = None) -> Explorer:
    """Play an episode: everybody's way so far, and of one robot the plan, the chosen view and the map behind it.

    record: an `episode.Record`, a file of one, or the records after every cycle, as `progress` of `episode.run` is
    given them. A single record holds maps of its end only, and these are then shown in every cycle. By default a team
    of three is run once, some seconds. place: the World, where `world.load` does not know the scene by its name.

    In a cycle the map is the one planned on; the ground includes what was seen on the move after it.
    """
    playback = _small_team() if record is None else Playback(record, place)
    lower, upper = playback.place.seen.lower[:2], playback.place.seen.upper[:2]
    middle = playback.log(0, 0).position[:2]
    return Explorer(
        lambda **values: _picture(playback, **values),
        {
            "cycle": Range("cycle", 0, len(playback.cycles), 0.0, 0.05, play=700),
            "robot": Choice("robot", tuple(range(playback.last.n_robots)), 0),
            "layer": Choice("shown", _LAYERS, "its splats"),
            "chart": Choice("over time", tuple(playback.measures), next(iter(playback.measures))),
            "probe": Point((middle[0] + 0.6, middle[1] + 0.3), tuple(lower), tuple(upper)),
        },
        size=(860, 385),
    )


@functools.cache
def _small_team() -> Playback:
    print("Three robots drive through the flat once; that takes some seconds.")
    kept = []
    episode.run("flat", "distributed", _TEAM, n_robots=3, progress=kept.append)
    playback = Playback(kept)
    for name in playback.measures:
        playback.measured(name)
    return playback


def _picture(playback: Playback, cycle, robot, layer, chart, probe):
    time, number = cycle, min(int(cycle + 1e-6), len(playback.cycles) - 1)  # sliders add up 0.05
    log, belief, config = playback.log(number, robot), playback.belief(number, robot), playback.last.config
    spot = planner.raised(np.array(probe)[None], playback.last.robots[robot].position[2:])
    alpha = float(risk.field(belief.splats, torch.from_numpy(spot), config.level, config.measure, config.spread)[0])
    clear = float(playback.place.ground.clearance(spot)[0])
    panels = [
        _place(playback, time, number, robot, layer, probe, alpha, clear),
        chart_panel(playback, time, robot, chart),
    ]
    if layer == "risk on its map":
        panels.append(items.color_bar((505, 75, 12, 250), *_scale(playback), "α [m]"))
    says = f"cycle {number}, robot {robot} {log.status}, {log.splats} splats"
    says += f" and {log.guests} of others" if log.guests else ""
    if log.path:
        chosen, alone = (round(math.degrees(yaw)) for yaw in (log.chosen, log.announced))
        whose = "" if playback.kept else " on its last map"
        says += f"; α on its way {playback.way_risk(number, robot):.2f} m{whose}; looks along {chosen}°, alone {alone}°"
    return panels, f"{says}; probe: α {alpha:.2f} m, true distance {clear:.2f} m"


def _scale(playback: Playback) -> tuple[float, float]:
    """The range of α [m] that the colours show, the same in every cycle."""
    fields = [playback.field(len(playback.cycles) - 1, k) for k in range(playback.last.n_robots)]
    known = np.concatenate([field[np.isfinite(field)] for field in fields])
    return min(0.0, float(np.quantile(known, 0.01))), float(np.quantile(known, 0.995))


def team_items(playback: Playback, time: float, cycle: int, robot: int) -> list[dict]:
    """Everybody's way, place and goal at a time; of one robot the plan, the agreed view and the one it announced."""
    shown, log, color = [], playback.log(cycle, robot), draw.robot_color(robot)
    for k in range(playback.last.n_robots):
        trail, here, yaw = playback.stand(time, k)
        goal, own = playback.last.robots[k].goal, draw.robot_color(k)
        shown += [items.line(trail, own, 2.4), items.text(goal, "★", own), items.view(here, yaw, length=0.6, color=own)]
        shown += [items.dots(here, own, 17, edge="#ffffff"), items.text(here, str(k), "#ffffff")]
    if log.view is not None:
        shown.append(items.line(log.path, color, 2.0, dash=(6, 4)))
        shown.append(items.view(log.view, log.chosen, playback.last.config.fov, 1.0, color, 0.3))
        shown.append(items.view(log.view, log.announced, playback.last.config.fov, 0.8, PALE, 0.0))
    return shown


def key(robot: int) -> list[tuple[str, str, str]]:
    """The legend of `team_items`."""
    return [("way", draw.robot_color(robot), "line"), ("plan, view", draw.robot_color(robot), "dash"),
            ("view alone", PALE, "line")]  # fmt: skip


def _place(playback: Playback, time, cycle: int, robot: int, layer: str, probe, alpha, clear) -> dict:
    shown = _layer(playback, cycle, robot, layer) + team_items(playback, time, cycle, robot)
    angle = np.linspace(0, 2 * np.pi, 61)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    shown.append(items.line(np.array(probe) + clear * ring, INK, 1.2))
    shown.append(items.line(np.array(probe) + max(alpha, 0.0) * ring, INK, 1.2, dash=(3, 3)))
    shown.append(items.handle("probe", probe, "the probe: α and the true distance here", "#ffffff"))
    when = "" if playback.kept or layer == "true plan" else ", as at the end"
    legend = [*key(robot), ("probe: true distance", INK, "line"), ("α", INK, "dash")]
    lower, upper = playback.place.seen.lower - 0.2, playback.place.seen.upper + 0.2
    return items.plan((50, 45, 405, 295), lower, upper, shown, title=f"robot {robot}: {layer}{when}", legend=legend)


def _layer(playback: Playback, cycle: int, robot: int, layer: str) -> list[dict]:
    if layer == "true plan":
        return items.walls(playback.place)
    if layer == "ground it knows":
        return [items.ground(playback.ground(cycle, robot))]
    if layer == "its splats":
        return [items.splats(playback.belief(cycle, robot).splats)]
    return [items.cells(playback.field(cycle, robot), playback.belief(cycle, robot).known.lattice, *_scale(playback))]


def chart_panel(
    playback: Playback, time: float, robot: int, chart: str, box: Sequence[float] = (605, 65, 240, 260)
) -> dict:
    """One number of every robot over the cycles, with the time as a handle to drag."""
    values = playback.measured(chart)
    low, high = (float(f(values)) for f in (np.nanmin, np.nanmax)) if np.isfinite(values).any() else (0.0, 1.0)
    rim = 0.06 * (high - low) or 1.0
    whole, team = np.arange(len(values)), values.shape[1] == 1
    colors = [INK] if team else [draw.robot_color(k) for k in range(values.shape[1])]
    shown = [items.curve([time, time], [low - rim, high + rim], PALE, dash=(4, 3))]
    shown += [
        items.curve(whole, column, color, width=3.0 if k == robot else 1.6)
        for k, (column, color) in enumerate(zip(values.T, colors, strict=True))
    ]
    now = float(np.interp(time, whole, values[:, 0 if team else robot]))
    shown.append(
        items.handle("cycle", (time, now if np.isfinite(now) else low), "the present cycle", "#ffffff", along="x")
    )
    names = [("team" if team else str(k), color, "line") for k, color in enumerate(colors)]
    return items.panel(
        box, (0, len(playback.cycles)), (low - rim, high + rim), shown,
        xlabel="cycle [1]: drag the time", title=chart, legend=names,
    )  # fmt: skip
