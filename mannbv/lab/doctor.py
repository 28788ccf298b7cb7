"""What is wrong with this installation, a line each with its remedy: `python -m mannbv doctor`.

Every check stands alone; one that raises is itself a finding. What loads compiled code runs in a second process, so
that even a library that takes the interpreter down with it is told in a line. Nothing heavy is imported up here.
"""

import io
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path

MARK = "mannbv-doctor "  # a library may print lines of its own
PATIENCE = 600  # [s] for the compiled checks, of which the first on a machine compiles
AGAIN = "python -m pip install --force-reinstall --no-deps"


@dataclass(frozen=True)
class Finding:
    """One line. level: "ok", "note" (works, but worth knowing) or "wrong"; the remedy is a command or a setting."""

    level: str
    what: str
    remedy: str = ""

    def __str__(self) -> str:
        return " ".join(f"{self.level:5}  {self.what}{'; ' if self.remedy else ''}{self.remedy}".splitlines())


def python() -> Iterator[Finding]:
    """The interpreter is new enough."""
    from packaging.specifiers import SpecifierSet

    try:
        wanted = metadata.metadata("mannbv")["Requires-Python"]
    except metadata.PackageNotFoundError:
        wanted = ">=3.11"
    version = ".".join(map(str, sys.version_info[:3]))
    if SpecifierSet(wanted).contains(version):
        yield Finding("ok", f"Python {version}")
    else:
        yield Finding(
            "wrong",
            f"Python {version}, where {wanted} is needed",
            "rm -r .venv, then make PYTHON=/path/to/python3.11 setup",
        )


def packages() -> Iterator[Finding]:
    """Every requirement is installed and within its bounds; an extra's is only noted."""
    try:
        asked = metadata.requires("mannbv") or []
    except metadata.PackageNotFoundError:
        yield Finding("wrong", "mannbv is not installed, only found in this folder", "make setup, or pip install -e .")
        return
    for extra in ("", *(metadata.metadata("mannbv").get_all("Provides-Extra") or ())):
        unmet = list(_unmet("mannbv", extra))
        if not unmet:
            yield Finding("ok", f"extra [{extra}]" if extra else "every requirement is installed and within its bounds")
        elif extra:
            lines = ", ".join(line for line, _ in unmet)
            yield Finding("note", f"extra [{extra}]: {lines}", f"if wanted: python -m pip install 'mannbv[{extra}]'")
        else:
            yield from (Finding("wrong", line, f"python -m pip install '{wanted}'") for line, wanted in unmet)
    yield from _outdated(asked)


def _unmet(package: str, extra: str = "") -> Iterator[tuple[str, str]]:
    """(what is amiss, the requirement) for what a package, or one of its extras, asks for."""
    from packaging.requirements import Requirement

    for wanted in map(Requirement, metadata.requires(package) or ()):
        always, now = (wanted.marker is None or wanted.marker.evaluate({"extra": name}) for name in ("", extra))
        if always == bool(extra) or not now:
            continue
        asked = f"{wanted.name}{wanted.specifier}"
        try:
            version = metadata.version(wanted.name)
        except metadata.PackageNotFoundError:
            yield f"{wanted.name} is not installed", asked
            continue
        if not wanted.specifier.contains(version, prereleases=True):
            yield f"{wanted.name} {version}, where {package} asks for {wanted.specifier}", asked


def _outdated(asked: Sequence[str]) -> Iterator[Finding]:
    """In a checkout: whether pyproject.toml has moved on since mannbv was installed."""
    import tomllib

    from packaging.requirements import Requirement

    file = Path(__file__).resolve().parents[2] / "pyproject.toml"
    if file.is_file():
        now = tomllib.loads(file.read_text(encoding="utf-8"))["project"]["dependencies"]
        then = [Requirement(text) for text in asked]
        if {str(r) for r in then if r.marker is None} != {str(Requirement(text)) for text in now}:
            yield Finding("note", "pyproject.toml has changed since mannbv was installed", "make setup")


