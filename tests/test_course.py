"""The two editions: what `make exercises` derives, keeps and refuses, and that it gives no answer away."""

import ast
import importlib
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).resolve().parent.parent
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
LESSONS = [path for path in NOTEBOOKS if path.name[0].isdigit()]  # the others have no exercises
ANSWER = "# a hint\nimport math\n\nFACTOR = 3\n\n\ndef helper(x):\n    return FACTOR * x\n\n\n" + (
    "def my_triple(x, twice=False):\n"
    '    """Three times x, '
    'or six."""\n    return helper(x) * (1 + twice)  # the answer\n\n\ndef my_root(x):\n    return math.sqrt(x)'
)
STUBS = "import math\n\n\n" + (
    'def my_triple(x, twice=False):\n    """Three times x, or six."""\n    ...  # your turn\n\n\n'
    "def my_root(x):\n    ...  # your turn"
)


def derive(folder: Path, root: Path = ROOT) -> subprocess.CompletedProcess:
    """tools/course.py of a checkout, its copies into a folder."""
    command = [sys.executable, str(root / "tools" / "course.py"), str(folder)]
    return subprocess.run(command, cwd=folder.parent, capture_output=True, text=True)


def cells(path: Path) -> list[dict]:
    """A notebook's cells, their sources joined."""
    return [cell | {"source": "".join(cell["source"])} for cell in json.loads(path.read_text("utf-8"))["cells"]]


def is_solution(cell: dict) -> bool:
    return "solution" in cell["metadata"].get("tags", ())


