"""The benchmarks: turns that are turns, rivals that compute the same, a report with every target. Nothing is timed."""

import json
import math

import numba
import numpy as np
import pytest
import torch
from helpers import camera_for, random_map, random_pose

from mannbv import information, risk, world
from mannbv.__main__ import main
from mannbv.lab import bench, draw
from mannbv.lab.bench import fresh, rivals, scenes, stages, suite, targets, timing

TINY = bench.Scale(
    budget=0.0, least=3, most=3, large=(300, 40), small=(200, 24), dense=(200, 20), gram=(60, 12), loop=(20, 6),
    flat=(60, 64), profile=(400, 32), field=(50, 40), memory=(50, 16), splats=(20, 40), sides=(10, 20), fresh=2,
)  # fmt: skip
# what performance.md asks for, in s, ns, B, and times: (to reach, stretch)
ASKED = {
    "sense.large": (0.6, None),
    "large.forward": (0.080, 0.060),
    "large.backward": (0.180, 0.125),
    "large.fisher": (0.250, 0.180),
    "pair.forward": (1.5, 1.5),
    "pair.backward": (2.5, 1.8),
    "pair.fisher": (4.5, 3.4),
    "small.forward": (0.0036, None),
    "small.backward": (0.007, None),
    "small.fisher": (0.009, None),
    "gram.fisher": (0.0006, None),
    "flat.fisher": (0.0005, None),
    "flat.profile": (0.002, None),
    "flat.slopes": (20.0, None),
    "space.steps": (20.0, None),
    "keyframe": (0.5, None),
    "first.warm": (1.0, None),
    "first.cold": (25.0, None),
    "memory": (4e9, None),
    "job": (60.0, 20.0),
}


class Machine:
    """A clock of work done, on a machine that becomes slower as it goes."""

    def __init__(self, slowing: float):
        self.now, self.slowing, self.order = 0.0, slowing, []

    def clock(self) -> float:
        return self.now

    def call(self, name: str, work: float):
        def run():
            self.order.append(name)
            self.now += work * (1 + self.slowing * self.now)

        return run


def test_calls_take_turns_with_equal_samples_and_every_place_in_a_round():
    machine = Machine(0.0)
    calls = [machine.call(name, work) for name, work in (("a", 1.0), ("b", 2.0), ("c", 4.0))]
    wall, cpu = bench.interleave(calls, 6, machine.clock, lambda: machine.now / 2)
    assert "".join(machine.order) == "abcbcacababcbcacab"
    assert wall == [[1.0] * 6, [2.0] * 6, [4.0] * 6]
    assert cpu == [[0.5] * 6, [1.0] * 6, [2.0] * 6]


def test_a_machine_that_slows_down_falls_on_both_sides_alike():
    """One side after the other would have read it as a difference of a factor."""
    machine = Machine(0.05)
    ours, theirs = machine.call("ours", 1.0), machine.call("theirs", 2.0)
    wall, _ = bench.interleave([ours, theirs], 40, machine.clock, machine.clock)
    assert abs(np.median(np.divide(wall[1], wall[0])) - 2.0) < 0.2
    machine = Machine(0.05)
    blocks = [bench.interleave([machine.call("", work)], 40, machine.clock, machine.clock)[0][0] for work in (1.0, 2.0)]
    assert np.median(np.divide(blocks[1], blocks[0])) > 10.0


@pytest.fixture
def elsewhere(monkeypatch):
    """Fresh processes and the main job, answered at once; returns what was asked of them."""
    asked = []

    def ask(*words, **environment):
        asked.append((words, environment))
        shares = {"torch": 0.5, "mannbv": 0.2, "render": 0.1, "backward": 0.3, "fisher": 0.4, "cpu": 0.9}
        return {"peak": 3e8} if words[0] == "memory" else shares

    monkeypatch.setattr(fresh, "ask", ask)
    monkeypatch.setattr(fresh, "_run", lambda arguments, environment: asked.append((tuple(arguments), {})))
    return asked


