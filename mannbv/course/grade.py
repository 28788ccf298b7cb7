"""Grade handed-in copies of the course's notebooks: `python -m mannbv grade FOLDER`.

A copy's own cells run first, as they stand, in a kernel of its own; then the course's check cells run in that kernel,
taken from the solved notebook, and only their verdicts count. So a deleted, moved or softened check cell changes
nothing. A copy that shadows `check`, or patches the checkers, meets fresh ones; one that sets out to cheat, by patching
the library itself, may still succeed: read what looks too good.

Students' code runs with the rights of whoever grades. Grade in a container, or an account of its own, without secrets.
"""

import ast
import contextlib
import csv
import functools
import hashlib
import io
import json
import logging
import os
import re
import secrets
import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from subprocess import DEVNULL

import nbformat.v4 as notebook
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient
from nbclient.exceptions import CellTimeoutError, DeadKernelError
from tqdm import tqdm

from mannbv import archive

COURSE = Path(__file__).resolve().parents[2] / "notebooks"
COLUMNS = ("file", "notebook", "exercise", "passed", "says", "seconds", "raised", "sha256")
FRESH = """\
import sys
for name in [name for name in sys.modules if name.startswith("mannbv.course.check")]:
    del sys.modules[name]"""
LATE = "out of time"
_LOG = logging.getLogger(__name__)
_LOG.addHandler(logging.NullHandler())
_LOG.propagate = False  # what happens to a copy stands in its rows


@dataclass(frozen=True)
class Exercise:
    """The answer's name(s), such as my_contact, and the source of the cell that checks it."""

    names: tuple[str, ...]
    check: str


@dataclass(frozen=True)
class Lesson:
    """A notebook of the course: name (file stem), title (first line), the cell ids that no other has, its exercises."""

    name: str
    title: str
    ids: frozenset[str]
    exercises: tuple[Exercise, ...]


def lessons(folder: Path) -> list[Lesson]:
    """The notebooks of a folder. Raises ValueError when none of them has exercises, or one cannot be read."""
    read = {path.stem: _cells(path.read_bytes(), path) for path in sorted(folder.glob("*.ipynb"))}
    found = []
    for name, cells in read.items():
        others = {cell["id"] for other, theirs in read.items() if other != name for cell in theirs}
        ids = frozenset(cell["id"] for cell in cells) - others
        try:
            exercises = tuple(_exercises(cells))
        except (SyntaxError, ValueError) as error:
            raise ValueError(f"{folder / name}.ipynb: {error}") from None
        found.append(Lesson(name, _headings(cells)[0], ids, exercises))
    if not any(lesson.exercises for lesson in found):
        raise ValueError(f"{folder}: no solved notebook here; name the folder that holds them with --notebooks DIR")
    return found


def grade(
    folder: Path, out: Path, course: Path = COURSE, limit: float = 120.0, report: Callable[[str], object] | None = None
) -> tuple[list[list[dict]], int]:
    """Grade every notebook below `folder` into the table `out`, and return the rows of each copy.

    limit: what a copy may take in all [s]. report: is given a line on each copy, as soon as it is graded. The second
    number counts the copies left alone, graded before with the same content. `out` is replaced whole after every copy,
    so that an interruption loses no more than the copy under way. Its rows go by the
    copies' paths, so name the folder alike each time. Raises ValueError for a limit, folder or table that cannot be.
    """
    if not 0 < limit < float("inf"):
        raise ValueError(f"grade: --limit must be a positive number of seconds, got {limit:g}")
    if not folder.is_dir():
        raise ValueError(f"{folder}: no such folder; name the one that holds the handed-in copies")
    paths = sorted(p for p in folder.rglob("*.ipynb") if p.is_file() and ".ipynb_checkpoints" not in p.parts)
    if not paths:
        raise ValueError(f"{folder}: no notebook (*.ipynb) in it or below")
    known, table, kept = lessons(course), read_table(out), 0
    write_table(out, table)  # now, rather than after an hour, if it cannot be written
    width = max(len(_plain(path.as_posix())) for path in paths)
    with tqdm(paths, unit="copy", dynamic_ncols=True, disable=None) as bar:  # on a terminal's standard error
        for path in bar:
            name = _plain(path.as_posix())
            rows = grade_copy(path, known, course, limit, table.get(name, []))
            kept += rows is table.get(name)
            if rows is not table.get(name):
                table[name] = rows
                write_table(out, table)
            if report:
                with bar.external_write_mode():
                    report(f"{name:{width}}  {score(rows)}")
    return [table[_plain(path.as_posix())] for path in paths], kept


