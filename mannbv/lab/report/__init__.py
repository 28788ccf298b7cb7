"""Reports of studies: the paper's tables beside what it prints, as text, CSV and LaTeX."""

from mannbv.lab.report.communication import (
    bytes_tables,
    exchange_table,
    growth_table,
    growth_tables,
    team_tables,
    time_table,
)
from mannbv.lab.report.quality import map_table, path_table
from mannbv.lab.report.tables import paper_tables, tables
from mannbv.lab.report.tabular import Table, as_csv, as_latex, as_text, digits, file_name, setting, table_csv, write

__all__ = [
    "Table",
    "as_csv",
    "as_latex",
    "as_text",
    "bytes_tables",
    "digits",
    "exchange_table",
    "file_name",
    "growth_table",
    "growth_tables",
    "map_table",
    "paper_tables",
    "path_table",
    "setting",
    "table_csv",
    "tables",
    "team_tables",
    "time_table",
    "write",
]