def test_a_run_measures_every_target_and_reports_it_in_the_agreed_form(elsewhere):
    reports, lines = [], []
    suite.run(TINY, reports.append, lambda done, stage, line: lines.append((stage, line)))
    report = json.loads(json.dumps(reports[-1], allow_nan=False))
    assert set(report) == {"mannbv", "machine", "complete", "load", "results", "targets"}
    assert report["machine"]["cpus"] >= 1 and report["load"].keys() == {"began", "now"}
    assert [r["complete"] for r in reports] == [False] * (len(reports) - 1) + [True]
    rows = {row["key"]: row for row in report["results"]}
    assert len(rows) == len(report["results"]) == len(reports) - 1
    assert sum(bool(line) for _, line in lines) == len(rows)
    assert list(dict.fromkeys(stage for stage, _ in lines)) == [*bench.STAGES, "done"]
    for row in rows.values():
        for kind in ("samples", "cpu", "ratio"):
            each = row[kind]["each"]
            low, high = row[kind]["quartiles"]
            assert not each or low <= row[kind]["median"] == np.median(each) <= high
        assert row["unit"] in ("s", "ns", "B") and row["samples"]["each"] and min(row["samples"]["each"]) >= 0
        if row["ratio"]["each"]:
            assert len(row["ratio"]["each"]) == len(row["samples"]["each"]) == TINY.least
    judged = {target["key"]: target for target in report["targets"]}
    assert {key: (t["to_reach"], t["stretch"]) for key, t in judged.items()} == ASKED
    for target in judged.values():
        assert target["measured"] is not None and isinstance(target["met"], bool)
        assert target["title"] in bench.verdict(target) and "to reach" in bench.verdict(target)
    # rivals were compared with ours before they were timed
    for key in ("dense.twin.forward", "gram.one.fisher.twin", "field.distances", "flat.slopes", "space.steps"):
        apart = [value for name, value in rows[key]["facts"].items() if name.startswith("apart")]
        assert apart and max(apart) <= 0.1
    assert set(rows["loop.one.fisher.loop"]["facts"]) >= {"apart_loop", "apart_jacrev"}
    per_pair = rows["pair.forward"]["facts"]
    assert 0 < per_pair["pairs"] <= per_pair["splats"] * 48 * 48
    for over, places in (("splats", {20, 40}), ("pixels", {100, 400})):
        own = [row["facts"] for row in rows.values() if row["facts"].get("over") == over]
        assert {(f["at"], f["stage"]) for f in own} == {(at, stage) for at in places for stage in stages.WHOLE}
    # the first warm process is not counted; the cold one has a cache of its own
    firsts = [environment for words, environment in elsewhere if words == ("first",)]
    assert firsts[:-1] == [{}] * (TINY.fresh + 1) and set(firsts[-1]) == {"NUMBA_CACHE_DIR"}
    assert rows["first.warm"]["samples"]["each"] == pytest.approx([0.8] * TINY.fresh)
    assert any("compare" in words for words, _ in elsewhere)


def test_what_differs_from_ours_is_not_timed(monkeypatch):
    honest = rivals.looped_fisher
    monkeypatch.setattr(rivals, "looped_fisher", lambda *view: 2 * honest(*view))
    monkeypatch.setitem(stages._RIVALS, "loop", ("twice as much", rivals.looped_fisher, rivals.without_turn))
    with pytest.raises(ValueError, match=r"ours and twice as much differ by 0\.5, more than 0\.1"):
        list(stages.fisher(TINY))
    with pytest.raises(ValueError, match="differ by nan"):
        stages.agree("numbers", torch.tensor([math.nan]), torch.ones(1))


