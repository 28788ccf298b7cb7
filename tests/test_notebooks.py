"""The form of the course's notebooks: short cells, one skeleton, equations where they are used, units, one first cell.

Each rule is a function from a notebook to what is wrong with it, [] for a good one; made-up notebooks show that it can
fail. What the cells compute is nbval's business.
"""

import ast
import re
import statistics
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import nbformat
import pytest
from IPython.core.inputtransformer2 import TransformerManager
from nbformat import v4
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import mannbv

ROOT = Path(__file__).resolve().parent.parent
PATHS = sorted((ROOT / "notebooks").glob("[0-9]*.ipynb"))
STEMS = [path.stem for path in PATHS]
TEACHING = (ROOT / "notebooks" / "TEACHING.md").read_text(encoding="utf-8")

SKELETON = ["Question", "In the paper", "Build", "Play", "Your turn", "Keep"]
WORKING = {"Build", "Play"}  # the sections in which an equation is used, and not only talked about
EQUATIONS = {
    **{"02": range(1, 3), "03": range(3, 6), "04": range(6, 10), "05": range(10, 14), "06": range(14, 16)},
    **{"09": range(16, 25), "10": range(25, 30)},
}
ALGORITHM = range(1, 22)  # lines of Algorithm 1, the subject of 12_team
CATEGORIES = {"map", "splat", "parameters of splat"}  # axes whose ticks are names, not amounts
LABELLED = {"plan", "ground", "ground_axes", "strip", "profile", "risk"}  # parts of `draw` that label axes themselves
MAX_BYTES = 500_000

# what a bare hosted runtime brings along, and what only a computer of one's own needs
HOSTED = {"numpy", "scipy", "torch", "numba", "matplotlib", "networkx", "pillow", "pyyaml", "tqdm", "ipywidgets"}
HOSTED |= {"contourpy", "nbformat", "nbclient", "packaging", "traitlets"}
AT_HOME = {"jupyterlab", "nbval"}

everywhere = pytest.mark.parametrize("path", PATHS, ids=STEMS)


def read(path: Path) -> nbformat.NotebookNode:
    return nbformat.read(path, as_version=4)


def made_up(*sources: str) -> nbformat.NotebookNode:
    """A notebook of these cells: markdown where the text begins with # or *, else code."""
    cells = [v4.new_markdown_cell(s) if s[0] in "#*" else v4.new_code_cell(s, execution_count=1) for s in sources]
    return v4.new_notebook(cells=cells)


def code(notebook) -> list:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def python(cell) -> ast.Module:
    """The cell's syntax tree, its magics turned into calls."""
    return ast.parse(TransformerManager().transform_cell(cell.source))


def calls(tree: ast.AST, inside_functions: bool = True) -> list[ast.Call]:
    """Calls of a cell; without those that wait in a function's body, if asked."""
    found = [tree] if isinstance(tree, ast.Call) else []
    for child in ast.iter_child_nodes(tree):
        waits = isinstance(child, (ast.FunctionDef, ast.ClassDef, ast.Lambda))
        if inside_functions or not waits:
            found += calls(child, inside_functions)
    return found


def name_of(call: ast.Call) -> str:
    """`show` of `draw.show(…)`, `print` of `print(…)`."""
    return getattr(call.func, "attr", getattr(call.func, "id", ""))


def sections(notebook) -> list[tuple[str, nbformat.NotebookNode]]:
    """Each cell with the heading of level 2 above it."""
    title, found = "", []
    for cell in notebook.cells:
        if cell.cell_type == "markdown" and cell.source.startswith("## "):
            title = cell.source.splitlines()[0][3:]
        found.append((title, cell))
    return found


# --- the rules ------------------------------------------------------------------------------------------------------


def long_cells(lengths: list[int]) -> list[str]:
    """Median at most 6 lines, nine in ten at most 12, none over 20."""
    wrong = [f"a cell of {n} lines" for n in lengths if n > 20]
    if statistics.median(lengths) > 6:
        wrong.append(f"median of {statistics.median(lengths)} lines")
    if sum(n <= 12 for n in lengths) < 0.9 * len(lengths):
        wrong.append("more than one in ten over 12 lines")
    return wrong


