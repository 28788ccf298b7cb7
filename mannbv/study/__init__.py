"""Many episodes: comparisons over strategies and seeds, their statistics, and the paper's tables."""

from mannbv.study.calibration import KINDS, Calibration, Forecasts, calibrate, calibration, forecasts
from mannbv.study.comparison import Outcome, Progress, compare, run_file
from mannbv.study.crew import Tick
from mannbv.study.growth import episode_of, picked
from mannbv.study.meter import Meter
from mannbv.study.moment import Portrait, Snapshot, midway, snapshot
from mannbv.study.quality import map_table, path_table
from mannbv.study.reduced import Agreement, SameViews, reduced, same_views
from mannbv.study.resampling import Estimate, bootstrap
from mannbv.study.results import StudyError, assemble, gather, load, rows_of, run_files, save
from mannbv.study.sheets import paper_tables, tables
from mannbv.study.summary import interval, per_seed, summarise
from mannbv.study.tabular import Table, as_csv, as_latex, as_text, digits, file_name, setting, table_csv, write
from mannbv.study.traffic import bytes_tables, exchange_table, growth_table, growth_tables, team_tables, time_table

__all__ = [
    "KINDS",
    "Agreement",
    "Calibration",
    "Estimate",
    "Forecasts",
    "Meter",
    "Outcome",
    "Portrait",
    "Progress",
    "SameViews",
    "Snapshot",
    "StudyError",
    "Table",
    "Tick",
    "as_csv",
    "as_latex",
    "as_text",
    "assemble",
    "bootstrap",
    "bytes_tables",
    "calibrate",
    "calibration",
    "compare",
    "digits",
    "episode_of",
    "exchange_table",
    "file_name",
    "forecasts",
    "gather",
    "growth_table",
    "growth_tables",
    "interval",
    "load",
    "map_table",
    "midway",
    "paper_tables",
    "path_table",
    "per_seed",
    "picked",
    "reduced",
    "rows_of",
    "run_file",
    "run_files",
    "same_views",
    "save",
    "setting",
    "snapshot",
    "summarise",
    "table_csv",
    "tables",
    "team_tables",
    "time_table",
    "write",
]
