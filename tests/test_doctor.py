"""Broken on purpose: the doctor sees each, in one line with a remedy, and the exit status tells."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from importlib import metadata
from pathlib import Path

import pytest

from mannbv import render
from mannbv.__main__ import main
from mannbv.lab import doctor


def lines(check) -> list[str]:
    return [str(finding) for finding in doctor.examine([check])]


def wrong(check) -> str:
    """The one thing that is wrong; it has a remedy and stands on one line."""
    (finding,) = [finding for finding in doctor.examine([check]) if finding.level == "wrong"]
    assert finding.remedy and "\n" not in str(finding)
    return str(finding)


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Put a package's metadata before all other: installed(name, version, *header lines)."""
    monkeypatch.syspath_prepend(str(tmp_path / "site"))

    def install(name: str, version: str, *headers: str) -> None:
        folder = tmp_path / "site" / f"{name}-{version}.dist-info"
        folder.mkdir(parents=True)
        head = ["Metadata-Version: 2.1", f"Name: {name}", f"Version: {version}", *headers]
        (folder / "METADATA").write_text("\n".join(head) + "\n")

    return install


# --- packages -------------------------------------------------------------------------------------------------------


def test_a_package_out_of_bounds_or_missing_is_named_with_its_remedy(installed):
    installed("mannbv", "9", "Requires-Dist: numpy>=99", "Requires-Dist: no-such-thing>=2", "Requires-Dist: scipy")
    said = [line for line in lines(doctor.packages) if line.startswith("wrong")]
    numpy = metadata.version("numpy")
    assert said == [
        f"wrong  numpy {numpy}, where mannbv asks for >=99; python -m pip install 'numpy>=99'",
        "wrong  no-such-thing is not installed; python -m pip install 'no-such-thing>=2'",
    ]


def test_a_missing_extra_and_an_outdated_installation_are_only_notes(installed):
    installed(
        "mannbv", "9", "Requires-Dist: scipy", "Provides-Extra: moon", "Provides-Extra: sun",
        'Requires-Dist: no-such-thing; extra == "moon"', 'Requires-Dist: numpy; extra == "sun"',
        'Requires-Dist: nor-this; sys_platform == "amiga"',
    )  # fmt: skip
    assert lines(doctor.packages) == [
        "ok     every requirement is installed and within its bounds",
        "note   extra [moon]: no-such-thing is not installed; if wanted: python -m pip install 'mannbv[moon]'",
        "ok     extra [sun]",
        "note   pyproject.toml has changed since mannbv was installed; make setup",
    ]


def test_a_torch_of_a_local_build_is_within_its_bounds(installed):
    installed("mannbv", "9", "Requires-Dist: torch==2.13.0")
    installed("torch", "2.13.0+cu130")
    assert lines(doctor.packages)[0].startswith("ok")


def test_an_uninstalled_mannbv_and_an_old_python_are_seen(installed, monkeypatch):
    installed("mannbv", "9", "Requires-Python: >=3.99")
    assert "where >=3.99 is needed" in wrong(doctor.python)

    def absent(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "requires", absent)
    assert "mannbv is not installed" in wrong(doctor.packages)


# --- Jupyter --------------------------------------------------------------------------------------------------------

MANAGER = "@jupyter-widgets/jupyterlab-manager"


@pytest.fixture
def labextensions(tmp_path, monkeypatch, installed):
    """JupyterLab looks here and nowhere else; labextensions(name, version) puts an extension there."""
    installed("jupyterlab_widgets", "3.0.17")
    installed("anywidget", "0.11.2")
    installed("ipywidgets", "8.1.9", "Requires-Dist: jupyterlab_widgets~=3.0.15")
    monkeypatch.setattr("jupyter_core.paths.jupyter_path", lambda *parts: [str(tmp_path / "lab")])

    def install(name: str, version: str) -> None:
        (tmp_path / "lab" / name).mkdir(parents=True, exist_ok=True)
        (tmp_path / "lab" / name / "package.json").write_text(json.dumps({"name": name, "version": version}))

    install(MANAGER, "5.0.16")
    install("anywidget", "0.11.0")
    return install


def test_widgets_whose_halves_fit_are_well(labextensions):
    assert [line[:3] for line in lines(doctor.widgets)] == ["ok ", "ok "]