def lengths_of(notebook) -> list[int]:
    return [len(cell.source.splitlines()) for cell in code(notebook)]


def wrong_openings(notebook) -> list[str]:
    """Sections that do not stand at the head of a cell, or do not open with one bold sentence on a line of its own."""
    wrong = []
    for cell in notebook.cells:
        lines = [line for line in cell.source.splitlines() if line] if cell.cell_type == "markdown" else []
        for k, line in enumerate(lines):
            if re.match(r"##+ ", line):
                opening = (lines[k + 1 :] or [""])[0]
                sentence = re.fullmatch(r"\*\*([^*]+[.?])\*\*", opening)
                if k or line.startswith("####") or not sentence or re.search(r"[.?!] [A-Z]", sentence[1]):
                    wrong.append(line)
    return wrong


def skeleton(notebook) -> list[str]:
    """The headings of level 2, in order."""
    found = [re.match(r"## (.+)", cell.source) for cell in notebook.cells if cell.cell_type == "markdown"]
    return [match[1] for match in found if match]


def numbers(text: str, before: str, number: str) -> set[int]:
    """Numbers cited after a word, singly, in lists and in ranges: "Eqs. (3)–(5), (8)" cites 3, 4, 5 and 8."""
    one = rf"{number}(?:–{number})?"
    found = set()
    for listed in re.finditer(rf"{before} {one}(?:(?:, | and |, and ){one})*", text):
        for first, last in re.findall(one, listed[0]):
            found |= set(range(int(first), int(last or first) + 1))
    return found


def used(notebook, before: str, number: str) -> set[int]:
    """Numbers cited in Build and Play, in a cell of code or one that has code for a neighbour."""
    cells, found = sections(notebook), set()
    for k, (title, cell) in enumerate(cells):
        near = [other.cell_type for _, other in cells[max(k - 1, 0) : k + 2]]
        if title in WORKING and "code" in near:
            found |= numbers(cell.source, before, number)
    return found


def equations(notebook) -> set[int]:
    return used(notebook, r"Eqs?\.", r"\((\d+)\)")


def algorithm_lines(notebook) -> set[int]:
    return used(notebook, "[Ll]ines?", r"(\d+)\b")


def text_of(node: ast.expr | None) -> str:
    """A label as it is written, with … for what is filled in; "" if it cannot be read off."""
    if isinstance(node, ast.Call) and name_of(node) == "format":
        return text_of(node.func.value)
    if isinstance(node, ast.Attribute) and node.attr == "axis":  # of a `metrics.Score`, which ends in its unit
        return "… [unit]"
    if isinstance(node, ast.JoinedStr):
        parts = (part.value if isinstance(part, ast.FormattedValue) else part for part in node.values)
        return "".join(text_of(part) or "…" for part in parts)
    return node.value if isinstance(node, ast.Constant) else ""


def unitless(notebook) -> list[str]:
    """Labels of axes and of colour bars that do not end in a unit in brackets and are no categories."""
    labels = []
    for call in (call for cell in code(notebook) for call in calls(python(cell))):
        words = {word.arg: word.value for word in call.keywords}
        labels += [text_of(words[key]) for key in ("xlabel", "ylabel") if key in words]
        if name_of(call) in ("set_xlabel", "set_ylabel", "set_label"):
            labels.append(text_of(call.args[0]))
        if name_of(call) == "colorbar":
            labels.append(text_of(words.get("label")))
    return [label for label in labels if not re.search(r"\[[^\[\]]+\]$", label) and label not in CATEGORIES]


def bare(notebook) -> list[str]:
    """Cells that begin a figure in which no axis is labelled (or taken away), here or by a function of the notebook."""
    trees = [python(cell) for cell in code(notebook)]
    labels = LABELLED | {"set_xlabel", "axis"}
    functions = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]

    def labelled(tree: ast.AST) -> bool:
        return any(name_of(c) in labels or "xlabel" in {w.arg for w in c.keywords} for c in calls(tree))

    labels |= {function.name for function in functions if labelled(function)}
    labels |= {function.name for function in functions if labelled(function)}  # a function that calls the first ones
    drawn = [
        (tree, cell) for tree, cell in zip(trees, code(notebook), strict=True) if "figure" in map(name_of, calls(tree))
    ]
    return [cell.source.splitlines()[0] for tree, cell in drawn if not labelled(tree)]


