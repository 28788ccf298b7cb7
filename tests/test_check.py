"""What the exercise checkers say."""

import numpy as np
import pytest
import torch

from mannbv import check


def triple(x):
    return 3 * x


@pytest.mark.parametrize(
    ("mine", "words"),
    [
        (lambda x: None, "to do"),
        (lambda x: ..., "to do"),
        (triple, "agrees with the library"),
        (lambda x: torch.as_tensor(3.0 * x), "agrees with the library"),
        (lambda x: -3 * x, "the sign"),
        (lambda x: 3 * x + 1, "too large in case 1 of 2"),
        (lambda x: 3 * x - (x > 1), "too small in case 2 of 2"),
        (lambda x: np.array([3 * x]), "shape (1,) where () is wanted"),
        (lambda x: float("nan"), "not finite in case 1 of 2"),
        (lambda x: 1 / 0, "it stops with ZeroDivisionError: division by zero"),
        (lambda x: "three", "a number or an array is wanted, got str"),
    ],
)
def test_a_verdict_names_what_is_wrong_and_never_the_answer(capsys, mine, words):
    agrees = check.compare(mine, triple, [(1.0,), (2.0,)], [(lambda x: -3 * x, "the sign")])
    said = capsys.readouterr().out.strip()
    assert said == words
    assert agrees is (words == "agrees with the library")
