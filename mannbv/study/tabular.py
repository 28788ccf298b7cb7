"""The paper's tables from results: map quality and risk, path and risk, and bytes."""

import csv
import io
from dataclasses import dataclass

from mannbv import messages

_KB = 1e-3
_NAMES = {"avar": "AV@R", "var": "V@R"}
# Table II: "communication size per robot", of one exchange [KB]
_PAPER_BYTES = (("distributed", "0.206", "0.028"), ("limited", "25", "25"))


@dataclass(frozen=True)
class Table:
    """Cells as text. heads: the lines of each column's head, its unit the last. notes: lines below."""

    title: str
    heads: tuple[tuple[str, ...], ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Column:
    key: str  # of the summary
    head: tuple[str, ...]
    scale: float = 1.0
    decimals: int | None = 2  # None: three digits or more
    spread: bool = True  # with its interval


def tables(results: dict) -> list[Table]:
    """All of them, in the paper's order, for the content of `results.json`."""
    return [map_table(results), path_table(results), *bytes_tables(results)]


def map_table(results: dict) -> Table:
    """Map quality and risk, as in the paper's Table I; risk and clearance of the same paths on the true surfaces."""
    risk = _risk(results)
    columns = [
        _Column("total_risk_m", (f"{risk} ↑", "own map", "[m]")),
        _Column("total_risk_true_m", (f"{risk} ↑", "true surfaces", "[m]")),
        _Column("reference_clearance_m", ("least", "clearance ↑", "[m]")),
        _Column("psnr_db", ("PSNR ↑", "", "[dB]")),
        _Column("depth_mae_m", ("depth error ↓", "mean absolute", "[m]")),
    ]
    return _table(results, f"Map quality and risk: {_about(results)} (the paper's Table I)", columns, _fates(results))


def path_table(results: dict) -> Table:
    """Path and risk, as in the paper's Table IV: both against the shortest feasible path on the true plan."""
    risk = _risk(results)
    columns = [
        _Column("path_overhead", ("longer than", "shortest ↓", "[%]"), 100.0, 1),
        _Column("risk_gain_share", (f"{risk} gain ↑", "own map", "[%]"), 100.0, 1),
        _Column("risk_gain_m", (f"{risk} gain ↑", "own map", "[m]")),
        _Column("risk_gain_true_share", (f"{risk} gain ↑", "true surfaces", "[%]"), 100.0, 1),
        _Column("risk_gain_true_m", (f"{risk} gain ↑", "true surfaces", "[m]")),
        _Column("min_clearance_m", ("least clearance", "driven ↑", "[m]")),
    ]
    title = f"Path and risk: {_about(results)} (the paper's Table IV)"
    return _table(results, title, columns, ("Gains in percent are of the shortest paths' risk, team by team.",))


def bytes_tables(results: dict) -> list[Table]:
    """Bytes per robot, beside what the paper prints; and what the team sent, by kind, beside the paper's count."""
    columns = [
        _Column("sent_per_cycle_b", ("sent", "a cycle", "[KB]"), _KB, None),
        _Column("received_per_cycle_b", ("received", "a cycle", "[KB]"), _KB, None),
        _Column("bytes_sent", ("sent", "in all", "[KB]"), _KB, None),
        _Column("bytes_received", ("received", "in all", "[KB]"), _KB, None),
    ]
    notes = ("1 KB = 1000 B, every byte on every link. The paper prints one exchange of its 3-D runs (Table II).",)
    each = _table(results, f"Bytes per robot: {_about(results)}", columns, notes)
    printed = tuple((f"paper, {name}", sent, received, "–", "–") for name, sent, received in _PAPER_BYTES)
    each = Table(each.title, each.heads, each.rows + printed, each.notes)

    team, summary = results["robots"] * _KB, results["summary"]
    kinds = [f"bytes_{kind.__name__.lower()}" for kind in messages.KINDS]
    used = [k for k in kinds if any(s.get(k, {}).get("mean", 0) > 0 for s in summary.values())]
    columns = [
        _Column("bytes_sent", ("all", "", "[KB]"), team, None),
        *(_Column(kind, (kind.removeprefix("bytes_"), "", "[KB]"), team, None, False) for kind in used),
        _Column("bytes_paper", ("paper's count", "", "[KB]"), team, None),
        _Column("paper_per_cycle_b", ("paper's count", "a cycle", "[KB]"), _KB, None),
    ]
    note = "Paper's count: centralized, one uplink of each map; limited, the splats of all pairs; else everything."
    return [each, _table(results, f"Bytes of the team in an episode: {_about(results)}", columns, (note,))]


def _table(results: dict, title: str, columns: list[_Column], notes: tuple[str, ...]) -> Table:
    heads = (("", "", "strategy"), *(column.head for column in columns))
    rows = [(name, *(_cell(metrics, c) for c in columns)) for name, metrics in results["summary"].items()]
    if any(metrics.get(c.key, {}).get("interval") for metrics in results["summary"].values() for c in columns):
        spread = f"±: half of the 95 % interval, Student's t over the means of {len(results['seeds'])} seeds."
        notes = (spread, *notes)
    return Table(title, heads, tuple(rows), notes)


def _cell(metrics: dict, column: _Column) -> str:
    entry = metrics.get(column.key)
    if entry is None:
        return "–"
    mean, decimals = entry["mean"] * column.scale, column.decimals
    if decimals is None:
        decimals = next((k for k, least in enumerate((99.95, 9.995)) if abs(mean) >= least or mean == 0), 2)
    text = f"{mean:,.{decimals}f}"
    if entry["interval"] and column.spread:
        half = (entry["interval"][1] - entry["interval"][0]) / 2 * column.scale
        text += f" ± {half:,.{decimals}f}"
    return text


def _risk(results: dict) -> str:
    measure = str(results["config"].get("measure", "avar"))
    return _NAMES.get(measure, measure)


def _about(results: dict) -> str:
    robots, seeds = results["robots"], results["seeds"]
    which = f"seed {seeds[0]}" if len(seeds) == 1 else f"{len(seeds)} seeds"
    return f"{results['scene']}, {robots} robot{'s' * (robots != 1)}, {which}"


def _fates(results: dict) -> tuple[str, ...]:
    """How many robots reached their goals, collisions, and what kept each of the others."""
    by_strategy = {}
    for row in results["rows"]:
        by_strategy.setdefault(row["strategy"], []).append(row)
    reached, bumps = [], []
    for name, rows in by_strategy.items():
        reached.append(f"{name} {sum(bool(r.get('reached')) for r in rows)}/{len(rows)}")
        bumps.append(f"{name} {sum(r.get('collisions') or 0 for r in rows)}")
    failed = [
        f"  {r['strategy']}, seed {r['seed']}, robot {r['robot']}: {r.get('fate') or 'did not reach its goal'}"
        for r in results["rows"]
        if not r.get("reached")
    ]
    return (f"At their goals: {', '.join(reached)}.", f"Collisions: {', '.join(bumps)}.", *failed)


# ---- as text, LaTeX, CSV ------------------------------------------------------------------------------------------


def as_text(table: Table) -> str:
    """For a terminal: aligned columns."""
    lines = [[head[k] for head in table.heads] for k in range(3)] + [list(row) for row in table.rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(table.heads))]
    written = []
    for first, *rest in lines:
        cells = [first.ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(rest, widths[1:], strict=True))]
        written.append("  ".join(cells).rstrip())
    rule = "─" * (sum(widths) + 2 * (len(widths) - 1))
    head = [line for line in written[:3] if line]
    return "\n".join([table.title, rule, *head, rule, *written[3:], rule, *table.notes])


