"""How a checker looks at an answer and what it says."""

import contextlib
import copy
import inspect
import io
from collections.abc import Callable, Sequence

import numpy as np

TO_DO = "to do"


class Fault(Exception):
    """What is wrong with an answer, in the words that its author reads."""


def compare(
    mine: Callable,
    truth: Callable,
    cases: Sequence[tuple],
    mistakes: Sequence[tuple[Callable, str]] = (),
    rtol: float = 1e-6,
    atol: float = 1e-9,
    gap: Callable | None = None,
) -> bool:
    """Print how an answer stands against the library, and return whether it agrees.

    mine, truth: functions of a case's arguments, numbers, arrays or tensors out. mistakes: (a plausible wrong
    function, the hint it deserves); the first that gives what `mine` gives everywhere is spoken. The right values are
    never printed. gap: for what fits no mistake, a function of (case, answer, wanted), two float arrays of one shape,
    that says how they differ; default: "too large" or "too small". An answer that returns None or ... is "to do".
    """
    places = [_place(mine, case, f"in case {number} of {len(cases)}") for number, case in enumerate(cases, 1)]
    answers = []
    for case, place in zip(cases, places, strict=True):
        try:
            answers.append(_plain(ask(mine, *map(_own, case), place=place)))
        except Fault as fault:
            return say(f"it returns nothing {place}" if answers and str(fault).startswith(TO_DO) else str(fault))
    wanted = [_plain(truth(*case)) for case in cases]
    if _same(answers, wanted, rtol, atol):
        return say("agrees with the library", True)
    for wrong, hint in mistakes:
        if _same(answers, [_plain(wrong(*case)) for case in cases], rtol, atol):
            return say(hint)
    for case, place, answer, value in zip(cases, places, answers, wanted, strict=True):
        if answer.shape != value.shape:
            return say(f"shape {answer.shape} where {value.shape or 'one number'} is wanted")
        if np.isnan(answer).any() or (gap is None and (np.isinf(answer) & np.isfinite(value)).any()):
            return say(f"not finite {place}")
        if not np.allclose(answer, value, rtol, atol):
            return say(f"{gap(case, answer, value) if gap else _gap(answer, value)} {place}")
    return False


def _own(value):
    """A copy of what an answer could write into: the truth is asked about the same case afterwards."""
    mutable = isinstance(value, list | dict | np.ndarray) or hasattr(value, "detach")
    return copy.deepcopy(value) if mutable else value


def ask(mine: Callable, *case, place: str = ""):
    """What an answer gives for a case. Raises Fault, with what to say, where it stops or returns nothing.

    place: names the case, as in "for std = 0.1"; without it, short inputs do.
    """
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed):
            answer = mine(*case)
    except Fault:
        raise
    except Exception as error:
        place = place or _place(mine, case, "")
        what = f"it stops with {type(error).__name__}: {error}".splitlines()[0]
        raise Fault(f"{what} ({place})" if place else what) from None
    finally:
        print(printed.getvalue(), end="")
    if answer is None or answer is ...:
        raise Fault(f"{TO_DO} (it prints, but returns nothing: None)" if printed.getvalue().strip() else TO_DO)
    return answer


def say(text: str, done: bool = False) -> bool:
    """Print a verdict, and return whether the exercise is done."""
    print(text)
    return done


def side(answer: float, value: float) -> str:
    """ "too large" or "too small"."""
    return "too large" if answer > value else "too small"


def _gap(answer: np.ndarray, value: np.ndarray) -> str:
    """On which side an answer lies, by the entry that is farthest off."""
    with np.errstate(invalid="ignore"):  # inf − inf
        away = np.nan_to_num(np.abs(answer - value))
    entry = tuple(int(k) for k in np.unravel_index(np.argmax(away), away.shape))
    name = f"entry {entry[0] if len(entry) == 1 else entry} is " if answer.size > 1 else ""
    return name + side(float(answer[entry]), float(value[entry]))


def _place(mine: Callable, case: tuple, otherwise: str) -> str:
    """ "for mean = 0.4, std = 0.1" where the inputs are few numbers, so that they can be tried by hand."""
    try:
        told, names = [_short(value) for value in case], list(inspect.signature(mine).parameters)
    except (Fault, TypeError, ValueError):
        return otherwise
    if len(names) == len(told):
        told = [f"{name} = {value}" for name, value in zip(names, told, strict=True)]
    text = ", ".join(told)
    return f"for {text}" if 0 < len(text) <= 60 else otherwise


def _short(value) -> str:
    """A number, or a list of some, in at most six digits. Raises ValueError for anything else."""
    if not isinstance(value, int | float | list | np.number | np.ndarray) and not hasattr(value, "detach"):
        raise ValueError
    array = _plain(value)
    if array.ndim > 1:
        raise ValueError
    return f"[{', '.join(f'{entry:.6g}' for entry in array)}]" if array.ndim else f"{array:.6g}"


def _plain(value) -> np.ndarray:
    try:
        return np.asarray(value.detach().numpy() if hasattr(value, "detach") else value, float)
    except (TypeError, ValueError, RuntimeError):
        raise Fault(f"a number or an array is wanted, got {type(value).__name__}") from None


def _same(answers, wanted, rtol: float, atol: float) -> bool:
    return all(a.shape == w.shape and np.allclose(a, w, rtol, atol) for a, w in zip(answers, wanted, strict=True))
