"""Derive the reader's copies of the notebooks: the exercises emptied, nothing run.

    python tools/course.py [FOLDER]      (without a name: course/)

A function in a cell tagged `solution` keeps its signature and docstring, and the cell its imports. A copy carries a
hash of its sources, so one that a reader has edited is never overwritten; one that was only run is made anew. Nothing
is written unless every notebook could be read, and each copy whole.
"""

import argparse
import ast
import hashlib
import json
import sys
from pathlib import Path

import nbformat

from notebooks import KEPT_CELL_METADATA, METADATA, ROOT, NotebookError, load, write

SOLVED = ROOT / "notebooks"


def derive(path: Path) -> nbformat.NotebookNode:
    """The reader's copy of a solved notebook. Raises NotebookError for a damaged one, or a bad solution cell."""
    notebook = load(path)
    for cell in (cell for cell in notebook.cells if "solution" in cell.metadata.get("tags", ())):
        try:
            cell.source = empty(cell.source)
        except (SyntaxError, ValueError) as error:
            raise NotebookError(f"{path}: solution cell `{cell.id}`: {error}") from None
    for cell in notebook.cells:
        cell.metadata = nbformat.from_dict({k: v for k, v in cell.metadata.items() if k in KEPT_CELL_METADATA})
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    notebook.metadata = nbformat.from_dict(METADATA | {"mannbv": {"derived": fingerprint(notebook)}})
    return notebook


def empty(source: str) -> str:
    """The imports of a solution, and its `my_...` functions with nothing but signature and docstring.

    The rest goes: helpers, constants and comments may give the answer away.
    Raises ValueError where there is no such function, SyntaxError where there is no Python.
    """
    nodes = ast.parse(source).body
    imports = [ast.unparse(node) for node in nodes if isinstance(node, ast.Import | ast.ImportFrom)]
    functions = [node for node in nodes if isinstance(node, ast.FunctionDef) and node.name.startswith("my_")]
    if not functions:
        raise ValueError("it defines no function my_...; only such functions are emptied")
    for node in functions:
        docstring = node.body[:1] if ast.get_docstring(node) else []
        node.body = [*docstring, ast.Expr(ast.Constant(...))]
    stubs = [ast.unparse(node) + "  # your turn" for node in functions]
    return "\n\n\n".join(["\n".join(imports)] * bool(imports) + stubs)


def fingerprint(notebook) -> str:
    """A hash of all cells' kinds and sources, blank ones aside: running the last cell adds one."""
    cells = [(cell["cell_type"], "".join(cell["source"])) for cell in notebook["cells"]]
    kept = [(kind, source) for kind, source in cells if source.strip()]
    return hashlib.sha256(json.dumps(kept).encode()).hexdigest()


def edited(copy: Path) -> bool:
    """Whether a copy holds anything that was not derived: its sources no longer match its hash, or it has none."""
    try:
        notebook = json.loads(copy.read_text(encoding="utf-8"))
        return notebook["metadata"]["mannbv"]["derived"] != fingerprint(notebook)
    except (ValueError, KeyError, TypeError):
        return True


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Derive the reader's copies of the notebooks.")
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "course", help="default: course/")
    folder = parser.parse_args(argv).folder
    try:
        paths = sorted(SOLVED.glob("*.ipynb"))
        if not paths:
            raise NotebookError(f"{SOLVED} holds no notebook; restore it from the repository")
        files = {path.name: (nbformat.writes(derive(path)) + "\n").encode() for path in paths}
        beside = [path for path in sorted(SOLVED.glob("records/*")) if path.is_file()]
        files |= {path.relative_to(SOLVED).as_posix(): path.read_bytes() for path in beside}
        kept = [path.name for path in paths if (folder / path.name).exists() and edited(folder / path.name)]
        for name in files:
            if name not in kept:
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                write(folder / name, files[name])
    except (NotebookError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    for name in kept:
        print(f"{folder / name}: kept, it holds your changes; delete or rename it to get a fresh copy")
    print(f"{folder}: {len(paths) - len(kept)} fresh, {len(kept)} kept")
    return 0


if __name__ == "__main__":
    sys.exit(main())