def wrong_outputs(notebook) -> list[str]:
    """Stored errors and warnings, and cells that speak or draw when run but have nothing stored."""
    wrong = []
    for cell in code(notebook):
        first = cell.source.splitlines()[0]
        printed = "".join(output.get("text", "") for output in cell.outputs)
        if any(o.output_type == "error" or o.get("name") == "stderr" for o in cell.outputs) or "Traceback" in printed:
            wrong.append(f"an error is stored under: {first}")
        run = {name_of(call) for call in calls(python(cell), inside_functions=False)}
        if ("print" in run and not printed) or ("show" in run and not any("data" in o for o in cell.outputs)):
            wrong.append(f"nothing is stored under: {first}")
        if cell.execution_count is None:
            wrong.append(f"never run: {first}")
    return wrong


def dead_links(notebook) -> list[str]:
    """Links to notebooks that are not there."""
    text = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")
    return [
        name for name in re.findall(r"\]\((\S+)\.ipynb\)", text) if not (PATHS[0].parent / f"{name}.ipynb").exists()
    ]


# --- every notebook -------------------------------------------------------------------------------------------------


def test_there_are_fifteen_in_order():
    assert [stem[:2] for stem in STEMS] == [f"{k:02}" for k in (*range(14), 15)]  # 14 is kept for a later one


@everywhere
def test_cells_are_short(path):
    assert long_cells(lengths_of(read(path))) == []


def test_cells_are_short_over_all():
    assert long_cells([n for path in PATHS for n in lengths_of(read(path))]) == []


@everywhere
def test_the_skeleton_stands_and_each_section_opens_with_one_bold_sentence(path):
    notebook = read(path)
    assert skeleton(notebook) == SKELETON
    assert wrong_openings(notebook) == []
    assert notebook.cells[0].source.startswith(f"# {path.stem[:2]} · ")


@pytest.mark.parametrize("start", EQUATIONS)
def test_each_equation_is_cited_where_it_is_used(start):
    (path,) = (path for path in PATHS if path.stem.startswith(start))
    assert set(EQUATIONS[start]) - equations(read(path)) == set()


def test_every_equation_has_a_notebook():
    assert sorted(n for subject in EQUATIONS.values() for n in subject) == list(range(1, 30))


def test_each_line_of_algorithm_1_is_cited_where_its_stage_runs():
    assert set(ALGORITHM) - algorithm_lines(read(PATHS[12])) == set()


@everywhere
def test_axes_have_units(path):
    assert unitless(read(path)) == []
    assert bare(read(path)) == []


@everywhere
def test_what_is_stored_is_whole_and_small(path):
    assert wrong_outputs(read(path)) == []
    assert path.stat().st_size <= MAX_BYTES


@everywhere
def test_links_lead_somewhere(path):
    assert dead_links(read(path)) == []


# --- the first cell -------------------------------------------------------------------------------------------------


class Shell:
    """Stands in for IPython's shell, and writes down the magics that it is asked for."""

    def __init__(self):
        self.asked = []

    def run_line_magic(self, name, line):
        self.asked.append((name, line))


def run_first(path: Path) -> list[tuple[str, str]]:
    """Run a notebook's first code cell; the magics that it called."""
    shell = Shell()
    source = TransformerManager().transform_cell(code(read(path))[0].source)
    exec(compile(source, path.name, "exec"), {"get_ipython": lambda: shell})
    return shell.asked


def test_the_first_cell_is_the_same_everywhere():
    assert len({code(read(path))[0].source for path in PATHS}) == 1


def test_at_home_the_first_cell_installs_nothing():
    assert "google.colab" not in sys.modules
    assert run_first(PATHS[0]) == []


def test_on_a_hosted_runtime_it_installs_the_checkout_and_what_the_runtime_lacks(monkeypatch):
    monkeypatch.setitem(sys.modules, "google.colab", ModuleType("google.colab"))
    ((magic, line),) = run_first(PATHS[0])
    verb, *words = line.split()
    names = {word for word in words if not word.startswith("-")}
    assert (magic, verb) == ("pip", "install")
    assert "--no-deps" in words  # torch stays as it is
    assert not {"-e", "--editable"} & set(words)  # an editable install needs a new kernel
    assert all((path.parent / ".." / "pyproject.toml").is_file() for path in PATHS) and ".." in names
    assert not names & HOSTED
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = {canonicalize_name(Requirement(text).name) for text in project["dependencies"]}
    assert needed - HOSTED - AT_HOME <= names


