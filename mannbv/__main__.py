"""The command line: `python -m mannbv scenes | compare SCENE | tables RUN… | bench | grade FOLDER | doctor`.

Any error is one line on standard error and exit status 2; Ctrl-C ends with 130. What a command needs is imported when
it runs, so that --help comes at once.
"""

import argparse
import contextlib
import functools
import logging
import math
import os
import sys
import warnings
from pathlib import Path

PRESETS = ("quick", "paper")
FIGURE = "figure.png"


class _UsageError(ValueError):
    """What was typed cannot be understood."""


class _Parser(argparse.ArgumentParser):
    def error(self, message):
        raise _UsageError(f"{message}; see {self.prog} --help")


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns the exit status."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(AttributeError, ValueError):
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
        if _interrupted(error):
            print("mannbv: stopped; the same command resumes", file=sys.stderr)
            return 130
        if os.environ.get("MANNBV_DEBUG"):
            raise
        return _fail(f"a fault in mannbv itself ({type(error).__name__}: {error}); MANNBV_DEBUG=1 shows where")


def _interrupted(error: BaseException) -> bool:
    """Whether Ctrl-C is behind it: from within a compiled kernel it comes as the cause of a SystemError."""
    return isinstance(error, KeyboardInterrupt) or isinstance(error.__cause__, KeyboardInterrupt)


def _fail(message: str) -> int:
    print("mannbv: " + " ".join(message.split()), file=sys.stderr)
    return 2


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="mannbv", description="Multi-robot next-best-view planning on Gaussian-splat maps.")
    commands = parser.add_subparsers(dest="name", required=True, metavar="COMMAND")

    scenes = commands.add_parser("scenes", help="the bundled scenes, a line each")
    scenes.set_defaults(command=_scenes)

    compare = commands.add_parser(
        "compare",
        help="the strategies on one scene: tables, a figure, results.json",
        description="Run the strategies on one scene; print the paper's tables; write results.json and figure.png. "
        "What was interrupted resumes, what is finished is kept.",
    )
    compare.add_argument(
        "scene",
        metavar="SCENE",
        help="a bundled name, a plan (.json), a ROS map (.yaml), a mesh (.glb, .gltf, .obj, .ply) or Habitat PointNav "
        "episodes (.json.gz)",
    )
    compare.add_argument(
        "--dim", type=int, choices=(2, 3), help="2: flatland; 3: space (default: 3 for meshes and PointNav, else 2)"
    )
    compare.add_argument("--robots", type=int, default=5, metavar="N", help="robots in the team (default 5)")
    compare.add_argument("--strategies", default="all", metavar="all|A,B", help="which strategies (default all)")
    compare.add_argument(
        "--seeds", type=int, default=1, metavar="N", help="seeds 0 … N−1; intervals from 2 on (default 1)"
    )
    compare.add_argument(
        "--preset",
        choices=PRESETS,
        default="quick",
        help="quick (default): small images, minutes a building; paper: 800 px as in the paper, in 3-D for many hours",
    )
    compare.add_argument("--up", metavar="AXIS", help="which way is up in a mesh: z, y, -z, … (default: looked for)")
    compare.add_argument("--scale", type=float, metavar="M", help="metres a unit of a mesh (default: looked for)")
    compare.add_argument("--floor", type=float, metavar="M", help="height of a mesh's storey (default: the largest)")
    compare.add_argument("--scenes-dir", type=Path, metavar="DIR", help="where the scenes of PointNav episodes lie")
    compare.add_argument("--building", metavar="NAME", help="which scene of a PointNav file (default: the first's)")
    compare.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="change a constant, as often as you like"
    )
    compare.add_argument(
        "--workers", type=int, default=2, metavar="N", help="processes side by side; 0: none (default 2)"
    )
    compare.add_argument("--out", metavar="DIR", help="where to write (default out/compare-<scene>)")
    compare.set_defaults(command=_compare)

    tables = commands.add_parser("tables", help="the paper's tables from saved runs")
    tables.add_argument("runs", nargs="+", metavar="RUN", help="results.json, a run's .npz, or a folder of them")
    tables.add_argument("--format", choices=("text", "csv", "latex"), default="text", help="csv: one line a robot")
    tables.add_argument("--out", type=Path, metavar="DIR", help="also write each table there, and the paper's figures")
    tables.set_defaults(command=_tables)

    bench = commands.add_parser(
        "bench",
        help="how fast every stage is, beside what it replaces",
        description="Time every stage in turns with what it replaces, a few minutes in all; write JSON, and a picture "
        "of cost against splats, pixels and threads beside it. Leave the machine alone meanwhile.",
    )
    bench.add_argument("--out", type=Path, default="bench.json", metavar="FILE", help="the JSON (default bench.json)")
    bench.add_argument(
        "--quick", action="store_true", help="within a minute: few rounds, no cold start and no main job"
    )
    bench.set_defaults(command=_bench)

    grade = commands.add_parser(
        "grade",
        help="handed-in copies of the notebooks: which exercises pass",
        description="Run every notebook below FOLDER, then the course's own checks on it, into a CSV. Copies graded "
        "before with the same content are skipped. This runs students' code with your rights: grade in a container, or "
        "an account of its own.",
    )
    grade.add_argument("folder", metavar="FOLDER", type=Path, help="the handed-in copies, in folders of any layout")
    grade.add_argument("--out", type=Path, default="grades.csv", metavar="FILE", help="the CSV (default grades.csv)")
    grade.add_argument("--limit", type=float, default=120.0, metavar="S", help="seconds a copy may take (default 120)")
    grade.add_argument("--notebooks", type=Path, metavar="DIR", help="the solved notebooks (default: the checkout's)")
    grade.set_defaults(command=_grade)

    doctor = commands.add_parser("doctor", help="what is wrong with this installation, and the remedies")
    doctor.set_defaults(command=_doctor)
    return parser