def grade_copy(path: Path, known: Sequence[Lesson], course: Path, limit: float, before: list[dict]) -> list[dict]:
    """The rows of one copy, one an exercise; `before` itself if it still holds."""

    def row(lesson="", exercise="", passed: bool | str = "", says="", seconds="", raised="", digest="") -> dict:
        values = (path.as_posix(), lesson, exercise, passed, says, seconds, raised, digest)
        return dict(zip(COLUMNS, map(_plain, values), strict=True))

    try:
        raw = path.read_bytes()
        cells = _cells(raw, path)
    except OSError as error:
        return [row(says=f"cannot be read: {error.strerror}")]
    except ValueError:
        return [row(says="no notebook of format 4: damaged, or saved by another program")]
    lesson = recognise(cells, path, known)
    if lesson is None:
        return [row(says="no notebook of this course: neither its cells, its title nor its name is known")]
    if not lesson.exercises:
        return [row(lesson.name, says=f"{lesson.title.lstrip('# ')}: a page without exercises, nothing to grade")]
    digest = hashlib.sha256(raw + repr(lesson.exercises).encode() + _checkers()).hexdigest()
    longer = [old for old in before if old["says"].startswith(LATE) and not old["says"].endswith(_may_take(limit))]
    if before and not longer and all(old["sha256"] == digest for old in before):
        return before
    verdicts, raised, seconds = run(cells, lesson, course, limit)
    return [
        row(lesson.name, exercise.names[0], passed, says, f"{seconds:.1f}", raised, digest)
        for exercise, (passed, says) in zip(lesson.exercises, verdicts, strict=True)
    ]


@functools.cache
def _checkers() -> bytes:
    """What decides, beside the notebooks: a mended checker grades anew."""
    return b"".join(path.read_bytes() for path in sorted((Path(__file__).parent / "check").glob("*.py")))


def recognise(cells: list[dict], path: Path, known: Iterable[Lesson]) -> Lesson | None:
    """Which notebook a copy is of: by its cells' ids, else its title, else its name; None for none of ours."""
    ids = {cell["id"] for cell in cells}
    best = max(known, key=lambda lesson: len(lesson.ids & ids))
    if len(best.ids & ids) >= 3:  # one or two may be chance
        return best
    titles = _headings(cells)
    by_title = [lesson for lesson in known if lesson.title in titles]
    by_name = [lesson for lesson in known if lesson.name in path.stem]
    return next(iter(by_title + by_name), None)


