"""Grading in small: a course of two notebooks, a class that hands in what classes hand in."""

import csv
import json
from pathlib import Path

import pytest

from mannbv.__main__ import main
from mannbv.course import grade

LIMIT = 15.0  # [s]; the copy that hangs takes it whole
IMPORT = "from mannbv.course.check import verdict as check"
TWICE = "done = check.Exercise(lambda x: {check.AGREES: 2 * x, 'that is a square': x * x}, [(1,), (3,)])(my_twice)"
THRICE = "done = check.Exercise(lambda x: {check.AGREES: 3 * x}, [(1,), (3,)])(my_thrice)"
SQUARE = "done = check.Exercise(lambda x: {check.AGREES: x * x}, [(2,), (3,)])(my_square)"


def cell(name: str, source: str, kind: str = "code", tags=()) -> dict:
    extra = {"outputs": [], "execution_count": None} if kind == "code" else {}
    return {"cell_type": kind, "id": name, "metadata": {"tags": list(tags)}, "source": source, **extra}


def twice() -> list[dict]:
    return [
        cell("title", "# 01 · Twice\n\nOne number and another.", "markdown"),
        cell("record", "import json\n\nfactor = json.load(open('records/factor.json'))"),
        cell("my-twice", "def my_twice(x):\n    return factor * x", tags=["solution"]),
        cell("check-twice", f"{IMPORT}\n\n{TWICE}"),
        cell("my-thrice", "def my_thrice(x):\n    return 3 * x", tags=["solution"]),
        cell("check-thrice", THRICE),
    ]


def square() -> list[dict]:
    return [
        cell("title", "# 02 · Square", "markdown"),
        cell("my-square", "def my_square(x):\n    return x * x", tags=["solution"]),
        cell("check-square", f"{IMPORT}\n\n{SQUARE}"),
    ]


def page() -> list[dict]:
    """Without exercises."""
    return [cell("title", "# A page", "markdown"), *(cell(f"page-{k}", "1 + 1") for k in range(5))]


def save(path: Path, cells: list[dict]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"cells": cells, "metadata": {}, "nbformat": 4, "nbformat_minor": 5}))
    return path


def edited(cells: list[dict], **sources: str | None) -> list[dict]:
    """The cells with other sources by id (- written _); without those that are None."""
    sources = {name.replace("_", "-"): source for name, source in sources.items()}
    return [c | {"source": sources.get(c["id"], c["source"])} for c in cells if sources.get(c["id"], "") is not None]


def anonymous(cells: list[dict]) -> list[dict]:
    return [{key: value for key, value in c.items() if key != "id"} for c in cells]


PATCH = """import mannbv.course.check.verdict
mannbv.course.check.verdict.Exercise = lambda *_: lambda mine: True
class check:
    AGREES, Exercise = "", lambda *_: lambda mine: True
done = True
def my_twice(x): return x * x"""
WIDGET = """import ipywidgets
from IPython.display import display
print = lambda *_: None
box = ipywidgets.Output()
display(box)
with box:
    1 / 0"""
NOISY = "def my_twice(x):\n    for _ in range(3000):\n        print('y' * 999)\n    return 2 * x"
COPIES = {
    "alice/01_twice.ipynb": twice(),
    "bob_01.ipynb": edited(twice(), my_twice="def my_twice(x):\n    return x * x", check_twice="done = True"),
    "carol/mine.ipynb": edited(twice(), check_twice=None, my_thrice=None, check_thrice=None)[::-1],
    "dave/01_twice.ipynb": edited(twice(), my_thrice="while True:\n    print('and on')"),
    "erin/01_twice.ipynb": edited(twice(), my_thrice="import os\n\nos._exit(1)"),
    "frank/copy (3).ipynb": anonymous(twice()),
    "gina/02_square_final.ipynb": anonymous(square())[1:],
    "heidi/notes.ipynb": [cell("a", "print(1)"), cell("title", "# Shopping", "markdown")],
    "hugo/03_page.ipynb": page(),
    "ivan/01_twice.ipynb": edited(twice(), my_twice="def my_twice(x:\n    return", my_thrice="def my_thrice(x): ..."),
    "judy/01_twice.ipynb": edited(twice(), my_twice=NOISY, my_thrice="def my_thrice(x):\n    open('x', 'w').close()"),
    "kim/01_twice.ipynb": edited(
        twice(), record=f"{WIDGET}\nfactor = 2", my_twice="def my_twice(x):\n    return 2 * x"
    ),
    "mallory/01_twice.ipynb": edited(twice(), my_twice=PATCH, check_twice=""),
    "mallory/.ipynb_checkpoints/01_twice.ipynb": twice(),
}


