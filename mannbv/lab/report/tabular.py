"""A table of text cells, and how it is written: for a terminal, as LaTeX, as CSV, and into files."""

import csv
import io
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from mannbv import archive
from mannbv.lab.study import Mean, Results
from mannbv.metrics import Score

NONE = "–"


@dataclass(frozen=True)
class Table:
    """Cells as text. heads: the lines of each column's head, its unit the last. notes: lines below.

    paper: rows that the paper prints, below a second rule. name: of its files.
    """

    title: str
    heads: tuple[tuple[str, ...], ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()
    paper: tuple[tuple[str, ...], ...] = ()
    name: str = "table"


def summary_table(
    results: Results, title: str, scores: list[Score], notes: tuple[str, ...], name: str = "table"
) -> Table:
    """A row a strategy, a column a score, from the summary; what is neither better nor worse has no interval."""
    measure, summary = results.constant("measure", "avar"), results.summary
    heads = (("", "", "strategy"), *(score.of(measure).head for score in scores))
    rows = [
        (strategy, *(_cell(means.get(score.key), score) for score in scores)) for strategy, means in summary.items()
    ]
    if any(" ± " in cell for row in rows for cell in row):
        spread = f"±: half of the 95 % interval, Student's t over the means of {len(results.seeds)} seeds."
        notes = (spread, *notes)
    return Table(title, heads, tuple(rows), notes, name=f"{name}-{slug(results)}")


def _cell(entry: Mean | None, score: Score) -> str:
    if entry is None:
        return NONE
    mean, decimals = entry.mean * score.scale, score.decimals
    if decimals is None:
        decimals = next((k for k, least in enumerate((99.95, 9.995)) if abs(mean) >= least or mean == 0), 2)
    text = f"{mean:,.{decimals}f}"
    if entry.interval and score.better:
        half = (entry.interval[1] - entry.interval[0]) / 2 * score.scale
        text += f" ± {half:,.{decimals}f}"
    return text


def digits(value: float) -> str:
    """A positive number with three digits, or all those before the point; at most five behind it."""
    return f"{value:,.{min(5, max(0, 2 - math.floor(math.log10(value) + 1e-9)))}f}" if value else "0"


def about(results: Results) -> str:
    """Scene, team and seeds, for a title."""
    robots, seeds = results.robots, results.seeds
    which = f"seed {seeds[0]}" if len(seeds) == 1 else f"{len(seeds)} seeds"
    return f"{setting(results.scene, results.dim)}, {robots} robot{'s' * (robots != 1)}, {which}"


def setting(scene: str, dim: int) -> str:
    """The scene, and whether it is one in space."""
    return scene + {3: " in 3-D"}.get(dim, "")


def slug(results: Results) -> str:
    """Scene and team, for a file's name."""
    return f"{file_name(results.scene)}-{results.dim}d-{results.robots}-robots"


def file_name(scene: str) -> str:
    """A scene's name without what a file's name should not hold."""
    return "".join(sign if sign.isalnum() else "-" for sign in Path(scene).name)


def as_text(table: Table) -> str:
    """For a terminal: aligned columns."""
    depth = max(map(len, table.heads))
    lines = [[head[k] for head in table.heads] for k in range(depth)]
    lines += [list(row) for row in (*table.rows, *table.paper)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(table.heads))]
    written = []
    for first, *rest in lines:
        cells = [first.ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(rest, widths[1:], strict=True))]
        written.append("  ".join(cells).rstrip())
    rule = "─" * (sum(widths) + 2 * (len(widths) - 1))
    head = [line for line in written[:depth] if line]
    ours, theirs = written[depth : depth + len(table.rows)], written[depth + len(table.rows) :]
    blocks = [line for block in (head, ours, theirs) if block for line in (*block, rule)]
    return "\n".join([table.title, rule, *blocks, *table.notes])


def as_latex(table: Table) -> str:
    """A booktabs table, the notes in its caption."""
    heads = [" ".join(part for part in head if part) for head in table.heads]
    first, *rows = [" & ".join(map(_tex, row)) + r" \\" for row in (heads, *table.rows, *table.paper)]
    ours, theirs = rows[: len(table.rows)], rows[len(table.rows) :]
    blocks = [line for block in (ours, theirs) if block for line in (r"\midrule", *block)]
    caption = _tex(" ".join([table.title + ".", *(note.strip() for note in table.notes)]))
    return "\n".join([
        r"\begin{table}", r"\centering", rf"\begin{{tabular}}{{l{'c' * (len(heads) - 1)}}}", r"\toprule",
        first, *blocks, r"\bottomrule", r"\end{tabular}", rf"\caption{{{caption}}}", r"\end{table}",
    ])  # fmt: skip


_TEX = {"\\": r"\textbackslash{}", "±": r"$\pm$", "↑": r"$\uparrow$", "↓": r"$\downarrow$", NONE: "--"}
_TEX |= {"−": "$-$", "²": "$^2$", "·": r"$\cdot$", ">": "$>$", "<": "$<$"}
_TEX |= {sign: f"\\{sign}" for sign in "%&#_{}$"}


def _tex(text: str) -> str:
    return "".join(_TEX.get(sign, sign) for sign in text)


def table_csv(table: Table) -> str:
    """A table's cells as plain numbers, empty where there is none, with a column for each interval."""
    rows = [*table.rows, *table.paper]
    columns = [[" ".join(filter(None, table.heads[0])), *(row[0] for row in rows)]]
    for k, head in enumerate(table.heads[1:], 1):
        title, cells = " ".join(filter(None, head)), [_plain(row[k]).split(" ± ") for row in rows]
        columns.append([title, *(cell[0] for cell in cells)])
        if any(len(cell) > 1 for cell in cells):
            columns.append([f"± {title}", *(cell[1] if len(cell) > 1 else "" for cell in cells)])
    return _written(zip(*columns, strict=True))


def _plain(cell: str) -> str:
    return "" if cell == NONE else cell.replace(",", "")


def as_csv(*several: Results) -> str:
    """The rows of results, one robot a line, with its scene and team."""
    lines = [
        {"scene": results.scene, "dim": results.dim, "robots": results.robots} | row.to_json()
        for results in several
        for row in results.rows
    ]
    return _written([lines[0], *(line.values() for line in lines)])


def _written(rows: Iterable) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    return out.getvalue()


_WRITERS = {".txt": lambda table: as_text(table) + "\n", ".tex": lambda table: as_latex(table) + "\n"}
_WRITERS[".csv"] = table_csv


def write(tables: Iterable[Table], folder: str | Path) -> list[Path]:
    """Each table as .txt, .tex and .csv in a folder; returns the files. Tables of one name are numbered."""
    place, names, files = Path(folder), {}, []
    for table in tables:
        names[table.name] = names.get(table.name, 0) + 1
        name = table.name if names[table.name] == 1 else f"{table.name}-{names[table.name]}"
        for suffix, writer in _WRITERS.items():
            file = place / (name + suffix)
            archive.write_text(file, writer(table))
            files.append(file)
    return files