def test_another_version_is_named_with_the_remedy(monkeypatch):
    monkeypatch.setattr(mannbv, "__version__", "9.9.9")
    with pytest.raises(AssertionError, match=r"9\.9\.9 is installed.*make setup.*restart the kernel"):
        run_first(PATHS[0])


# --- how to teach them ----------------------------------------------------------------------------------------------


def rows(text: str) -> dict[str, set[str]]:
    """Of TEACHING.md's table of needs: each notebook's start, and those that it needs."""
    cells = re.findall(r"^\| \[(\d\d)_\w+\]\(\w+\.ipynb\) \| ([^|]*) \|", text, flags=re.MULTILINE)
    return {start: set(re.findall(r"\b\d\d\b", needs)) for start, needs in cells}


def wrong_needs(table: dict[str, set[str]]) -> list[str]:
    """Notebooks without a row, and prerequisites that do not exist or come later."""
    missing = [f"no row for {stem}" for stem in STEMS if stem[:2] not in table]
    late = [f"{start} needs {need}" for start in table for need in table[start] if need not in table or need >= start]
    return missing + late


def test_the_guide_has_a_row_for_each_notebook_and_its_prerequisites_come_earlier():
    assert wrong_needs(rows(TEACHING)) == []
    assert dead_links(made_up(f"# guide\n{TEACHING}")) == []


def short_cuts(text: str, table: dict[str, set[str]]) -> list[str]:
    """Ways through the course (00 → 04 → 07) that reach a notebook before what it needs."""
    ways = [re.findall(r"\d\d", way) for way in re.findall(r"\d\d(?: → \d\d)+", text)]
    return [f"{stop} in {way}" for way in ways for k, stop in enumerate(way) if table[stop] - set(way[:k])]


def test_each_way_through_passes_what_its_notebooks_need():
    assert "→" in TEACHING
    assert short_cuts(TEACHING, rows(TEACHING)) == []


def test_the_guide_names_what_a_notebook_says_that_it_needs():
    """A link in a notebook's title cell to an earlier one is a prerequisite."""
    table = rows(TEACHING)
    for path in PATHS:
        named = {name[:2] for name in re.findall(r"\]\((\w+)\.ipynb\)", read(path).cells[0].source)}
        assert named <= table[path.stem[:2]], path.stem


# --- made-up notebooks that break each rule -------------------------------------------------------------------------


def test_long_cells_are_seen():
    assert long_cells([6, 6, 6, 12]) == []
    assert long_cells([1, 1, 1, 21, *[1] * 30]) == ["a cell of 21 lines"]
    assert long_cells([7, 7, 7]) == ["median of 7 lines"]
    assert long_cells([1] * 8 + [13]) == ["more than one in ten over 12 lines"]
    assert lengths_of(made_up("# title", "a = 1\n\nb = 2")) == [3]  # blank lines count


@pytest.mark.parametrize(
    "source",
    [
        "## Build\nNo bold sentence.",
        "### Risk\n**Not a sentence**",
        "### Risk\n**A sentence.** And more on the line.",
        "### Risk\n**One sentence. Another one.**",
        "### Risk",
        "#### Deeper\n**Too deep.**",
        "**A sentence.**\n\n### Risk\n**The heading stands within a cell.**",
    ],
)
def test_a_wrong_opening_is_seen(source):
    assert len(wrong_openings(made_up(source))) == 1


def test_a_right_opening_passes_and_the_skeleton_is_read_in_order():
    notebook = made_up(
        "# 1 · A", "## Build\n**How far, Eq. (3)?**\n\nText.", "### Risk\n**A room.**", "## Keep\n**So.**"
    )
    assert wrong_openings(notebook) == []
    assert skeleton(notebook) == ["Build", "Keep"]


