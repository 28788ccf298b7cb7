"""The house keeps its floors: who imports whom, where the dimension may be asked for, docstrings, module sizes."""

import ast
import importlib
import inspect
import pkgutil
import re
from pathlib import Path

import networkx as nx
import pytest

import mannbv

ROOT = Path(mannbv.__file__).parent


def floors_of(document: str) -> dict[str, int]:
    """Room → floor, from the block in CONTRIBUTING.md: rooms between two · share one, the lowest stand last."""
    block = re.search(r"^```floors\n(.*?)^```", document, re.M | re.S)[1]
    levels = [level for line in block.splitlines() for level in line[10:].split("·")]
    return {room.strip(): floor for floor, level in enumerate(reversed(levels)) for room in level.split(",")}


FLOORS = floors_of((ROOT.parent / "CONTRIBUTING.md").read_text(encoding="utf-8"))
BASEMENT = "kernels"  # numba loops: every room may use them, they use no room
WINGS = {"lab", "course"}  # folders whose rooms have floors of their own

# where a room above the ground floors may ask for the dimension, and why
MAY_ASK = {
    ("commands", "run"): "names the folder of a 3-D run",
    ("world", "_load"): "a scene stands in both: which one is asked for",
    ("world", "suited"): "a plane has no height to which a camera could be raised",
}
GROUND = {BASEMENT, "geometry", "grid", "network", "config", "splats", "camera", "consensus"}

SOURCES = sorted(ROOT.rglob("*.py"))


def name_of(path: Path) -> tuple[str, ...]:
    """Module below the package: ("render", "dense")."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return parts[:-1] if parts[-1] == "__init__" else parts


def imports(source: str, module: tuple[str, ...], is_package: bool = False) -> list[tuple[str, ...]]:
    """Full names that a module imports from this package, at its top or inside functions, whatever way it writes it."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found += [tuple(alias.name.split(".")) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = tuple(node.module.split(".")) if node.module else ()
            if node.level:
                package = ("mannbv", *module) if is_package else ("mannbv", *module[:-1])
                base = package[: len(package) - node.level + 1] + base
            found += [(*base, alias.name) for alias in node.names]
    return [name for name in found if name[0] == "mannbv"]


def imported(source: str, module: tuple[str, ...], is_package: bool = False) -> set[str]:
    """Rooms that a module imports."""
    return {room_of(name[1:]) for name in imports(source, module, is_package) if len(name) > 1} - {"__version__"}


def circles(modules: dict[tuple[str, ...], tuple[str, bool]]) -> list[set[tuple[str, ...]]]:
    """Groups of modules that import each other; module → its source, and whether it is a package."""
    graph = nx.DiGraph()
    for module, (source, is_package) in modules.items():
        for name in imports(source, module, is_package):
            target = next((part for part in (name[1:], name[1:-1]) if part in modules), module)
            if target != module:
                graph.add_edge(module, target)
    return [group for group in nx.strongly_connected_components(graph) if len(group) > 1]


def room_of(module: tuple[str, ...]) -> str:
    """The room that a module or one of its names belongs to: "render", or "lab.draw" in a wing."""
    return ".".join(module[: 2 if module[0] in WINGS else 1])


def trespasses(source: str, module: tuple[str, ...], is_package: bool = False) -> list[str]:
    """Imports that break the rule of floors; [] for a good module."""
    room = room_of(module)
    wrong = []
    for other in sorted(imported(source, module, is_package) - {room}):
        if other == BASEMENT:
            continue
        if room == BASEMENT or other not in FLOORS or FLOORS[other] >= FLOORS[room]:
            wrong.append(f"{'.'.join(module)} must not import {other}")
    return wrong


def dimension_questions(source: str, module: tuple[str, ...]) -> list[str]:
    """Functions above the ground floors that branch on the dimension without leave."""
    if module[0] in GROUND:
        return []
    asked = []

    def asks(test: ast.AST) -> bool:
        for node in ast.walk(test):
            if isinstance(node, ast.Compare):
                sides = [node.left, *node.comparators]
                named = any(
                    getattr(s, "attr", getattr(s, "id", None)) in ("dim", "ndim_world", "n_dims") for s in sides
                )
                fixed = any(isinstance(s, ast.Constant) and s.value in (2, 3) for s in sides)
                if named and fixed:
                    return True
        return False

    def visit(node: ast.AST, function: str) -> None:
        if isinstance(node, ast.FunctionDef):
            function = function or node.name
        if (
            isinstance(node, (ast.If, ast.IfExp, ast.While))
            and asks(node.test)
            and (module[0], function) not in MAY_ASK
        ):
            asked.append(f"{'.'.join(module)}.{function} asks for the dimension in line {node.lineno}")
        if isinstance(node, ast.Match) and getattr(node.subject, "attr", getattr(node.subject, "id", "")) == "dim":
            asked.append(f"{'.'.join(module)}.{function} asks for the dimension in line {node.lineno}")
        for child in ast.iter_child_nodes(node):
            visit(child, function)

    visit(ast.parse(source), "")
    return asked


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_a_room_keeps_to_its_floor_and_size(path):
    module, source = name_of(path), path.read_text(encoding="utf-8")
    assert len(source.splitlines()) <= 350, "split it into a folder of the same name"
    if not module:  # mannbv/__init__.py
        assert imported(source, ("mannbv",), True) == set()
        return
    if module in {(wing,) for wing in WINGS}:
        return
    assert room_of(module) in FLOORS, "give the new room a floor, in CONTRIBUTING.md"
    assert trespasses(source, module, path.name == "__init__.py") == []
    assert dimension_questions(source, module) == []


