import dataclasses
import json
import os
import signal
import subprocess
import sys
import time

import pytest

from mannbv import episode, world
from mannbv.__main__ import main
from mannbv.lab import study

QUICK = ["--robots", "2", "--set", "max_cycles=2", "--set", "fit_steps=4", "--set", "image_width=32", "--workers", "0"]


def command(*words) -> list[str]:
    return ["compare", "flat", "--strategies", "single", *QUICK, *map(str, words)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where a small comparison has been written."""
    out = tmp_path_factory.mktemp("main") / "out"
    assert main(command("--strategies", "distributed,single", "--out", out)) == 0
    return out


def test_compare_prints_the_tables_and_writes_figure_and_results(tmp_path, capsys):
    out = tmp_path / "out"
    assert main(command("--out", out)) == 0
    said = capsys.readouterr()
    for title in ("Map quality and risk: flat", "Path and risk: flat", "Bytes per robot: flat", "Bytes of the team"):
        assert title in said.out
    assert f"Figure:  {out / 'figure.png'}" in said.out
    assert (out / "figure.png").read_bytes().startswith(b"\x89PNG")
    results = json.loads((out / "results.json").read_text())
    assert results["config"]["max_cycles"] == 2
    assert len(results["rows"]) == 2
    assert said.err == "single, seed 0: 0/2 robots at their goals, 2 cycles, 1/1 episodes\n"


def test_the_same_command_again_runs_nothing_and_says_the_same(folder, capsys):
    before = {path: path.stat().st_mtime_ns for path in (folder / "runs").iterdir()}
    capsys.readouterr()
    assert main(command("--strategies", "single,distributed", "--out", folder)) == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert "distributed" in said.out
    assert {path: path.stat().st_mtime_ns for path in (folder / "runs").iterdir()} == before


def test_tables_reads_what_compare_wrote(folder, capsys):
    main(command("--strategies", "single,distributed", "--out", folder))
    printed = capsys.readouterr().out.split("Figure:")[0].strip().split("\n\n")
    assert main(["tables", str(folder)]) == 0
    written = capsys.readouterr().out
    own = [[line for line in table.splitlines() if line.startswith(("single ", "distributed "))] for table in printed]
    assert len(own) == 4
    for line in (line for table in own for line in table):  # the paper's tables hold what compare prints, and more
        assert line in written.splitlines()
    for title in ("Growth of the shared maps", "Shared data against team size", "Seconds of a planning cycle"):
        assert title in written
    assert "--robots N --out DIR for N = 2, 5, 7, 10" in written  # neither centralized nor limited is there
    runs = [str(path) for path in (folder / "runs").glob("*.npz")]
    assert main(["tables", *runs]) == 0
    assert capsys.readouterr().out == written
    assert main(["tables", str(folder), "--format", "csv"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 5
    assert main(["tables", str(folder), "--format", "latex"]) == 0
    assert capsys.readouterr().out.count(r"\begin{table}") == written.count("\n\n") + 1


def test_tables_writes_files_and_figures_and_says_what_it_cannot_draw(folder, tmp_path, capsys):
    out = tmp_path / "paper"
    assert main(["tables", str(folder), "--out", str(out)]) == 0
    said = capsys.readouterr()
    printed = said.out.strip().split("\n\n")
    assert sorted(printed) == sorted(file.read_text().strip() for file in out.glob("*.txt"))
    assert len(list(out.glob("*.tex"))) == len(list(out.glob("*.csv"))) == len(printed)
    assert [file.name for file in sorted(out.glob("figure*"))] == [
        "figure1-overview-flat-2d.png",
        "figure1-overview-flat-2d.svg",
    ]
    lines = said.err.splitlines()
    assert f"{len(list(out.iterdir()))} files in {out}" in lines[0]
    assert [line.split("-")[0] for line in lines[1:]] == [f"mannbv: figure{k}" for k in (2, 3, 4, 5)]
    assert "no robot suggests a view" in lines[1]  # two cycles are too few for it
    assert all("add them with compare" in line for line in lines[2:])
    lonely = tmp_path / "results.json"
    lonely.write_bytes((folder / "results.json").read_bytes())
    assert main(["tables", str(lonely), "--out", str(out)]) == 0
    assert "mannbv: no figures: they need the runs (.npz) beside results.json" in capsys.readouterr().err
    assert main(["tables", str(lonely), "--out", str(lonely)]) == 2


def test_tables_leaves_an_unfinished_run_out_and_says_so(folder, tmp_path, capsys):
    record = episode.load(study.run_file(folder, "single", 0))
    half = dataclasses.replace(record, finished=False, rows=())
    half.save(tmp_path / "half.npz")
    assert main(["tables", str(folder), str(tmp_path / "half.npz")]) == 0
    assert capsys.readouterr().err == f"mannbv: {tmp_path / 'half.npz'}: not finished (2 cycles so far), left out\n"


def test_scenes_are_a_line_each(capsys):
    assert main(["scenes"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [scene.name for scene in world.scenes()]
    assert all("m²" in line for line in lines)


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from mannbv.__main__ import main; code = main(['compare', '--help']);"
        "print([name for name in ('torch', 'numba', 'matplotlib', 'scipy', 'numpy') if name in sys.modules], code)"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert said.splitlines()[-1] == "[] 0"
    assert "--preset" in said


BAD = [
    ([], "COMMAND"),
    (["dance"], "invalid choice: 'dance'"),
    (["compare"], "SCENE"),
    (["compare", "atlantis"], "atlantis: no such scene; give one of flat,"),
    (["compare", "flat", "--up", "y"], "--up is for meshes and PointNav episodes; leave it out"),
    (["compare", "flat", "--dim", "4"], "invalid choice: 4"),
    (["compare", "flat", "--robots", "0"], "--robots must be at least 1, got 0"),
    (["compare", "flat", "--robots", "many"], "invalid int value: 'many'"),
    (["compare", "flat", "--robots", "99"], "99 robots, but only"),
    (["compare", "flat", "--seeds", "0"], "--seeds must be at least 1, got 0"),
    (["compare", "flat", "--workers", "-1"], "--workers must be at least 0, got -1"),
    (
        ["compare", "flat", "--strategies", "single,psychic"],
        "no strategy is called 'psychic'; choose one of centralized,",
    ),
    (["compare", "flat", "--strategies", ""], "no strategy is called ''"),
    (["compare", "flat", "--preset", "luxury"], "invalid choice: 'luxury'"),
    (["compare", "flat", "--set", "level=0"], "level must lie strictly between 0 and 1"),
    (["compare", "flat", "--set", "level=1"], "level must lie strictly between 0 and 1"),
    (["compare", "flat", "--set", "level=nan"], "level must be finite"),
    (["compare", "flat", "--set", "level=high"], "level is a number, such as 0.1"),
    (["compare", "flat", "--set", "rounds=2.5"], "rounds is a whole number, such as 30"),
    (["compare", "flat", "--set", "courage=1"], "--set courage=1: give NAME=VALUE with a constant's name"),
    (["compare", "flat", "--set", "penality=1"], "give NAME=VALUE with a constant's name, did you mean penalty?"),
    (["compare", "flat", "--set", "level"], "give NAME=VALUE with a constant's name, such as --set level=0.05"),
    (["compare", "flat", "--set", "replace=1"], "give NAME=VALUE with a constant's name"),
    (["compare", "flat", "--set", "solver=dice"], "no solver is called 'dice'; choose one of cadmm,"),
    (["compare", "flat", "--set", "network=hairnet"], "no network is called 'hairnet'; choose one of complete,"),
    (["compare", "flat", "--set", "measure=tape"], "no measure is called 'tape'; choose one of avar,"),
    (["compare", "flat", "--set", "cell=1e-6"], "flat: 9.76 × 7.36 m is too large for a grid of 1e-06 m cells"),
    (["compare", "flat", "--seeds", "99999999999999"], "not enough memory; ask for fewer seeds"),
    (["compare", "flat", "--set", "robot_radius=3"], "for a robot of radius 3 m"),
    (["tables"], "RUN"),
    (["tables", "nowhere"], "nowhere: no such file or folder"),
]


@pytest.mark.parametrize(("words", "says"), BAD, ids=lambda part: " ".join(part) if isinstance(part, list) else "")
def test_bad_input_is_one_line_and_status_2(words, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    one_line(capsys.readouterr(), says)
    assert not list(tmp_path.rglob("*.npz"))


def one_line(said, text: str) -> None:
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert said.err.startswith("mannbv: ")
    assert said.err.endswith("\n")
    assert text in said.err


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("plan.json", "{", "plan.json"),
        ("plan.json", '{"format": "mannbv plan 1"}', "plan.json"),
        ("map.yaml", "image: none.png\nresolution: 0.05\norigin: [0, 0, 0]\n", "none.png"),
        ("house.glb", "glTF", "house.glb: not a complete .glb file; export or download it again"),
    ],
)
def test_a_bad_scene_file_is_named(name, content, says, tmp_path, capsys):
    (tmp_path / name).write_text(content)
    assert main(["compare", str(tmp_path / name), "--out", str(tmp_path / "out")]) == 2
    one_line(capsys.readouterr(), says)


def test_a_start_in_a_wall_and_an_unreachable_goal_are_named(tmp_path, capsys):
    plan = json.loads((world.library.folder() / "flat.json").read_text())
    for key, place in (("starts", [0.05, 0.05, 0.0]), ("goals", [-5.0, 0.0])):
        (tmp_path / "plan.json").write_text(json.dumps(plan | {key: [place, *plan[key][1:]]}))
        assert main(["compare", str(tmp_path / "plan.json"), "--out", str(tmp_path / "out")]) == 2
        one_line(capsys.readouterr(), f"{key}[0] at")


def test_a_scene_cannot_choose_a_folder_elsewhere(tmp_path, monkeypatch, capsys):
    plan = json.loads((world.library.folder() / "flat.json").read_text()) | {"name": "a/../../../b"}
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "plan.json").write_text(json.dumps(plan))
    monkeypatch.chdir(tmp_path / "here")
    assert main(["compare", "plan.json", "--strategies", "single", *QUICK, "--robots", "1"]) == 0
    assert (tmp_path / "here" / "out" / "compare-b" / "results.json").is_file()
    assert [path.name for path in tmp_path.iterdir()] == ["here"]


def test_a_place_that_cannot_be_written_is_named(tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert main(command("--out", tmp_path / "file" / "deeper")) == 2
    one_line(capsys.readouterr(), "cannot be written (Not a directory); choose another --out")
    assert (tmp_path / "file").read_text() == "in the way"


def test_another_comparison_in_the_folder_is_named_and_left_alone(folder, capsys):
    before = (folder / "results.json").read_bytes()
    capsys.readouterr()
    assert main(["compare", "openplan", *QUICK, "--out", str(folder)]) == 2
    one_line(capsys.readouterr(), "holds another comparison (scene flat, not openplan); choose another --out")
    assert main(command("--set", "level=0.2", "--out", folder)) == 2
    one_line(capsys.readouterr(), "(level 0.1, not 0.2)")
    assert (folder / "results.json").read_bytes() == before


def test_a_damaged_file_is_named(folder, tmp_path, capsys):
    for name, damage in (("a.npz", b"PK\x03\x04 no archive"), ("results.json", b'{"rows": NaN}')):
        (tmp_path / name).write_bytes(damage)
        assert main(["tables", str(tmp_path / name)]) == 2
        one_line(capsys.readouterr(), name)
    whole = study.run_file(folder, "single", 0).read_bytes()
    (tmp_path / "cut.npz").write_bytes(whole[: len(whole) // 2])
    assert main(["tables", str(tmp_path / "cut.npz")]) == 2
    one_line(capsys.readouterr(), "cut.npz: not a whole record")


def test_failed_episodes_end_in_one_line_below_the_tables(tmp_path, monkeypatch, capsys):
    run = episode.run

    def unlucky(place, strategy, *rest):
        if strategy == "single":
            raise ValueError("single: lost its way")
        return run(place, strategy, *rest)

    monkeypatch.setattr(episode, "run", unlucky)
    assert main(command("--strategies", "distributed,single", "--out", tmp_path)) == 2
    said = capsys.readouterr()
    assert said.err.splitlines()[-1] == "mannbv: compare: 1 of 2 episodes failed: single, seed 0: single: lost its way"
    assert "Map quality and risk" in said.out
    assert (tmp_path / "figure.png").exists()
    assert main(command("--out", tmp_path / "none")) == 2  # not one episode is left for a table
    assert "Map quality" not in capsys.readouterr().out


def test_what_nobody_foresaw_is_still_one_line(monkeypatch, capsys):
    def fail():
        raise KeyError("lamp")

    monkeypatch.setattr(world, "scenes", fail)
    monkeypatch.delenv("MANNBV_DEBUG", raising=False)
    assert main(["scenes"]) == 2
    one_line(capsys.readouterr(), "a fault in mannbv itself (KeyError: 'lamp')")
    monkeypatch.setenv("MANNBV_DEBUG", "1")
    with pytest.raises(KeyError):
        main(["scenes"])


def test_ctrl_c_stops_the_workers_and_says_how_to_go_on(tmp_path):
    words = [sys.executable, "-m", "mannbv", *command("--workers", "2", "--set", "max_cycles=60", "--out", tmp_path)]
    process = subprocess.Popen(words, start_new_session=True, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    file, ends = study.run_file(tmp_path, "single", 0), time.monotonic() + 60
    while not file.exists():
        assert time.monotonic() < ends, "nothing happened"
        time.sleep(0.005)
    os.killpg(process.pid, signal.SIGINT)  # a terminal's Ctrl-C reaches the workers too
    out, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert out == ""
    assert err == "mannbv: stopped; the same command resumes\n"
    left = file.read_bytes()
    assert not episode.load(file).finished
    time.sleep(1.0)
    assert file.read_bytes() == left  # nobody goes on


def test_a_reader_who_leaves_is_no_error():
    words = f"{sys.executable} -m mannbv scenes | true"
    done = subprocess.run(["bash", "-c", f"set -o pipefail; {words}"], capture_output=True, text=True, check=False)
    assert done.stderr == ""


def test_presets_differ_in_the_images_only():
    from mannbv.commands.compare import _config
    from mannbv.config import SPACE, Config

    assert _config(2, "quick", []) == Config()
    assert _config(2, "paper", []) == Config(image_width=800, image_height=800)
    assert _config(2, "paper", ["image_width=400", "solver = own", "level=0.3"]) == Config(
        image_width=400, image_height=800, solver="own", level=0.3
    )
    quick, paper = _config(3, "quick", []), _config(3, "paper", [])
    assert quick.replace(image_width=800, image_height=800, insert_spacing=6) == paper
    assert quick.risk_opacity == SPACE.risk_opacity and quick.share_scale == SPACE.share_scale
