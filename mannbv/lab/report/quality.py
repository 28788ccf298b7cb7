"""Tables I and IV: how good and how safe maps and paths are, ours beside the paper's."""

import dataclasses
from itertools import pairwise

import numpy as np

from mannbv.lab.report import paper
from mannbv.lab.report.tabular import Column, Table, about, summary_table

_NAMES = {"avar": "AV@R", "var": "V@R"}


def map_table(results: dict) -> Table:
    """Map quality and risk, as in the paper's Table I; risk and clearance of the same paths on the true surfaces."""
    risk = _risk(results)
    columns = [
        Column("total_risk_m", (f"{risk} ↑", "own map", "[m]")),
        Column("total_risk_true_m", (f"{risk} ↑", "true surfaces", "[m]")),
        Column("reference_clearance_m", ("least", "clearance ↑", "[m]")),
        Column("psnr_db", ("PSNR ↑", "", "[dB]")),
        Column("depth_mae_m", ("depth error ↓", "mean absolute", "[m]")),
    ]
    title = f"Map quality and risk: {about(results)} (the paper's Table I)"
    return summary_table(results, title, columns, _fates(results), "table1-maps")


def path_table(results: dict) -> Table:
    """Path and risk, as in the paper's Table IV: both against the shortest feasible path on the true plan."""
    risk = _risk(results)
    columns = [
        Column("path_overhead", ("longer than", "shortest ↓", "[%]"), 100.0, 1),
        Column("risk_gain_share", (f"{risk} gain ↑", "own map", "[%]"), 100.0, 1),
        Column("risk_gain_m", (f"{risk} gain ↑", "own map", "[m]")),
        Column("risk_gain_true_share", (f"{risk} gain ↑", "true surfaces", "[%]"), 100.0, 1),
        Column("risk_gain_true_m", (f"{risk} gain ↑", "true surfaces", "[m]")),
        Column("min_clearance_m", ("least clearance", "driven ↑", "[m]")),
    ]
    title = f"Path and risk: {about(results)} (the paper's Table IV)"
    notes = ("Gains in percent are of the shortest paths' risk, team by team.",)
    return summary_table(results, title, columns, notes, "table4-paths")


def tables_beside(several: list[dict]) -> list[Table]:
    """Tables I and IV of each of several results with the order of the strategies, ours and the paper's; and the
    paper's own two tables."""
    beside = []
    for results in several:
        risk = _risk(results)
        maps = (
            ("total_risk_m", f"{risk} on the own map", 1, 2),
            ("psnr_db", "PSNR", 1, 2),
            ("depth_mae_m", "depth", -1, 2),
            ("total_risk_true_m", f"{risk} on the true surfaces", 1, 2),
        )
        paths = (
            ("path_overhead", "path length", -1, 3),
            ("risk_gain_share", f"{risk} gain on the own map", 1, 3),
            ("risk_gain_true_share", f"{risk} gain on the true surfaces", 1, 3),
        )
        beside += [
            _with(map_table(results), _orders(results, maps, paper.MAPS)),
            _with(path_table(results), _orders(results, paths, paper.PATHS)),
        ]
    maps, paths = ("AV@R ↑ [m]", "PSNR ↑ [dB]", "depth ↓ [m]"), ("longer ↓ [%]", "AV@R gain ↑ [%]")
    return [*beside, _printed("I", 1, paper.MAPS, maps, 2), _printed("IV", 4, paper.PATHS, paths, 1)]


def _with(table: Table, notes: list[str]) -> Table:
    return dataclasses.replace(table, notes=(*table.notes, *notes))


def _printed(numeral: str, number: int, scores: dict, columns: tuple[str, ...], decimals: int) -> Table:
    heads = (("", "building"), ("", "strategy"), *(tuple(column.rsplit(" ", 1)) for column in columns))
    rows = [
        (building, name, *(f"{value:.{decimals}f}" for value in parts[k]))
        for k, building in enumerate(paper.BUILDINGS)
        for name, parts in scores.items()
    ]
    title = f"The paper's own Table {numeral}: other buildings, another simulator and camera"
    notes = ("Only the order of the strategies compares with ours.",)
    return Table(title, heads, tuple(rows), notes, name=f"table{number}-paper")


def _orders(results: dict, keys: tuple, printed: dict) -> list[str]:
    """For each score our order of the strategies, best first, and that of the paper's mean over its buildings.

    The scores that the paper does not print come last.
    """
    several = len(results["seeds"]) > 1
    lines = [f"Orders of means: {'a difference within ± tells nothing' if several else 'one seed tells little'}."]
    means = {strategy: np.mean(scores, 0).tolist() for strategy, scores in printed.items()}
    for column, (key, name, sign, decimals) in enumerate(keys):
        ours = {s: metrics[key]["mean"] for s, metrics in results["summary"].items() if key in metrics}
        theirs = {s: scores[column] for s, scores in means.items() if column < len(scores)}
        lines.append(f"By {name}, best first: ours {order(ours, sign, decimals)};")
        ranked = f"mean of four buildings {order(theirs, sign, 2)}" if theirs else "tables have no such score"
        lines.append(f"  the paper's {ranked}.")
    return lines


def order(scores: dict[str, float], sign: int, decimals: int) -> str:
    """Names by falling (sign 1) or rising (−1) score, such as "a > b = c"; equal is what is printed alike."""
    names = sorted(scores, key=lambda name: -sign * scores[name])
    text = names[0] if names else "none"
    for before, name in pairwise(names):
        alike = f"{scores[before]:.{decimals}f}" == f"{scores[name]:.{decimals}f}"
        text += f" {'=' if alike else '>'} {name}"
    return text


def _risk(results: dict) -> str:
    measure = str(results["config"].get("measure", "avar"))
    return _NAMES.get(measure, measure)


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
