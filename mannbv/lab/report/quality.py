"""Tables I and IV: how good and how safe maps and paths are, ours beside the paper's."""

import dataclasses
from itertools import pairwise

import numpy as np

from mannbv.lab.report import paper
from mannbv.lab.report.tabular import Table, about, summary_table
from mannbv.lab.study import Results
from mannbv.metrics import SCORES, Score


def map_table(results: Results) -> Table:
    """Map quality and risk, as in the paper's Table I; risk and clearance of the same paths on the true surfaces."""
    keys = ("total_risk_m", "total_risk_true_m", "reference_clearance_m", "psnr_db", "depth_mae_m")
    title = f"Map quality and risk: {about(results)} (the paper's Table I)"
    return summary_table(results, title, [SCORES[key] for key in keys], _fates(results), "table1-maps")


def path_table(results: Results) -> Table:
    """Path and risk, as in the paper's Table IV: both against the shortest feasible path on the true plan."""
    keys = (
        "path_overhead", "risk_gain_share", "risk_gain_m", "risk_gain_true_share", "risk_gain_true_m",
        "min_clearance_m",
    )  # fmt: skip
    title = f"Path and risk: {about(results)} (the paper's Table IV)"
    notes = ("Gains in percent are of the shortest paths' risk, team by team.",)
    return summary_table(results, title, [SCORES[key] for key in keys], notes, "table4-paths")


def tables_beside(several: list[Results]) -> list[Table]:
    """Tables I and IV of each of several results with the order of the strategies, ours and the paper's; and the
    paper's own two tables."""
    beside = []
    for results in several:
        beside += [
            _with(map_table(results), _orders(results, paper.MAPS, paper.MAP_SCORES, "total_risk_true_m")),
            _with(path_table(results), _orders(results, paper.PATHS, paper.PATH_SCORES, "risk_gain_true_share")),
        ]
    maps, paths = _printed("I", 1, paper.MAPS, paper.MAP_SCORES), _printed("IV", 4, paper.PATHS, paper.PATH_SCORES)
    return [*beside, maps, paths]


def _with(table: Table, notes: list[str]) -> Table:
    return dataclasses.replace(table, notes=(*table.notes, *notes))


def _printed(numeral: str, number: int, printed: dict, keys: tuple[str, ...]) -> Table:
    scores = [SCORES[key] for key in keys]
    heads = (("", "building"), ("", "strategy"), *((score.head[0], score.head[2]) for score in scores))
    rows = [
        (building, name, *(f"{value:.{score.decimals}f}" for value, score in zip(parts[k], scores, strict=True)))
        for k, building in enumerate(paper.BUILDINGS)
        for name, parts in printed.items()
    ]
    title = f"The paper's own Table {numeral}: other buildings, another simulator and camera"
    notes = ("Only the order of the strategies compares with ours.",)
    return Table(title, heads, tuple(rows), notes, name=f"table{number}-paper")


def _orders(results: Results, printed: dict, keys: tuple[str, ...], *unprinted: str) -> list[str]:
    """For each score our order of the strategies, best first, and that of the paper's mean over its buildings."""
    several = len(results.seeds) > 1
    lines = [f"Orders of means: {'a difference within ± tells nothing' if several else 'one seed tells little'}."]
    means = {strategy: np.mean(scores, 0).tolist() for strategy, scores in printed.items()}
    for column, key in enumerate((*keys, *unprinted)):
        score = SCORES[key].of(results.constant("measure", "avar"))
        ours = {s: scores[key].mean * score.scale for s, scores in results.summary.items() if key in scores}
        theirs = {s: scores[column] for s, scores in means.items() if column < len(scores)}
        lines.append(f"By {score.label}, best first: ours {order(ours, score)};")
        beside = f"mean of four buildings {order(theirs, score)}" if theirs else "tables have no such score"
        lines.append(f"  the paper's {beside}.")
    return lines


def order(means: dict[str, float], score: Score) -> str:
    """Names, the best score first, such as "a > b = c"; means as printed, and equal is what is printed alike."""
    names = sorted(means, key=lambda name: -score.better * means[name])
    text = names[0] if names else "none"
    for before, name in pairwise(names):
        alike = f"{means[before]:.{score.decimals}f}" == f"{means[name]:.{score.decimals}f}"
        text += f" {'=' if alike else '>'} {name}"
    return text


def _fates(results: Results) -> tuple[str, ...]:
    """How many robots reached their goals, collisions, and what kept each of the others."""
    teams = {name: results.of(name) for name in results.summary}
    reached = [f"{name} {sum(bool(row.reached) for row in rows)}/{len(rows)}" for name, rows in teams.items()]
    bumps = [f"{name} {sum(row.collisions or 0 for row in rows)}" for name, rows in teams.items()]
    failed = [
        f"  {row.strategy}, seed {row.seed}, robot {row.robot}: {row.fate or 'did not reach its goal'}"
        for row in results.rows
        if not row.reached
    ]
    return (f"At their goals: {', '.join(reached)}.", f"Collisions: {', '.join(bumps)}.", *failed)
