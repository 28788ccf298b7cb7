"""Many episodes: comparisons over strategies and seeds, their statistics, and the paper's tables."""

from mannbv.study.comparison import Outcome, Progress, compare, run_file
from mannbv.study.crew import Tick
from mannbv.study.meter import Meter
from mannbv.study.moment import Portrait, Snapshot, midway, snapshot
from mannbv.study.results import StudyError, assemble, gather, load, rows_of, save
from mannbv.study.summary import interval, per_seed, summarise
from mannbv.study.tabular import Table, as_csv, as_latex, as_text, bytes_tables, map_table, path_table, tables

__all__ = [
    "Meter",
    "Outcome",
    "Portrait",
    "Progress",
    "Snapshot",
    "StudyError",
    "Table",
    "Tick",
    "as_csv",
    "as_latex",
    "as_text",
    "assemble",
    "bytes_tables",
    "compare",
    "gather",
    "interval",
    "load",
    "map_table",
    "midway",
    "path_table",
    "per_seed",
    "rows_of",
    "run_file",
    "save",
    "snapshot",
    "summarise",
    "tables",
]
