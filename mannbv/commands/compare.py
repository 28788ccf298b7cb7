"""`compare SCENE`: the strategies on one scene → tables, a figure, results.json."""

import math
import sys
from argparse import Namespace
from pathlib import Path

from mannbv.commands.line import Commands, UsageError

PRESETS = ("quick", "paper")
FIGURE = "figure.png"


def add(commands: Commands) -> None:
    """Teach the parser this command."""
    parser = commands.add_parser(
        "compare",
        help="the strategies on one scene: tables, a figure, results.json",
        description="Run the strategies on one scene; print the paper's tables; write results.json and figure.png. "
        "What was interrupted resumes, what is finished is kept.",
    )
    parser.add_argument(
        "scene",
        metavar="SCENE",
        help="a bundled name, a plan (.json), a ROS map (.yaml), a mesh (.glb, .gltf, .obj, .ply) or Habitat PointNav "
        "episodes (.json.gz)",
    )
    parser.add_argument(
        "--dim", type=int, choices=(2, 3), help="2: flatland; 3: space (default: 3 for meshes and PointNav, else 2)"
    )
    parser.add_argument("--robots", type=int, default=5, metavar="N", help="robots in the team (default 5)")
    parser.add_argument("--strategies", default="all", metavar="all|A,B", help="which strategies (default all)")
    parser.add_argument(
        "--seeds", type=int, default=1, metavar="N", help="seeds 0 … N−1; intervals from 2 on (default 1)"
    )
    parser.add_argument(
        "--preset",
        choices=PRESETS,
        default="quick",
        help="quick (default): small images, minutes a building; paper: 800 px as in the paper, in 3-D for many hours",
    )
    parser.add_argument("--up", metavar="AXIS", help="which way is up in a mesh: z, y, -z, … (default: looked for)")
    parser.add_argument("--scale", type=float, metavar="M", help="metres a unit of a mesh (default: looked for)")
    parser.add_argument("--floor", type=float, metavar="M", help="height of a mesh's storey (default: the largest)")
    parser.add_argument("--scenes-dir", type=Path, metavar="DIR", help="where the scenes of PointNav episodes lie")
    parser.add_argument("--building", metavar="NAME", help="which scene of a PointNav file (default: the first's)")
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="change a constant, as often as you like"
    )
    parser.add_argument(
        "--workers", type=int, default=2, metavar="N", help="processes side by side; 0: none (default 2)"
    )
    parser.add_argument("--out", metavar="DIR", help="where to write (default out/compare-<scene>)")
    parser.set_defaults(command=run)


def run(arguments: Namespace) -> int:
    """Run it; returns the exit status."""
    for name, least in (("robots", 1), ("seeds", 1), ("workers", 0)):
        if getattr(arguments, name) < least:
            raise UsageError(f"compare: --{name} must be at least {least}, got {getattr(arguments, name)}")
    from mannbv import team, world
    from mannbv.lab import report, study

    strategies = None if arguments.strategies == "all" else [s.strip() for s in arguments.strategies.split(",")]
    overrule = {name: getattr(arguments, name) for name in ("up", "scale", "floor", "scenes_dir", "building")}
    place = world.load(arguments.scene, dim=arguments.dim, **overrule)
    config = _config(place.dim, arguments.preset, arguments.set)
    for note in place.notes:
        print(f"{place.name}: {note}", file=sys.stderr)
    out = Path(arguments.out or f"out/compare-{Path(place.name).name}" + "-3d" * (place.dim == 3))  # or "../here"
    n_strategies = len(set(strategies or team.STRATEGIES))
    with study.ProgressBar() as bar:
        outcome = study.compare(
            place, strategies, arguments.seeds, arguments.robots, config, out, arguments.workers, bar
        )
    results = outcome.results
    if results.rows:
        for table in report.tables(results):
            print(report.as_text(table), end="\n\n")
        from mannbv.lab import draw

        record, drawn = _shown(outcome, place)
        if record.cycles:  # max_cycles may be 0
            draw.save(draw.compare_figure(results, record, drawn), out / FIGURE)
            print(f"Figure:  {out / FIGURE}")
        print(f"Results: {out / 'results.json'}")
    if outcome.failures:
        sys.stdout.flush()
        raise ValueError(
            f"compare: {len(outcome.failures)} of {n_strategies * arguments.seeds} episodes failed: "
            + "; ".join(outcome.failures)
        )
    return 0


def _shown(outcome, place):
    """The record that the figure shows, of a distributed team if there is one, and its world."""
    from mannbv import episode

    done = [(row.strategy, row.seed) for row in outcome.results.rows]
    strategy, seed = min(done, key=lambda run: run[0] != "distributed")
    record = outcome.record(strategy, seed)
    return record, episode.draw_team(place, record.n_robots, seed, record.config)


def _config(dim: int, preset: str, changes: list[str]):
    """A preset's constants for a world of `dim` dimensions, with NAME=VALUE changes.

    Raises ValueError, naming the change and the remedy.
    """
    from mannbv.config import PRESETS as constants
    from mannbv.config import Config, nearest

    values, names = {}, Config.__dataclass_fields__
    for change in changes:
        name, equals, text = change.partition("=")
        name = name.strip()
        if name not in names or not equals:
            example = nearest({name} - names.keys(), names) or "such as --set level=0.05"
            raise UsageError(f"--set {change}: give NAME=VALUE with a constant's name, {example}")
        default = getattr(Config(), name)
        try:
            values[name] = type(default)(text.strip())
        except ValueError:
            kind = "a whole number" if isinstance(default, int) else "a number"
            raise UsageError(f"--set {change}: {name} is {kind}, such as {default}") from None
        if isinstance(default, float) and not math.isfinite(values[name]):
            raise UsageError(f"--set {change}: {name} must be finite, such as {default:g}")
    return constants[dim][preset].replace(**values)
