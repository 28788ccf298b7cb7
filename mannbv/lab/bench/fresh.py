"""Measurements that need a process of their own: first import and image, memory, the main job."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import mannbv
from mannbv.lab.bench import child
from mannbv.lab.bench.timing import Result, load

_PACKAGE = Path(mannbv.__file__).parent


def ask(*words: str, **environment: str) -> dict[str, float]:
    """What a function of `child` returns in a fresh process. Raises ValueError with the process's last line."""
    return json.loads(_run(["-P", child.__file__, *words], environment).splitlines()[-1])


def _run(arguments: list[str], environment: dict[str, str]) -> str:
    path = os.pathsep.join(filter(None, [str(_PACKAGE.parent), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        [sys.executable, *arguments],
        env=os.environ | {"PYTHONPATH": path} | environment,
        capture_output=True,
        text=True,
    )
    if done.returncode:
        said = (done.stderr.strip() or f"exit status {done.returncode}").splitlines()[-1]
        raise ValueError(f"bench: a fresh process failed ({said}); see python -m mannbv doctor")
    return done.stdout


def first(count: int, cold: bool) -> Iterator[Result]:
    """First import and first image, `count` times with compiled kernels at hand; and, if asked, once without."""
    what = "first import and first image in space"
    ask("first")  # whatever was never compiled is now
    began = load()
    yield _first("first.warm", f"{what}, kernels compiled", [ask("first") for _ in range(count)], began)
    if cold:
        with tempfile.TemporaryDirectory() as empty:
            measured = [ask("first", NUMBA_CACHE_DIR=empty)]
        yield _first("first.cold", f"{what}, nothing compiled yet", measured, load())
        later = tuple(one["backward"] + one["fisher"] for one in measured)
        yield Result("first.cold.rest", "and then the first gradient and the first Fisher", "s", later, load=load())


def _first(key: str, title: str, measured: list[dict], began: float | None) -> Result:
    best = {f"best_{name}_s": min(one[name] for one in measured) for name in measured[0]}
    total = tuple(one["torch"] + one["mannbv"] + one["render"] for one in measured)
    return Result(key, title, "s", total, tuple(one["cpu"] for one in measured), load=began, facts=best)


def memory(n_splats: int, size: int) -> Iterator[Result]:
    """The peak of a process that renders with gradients and takes the Fisher information."""
    peak = [ask("memory", str(n_splats), str(size)).get("peak") for _ in range(2)][1]  # the first may have compiled
    if peak is not None:
        title = f"memory peak of {n_splats:,} splats at {size}×{size} with gradients and Fisher"
        yield Result("memory", title, "B", (peak,), facts={"splats": n_splats, "width": size})


def job() -> Iterator[Result]:
    """The main job, as `make run` does it."""
    with tempfile.TemporaryDirectory() as folder:
        began, before = time.perf_counter(), load()
        _run(["-m", "mannbv", "compare", "flat", "--out", folder], {})
        taken = time.perf_counter() - began
    yield Result("job", "the main job: five robots, four strategies, to their goals", "s", (taken,), load=before)
