"""Exercises as data, a module a notebook, so that `from mannbv.course.check import masks as check` serves notebook 05.

Each is a table of what is said of which value, the right one and plausible mistakes with the hints that they deserve,
and the cases to try. Called with an answer it says "to do", "agrees with the library", or what is wrong (a sign, a
unit, the wrong tail), never the answer.
"""

from mannbv.course.check.verdict import AGREES, Exercise, Judged

__all__ = ["AGREES", "Exercise", "Judged"]
