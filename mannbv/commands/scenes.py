"""`scenes`: the bundled scenes, a line each."""

from argparse import Namespace

from mannbv.commands.line import Commands


def add(commands: Commands) -> None:
    """Teach the parser this command."""
    parser = commands.add_parser("scenes", help="the bundled scenes, a line each")
    parser.set_defaults(command=run)


def run(arguments: Namespace) -> int:
    """Run it; returns the exit status."""
    from mannbv import world

    found = world.scenes()
    width = max(len(scene.name) for scene in found)
    for scene in found:
        print(f"{scene.name:{width}}  {scene.area:4.0f} m²  {scene.description}")
    return 0
