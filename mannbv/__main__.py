"""The command line: `python -m mannbv scenes | compare SCENE | tables RUN… | bench | grade FOLDER | doctor`.

Any error is one line on standard error and exit status 2; Ctrl-C ends with 130. What a command needs is imported when
it runs, so that --help comes at once.
"""

import argparse
import io
import logging
import os
import sys
import warnings
from typing import NoReturn

from mannbv.commands import COMMANDS
from mannbv.commands.line import UsageError, interrupted


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; see {self.prog} --help")


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns the exit status."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without ± or ↑ shows "?"
    parser = _parser()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            arguments = parser.parse_args(argv)
            logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it announces the building of its font cache
            return arguments.command(arguments)
    except SystemExit as end:  # --help
        return int(end.code or 0)
    except KeyboardInterrupt:
        print("mannbv: stopped; the same command resumes", file=sys.stderr)
        return 130
    except BrokenPipeError:  # whoever read our output has left
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _fail(f"{where}{error.strerror or error}; check the path")
    except MemoryError as error:
        what = f" ({error})" if str(error) else ""
        return _fail(f"not enough memory{what}; ask for fewer seeds, smaller images or larger cells")
    except ValueError as error:
        return _fail(str(error) or type(error).__name__)
    except Exception as error:
        if interrupted(error):
            print("mannbv: stopped; the same command resumes", file=sys.stderr)
            return 130
        if os.environ.get("MANNBV_DEBUG"):
            raise
        return _fail(f"a fault in mannbv itself ({type(error).__name__}: {error}); MANNBV_DEBUG=1 shows where")


def _fail(message: str) -> int:
    print("mannbv: " + " ".join(message.split()), file=sys.stderr)
    return 2


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="mannbv", description="Multi-robot next-best-view planning on Gaussian-splat maps.")
    commands = parser.add_subparsers(dest="name", required=True, metavar="COMMAND")
    for command in COMMANDS:
        command.add(commands)
    return parser


if __name__ == "__main__":
    sys.exit(main())
