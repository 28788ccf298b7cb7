"""What commands share: the parser that they add to, an error in what was typed, and who pressed Ctrl-C."""

import argparse

Commands = argparse._SubParsersAction  # what `add_subparsers` returns


class UsageError(ValueError):
    """What was typed cannot be understood."""


def interrupted(error: BaseException) -> bool:
    """Whether Ctrl-C is behind it: from within a compiled kernel it comes as the cause of a SystemError."""
    return isinstance(error, KeyboardInterrupt) or isinstance(error.__cause__, KeyboardInterrupt)