@pytest.mark.parametrize("dim", [2, 3])
def test_rivals_compute_what_we_compute(dim, rng):
    splats, pose, camera = random_map(rng, 12, dim), random_pose(rng, dim), camera_for(dim, 6, 5)
    ours = rivals.without_turn(information.fisher(splats, camera, pose), dim)
    assert ours.shape == (12, 2 * dim + 4) and ours.any()
    for rival in (rivals.looped_fisher, rivals.jacrev_fisher):
        assert torch.allclose(rival(splats, camera, pose), ours, rtol=1e-9, atol=1e-9 * float(ours.max()))
    points = torch.from_numpy(rng.uniform(-3, 3, (250, dim)))
    factor = -float(risk.average_value_at_risk(0.0, 1.0, 0.1))
    assert torch.allclose(rivals.risk_field(splats, points, factor), risk.field(splats, points, 0.1))


@pytest.mark.parametrize("dim", [2, 3])
def test_the_room_is_the_same_each_time_and_stands_around_its_camera(dim):
    room = scenes.room(4000, dim)
    assert all(torch.equal(a, b) for a, b in zip(room.tensors(), scenes.room(4000, dim).tensors(), strict=True))
    assert not torch.equal(room.means, scenes.room(4000, dim, seed=1).means)
    sides = torch.tensor(scenes.SIDES[:dim])
    away = torch.minimum(room.means.abs(), (room.means - sides).abs())
    assert (away.amin(1) < 6 * 0.01).all()  # on a wall
    share = (away[:, 0] < 0.06).float().mean()
    assert abs(share - (0.5 if dim == 2 else 15 / 51)) < 0.05  # walls by their area
    camera, pose = scenes.view(64, dim)
    drawn = information.fisher(room, camera, pose).sum(1) > 0
    assert 0.1 < drawn.float().mean() < 0.9
    assert ((pose.position > 0) & (pose.position < sides)).all()


def test_a_fresh_process_measures_its_first_image_and_its_own_peak():
    first = fresh.ask("first")
    assert set(first) == {"torch", "mannbv", "render", "backward", "fisher", "cpu"}
    assert all(value > 0 for value in first.values())
    ballast = np.ones(100_000_000)  # of the asking process: no part of a child's peak
    small, large = (fresh.ask("memory", "20", size)["peak"] for size in ("16", "2400"))
    assert 5e7 < small < ballast.nbytes
    assert large - small > 5 * 4 * 2400**2  # at least one image of five channels more
    with pytest.raises(ValueError, match="bench: a fresh process failed"):
        fresh.ask("second")


def test_threads_are_as_before_afterwards():
    before = numba.get_num_threads(), torch.get_num_threads()
    with timing.threads(1) as used:
        assert (used, numba.get_num_threads(), torch.get_num_threads()) == (1, 1, 1)
    assert (numba.get_num_threads(), torch.get_num_threads()) == before


def test_results_are_printed_with_their_spread_and_suitable_units():
    result = bench.Result("k", "a thing", "s", (0.01, 0.02, 0.04), (0.01, 0.015, 0.05), (2.0, 3.0, 1500.0))
    assert str(result) == "a thing: 20 ms (15 ms to 30 ms in half of 3 rounds), CPU 15 ms, 3 times ours"
    assert [timing.with_unit(v, u) for v, u in ((2e-7, "s"), (3.2e9, "B"), (1.5, "ns"), (12345.6, "times"))] == [
        "0.2 µs", "3.2 GB", "1.5 ns", "12,346 times",
    ]  # fmt: skip


@pytest.mark.parametrize(("measured", "met", "stretch"), [(1.0, True, True), (2.0, True, False), (3.0, False, False)])
def test_a_target_is_a_bound_on_the_median(measured, met, stretch):
    target = targets.Target("k", 2.0, 1.0)
    judged = target.judged([bench.Result("k", "t", "s", (0.0, measured, 9.0), ratio=(0.0, measured, 9.0))])
    assert (judged["measured"], judged["met"], judged["stretch_met"]) == (measured, met, stretch)
    turned = targets.Target("k", 2.0, ratio=True)
    judged = turned.judged([bench.Result("k", "t", "s", (0.0,) * 3, ratio=(0.0, measured, 9.0))])
    assert judged["met"] == (measured >= 2.0)
    assert target.judged([])["measured"] is None
    assert bench.verdict(target.judged([])) == "target  k: not measured this time"