def widgets() -> Iterator[Finding]:
    """Widgets have a half in Python and a half in JupyterLab; both are there and fit each other."""
    from jupyter_core.paths import jupyter_path
    from packaging.version import Version

    folders = [Path(folder) for folder in jupyter_path("labextensions")]
    halves = [  # the extension's version that a package's version stands for; below 1.0 a minor step may break
        ("jupyterlab_widgets", "@jupyter-widgets/jupyterlab-manager", lambda v: (v.major + 2,)),
        ("anywidget", "anywidget", lambda v: (v.major, v.minor) if v.major == 0 else (v.major,)),
    ]
    for line, _ in _unmet("ipywidgets"):
        yield Finding("wrong", line, "python -m pip install --force-reinstall ipywidgets")
    for package, extension, fitting in halves:
        try:
            version = Version(metadata.version(package))
        except metadata.PackageNotFoundError:
            yield Finding("wrong", f"{package} is not installed: no widgets", f"python -m pip install {package}")
            continue
        files = [file for folder in folders if (file := folder / extension / "package.json").is_file()]
        if not files:
            yield Finding("wrong", f"{package} {version}: JupyterLab finds no {extension}", f"{AGAIN} {package}")
            continue
        half = Version(json.loads(files[0].read_text(encoding="utf-8"))["version"])  # JupyterLab, too, takes the first
        wanted = fitting(version)
        if half.release[: len(wanted)] == wanted:
            yield Finding("ok", f"{package} {version}, in JupyterLab {extension} {half}")
        else:
            what = f"{package} {version} does not fit {extension} {half} in {files[0].parent}"
            yield Finding("wrong", what, f"delete that folder, then {AGAIN} {package}")


def kernel() -> Iterator[Finding]:
    """The kernel `python3` of the notebooks starts this very interpreter."""
    from jupyter_client.kernelspec import KernelSpecManager

    spec = KernelSpecManager().get_kernel_spec("python3")
    remedy = f"delete {spec.resource_dir}: without it Jupyter takes its own interpreter"
    command = spec.argv[0]
    if re.fullmatch(r"python[0-9.]*", command):  # Jupyter puts itself in place of a bare name
        command = sys.executable
    asked = [command, "-c", "import sys, ipykernel; print(sys.prefix)"]
    try:
        done = subprocess.run(asked, capture_output=True, text=True, timeout=60, stdin=subprocess.DEVNULL)
    except OSError as error:
        yield Finding("wrong", f"the kernel python3 starts {command}: {error.strerror}", remedy)
        return
    prefix = done.stdout.strip()
    if done.returncode:
        yield Finding("wrong", f"the kernel python3 starts {command}, which has no ipykernel that loads", remedy)
    elif prefix != sys.prefix:
        yield Finding("wrong", f"the kernel python3 is of {prefix}, not of this {sys.prefix}", remedy)
    else:
        yield Finding("ok", f"the kernel python3 is this interpreter, {sys.prefix}")


def temporary() -> Iterator[Finding]:
    """The temporary folder can be written."""
    try:
        with tempfile.TemporaryFile() as file:
            file.write(bytes(2**20))
            file.flush()
    except OSError as error:
        yield Finding(
            "wrong", f"no temporary file can be written: {error.strerror}", "set TMPDIR to a folder with space"
        )
    else:
        yield Finding("ok", f"temporary folder {tempfile.gettempdir()}")


def torch() -> Iterator[Finding]:
    """torch loads; which build it is."""
    import torch

    build = f"CUDA {torch.version.cuda} build" if torch.version.cuda else "CPU build"
    gpu = ", a GPU is usable" if torch.cuda.is_available() else ""
    yield Finding("ok", f"torch {torch.__version__}, {build}{gpu}")


def cores() -> int:
    """How many cores this process may use: its affinity, and a container's quota."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        quota, period = Path("/sys/fs/cgroup/cpu.max").read_text(encoding="ascii").split()
        return max(1, min(count, int(quota) // int(period)))
    except (OSError, ValueError):  # no cgroup, or no quota ("max")
        return count


def threads() -> Iterator[Finding]:
    """As many threads as cores, and numba's threads start."""
    here = cores()
    for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS"):
        value = os.environ.get(name)
        if value is None:
            continue
        if not re.fullmatch(r"0*[1-9][0-9]*(,[0-9]+)*", value.strip()):
            yield Finding("wrong", f"{name}={value} is not a number of threads", f"unset it, or set it to {here}")
        elif int(value.split(",")[0]) > here:
            yield Finding("note", f"{name}={value} on {here} cores: slower, not faster", f"set it to {here} at most")
    import numba
    import torch
    from numba.np.ufunc import parallel

    parallel._launch_threads()
    layer = numba.threading_layer()  # pyright: ignore[reportPrivateImportUsage]
    of_numba = f"numba {numba.get_num_threads()} ({layer})"
    yield Finding("ok", f"{here} cores; threads: torch {torch.get_num_threads()}, {of_numba}")


def cache() -> Iterator[Finding]:
    """The compiled kernels can be kept."""
    wanted = os.environ.get("NUMBA_CACHE_DIR")
    try:
        from mannbv.kernels.flat import row
    except RuntimeError as error:
        if "cannot cache" not in str(error):
            raise
        yield Finding("wrong", "no folder for compiled kernels can be written", "set NUMBA_CACHE_DIR to one that can")
        return
    used = Path(str(row.project.stats.cache_path))
    if wanted and Path(wanted).resolve() not in used.resolve().parents:
        what = f"NUMBA_CACHE_DIR={wanted} cannot be written; kernels are kept in {used}"
        yield Finding("wrong", what, "unset it, or name a folder that can")
        return
    tempfile.TemporaryFile(dir=used).close()
    yield Finding("ok", f"compiled kernels are kept in {used}")


