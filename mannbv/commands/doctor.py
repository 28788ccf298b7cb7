"""`doctor`: what is wrong with this installation, and the remedies."""

from argparse import Namespace

from mannbv.commands.line import Commands


def add(commands: Commands) -> None:
    """Teach the parser this command."""
    parser = commands.add_parser("doctor", help="what is wrong with this installation, and the remedies")
    parser.set_defaults(command=run)


def run(arguments: Namespace) -> int:
    """Run it; returns the exit status."""
    from mannbv.lab import doctor

    return doctor.main()
