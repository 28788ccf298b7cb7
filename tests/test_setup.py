"""The set-up as a reader meets it: lock, wheel, make, the skip guard, notebooks, and what the documents claim."""

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from importlib.util import find_spec
from pathlib import Path

import nbformat
import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"].values()
DIRECT = [Requirement(text) for group in (PROJECT["dependencies"], *EXTRAS) for text in group]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
DOCUMENTS = ["README.md", "environment.md", "CONTRIBUTING.md"]

needs_make = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def run(*command, cwd, **env) -> subprocess.CompletedProcess:
    """The finished command; of this process's environment, make's and pytest's own variables are left out."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("MAKE", "MFLAGS", "PYTEST", "PYTHON"))}
    command = [str(part) for part in command]
    return subprocess.run(command, cwd=cwd, env=kept | env, capture_output=True, text=True, stdin=subprocess.DEVNULL)


def locked() -> list[str]:
    return [line for line in text("requirements.lock").splitlines() if not line.startswith("#")]


# --- the lock and the reasons ---------------------------------------------------------------------------------------


def test_the_lock_pins_everything_exactly_torch_first_and_names_no_place():
    assert locked()[0] == "torch==2.13.0"
    assert [line for line in locked() if not re.fullmatch(r"[a-z0-9-]+==[0-9][a-z0-9.]*", line)] == []
    assert not any(line.startswith("mannbv") for line in locked())


def test_the_lock_satisfies_every_direct_dependency():
    pinned = dict(line.split("==") for line in locked())
    wrong = [str(r) for r in DIRECT if not r.specifier.contains(pinned.get(canonicalize_name(r.name), "0"))]
    assert wrong == []


def test_environment_gives_a_reason_and_the_tried_version_of_each_direct_dependency_and_of_no_other():
    rows = re.findall(r"^\| `([\w-]+)` \| (\S+) \| (.+) \|$", text("environment.md"), flags=re.MULTILINE)
    pinned = dict(line.split("==") for line in locked())
    assert sorted(name for name, _, _ in rows) == sorted(canonicalize_name(r.name) for r in DIRECT)
    assert {name: version for name, version, _ in rows} == {name: pinned[name] for name, _, _ in rows}
    assert all(len(reason) > 10 for _, _, reason in rows)


# --- the wheel ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory) -> Path:
    """A folder that holds the wheel's contents."""
    folder = tmp_path_factory.mktemp("wheel")
    flags = ["--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", folder]
    built = run(sys.executable, "-m", "pip", "wheel", ROOT, *flags, cwd=folder)
    assert built.returncode == 0, built.stderr
    (wheel,) = folder.glob("mannbv-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def isolated(unpacked: Path, cwd: Path, *arguments) -> subprocess.CompletedProcess:
    """Python with the wheel and its dependencies but no checkout: -S leaves out the editable install's .pth file."""
    libraries = sysconfig.get_paths()["purelib"], sysconfig.get_paths()["platlib"]
    path = os.pathsep.join([str(unpacked), *dict.fromkeys(libraries)])
    return run(sys.executable, "-S", *arguments, cwd=cwd, PYTHONPATH=path)


def test_the_wheel_holds_the_scenes_and_the_licence_and_no_tests(unpacked):
    files = {path.relative_to(unpacked).as_posix() for path in unpacked.rglob("*") if path.is_file()}
    scenes = {f"mannbv/data/{path.name}" for path in (ROOT / "data").glob("*.json")}
    assert scenes
    assert scenes <= files
    assert any(name.endswith("licenses/LICENSE") for name in files)
    assert "mannbv/py.typed" in files  # a type checker then believes the annotations
    assert {name.split("/")[0] for name in files} == {"mannbv", f"mannbv-{PROJECT['version']}.dist-info"}


def test_a_scene_loads_by_name_from_the_wheel_alone(unpacked, tmp_path):
    code = "import mannbv; from mannbv import world; print(mannbv.__file__); print(world.load('flat').name)"
    done = isolated(unpacked, tmp_path, "-c", code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str(unpacked / "mannbv" / "__init__.py"), "flat"]


def test_the_command_line_lists_the_scenes_from_the_wheel_alone(unpacked, tmp_path):
    done = isolated(unpacked, tmp_path, "-m", "mannbv", "scenes")
    assert done.returncode == 0, done.stderr
    listed = {line.split()[0] for line in done.stdout.splitlines() if line.strip()}
    assert {path.stem for path in (ROOT / "data").glob("*.json")} <= listed


def test_a_wheel_without_its_scenes_is_noticed(unpacked, tmp_path):
    shutil.copytree(unpacked, tmp_path / "site")
    shutil.rmtree(tmp_path / "site" / "mannbv" / "data")
    done = isolated(tmp_path / "site", tmp_path, "-c", "from mannbv import world; world.load('flat')")
    assert done.returncode != 0
    assert "SceneError" in done.stderr


# --- make -----------------------------------------------------------------------------------------------------------


@needs_make
def test_bare_make_lists_every_target():
    listed = re.findall(r"^make ([\w-]+) +\S", run("make", cwd=ROOT).stdout, flags=re.MULTILINE)
    phony = re.search(r"^\.PHONY: (.+)$", text("Makefile"), flags=re.MULTILINE).group(1).split()
    assert listed == phony
    assert {"run", "test", "test-generic", "exercises", "lab", "notebooks", "lint", "clean"} <= set(listed)


@needs_make
def test_lint_checks_the_types_of_the_whole_package_with_the_interpreter_that_has_its_libraries():
    assert "-m basedpyright --pythonpath .venv/bin/python\n" in run("make", "-n", "lint", cwd=ROOT).stdout
    settings = tomllib.loads(text("pyproject.toml"))["tool"]["pyright"]
    assert (settings["include"], settings["typeCheckingMode"]) == (["mannbv"], "standard")
    assert not {"ignore", "exclude"} & settings.keys()


@needs_make
def test_lab_derives_the_readers_copies_and_opens_them():
    planned = run("make", "--dry-run", "lab", "ARGS=--port=9999", cwd=ROOT).stdout
    derive, opened = planned.index("tools/course.py\n"), planned.index("-m jupyterlab course ")
    assert derive < opened
    assert planned.rstrip().endswith("--port=9999")


@needs_make
def test_the_generic_run_compares_every_notebook_on_one_thread_for_a_plain_processor():
    planned = run("make", "-n", "test-generic", cwd=ROOT).stdout.splitlines()
    solved, readers = (set(line.split()) for line in planned if "pytest" in line)
    assert {"NUMBA_CPU_NAME=generic", "OMP_NUM_THREADS=1", "tools/nbval.ini", "notebooks"} <= solved
    assert {"NUMBA_CPU_NAME=generic", "OMP_NUM_THREADS=1", "tools/course.ini", "out/tests/course"} <= readers


PRETENDERS = {  # what stands in for python3, and what the reader must be told
    "absent": (None, "there is no ./python"),
    "old": ("import sys; sys.version_info = (3, 10, 14, 'final', 0); exec(sys.argv[1])", "is older"),
    "bare": ("import sys; sys.modules['ensurepip'] = None; exec(sys.argv[1])", "lacks the venv module"),
}


@needs_make
@pytest.mark.parametrize("kind", PRETENDERS)
def test_an_unfit_python_is_told_in_one_line_with_the_remedy(kind, tmp_path):
    for name in ("Makefile", "pyproject.toml", "requirements.lock"):
        shutil.copy(ROOT / name, tmp_path)
    code, message = PRETENDERS[kind]
    if code is not None:
        (tmp_path / "python").write_text(f'#!/bin/sh\nexec "{sys.executable}" -c "{code}" "$2"\n')
        (tmp_path / "python").chmod(0o755)
    done = run("make", "test", "PYTHON=./python", cwd=tmp_path)
    assert done.returncode != 0
    lines = [line for line in done.stderr.splitlines() if not line.startswith("make")]
    assert len(lines) == 1
    assert message in lines[0]
    assert "make PYTHON=" in lines[0]
    assert not (tmp_path / ".venv").exists()


@needs_make
def test_setup_runs_again_only_when_the_lock_or_the_project_changed(tmp_path):
    for name in ("Makefile", "pyproject.toml", "requirements.lock"):
        shutil.copy(ROOT / name, tmp_path)
    (tmp_path / ".venv").mkdir()
    (tmp_path / ".venv" / ".ready").touch()
    assert run("make", "--question", "setup", cwd=tmp_path).returncode == 0
    for name in ("pyproject.toml", "requirements.lock"):
        later = (tmp_path / ".venv" / ".ready").stat().st_mtime + 10
        os.utime(tmp_path / name, (later, later))
        assert run("make", "--question", "setup", cwd=tmp_path).returncode == 1
        os.utime(tmp_path / name, (0, 0))


# --- threads --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("asked", "policy"), [({}, "passive"), ({"OMP_WAIT_POLICY": "active"}, "active")])
def test_waiting_threads_leave_the_cores_to_others_unless_told_otherwise(asked, policy, tmp_path, monkeypatch):
    monkeypatch.delenv("OMP_WAIT_POLICY", raising=False)
    done = run(sys.executable, "-c", "import os, mannbv; print(os.environ['OMP_WAIT_POLICY'])", cwd=tmp_path, **asked)
    assert done.stdout.strip() == policy


# --- CI -------------------------------------------------------------------------------------------------------------


def test_ci_runs_the_test_command_of_the_readme():
    section = text("README.md").split("## Test it")[1]
    command = re.search(r"```bash\n(.+?)\n```", section, flags=re.DOTALL).group(1)
    lines = [line for line in text(".ci/run").splitlines() if line and not line.startswith("#")]
    assert command in lines
    assert "set -euo pipefail" in lines


@needs_make
def test_ci_looks_for_skips_in_every_report_of_the_test_command():
    written = re.findall(r"--junitxml=(\S+)", run("make", "--dry-run", "test", cwd=ROOT).stdout)
    assert {Path(report).stem for report in written} == {"pytest", "notebooks", "course"}
    (guard,) = (line for line in text(".ci/run").splitlines() if "skips.py" in line)
    assert guard.split("skips.py")[1].split() == written


SKIPS = {  # a test file's body -> what the guard must return
    "def test_one(): pass": 0,
    "def test_one(): pytest.skip('third-party scenes are not beside this checkout')": 0,
    "def test_one(): pytest.skip('could not be bothered')": 1,
    "def test_one(): pytest.xfail('some day')": 1,
    "@pytest.mark.xfail\ndef test_one(): assert False": 1,
    "pytest.skip('third-party scenes are not beside this checkout', allow_module_level=True)": 0,
    "pytest.importorskip('no_such_module')": 1,
}


@pytest.mark.parametrize("body", SKIPS)
def test_the_skip_guard_fails_on_a_skip_without_leave(body, tmp_path):
    (tmp_path / "test_one.py").write_text(f"import pytest\n{body}\n")
    options = ["-c", os.devnull, "--rootdir=.", "-p", "no:cacheprovider", "--junitxml=report.xml"]
    run(sys.executable, "-m", "pytest", *options, "test_one.py", cwd=tmp_path, PYTEST_DISABLE_PLUGIN_AUTOLOAD="1")
    guard = run(sys.executable, ROOT / ".ci" / "skips.py", "report.xml", cwd=tmp_path)
    assert guard.returncode == SKIPS[body], guard.stdout + guard.stderr
    assert bool(guard.stderr) == bool(SKIPS[body])


def test_the_skip_guard_fails_without_a_report_or_without_tests(tmp_path):
    (tmp_path / "empty.xml").write_text("<testsuites><testsuite/></testsuites>")
    (tmp_path / "torn.xml").write_text("<testsuites><test")
    for reports in ([], ["absent.xml"], ["empty.xml"], ["torn.xml"]):
        assert run(sys.executable, ROOT / ".ci" / "skips.py", *reports, cwd=tmp_path).returncode == 1


# --- notebooks ------------------------------------------------------------------------------------------------------


def notebook(path: Path, *sources: str) -> Path:
    """A notebook of code cells that were never run."""
    cells = [nbformat.v4.new_code_cell(source, id=f"c{k}") for k, source in enumerate(sources)]
    nbformat.write(nbformat.v4.new_notebook(cells=cells, metadata={"volatile": 1}), path)
    return path


def store(*arguments) -> subprocess.CompletedProcess:
    """`make notebooks` on some notebooks."""
    return run(sys.executable, ROOT / "tools" / "notebooks.py", *arguments, cwd=ROOT)


def strict(path: Path) -> subprocess.CompletedProcess:
    """nbval as `make test` runs it, on one notebook."""
    options = ["-c", "tools/nbval.ini", "--rootdir=.", "-p", "no:cacheprovider"]
    return run(sys.executable, "-m", "pytest", *options, path, cwd=ROOT)


def test_stored_outputs_pass_strict_nbval_and_an_edited_number_does_not(tmp_path):
    path = notebook(tmp_path / "made.ipynb", "print(6 * 7)", "object()", "import ipywidgets; ipywidgets.IntSlider(3)")
    done = store(path)
    assert done.returncode == 0, done.stderr
    stored = path.read_text()
    assert "volatile" not in stored
    assert "widget-view" not in stored
    assert [cell["id"] for cell in json.loads(stored)["cells"]] == ["c0", "c1", "c2"]
    assert store("--check", path).returncode == 0
    assert strict(path).returncode == 0
    path.write_text(stored.replace('"42\\n"', '"43\\n"'))
    edited = strict(path)
    assert edited.returncode == 1
    assert "1 failed, 2 passed" in edited.stdout
    assert "out of date" in store("--check", path).stderr


def test_a_notebook_that_must_not_be_stored_is_named_in_one_line_and_left_as_it_was(tmp_path):
    bad = {
        "raises.ipynb": ("1 / 0", "code cell 2 raised ZeroDivisionError"),
        "large.ipynb": ("print('x\\n' * 300_000)", "over 500,000"),
        "path.ipynb": (f"print({str(ROOT)!r} + '/x')", "this machine's path"),
    }
    paths = [notebook(tmp_path / name, "1", source) for name, (source, _) in bad.items()]
    (tmp_path / "torn.ipynb").write_text('{"cells": [')
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    done = store(*paths, tmp_path / "torn.ipynb")
    assert done.returncode == 2
    lines = done.stderr.splitlines()
    assert len(lines) == 4
    for line, path, complaint in zip(lines, paths, [complaint for _, complaint in bad.values()], strict=False):
        assert line.startswith(str(path))
        assert complaint in line
    assert "torn.ipynb: not a notebook" in lines[3]
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_the_cell_that_raised_is_named_whatever_counts_an_earlier_run_has_stored(tmp_path):
    path = notebook(tmp_path / "ran.ipynb", "1", "", "print(6 * 7)", "4")
    assert store(path).returncode == 0
    made = json.loads(path.read_text())
    made["cells"][2]["source"] = ["1 / 0"]
    path.write_text(json.dumps(made))
    assert "code cell 3 raised ZeroDivisionError" in store(path).stderr


def test_check_notices_outputs_that_differ_from_run_to_run(tmp_path):
    done = store("--check", notebook(tmp_path / "made.ipynb", "import os; os.getpid()"))
    assert done.returncode == 2
    assert "two runs differ" in done.stderr


def test_there_are_notebooks_and_each_holds_the_outputs_of_one_run_from_top_to_bottom():
    assert NOTEBOOKS
    for path in NOTEBOOKS:
        stored = json.loads(path.read_text(encoding="utf-8"))
        code = [cell for cell in stored["cells"] if cell["cell_type"] == "code"]
        assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1)), path.name
        kinds = {kind for cell in code for out in cell["outputs"] for kind in (*out, *out.get("data", ()))}
        assert kinds & {"text", "text/plain"}, path.name  # else strict nbval has nothing to compare
        assert path.stat().st_size <= 500_000, path.name