def one_result(scale):
    yield bench.Result("large.forward", "a thing", "s", (0.5,))


def test_the_command_writes_the_report_and_the_picture_and_says_each_result(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(suite, "STAGES", {"one": one_result})
    assert main(["bench", "--quick", "--out", str(tmp_path / "new" / "fast.json")]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "a thing: 500 ms"
    assert said[1] == "target  a thing: 500 ms; to reach at most 80 ms: no, stretch at most 60 ms: no"
    assert len(said) == 1 + len(ASKED) + 2
    assert json.loads((tmp_path / "new" / "fast.json").read_text())["complete"]
    assert (tmp_path / "new" / "fast.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("within_a_kernel", [False, True])
def test_what_was_measured_before_an_interruption_is_kept(within_a_kernel, tmp_path, monkeypatch, capsys):
    def interrupted(scale):
        if within_a_kernel:  # as numba's dispatcher hands it on
            raise SystemError("returned a result with an exception set") from KeyboardInterrupt()
        raise KeyboardInterrupt
        yield

    out = tmp_path / "fast.json"
    monkeypatch.setattr(suite, "STAGES", {"one": one_result, "two": interrupted})
    assert main(["bench", "--out", str(out)]) == 130
    assert capsys.readouterr().err == f"mannbv: stopped; what was measured is in {out}\n"
    report = json.loads(out.read_text())
    assert not report["complete"] and [row["key"] for row in report["results"]] == ["large.forward"]
    out.unlink()
    monkeypatch.setattr(suite, "STAGES", {"two": interrupted})
    assert main(["bench", "--out", str(out)]) == 130
    assert capsys.readouterr().err == "mannbv: stopped; nothing was measured\n"
    assert not out.exists()


@pytest.mark.parametrize(("cause", "status"), [(KeyboardInterrupt(), 130), (ZeroDivisionError(), 2)])
def test_only_ctrl_c_within_a_kernel_stops_a_command_without_a_fault(cause, status, monkeypatch, capsys):
    def scenes_of_a_kernel():
        raise SystemError("returned a result with an exception set") from cause

    monkeypatch.setattr(world, "scenes", scenes_of_a_kernel)
    monkeypatch.delenv("MANNBV_DEBUG", raising=False)
    assert main(["scenes"]) == status
    assert ("stopped" in capsys.readouterr().err) == (status == 130)


def test_a_place_that_cannot_hold_the_report_is_named_before_anything_is_measured(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(suite, "STAGES", {})
    assert main(["bench", "--out", "fast.png"]) == 2
    assert capsys.readouterr().err.startswith("mannbv: bench: --out fast.png must end in .json")
    (tmp_path / "file").write_text("in the way")
    assert main(["bench", "--out", str(tmp_path / "file" / "fast.json")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_the_picture_shows_the_medians():
    rows = []
    for over, places in (("splats", (10, 1000)), ("threads", (1, 2))):
        for at in places:
            for k, stage in enumerate(stages.WHOLE):
                facts = {"over": over, "at": at, "stage": stage, "splats": 10, "width": 8}
                samples = tuple(at * (k + 1) * share for share in (0.001, 0.002, 0.004))
                cpu = tuple(sample / 2 for sample in samples)
                rows.append(bench.Result("", "", "s", samples, cpu, threads=at, facts=facts).row())
    splats, pixels, threads = draw.cost_figure({"results": rows}).axes
    drawn = {line.get_label(): line.get_xydata().tolist() for line in splats.lines}
    assert drawn["forward"] == [[10, 10], [1000, 1000]]
    assert drawn["Fisher, its forward pass included"] == [[10, 30], [1000, 3000]]
    assert splats.get_title(loc="left") == "8×8 px, CPU time"
    assert [text.get_text() for text in pixels.texts] == ["not measured"]
    assert [line.get_ydata().tolist() for line in threads.lines] == [[6, 12], [4, 8], [2, 4]]