@pytest.fixture(scope="module")
def course(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("course")
    save(folder / "01_twice.ipynb", twice())
    save(folder / "02_square.ipynb", square())
    save(folder / "03_page.ipynb", page())
    (folder / "records").mkdir()
    (folder / "records" / "factor.json").write_text("2")
    return folder


def hand_in(folder: Path, names=COPIES) -> Path:
    for name in names:
        save(folder / name, COPIES[name])
    return folder


@pytest.fixture(scope="module")
def graded(course, tmp_path_factory) -> tuple[Path, Path]:
    """A class's folder and its table."""
    folder = hand_in(tmp_path_factory.mktemp("class"))
    (folder / "torn.ipynb").write_text('{"cells": [')
    out = folder.parent / "marks" / "grades.csv"
    command = ["grade", str(folder), "--out", str(out), "--notebooks", str(course), "--limit", str(LIMIT)]
    assert main(command) == 0
    return folder, out


def rows(graded: tuple[Path, Path], name: str) -> list[dict]:
    folder, out = graded
    with out.open(newline="", encoding="utf-8") as lines:
        return [row for row in csv.DictReader(lines) if row["file"] == (folder / name).as_posix()]


def marks(graded, name: str) -> list[tuple[str, str, str]]:
    return [(row["exercise"], row["passed"], row["says"]) for row in rows(graded, name)]


def test_a_right_copy_passes_every_exercise(graded):
    agrees = "agrees with the library"
    assert marks(graded, "alice/01_twice.ipynb") == [("my_twice", "True", agrees), ("my_thrice", "True", agrees)]
    (row, _) = rows(graded, "alice/01_twice.ipynb")
    assert row["notebook"] == "01_twice" and row["raised"] == "" and float(row["seconds"]) > 0


def test_a_softened_check_cell_helps_nobody(graded):
    assert marks(graded, "bob_01.ipynb")[0] == ("my_twice", "False", "that is a square")
    assert marks(graded, "bob_01.ipynb")[1][1] == "True"


def test_shadowing_or_patching_the_checker_helps_nobody(graded):
    assert marks(graded, "mallory/01_twice.ipynb")[0] == ("my_twice", "False", "that is a square")


def test_deleted_and_moved_cells_are_missing_or_found(graded):
    # turned around: my_twice stands before what it needs, which is there when it is called
    assert marks(graded, "carol/mine.ipynb") == [
        ("my_twice", "True", "agrees with the library"),
        ("my_thrice", "False", "missing: no cell defines my_thrice"),
    ]


def test_widgets_and_a_shadowed_print_disturb_nothing(graded):
    assert [passed for _, passed, _ in marks(graded, "kim/01_twice.ipynb")] == ["True", "True"]


def test_a_copy_that_hangs_says_so_and_the_others_go_on(graded):
    late = f"out of time in code cell 4 (my-thrice): a copy may take {LIMIT:g} s"
    assert marks(graded, "dave/01_twice.ipynb") == [("my_twice", "False", late), ("my_thrice", "False", late)]


def test_a_copy_that_kills_its_kernel_says_so_and_the_others_go_on(graded):
    died = "its kernel died in code cell 4 (my-thrice)"
    assert marks(graded, "erin/01_twice.ipynb") == [("my_twice", "False", died), ("my_thrice", "False", died)]


@pytest.mark.parametrize("name", ["frank/copy (3).ipynb", "gina/02_square_final.ipynb"])
def test_without_cell_ids_the_title_tells_and_without_that_the_name(graded, name):
    assert {row["passed"] for row in rows(graded, name)} == {"True"}
    assert {row["notebook"] for row in rows(graded, name)} == {"01_twice" if "frank" in name else "02_square"}


def test_what_is_no_notebook_of_the_course_gets_a_line(graded):
    assert [says[:31] for _, _, says in marks(graded, "heidi/notes.ipynb")] == ["no notebook of this course: nei"]
    assert [says[:23] for _, _, says in marks(graded, "torn.ipynb")] == ["no notebook of format 4"]
    assert rows(graded, "mallory/.ipynb_checkpoints/01_twice.ipynb") == []


def test_a_page_of_the_course_without_exercises_has_nothing_to_grade(graded):
    (row,) = rows(graded, "hugo/03_page.ipynb")
    assert row["notebook"] == "03_page" and row["exercise"] == row["passed"] == ""
    assert row["says"] == "A page: a page without exercises, nothing to grade"


def test_errors_are_recorded_and_empty_answers_are_to_do(graded):
    missing = "missing: its code cell 2 (my-twice) stopped with SyntaxError"
    assert marks(graded, "ivan/01_twice.ipynb") == [("my_twice", "False", missing), ("my_thrice", "False", "to do")]
    raised = rows(graded, "ivan/01_twice.ipynb")[0]["raised"]
    assert raised.startswith("code cell 2 (my-twice): SyntaxError") and raised.endswith("(line 1) (and 1 more)")
    assert grade.score(rows(graded, "ivan/01_twice.ipynb")) == f"0/2  {raised}"


def test_a_chatty_answer_is_judged_and_writes_into_a_throw_away_folder(graded, course):
    before = sorted(path.name for path in course.rglob("*"))
    assert [passed for _, passed, _ in marks(graded, "judy/01_twice.ipynb")] == ["True", "False"]
    assert before == ["01_twice.ipynb", "02_square.ipynb", "03_page.ipynb", "factor.json", "records"]


def test_each_copy_is_told_of_once_when_it_is_done(course, tmp_path, capsys):
    folder = hand_in(tmp_path / "in", ["gina/02_square_final.ipynb", "heidi/notes.ipynb"])
    command = ["grade", str(folder), "--out", str(tmp_path / "grades.csv"), "--notebooks", str(course)]
    assert main(command) == 0
    said = capsys.readouterr()
    assert said.err == "" and said.out.count("\n") == 3
    lines = [line.removeprefix(folder.as_posix() + "/") for line in said.out.splitlines()]
    assert lines[0] == "gina/02_square_final.ipynb  1/1"
    assert lines[1].startswith("heidi/notes.ipynb           no notebook of this course")
    assert lines[2].startswith("2 files: ")


def again(graded, course, capsys, limit=LIMIT) -> tuple[str, str]:
    folder, out = graded
    capsys.readouterr()
    assert main(["grade", str(folder), "--out", str(out), "--notebooks", str(course), "--limit", str(limit)]) == 0
    said = capsys.readouterr()
    return said.out, said.err


def test_a_second_run_runs_nothing_says_so_and_ends_in_the_same_table(graded, course, capsys, monkeypatch):
    monkeypatch.setattr(grade, "run", None)
    before = graded[1].read_bytes()
    said, _ = again(graded, course, capsys)
    assert graded[1].read_bytes() == before
    assert "14 files, 11 of them graded before with the same content" in said
    lines = [line.removeprefix(graded[0].as_posix() + "/") for line in said.splitlines()]
    assert lines[0].split() == ["alice/01_twice.ipynb", "2/2"]
    assert [line.split()[1] for line in lines if line.startswith(("bob", "dave", "erin"))] == ["1/2", "0/2", "0/2"]
    (bob,) = (line for line in lines if line.startswith("bob"))
    assert bob.endswith("1/2  code cell 5 (check-thrice): NameError: name 'check' is not defined")


def test_a_changed_copy_is_graded_again_and_a_late_one_with_another_limit(graded, course, capsys, monkeypatch):
    ran = []

    def run(cells, lesson, course, limit):
        ran.append((cells[0]["source"], limit))
        return [(False, "no")] * len(lesson.exercises), "", 0.0

    monkeypatch.setattr(grade, "run", run)
    text = (graded[0] / "alice/01_twice.ipynb").read_text()
    kept = graded[1].read_bytes()
    (graded[0] / "alice/01_twice.ipynb").write_text(text.replace("One number", "Any number"))
    try:
        assert " 10 of them" in again(graded, course, capsys)[0]
        assert ran == [("# 01 · Twice\n\nAny number and another.", LIMIT)]
        assert marks(graded, "alice/01_twice.ipynb")[0] == ("my_twice", "False", "no")
        again(graded, course, capsys, limit=2 * LIMIT)
        assert [limit for _, limit in ran] == [LIMIT, 2 * LIMIT]
        assert marks(graded, "dave/01_twice.ipynb")[0] == ("my_twice", "False", "no")
    finally:
        (graded[0] / "alice/01_twice.ipynb").write_text(text)
        graded[1].write_bytes(kept)


def test_an_interruption_keeps_what_was_graded(course, tmp_path, capsys, monkeypatch):
    folder, out, done = hand_in(tmp_path / "in", list(COPIES)[:3]), tmp_path / "grades.csv", []

    def run(cells, lesson, course, limit):
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(1)
        return [(True, "yes")] * len(lesson.exercises), "", 0.0

    monkeypatch.setattr(grade, "run", run)
    command = ["grade", str(folder), "--out", str(out), "--notebooks", str(course)]
    assert main(command) == 130
    assert len(grade.read_table(out)) == 2
    done.clear()
    assert main(command) == 0
    assert len(done) == 1 and len(grade.read_table(out)) == 3


def test_a_spreadsheet_meets_no_formula():
    assert grade._plain("=HYPERLINK(1)\n\x1b[31mred\x1b[0m") == "'=HYPERLINK(1) red"
    assert grade._plain(f"{'a' * 999}").endswith("a…") and len(grade._plain("a" * 999)) == 300


def complain(capsys, *command) -> str:
    assert main(["grade", *map(str, command)]) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1
    return said.err


def test_what_cannot_be_graded_is_told_in_one_line(course, tmp_path, capsys):
    folder = hand_in(tmp_path / "in", ["bob_01.ipynb"])
    out = "--out", tmp_path / "grades.csv"
    assert "no such folder" in complain(capsys, tmp_path / "nowhere", *out)
    assert "no notebook (*.ipynb)" in complain(capsys, course / "records", *out)
    for limit in ("0", "-1", "nan", "inf"):
        assert "--limit must be a positive number" in complain(capsys, folder, *out, "--limit", limit)
    assert "with --notebooks DIR" in complain(capsys, folder, *out, "--notebooks", tmp_path / "nowhere")
    assert "check the path" in complain(capsys, folder, "--out", tmp_path, "--notebooks", course)
    assert not (tmp_path / "grades.csv").exists()


@pytest.mark.parametrize(
    "text", ["name,age\nzoe,7\n", ",".join(grade.COLUMNS) + "\na.ipynb,01_twice\n", "\x00", "caf\xe9"]
)
def test_a_foreign_or_damaged_table_is_left_alone(course, tmp_path, capsys, text):
    other = tmp_path / "other.csv"
    other.write_text(text, encoding="latin-1")
    folder = hand_in(tmp_path / "in", ["bob_01.ipynb"])
    assert "name another with --out" in complain(capsys, folder, "--out", other, "--notebooks", course)
    assert other.read_text(encoding="latin-1") == text


@pytest.mark.parametrize("check", ["assert my_square(2) == 4", "check.square(my_square)", "done = ("])
def test_a_lesson_whose_check_gives_no_verdict_is_refused(tmp_path, check, capsys):
    save(tmp_path / "course" / "02_square.ipynb", edited(square(), check_square=check))
    folder = hand_in(tmp_path / "in", ["bob_01.ipynb"])
    assert "02_square.ipynb: " in complain(capsys, folder, "--notebooks", tmp_path / "course")


def test_every_lesson_of_the_course_has_its_exercises():
    known = [lesson for lesson in grade.lessons(grade.COURSE) if lesson.exercises]
    assert [lesson.name for lesson in known] == sorted(path.stem for path in grade.COURSE.glob("[0-9]*.ipynb"))
    assert all(3 <= len(lesson.exercises) <= 5 and len(lesson.ids) > 10 for lesson in known)


def test_a_solved_notebook_of_the_course_passes_and_an_emptied_one_is_to_do(tmp_path):
    notebook = json.loads((grade.COURSE / "11_messages.ipynb").read_text(encoding="utf-8"))
    save(tmp_path / "in" / "a.ipynb", notebook["cells"])
    for c in notebook["cells"]:
        if "solution" in c["metadata"].get("tags", ()):
            heads = [line for line in "".join(c["source"]).splitlines() if line.startswith("def ")]
            c["source"] = "\n".join(f"{head}\n    ..." for head in heads)
    save(tmp_path / "in" / "b.ipynb", notebook["cells"])
    (solved, emptied), _ = grade.grade(tmp_path / "in", tmp_path / "grades.csv")
    assert grade.score(solved) == "4/4"
    assert [row["says"] for row in emptied] == ["to do"] * 4
