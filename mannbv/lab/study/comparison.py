"""Several strategies on one scene over several seeds: the main job."""

import dataclasses
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mannbv import consensus, episode, messages, network, risk, team, world
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.lab.study import results
from mannbv.lab.study import workers as pool
from mannbv.lab.study.cycles import episode_of
from mannbv.lab.study.results import Results, StudyError
from mannbv.lab.study.workers import EpisodeProgress, Job
from mannbv.world import World


@dataclass(frozen=True)
class Progress:
    """Where a study stands: the robots of a team, and how far each episode is, by (strategy, seed)."""

    n_robots: int
    episodes: dict[tuple[str, int], EpisodeProgress] = field(default_factory=dict)

    def updated(self, news: EpisodeProgress) -> "Progress":
        """With news of one episode; a failure keeps what was known of it."""
        key = news.strategy, news.seed
        if news.fault is not None:
            news = self.episodes[key]._replace(fault=news.fault)
        return dataclasses.replace(self, episodes={**self.episodes, key: news})

    @property
    def share(self) -> float:
        """A guess at how much of the study is done, 0 to 1."""
        parts = [1.0 if each.fault else each.share for each in self.episodes.values()]
        return sum(parts) / len(parts) if parts else 1.0


@dataclass(frozen=True)
class Outcome:
    """What `compare` hands back: the content of results.json, its folder, and a line for each episode that failed."""

    results: Results
    folder: Path
    failures: tuple[str, ...] = ()

    def record(self, strategy: str, seed: int = 0) -> episode.Record:
        """The record of one of its episodes."""
        return episode.load(run_file(self.folder, strategy, seed))


def run_file(folder: str | Path, strategy: str, seed: int) -> Path:
    """Where `compare` keeps an episode."""
    return Path(folder) / "runs" / f"{strategy}-{seed}.npz"


def compare(
    scene: World | str | Path,
    strategies: Iterable[str] | None = None,
    seeds: int | Iterable[int] = 1,
    n_robots: int = 5,
    config: Config | None = None,
    out: str | Path = "out/compare",
    workers: int = 2,
    progress: Callable[[Progress], None] | None = None,
) -> Outcome:
    """Run every strategy with every seed, each episode saved as it grows under `out`/runs, and write results.json.

    scene: a World or what `world.load` takes. strategies: None for the paper's four. seeds: how many, from 0, or which.
    workers: processes side by side (0: none but this one; with more, a script of your own must call this under
    `if __name__ == "__main__":`, for they import it). progress(Progress) is called after each cycle of any run.
    The same call resumes what was interrupted and keeps what is finished; results.json tells of all finished runs in
    the folder. An episode that fails is named in `Outcome.failures` and costs no other.
    Raises ValueError for a bad scene, strategy, team or constant; StudyError, a ValueError, if `out` holds another
    comparison or cannot be written.
    """
    config, folder = config or Config(), Path(out)
    names = list(dict.fromkeys(team.STRATEGIES if strategies is None else strategies))
    numbers = list(range(seeds)) if isinstance(seeds, int) else list(dict.fromkeys(seeds))
    place = (scene if isinstance(scene, World) else world.load(scene)).suited(config)
    check(place, names, numbers, n_robots, config)
    found = _finished(folder, place, n_robots, config)
    _make(folder)
    jobs = [
        Job(place, name, seed, n_robots, config, run_file(folder, name, seed))
        for seed in numbers
        for name in names
        if (name, seed) not in found
    ]
    standing = Progress(n_robots, {(job.strategy, job.seed): EpisodeProgress(job.strategy, job.seed) for job in jobs})

    def watch(news: EpisodeProgress) -> None:
        nonlocal standing
        standing = standing.updated(news)
        if progress is not None:
            progress(standing)

    faults = pool.run(jobs, workers, watch)
    for job in jobs:
        if job not in faults:
            record = episode.load(job.path)
            found[job.strategy, job.seed] = record.rows, episode_of(record)
    rows = [row for rows, _ in found.values() for row in rows]
    table = results.assemble(place.name, place.dim, n_robots, config, rows, [entry for _, entry in found.values()])
    if found:
        results.save(table, folder / "results.json")
    failures = tuple(f"{job.strategy}, seed {job.seed}: {fault}" for job, fault in faults.items())
    return Outcome(table, folder, failures)


def check(place: World, strategies: list[str], seeds: list[int], n_robots: int, config: Config) -> None:
    """Raises ValueError, before any work, for what would make every episode fail."""
    for what, known, name in [
        *(("strategy", team.REGISTRY, name) for name in strategies),
        ("solver", consensus.SOLVERS, config.solver),
        ("measure", risk.MEASURES, config.measure),
        ("network", network.GRAPHS, config.network),
        ("codec", messages.CODECS, config.codec),
    ]:
        if name not in known:
            raise StudyError(f"compare: no {what} is called '{name}'; choose one of {', '.join(known)}")
    if not strategies:
        raise StudyError(f"compare: no strategy is given; choose some of {', '.join(team.REGISTRY)}")
    if not seeds or min(seeds) < 0:
        raise StudyError("compare: needs at least one seed, and none below 0")
    Camera.of_dim(place.dim, config.image_width, config.image_height, config.fov)
    episode.draw_team(place, n_robots, seeds[0], config)


def _make(folder: Path) -> None:
    runs = run_file(folder, "", 0).parent
    try:
        runs.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=runs):
            pass
    except OSError as error:
        raise StudyError(f"{folder}: cannot be written ({error.strerror or error}); choose another --out") from None


def _finished(folder: Path, place: World, n_robots: int, config: Config) -> dict[tuple[str, int], tuple]:
    """Rows and log of each finished run. Raises StudyError if the folder holds another comparison, or its results."""
    found = {}
    for path in sorted(folder.glob("runs/*.npz")):
        record = episode.load(path)
        other = _difference(record, place, n_robots, config)
        if other:
            raise StudyError(
                f"{folder}: holds another comparison ({other}); choose another --out, or delete it to start afresh"
            )
        if record.finished:
            found[record.strategy, record.seed] = record.rows, episode_of(record)
    if not found and (folder / "results.json").exists() and not any(folder.glob("runs/*.npz")):
        raise StudyError(f"{folder}: holds results.json but no runs; choose another --out, or move that file away")
    return found


def _difference(record: episode.Record, place: World, n_robots: int, config: Config) -> str:
    """What a saved run was asked otherwise; empty if nothing."""
    if record.scene != place.name:
        return f"scene {record.scene}, not {place.name}"
    if record.n_robots != n_robots:
        return f"{record.n_robots} robots, not {n_robots}"
    if record.config != config:
        old, new = dataclasses.asdict(record.config), dataclasses.asdict(config)
        return ", ".join(f"{name} {old[name]}, not {new[name]}" for name in old if old[name] != new[name])
    goals = np.array([robot.goal for robot in record.robots])
    known = (np.abs(goals[:, None] - place.goals).max(2) < 1e-9).any(1).all()
    if record.robots[0].ground.lattice != place.ground.lattice(config.cell) or not known:
        return f"another building called {place.name}"
    return ""