@pytest.mark.parametrize(("extension", "package"), [(MANAGER, "jupyterlab_widgets"), ("anywidget", "anywidget")])
def test_a_missing_labextension_is_seen(labextensions, tmp_path, extension, package):
    shutil.rmtree(tmp_path / "lab" / extension)
    assert f"JupyterLab finds no {extension}; python -m pip install" in wrong(doctor.widgets)
    assert wrong(doctor.widgets).endswith(package)


@pytest.mark.parametrize(("extension", "version"), [(MANAGER, "3.1.11"), ("anywidget", "0.9.18")])
def test_a_labextension_of_another_time_is_seen(labextensions, extension, version):
    labextensions(extension, version)
    assert f"does not fit {extension} {version} in" in wrong(doctor.widgets)


def test_a_damaged_labextension_is_a_finding(labextensions, tmp_path):
    (tmp_path / "lab" / "anywidget" / "package.json").write_text("{")
    assert "widgets stops with JSONDecodeError" in wrong(doctor.widgets)


def test_python_halves_that_do_not_fit_each_other_are_seen(labextensions, installed, tmp_path):
    shutil.rmtree(tmp_path / "site" / "ipywidgets-8.1.9.dist-info")
    installed("ipywidgets", "7.8", "Requires-Dist: jupyterlab_widgets<3,>=1")
    assert "jupyterlab_widgets 3.0.17, where ipywidgets asks for <3,>=1" in wrong(doctor.widgets)


@pytest.fixture
def kernelspec(tmp_path, monkeypatch):
    """Jupyter meets this command as python3 first."""
    monkeypatch.setenv("JUPYTER_PATH", str(tmp_path))

    def spec(command: str) -> None:
        folder = tmp_path / "kernels" / "python3"
        folder.mkdir(parents=True)
        argv = [command, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
        (folder / "kernel.json").write_text(
            json.dumps({"argv": argv, "display_name": "Python 3", "language": "python"})
        )

    return spec


def script(path: Path, text: str) -> str:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize("command", ["python", "python3", sys.executable])
def test_a_kernel_that_is_this_interpreter_is_well(kernelspec, command):
    kernelspec(command)
    assert lines(doctor.kernel) == [f"ok     the kernel python3 is this interpreter, {sys.prefix}"]


def test_a_kernel_of_another_interpreter_is_seen_wherever_its_spec_lies(kernelspec, tmp_path):
    kernelspec(script(tmp_path / "other", "echo /elsewhere"))
    said = wrong(doctor.kernel)
    assert f"the kernel python3 is of /elsewhere, not of this {sys.prefix}" in said
    assert f"delete {tmp_path / 'kernels' / 'python3'}" in said


def test_a_kernel_that_cannot_start_is_seen(kernelspec, tmp_path):
    kernelspec(script(tmp_path / "other", "exit 1"))
    assert "has no ipykernel that loads" in wrong(doctor.kernel)
    (tmp_path / "other").unlink()
    assert "No such file" in wrong(doctor.kernel)


# --- places to write, threads ---------------------------------------------------------------------------------------


def test_an_unwritable_temporary_folder_is_seen(monkeypatch, tmp_path):
    assert lines(doctor.temporary)[0].startswith("ok")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    assert "set TMPDIR" in wrong(doctor.temporary)


@pytest.fixture
def plain_file(tmp_path) -> Path:
    """Below a plain file nobody can write, not even root."""
    (tmp_path / "file").write_text("")
    return tmp_path / "file"


def test_an_unwritable_numba_cache_dir_is_seen_and_a_good_one_used(monkeypatch, plain_file, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(plain_file / "cache"))
    (finding,) = doctor.examine_apart([doctor.cache])
    assert finding.level == "wrong" and f"NUMBA_CACHE_DIR={plain_file / 'cache'} cannot be written" in finding.what
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "good"))
    (finding,) = doctor.examine_apart([doctor.cache])
    assert finding.level == "ok" and str(tmp_path / "good") in finding.what


def test_no_folder_at_all_for_kernels_is_seen(plain_file, tmp_path):
    package = Path(doctor.__file__).parents[1]
    shutil.copytree(package, tmp_path / "mannbv", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "mannbv" / "kernels" / "flat" / "__pycache__").write_text("")
    places = {"PYTHONPATH": str(tmp_path), "XDG_CACHE_HOME": str(plain_file), "HOME": str(plain_file)}
    code = "from mannbv.lab import doctor; doctor.print_findings(['cache'])"
    environment = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"} | places
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, cwd=tmp_path, capture_output=True, text=True, check=True
    )
    said = json.loads(done.stdout.splitlines()[-1].removeprefix(doctor.MARK))
    assert said["level"] == "wrong" and "NUMBA_CACHE_DIR" in said["remedy"]


