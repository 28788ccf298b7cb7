"""`results.json` and the files of single runs: writing, reading, and refusing what does not belong together."""

import dataclasses
from pathlib import Path

from mannbv import __version__, archive, episode, messages, team
from mannbv.config import Config
from mannbv.episode import Record
from mannbv.lab.study.cycles import episode_of, is_episode
from mannbv.lab.study.summary import summarise
from mannbv.messages import Ledger

KEYS = ("mannbv", "scene", "dim", "robots", "seeds", "config", "rows", "summary")


class StudyError(ValueError):
    """A study that cannot be run or read; its one line names the thing and the remedy."""


def rows_of(record: Record) -> list[dict]:
    """The scores of a finished record, with each robot's bytes by kind, and by the paper's count (`bytes_paper`)."""
    rows = []
    for row in record.rows:
        own = {key: value for key, value in record.ledger.rows.items() if key[0] == row["robot"]}
        first = {key: value for key, value in record.ledger.rows.items() if key[2] == row["robot"]}
        kinds = Ledger(own).by_kind()
        extra = {f"bytes_{kind.__name__.lower()}": kinds.get(kind.__name__, 0) for kind in messages.KINDS}
        rows.append(row | extra | {"bytes_paper": Ledger(first).paper_total(record.strategy)})
    return rows


def assemble(scene: str, dim: int, n_robots: int, config: Config, rows: list[dict], episodes=()) -> dict:
    """The content of `results.json`; rows are sorted by strategy, seed and robot, episodes (`episode_of`) likewise."""
    order = {name: k for k, name in enumerate(team.REGISTRY)}

    def rank(entry: dict) -> tuple:
        return order.get(entry["strategy"], len(order)), entry["strategy"], entry["seed"], entry.get("robot", 0)

    rows = archive.plain(sorted(rows, key=rank))
    return {
        "mannbv": __version__,
        "scene": scene,
        "dim": dim,
        "robots": n_robots,
        "seeds": sorted({row["seed"] for row in rows}),
        "config": dataclasses.asdict(config),
        "rows": rows,
        "summary": summarise(rows),
        "episodes": sorted(episodes, key=rank),
    }


def save(results: dict, path) -> None:
    """Write `results.json`; the file is whole at any moment, and holds no NaN."""
    archive.write_text(path, archive.to_json(results, indent=1) + "\n")


def load(path) -> dict:
    """Read `results.json`; one written before there were "episodes" has none. Raises StudyError for anything else."""
    path = Path(path)
    try:
        results = archive.from_json(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise StudyError(f"{path}: cannot be read ({error.strerror or error}); check the path") from None
    except ValueError as error:
        raise StudyError(f"{path}: not valid JSON ({error}); run the same compare again to rewrite it") from None
    if not isinstance(results, dict) or not all(key in results for key in KEYS):
        raise StudyError(f"{path}: no results of compare; expected an object with {', '.join(KEYS)}")
    rows = results["rows"]
    wanted = {"strategy": str, "seed": int, "robot": int}
    if not isinstance(rows, list) or not all(
        isinstance(row, dict) and all(isinstance(row.get(k), kind) for k, kind in wanted.items()) for row in rows
    ):
        raise StudyError(f"{path}: its rows are not those of compare; run the same compare again to rewrite it")
    for row in rows:
        for key, value in row.items():
            if key not in ("strategy", "fate") and not (value is None or _is_number(value)):
                raise StudyError(f"{path}: {key} in its rows is no number; run the same compare again to rewrite it")
    kinds = {"config": dict, "scene": str, "robots": int, "dim": int}
    if not all(isinstance(results[key], kind) for key, kind in kinds.items()):
        raise StudyError(f"{path}: its {', '.join(kinds)} are not those of compare; run the same compare again")
    episodes = results.setdefault("episodes", [])
    if not isinstance(episodes, list) or not all(is_episode(entry, results["robots"]) for entry in episodes):
        raise StudyError(f"{path}: its episodes are not those of compare; run the same compare again to rewrite it")
    return results


def _is_number(value) -> bool:
    return isinstance(value, (int, float)) and abs(value) < 1e300  # JSON holds whole numbers of any size


def gather(paths) -> tuple[list[dict], list[str]]:
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
                rows, episodes = rows_of(record), [episode_of(record)]
                found.append(assemble(record.scene, dim, record.n_robots, record.config, rows, episodes))
            else:
                left_out.append(f"{file}: not finished ({len(record.cycles)} cycles so far), left out")
    groups = {}
    for results in found:
        key = archive.to_json([results[k] for k in ("scene", "dim", "robots", "config")], sort_keys=True)
        groups.setdefault(key, []).append(results)
    merged = [_merge(group) for group in groups.values()]
    merged = [results for results in merged if results["rows"]]
    if not merged:
        raise StudyError(left_out[0] if left_out else f"{', '.join(map(str, paths))}: no finished run in there")
    return merged, left_out


def run_files(paths) -> list[Path]:
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


def _merge(group: list[dict]) -> dict:
    """One of several results of the same scene, team and constants; a run that is there twice counts once."""
    rows = {(row["strategy"], row["seed"], row["robot"]): row for results in group for row in results["rows"]}
    episodes = {(entry["strategy"], entry["seed"]): entry for results in group for entry in results["episodes"]}
    about, first = ("scene", "dim", "robots"), group[0]
    merged = assemble(*(first[key] for key in about), Config(), list(rows.values()), episodes.values())
    # as it was written, perhaps by a version with other constants
    return merged | {"mannbv": first["mannbv"], "config": first["config"]}
