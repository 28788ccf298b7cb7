"""The paper's six tables: their numbers against rows and ledgers summed by hand, the paper's against its own text."""

import csv
import dataclasses
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest

from mannbv import episode, messages, metrics
from mannbv.config import Config
from mannbv.lab import report, study
from mannbv.lab.report import communication, paper, quality
from mannbv.metrics import SCORES

TINY = Config(max_cycles=3, fit_steps=4, image_width=32)
PAPER = Path(__file__).parents[1].parent / "shared" / "paper.tex"


@pytest.fixture(scope="module")
def records():
    return {name: episode.run("flat", name, TINY, 0, 2) for name in ("centralized", "limited", "distributed")}


@pytest.fixture(scope="module")
def results(records):
    """A real comparison of two robots."""
    rows = [row for record in records.values() for row in record.rows]
    return study.assemble("flat", 2, 2, TINY, rows, [study.episode_of(record) for record in records.values()])


def log(strategy, splats, sent, counted=None, **extra) -> study.EpisodeLog:
    """An episode as `results.json` has it."""
    cycles = len(splats)
    entry = {
        "strategy": strategy, "seed": 0, "cycles": cycles, "splats": splats,
        "guests": [[0] * len(counts) for counts in splats], "bytes_by_cycle": sent,
        "bytes_paper_by_cycle": counted or sent, "messages": {"Splats": [cycles, sum(sent)]}, "seconds": {"map": 1.0},
    }  # fmt: skip
    return study.EpisodeLog.from_json(entry | extra)


def made_up(n_robots, episodes, dim=3, **scores) -> study.Results:
    rows = [
        metrics.Row(s, 0, k, cycles=2, reached=True, **scores)
        for s in ("centralized", "limited")
        for k in range(n_robots)
    ]
    return study.assemble("hall", dim, n_robots, Config(), rows, episodes)


def cells(table, first: str) -> tuple[str, ...]:
    (row,) = (row for row in (*table.rows, *table.paper) if row[0] == first)
    return row


def named(tables, name: str):
    (table,) = (table for table in tables if table.name.startswith(name))
    return table


# ---- what the paper prints ------------------------------------------------------------------------------------------


@pytest.mark.skipif(not PAPER.is_file(), reason="the paper's text is not beside this checkout")
def test_the_papers_numbers_are_those_of_its_text():
    text = PAPER.read_text(encoding="utf-8").replace("{,}", "")
    blocks = re.findall(r"\\begin\{tabular\}(.*?)\\end\{tabular\}", text, re.DOTALL)
    blocks = [block for block in blocks if "midrule" in block]
    numbers = [
        [float(n) for n in re.findall(r"(?<![\w.])\d+(?:\.\d+)?", block.split(r"\midrule")[-1])] for block in blocks
    ]
    flat = lambda table: [v for parts in table.values() for part in parts for v in part]  # noqa: E731
    one, two, three, four, five, six = numbers
    assert one == flat({name: paper.MAPS[name] for name in ("centralized", "distributed", "limited", "single")})
    assert two == [float(paper.EXCHANGE[name][k]) for name in ("distributed", "limited") for k in (1, 0)]
    assert [n for n in three if n != 4] == [v for counts, size in paper.GROWTH[2] for v in (*counts, size)]
    assert four == flat(paper.PATHS)
    assert five == [v for counts, size in paper.GROWTH[5] for v in (*counts, size)]
    assert six == [v for size, shared in paper.TEAMS.items() for v in (size, *shared)]


def test_our_formulas_give_the_papers_sizes():
    for rows in paper.GROWTH.values():
        for counts, printed in rows:
            assert messages.centralized_bytes(counts) / 2**20 == pytest.approx(printed, abs=0.1)
            assert messages.centralized_bytes(counts) / 1e6 > printed + 0.1  # its MB are MiB
    for size, (_, limited) in paper.TEAMS.items():
        formula = size * (size - 1) * 25e3 / 1e6
        assert messages.limited_sharing_bytes(size) / 1e6 == formula
        assert (formula == pytest.approx(limited)) == (size != 10)


