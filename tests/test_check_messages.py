"""What the checks of notebook 11 say to right, wrong and empty answers."""

import json
from pathlib import Path

import numpy as np
import pytest

from mannbv.course.check import messages as check

NOTEBOOK = Path(__file__).parent.parent / "notebooks" / "11_messages.ipynb"


@pytest.fixture(scope="module")
def stored():
    """The functions of the notebook's solutions."""
    names = {"np": np}
    for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]:
        if "solution" in cell["metadata"].get("tags", ()):
            exec("".join(cell["source"]), names)
    return names


def codec(dtype, step):
    return (
        lambda yaws: np.round(np.asarray(yaws) / step).astype(dtype).tobytes(),
        lambda data: np.frombuffer(data, dtype) * step,
    )


WRONG = {
    "total": [
        (lambda c: 56 * sum(c) / 1e6, "not a million bytes"),
        (lambda c: 56 * sum(c), "these are bytes"),
        (lambda c: 14 * 8 * sum(c) / 2**20, "single precision"),
        (lambda c: 62 * 4 * sum(c) / 2**20, "the paper sends fewer numbers"),
        (lambda c: 10 * 4 * sum(c) / 2**20, "flatland"),
    ],
    "copies": [
        (lambda n: 8 * n, "what stands before them?"),
        (lambda n: 4 + 2 + 4 + 4 + 8 * n, "how long it is"),
        (lambda n: 18 + 4 * n, "single precision"),
        (lambda n: 18 + 8 * (n - 1), "the sender's own"),
    ],
    "ring": [
        (lambda n: n * (n - 1), "everyone could hear everyone"),
        (lambda n: n * sum(range(n)), "the other way is shorter"),
        (lambda n: sum(min(k, n - k) for k in range(n)), "one robot"),
        (lambda n: n * sum(min(k, n - k) for k in range(n)) / 2, "one each way"),
    ],
    "pack": [
        (lambda yaws: np.asarray(yaws, "<f4").tobytes(), lambda data: np.frombuffer(data, "<f4"), "more than 2 B"),
        (lambda yaws: np.asarray(yaws, "<f2").tobytes(), lambda data: np.frombuffer(data, "<f2"), None),
        (*codec("i1", np.pi / 127), "too coarse"),
        (*codec("<i2", 0.01), "too coarse"),
        (*codec("<i2", 0.00005), "overflows"),
        (lambda yaws: list(yaws), lambda data: np.array(data), "bytes are wanted"),
        (codec("<i2", 0.0002)[0], lambda data: np.frombuffer(data, "i1") * 0.0002, "not as many yaws"),
    ],
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_the_stored_solution_agrees_and_an_empty_one_is_to_do(name, stored, capsys):
    mine = [stored["my_pack"], stored["my_unpack"]] if name == "pack" else [stored[f"my_{name}"]]
    assert getattr(check, name)(*mine)
    assert capsys.readouterr().out.strip() == "agrees with the library"
    for empty in (None, ...):
        nothing = [lambda case, empty=empty: empty] * len(mine)
        assert not getattr(check, name)(*nothing)
        assert capsys.readouterr().out.strip() == "to do"
        if name == "pack":
            assert not check.pack(mine[0], nothing[0])
            assert capsys.readouterr().out.strip() == "to do"


@pytest.mark.parametrize(
    ("name", "mine", "hint"), [(name, a[:-1], a[-1]) for name, all_ in WRONG.items() for a in all_]
)
def test_a_wrong_answer_is_told_what_is_wrong(name, mine, hint, capsys):
    assert getattr(check, name)(*mine) is (hint is None)
    assert (hint or "agrees with the library") in capsys.readouterr().out
