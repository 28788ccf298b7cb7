"""Every exercise of every notebook: the right answers pass, and each mistake hears its own hint and no other."""

import ast
import dis
import importlib
import json
import math
import re
from pathlib import Path
from types import CodeType

import numpy as np
import pytest
import torch
from IPython.core.inputtransformer2 import TransformerManager
from scipy import ndimage, optimize, sparse, stats
from scipy.spatial.transform import Rotation

from mannbv import consensus, geometry, grid, mapping, planner, render, risk, splats
from mannbv.camera import Camera, Frame
from mannbv.config import Config
from mannbv.course import check
from mannbv.course.check.verdict import AGREES, TO_DO, Exercise, Judged
from mannbv.splats import SplatMap

NOTEBOOKS = {path.stem[3:]: path for path in sorted(Path(__file__).parents[1].glob("notebooks/[0-9]*.ipynb"))}
ROOMS = {name: importlib.import_module(f"mannbv.course.check.{name}") for name in NOTEBOOKS}
EXERCISES = {
    f"{room}.{name}": exercise
    for room, module in ROOMS.items()
    for name, exercise in vars(module).items()
    if isinstance(exercise, Exercise | Judged)
}
everywhere = pytest.mark.parametrize("name", EXERCISES)


def said_of(capsys, exercise, *mine) -> tuple[bool, str]:
    """Whether an answer is done, and the one line that it hears."""
    done = exercise(*mine)
    said = capsys.readouterr().out
    assert said.endswith("\n") and said.count("\n") == 1 and isinstance(done, bool)
    return done, said[:-1]


def replayed(values: list):
    """An answer that gives these values, one a call."""
    rest = iter(values)
    return lambda *case: next(rest)


def functions(answer) -> tuple:
    return answer if isinstance(answer, tuple) else (answer,)


def pattern(hint: str) -> str:
    """A hint of which the {fields} are filled in."""
    return ".*".join(map(re.escape, re.split(r"\{.+?\}", hint)))


# --- what holds for all -----------------------------------------------------------------------------------------------


def test_each_module_is_of_a_notebook_and_has_its_exercises():
    modules = {path.stem for path in Path(check.__file__).parent.glob("*.py")}
    assert modules - {"__init__", "verdict"} == set(NOTEBOOKS)
    for room, path in NOTEBOOKS.items():
        asked = re.findall(r"done = check\.(\w+)\(", path.read_text(encoding="utf-8"))
        assert {f"{room}.{name}" for name in asked} == {name for name in EXERCISES if name.startswith(f"{room}.")}


@everywhere
def test_the_truth_passes(name, capsys):
    exercise = EXERCISES[name]
    if isinstance(exercise, Judged):
        done, said = said_of(capsys, exercise, *functions(exercise.truth))
        assert done and re.fullmatch(pattern(exercise.praise), said)
    else:
        words, values = next(exercise.rows(exercise.drawn()))
        assert words == AGREES
        assert said_of(capsys, exercise, replayed(values)) == (True, AGREES)


@everywhere
def test_each_mistake_hears_its_own_hint_and_no_other(name, capsys):
    exercise = EXERCISES[name]
    if isinstance(exercise, Judged):
        for answer, hint, _ in exercise.mistakes:
            done, said = said_of(capsys, exercise, *functions(answer))
            fits = {other.hint for other in exercise.mistakes if re.fullmatch(pattern(other.hint), said)}
            assert (done, fits) == (False, {hint}), said
        assert len(exercise.mistakes) >= 3
    else:
        _, *wrong = exercise.rows(exercise.drawn())
        for hint, values in wrong:
            assert said_of(capsys, exercise, replayed(values)) == (False, hint)
        assert len(wrong) >= 3


def defined(cells: list[ast.Module]) -> dict[str, ast.stmt]:
    """The statement that first defines a name, in the notebook's order."""
    found = {}
    for node in (node for cell in cells for node in cell.body):
        stored = [n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]
        imported = [a.asname or a.name for a in getattr(node, "names", [])]
        for name in [node.name] if isinstance(node, ast.FunctionDef) else stored + imported:
            found.setdefault(name, node)
    return found