@pytest.mark.parametrize("value", ["many", "0", "-2", ""])
def test_a_senseless_number_of_threads_is_seen(monkeypatch, value):
    monkeypatch.setenv("OMP_NUM_THREADS", value)
    assert f"OMP_NUM_THREADS={value} is not a number of threads" in wrong(doctor.threads)


def test_more_threads_than_cores_are_a_note(monkeypatch):
    monkeypatch.setattr(doctor, "cores", lambda: 4)
    for value, level in (("4", "ok"), ("5", "note"), ("2,8", "ok"), ("8,2", "note")):
        monkeypatch.setenv("OMP_NUM_THREADS", value)
        assert lines(doctor.threads)[0].startswith(level)


@pytest.mark.parametrize(("quota", "count"), [("max 100000", 8), ("250000 100000", 2), ("50000 100000", 1)])
def test_a_containers_quota_counts_as_cores(monkeypatch, quota, count):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    monkeypatch.setattr(Path, "read_text", lambda *_, **__: quota)
    assert doctor.cores() == count


# --- compiled code --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("broken", "by"), [(lambda part: part.flip(0), "a mirrored row"), (lambda part: 0.9 * part, "a darker one")]
)
def test_a_kernel_that_draws_wrongly_is_seen(monkeypatch, broken, by):
    assert [line[:2] for line in lines(doctor.picture)] == ["ok"]
    honest = render.render

    def compiled_wrongly(scene, camera, pose, method="auto"):
        image = honest(scene, camera, pose, method=method)
        spoilt = type(image)(broken(image.color), broken(image.depth), broken(image.opacity))
        return spoilt if method == "tiled" else image

    monkeypatch.setattr(render, "render", compiled_wrongly)
    assert "a compiled kernel draws wrongly, off by 0." in wrong(doctor.picture), by


def test_missing_scenes_are_seen(monkeypatch):
    monkeypatch.setattr("mannbv.world.scenes", list)
    assert "no bundled scene" in wrong(doctor.scenes)


def test_a_library_that_takes_the_interpreter_down_is_a_line_and_the_other_checks_go_on(tmp_path, monkeypatch):
    (tmp_path / "torch.py").write_text("import os\nos.abort()\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    found = list(doctor.examine_apart([doctor.figure, doctor.torch, doctor.figure]))
    assert [finding.level for finding in found] == ["ok", "wrong", "ok"]
    assert found[1].what.startswith("torch: the interpreter ends with status -")


def test_a_library_that_does_not_load_is_a_line(tmp_path, monkeypatch):
    (tmp_path / "torch.py").write_text("raise ImportError('libgomp.so.1: cannot open\\nshared object')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (finding,) = doctor.examine_apart([doctor.torch])
    assert finding.level == "wrong" and finding.what == "torch stops with ImportError: libgomp.so.1: cannot open"


# --- all of it ------------------------------------------------------------------------------------------------------


def test_the_status_tells_whether_something_is_wrong(monkeypatch, capsys):
    def well():
        yield doctor.Finding("ok", "well")
        yield doctor.Finding("note", "an oddity", "if it hurts")

    def broken():
        yield doctor.Finding("ok", "half")
        raise OSError("no\nway")

    monkeypatch.setattr(doctor, "COMPILED", ())
    monkeypatch.setattr(doctor, "LIGHT", (well,))
    assert main(["doctor"]) == 0
    assert capsys.readouterr().out == "ok     well\nnote   an oddity; if it hurts\nNothing is wrong.\n"
    monkeypatch.setattr(doctor, "LIGHT", (broken, well))
    assert main(["doctor"]) == 1
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "ok     half" and said[1].startswith("wrong  broken stops with OSError: no; ")
    assert said[2:] == ["ok     well", "note   an oddity; if it hurts", "1 wrong"]


def test_this_installation_is_well(capsys):
    assert main(["doctor"]) == 0, capsys.readouterr().out
    said = capsys.readouterr().out.splitlines()
    assert said[-1] == "Nothing is wrong."
    for part in (
        "Python 3.",
        "requirement",
        "jupyterlab-manager",
        "kernel python3",
        "torch ",
        "cores",
        "kernels are kept",
    ):
        assert any(part in line for line in said)
