"""Run the notebooks and store their outputs, byte for byte the same on every run.

    python tools/notebooks.py [--check] [NOTEBOOK...]      (without names: all of notebooks/)

--check writes nothing: it runs each notebook twice and fails where the two runs, or the stored file, differ by a byte.
A notebook is written only when every cell ran, and whole or not at all; one that fails is named, with its cell.
"""

import argparse
import json
import re
import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError

from mannbv import archive

ROOT = Path(__file__).resolve().parent.parent
MAX_BYTES = 500_000
TIMEOUT = 600  # [s] a cell
METADATA = {
    "kernelspec": {"display_name": "Python 3 (ipykernel)", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
KEPT_CELL_METADATA = {"tags", "jupyter"}
# A widget's view names a model that lives in one kernel only; its text form stays.
WIDGET_VIEW = "application/vnd.jupyter.widget-view+json"


class NotebookError(ValueError):
    """A notebook that must not be stored: the message says which, where and why."""


def sanitizers() -> list[tuple[str, str]]:
    """(regex, replacement) pairs of tools/sanitize.cfg, in the way nbval reads them."""
    text = (ROOT / "tools" / "sanitize.cfg").read_text(encoding="utf-8")
    return re.findall(r"^regex: (.*)$\n^replace: (.*)$", text, flags=re.MULTILINE)


def load(path: Path) -> nbformat.NotebookNode:
    """The notebook, each cell with an id that does not change from run to run: its own, or its place."""
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
        raw.update(nbformat=4, nbformat_minor=5)
        for index, cell in enumerate(raw["cells"]):
            cell.setdefault("id", f"cell-{index:02d}")
        notebook = nbformat.reads(json.dumps(raw), as_version=4)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise NotebookError(f"{path}: not a notebook of format 4 ({error}); restore it or save it anew") from None
    try:
        nbformat.validate(notebook)
    except nbformat.ValidationError as error:
        raise NotebookError(f"{path}: not a valid notebook ({error.message}); save it anew from JupyterLab") from None
    return notebook


def run(path: Path) -> bytes:
    """Run the notebook in a fresh kernel, in its own folder, and return the file that should be stored."""
    notebook = load(path)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    for cell in code:
        cell.execution_count = None  # so that a count tells that the cell was run here
    client = NotebookClient(
        notebook,
        timeout=TIMEOUT,
        kernel_name="python3",
        record_timing=False,
        store_widget_state=False,
        coalesce_streams=True,
        extra_arguments=["--log-level=ERROR"],
        resources={"metadata": {"path": str(path.resolve().parent)}},
    )
    try:
        client.execute()
    except CellExecutionError as error:
        cell = max(place for place, cell in enumerate(code, 1) if cell.execution_count)
        raise NotebookError(f"{path}: code cell {cell} raised {error.ename}: {error.evalue}; not written") from None
    except (CellTimeoutError, DeadKernelError) as error:
        raise NotebookError(f"{path}: {str(error).splitlines()[0]}; not written") from None
    normalise(notebook)
    stored = (nbformat.writes(notebook) + "\n").encode()
    if str(ROOT).encode() in stored:
        raise NotebookError(f"{path}: an output holds this machine's path {ROOT}; print a relative one")
    if len(stored) > MAX_BYTES:
        raise NotebookError(f"{path}: {len(stored):,} B, over {MAX_BYTES:,}; draw fewer or smaller pictures")
    return stored


def normalise(notebook: nbformat.NotebookNode) -> None:
    """Drop, in place, what changes from run to run or machine to machine. Execution counts stay: nbval wants them."""
    notebook.metadata = nbformat.from_dict(METADATA)
    for cell in notebook.cells:
        cell.metadata = {key: value for key, value in cell.metadata.items() if key in KEPT_CELL_METADATA}
        for output in cell.get("outputs", ()):
            if "text" in output:
                output.text = sanitise(output.text)
            if "data" in output:
                output.data.pop(WIDGET_VIEW, None)
                output.data.update({kind: sanitise(text) for kind, text in output.data.items() if "text/" in kind})


def sanitise(text: str) -> str:
    """The text with addresses and the like replaced, as nbval replaces them before it compares."""
    for regex, replacement in sanitizers():
        text = re.sub(regex, replacement, text)
    return text


def write(path: Path, stored: bytes) -> None:
    """Replace the file whole, so that a kill leaves the old one."""
    with archive.whole(path) as file:
        file.write(stored)


def check(path: Path) -> None:
    """Raise NotebookError unless two runs and the stored file agree to the byte."""
    first, second = run(path), run(path)
    if first != second:
        raise NotebookError(f"{path}: two runs differ, first in line {first_difference(first, second)}")
    if first != path.read_bytes():
        line = first_difference(path.read_bytes(), first)
        raise NotebookError(f"{path}: stored outputs are out of date, first in line {line}; make notebooks")


def first_difference(a: bytes, b: bytes) -> str:
    """Number and (shortened) text of the first line in which two files differ."""
    a_lines, b_lines = a.decode().splitlines(), b.decode().splitlines()
    index = next((k for k, (x, y) in enumerate(zip(a_lines, b_lines, strict=False)) if x != y), len(b_lines) - 1)
    return f"{index + 1}: {b_lines[index].strip()[:80]}"


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Run the notebooks and store their outputs.")
    parser.add_argument("notebooks", nargs="*", type=Path, help="default: every notebook in notebooks/")
    parser.add_argument("--check", action="store_true", help="write nothing; fail unless two runs agree to the byte")
    options = parser.parse_args(argv)
    paths = options.notebooks or sorted((ROOT / "notebooks").glob("*.ipynb"))
    if not paths:
        print("notebooks/ holds no notebook", file=sys.stderr)
        return 2
    failed = 0
    for path in paths:
        try:
            if options.check:
                check(path)
            else:
                write(path, run(path))
        except (NotebookError, OSError) as error:
            failed += 1
            print(error, file=sys.stderr)
        else:
            print(f"{path.name}: {'agrees' if options.check else 'stored'}, {path.stat().st_size:,} B", flush=True)
    return 2 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