def picture() -> Iterator[Finding]:
    """A kernel compiles, runs, and draws what the dense reference draws."""
    import math

    import torch

    from mannbv import geometry, render, splats
    from mannbv.camera import Camera

    along = torch.linspace(-1.0, 1.0, 9)
    scene = splats.SplatMap(
        torch.stack([2 + along**2, along], 1), torch.full((9, 2), math.log(0.1)),
        torch.tensor([[1.0, 0.0]]).expand(9, 2), torch.full((9,), 2.0), (along[:, None] + 1).expand(9, 3) / 2,
    )  # fmt: skip
    view = Camera.from_fov(32), geometry.yaw_pose(torch.zeros(2), 0.0)
    fast, slow = (render.render(scene, *view, method=method) for method in ("tiled", "dense"))
    gap = max(float((a - b).abs().max()) for a, b in ((fast.color, slow.color), (fast.opacity, slow.opacity)))
    if slow.opacity.max() > 0.5 and gap < 0.02:  # the kernel drops what is fainter than 1/255
        yield Finding("ok", "a kernel compiles, runs, and draws what the reference draws")
    else:
        remedy = f"delete the folder of compiled kernels, then {AGAIN} numba llvmlite"
        yield Finding("wrong", f"a compiled kernel draws wrongly, off by {gap:.2g}", remedy)


def scenes() -> Iterator[Finding]:
    """The bundled buildings load."""
    from mannbv import world

    names = [world.load(scene.name).name for scene in world.scenes()]
    if names:
        yield Finding("ok", f"bundled scenes: {', '.join(names)}")
    else:
        yield Finding("wrong", "no bundled scene is found", "restore data/ from the repository, or reinstall mannbv")


def figure() -> Iterator[Finding]:
    """A figure is drawn without a display and without pyplot."""
    from matplotlib.figure import Figure

    Figure().savefig(io.BytesIO(), format="png")
    if "matplotlib.pyplot" in sys.modules:
        yield Finding("note", "matplotlib.pyplot is loaded, which may ask for a display", "set MPLBACKEND=agg")
    else:
        yield Finding("ok", "figures are drawn without a display")


Check = Callable[[], Iterator[Finding]]
LIGHT: tuple[Check, ...] = (python, packages, widgets, kernel, temporary)
COMPILED: tuple[Check, ...] = (torch, threads, cache, figure, picture, scenes)


def examine(checks: Sequence[Check]) -> Iterator[Finding]:
    """The findings of some checks; one that raises is a finding."""
    for check in checks:
        try:
            yield from check()
        except Exception as error:
            why = f"{type(error).__name__}: {error}".splitlines()[0]
            yield Finding(
                "wrong",
                f"{check.__name__} stops with {why}",
                "rm -r .venv, then make setup; or reinstall what it names",
            )


def print_findings(names: Sequence[str]) -> None:
    """In the second process: examine the checks so named, each finding a line of JSON."""
    for name in names:
        print(MARK + json.dumps(name), flush=True)
        for finding in examine([globals()[name]]):
            print(MARK + json.dumps(asdict(finding)), flush=True)


def examine_apart(checks: Sequence[Check]) -> Iterator[Finding]:
    """As `examine`, in a process of its own each time one has crashed: the checks behind it are still made."""
    names = [check.__name__ for check in checks]
    while names:
        code = f"from mannbv.lab import doctor; doctor.print_findings({names})"
        try:
            done = subprocess.run(
                [sys.executable, "-c", code], capture_output=True, text=True, errors="replace", timeout=PATIENCE
            )
            printed, end = done.stdout, done.returncode and f"ends with status {done.returncode}"
        except subprocess.TimeoutExpired as error:
            printed, end = (error.stdout or b"").decode(errors="replace"), f"does not end within {PATIENCE} s"
        for line in printed.splitlines():
            if line.startswith(MARK):
                said = json.loads(line.removeprefix(MARK))
                if isinstance(said, str):
                    names = names[names.index(said) :]
                else:
                    yield Finding(**said)
        if not end:
            return
        yield Finding(
            "wrong", f"{names[0]}: the interpreter {end}", "rm -r .venv, then make setup; or reinstall torch and numba"
        )
        names = names[1:]


def main() -> int:
    """Print every finding; 0 when nothing is wrong, 1 when something is."""
    wrong = 0
    for checks, how in ((LIGHT, examine), (COMPILED, examine_apart)):
        for finding in how(checks):
            wrong += finding.level == "wrong"
            print(finding, flush=True)
    print(f"{wrong} wrong" if wrong else "Nothing is wrong.")
    return 1 if wrong else 0