def _scenes(arguments) -> int:
    from mannbv import world

    found = world.scenes()
    width = max(len(scene.name) for scene in found)
    for scene in found:
        print(f"{scene.name:{width}}  {scene.area:4.0f} m²  {scene.description}")
    return 0


def _compare(arguments) -> int:
    for name, least in (("robots", 1), ("seeds", 1), ("workers", 0)):
        if getattr(arguments, name) < least:
            raise _UsageError(f"compare: --{name} must be at least {least}, got {getattr(arguments, name)}")
    from mannbv import study, team, world

    strategies = None if arguments.strategies == "all" else [s.strip() for s in arguments.strategies.split(",")]
    overrule = {name: getattr(arguments, name) for name in ("up", "scale", "floor", "scenes_dir", "building")}
    place = world.load(arguments.scene, dim=arguments.dim, **overrule)
    config = _config(place.dim, arguments.preset, arguments.set)
    for note in place.notes:
        print(f"{place.name}: {note}", file=sys.stderr)
    out = Path(arguments.out or f"out/compare-{Path(place.name).name}" + "-3d" * (place.dim == 3))  # or "../here"
    n_strategies = len(set(strategies or team.STRATEGIES))
    with study.Meter() as meter:
        outcome = study.compare(
            place, strategies, arguments.seeds, arguments.robots, config, out, arguments.workers, meter
        )
    results = outcome.results
    if results["rows"]:
        _print_tables(results)
        from mannbv import draw

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

    done = [(row["strategy"], row["seed"]) for row in outcome.results["rows"]]
    strategy, seed = min(done, key=lambda run: run[0] != "distributed")
    record = outcome.record(strategy, seed)
    return record, episode.draw_team(place, record.n_robots, seed, record.config)


