"""Tables II, III, V and VI: what is sent, beside what the paper prints; and the seconds of a cycle."""

import dataclasses

from mannbv import archive, messages
from mannbv.lab.report import paper
from mannbv.lab.report.tabular import NONE, Table, about, digits, setting, slug, summary_table
from mannbv.lab.study import Results, picked
from mannbv.metrics import SCORES, Score

_KB, _MB, _MIB = 1e-3, 1e-6, 2**-20
_GROWTH = {2: ("III", 3), 5: ("V", 5)}  # team size → the paper's table


def bytes_tables(results: Results) -> list[Table]:
    """Bytes per robot, beside what the paper prints; and what the team sent, by kind, beside the paper's count."""
    keys = ("sent_per_cycle_b", "received_per_cycle_b", "bytes_sent", "bytes_received")
    notes = ("1 KB = 1000 B, every byte on every link. The paper prints one exchange of its 3-D runs (Table II).",)
    each = summary_table(results, f"Bytes per robot: {about(results)}", _scores(keys), notes, "table2-robots")
    printed = tuple((f"paper, {name}", *values, NONE, NONE) for name, values in paper.EXCHANGE.items())
    each = dataclasses.replace(each, rows=each.rows + printed)

    kinds = [f"bytes_{kind.__name__.lower()}" for kind in messages.KINDS]
    used = [key for key in kinds if any(key in means and means[key].mean > 0 for means in results.summary.values())]
    scores = [*_scores(("bytes_sent", *used, "bytes_paper"), results.robots), *_scores(("paper_per_cycle_b",))]
    note = "Paper's count: centralized, one uplink of each map; limited, the splats of all pairs; else everything."
    title = f"Bytes of the team in an episode: {about(results)}"
    return [each, summary_table(results, title, scores, (note,), "table2-team")]


def _scores(keys, robots: int = 1) -> list[Score]:
    """Scores in KB, of so many robots."""
    return [SCORES[key].scaled("KB", robots * _KB) for key in keys]


def exchange_table(results: Results) -> Table:
    """Bytes of one message, by strategy and kind: what one exchange on one link is, as in the paper's Table II."""
    sums = {}
    for entry in results.episodes:
        for kind, (count, n_bytes) in entry.messages.items():
            key = entry.strategy, kind.lower()
            before = sums.get(key, (0, 0))
            sums[key] = before[0] + count, before[1] + n_bytes
    rows = [(s, kind, f"{n:,}", f"{b / n:,.0f}", digits(b * _KB)) for (s, kind), (n, b) in sums.items()]
    ideal, guests = messages.ideal_exchange_bytes(), messages.limited_sharing_bytes(2) // 2
    printed = [
        ("paper, distributed", "sent", NONE, "206", NONE),
        ("paper, distributed", "received", NONE, "28", NONE),
        ("paper, distributed", "17 float64", NONE, str(ideal), NONE),
        ("paper, limited", "400 splats", NONE, f"{guests:,}", NONE),
    ]
    heads = (("", "strategy"), ("", "kind"), ("messages", "[1]"), ("one, mean", "[B]"), ("in all", "[KB]"))
    title = f"Bytes of one message: {about(results)} (the paper's Table II)"
    codec = results.constant("codec", "json")
    notes = (
        f"Really serialised, as {codec}, relays included. One message of copies, a robot's yaws for the whole team in",
        "one round of C-ADMM, is what compares with the paper's exchange of the distributed method.",
    )
    notes = notes if rows or not missing(results) else (missing(results),)
    return Table(title, heads, tuple(rows), notes, tuple(printed), f"table2-messages-{slug(results)}")


def growth_table(results: Results) -> Table:
    """Centralized: every robot's splats at some cycles and what one uplink of all maps takes (Tables III and V)."""
    log = next((entry for entry in results.episodes if entry.strategy == "centralized"), None)
    rows, notes = [], (missing(results, "centralized") or "No cycle was run.",)
    if log is not None and log.cycles:
        for c in picked(log.cycles):
            counts, sent = log.splats[c], log.bytes_by_cycle[c]
            uplink = messages.centralized_bytes(counts, results.dim) * _MIB
            rows.append((f"cycle {c + 1}", *_counted(counts), digits(uplink), digits(sent * _MB), NONE))
        each = messages.centralized_bytes([1], results.dim)
        widest = results.constant("share_scale", 0.0)
        notes = (
            f"Seed {log.seed}; maps are sent again in every cycle. One uplink: {each} B for each of their splats.",
            "Really sent: every message of that cycle on every link, priors and grids included"
            + (f"; no splat wider than {widest:g} m." if widest else "."),
        )
    return _growth(about(results), results.robots, rows, notes, slug(results))


def _growth(what: str, n_robots: int, rows: list[tuple], notes: tuple[str, ...], name: str) -> Table:
    printed = []
    for k, (counts, size) in enumerate(paper.GROWTH.get(n_robots, ())):
        uplink = messages.centralized_bytes(counts) * _MIB
        printed.append((f"paper, step {k + 1}", *_counted(counts), f"{uplink:.2f}", NONE, f"{size:.2f}"))
    if printed:
        notes = (*notes, "The paper's rows: 56 B for each of its splats, beside the size it prints; its MB are MiB.")
    numeral, number = _GROWTH.get(n_robots, ("", 3))
    like = f"the paper's Table {numeral}" if numeral else "as the paper's Tables III and V"
    heads = (("", "", "centralized"), *(("robot", str(k), "[splats]") for k in range(n_robots)))
    heads += (("one uplink", "of all maps", "[MiB]"), ("really", "sent", "[MB]"), ("paper", "prints", "[MB]"))
    title = f"Growth of the shared maps: {what} ({like})"
    return Table(title, heads, tuple(rows), notes, tuple(printed), f"table{number}-growth-{name}")