def test_the_papers_rows_stand_beside_what_our_formula_gives():
    two, five = communication.growth_tables([made_up(3, [])])[0], communication.growth_tables([made_up(3, [])])[-1]
    assert cells(two, "paper, step 4") == ("paper, step 4", "190,716", "189,123", "20.29", "–", "20.28")
    assert cells(five, "paper, step 1")[1:] == ("56,741", "51,055", "30,174", "50,368", "22,909", "11.28", "–", "11.19")
    six = communication.team_tables([made_up(3, [])])[0]
    assert cells(six, "10 robots")[-3:] == ("2.25", "16.84", "2.150")
    assert any("for ten robots: 2.150 where that is 2.25" in note for note in six.notes)


# ---- episodes in results.json ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["centralized", "limited", "distributed"])
def test_an_episode_is_told_cycle_by_cycle(records, name):
    record = records[name]
    entry = study.episode_of(record)
    assert entry.cycles == len(record.cycles) == 3
    assert entry.splats[-1] == tuple(robot.splats for robot in record.cycles[-1].robots)
    assert sum(entry.bytes_by_cycle) == record.ledger.total() > 0
    assert sum(entry.bytes_paper_by_cycle) == record.ledger.paper_total(name)
    second = [row for key, row in record.ledger.rows.items() if key[4] == 1]
    assert entry.bytes_by_cycle[1] == sum(n_bytes for _, n_bytes in second)
    assert sum(count for count, _ in entry.messages.values()) == record.ledger.messages()
    assert {kind: n for kind, (_, n) in entry.messages.items()} == record.ledger.by_kind()
    spent = sum(sum(log.to_json()["seconds"].values()) for log in record.cycles)
    assert sum(entry.seconds.values()) == pytest.approx(spent)


def test_one_uplink_grows_with_the_maps_as_the_messages_do(records):
    """Whole maps on the wire: as many bytes more from cycle to cycle as there are splats more."""
    entry = study.episode_of(records["centralized"])
    each = [sum(counts) for counts in entry.splats]
    sent = entry.bytes_paper_by_cycle
    per_splat = np.diff(sent) / np.diff(each)
    wire = (40 + 4 + 9 * 4) * 4 / 3  # the splat, its id, its prior, in base64
    np.testing.assert_allclose(per_splat, wire, rtol=0.02)
    assert messages.centralized_bytes(entry.splats[-1], 2) == 40 * each[-1] < sent[-1]


def test_results_without_episodes_still_load_and_say_what_to_do(results, tmp_path):
    old = {key: value for key, value in results.to_json().items() if key != "episodes"}
    (tmp_path / "results.json").write_text(json.dumps(old))
    (merged,), _ = study.gather([tmp_path])
    assert merged.episodes == ()
    for table in (
        communication.growth_table(merged),
        communication.time_table(merged),
        communication.exchange_table(merged),
    ):
        assert table.rows == ()
        assert any("run the same compare again" in note for note in table.notes)
    study.save(results, tmp_path / "results.json")
    assert study.gather([tmp_path])[0][0].episodes == results.episodes


GOOD = log("centralized", [[1, 2], [3, 4]], [10, 20])


@pytest.mark.parametrize(
    "change",
    [
        {"strategy": 3},
        {"seed": -1},
        {"cycles": 3},
        {"splats": [[1, 2]]},
        {"splats": [[1, 2], [3]]},
        {"splats": [[1, 2], [3, "4"]]},
        {"guests": None},
        {"bytes_by_cycle": [10, -20]},
        {"bytes_by_cycle": [10, True]},
        {"bytes_paper_by_cycle": [10, 10**20]},
        {"messages": {"Splats": [0, 3]}},
        {"messages": []},
        {"seconds": {"map": "long"}},
        {"seconds": None},
    ],
)
def test_bad_episodes_are_refused(tmp_path, change):
    path = tmp_path / "results.json"
    good, entry = made_up(2, [GOOD]).to_json(), GOOD.to_json()
    path.write_text(json.dumps(good))
    assert study.load(path).episodes == (GOOD,)
    for wrong in ([entry | change], entry, [3]):
        path.write_text(json.dumps(good | {"episodes": wrong}))
        with pytest.raises(study.StudyError, match=r"no results of compare .*episode.*; run the same compare again"):
            study.gather([path])


