"""`tables RUN…`: the paper's tables and figures from saved runs."""

import sys
from argparse import Namespace
from pathlib import Path

from mannbv.commands.line import Commands


def add(commands: Commands) -> None:
    """Teach the parser this command."""
    parser = commands.add_parser("tables", help="the paper's tables from saved runs")
    parser.add_argument("runs", nargs="+", metavar="RUN", help="results.json, a run's .npz, or a folder of them")
    parser.add_argument("--format", choices=("text", "csv", "latex"), default="text", help="csv: one line a robot")
    parser.add_argument("--out", type=Path, metavar="DIR", help="also write each table there, and the paper's figures")
    parser.set_defaults(command=run)


def run(arguments: Namespace) -> int:
    """Run it; returns the exit status."""
    from mannbv.lab import report, study

    merged, left_out = study.gather(arguments.runs)
    tables = report.paper_tables(merged)
    if arguments.format == "csv":
        print(report.as_csv(*merged), end="")
    else:
        print("\n\n".join(map({"text": report.as_text, "latex": report.as_latex}[arguments.format], tables)))
    sys.stdout.flush()
    if arguments.out:
        left_out += _write(arguments.runs, tables, arguments.out)
    for line in left_out:
        print(f"mannbv: {line}", file=sys.stderr)
    return 0


def _write(runs: list[str], tables: list, out: Path) -> list[str]:
    """Tables and the paper's figures into a folder; returns a line for each figure that cannot be drawn."""
    from mannbv.lab import draw, report, study

    files, lacking, figures = report.write(tables, out), [], 0
    records = study.run_files(runs)
    for name, figure, why in draw.paper_figures(records):
        if figure is None:
            lacking.append(f"{name}: {why}")
        else:
            figures += 1
            files += [draw.save(figure, out / (name + suffix)) for suffix in (".png", ".svg")]
    lacking += [] if records else ["no figures: they need the runs (.npz) beside results.json"]
    print(f"Written: {len(tables)} tables and {figures} figures, {len(files)} files in {out}", file=sys.stderr)
    return lacking