def _counted(counts) -> tuple[str, ...]:
    return tuple(f"{count:,}" for count in counts)


def growth_tables(several: list[Results]) -> list[Table]:
    """Tables III and V: for each of several results, and the paper's rows alone for a team size that is not there."""
    tables = [(results.robots, growth_table(results)) for results in several]
    for size in sorted(set(_GROWTH) - {size for size, _ in tables}):
        note = f"Of ours: {_command(several[0], [size])}"
        tables.append((size, _growth(f"{size} robots", size, [], (note,), f"{size}-robots")))
    return [table for _, table in sorted(tables, key=lambda pair: pair[0])]


def team_tables(several: list[Results]) -> list[Table]:
    """Table VI, one a scene: shared data against the size of the team, half way through the shortest episode."""
    groups = {}
    for results in several:
        key = archive.to_json([results.scene, results.dim, results.config], sort_keys=True)
        groups.setdefault(key, []).append(results)
    return [_team_table(sorted(group, key=lambda results: results.robots)) for group in groups.values()]


def _team_table(group: list[Results]) -> Table:
    first, dim = group[0], group[0].dim
    logs = {}  # (team size, strategy) → its first episode
    for results in group:
        for entry in results.episodes:
            if entry.strategy in ("centralized", "limited") and entry.cycles:
                logs.setdefault((results.robots, entry.strategy), entry)
    step = (min((entry.cycles for entry in logs.values()), default=1) - 1) // 2
    sizes = sorted({size for size, _ in logs} | set(paper.TEAMS))
    rows = []
    for size in sizes:
        central, limited = logs.get((size, "centralized")), logs.get((size, "limited"))
        splats = central.splats[step] if central else ()
        prints = paper.TEAMS.get(size)
        rows.append((
            f"{size} robot{'s' * (size != 1)}",
            f"{sum(splats):,}" if central else NONE,
            digits(messages.centralized_bytes(splats, dim) * _MIB) if central else NONE,
            digits(limited.bytes_paper_by_cycle[step] * _MB) if limited else NONE,
            digits(messages.limited_sharing_bytes(size) * _MB),
            f"{prints[0]:.2f}" if prints else NONE,
            f"{prints[1]:.3f}" if prints else NONE,
        ))  # fmt: skip
    heads = (
        ("", "", "team size"), ("maps", "", "[splats]"), ("centralized", "one uplink", "[MiB]"),
        ("limited", "really sent", "[MB]"), ("limited", "N(N−1)·25 kB", "[MB]"),
        ("paper", "centralized", "[MB]"), ("paper", "limited", "[MB]"),
    )  # fmt: skip
    notes = []
    if logs:
        notes.append(f"Planning cycle {step + 1} of every run (its first seed), half way through the shortest.")
        codec = first.constant("codec", "json")
        notes.append(f"Limited, really sent: splats with ids and priors, no more than needed, written in {codec}.")
    notes.append("The paper's limited column is N(N−1)·25 kB, but for ten robots: 2.150 where that is 2.25.")
    lacking = [size for size in paper.TEAMS if not {(size, "centralized"), (size, "limited")} & set(logs)]
    if lacking:
        notes.append(f"More rows: {_command(first, lacking)}")
    title = f"Shared data against team size: {setting(first.scene, dim)} (the paper's Table VI)"
    name = slug(first).rsplit("-", 2)[0]
    return Table(title, heads, tuple(rows), tuple(notes), name=f"table6-teams-{name}")


def _command(results: Results, sizes: list[int]) -> str:
    which = f"--robots {sizes[0]}" if len(sizes) == 1 else "--robots N"
    each = "" if len(sizes) == 1 else f" for N = {', '.join(map(str, sizes))}"
    return f"compare {results.scene} --dim {results.dim} {which} --out DIR{each}; then tables on all folders."


def missing(results: Results, strategy: str | None = None) -> str:
    """Why nothing is known cycle by cycle of a strategy (or of any), and the remedy; "" where something is."""
    if not results.episodes:
        return "Not known cycle by cycle: run the same compare again, which rewrites results.json from its runs."
    if strategy is not None and all(entry.strategy != strategy for entry in results.episodes):
        return f"No {strategy} run here: add it with compare … --strategies {strategy}."
    return ""


def time_table(results: Results) -> Table:
    """Seconds of a planning cycle of the whole team, by stage: the mean over cycles and seeds."""
    stages = list(dict.fromkeys(stage for entry in results.episodes for stage in entry.seconds))
    rows = []
    for strategy in dict.fromkeys(entry.strategy for entry in results.episodes):
        mine = [entry for entry in results.episodes if entry.strategy == strategy]
        cycles = sum(entry.cycles for entry in mine)
        if cycles:
            spent = [sum(entry.seconds.get(stage, 0.0) for entry in mine) / cycles for stage in stages]
            rows.append((strategy, f"{cycles:,}", *map(digits, spent), digits(sum(spent))))
    heads = (("", "strategy"), ("cycles", "[1]"), *((stage, "[s]") for stage in stages), ("all", "[s]"))
    notes = ("All robots of the team one after another in one process, whatever else the machine was doing.",)
    notes = notes if rows else (missing(results) or "No cycle was run.",)
    title = f"Seconds of a planning cycle: {about(results)}"
    return Table(title, heads, tuple(rows), notes, name=f"time-{slug(results)}")
