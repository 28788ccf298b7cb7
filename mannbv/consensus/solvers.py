"""Ways to agree on the team's yaws: C-ADMM in its forms, and what it is up against (Section V-C)."""

import dataclasses
import functools
import inspect
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar, Unpack

import networkx as nx
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from mannbv import geometry
from mannbv import network as networks
from mannbv.config import Config, suggesting
from mannbv.consensus import objectives as tables
from mannbv.consensus.cadmm import CADMM, Agreement, Numbers, Outgoing, exchange
from mannbv.consensus.objectives import Objectives

_DEFAULT = Config()


@dataclass(frozen=True, eq=False)
class Round:
    """Where the team stands after a round of messages; angles in [−π, π)."""

    yaws: Float[np.ndarray, " robots"]  # each robot's own yaw [rad]
    copies: Float[np.ndarray, "robots robots"]  # copies[i, k]: robot i's copy of robot k's yaw [rad]
    primal_residual: float = 0.0  # largest of the robots' [rad]
    dual_residual: float = 0.0  # largest of the robots'
    penalty: float = 0.0  # ρ of this round
    states: tuple[Agreement, ...] = ()  # every robot's memory, for C-ADMM


@suggesting("consensus: no setting", "consensus.Settings")
@dataclass(frozen=True)
class Settings:
    """What a solver may need beside the problem. Raises ValueError for impossible values."""

    penalty: float = CADMM.penalty  # ρ, for objectives whose largest value is 1
    growth: float = CADMM.growth  # ρ is multiplied by this each round
    rounds: int = _DEFAULT.rounds  # T_ADMM, rounds of messages at most
    tolerance: float = _DEFAULT.tolerance  # the rounds end when both residuals are smaller
    primal: str | None = None  # "exact", "gradient" or "stochastic"; None: as the solver's name says
    rng: np.random.Generator | None = None  # for solvers that draw
    loss: float = 0.0  # probability that a message is lost (C-ADMM only; needs rng)
    scale: float | None = None  # objectives are divided by this; None: their largest absolute value, 1 for functions
    steps: int = CADMM.steps  # of the primals that take steps
    rate: float = CADMM.rate  # [rad²] of such a step
    bins: int = 36  # of a quantised profile
    bits: int = 8  # of each bin

    def __post_init__(self):
        self.cadmm()
        if self.scale is not None and not 0 < self.scale < np.inf:
            raise ValueError(f"consensus: scale must be positive and finite, got {self.scale}")
        for name in ("rounds", "tolerance"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"consensus: {name} must not be negative, got {getattr(self, name)}")
        if not 0 <= self.loss < 1 or (self.loss and self.rng is None):
            raise ValueError(f"consensus: loss must lie in [0, 1) and needs an rng, got {self.loss} and {self.rng}")

    def cadmm(self, primal: str = "exact", circle: bool = True) -> CADMM:
        """The C-ADMM of these settings; `primal` where they leave it open."""
        primal = self.primal or primal
        seed = (int(self.rng.integers(2**32)),) if primal == "stochastic" and self.rng else ()
        return CADMM(self.penalty, self.growth, primal, circle, self.steps, self.rate, seed)


class Options(Numbers, total=False):
    """The fields of `Settings` for a type checker, which cannot read them off the record."""

    rounds: int
    tolerance: float
    primal: str | None
    rng: np.random.Generator | None
    loss: float
    scale: float | None
    bins: int
    bits: int


Solver = Callable[[Objectives, nx.Graph, np.ndarray, Settings], list[Round] | np.ndarray]  # how one is registered
Solve = TypeVar("Solve", bound=Callable)
Stand = TypeVar("Stand")


def explicit(function: Solve) -> Solve:
    """The function itself; its signature now names the fields of `Settings`, for `help` and completion."""
    signature = inspect.signature(function)
    given = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
    options = [
        inspect.Parameter(f.name, inspect.Parameter.KEYWORD_ONLY, default=f.default, annotation=f.type)
        for f in dataclasses.fields(Settings)
    ]
    vars(function)["__signature__"] = signature.replace(parameters=given + options)
    return function


@explicit
def solve(
    objectives: Objectives, network: nx.Graph, yaws: ArrayLike, solver: str = "cadmm", **settings: Unpack[Options]
) -> list[Round]:
    """The team's yaws that maximise Σ_i F_i, Eq. (25), as a trace of rounds; the last one is the answer.

    objectives: (N, N, M) gains of robot k's view in robot i's map on M uniform yaws of [−π, π), or N functions
    F_i(yaws (N,)). network: a connected networkx graph over robots 0 … N−1. yaws: the announced yaws (N,) [rad], or
    first copies (N, N), whose diagonal counts as announced. solver: a name in SOLVERS. settings: fields of `Settings`.
    Trace element t stands after t rounds of messages. Raises ValueError, in one line, for bad input.
    """
    if solver not in SOLVERS:
        raise ValueError(f"consensus: no solver is called '{solver}'; choose one of {', '.join(SOLVERS)}")
    chosen = Settings(**settings)
    problem = tables.checked(objectives)
    n = len(problem)
    networks.check(network, n)
    first = np.asarray(yaws, float)
    if first.shape not in ((n,), (n, n)) or not np.isfinite(first).all():
        raise ValueError(f"consensus: yaws must be {n} or {n} × {n} finite angles, got {first.tolist()}")
    scale = float(chosen.scale or tables.scale_of(problem))
    scaled = problem / scale if isinstance(problem, np.ndarray) else [tables.Called(f, scale) for f in problem]
    answer = SOLVERS[solver](scaled, network, first, chosen)
    return answer if isinstance(answer, list) else [_alone(_announced(first), np.asarray(answer, float))]


