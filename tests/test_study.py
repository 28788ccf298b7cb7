import csv
import dataclasses
import io
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
import torch
from helpers import at_goal
from scipy import stats

from mannbv import consensus, episode, risk, team, world
from mannbv.config import Config
from mannbv.lab import report, study
from mannbv.lab.study import workers
from mannbv.metrics import Row

TINY = Config(max_cycles=2, fit_steps=4, image_width=32)
NAMES = ["distributed", "single"]
# what design promises of each row
COLUMNS = {
    "strategy", "seed", "robot", "reached", "cycles", "path_length_m", "path_overhead", "total_risk_m",
    "total_risk_true_m", "risk_gain_m", "psnr_db", "depth_mae_m", "bytes_sent", "bytes_received", "collisions",
    "min_clearance_m", "spl", "coverage", "seconds", "fate",
}  # fmt: skip


def compare(out, strategies=NAMES, seeds=1, config=TINY, workers=0, **options):
    return study.compare("flat", strategies, seeds, 2, config, out, workers, **options)


def read(folder) -> dict:
    def refuse(constant):
        raise AssertionError(f"{constant} in results.json")

    return json.loads((folder / "results.json").read_text(), parse_constant=refuse)


def timeless(results: dict) -> dict:
    """The content of a results.json without what a clock has written."""
    results = json.loads(json.dumps(results))
    for part in [*results["rows"], *results["summary"].values(), *results["episodes"]]:
        part.pop("seconds")
    return results


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A small comparison in this process, over two seeds."""
    return compare(tmp_path_factory.mktemp("study"), seeds=2)


@pytest.fixture
def registry():
    """What a test registers is gone after it."""
    before = dict(team.REGISTRY)
    yield
    team.REGISTRY.clear()
    team.REGISTRY.update(before)


# ---- results.json -------------------------------------------------------------------------------------------------


def test_results_have_the_promised_form(done):
    results = read(done.folder)
    assert list(results) == ["mannbv", "scene", "dim", "robots", "seeds", "config", "rows", "summary", "episodes"]
    assert (results["scene"], results["dim"], results["robots"], results["seeds"]) == ("flat", 2, 2, [0, 1])
    assert Config(**results["config"]) == TINY
    asked = [(name, seed, robot) for name in NAMES for seed in (0, 1) for robot in (0, 1)]
    assert [(row["strategy"], row["seed"], row["robot"]) for row in results["rows"]] == asked
    for row in results["rows"]:
        assert set(row) >= COLUMNS
        assert row["path_overhead"] is None  # two cycles reach no goal: null, not NaN
        assert row["fate"].startswith("2 cycles were not enough")
    assert set(results["summary"]) == set(NAMES)
    entry = results["summary"]["single"]["psnr_db"]
    assert set(entry) == {"mean", "interval"}
    assert entry["interval"][0] < entry["mean"] < entry["interval"][1]
    assert done.failures == ()
    assert study.load(done.folder / "results.json") == done.results
    assert done.results.to_json() == results


def test_bytes_by_kind_and_by_the_papers_count_add_up(done):
    for name in NAMES:
        for seed in (0, 1):
            rows = [row for row in done.results.of(name) if row.seed == seed]
            ledger = done.record(name, seed).ledger
            for row in rows:
                kinds = row.bytes_plan, row.bytes_suggestion, row.bytes_copies, row.bytes_profile
                kinds += row.bytes_splats, row.bytes_grid
                assert sum(kinds) == row.bytes_sent == ledger.sent_by(row.robot)
            assert sum(row.bytes_received for row in rows) == sum(row.bytes_sent for row in rows) == ledger.total()
            assert sum(row.bytes_paper for row in rows) == ledger.paper_total(name)
    assert sum(row.bytes_sent for row in done.results.of("single")) == 0


def test_the_papers_count_splits_by_the_robot_that_a_message_came_from_first():
    config = TINY.replace(network="line", max_cycles=1)  # three in a line: maps and splats are relayed
    for name in ("centralized", "limited"):
        record = episode.run("flat", name, config, 0, 3)
        assert sum(row.bytes_paper for row in record.rows) == record.ledger.paper_total(name) > 0


def test_the_same_call_gives_the_same_file_but_for_seconds_also_in_other_processes(done, tmp_path):
    again = compare(tmp_path / "again", seeds=2, workers=2)
    assert timeless(read(again.folder)) == timeless(read(done.folder))
    wrong = compare(tmp_path / "other", ["single"], seeds=[1], config=TINY.replace(fit_steps=3))
    mine = [row for row in timeless(read(done.folder))["rows"] if (row["strategy"], row["seed"]) == ("single", 1)]
    assert len(mine) == 2 and timeless(read(wrong.folder))["rows"] != mine


def test_what_is_finished_is_kept_and_more_seeds_join(tmp_path):
    first = compare(tmp_path, ["single"])
    file = study.run_file(tmp_path, "single", 0)
    before = file.stat().st_mtime_ns
    (file.parent / ".single-1.npz.123.tmp").write_bytes(b"half")  # what a killed run was writing
    updates = []
    more = compare(tmp_path, ["single"], seeds=2, progress=updates.append)
    assert file.stat().st_mtime_ns == before
    assert not list(file.parent.glob(".*.tmp"))
    assert {key for progress in updates for key in progress.episodes} == {("single", 1)}
    assert more.results.seeds == (0, 1)
    assert more.results.rows[:2] == first.results.rows


def test_a_run_killed_at_some_cycle_resumes_to_the_same(tmp_path):
    config = {"max_cycles": 8, "fit_steps": 4, "image_width": 32}
    whole = compare(tmp_path / "whole", ["distributed"], config=Config(**config))
    file = study.run_file(tmp_path / "killed", "distributed", 0)
    changes = [word for name, value in config.items() for word in ("--set", f"{name}={value}")]
    command = [sys.executable, "-m", "mannbv", "compare", "flat", "--robots", "2", "--strategies", "distributed"]
    command += [*changes, "--out", str(tmp_path / "killed")]
    process = subprocess.Popen(command, start_new_session=True, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    until(file.exists)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    cut = episode.load(file)
    assert not cut.finished
    assert 0 < len(cut.cycles) < 8
    resumed = compare(tmp_path / "killed", ["distributed"], config=Config(**config))
    assert timeless(read(resumed.folder)) == timeless(read(whole.folder))


def until(condition, limit=60.0):
    """Wait for what another process does."""
    ends = time.monotonic() + limit
    while not condition():
        assert time.monotonic() < ends, "nothing happened"
        time.sleep(0.005)


def test_a_worker_leaves_at_the_next_cycle_when_its_parent_is_gone(tmp_path):
    place = world.load("flat")
    job = workers.Job(place, "single", 0, 2, TINY.replace(max_cycles=50), study.run_file(tmp_path, "single", 0))
    ours, theirs = multiprocessing.Pipe()
    ours.send_bytes(workers._packed(job))
    ours.close()
    handler, threads = signal.getsignal(signal.SIGINT), torch.get_num_threads()
    try:
        with warnings.catch_warnings():
            workers._work(theirs)  # returns
    finally:
        signal.signal(signal.SIGINT, handler)
        torch.set_num_threads(threads)
    assert len(episode.load(job.path).cycles) == 1


# ---- failures -----------------------------------------------------------------------------------------------------


def break_down(robot, mission):
    raise KeyError("the third wheel")


def vanish(robot, mission):
    os._exit(7)


def give_up(robot, mission):
    raise ValueError("nothing\nto say")


def test_a_failing_episode_is_named_and_costs_no_other(tmp_path, registry):
    team.register("wrong", break_down, team.serve_own)
    team.register("sorry", give_up, team.serve_own)
    outcome = compare(tmp_path, ["wrong", "single", "sorry"])
    wrong, sorry = outcome.failures
    assert wrong.startswith("wrong, seed 0: KeyError: 'the third wheel' (traceback in ")
    assert sorry == "sorry, seed 0: nothing to say"
    assert "break_down" in (tmp_path / "runs" / "wrong-0.error.txt").read_text()
    assert not (tmp_path / "runs" / "sorry-0.error.txt").exists()
    assert {row["strategy"] for row in read(tmp_path)["rows"]} == {"single"}


def test_a_killed_worker_costs_its_own_episode_only_and_own_strategies_reach_the_workers(tmp_path, registry):
    team.register("gone", vanish, team.serve_own)
    team.register("mine", team.announce, team.serve_own, "own")
    updates = []
    outcome = compare(tmp_path, ["gone", "mine"], workers=1, progress=updates.append)
    assert len(outcome.failures) == 1
    assert outcome.failures[0].startswith("gone, seed 0: its process was ended (exit code 7)")
    assert {row.strategy for row in outcome.results.rows} == {"mine"}
    assert updates[-1].episodes["gone", 0].fault
    assert updates[-1].episodes["mine", 0].finished
    assert updates[-1].share == 1.0


def test_a_strategy_that_no_other_process_could_find_is_refused_at_once(tmp_path, registry):
    team.register("hidden", lambda robot, mission: [], team.serve_own)
    with pytest.raises(ValueError, match=r"strategy 'hidden' cannot be sent .* or use workers=0"):
        compare(tmp_path, ["hidden"], workers=1)
    assert compare(tmp_path, ["hidden"], workers=0).failures == ()


def test_built_in_solvers_and_measures_need_no_sending():
    place = world.load("flat")
    for changes in [{"solver": name} for name in consensus.SOLVERS] + [{"measure": name} for name in risk.MEASURES]:
        job = workers.Job(place, "single", 0, 2, TINY.replace(**changes), study.run_file("x", "single", 0))
        assert workers._packed(job)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"n_robots": 3}, "2 robots, not 3"),
        ({"config": TINY.replace(level=0.2)}, "level 0.1, not 0.2"),
        ({"scene": "openplan"}, "scene flat, not openplan"),
    ],
)
def test_a_folder_that_holds_another_comparison_is_left_alone(done, options, says):
    before = {path: path.read_bytes() for path in done.folder.rglob("*") if path.is_file()}
    arguments = {"scene": "flat", "n_robots": 2, "config": TINY, "strategies": NAMES, "workers": 0} | options
    with pytest.raises(study.StudyError) as caught:
        study.compare(out=done.folder, **arguments)
    assert f"holds another comparison ({says}); choose another --out" in str(caught.value)
    assert {path: path.read_bytes() for path in done.folder.rglob("*") if path.is_file()} == before


def test_another_building_of_the_same_name_is_another_comparison(done):
    twin = dataclasses.replace(world.load("openplan"), name="flat")
    with pytest.raises(study.StudyError, match="another building called flat"):
        study.compare(twin, NAMES, 1, 2, TINY, done.folder, 0)


def test_results_without_their_runs_are_not_overwritten(tmp_path):
    (tmp_path / "results.json").write_text("precious")
    with pytest.raises(study.StudyError, match=r"holds results\.json but no runs"):
        compare(tmp_path)
    assert (tmp_path / "results.json").read_text() == "precious"


def test_a_damaged_run_is_named(tmp_path):
    compare(tmp_path, ["single"])
    file = study.run_file(tmp_path, "single", 0)
    file.write_bytes(file.read_bytes()[:1000])
    with pytest.raises(ValueError, match=r"single-0\.npz: not a whole record .* delete it"):
        compare(tmp_path, ["single"])


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"strategies": ["single", "telepathy"]}, "no strategy is called 'telepathy'; choose one of centralized"),
        ({"strategies": []}, "no strategy is given"),
        ({"seeds": 0}, "at least one seed"),
        ({"seeds": [3, -1]}, "none below 0"),
        ({"workers": -1}, "workers must be 0"),
    ],
)
def test_bad_requests_are_refused_before_any_work(tmp_path, options, says):
    with pytest.raises(ValueError, match=says):
        compare(tmp_path / "out", **options)
    assert not list(tmp_path.rglob("*.npz"))


# ---- statistics ---------------------------------------------------------------------------------------------------


def row(seed, robot, strategy="single", **values) -> Row:
    return Row(strategy, seed, robot, **{"cycles": 2} | values)


def test_the_seed_is_the_unit_of_the_interval():
    table = np.array([[1.0, 2.0, 6.0], [2.0, 2.5, 3.0], [5.0, 4.0, 9.0], [0.5, 1.0, 0.0]])  # seeds × robots
    rows = [row(s, r, psnr_db=float(v)) for s, line in enumerate(table) for r, v in enumerate(line)]
    entry = study.summarise(rows)["single"]["psnr_db"]
    assert entry.mean == pytest.approx(table.mean(), rel=1e-12)
    oracle = stats.ttest_1samp(table.mean(1), 0.0).confidence_interval(0.95)
    assert entry.interval == pytest.approx([oracle.low, oracle.high], rel=1e-12)
    pooled = stats.ttest_1samp(table.ravel(), 0.0).confidence_interval(0.95)  # robots of a team taken for independent
    assert entry.interval[0] < pooled.low - 0.5


def test_one_seed_has_no_interval_and_what_does_not_exist_is_left_out():
    rows = [row(0, 0, psnr_db=3.0, spl=None, fate="reached"), row(0, 1, psnr_db=5.0, spl=0.5, fate="reached")]
    summary = study.summarise(rows)["single"]
    assert summary["psnr_db"].to_json() == {"mean": 4.0, "interval": None}
    assert summary["spl"].to_json() == {"mean": 0.5, "interval": None}
    assert not {"fate", "seed", "robot", "strategy"} & set(summary)
    nothing = study.summarise([row(0, 0, spl=None)])["single"]
    assert "spl" not in nothing


def test_the_gain_in_percent_is_the_teams_own():
    # shortest paths at 0.01 and 0.59 m: the robots' own shares are 3900 % and 2 %, the team's 0.40 / 0.60
    rows = [
        row(0, 0, total_risk_m=0.40, risk_gain_m=0.39, total_risk_true_m=1.0, risk_gain_true_m=0.5),
        row(0, 1, total_risk_m=0.60, risk_gain_m=0.01, total_risk_true_m=None, risk_gain_true_m=None),
    ]
    summary = study.summarise(rows)["single"]
    assert summary["risk_gain_share"].mean == pytest.approx(0.40 / 0.60)
    assert summary["risk_gain_true_share"].mean == pytest.approx(1.0)
    blind = [row(0, 0, total_risk_m=-0.2, risk_gain_m=0.1)]  # no share of a negative risk
    assert "risk_gain_share" not in study.summarise(blind)["single"]


def test_bytes_a_cycle_are_those_of_the_teams_cycles():
    early = row(0, 0, cycles=1, bytes_sent=100, bytes_paper=10)  # at its goal after one of two cycles
    rows = [early, row(0, 1, bytes_sent=300, bytes_paper=30)]
    summary = study.summarise(rows)["single"]
    assert summary["sent_per_cycle_b"].mean == 100.0
    assert summary["paper_per_cycle_b"].mean == 20.0


# ---- tables -------------------------------------------------------------------------------------------------------


def small_results(seeds=(0, 1)) -> study.Results:
    rows = []
    for name, lift in (("centralized", 0.1), ("single", 0.0)):
        for seed in seeds:
            for robot in (0, 1):
                rows.append(row(
                    seed, robot, name, reached=robot == 0 or name == "centralized", collisions=robot,
                    total_risk_m=0.5 + lift + 0.02 * seed, total_risk_true_m=0.6, reference_clearance_m=0.15,
                    psnr_db=18.0, depth_mae_m=0.25, path_overhead=0.295 if robot == 0 else None,
                    risk_gain_m=0.1, risk_gain_true_m=0.2, min_clearance_m=0.3, bytes_sent=250_000,
                    bytes_received=250_000, bytes_splats=200_000, bytes_copies=50_000, bytes_plan=0,
                    bytes_paper=12_345, seconds=1.0,
                    fate="reached" if robot == 0 or name == "centralized" else "no frontier left to go to",
                ))  # fmt: skip
    return study.assemble("flat", 2, 2, Config(), rows)


def test_tables_show_the_numbers_with_intervals_and_units():
    maps, paths, each, whole = map(report.as_text, report.tables(small_results()))
    half = (0.02 / np.sqrt(2)) / np.sqrt(2) * stats.t.ppf(0.975, 1)  # two seeds, 0.02 apart
    shown = f"centralized  0.61 ± {half:.2f}  0.60 ± 0.00  0.15 ± 0.00  18.00 ± 0.00  0.25 ± 0.00"
    assert line(maps, "centralized") == shown.split()
    assert "At their goals: centralized 4/4, single 2/4." in maps
    assert "Collisions: centralized 2, single 2." in maps
    assert "  single, seed 1, robot 1: no frontier left to go to" in maps
    assert line(paths, "single")[1:4] == ["29.5", "±", "0.0"]
    share = 100 * np.mean([0.2 / 0.8, 0.2 / 0.84])  # gain over the shortest paths' risk, two robots a seed
    assert line(paths, "single")[4] == f"{share:.1f}"
    assert line(paths, "single")[-3:] == ["0.30", "±", "0.00"]
    assert line(each, "single")[1:4] == ["125", "±", "0"]  # two cycles
    assert line(each, "paper, limited")[-4:] == ["25", "25", "–", "–"]
    assert line(each, "paper, distributed")[-4:] == ["0.206", "0.028", "–", "–"]
    assert line(whole, "single")[1:] == ["500", "±", "0", "100", "400", "24.7", "±", "0.0", "12.3", "±", "0.0"]
    for text in (maps, paths, each, whole):
        assert "±: half of the 95 % interval, Student's t over the means of 2 seeds." in text
        assert max(map(len, text.splitlines())) <= 120


def line(text: str, name: str) -> list[str]:
    return next(line for line in text.splitlines() if line.startswith(name)).split()


def test_one_seed_shows_no_interval_and_names_the_measure():
    results = small_results(seeds=(3,))
    text = report.as_text(report.map_table(results))
    assert "±" not in text
    assert "flat, 2 robots, seed 3" in text
    other = report.as_text(report.map_table(dataclasses.replace(results, config={"measure": "spectral"})))
    assert "spectral ↑" in other
    assert "AV@R" not in other


def test_columns_are_aligned():
    body = report.as_text(report.map_table(small_results())).splitlines()
    rows = [line for line in body if line.startswith(("centralized", "single"))]
    assert len({len(line) for line in rows}) == 1
    assert len(body[1]) == len(rows[0])


def test_latex_is_escaped_and_whole():
    text = report.as_latex(report.path_table(small_results()))
    assert text.count(r"\begin{") == text.count(r"\end{") == 2
    assert r"29.5 $\pm$ 0.0" in text
    assert r"[\%]" in text
    assert not set("±↑↓–") & set(text)
    columns = text.split(r"\begin{tabular}{")[1].split("}")[0]
    assert all(line.count("&") == len(columns) - 1 for line in text.splitlines() if line.endswith(r"\\"))


def test_csv_holds_every_row_of_several_results():
    one, other = small_results(), dataclasses.replace(small_results(seeds=(5,)), scene="wings")
    table = list(csv.DictReader(io.StringIO(report.as_csv(one, other))))
    assert len(table) == 12
    assert float(table[0]["total_risk_m"]) == one.rows[0].total_risk_m
    assert (table[0]["spl"], table[8]["seed"], table[8]["scene"]) == ("", "5", "wings")


# ---- saved runs ---------------------------------------------------------------------------------------------------


def test_tables_come_from_a_folder_its_runs_or_its_file(done):
    files = [study.run_file(done.folder, name, seed) for name in NAMES for seed in (0, 1)]
    for paths in ([done.folder], [done.folder / "results.json"], [done.folder / "runs"], files, [done.folder, *files]):
        (results,), left_out = study.gather(paths)
        assert results == done.results
        assert left_out == []


def test_unfinished_runs_are_left_out_and_other_comparisons_stand_apart(done, tmp_path):
    half = dataclasses.replace(done.record("single"), finished=False, rows=())
    half.save(tmp_path / "half.npz")
    other = compare(tmp_path / "other", ["single"], config=TINY.replace(level=0.3))
    merged, left_out = study.gather([done.folder, tmp_path / "half.npz", other.folder])
    assert [results.config["level"] for results in merged] == [0.1, 0.3]
    assert len(left_out) == 1
    assert "half.npz: not finished (2 cycles so far)" in left_out[0]
    with pytest.raises(study.StudyError, match="not finished"):
        study.gather([tmp_path / "half.npz"])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{", "not valid JSON"),
        ("[1]", "no results of compare"),
        ('{"mannbv": 1}', "no results of compare"),
    ],
)
def test_a_bad_results_file_is_named(tmp_path, text, says):
    (tmp_path / "results.json").write_text(text)
    with pytest.raises(study.StudyError, match=says) as caught:
        study.gather([tmp_path])
    assert str(caught.value).startswith(str(tmp_path / "results.json"))


@pytest.mark.parametrize(
    "rows",
    [
        3,
        [4],
        [{"strategy": "single"}],
        [row(0, 0).to_json() | {"psnr_db": "high"}],
        [row(0, 0).to_json() | {"psnr_db": 10**400}],
        [row(0, 0).to_json() | {"charm": 1.0}],
    ],
)
def test_bad_rows_are_refused(tmp_path, rows):
    (tmp_path / "results.json").write_text(json.dumps(small_results().to_json() | {"rows": rows}))
    with pytest.raises(study.StudyError, match="rows"):
        study.gather([tmp_path / "results.json"])


@pytest.mark.parametrize(
    "change", [{"robots": "five"}, {"dim": None}, {"scene": 3}, {"config": []}, {"summary": 7}, {"seeds": 1}]
)
def test_what_is_not_compares_is_refused(tmp_path, change):
    (tmp_path / "results.json").write_text(json.dumps(small_results().to_json() | change))
    with pytest.raises(study.StudyError, match=f"no results of compare .*, {next(iter(change))} must be"):
        study.gather([tmp_path / "results.json"])


def test_folders_and_files_that_hold_nothing_are_named(tmp_path):
    for path in (tmp_path, tmp_path / "nowhere", tmp_path / "notes.txt"):
        (tmp_path / "notes.txt").write_text("hello")
        with pytest.raises(study.StudyError, match=str(path)):
            study.gather([path])


# ---- progress -----------------------------------------------------------------------------------------------------


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_progress_counts_robots_and_cycles(tmp_path):
    updates = []
    compare(tmp_path, ["single"], progress=updates.append)
    episodes = [progress.episodes["single", 0] for progress in updates]
    assert [each.cycles for each in episodes] == [1, 2, 2]
    assert [each.finished for each in episodes] == [False, False, True]
    shares = [progress.share for progress in updates]
    assert shares == sorted(shares)
    assert 0 < shares[0] < 1
    assert shares[-1] == 1


def story() -> list[study.Progress]:
    start = study.Progress(2, {("single", k): study.EpisodeProgress("single", k) for k in range(2)})
    steps = [start.updated(study.EpisodeProgress("single", 0, 3, 1, 0.5))]
    steps.append(steps[-1].updated(study.EpisodeProgress("single", 0, 6, 2, 1.0, True)))
    return [*steps, steps[-1].updated(study.EpisodeProgress("single", 1, fault="no luck"))]


def test_the_progress_bar_is_a_bar_on_a_terminal_and_a_line_an_episode_elsewhere(monkeypatch):
    clock = iter(range(0, 10_000, 100))
    monkeypatch.setattr(study.progress.time, "monotonic", lambda: next(clock))
    lines, terminal = io.StringIO(), Terminal()
    for stream in (lines, terminal):
        with study.ProgressBar(stream) as bar:
            for progress in story():
                bar(progress)
    printed = lines.getvalue().splitlines()
    assert len(printed) == 2
    assert printed[0].startswith("single, seed 0: 2/2 robots at their goals, 6 cycles, 1/2 episodes, about ")
    assert printed[1] == "single, seed 1: failed, 2/2 episodes"
    assert "robots at their goals 1/4" in terminal.getvalue()
    assert "6 cycles, 1/2 episodes" in terminal.getvalue()


def test_the_time_left_follows_from_the_share_done(monkeypatch):
    now = [1000.0]
    monkeypatch.setattr(study.progress.time, "monotonic", lambda: now[0])
    bar = study.ProgressBar(io.StringIO())
    progress = study.Progress(
        1, {("single", 0): study.EpisodeProgress("single", 0, share=0.2)}
    )  # resumed: 0.2 was there before
    bar(progress)
    assert bar.left(progress) == ""
    now[0] += 60
    assert (
        bar.left(progress.updated(study.EpisodeProgress("single", 0, share=0.5))) == "about 01:40 left"
    )  # 60 s · 0.5 / 0.3


def test_a_long_study_is_told_in_few_lines():
    stream = io.StringIO()
    progress = study.Progress(1, {("single", k): study.EpisodeProgress("single", k) for k in range(200)})
    with study.ProgressBar(stream) as bar:
        for k in range(200):
            progress = progress.updated(study.EpisodeProgress("single", k, 5, 1, 1.0, True))
            bar(progress)
    printed = stream.getvalue().splitlines()
    assert len(printed) == 20
    assert "200/200 episodes" in printed[-1]


# ---- a cycle of an episode ------------------------------------------------------------------------------------------


def test_a_snapshot_is_what_the_cycle_planned_on_the_maps_of_today(done):
    record = done.record("distributed")
    snapshot = study.snapshot(record, 1)
    for robot, seen in zip(record.robots, snapshot.robots, strict=True):
        log = record.cycles[1].robots[robot.index]
        assert seen.chosen == log.chosen
        np.testing.assert_array_equal(seen.path, log.path)
        assert {mate for mate, _, _ in seen.suggestions} <= {0, 1} - {robot.index}
        means, path = robot.local.splats.means.double().numpy(), seen.path
        away = np.linalg.norm(means[:, None] - path, axis=2)
        sigma = robot.local.splats.scales.max(1).values.double().numpy()
        tail = stats.norm.pdf(stats.norm.ppf(0.1)) / 0.1
        alpha = (away - tail * sigma[:, None]).min(0)
        radii = 0.5 + np.exp(-2.0 * alpha)
        np.testing.assert_allclose(seen.zone.radii, radii, rtol=1e-5)
        clear = (np.abs(away - radii) > 1e-4).all(1)  # none of these lies on a ball's rim
        np.testing.assert_array_equal(seen.zone.selected.numpy()[clear], (away <= radii).any(1)[clear])


def test_a_snapshots_risk_is_that_of_the_known_free_cells(done):
    record = done.record("single")
    seen = study.snapshot(record).robots[0]
    robot = record.robots[0]
    ground = seen.belief.ground  # the known part
    free = ground.log_odds < 0
    assert free.sum() == (robot.ground.log_odds < 0).sum()
    np.testing.assert_array_equal(np.isfinite(seen.risk), free)
    cell = np.argwhere(free)[17]
    center = np.array(ground.lattice.origin) + (cell + 0.5) * ground.lattice.cell
    expected = risk.field(robot.local.splats, torch.from_numpy(center[None]), 0.1)
    assert seen.risk[tuple(cell)] == pytest.approx(float(expected), abs=1e-6)


def test_a_robot_at_its_goal_plans_nothing(done):
    record = done.record("distributed")
    first, second = record.cycles
    record = dataclasses.replace(record, cycles=(first, at_goal(second, 0, suggestions=())))
    robot = study.snapshot(record, 1).robots[0]
    assert robot.path.shape == (0, 2)
    assert robot.view is None
    assert robot.zone is None
    assert study.midway(record) == 0  # only then were both under way


def test_a_snapshot_needs_a_cycle(done):
    record = done.record("single")
    with pytest.raises(ValueError, match="cycles 0 to 1, not 2"):
        study.snapshot(record, 2)
    with pytest.raises(ValueError, match="no cycle yet"):
        study.midway(dataclasses.replace(record, cycles=()))


MAPS = Path(__file__).parents[1].parent / "shared" / "scenes" / "maps"


@pytest.mark.skipif(not MAPS.is_dir(), reason="third-party scenes are not beside this checkout")
@pytest.mark.parametrize("name", ["aws_small_house/map", "nav2_depot/depot", "willow/willow-2010-02-18-0.10"])
def test_a_real_map_ends_with_its_tables(tmp_path, name):
    config = Config(image_width=32, fit_steps=4, max_cycles=1, n_subgoals=1, cell=0.1)
    outcome = study.compare(str(MAPS / f"{name}.yaml"), ["distributed", "single"], 1, 2, config, tmp_path, workers=0)
    assert not outcome.failures
    for table in report.tables(outcome.results):
        assert {row[0] for row in table.rows} >= {"distributed", "single"}
