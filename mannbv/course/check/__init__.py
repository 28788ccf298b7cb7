"""Exercise checkers: a module a notebook, so that `from mannbv.course.check import masks as check` serves notebook 05.

A checker says "to do", "agrees with the library", or what is wrong (a sign, a unit, the wrong tail), never the answer.
"""

from mannbv.course.check.verdict import compare

__all__ = ["compare"]
