"""What the exercise checkers say."""

import math

import numpy as np
import pytest
import torch

from mannbv.course import check


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
        (lambda x: 3 * x + 1, "too large for x = 1"),
        (lambda x: 3 * x - (x > 1), "too small for x = 2"),
        (lambda x: np.array([3 * x]), "shape (1,) where one number is wanted"),
        (lambda x: float("nan"), "not finite for x = 1"),
        (lambda x: 3 * x if x < 2 else math.inf, "not finite for x = 2"),
        (lambda x: 3 / (x - 1), "it stops with ZeroDivisionError: float division by zero (for x = 1)"),
        (lambda x: 3 * x if x < 2 else None, "it returns nothing for x = 2"),
        (lambda x: torch.tensor([3.0 * x], requires_grad=True)[0], "agrees with the library"),
        (lambda x: [torch.tensor([x, x], requires_grad=True)], "a number or an array is wanted, got list"),
        (lambda x: "three", "a number or an array is wanted, got str"),
    ],
)
def test_a_verdict_names_what_is_wrong_and_never_the_answer(capsys, mine, words):
    agrees = check.compare(mine, triple, [(1.0,), (2.0,)], [(lambda x: -3 * x, "the sign")])
    said = capsys.readouterr().out.strip()
    assert said == words
    assert agrees is (words == "agrees with the library")


def test_an_answer_that_is_only_printed_hears_that_it_returns_nothing(capsys):
    assert not check.compare(lambda x: print(3 * x), triple, [(1.0,), (2.0,)])
    assert capsys.readouterr().out == "3.0\nto do (it prints, but returns nothing: None)\n"


def test_a_right_answer_may_print_and_its_words_come_first(capsys):
    assert check.compare(lambda x: print("here") or 3 * x, triple, [(1.0,)])
    assert capsys.readouterr().out == "here\nagrees with the library\n"


@pytest.mark.parametrize(
    ("case", "place"),
    [
        ((0.25, [1, 2]), "for first = 0.25, second = [1, 2]"),
        ((torch.tensor([0.1, -1.6]), 3), "for first = [0.1, -1.6], second = 3"),
        ((np.eye(2), 3), "in case 1 of 1"),
        ((np.arange(40), 3), "in case 1 of 1"),
        (("a word", 3), "in case 1 of 1"),
    ],
)
def test_a_case_is_named_by_its_inputs_where_they_are_short(capsys, case, place):
    assert not check.compare(lambda first, second: 1.0, lambda *_: 2.0, [case])
    assert not check.compare(lambda *inputs: 1.0, lambda *_: 2.0, [(0.25, 3)])
    assert capsys.readouterr().out == f"too small {place}\ntoo small for 0.25, 3\n"


def test_of_many_entries_the_one_that_is_farthest_off_is_named(capsys):
    wanted = np.array([[1.0, np.inf], [3.0, 4.0]])
    assert check.compare(lambda: wanted, lambda: wanted, [()])  # inf where inf is wanted
    assert not check.compare(lambda: wanted + np.array([[0, 0], [0.1, -2]]), lambda: wanted, [()])
    assert not check.compare(lambda: wanted, lambda: np.eye(2), [()])
    said = capsys.readouterr().out.splitlines()[1:]
    assert said[0] == "entry (1, 1) is too small in case 1 of 1" and said[1].startswith("not finite")


def test_a_gap_of_ones_own_is_spoken_with_the_case(capsys):
    assert not check.compare(
        lambda x: 4.0, triple, [(1.0,)], gap=lambda case, answer, wanted: f"{answer - wanted:g} off"
    )
    assert capsys.readouterr().out == "1 off for x = 1\n"


def test_an_answer_that_writes_into_its_input_is_judged_by_what_was_asked(capsys):
    cases = [(np.array([1.0, 2.0]),), (torch.tensor([3.0, 4.0]),)]
    assert not check.compare(lambda x: x.__imul__(0), lambda x: 2 * x, cases)  # else the truth would be 0 too
    assert check.compare(lambda x: x.__imul__(2), lambda x: 2 * x, cases)
    assert capsys.readouterr().out.endswith("agrees with the library\n")