@pytest.mark.parametrize(
    ("source", "module"),
    [
        ("from mannbv import team", ("risk",)),
        ("import mannbv.information as i", ("mask",)),  # its own floor
        ("from mannbv.world import plan", ("render", "dense")),
        ("def f():\n    from mannbv.objective import team", ("grid",)),  # hidden in a function
        ("from ..metrics import psnr", ("consensus", "solvers")),  # relative
        ("from .. import planner", ("world", "flat")),
        ("from mannbv import geometry", ("kernels", "rays")),  # the basement knows no room
        ("from mannbv import cellar", ("episode",)),  # a room without a floor
    ],
)
def test_the_checker_sees_a_bad_import(source, module):
    assert len(trespasses(source, module)) == 1


@pytest.mark.parametrize(
    ("source", "module"),
    [
        ("import numpy\nfrom mannbv import geometry, kernels\nfrom mannbv.kernels.flat.rays import cast", ("risk",)),
        ("from mannbv.render.dense import render\nfrom .dense import compose", ("render", "tiled")),
        ("from mannbv import __version__", ("episode",)),
    ],
)
def test_the_checker_lets_good_imports_pass(source, module):
    assert trespasses(source, module) == []


def test_no_modules_import_each_other_in_a_circle():
    modules = {name_of(path): (path.read_text(encoding="utf-8"), path.name == "__init__.py") for path in SOURCES}
    assert circles(modules) == []


def test_the_checker_sees_a_circle_through_a_function_and_leaves_a_package_its_own_modules():
    lines = {("a",): "from mannbv.b import c", ("b", "c"): "def f():\n    from .. import a", ("d",): "import mannbv.a"}
    assert circles({name: (source, False) for name, source in lines.items()}) == [{("a",), ("b", "c")}]
    package = {("b",): ("from mannbv.b.c import thing", True), ("b", "c"): ("from mannbv.b import d", False)}
    assert circles(package | {("b", "d"): ("", False)}) == []
    assert circles(package) == [{("b",), ("b", "c")}]  # d is then a name of the package


def test_the_checker_sees_a_question_for_the_dimension():
    for bad in ("if m.dim == 2:\n    pass", "x = 1 if dim == 3 else 2", "def f(m):\n    while 2 < m.dim: pass"):
        assert len(dimension_questions(bad, ("objective",))) == 1
        assert dimension_questions(bad, ("geometry",)) == []
    assert dimension_questions("if a.dim != b.dim:\n    raise ValueError", ("objective",)) == []


def untyped(source: str) -> list[str]:
    """Public functions and methods with a parameter or a result that has no type, and records with a field of Any.

    What a decorator makes a record of, as an exercise of its table, is no function any more.
    """
    found = []

    def visit(body: list[ast.stmt], inside: str) -> None:
        for node in body:
            name = f"{inside}{getattr(node, 'name', '')}"
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                fields = [part for part in node.body if isinstance(part, ast.AnnAssign)]
                found.extend(f"{name}.{part.target.id}" for part in fields if "Any" in words(part.annotation))
                visit(node.body, f"{name}.")
            if not isinstance(node, ast.FunctionDef) or (node.name.startswith("_") and node.name != "__init__"):
                continue
            makers = {word for decorator in node.decorator_list for word in words(decorator)}
            everything = ast.walk(node.args)
            given = [part for part in everything if isinstance(part, ast.arg) and part.arg not in ("self", "cls")]
            whole = all(part.annotation for part in given) and (node.returns or node.name == "__init__")
            if not whole and not makers & {"exercise", "judged"}:
                found.append(name)

    visit(ast.parse(source).body, "")
    return found


def words(node: ast.AST) -> set[str]:
    """The names in an expression."""
    return {getattr(part, "id", getattr(part, "attr", "")) for part in ast.walk(node)}


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_public_signatures_are_complete_and_no_record_holds_just_anything(path):
    if name_of(path)[:1] != (BASEMENT,):  # numba takes a loop's types from the call
        assert untyped(path.read_text(encoding="utf-8")) == []


def test_the_checker_sees_what_has_no_type():
    source = """
class Record(NamedTuple):
    number: int
    thing: list[Any]

    def half(self) -> int: ...
    def twice(self, of, *more: int) -> int: ...

class _Own:
    def free(self, of): ...

def done(a: int, /, *rest: int, b: int = 3, **more: int) -> None:
    def inner(a): ...
def no_result(a: int): ...
def no_type(*rest) -> None: ...
@exercise(cases=[])
def table(a): ...
"""
    assert untyped(source) == ["Record.thing", "Record.twice", "no_result", "no_type"]


def public(module):
    for name, thing in vars(module).items():
        own = getattr(thing, "__module__", None) == module.__name__
        if own and not name.startswith("_") and (inspect.isclass(thing) or inspect.isfunction(thing)):
            yield name, thing


def test_everything_public_says_what_it_is():
    silent = []
    for info in pkgutil.walk_packages([str(ROOT)], "mannbv."):
        if info.name.startswith("mannbv.kernels.") or info.name.endswith("__main__"):
            continue
        module = importlib.import_module(info.name)
        if not module.__doc__:
            silent.append(info.name)
        for name, thing in public(module):
            doc = thing.__doc__ or ""
            if not doc or (inspect.isclass(thing) and doc.startswith(f"{name}(")):  # a dataclass writes its own
                silent.append(f"{info.name}.{name}")
    for path in (ROOT / "kernels").rglob("*.py"):
        if not ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))):
            silent.append(str(path))
    assert silent == []
