"""What an exercise is, how an answer to it is judged, and what is said."""

import contextlib
import copy
import inspect
import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

TO_DO = "to do"
AGREES = "agrees with the library"


class Fault(Exception):
    """What is wrong with an answer, in the words that its author reads."""


def _printed(asked: "Exercise | Judged", *mine: Callable) -> bool:
    """What a reader calls with an answer: it prints what is said of it, and returns whether it is done."""
    try:
        said, done = asked.said(*mine)
    except Fault as fault:
        said, done = str(fault), False
    print(said)
    return done


@dataclass(frozen=True, repr=False, eq=False)
class Exercise:
    """An exercise with one right answer.

    table: a function of a case that gives what is said of which value: under AGREES, first, the right one, which is
    never printed; under each hint a plausible wrong one, or a list of some. cases: arguments to try, or a function that
    draws them. read: makes of an answer what is compared, numbers or an array. gap: for what is not in the table, a
    function of (case, answer, wanted), the last two float arrays of one shape, that says how they differ; default: "too
    large" or "too small". screen: looks at the answer itself first, and may raise Fault.
    """

    table: Callable[..., dict[str, object]]
    cases: Sequence[tuple] | Callable[[], Sequence[tuple]]
    rtol: float = 1e-4
    read: Callable = lambda answer: answer
    gap: Callable | None = None
    screen: Callable | None = None
    __call__ = _printed

    def drawn(self) -> Sequence[tuple]:
        """The cases to try."""
        return self.cases() if callable(self.cases) else self.cases

    def rows(self, cases: Sequence[tuple]) -> Iterator[tuple[str, list]]:
        """What is said, and of which value in each case; the right ones first."""
        tables = [self.table(*case) for case in cases]
        for words in tables[0]:
            several = [table[words] if isinstance(table[words], list) else [table[words]] for table in tables]
            yield from ((words, list(values)) for values in zip(*several, strict=True))

    def said(self, mine: Callable) -> tuple[str, bool]:
        """What an answer hears, and whether it is right. Raises Fault where it fits nothing in the table."""
        if self.screen:
            self.screen(mine)
        cases = self.drawn()
        given = copy.deepcopy(cases)  # an answer may write into them; the truth is asked about what was asked
        places = [_place(mine, case, f"in case {number} of {len(cases)}") for number, case in enumerate(cases, 1)]
        answers = []
        for case, place in zip(given, places, strict=True):
            try:
                answers.append(self._read(ask(mine, *case, place=place)))
            except Fault as fault:
                late = answers and str(fault).startswith(TO_DO)
                raise Fault(f"it returns nothing {place}") if late else fault from None
        rows = [(words, [self._read(value) for value in values]) for words, values in self.rows(cases)]
        for words, values in rows:
            if all(map(self._same, answers, values)):
                return words, words == AGREES
        asked = zip(given, places, answers, rows[0][1], strict=True)
        case, place, answer, wanted = next(row for row in asked if not self._same(*row[2:]))
        if answer.shape != wanted.shape:
            raise Fault(f"shape {answer.shape} where {wanted.shape or 'one number'} is wanted")
        if np.isnan(answer).any() or (self.gap is None and (np.isinf(answer) & np.isfinite(wanted)).any()):
            raise Fault(f"not finite {place}")
        raise Fault(f"{(self.gap or _gap)(case, answer, wanted)} {place}")

    def _read(self, answer: Any) -> np.ndarray:
        try:
            return plain(self.read(answer))
        except (TypeError, ValueError, RuntimeError):
            raise Fault(f"a number or an array is wanted, got {type(answer).__name__}") from None

    def _same(self, answer: np.ndarray, value: np.ndarray) -> bool:
        return answer.shape == value.shape and np.allclose(answer, value, self.rtol, 1e-6)


class Mistake(NamedTuple):
    """A plausible wrong answer to an exercise that is judged, and the hint that it deserves.

    seen: tells it by what the judge saw, {fields} of which the hint may name. None: the judge itself says the hint.
    """

    answer: Callable | tuple[Callable, ...]
    hint: str
    seen: Callable[..., bool] | None = None