def as_latex(table: Table) -> str:
    """A booktabs table, the notes in its caption."""
    heads = [" ".join(part for part in head if part) for head in table.heads]
    rows = [" & ".join(map(_tex, row)) + r" \\" for row in (heads, *table.rows)]
    caption = _tex(" ".join([table.title + ".", *(note.strip() for note in table.notes)]))
    return "\n".join([
        r"\begin{table}", r"\centering", rf"\begin{{tabular}}{{l{'c' * (len(heads) - 1)}}}", r"\toprule",
        rows[0], r"\midrule", *rows[1:], r"\bottomrule", r"\end{tabular}", rf"\caption{{{caption}}}", r"\end{table}",
    ])  # fmt: skip


_TEX = {"\\": r"\textbackslash{}", "±": r"$\pm$", "↑": r"$\uparrow$", "↓": r"$\downarrow$", "–": "--"}
_TEX |= {sign: f"\\{sign}" for sign in "%&#_{}$"}


def _tex(text: str) -> str:
    return "".join(_TEX.get(sign, sign) for sign in text)


def as_csv(*several: dict) -> str:
    """The rows of results, one robot a line, with all columns that any row has."""
    rows = [{"scene": results["scene"]} | row for results in several for row in results["rows"]]
    columns = list(dict.fromkeys(key for row in rows for key in row))
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()
