"""`results.json` and the files of single runs: writing, reading, and refusing what does not belong together."""

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar, cast

from mannbv import __version__, archive, episode, team
from mannbv.config import Config
from mannbv.lab.study.cycles import EpisodeLog, episode_of
from mannbv.lab.study.summary import Mean, summarise
from mannbv.metrics import Row
from mannbv.plain import Plain

_Value = TypeVar("_Value")


class StudyError(ValueError):
    """A study that cannot be run or read; its one line names the thing and the remedy."""


@dataclass(frozen=True)
class Results(Plain):
    """The content of `results.json`: one scene, team and set of constants; all strategies and seeds.

    mannbv: the version that wrote it; robots: how many; config: its constants, by name. rows: of each strategy, seed
    and robot; summary: strategy → score → mean over seeds; episodes: cycle by cycle, none from before they were kept.
    """

    mannbv: str
    scene: str
    dim: int
    robots: int
    seeds: tuple[int, ...]
    config: Mapping[str, object]
    rows: tuple[Row, ...]
    summary: Mapping[str, Mapping[str, Mean]]
    episodes: tuple[EpisodeLog, ...] = ()

    def constant(self, name: str, absent: _Value) -> _Value:
        """A constant of the config, or `absent` where the version that wrote this had none."""
        value, kind = self.config.get(name, absent), type(absent)
        if kind is float and isinstance(value, int):  # as JSON writes a whole one
            return cast(_Value, float(value))
        return value if isinstance(value, kind) else absent

    def of(self, strategy: str) -> list[Row]:
        """The rows of a strategy."""
        return [row for row in self.rows if row.strategy == strategy]


def assemble(
    scene: str, dim: int, n_robots: int, config: Config, rows: Iterable[Row], episodes: Iterable[EpisodeLog] = ()
) -> Results:
    """The content of `results.json`; rows are sorted by strategy, seed and robot, episodes (`episode_of`) likewise."""
    order = {name: k for k, name in enumerate(team.REGISTRY)}

    def rank(entry: Row | EpisodeLog) -> tuple:
        return order.get(entry.strategy, len(order)), entry.strategy, entry.seed, getattr(entry, "robot", 0)

    rows = tuple(sorted(rows, key=rank))
    return Results(
        mannbv=__version__,
        scene=scene,
        dim=dim,
        robots=n_robots,
        seeds=tuple(sorted({row.seed for row in rows})),
        config=dataclasses.asdict(config),
        rows=rows,
        summary=summarise(rows),
        episodes=tuple(sorted(episodes, key=rank)),
    )


def save(results: Results, path: str | Path) -> None:
    """Write `results.json`; the file is whole at any moment, and holds no NaN."""
    archive.write_text(path, archive.to_json(results.to_json(), indent=1) + "\n")


def load(path: str | Path) -> Results:
    """Read `results.json` of any version. Raises StudyError for anything else."""
    path = Path(path)
    try:
        values = archive.from_json(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise StudyError(f"{path}: cannot be read ({error.strerror or error}); check the path") from None
    except ValueError as error:
        raise StudyError(f"{path}: not valid JSON ({error}); run the same compare again to rewrite it") from None
    try:
        results = Results.from_json(values, "results")
        for entry in results.episodes:
            if not entry.fits(results.robots):
                raise ValueError(f"the episode of {entry.strategy}, seed {entry.seed}, is not whole")
    except ValueError as error:
        raise StudyError(f"{path}: no results of compare ({error}); run the same compare again to rewrite it") from None
    return results


def gather(paths: Iterable[str | Path]) -> tuple[list[Results], list[str]]:
    """Results from any mix of `results.json`, run files (.npz) and folders of either; and a line for each run left out.

    What shares scene, team and constants becomes one. Raises StudyError where nothing finished is found.
    """
    found, left_out = [], []
    for path in map(Path, paths):
        for file in _files(path):
            if file.suffix == ".json":
                found.append(load(file))
                continue
            record = episode.load(file)
            if record.finished:
                dim = record.robots[0].local.splats.dim
                entries = [episode_of(record)]
                found.append(assemble(record.scene, dim, record.n_robots, record.config, record.rows, entries))
            else:
                left_out.append(f"{file}: not finished ({len(record.cycles)} cycles so far), left out")
    groups = {}
    for results in found:
        key = archive.to_json([results.scene, results.dim, results.robots, results.config], sort_keys=True)
        groups.setdefault(key, []).append(results)
    merged = [_merge(group) for group in groups.values()]
    merged = [results for results in merged if results.rows]
    if not merged:
        raise StudyError(left_out[0] if left_out else f"{', '.join(map(str, paths))}: no finished run in there")
    return merged, left_out


def run_files(paths: Iterable[str | Path]) -> list[Path]:
    """The run files (.npz) that stand behind what `gather` is given: themselves, or those beside a `results.json`."""
    found = []
    for path in map(Path, paths):
        folder = path if path.is_dir() else path.parent
        beside = sorted(folder.glob("runs/*.npz")) or sorted(folder.glob("*.npz"))
        found += [path] if path.suffix == ".npz" else beside
    return list(dict.fromkeys(found))


def _files(path: Path) -> list[Path]:
    if path.is_dir():
        if (path / "results.json").is_file():
            return [path / "results.json"]
        files = sorted(path.glob("*.npz")) or sorted(path.glob("runs/*.npz"))
        if not files:
            raise StudyError(f"{path}: holds neither results.json nor runs; give a folder that compare has written")
        return files
    if not path.exists():
        raise StudyError(f"{path}: no such file or folder")
    if path.suffix not in (".json", ".npz"):
        raise StudyError(f"{path}: give a results.json, a run's .npz, or a folder of them")
    return [path]


def _merge(group: list[Results]) -> Results:
    """One of several results of the same scene, team and constants; a run that is there twice counts once."""
    rows = {(row.strategy, row.seed, row.robot): row for results in group for row in results.rows}
    episodes = {(entry.strategy, entry.seed): entry for results in group for entry in results.episodes}
    first = group[0]
    merged = assemble(first.scene, first.dim, first.robots, Config(), rows.values(), episodes.values())
    # as it was written, perhaps by a version with other constants
    return dataclasses.replace(merged, mannbv=first.mannbv, config=first.config)
