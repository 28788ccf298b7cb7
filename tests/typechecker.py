"""What checks annotations while tests run: beartype, reading them as pyright does: 1 is a float, (1, 2) array-like."""

from collections.abc import Sequence
from typing import TextIO, get_args

from beartype import BeartypeConf, FrozenDict, beartype
from numpy.typing import ArrayLike

# at run time numpy's protocol of nested sequences also asks for __reversed__, which a tuple has not
_HINTS = {hint: Sequence for hint in get_args(ArrayLike) if "NestedSequence" in repr(hint)}
_HINTS[TextIO] = object  # an io.StringIO is none there
checked = beartype(conf=BeartypeConf(is_pep484_tower=True, hint_overrides=FrozenDict(_HINTS)))