def run(cells: list[dict], lesson: Lesson, course: Path, limit: float) -> tuple[list[tuple[bool, str]], str, float]:
    """Run a copy's code cells, then the lesson's checks: (passed, what it says) of each, what raised, seconds."""
    token = secrets.token_hex(8)
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    codes, places = [cell["source"] for cell in code], [_place(n, cell["id"]) for n, cell in enumerate(code, 1)]
    checks = [
        exercise.check + f"\n__import__('builtins').print('\\n{token}', done is True)" for exercise in lesson.exercises
    ]
    sheet = notebook.new_notebook(cells=[notebook.new_code_cell(source) for source in (*codes, FRESH, *checks)])
    began, end = time.monotonic(), ""
    with _kernel(sheet, course, began + limit) as execute:
        for number, cell in enumerate(sheet.cells, 1):
            try:
                execute(cell, number - 1)
            except Exception as error:  # whatever one copy does, the others are graded
                place = places[number - 1] if number <= len(codes) else "a check"
                end = f"stopped with {type(error).__name__} in {place}"
                if isinstance(error, CellTimeoutError):
                    end = f"{LATE} in {place}: {_may_take(limit)}"
                elif isinstance(error, DeadKernelError):
                    end = f"its kernel died in {place}"
                break
            cell.metadata["ran"] = True
    faults = [(k, error) for k, cell in enumerate(sheet.cells[: len(codes)]) if (error := _error(cell))]
    stopped = [(codes[k], f"its {places[k]} stopped with {error.partition(':')[0]}") for k, error in faults]
    verdicts = [
        _verdict(cell, exercise, token, stopped) if "ran" in cell.metadata else (False, end)
        for cell, exercise in zip(sheet.cells[len(codes) + 1 :], lesson.exercises, strict=True)
    ]
    raised = f"{places[faults[0][0]]}: {faults[0][1]}" if faults else ""
    raised += f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
    return verdicts, raised, time.monotonic() - began


class _Client(NotebookClient):
    """Keeps errors and the end of what is printed, so that a copy that prints without end fills no memory."""

    def output(self, outs, msg, display_id, cell_index):
        if msg["msg_type"] == "stream":
            msg["content"]["text"] = msg["content"]["text"][-2000:]
            del outs[:-20]
        elif msg["msg_type"] != "error":
            return None
        return super().output(outs, msg, None, cell_index)

    def handle_comm_msg(self, outs, msg, cell_index):
        """Widgets talk to nobody here."""


@contextlib.contextmanager
def _kernel(sheet, course: Path, deadline: float):
    """A kernel of this very interpreter, in a throw-away copy of what lies beside the course's notebooks."""
    with tempfile.TemporaryDirectory(prefix="mannbv-grade-", ignore_cleanup_errors=True) as folder:
        place = Path(folder) / "notebooks"
        shutil.copytree(course, place, ignore=shutil.ignore_patterns("*.ipynb", ".*"))
        manager = AsyncKernelManager(kernel_spec_manager=KernelSpecManager(kernel_dirs=[]), kernel_name="python3")
        client = _Client(
            sheet, km=manager, allow_errors=True, shutdown_kernel="immediate", record_timing=False, log=_LOG,
            store_widget_state=False, timeout_func=lambda _: max(0.001, deadline - time.monotonic()),
        )  # fmt: skip
        client.owns_km = True  # it cleans up what it was handed
        began = contextlib.ExitStack()
        try:
            began.enter_context(client.setup_kernel(cwd=str(place), stdout=DEVNULL, stderr=DEVNULL))
        except (RuntimeError, OSError) as error:
            raise ValueError(f"grade: no kernel starts here ({error}); see python -m mannbv doctor") from None
        group = getattr(manager.provisioner, "pgid", None)
        try:
            with began:
                yield client.execute_cell
        finally:
            if group and group != os.getpgrp():  # and what the copy has started
                with contextlib.suppress(OSError):
                    os.killpg(group, signal.SIGKILL)


def _place(number: int, name: str) -> str:
    return f"code cell {number}" + f" ({name})" * bool(name)


def _verdict(cell, exercise: Exercise, token: str, stopped: list[tuple[str, str]]) -> tuple[bool, str]:
    """Passed, and what the check says; `stopped`: source of each of the copy's cells that failed, and with what."""
    printed = "".join(o.text for o in cell.outputs if o.output_type == "stream" and o.name == "stdout")
    said, _, verdict = printed.rpartition(token)
    lines = [line for line in said.splitlines() if line.strip()]
    error = _error(cell)
    for name in exercise.names:
        if error == f"NameError: name '{name}' is not defined":
            why = (why for source, why in stopped if re.search(rf"\b{name}\b", source))
            return False, f"missing: {next(why, f'no cell defines {name}')}"
    return verdict.strip() == "True", error or (lines[-1] if lines else "the check said nothing")