# --- documents ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", DOCUMENTS)
def test_every_relative_link_leads_somewhere(name):
    links = re.findall(r"\]\((?!https?:|#)([^)#]+)", text(name))
    assert [link for link in links if not (ROOT / link).exists()] == []


@pytest.mark.parametrize("name", DOCUMENTS)
def test_every_make_target_that_a_document_names_exists(name):
    targets = set(re.search(r"^\.PHONY: (.+)$", text("Makefile"), flags=re.MULTILINE).group(1).split())
    named = re.findall(r"(?:^|`)make ([a-z-]+)", text(name), flags=re.MULTILINE)
    assert named
    assert set(named) <= targets


def test_the_map_names_real_rooms_every_equation_and_every_notebook():
    table = text("README.md").split("## The map")[1].split("\n## ")[0]
    rows = [line.strip("| \n").split(" | ") for line in table.splitlines() if line.startswith("| ")][1:]
    rooms = {room for row in rows for room in re.findall(r"`([\w.]+)`", row[1])}
    assert sorted(room for room in rooms if find_spec(f"mannbv.{room}") is None) == []
    met = set()
    for row in rows:
        for first, last in re.findall(r"\((\d+)\)(?:–\((\d+)\))?", row[3]):
            met |= set(range(int(first), int(last or first) + 1))
    assert met == set(range(1, 30))
    assert set(re.findall(r"notebooks/(\w+\.ipynb)", table)) == {path.name for path in NOTEBOOKS}


def test_contributing_fits_one_screen():
    assert len(text("CONTRIBUTING.md").splitlines()) <= 40


def test_the_citation_agrees_with_the_project():
    cff = yaml.safe_load(text("CITATION.cff"))
    assert {"cff-version", "message", "title", "authors"} <= set(cff)
    assert (cff["cff-version"], cff["version"], cff["license"]) == ("1.2.0", PROJECT["version"], PROJECT["license"])
    assert [author["name"] for author in cff["authors"]] == [author["name"] for author in PROJECT["authors"]]