def test_equations_count_only_where_they_are_used():
    notebook = made_up(
        "## In the paper\n**Eq. (1).**",
        "y = 1  # Eq. (1), in the wrong section",
        "*A pause.*",
        "## Build\n**Eq. (2), but no code beside it.**",
        "### Next\n**Eqs. (3)–(5), (8) and (9).**",
        'def f():\n    """Eq. (12)."""',
        "# (13) alone is no citation",
        "## Keep\n**Eq. (14).**",
    )
    assert equations(notebook) == {3, 4, 5, 8, 9, 12}


def test_lines_count_only_where_their_stage_runs():
    table = "## In the paper\n**A table.**\n\n| line 7 |", "x = 0"
    notebook = made_up(*table, "## Build\n**Lines 8–10, and line 20.**", "x = 1  # line 3, lines 14 and 15; 99")
    assert algorithm_lines(notebook) == {3, 8, 9, 10, 14, 15, 20}


@pytest.mark.parametrize(
    "source",
    [
        'ax.set(xlabel="time")',
        'ax.set_ylabel("gain (1)")',
        'ax.set(xlabel="[m] of way")',
        'ax.set(ylabel=f"share of {name}")',
        "ax.set(ylabel=score.label)",
        "ax.set(ylabel=label)",  # whoever reads the cell cannot see the unit either
        "canvas.colorbar(image, ax=ax)",
        'canvas.colorbar(image, ax=ax, label="risk")',
        'def plot(ax):\n    ax.set(xlabel="time")',
    ],
)
def test_an_axis_without_a_unit_is_seen(source):
    assert len(unitless(made_up(source))) == 1


def test_axes_with_units_or_names_pass():
    good = 'ax.set(xlabel="time [s]", ylabel=f"{name} [{unit}]", title="time")', 'ax.set_xlabel("splat")'
    good += ('ax.set(xlabel=score.axis, ylabel=f"less {SCORES[key].axis}")',)
    assert unitless(made_up(*good, 'canvas.colorbar(image, label="risk [m]")', 'ax.plot(x, label="no axis")')) == []


def test_a_figure_without_labels_is_seen():
    helpers = "def axes(ax):\n    ax.set_xlabel('x [m]')", "def scene(ax):\n    axes(ax)"
    assert (
        bare(made_up(*helpers, "canvas, ax = draw.figure(4, 3)\nscene(ax)", "draw.figure(4, 3)\ndraw.plan(ax)")) == []
    )
    assert bare(made_up(*helpers, "canvas, ax = draw.figure(4, 3)\nax.plot(x)")) == ["canvas, ax = draw.figure(4, 3)"]


def test_missing_and_failed_outputs_are_seen():
    quiet = made_up("a = 1", "def f():\n    print(a)")
    assert wrong_outputs(quiet) == []
    assert len(wrong_outputs(made_up("if a:\n    print(a)"))) == 1
    assert len(wrong_outputs(made_up("draw.show(canvas)"))) == 1
    for output in (
        v4.new_output("error", ename="ValueError", evalue="", traceback=[]),
        v4.new_output("stream", name="stderr", text="a warning\n"),
        v4.new_output("stream", text="Traceback (most recent call last)\n"),
    ):
        quiet.cells[0].outputs = [output]
        assert len(wrong_outputs(quiet)) == 1
    quiet.cells[0].outputs, quiet.cells[0].execution_count = [], None
    assert wrong_outputs(quiet) == ["never run: a = 1"]


def test_a_dead_link_is_seen():
    assert dead_links(made_up("# to [00](00_start.ipynb) and [99](99_none.ipynb)")) == ["99_none"]


def test_a_guide_that_does_not_fit_the_notebooks_is_seen():
    table = {stem[:2]: {"00"} if stem[:2] > "00" else set() for stem in STEMS}
    assert wrong_needs(table) == []
    assert wrong_needs(table | {"04": {"05"}}) == ["04 needs 05"]
    assert wrong_needs(table | {"04": {"04"}}) == ["04 needs 04"]
    del table["12"]
    assert wrong_needs(table) == ["no row for 12_team"]
    assert short_cuts("00 → 05 → 04", {"00": set(), "04": {"00"}, "05": {"04"}}) == ["05 in ['00', '05', '04']"]
    assert rows("| [04_risk](04_risk.ipynb) | 00, 01 | … |\n| 05 | 04 |") == {"04": {"00", "01"}}
