"""Episodes side by side, in spawned processes of one thread each.

A worker that is killed costs its own episode only (a process pool would lose all that are under way), and workers end
by themselves, at the next cycle, when their parent is gone. Every episode is saved as it grows, so nothing is lost.
"""

import contextlib
import multiprocessing
import os
import pickle
import signal
import traceback
import warnings
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing import connection
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from mannbv import archive, consensus, episode, risk, team
from mannbv.config import Config
from mannbv.episode import Record
from mannbv.world import World

_THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
_ALONE = {**dict.fromkeys(_THREADS, "1"), "PYTHONWARNINGS": "ignore"}
_REGISTRIES = {"strategy": team.REGISTRY, "solver": consensus.SOLVERS, "measure": risk.MEASURES}


@dataclass(frozen=True)
class Job:
    """One episode to run, and the file in which it is saved as it grows."""

    place: World
    strategy: str
    seed: int
    n_robots: int
    config: Config
    path: Path


class EpisodeProgress(NamedTuple):
    """How far an episode is. share: a guess at how much of it is done, 0 to 1; fault: why it failed, or None."""

    strategy: str
    seed: int
    cycles: int = 0
    at_goal: int = 0
    share: float = 0.0
    finished: bool = False
    fault: str | None = None


def progress_of(record: Record) -> EpisodeProgress:
    """How far a record is: by the distance that its robots have left, or by the cycles."""
    start = [np.linalg.norm(robot.goal - robot.trail[0]) for robot in record.robots]
    rest = [(robot.status != "reached") * np.linalg.norm(robot.goal - robot.position) for robot in record.robots]
    done = np.clip(1 - np.array(rest) / np.maximum(start, 1e-9), 0, 1).mean()
    share = max(float(done), len(record.cycles) / max(record.config.max_cycles, 1))
    return EpisodeProgress(
        record.strategy, record.seed, len(record.cycles), sum(robot.status == "reached" for robot in record.robots),
        1.0 if record.finished else min(share, 0.97), record.finished,
    )  # fmt: skip


def run(jobs: list[Job], workers: int, watch: Callable[[EpisodeProgress], None]) -> dict[Job, str]:
    """Run all jobs, `workers` at a time (0: in this process); returns why some failed. `watch` gets every change."""
    if workers < 0:
        raise ValueError(f"study: workers must be 0 (run in this process) or more, got {workers}")
    for folder in {job.path.parent for job in jobs}:
        archive.tidy(folder)
    if workers:
        return _Pool(jobs, workers, watch).run()
    faults = {}
    for job in jobs:
        fault = _attempt(job, watch)
        if fault is not None:
            faults[job] = fault
            watch(EpisodeProgress(job.strategy, job.seed, fault=fault))
    return faults


def _attempt(job: Job, watch: Callable[[EpisodeProgress], None]) -> str | None:
    """Run or resume one episode; why it failed, in a line. What nobody foresaw leaves its traceback beside the file."""
    report = job.path.with_suffix(".error.txt")
    try:
        report.unlink(missing_ok=True)
        episode.run(
            job.place,
            job.strategy,
            job.config,
            job.seed,
            job.n_robots,
            job.path,
            lambda record: watch(progress_of(record)),
        )
    except (ValueError, OSError) as error:
        return _line(error)
    except Exception as error:
        with contextlib.suppress(OSError):
            report.write_text(traceback.format_exc(), encoding="utf-8")
        return f"{type(error).__name__}: {_line(error)} (traceback in {report})"
    return None


def _line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


class _Pool:
    """The parent's side: who works on what."""

    def __init__(self, jobs: list[Job], workers: int, watch: Callable[[EpisodeProgress], None]):
        self.waiting, self.workers, self.watch = deque(jobs), workers, watch
        self.load = {id(job): _packed(job) for job in jobs}
        self.busy, self.faults = {}, {}

    def run(self) -> dict[Job, str]:
        try:
            for _ in range(min(self.workers, len(self.waiting))):
                self._hire()
            while self.busy:
                for pipe in connection.wait(list(self.busy)):
                    self._hear(pipe)
        finally:
            for process, _ in self.busy.values():
                process.terminate()
            for process, _ in self.busy.values():
                process.join()
        return self.faults

    def _hire(self) -> None:
        ours, theirs = multiprocessing.Pipe()
        process = multiprocessing.get_context("spawn").Process(target=_work, args=(theirs,), daemon=True)
        with _born_alone():
            process.start()
        theirs.close()  # so that the pipe ends when the worker does
        self._hand_out(ours, process)

    def _hand_out(self, pipe, process) -> None:
        if not self.waiting:
            self.busy.pop(pipe, None)
            pipe.close()  # the worker then leaves
            process.join()
            return
        job = self.waiting.popleft()
        self.busy[pipe] = process, job
        with contextlib.suppress(OSError):  # a worker that died is noticed in _hear
            pipe.send_bytes(self.load[id(job)])

    def _hear(self, pipe) -> None:
        process, job = self.busy[pipe]
        try:
            word = pipe.recv()
        except (EOFError, OSError):
            del self.busy[pipe]
            process.join()
            self._failed(
                job, f"its process was ended (exit code {process.exitcode}); if memory is short, use one worker"
            )
            if self.waiting:
                self._hire()
            return
        if isinstance(word, EpisodeProgress):
            self.watch(word)
            return
        if word is not None:
            self._failed(job, word)
        self._hand_out(pipe, process)

    def _failed(self, job: Job, fault: str) -> None:
        self.faults[job] = fault
        self.watch(EpisodeProgress(job.strategy, job.seed, fault=fault))


def _packed(job: Job) -> bytes:
    """A job as bytes, with its strategy, solver and measure: a new process has registered only this package's own."""
    names = {"strategy": job.strategy, "solver": job.config.solver, "measure": job.config.measure}
    entries = {}
    for what, name in names.items():
        entry = _REGISTRIES[what][name]
        try:
            pickle.dumps(entry)
        except (pickle.PicklingError, AttributeError, TypeError):
            if _ours(entry):
                continue
            raise ValueError(
                f"study: {what} '{name}' cannot be sent to another process; define it at the top of a module, "
                "or use workers=0"
            ) from None
        entries[what] = name, entry
    return pickle.dumps((entries, job))


def _ours(entry) -> bool:
    if isinstance(entry, tuple):
        return all(map(_ours, entry))
    return not callable(entry) or entry.__module__.startswith("mannbv.")


@contextlib.contextmanager
def _born_alone():
    """A process started here has one thread and never hears Ctrl-C: its parent decides."""
    before = {name: os.environ.get(name) for name in _ALONE}
    blocks = hasattr(signal, "pthread_sigmask")  # not on Windows
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if blocks else set()
    os.environ.update(_ALONE)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
        if blocks:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)


class _Orphaned(BaseException):
    """The parent is gone."""


def _work(pipe) -> None:
    """The worker's side: run what comes through the pipe until it closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter("ignore")
    torch.set_num_threads(1)

    def say(word) -> None:
        try:
            pipe.send(word)
        except OSError:
            raise _Orphaned from None

    with contextlib.suppress(EOFError, OSError, _Orphaned):
        while True:
            parcel = pipe.recv_bytes()
            try:
                entries, job = pickle.loads(parcel)
            except (AttributeError, ImportError):
                say("its strategy, solver or measure is unknown to other processes; define it at the top of a module")
                continue
            for what, (name, entry) in entries.items():
                _REGISTRIES[what][name] = entry
            say(_attempt(job, say))
