"""`bench`: how fast every stage is, beside what it replaces."""

import sys
from argparse import Namespace
from pathlib import Path

from mannbv.commands.line import Commands, UsageError, interrupted


def add(commands: Commands) -> None:
    """Teach the parser this command."""
    parser = commands.add_parser(
        "bench",
        help="how fast every stage is, beside what it replaces",
        description="Time every stage in turns with what it replaces, a few minutes in all; write JSON, and a picture "
        "of cost against splats, pixels and threads beside it. Leave the machine alone meanwhile.",
    )
    parser.add_argument("--out", type=Path, default="bench.json", metavar="FILE", help="the JSON (default bench.json)")
    parser.add_argument(
        "--quick", action="store_true", help="within a minute: few rounds, no cold start and no main job"
    )
    parser.set_defaults(command=run)


def run(arguments: Namespace) -> int:
    """Run it; returns the exit status."""
    out = arguments.out
    if out.suffix != ".json":
        raise UsageError(f"bench: --out {out} must end in .json; the picture goes beside it as .png")
    from tqdm import tqdm

    from mannbv import archive
    from mannbv.lab import bench, draw

    out.parent.mkdir(parents=True, exist_ok=True)
    kept = {}

    def keep(report: dict) -> None:
        archive.write_text(out, archive.to_json(report, indent=1) + "\n")
        kept.update(report)

    with tqdm(total=len(bench.STAGES), file=sys.stderr, disable=None, bar_format="{desc} |{bar}| {elapsed}") as bar:

        def show(done: int, stage: str, line: str) -> None:
            bar.n = done
            bar.set_description_str(stage)
            if line:
                bar.write(line)  # to standard output, above the bar
                sys.stdout.flush()

        try:
            bench.run(bench.QUICK if arguments.quick else bench.FULL, keep, show)
        except (KeyboardInterrupt, SystemError) as error:
            if not interrupted(error):
                raise
            bar.close()
            print(
                f"mannbv: stopped; {f'what was measured is in {out}' if kept else 'nothing was measured'}",
                file=sys.stderr,
            )
            return 130
    for target in kept["targets"]:
        print(bench.verdict(target))
    draw.save(draw.cost_figure(kept), out.with_suffix(".png"))
    print(f"Figure:  {out.with_suffix('.png')}\nResults: {out}")
    return 0
