"""Which record serves which of the paper's figures."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure

from mannbv import episode
from mannbv.episode import Record
from mannbv.lab import report, study
from mannbv.lab.draw import canvas, team
from mannbv.lab.draw.paper import centralized, overview, proposals, sharing
from mannbv.lab.draw.team import KEY_HEIGHT, WIDTH

_HEAD = 0.55  # inches


def beliefs_figure(record: Record, cycle: int | None = None) -> Figure:
    """Every robot's belief: its risk field above, below its map around the safe path, with its mask and its view."""
    snapshot, whole = study.snapshot(record, cycle), team.known(record)
    height = _HEAD + team.beliefs_height(record.n_robots, whole) + KEY_HEIGHT
    with canvas.style():
        made = Figure(figsize=(WIDTH, height))
        team.headline(made, f"{team.scene_of(record)}, {record.strategy}: what {record.n_robots} robots believe")
        team.beliefs(made, snapshot, whole, _HEAD, record.config)
        team.key(made, team.shown(record, snapshot))
    return made


# name of the file, the figure, the strategies of its records, the team size that the paper shows
FIGURES: tuple[tuple[str, Callable[..., Figure], tuple[str, ...], int], ...] = (
    ("figure1-overview", overview.overview_figure, ("distributed",), 3),
    ("figure2-mask-and-views", proposals.mask_figure, ("distributed",), 2),
    ("figure3-growth", centralized.growth_figure, ("centralized",), 5),
    ("figure4-beliefs", beliefs_figure, ("limited",), 5),
    ("figure5-sharing", sharing.sharing_figure, ("centralized", "limited"), 2),
)


class _Run(NamedTuple):
    """What a run file holds; the record itself may be large, and is read again when it is drawn."""

    file: Path
    scene: str
    dim: int
    strategy: str
    n_robots: int
    seed: int


def paper_figures(files: Iterable[str | Path]) -> Iterator[tuple[str, Figure | None, str]]:
    """From run files (.npz) the paper's figures, a set a scene: (name, figure, ""), or (name, None, why it is not
    there).

    Of several records that would serve, the one of the team size that the paper shows, or next to it, and of the first
    seed.
    """
    scenes = {}
    for file in map(Path, files):
        try:
            record = episode.load(file)
        except ValueError as error:
            yield file.name, None, str(error)
            continue
        dim = record.robots[0].local.splats.dim
        if record.cycles:
            run = _Run(file, record.scene, dim, record.strategy, record.n_robots, record.seed)
            scenes.setdefault((record.scene, dim), []).append(run)
    for (scene, dim), runs in scenes.items():
        for name, draw, strategies, size in FIGURES:
            name = f"{name}-{report.file_name(scene)}-{dim}d"
            chosen = _chosen(runs, strategies, size)
            try:
                if not chosen:
                    raise ValueError(f"needs runs of one team: {' and '.join(strategies)}; add them with compare")
                yield name, draw(*(episode.load(run.file) for run in chosen)), ""
            except ValueError as error:
                yield name, None, str(error)


def _chosen(runs: list[_Run], strategies: tuple[str, ...], size: int) -> list[_Run]:
    """A run of each strategy, all of one team size and seed; [] where there are none."""
    teams = {}
    for run in runs:
        teams.setdefault((run.n_robots, run.seed), {}).setdefault(run.strategy, run)
    fit = [key for key, found in teams.items() if set(strategies) <= set(found)]
    best = min(fit, key=lambda key: (abs(key[0] - size), key), default=None)
    return [teams[best][name] for name in strategies] if fit else []
