"""Which tables belong together."""

from mannbv.lab.report import communication, quality
from mannbv.lab.report.tabular import Table
from mannbv.lab.study import Results


def tables(results: Results) -> list[Table]:
    """What `compare` prints of its `results.json`: map quality and risk, path and risk, bytes."""
    return [quality.map_table(results), quality.path_table(results), *communication.bytes_tables(results)]


def paper_tables(several: list[Results]) -> list[Table]:
    """The paper's six tables in its order, for the contents of several `results.json`, each beside what it prints.

    Table II, bytes of a robot, a team and a message; III and V, growth of centralized maps for two and five robots;
    VI, shared data against team size, which needs several sizes. The seconds of a planning cycle come last.
    """
    found = quality.tables_beside(several) + communication.growth_tables(several) + communication.team_tables(several)
    for results in several:
        found += [
            *communication.bytes_tables(results),
            communication.exchange_table(results),
            communication.time_table(results),
        ]
    return sorted(found, key=lambda table: table.name.split("-")[0])