def register(name: str, function: Solver) -> None:
    """Make `solve(…, solver=name)` call function(objectives, network, yaws, settings).

    It gets checked, scaled objectives and a `Settings`, and returns a trace (a list of `Round`) or just N yaws [rad].
    Raises ValueError if the name is one of ours; your own may be registered anew.
    """
    if name in _OURS or not callable(function):
        raise ValueError(f"consensus: cannot register '{name}': the name is one of ours, or it is no function")
    SOLVERS[name] = function


def _announced(yaws: np.ndarray) -> np.ndarray:
    return yaws if yaws.ndim == 1 else np.diagonal(yaws)


def _alone(announced: np.ndarray, yaws: np.ndarray) -> Round:
    """Each robot knows what it chose itself, and of the others only what they had announced."""
    copies = np.tile(announced, (len(yaws), 1))
    np.fill_diagonal(copies, yaws)
    return Round(geometry.wrap(yaws), geometry.wrap(copies))


def _as_table(objectives: Objectives, announced: np.ndarray) -> np.ndarray:
    return objectives if isinstance(objectives, np.ndarray) else tables.tabulate(objectives, announced)


def own(objectives: Objectives, network: nx.Graph, yaws: np.ndarray, settings: Settings) -> list[Round]:
    """Each robot takes the best view for its own map, argmax f_kk; nothing is sent."""
    announced = _announced(yaws)
    diagonal = np.einsum("kkm->km", _as_table(objectives, announced))
    return [_alone(announced, tables.best_yaws(diagonal, announced))]


def optimum(objectives: Objectives, network: nx.Graph, yaws: np.ndarray, settings: Settings) -> list[Round]:
    """The oracle: argmax_ψ Σ_i f_ik(ψ) for every k. For functions a local search from the best of each yaw's sweep."""
    announced = _announced(yaws)
    best = tables.best_yaws(_as_table(objectives, announced).sum(0), announced)
    if not isinstance(objectives, np.ndarray):
        team = tables.Called(lambda psi: sum(f(psi) for f in objectives))
        still = np.zeros(len(best))
        best = max((best, announced), key=team.value)
        best = geometry.wrap(best + team.minimise(best, still, still, 0.0, circle=True))
    return [Round(best, np.tile(best, (len(best), 1)))]


def profile(objectives: Objectives, network: nx.Graph, yaws: np.ndarray, settings: Settings) -> list[Round]:
    """One exchange: each robot gets everyone's f_ik quantised to `bins` × `bits` and takes the best of the sum.

    What C-ADMM is up against: 36 B and a scale a message, no rounds, no step size.
    """
    announced = _announced(yaws)
    table = _as_table(objectives, announced)
    n, _, n_yaws = table.shape
    team = np.einsum("kkm->km", table).copy()  # a robot need not quantise what it keeps
    for i, k in np.ndindex(n, n):
        if i != k:
            team[k] += tables.restore(*tables.quantise(table[i, k], settings.bins, settings.bits), n_yaws)
    return [_alone(announced, tables.best_yaws(team, announced))]


def _cadmm(
    objectives: Objectives, network: nx.Graph, yaws: np.ndarray, settings: Settings, primal: str = "exact",
    circle: bool = True,
) -> list[Round]:  # fmt: skip
    announced = _announced(yaws)
    firsts = np.tile(announced, (len(announced), 1)) if yaws.ndim == 1 else yaws
    return played(settings.cadmm(primal, circle), objectives, network, announced, firsts, settings, _stand)


def played(
    solver: CADMM,
    objectives: np.ndarray | Sequence,
    network: nx.Graph,
    announced: np.ndarray,
    firsts: np.ndarray,
    settings: Settings,
    stand: Callable[[list[Agreement], tuple[float, float], float], Stand],
) -> list[Stand]:
    """C-ADMM from first copies (N, N), its messages in memory: stand(states, largest residuals, ρ) after each round."""

    def deliver(outbox: list[Outgoing]) -> dict[int, dict]:
        inboxes = defaultdict(dict)
        for note in sorted(outbox, key=lambda note: (note.receiver, note.sender)):
            if not (settings.rng and settings.loss and settings.rng.random() < settings.loss):
                inboxes[note.receiver][note.sender] = note.offsets
        return inboxes

    team = [
        solver.start(i, networks.neighbours(network, i), announced, objectives[i], copies=firsts[i])
        for i in range(len(objectives))
    ]
    trace, penalty = [], float(solver.penalty)
    for states in exchange(solver, team, deliver, settings.rounds, settings.tolerance):
        residuals = max(s.primal_residual for s in states), max(s.dual_residual for s in states)
        trace.append(stand(states, residuals, penalty))
        penalty = states[0].penalty
    return trace


def _stand(states: list[Agreement], residuals: tuple[float, float], penalty: float) -> Round:
    yaws, copies = np.array([s.yaw for s in states]), np.stack([s.yaws for s in states])
    return Round(yaws, copies, residuals[0], residuals[1], penalty, tuple(states))


SOLVERS: dict[str, Solver] = {
    "cadmm": _cadmm,
    "cadmm-gradient": functools.partial(_cadmm, primal="gradient"),
    "cadmm-stochastic": functools.partial(_cadmm, primal="stochastic"),  # the paper's primal update
    "cadmm-literal": functools.partial(_cadmm, circle=False),  # shows what goes wrong at ±π
    "profile": profile,
    "own": own,
    "optimum": optimum,
}
_OURS = frozenset(SOLVERS)