def exercises(path: Path) -> list[tuple[dict, dict]]:
    """(solution cell, the cell after it) for each exercise."""
    every = cells(path)
    return [(cell, every[k + 1]) for k, cell in enumerate(every) if is_solution(cell)]


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def course(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("derived") / "course"
    done = derive(folder)
    assert (done.returncode, done.stderr) == (0, "")
    return folder


@pytest.fixture
def small(tmp_path) -> Path:
    """A checkout with two small notebooks that have been run, and a record."""
    for tool in ("course.py", "notebooks.py"):
        (tmp_path / "tools").mkdir(exist_ok=True)
        shutil.copy(ROOT / "tools" / tool, tmp_path / "tools")
    (tmp_path / "notebooks" / "records").mkdir(parents=True)
    (tmp_path / "notebooks" / "records" / "a.json").write_text("[1]")
    for name in ("a", "b"):
        solved(tmp_path / "notebooks" / f"{name}.ipynb", ANSWER)
    return tmp_path


def solved(path: Path, answer: str) -> None:
    output = nbformat.v4.new_output("stream", text="42\n")
    parts = [
        nbformat.v4.new_markdown_cell("Read [b](b.ipynb).", id="title"),
        nbformat.v4.new_code_cell(answer, id="answer", metadata={"tags": ["solution"]}, execution_count=1),
        nbformat.v4.new_code_cell("print(42)", id="check", execution_count=2, outputs=[output]),
    ]
    nbformat.write(nbformat.v4.new_notebook(cells=parts), path)


# --- what is derived ------------------------------------------------------------------------------------------------


def test_every_notebook_and_record_has_a_copy_the_same_byte_for_byte_each_time(course, tmp_path):
    assert derive(tmp_path / "again").returncode == 0
    assert contents(tmp_path / "again") == contents(course)
    records = {f"records/{path.name}" for path in (ROOT / "notebooks" / "records").iterdir()}
    assert set(contents(course)) == {path.name for path in NOTEBOOKS} | records
    assert len(LESSONS) == 15


def test_an_answer_keeps_its_imports_signatures_and_docstrings_and_loses_all_else(small):
    assert derive(small / "course", small).returncode == 0
    copy = cells(small / "course" / "a.ipynb")
    assert [cell["source"] for cell in copy] == ["Read [b](b.ipynb).", STUBS, "print(42)"]
    assert [cell["id"] for cell in copy] == ["title", "answer", "check"]
    assert is_solution(copy[1])
    assert [(cell["outputs"], cell["execution_count"]) for cell in copy[1:]] == [([], None)] * 2
    assert (small / "course" / "records" / "a.json").read_text() == "[1]"


def leaks(path: Path, copy: Path) -> list[str]:
    """Lines of the answers, imports and signatures aside, that stand in the copy but nowhere else in the notebook."""
    known = "\n".join(cell["source"] for cell in cells(path) if not is_solution(cell))
    read = "\n".join(cell["source"] for cell in cells(copy))
    lines = {line.strip() for solution, _ in exercises(path) for line in solution["source"].splitlines()}
    answers = {line for line in lines if len(line) > 12 and not re.match(r"def my_|import |from ", line)}
    assert answers
    return sorted(line for line in answers if line not in known and line in read)


@pytest.mark.parametrize("path", LESSONS, ids=lambda path: path.stem)
def test_no_line_of_an_answer_is_found_in_the_copy(path, course):
    assert leaks(path, course / path.name) == []
    assert leaks(path, path)  # the solved edition would be caught


def test_the_copies_hold_no_output_and_every_link_between_them_leads_somewhere(course):
    for path in sorted(course.glob("*.ipynb")):
        for cell in cells(path):
            assert cell.get("outputs", []) == [] and cell.get("execution_count") is None
            links = re.findall(r"\]\((?!https?:|#)([^)#]+)", cell["source"]) if cell["cell_type"] == "markdown" else []
            assert [link for link in links if not (course / link).exists()] == []
            assert not re.search(r"solved version|stored\s+answer", cell["source"])


# --- exercises ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", LESSONS, ids=lambda path: path.stem)
def test_three_to_five_exercises_each_checked_by_a_checker_that_exists_and_to_do_at_first(path, course, capsys):
    room = re.search(
        r"^from mannbv\.course\.check import (\w+) as check$", "\n".join(map(source, cells(path))), re.MULTILINE
    )
    checkers = importlib.import_module(f"mannbv.course.check.{room.group(1)}")
    turns = exercises(course / path.name)
    assert 3 <= len(turns) <= 5
    for stub, check in turns:
        *imports, last = ast.parse(check["source"]).body
        assert all(ast.unparse(node) == room.group(0) for node in imports)
        name, answers = re.fullmatch(r"done = check\.(\w+)\((my_\w+(?:, my_\w+)*)\)", ast.unparse(last)).groups()
        assert callable(getattr(checkers, name))
        assert answers.split(", ") == re.findall(r"^def (\w+)", stub["source"], re.MULTILINE)
        space = {"check": checkers}
        exec(stub["source"] + "\n" + check["source"], space)
        assert space["done"] is False
        assert capsys.readouterr().out == "to do\n"


def source(cell: dict) -> str:
    return cell["source"]


def test_a_copy_runs_without_stored_outputs_and_a_cell_that_raises_is_noticed(small):
    assert derive(small / "course", small).returncode == 0
    command = [sys.executable, "-m", "pytest", "-c", str(ROOT / "tools" / "course.ini"), "--rootdir=."]
    command += ["-p", "no:cacheprovider", "course"]
    env = {key: value for key, value in os.environ.items() if not key.startswith("PYTEST")}
    run = subprocess.run(command, cwd=small, env=env, capture_output=True, text=True)
    assert run.returncode == 0 and "4 passed" in run.stdout
    solved(small / "course" / "a.ipynb", "1 / 0")
    run = subprocess.run(command, cwd=small, env=env, capture_output=True, text=True)
    assert run.returncode == 1 and "1 failed, 3 passed" in run.stdout


# --- what is kept ---------------------------------------------------------------------------------------------------


def change(path: Path, index: int, **values) -> None:
    notebook = json.loads(path.read_text("utf-8"))
    notebook["cells"][index] |= values
    path.write_text(json.dumps(notebook), "utf-8")


EDITS = {
    "an answer": lambda path: change(path, 1, source="def my_triple(x):\n    return 3 * x"),
    "a note": lambda path: change(path, 0, source=["Read [b](b.ipynb).\n", "Mine: see page 3."]),
    "a cell's kind": lambda path: change(path, 2, cell_type="raw"),
    "a file that is no notebook": lambda path: path.write_text("my notes"),
    "a notebook of the reader's own": lambda path: solved(path, "mine = 1"),
}


@pytest.mark.parametrize("edit", EDITS)
def test_what_a_reader_has_edited_is_kept_and_named_while_the_others_are_made_anew(small, edit):
    folder = small / "course"
    assert derive(folder, small).returncode == 0
    EDITS[edit](folder / "a.ipynb")
    mine = (folder / "a.ipynb").read_bytes()
    solved(small / "notebooks" / "b.ipynb", ANSWER.replace("Three", "3"))
    done = derive(folder, small)
    assert (done.returncode, done.stderr) == (0, "")
    assert (folder / "a.ipynb").read_bytes() == mine
    assert "3 times x" in (folder / "b.ipynb").read_text()
    (line,) = (line for line in done.stdout.splitlines() if "kept, " in line and "a.ipynb" in line)
    assert "delete or rename it" in line
    assert "b.ipynb" not in done.stdout
    (folder / "a.ipynb").unlink()
    assert "kept, it" not in derive(folder, small).stdout


def test_a_copy_that_was_only_run_is_made_anew(small):
    folder = small / "course"
    assert derive(folder, small).returncode == 0
    before = contents(folder)
    change(folder / "a.ipynb", 2, outputs=[nbformat.v4.new_output("stream", text="42\n")], execution_count=7)
    notebook = json.loads((folder / "a.ipynb").read_text())
    notebook["cells"].append(nbformat.v4.new_code_cell("", id="below"))  # JupyterLab adds one below the last
    (folder / "a.ipynb").write_text(json.dumps(notebook))
    assert contents(folder) != before
    done = derive(folder, small)
    assert done.returncode == 0 and "2 fresh, 0 kept" in done.stdout
    assert contents(folder) == before


# --- what is refused ------------------------------------------------------------------------------------------------

FAULTS = {  # what is wrong with the last notebook -> what is said
    "torn": (lambda path: path.write_text('{"cells": ['), "not a notebook"),
    "nameless": (lambda path: solved(path, "x = 3"), "solution cell `answer`: it defines no function my_..."),
    "no Python": (lambda path: solved(path, "def my_("), "solution cell `answer`: "),
    "a folder": (lambda path: (path.unlink(), path.mkdir()), "b.ipynb"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_bad_notebook_is_named_in_one_line_and_no_copy_is_touched(small, fault):
    folder, (spoil, complaint) = small / "course", FAULTS[fault]
    assert derive(folder, small).returncode == 0
    before = contents(folder)
    solved(small / "notebooks" / "a.ipynb", ANSWER.replace("Three", "3"))  # would change its copy
    spoil(small / "notebooks" / "b.ipynb")
    done = derive(folder, small)
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert "b.ipynb" in line and complaint in line
    assert contents(folder) == before


def test_without_notebooks_nothing_is_made(small):
    shutil.rmtree(small / "notebooks")
    done = derive(small / "course", small)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert "holds no notebook" in done.stderr
    assert not (small / "course").exists()