def test_run_files_are_those_beside_the_results(tmp_path):
    runs = [study.run_file(tmp_path, name, 0) for name in ("distributed", "single")]
    runs[0].parent.mkdir()
    for file in runs:
        file.write_bytes(b"")
    for paths in ([tmp_path], [tmp_path / "results.json"], [tmp_path / "runs"], runs, [tmp_path, *runs]):
        assert study.run_files(paths) == runs


# ---- the tables -----------------------------------------------------------------------------------------------------


def test_growth_shows_five_cycles_the_last_among_them():
    counts = [[100 * c, 7 * c] for c in range(1, 10)]
    table = communication.growth_table(made_up(2, [log("centralized", counts, [1_000_000 * c for c in range(1, 10)])]))
    assert [row[0] for row in table.rows] == ["cycle 1", "cycle 3", "cycle 5", "cycle 7", "cycle 9"]
    assert cells(table, "cycle 9")[1:] == ("900", "63", f"{963 * 56 / 2**20:.4f}", "9.00", "–")
    assert "the paper's Table III" in table.title
    plane = communication.growth_table(made_up(2, [log("centralized", counts, [0] * 9)], dim=2))
    assert cells(plane, "cycle 9")[3:5] == (f"{963 * 40 / 2**20:.4f}", "0")
    assert "Tables III and V" in communication.growth_table(made_up(3, [])).title
    lonely = communication.growth_table(made_up(2, [log("limited", counts, [0] * 9)]))
    assert "No centralized run here" in lonely.notes[0]


def test_both_growth_tables_are_there_and_say_what_to_run():
    tables = communication.growth_tables([made_up(5, [log("centralized", [[9] * 5], [1])])])
    assert [table.name for table in tables] == ["table3-growth-2-robots", "table5-growth-hall-3d-5-robots"]
    assert tables[0].notes[0] == "Of ours: compare hall --dim 3 --robots 2 --out DIR; then tables on all folders."
    assert len(tables[0].paper) == 4
    assert len(tables[1].paper) == 2


def test_team_sizes_are_compared_at_the_same_cycle():
    def team(n, cycles):
        central = log("centralized", [[1000 * c] * n for c in range(1, cycles + 1)], [0] * cycles)
        limited = log("limited", [[1] * n] * cycles, [0] * cycles, [10_000 * n * c for c in range(1, cycles + 1)])
        return made_up(n, [central, limited])

    (table,) = communication.team_tables([team(5, 9), team(2, 6)])  # half of six cycles: the third
    assert cells(table, "2 robots")[1:5] == ("6,000", f"{6000 * 56 / 2**20:.3f}", "0.0600", "0.0500")
    assert cells(table, "5 robots")[1:5] == ("15,000", f"{15000 * 56 / 2**20:.3f}", "0.150", "0.500")
    assert cells(table, "7 robots")[1:4] == ("–", "–", "–")
    assert table.notes[0] == "Planning cycle 3 of every run (its first seed), half way through the shortest."
    assert "--robots N --out DIR for N = 7, 10" in table.notes[-1]
    elsewhere = dataclasses.replace(team(2, 6), scene="attic")
    assert len(communication.team_tables([team(5, 9), elsewhere])) == 2


def test_messages_have_the_mean_size_that_the_ledger_says(results, records):
    table = communication.exchange_table(results)
    rows = records["distributed"].ledger.rows
    plans = [row for key, row in rows.items() if key[3] == "Plan"]
    count, size = np.sum(plans, axis=0)
    (row,) = (row for row in table.rows if row[:2] == ("distributed", "plan"))
    assert row[2:4] == (f"{count}", f"{size / count:,.0f}")
    assert ("paper, distributed", "17 float64", "–", "136", "–") in table.paper


def test_seconds_are_the_mean_of_a_cycle():
    episodes = [
        log("limited", [[1, 1]] * 3, [0] * 3, seconds={"map": 6.0, "plan": 0.3}),
        log("limited", [[1, 1]], [0], seconds={"map": 2.0, "plan": 0.1}, seed=1),
    ]
    table = communication.time_table(made_up(2, episodes))
    assert table.rows == (("limited", "4", "2.00", "0.100", "2.10"),)