def _may_take(limit: float) -> str:
    return f"a copy may take {limit:g} s"


def _error(cell) -> str:
    """The error that a cell ended in, on one line; "" for none."""
    error = next((f"{o.ename}: {o.evalue}" for o in cell.get("outputs", ()) if o.output_type == "error"), "")
    return re.sub(r"\(\d+\.py, (line \d+)\)", r"(\1)", error)  # the kernel's name for a cell says nothing


def _cells(raw: bytes, path: Path) -> list[dict]:
    """id, cell_type, source and tags of each cell, whatever else is wrong with the notebook."""
    try:
        return [
            {
                "id": str(cell.get("id", "")),
                "cell_type": cell["cell_type"],
                "source": "".join(cell["source"]),
                "tags": list(cell.get("metadata", {}).get("tags", ())),
            }
            for cell in json.loads(raw)["cells"]
        ]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise ValueError(f"{path}: not a notebook of format 4; restore it") from None


def _headings(cells: list[dict]) -> list[str]:
    """First lines of the text cells."""
    return [cell["source"].strip().partition("\n")[0] for cell in cells if cell["cell_type"] == "markdown"] or [""]


def _exercises(cells: list[dict]) -> Iterable[Exercise]:
    """The code cells that follow one tagged `solution`: each asks about a my_..., with every check's imports so far."""
    imports, codes = [], [cell for cell in cells if cell["cell_type"] == "code"]
    for solution, cell in pairwise(codes):
        if "solution" not in solution["tags"] or "solution" in cell["tags"]:
            continue
        body = ast.parse(cell["source"]).body
        used = sorted((n for s in body for n in ast.walk(s) if isinstance(n, ast.Name)), key=lambda n: n.lineno)
        names = tuple(dict.fromkeys(n.id for n in used if n.id.startswith("my_")))
        imports += [ast.unparse(s) for s in body if isinstance(s, (ast.Import, ast.ImportFrom))]
        if not names or "done = " not in cell["source"]:
            raise ValueError(f"the check of {solution['source'][:40]!r} is not of the form done = check.name(my_...)")
        yield Exercise(names, "\n".join(["done = None", *dict.fromkeys(imports), cell["source"]]))


def _plain(value) -> str:
    """One short line that no spreadsheet takes for a formula."""
    text = re.sub(r"\x1b\[[0-9;]*m", "", str(value))
    text = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    text = text if len(text) <= 300 else text[:299] + "…"
    return "'" + text if text[:1] in ("=", "+", "-", "@") else text


def read_table(path: Path) -> dict[str, list[dict]]:
    """The rows of an earlier run by file; {} if there is none. Raises ValueError for a table that is not ours."""
    if not path.exists():
        return {}
    table = {}
    with path.open(encoding="utf-8", newline="") as lines:
        reader = csv.DictReader(lines, strict=True)
        try:
            if tuple(reader.fieldnames or ()) != COLUMNS:
                raise ValueError
            for row in reader:
                if None in row or None in row.values():  # more or fewer fields
                    raise ValueError
                table.setdefault(row["file"], []).append(row)
        except (csv.Error, ValueError):
            raise ValueError(f"{path}: not a table that grade has written; name another with --out FILE") from None
    return table


def write_table(path: Path, table: dict[str, list[dict]]) -> None:
    """Replace the table whole."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(row for rows in table.values() for row in rows)
    archive.write_text(path, text.getvalue())


def score(rows: list[dict]) -> str:
    """Passed/total of a copy, and the first error of its cells; or why it has none."""
    if not rows[0]["exercise"]:
        return rows[0]["says"]
    marks = f"{sum(row['passed'].lower() == 'true' for row in rows)}/{len(rows)}"  # spreadsheets write TRUE
    return f"{marks}  {rows[0]['raised']}".rstrip()
