"""The whole run: stage after stage, each result shown and kept as it comes, so that an interruption loses little."""

import os
import platform
from collections.abc import Callable
from importlib import metadata

from llvmlite import binding

from mannbv import __version__
from mannbv.lab.bench.sides import Scale
from mannbv.lab.bench.stages import STAGES
from mannbv.lab.bench.targets import TARGETS
from mannbv.lab.bench.timing import Result, load, most_threads


def run(scale: Scale, keep: Callable[[dict], None], show: Callable[[int, str, str], None]) -> None:
    """Measure everything.

    keep(report) is called after every result with all there are so far, and at the end. report: {"mannbv", "machine",
    "complete", "load", "results", "targets"}, see `Result.row` and `Target.judged`. show(stages done, the one at work,
    a line) is called as a stage begins and after every result. Raises ValueError if a rival's answer is not ours.
    """
    results: list[Result] = []
    began = load()
    for done, (name, stage) in enumerate(STAGES.items()):
        show(done, name, "")
        for result in stage(scale):
            results.append(result)
            keep(_report(results, began, False))
            show(done, name, str(result))
    keep(_report(results, began, True))
    show(len(STAGES), "done", "")


def _report(results: list[Result], began: float | None, complete: bool) -> dict:
    return {
        "mannbv": __version__,
        "machine": _machine(),
        "complete": complete,
        "load": {"began": began, "now": load()},
        "results": [result.row() for result in results],
        "targets": [target.judged(results) for target in TARGETS],
    }


def _machine() -> dict:
    versions = {name: metadata.version(name) for name in ("numba", "numpy", "torch")}
    return {
        "cpus": os.cpu_count(),
        "threads": most_threads(),
        "OMP_WAIT_POLICY": os.environ.get("OMP_WAIT_POLICY"),  # threads that spin while they wait slow a busy machine
        "processor": binding.get_host_cpu_name(),  # what kernels are compiled for
        "system": platform.system(),
        "python": platform.python_version(),
        **versions,
    }
