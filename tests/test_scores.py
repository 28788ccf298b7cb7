"""One table names the scores: rows and summaries hold what is in it, and nobody else writes a label."""

import ast
import dataclasses
import json
import pickle
import re
from pathlib import Path

import pytest

import mannbv
from mannbv import episode, messages
from mannbv.lab import study
from mannbv.lab.report import paper
from mannbv.lab.study.reduced import METRICS
from mannbv.metrics import SCORES, Row

ROOT = Path(mannbv.__file__).parent
SHIPPED = ROOT.parent / "notebooks" / "records"
WHO = {"strategy", "seed", "robot", "fate"}  # of a row: whose it is, and words


def of_row() -> set[str]:
    return {field.name for field in dataclasses.fields(Row)} - WHO


def test_every_score_of_a_row_is_in_the_table_and_the_reverse():
    assert {key for key, score in SCORES.items() if not score.of_team} == of_row()
    assert all(key == score.key for key, score in SCORES.items())


def test_every_score_of_a_team_is_in_the_table_and_the_reverse():
    values = dict.fromkeys(of_row(), 1) | {"strategy": "single", "seed": 0, "robot": 0, "reached": True}
    rows = [Row.from_json(values)]
    assert list(study.per_seed(rows)["single"][0]) == list(SCORES)  # in its order, as results.json has them


def test_every_kind_of_message_has_its_bytes():
    kinds = {f"bytes_{kind.__name__.lower()}" for kind in messages.KINDS}
    assert kinds == {key for key in SCORES if key.startswith("bytes_")} - {
        "bytes_sent",
        "bytes_received",
        "bytes_paper",
    }


def test_what_others_pick_from_the_table_is_there():
    assert {*METRICS, *paper.MAP_SCORES, *paper.PATH_SCORES} <= set(SCORES)
    for scores, printed in ((paper.MAP_SCORES, paper.MAPS), (paper.PATH_SCORES, paper.PATHS)):
        assert {len(building) for buildings in printed.values() for building in buildings} == {len(scores)}


def words(source: str) -> list[str]:
    """Every string that a source writes."""
    return [
        node.value for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Constant) and type(node.value) is str
    ]


def sources():
    """(name, source) of the package, the tools and the notebooks' code."""
    for path in sorted([*ROOT.rglob("*.py"), *(ROOT.parent / "tools").glob("*.py")]):
        yield path.name, path.read_text(encoding="utf-8")
    for path in sorted((ROOT.parent / "notebooks").glob("*.ipynb")):
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            if cell["cell_type"] == "code":
                yield path.name, re.sub(r"^(\s*)[%!].*", r"\1pass", "".join(cell["source"]), flags=re.M)


LABELS = {score.label for score in SCORES.values()} - set(SCORES)  # "collisions" is both, and a field


def test_a_label_is_written_once():
    written = [(word, name) for name, source in sources() for word in words(source) if word in LABELS]
    assert sorted(written) == sorted((label, "scores.py") for label in LABELS)


def test_a_label_elsewhere_would_be_seen():
    assert words('print("PSNR", f"{x} dB")') == ["PSNR", " dB"]
    assert "PSNR" in LABELS


def test_labels_name_their_scores_in_one_unit():
    assert len({score.axis for score in SCORES.values()}) == len(SCORES)
    assert all(re.search(r"\[[^\[\]]+\]$", score.axis) for score in SCORES.values())


@pytest.mark.parametrize(
    ("key", "head", "axis"),
    [
        ("total_risk_m", ("AV@R ↑", "own map", "[m]"), "AV@R, own map [m]"),
        ("psnr_db", ("PSNR ↑", "", "[dB]"), "PSNR [dB]"),
        ("depth_mae_m", ("depth error ↓", "", "[m]"), "depth error [m]"),
        ("bytes_plan", ("plans", "sent", "[B]"), "plans, sent [B]"),
    ],
)
def test_a_head_has_the_better_direction_and_the_unit(key, head, axis):
    assert (SCORES[key].head, SCORES[key].axis) == (head, axis)


def test_scores_of_risk_take_the_name_of_the_measure():
    assert SCORES["risk_gain_true_share"].of("var").label == "V@R gain, true surfaces"
    assert SCORES["total_risk_m"].of("avar") == SCORES["total_risk_m"]
    assert SCORES["total_risk_m"].of("timid").label == "timid, own map"
    assert SCORES["psnr_db"].of("var") == SCORES["psnr_db"]


# ---- rows -----------------------------------------------------------------------------------------------------------


def test_a_row_survives_json_and_pickling_and_cannot_change():
    row = Row("single", 3, 1, reached=False, cycles=4, psnr_db=17.5, fate="no frontier left to go to")
    assert Row.from_json(json.loads(json.dumps(row.to_json()))) == pickle.loads(pickle.dumps(row)) == row
    assert row.to_json()["path_overhead"] is None
    with pytest.raises(dataclasses.FrozenInstanceError):
        row.psnr_db = 20.0


def test_a_row_of_an_earlier_version_has_its_bytes_by_kind_from_the_ledger():
    record = episode.load(SHIPPED / "15_episode.npz")
    for row in record.rows:
        mine = {key: n for key, (_, n) in record.ledger.rows.items() if key[0] == row.robot}
        assert row.bytes_copies == sum(n for key, n in mine.items() if key[3] == "Copies") > 0
        assert row.bytes_sent == sum(mine.values())
    assert sum(row.bytes_paper for row in record.rows) == record.ledger.paper_total(record.strategy)


@pytest.mark.parametrize("name", ["08_one_robot", "12_team"])
def test_results_of_an_earlier_version_keep_their_form_to_the_letter(name):
    path = SHIPPED / f"{name}.json"
    before, again = json.loads(path.read_text(encoding="utf-8")), study.load(path)
    assert json.dumps(again.to_json()) == json.dumps(before | {"episodes": []})
    summary = {strategy: {key: mean.to_json() for key, mean in means.items()} for strategy, means in
               study.summarise(again.rows).items()}  # fmt: skip
    assert json.dumps(summary) == json.dumps(before["summary"])
    assert again.constant("codec", "") == "json" and again.constant("share_scale", 0.0) == 0.0  # had no such constant
