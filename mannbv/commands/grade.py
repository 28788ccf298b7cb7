"""`grade FOLDER`: which exercises pass in handed-in copies of the notebooks."""

import functools
from argparse import Namespace
from pathlib import Path

from mannbv.commands.line import Commands


def add(commands: Commands) -> None:
    """Teach the parser this command."""
    parser = commands.add_parser(
        "grade",
        help="handed-in copies of the notebooks: which exercises pass",
        description="Run every notebook below FOLDER, then the course's own checks on it, into a CSV. Copies graded "
        "before with the same content are skipped. This runs students' code with your rights: grade in a container, or "
        "an account of its own.",
    )
    parser.add_argument("folder", metavar="FOLDER", type=Path, help="the handed-in copies, in folders of any layout")
    parser.add_argument("--out", type=Path, default="grades.csv", metavar="FILE", help="the CSV (default grades.csv)")
    parser.add_argument("--limit", type=float, default=120.0, metavar="S", help="seconds a copy may take (default 120)")
    parser.add_argument("--notebooks", type=Path, metavar="DIR", help="the solved notebooks (default: the checkout's)")
    parser.set_defaults(command=run)


def run(arguments: Namespace) -> int:
    """Run it; returns the exit status."""
    from mannbv.course import grade

    course = arguments.notebooks or grade.COURSE
    copies, kept = grade.grade(
        arguments.folder, arguments.out, course, arguments.limit, functools.partial(print, flush=True)
    )
    again = f", {kept} of them graded before with the same content" if kept else ""
    print(f"{len(copies)} files{again}: {arguments.out}")
    return 0