def _config(dim: int, preset: str, changes: list[str]):
    """A preset's constants for a world of `dim` dimensions, with NAME=VALUE changes.

    Raises ValueError, naming the change and the remedy.
    """
    from mannbv.config import PRESETS as constants
    from mannbv.config import Config

    values = {}
    for change in changes:
        name, equals, text = change.partition("=")
        name = name.strip()
        if name not in Config.__dataclass_fields__ or not equals:
            raise _UsageError(f"--set {change}: give NAME=VALUE with a constant's name, such as --set level=0.05")
        default = getattr(Config(), name)
        try:
            values[name] = type(default)(text.strip())
        except ValueError:
            kind = "a whole number" if isinstance(default, int) else "a number"
            raise _UsageError(f"--set {change}: {name} is {kind}, such as {default}") from None
        if isinstance(default, float) and not math.isfinite(values[name]):
            raise _UsageError(f"--set {change}: {name} must be finite, such as {default:g}")
    return constants[dim][preset].replace(**values)


def _tables(arguments) -> int:
    from mannbv import study

    merged, left_out = study.gather(arguments.runs)
    tables = study.paper_tables(merged)
    if arguments.format == "csv":
        print(study.as_csv(*merged), end="")
    else:
        print("\n\n".join(map({"text": study.as_text, "latex": study.as_latex}[arguments.format], tables)))
    sys.stdout.flush()
    if arguments.out:
        left_out += _write(arguments.runs, tables, arguments.out)
    for line in left_out:
        print(f"mannbv: {line}", file=sys.stderr)
    return 0


def _write(runs: list[str], tables: list, out: Path) -> list[str]:
    """Tables and the paper's figures into a folder; returns a line for each figure that cannot be drawn."""
    from mannbv import draw, study

    files, lacking, figures = study.write(tables, out), [], 0
    runs = study.run_files(runs)
    for name, figure, why in draw.paper_figures(runs):
        if figure is None:
            lacking.append(f"{name}: {why}")
        else:
            figures += 1
            files += [draw.save(figure, out / (name + suffix)) for suffix in (".png", ".svg")]
    lacking += [] if runs else ["no figures: they need the runs (.npz) beside results.json"]
    print(f"Written: {len(tables)} tables and {figures} figures, {len(files)} files in {out}", file=sys.stderr)
    return lacking


def _bench(arguments) -> int:
    out = arguments.out
    if out.suffix != ".json":
        raise _UsageError(f"bench: --out {out} must end in .json; the picture goes beside it as .png")
    from tqdm import tqdm

    from mannbv import bench, draw, study

    out.parent.mkdir(parents=True, exist_ok=True)
    kept = {}

    def keep(report: dict) -> None:
        study.save(report, out)
        kept.update(report)

    with tqdm(total=len(bench.STAGES), file=sys.stderr, disable=None, bar_format="{desc} |{bar}| {elapsed}") as bar:

        def tell(done: int, stage: str, line: str) -> None:
            bar.n = done
            bar.set_description_str(stage)
            if line:
                bar.write(line)  # to standard output, above the bar
                sys.stdout.flush()

        try:
            bench.run(bench.QUICK if arguments.quick else bench.FULL, keep, tell)
        except (KeyboardInterrupt, SystemError) as error:
            if not _interrupted(error):
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


def _grade(arguments) -> int:
    from mannbv import grade

    course = arguments.notebooks or grade.COURSE
    copies, kept = grade.grade(
        arguments.folder, arguments.out, course, arguments.limit, functools.partial(print, flush=True)
    )
    again = f", {kept} of them graded before with the same content" if kept else ""
    print(f"{len(copies)} files{again}: {arguments.out}")
    return 0


def _doctor(arguments) -> int:
    from mannbv import doctor

    return doctor.main()


def _print_tables(results: dict) -> None:
    from mannbv import study

    for table in study.tables(results):
        print(study.as_text(table), end="\n\n")


if __name__ == "__main__":
    sys.exit(main())