def globals_of(code: CodeType) -> set[str]:
    """The names of a notebook that a statement, and what it defines, looks up."""
    inner = [globals_of(part) for part in code.co_consts if isinstance(part, CodeType)]
    looked_up = {step.argval for step in dis.get_instructions(code) if step.opname in ("LOAD_GLOBAL", "LOAD_NAME")}
    return looked_up.union(*inner)


def solution(path: Path, name: str) -> list:
    """The stored answers to an exercise of a notebook, with no more of the notebook run than they need."""
    cells = [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    sources = ["".join(cell["source"]) for cell in cells]
    known = defined([ast.parse(TransformerManager().transform_cell(source)) for source in sources])
    asked = next(re.search(rf"done = check\.{name}\((.+)\)", s) for s in sources if f"check.{name}(" in s)[1]
    space = {}

    def bring(name: str) -> None:
        if name in known:
            code = compile(ast.Module([known.pop(name)], []), path.name, "exec")
            for needed in globals_of(code):
                bring(needed)
            exec(code, space)

    answers = asked.split(", ")
    for answer in answers:
        bring(answer)
    return [space[answer] for answer in answers]


@everywhere
def test_the_stored_solution_of_the_notebook_passes(name, capsys):
    room, exercise = name.split(".")
    done, said = said_of(capsys, EXERCISES[name], *solution(NOTEBOOKS[room], exercise))
    assert done and re.fullmatch(pattern(getattr(EXERCISES[name], "praise", AGREES)), said)


@everywhere
@pytest.mark.parametrize("nothing", [None, ...])
def test_an_empty_answer_is_to_do(name, nothing, capsys):
    exercise = EXERCISES[name]
    mine = [lambda *case: nothing] * len(functions(getattr(exercise, "truth", 0)))
    assert said_of(capsys, exercise, *mine) == (False, TO_DO)


RUBBISH = {
    "a word": "three", "a dictionary": {"yaw": 1}, "an object": object(), "a function": max, "a complex number": 1j,
    "no two rows alike": [[1.0], [1.0, 2.0]], "no number": math.nan, "an array of another shape": np.ones((7, 5)),
    "an empty array": np.zeros(0), "too large": 1e300, "a tensor": torch.ones(2, 2, 2), "a list of words": ["a", "b"],
}  # fmt: skip


@everywhere
def test_an_answer_that_stops_or_gives_rubbish_hears_a_sentence(name, capsys):
    exercise = EXERCISES[name]
    for answer in RUBBISH.values():
        mine = [lambda *case, answer=answer: answer] * len(functions(getattr(exercise, "truth", 0)))
        done, said = said_of(capsys, exercise, *mine)
        assert not done and 0 < len(said) < 200 and said != TO_DO
    done, said = said_of(capsys, exercise, *[lambda *case: 1 / 0] * len(mine))
    assert not done and said.startswith("it stops with ZeroDivisionError: division by zero")


# --- what an exercise says beside its hints --------------------------------------------------------------------------

TRIPLE = Exercise(lambda x: {AGREES: 3 * x, "the sign": -3 * x}, [(1.0,), (2.0,)])


@pytest.mark.parametrize(
    ("mine", "words"),
    [
        (lambda x: 3 * x, AGREES),
        (lambda x: torch.as_tensor(3.0 * x), AGREES),
        (lambda x: torch.tensor([3.0 * x], requires_grad=True)[0], AGREES),
        (lambda x: -3 * x, "the sign"),
        (lambda x: 3 * x + 1, "too large for x = 1"),
        (lambda x: 3 * x - (x > 1), "too small for x = 2"),
        (lambda x: np.array([3 * x]), "shape (1,) where one number is wanted"),
        (lambda x: math.nan, "not finite for x = 1"),
        (lambda x: 3 * x if x < 2 else math.inf, "not finite for x = 2"),
        (lambda x: 3 / (x - 1), "it stops with ZeroDivisionError: float division by zero (for x = 1)"),
        (lambda x: 3 * x if x < 2 else None, "it returns nothing for x = 2"),
        (lambda x: [torch.tensor([x, x], requires_grad=True)], "a number or an array is wanted, got list"),
        (lambda x: "three", "a number or an array is wanted, got str"),
    ],
)
def test_a_verdict_names_what_is_wrong_and_never_the_answer(capsys, mine, words):
    assert said_of(capsys, TRIPLE, mine) == (words == AGREES, words)


def test_what_an_answer_prints_comes_first_and_one_that_only_prints_hears_that_it_returns_nothing(capsys):
    assert TRIPLE(lambda x: print("here") or 3 * x)
    assert capsys.readouterr().out == "here\nhere\nagrees with the library\n"
    assert not TRIPLE(lambda x: print(3 * x))
    assert capsys.readouterr().out == "3.0\nto do (it prints, but returns nothing: None)\n"


@pytest.mark.parametrize(
    ("case", "place"),
    [
        ((0.25, [1, 2]), "for first = 0.25, second = [1, 2]"),
        ((torch.tensor([0.1, -1.6]), 3), "for first = [0.1, -1.6], second = 3"),
        ((np.eye(2), 3), "in case 1 of 1"),
        ((np.arange(40), 3), "in case 1 of 1"),
        (("a word", 3), "in case 1 of 1"),
    ],
)
def test_a_case_is_named_by_its_inputs_where_they_are_short(capsys, case, place):
    two = Exercise(lambda *_: {AGREES: 2.0}, [case])
    assert said_of(capsys, two, lambda first, second: 1.0) == (False, f"too small {place}")
    short = Exercise(lambda *_: {AGREES: 2.0}, [(0.25, 3)])
    assert said_of(capsys, short, lambda *inputs: 1.0) == (False, "too small for 0.25, 3")


def test_of_many_entries_the_one_that_is_farthest_off_is_named(capsys):
    wanted = np.array([[1.0, np.inf], [3.0, 4.0]])
    exercise = Exercise(lambda: {AGREES: wanted}, [()])
    assert said_of(capsys, exercise, lambda: wanted) == (True, AGREES)  # inf where inf is wanted
    off = np.array([[0, 0], [0.1, -2]])
    assert said_of(capsys, exercise, lambda: wanted + off) == (False, "entry (1, 1) is too small in case 1 of 1")
    finite = Exercise(lambda: {AGREES: np.eye(2)}, [()])
    assert said_of(capsys, finite, lambda: wanted) == (False, "not finite in case 1 of 1")


@pytest.mark.parametrize(
    "case", [np.array([1.0, 2.0]), torch.tensor([3.0, 4.0]), [5.0, 6.0]], ids=["numpy", "torch", "list"]
)
def test_an_answer_that_writes_into_its_input_is_judged_by_what_was_asked(capsys, case):
    def emptied(x):
        x[0] = x[1] = 0.0
        return x

    double = Exercise(lambda x: {AGREES: np.asarray(x) * 2}, [(case,)])
    assert not said_of(capsys, double, emptied)[0]  # else the truth would be 0 too
    assert said_of(capsys, double, lambda x: np.asarray(x) * 2) == (True, AGREES)


def zone(reach):
    """Splats that reach so far into a ball, by another way than the table's."""
    return lambda m, path, radii: (torch.cdist(m.means, path) <= radii + reach * m.scales.amax(1)[:, None]).any(1)


def cells(free, source, cell, structure=None):
    """Distances grown ring by ring."""
    distance, reached, step = np.full(free.shape, np.inf), np.zeros(free.shape, bool), 0.0
    reached[tuple(source)] = True
    while step <= free.size:
        distance[reached & np.isinf(distance)] = step * cell
        reached, step = reached | (ndimage.binary_dilation(reached, structure) & free), step + 1
    return distance


def over_corners(free, source, cell):
    """A diagonal step its true length, even between two walls."""
    at = np.argwhere(free)
    away = np.linalg.norm(at[:, None] - at, axis=-1)
    distance = np.full(free.shape, np.inf)
    start = int((at == source).all(1).argmax())
    distance[free] = cell * sparse.csgraph.dijkstra(np.where(away < 1.5, away, 0.0), indices=start)
    return distance


def turned(axis, yaw):
    x, y, z, w = Rotation.from_euler(axis, yaw).as_quat()
    return w, x, y, z


def differences(f, yaw, step):
    return (f(yaw + step) - f(yaw - step)) / (2 * step)


def placed(factor_pixel, factor_std):
    return lambda p, d, s, c: solution(NOTEBOOKS["camera"], "place")[0](factor_pixel * p, d, factor_std * s, c)


# answers that fit no hint, and other right ones; the right ones by scipy where it has one
OTHERS = [
    ("start.avar", lambda m, s, level: m - s * stats.norm.pdf(stats.norm.ppf(level)) / level, AGREES),
    ("start.radius", lambda alpha: 0.51 + math.exp(-2 * alpha), "too large for alpha = -0.1"),
    ("start.radius", lambda alpha: 0.5 + math.exp(-2 * max(alpha, 0.0)), "too small for alpha = -0.1"),
    ("splats.size", lambda n, dim: n * {2: 40, 3: 56}[dim], AGREES),  # 56 B as in the paper's tables
    ("splats.union", lambda a, b: splats.union(a, b),
     "that is `splats.union` itself: join the five tables on your own"),
    ("splats.union", lambda a, b: SplatMap(*map(torch.cat, zip(a.tensors(), b.tensors(), b.tensors(), strict=True))),
     "shape (60,) where (40,) is wanted"),
    ("splats.union", lambda a, b: [a, b], "a SplatMap is wanted, got list"),
    ("splats.pillar", lambda c, r, n: SplatMap.empty(3), "0 splats where 24 are wanted"),
    ("camera.place", placed(2, 1), "the place is too large for pixel 32 of 64, 2 m ahead, 3 px wide, in case 1 of 3"),
    ("camera.place", placed(1, 2), "the size is too large for pixel 32 of 64, 2 m ahead, 3 px wide, in case 1 of 3"),
    ("information.measure", lambda F, H: torch.trace(F @ torch.linalg.inv(F + H)), "behaves like a worth"),
    ("information.measure", lambda F, H: torch.linalg.eigvals(torch.linalg.solve(H, F)).real.max(),
     "behaves like a worth"),
    ("information.measure", lambda F, H: 0.5 * torch.trace(torch.linalg.solve(H, F)),
     "behaves like a worth, but it is Eq. (5) itself: now find another"),
    ("risk.culprit", lambda *case: np.zeros(8), "another splat at the point (0.8, 0.1) in case 1 of 2"),
    ("risk.culprit", lambda *case: np.full(8, 0.5), "not the index of a splat, somewhere in case 1 of 2"),
    ("risk.along", lambda cov, mean, at: np.linalg.norm(np.linalg.cholesky(cov).T @ (at - mean) / math.dist(at, mean)),
     AGREES),
    ("risk.measure", risk.average_value_at_risk,
     "a risk measure: farther is safer, surer is safer, rarer is worse"),
    ("risk.measure", lambda mean, std, level: mean - math.expm1(std) / level,
     "a risk measure: farther is safer, surer is safer, rarer is worse; but it takes numbers only: to steer a team, "
     "write it for tensors"),
    ("masks.body", zone(2), AGREES),
    ("masks.body", zone(9), "splat 5 is in, though it reaches into no ball, in case 1 of 2"),
    ("masks.body", zone(1.2), "splat 4 is missing in case 1 of 2"),
    ("masks.walk", cells, AGREES),
    ("masks.walk", over_corners,
     "only the four sides count, but a diagonal step led to the cell (1, 1) in case 1 of 2"),
    ("masks.walk", lambda free, source, cell: cells(free, source, cell / 2),
     "too small at the cell (0, 1), seen from (0, 0), in case 1 of 2"),
    ("masks.walk", lambda *case: np.nan_to_num(cells(*case), posinf=-1.0),
     "too near: no way leads from (0, 0) to the cell (0, 2) in case 1 of 2"),
    ("masks.walk", lambda free, *rest: cells(free & (np.arange(len(free)) < 3)[:, None], *rest),
     "not infinitely far: a way leads from (0, 0) to the cell (3, 0) in case 1 of 2"),
    ("masks.bounded", lambda alpha: 2.0 if alpha < 0 else 0.5,
     "a mask radius: it never grows with α and keeps within its bounds, so Proposition 2 holds for it"),
    ("one_view.maxima", lambda g: 0, "too small for g = [3, 1, 2, 0, 1, 0]"),
    ("one_view.slope", lambda f, yaw: f(yaw + 1e-4) - f(yaw - 1e-4),
     "that is a difference: over which angle? in case 1 of 3"),
    ("one_view.slope", lambda f, yaw: 0.9 * differences(f, yaw, 1e-4), "not steep enough in case 1 of 3"),
    ("one_view.slope", lambda f, yaw: 1.3 * differences(f, yaw, 1e-4), "too steep in case 1 of 3"),
    ("one_view.slope", lambda f, yaw: differences(f, yaw, 0.0873),
     "the places are too far apart: the landscape bends within 0.17 rad, in case 1 of 3"),
    ("one_view.slope", lambda f, yaw: (f(yaw + 1e-17) - f(yaw)) / 1e-17,
     "so small a step is lost in rounding, in case 1 of 3"),
    ("paths.frontier", lambda s: (s == 0) & np.any([np.roll(s == -1, k, axis) for k in (1, -1) for axis in (0, 1)], 0),
     "over the edge: to np.roll the last row is a neighbour of the first, to a robot it is not"),
    ("one_robot.paired", lambda a, b: interval(a, b), AGREES),
    ("team_problem.look", lambda: (2.5, 0.0),
     "three finite numbers are wanted, x [m], y [m], yaw [rad]; got shape (2,)"),
    ("team_problem.look", lambda: (-0.9, 0.05, 0.1),
     "robot 0 stands there: from where else does a camera see the same of the splat?"),
    ("consensus.slope", lambda t, g, z, y, r: -g + (y + r * (t - z)), "shape (2, 3) where (3,) is wanted"),
    ("into_3d.quaternion", lambda yaw: turned("z", yaw), AGREES),
    ("into_3d.quaternion", lambda yaw: np.negative(turned("z", yaw)), AGREES),  # the same rotation
    ("into_3d.quaternion", lambda yaw: turned("x", yaw),
     "that turns about x, and would tip the splat over: the vertical is z"),
    ("into_3d.quaternion", lambda yaw: np.multiply(2, turned("z", yaw)), "entry 0 is too large for yaw = 0.4"),
    ("into_3d.body", lambda m, *case: m.means[:, 2] > 9, "splat 1 should be chosen in case 1 of 2"),
    ("into_3d.body", lambda m, *case: m.means[:, 2] > -9, "splat 0 should not be chosen in case 1 of 2"),
    ("into_3d.parameters", lambda dim: len(np.triu_indices(dim)[0]) + dim + 4, AGREES),  # Σ as a symmetric matrix
    ("gibson_episode.paired", lambda a, b: interval(a, b), AGREES),
    ("gibson_episode.order", lambda a, b: stats.kendalltau(a, b)[0], AGREES),
]  # fmt: skip


def interval(a, b):
    low, high = stats.ttest_rel(a, b).confidence_interval(0.95)
    return (low + high) / 2, (high - low) / 2


@pytest.mark.parametrize(("name", "mine", "words"), OTHERS, ids=[name for name, *_ in OTHERS])
def test_other_answers_hear_how_they_differ_or_that_they_agree(name, mine, words, capsys):
    assert said_of(capsys, EXERCISES[name], mine)[1] == words


# --- truths that are not the library's own, against it ---------------------------------------------------------------


def true(name, *case):
    return EXERCISES[name].table(*case)[AGREES]


def test_the_placed_splat_the_weights_and_the_loss_are_the_renderers_and_the_mappings(rng):
    camera, pose = Camera.from_fov(64), geometry.yaw_pose(torch.zeros(2, dtype=torch.float64), 0.0)
    x, scale = true("camera.place", 10.0, 1.5, 2.0, camera)
    spot = SplatMap(*(torch.tensor(t, dtype=torch.float64) for t in (
        [[1.5, -x], [3.0, 0.2]], [[math.log(scale)] * 2, [-1.0, -2.0]], [[1.0, 0.0], [0.6, 0.8]], [0.0, 2.0],
        [[0.2, 0.5, 0.9], [0.7, 0.1, 0.3]],
    )))  # fmt: skip
    drawn = render.compose(spot, camera, pose)
    pixels = camera.pixels(spot.means)[:, 0]
    assert torch.allclose(drawn.blend[0], 0.5 * torch.exp(-((pixels - 10.0) ** 2) / (2 * 2.0**2)))
    assert torch.allclose(drawn.weight[:, 20], true("camera.weights", drawn.blend[:, 20]))
    image = render.render(spot, camera, pose)
    depth = torch.from_numpy(rng.uniform(1, 2, 64)) * (torch.arange(64) > 5)
    frame = Frame(torch.from_numpy(rng.uniform(0, 1, (64, 3))), depth, pose)
    wanted = mapping.loss(spot, camera, frame, 0.5)
    assert torch.allclose(true("camera.loss", image.color, frame.color, image.depth, depth, 0.5), wanted)


def test_the_price_is_the_planners():
    config = Config(risk_weight=5.0, risk_scale=0.4)
    lattice = grid.Lattice((0.0, 0.0), 0.1, (20, 3))
    rotation = geometry.identity_rotations(1, 2)
    one = SplatMap(torch.zeros(1, 2), torch.full((1, 2), -3.0), rotation, torch.zeros(1), torch.zeros(1, 3))
    priced = planner.prices(one, lattice, np.ones(lattice.shape, bool), np.zeros(0), config)
    alpha = risk.field(one, torch.from_numpy(lattice.centers().reshape(-1, 2)), config.level).double().numpy()
    assert np.allclose(priced.ravel(), true("paths.price", alpha, 5.0, 0.4), rtol=1e-5)


def test_consensus_residuals_are_the_solvers_and_z_and_slope_those_of_the_lagrangian(rng):
    state = consensus.start(0, [1, 2], rng.uniform(-3, 3, 3), rng.normal(size=(3, 24)), penalty=0.4)
    for _ in range(2):
        before, state = state, consensus.step(state, {1: rng.normal(size=3), 2: rng.normal(size=3)})
    residuals = state.primal_residual, state.dual_residual
    assert true("consensus.residuals", state.agreed, state.edge, before.edge, before.penalty) == pytest.approx(
        residuals
    )
    *link, rho = rng.normal(size=4), abs(rng.normal())
    a, b, p, q = link[0]

    def energy_of_link(z):  # the terms of Eq. (26) that hold it
        return p * (a - z) + rho / 2 * (a - z) ** 2 + q * (b - z) + rho / 2 * (b - z) ** 2

    assert true("consensus.edge", a, b, p, q, rho) == pytest.approx(
        optimize.minimize_scalar(energy_of_link).x, abs=1e-6
    )
    copies, gain, edge, dual = rng.normal(size=3), rng.normal(size=3), rng.normal(size=(2, 3)), rng.normal(size=(2, 3))

    def energy(t):  # what Eq. (27) minimises, for F = gain · T
        return -gain @ t + (dual * (t - edge)).sum() + rho / 2 * ((t - edge) ** 2).sum()

    found = optimize.approx_fprime(copies, energy, 1e-7)
    np.testing.assert_allclose(true("consensus.slope", copies, gain, edge, dual, rho), found, atol=1e-5)


def test_the_general_z_forgives_any_first_duals_and_the_mean_does_not(rng):
    wish, weight, first = rng.normal(size=2), rng.uniform(0.5, 2, 2), rng.normal(size=2)
    best = (weight * wish).sum() / weight.sum()

    def reached(middle):
        z, dual = 0.0, first
        for _ in range(200):
            copies = (weight * wish + z - dual) / (weight + 1)  # Eq. (27) with a penalty of 1
            z = middle(*copies, *dual, 1.0)
            dual = dual + copies - z
        return copies

    np.testing.assert_allclose(reached(lambda *case: true("consensus.edge", *case)), best, atol=1e-9)
    assert np.abs(reached(lambda a, b, p, q, r: (a + b) / 2) - best).min() > 0.05


def test_made_up_gains_hold_less_in_the_maps_of_teammates(rng):
    gains, own = ROOMS["consensus"].hilly(rng, 6), np.eye(6, dtype=bool)
    assert gains.shape == (6, 6, 72) and gains.min() > 0
    assert gains[own].mean() > 1.5 * gains[~own].mean()
