"""How a checker looks at an answer and what it says."""

from collections.abc import Callable, Sequence

import numpy as np


def compare(
    mine: Callable,
    truth: Callable,
    cases: Sequence[tuple],
    mistakes: Sequence[tuple[Callable, str]] = (),
    rtol: float = 1e-6,
    atol: float = 1e-9,
) -> bool:
    """Print how an answer stands against the library, and return whether it agrees.

    mine, truth: functions of a case's arguments, numbers, arrays or tensors out. mistakes: (a plausible wrong
    function, the hint it deserves); the first that gives what `mine` gives everywhere is spoken. The right values are
    never printed. An answer that returns None or ... is still "to do".
    """
    answers = []
    for case in cases:
        try:
            answer = mine(*case)
        except Exception as error:
            return _say(f"it stops with {type(error).__name__}: {error}".splitlines()[0])
        if answer is None or answer is ...:
            return _say("to do")
        try:
            answers.append(_plain(answer))
        except (TypeError, ValueError):
            return _say(f"a number or an array is wanted, got {type(answer).__name__}")
    wanted = [_plain(truth(*case)) for case in cases]
    if _same(answers, wanted, rtol, atol):
        _say("agrees with the library")
        return True
    for wrong, hint in mistakes:
        if _same(answers, [_plain(wrong(*case)) for case in cases], rtol, atol):
            return _say(hint)
    for number, (answer, value) in enumerate(zip(answers, wanted, strict=True), 1):
        if answer.shape != value.shape:
            return _say(f"shape {answer.shape} where {value.shape} is wanted")
        if not np.isfinite(answer).all():
            return _say(f"not finite in case {number} of {len(cases)}")
        if not np.allclose(answer, value, rtol, atol):
            gap = (answer - value).ravel()
            side = "large" if gap[np.argmax(np.abs(gap))] > 0 else "small"
            return _say(f"too {side} in case {number} of {len(cases)}")
    return False


def _say(text: str) -> bool:
    print(text)
    return False


def _plain(value) -> np.ndarray:
    value = value.detach().numpy() if hasattr(value, "detach") else value
    return np.asarray(value, float)


def _same(answers, wanted, rtol: float, atol: float) -> bool:
    return all(a.shape == w.shape and np.allclose(a, w, rtol, atol) for a, w in zip(answers, wanted, strict=True))