def test_the_order_of_strategies_is_ours_and_the_papers():
    assert quality.order({"a": 1.0, "b": 3.0, "c": 2.0}, SCORES["psnr_db"]) == "b > c > a"
    assert quality.order({"a": 1.0, "b": 3.0, "c": 2.0}, SCORES["depth_mae_m"]) == "a > c > b"
    assert quality.order({"a": 1.004, "b": 1.001}, SCORES["psnr_db"]) == "a = b"
    tables = quality.tables_beside([made_up(2, [], psnr_db=18.0)])
    maps, paths, mine, theirs = tables
    assert "By PSNR, best first: ours centralized = limited;" in maps.notes
    means = {name: np.mean([scores[1] for scores in parts]) for name, parts in paper.MAPS.items()}
    best = sorted(means, key=means.get, reverse=True)
    assert f"  the paper's mean of four buildings {' > '.join(best)}." in maps.notes
    assert "By path overhead, best first: ours none;" in paths.notes
    assert "Orders of means: one seed tells little." in maps.notes
    assert ("Ribera", "single", "0.57", "14.65", "0.42") in mine.rows
    assert ("Cantwell", "limited", "29.8", "13.3") in theirs.rows
    assert "other buildings, another simulator and camera" in mine.title


def test_all_six_are_told_in_the_papers_order(results):
    tables = report.paper_tables([results])
    numbers = [table.name[:6] for table in tables]
    assert numbers == sorted(numbers)
    assert set(numbers) == {*(f"table{k}" for k in range(1, 7)), "time-f"}
    for table in tables:
        assert max(map(len, report.as_text(table).splitlines())) <= 120


# ---- files ----------------------------------------------------------------------------------------------------------


def test_every_table_is_a_csv_that_parses_and_latex_that_balances(results, tmp_path):
    tables = report.paper_tables([results, dataclasses.replace(results, scene="50 %_&_{a}\\#")])
    files = report.write(tables, tmp_path / "new")
    assert len(set(files)) == 3 * len(tables)
    for table, (text, tex, comma) in zip(tables, zip(*[iter(files)] * 3, strict=True), strict=True):
        assert text.read_text(encoding="utf-8") == report.as_text(table) + "\n"
        head, *rows = csv.reader(io.StringIO(comma.read_text(encoding="utf-8")))
        assert len(rows) == len(table.rows) + len(table.paper)
        assert len(set(head)) == len(head)
        assert {len(row) for row in rows} == {len(head)}
        source = tex.read_text(encoding="utf-8")
        bare = re.sub(r"\\[\\{}%&#_$]", "", source.replace(r"\textbackslash{}", ""))
        assert bare.count("{") == bare.count("}")
        assert bare.count("$") % 2 == 0
        assert "$$" not in bare
        assert source.isascii()
        lines = [line for line in source.splitlines() if line.endswith(r"\\")]
        assert {len(re.findall(r"(?<!\\)&", line)) for line in lines} == {len(table.heads) - 1}


def test_csv_cells_are_plain_numbers():
    table = report.Table(
        "t", (("", "who"), ("far", "[m]"), ("sent", "[KB]")), (("a", "1.5 ± 0.2", "1,234"), ("b", "2.0", "–"))
    )
    assert report.table_csv(table) == "who,far [m],± far [m],sent [KB]\na,1.5,0.2,1234\nb,2.0,,\n"


def test_numbers_have_three_digits():
    values = [0.0, 0.000123, 0.0483, 0.999, 1.0, 12.34, 999.6, 12345.6]
    assert [report.digits(v) for v in values] == ["0", "0.00012", "0.0483", "0.999", "1.00", "12.3", "1,000", "12,346"]


def test_tables_of_one_name_do_not_overwrite_each_other(tmp_path):
    one, other = (report.Table("t", (("", "x"),), ((word,),), name="same") for word in ("one", "other"))
    files = report.write([one, other], tmp_path)
    assert [file.name for file in files[::3]] == ["same.txt", "same-2.txt"]
    assert "other" in files[3].read_text()
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        report.write([one], tmp_path / "file")