@dataclass(frozen=True, repr=False, eq=False)
class Judged:
    """An exercise with many right answers, one of which is `truth`; an answer may be two functions.

    judge: a function of the answer that returns what it saw, and raises Fault where there is nothing to see. mistakes:
    the first that is seen is spoken. praise: what is said where none is, with {fields} of what the judge saw.
    """

    judge: Callable
    truth: Callable | tuple[Callable, ...]
    mistakes: Sequence[Mistake]
    praise: str = AGREES
    __call__ = _printed

    def said(self, *mine: Callable) -> tuple[str, bool]:
        """What an answer hears, and whether it is a good one. Raises Fault where there is nothing to judge."""
        seen = self.judge(*mine)
        fields = vars(seen) if isinstance(seen, SimpleNamespace) else {}
        hint = next((m.hint for m in self.mistakes if m.seen and m.seen(seen)), "")
        return (hint or self.praise).format(**fields), not hint


def exercise(cases: Sequence[tuple] | Callable, **more: Any) -> Callable[[Callable], Exercise]:
    """Make an `Exercise` of its table, a function of a case whose first line says what is asked."""
    return lambda table: _documented(Exercise(table, cases, **more), table)


def judged(truth: Any, mistakes: Sequence[tuple], praise: str = AGREES) -> Callable[[Callable], Judged]:
    """Make a `Judged` of its judge, a function of an answer whose first line says what is asked; mistakes: rows."""
    return lambda judge: _documented(Judged(judge, truth, [Mistake(*row) for row in mistakes], praise), judge)


def _documented(record: Any, function: Callable) -> Any:
    object.__setattr__(record, "__doc__", function.__doc__)  # for `check.radius?`
    return record


def ask(mine: Callable, *case: object, place: str = "") -> Any:
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


def plain(answer: Any) -> np.ndarray:
    """Numbers as a float array. Raises Fault for anything else."""
    try:
        return np.asarray(answer.detach().numpy() if hasattr(answer, "detach") else answer, float)
    except (TypeError, ValueError, RuntimeError):
        raise Fault(f"a number or an array is wanted, got {type(answer).__name__}") from None


def number(answer: Any, what: str = "") -> float:
    """One number. Raises Fault, with `what` it should be, for anything else."""
    try:
        return float(answer)
    except (TypeError, ValueError, RuntimeError):
        raise Fault(f"one number is wanted{what and ': '}{what}") from None


def side(answer: float, value: float) -> str:
    """ "too large" or "too small"."""
    return "too large" if answer > value else "too small"


def _gap(case: tuple, answer: np.ndarray, value: np.ndarray) -> str:
    """On which side an answer lies, by the entry that is farthest off."""
    with np.errstate(invalid="ignore"):  # inf − inf
        away = np.nan_to_num(np.abs(answer - value))
    entry = tuple(int(k) for k in np.unravel_index(np.argmax(away), away.shape))
    name = f"entry {entry[0] if len(entry) == 1 else entry} is " if answer.size > 1 else ""
    return name + side(float(answer[entry]), float(value[entry]))


def _place(mine: Callable, case: tuple, otherwise: str) -> str:
    """ "for mean = 0.4, std = 0.1" where the inputs are few numbers, so that they can be tried by hand."""
    try:
        inputs, names = [_short(value) for value in case], list(inspect.signature(mine).parameters)
    except (Fault, TypeError, ValueError):
        return otherwise
    if len(names) == len(inputs):
        inputs = [f"{name} = {value}" for name, value in zip(names, inputs, strict=True)]
    text = ", ".join(inputs)
    return f"for {text}" if 0 < len(text) <= 60 else otherwise


def _short(value) -> str:
    """A number, or a list of some, in at most six digits. Raises ValueError for anything else."""
    if not isinstance(value, int | float | list | np.number | np.ndarray) and not hasattr(value, "detach"):
        raise ValueError
    array = plain(value)
    if array.ndim > 1:
        raise ValueError
    return f"[{', '.join(f'{entry:.6g}' for entry in array)}]" if array.ndim else f"{array:.6g}"
