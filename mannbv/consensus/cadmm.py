"""C-ADMM, Eqs. (26)-(29): a solver object, what a robot remembers between rounds, and the exchange (Section V-C).

Copies are real offsets from the yaw each owner announced and start at 0, so that sums and means are those of ℝᴺ as
Remark 1 asks, yet the yaws live on a circle: 3.1 and −3.1 meet at π, and wrapping happens only in what is read off.
"""

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple, TypedDict, Unpack

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from mannbv import geometry
from mannbv.config import Config, suggesting
from mannbv.consensus.objectives import TIE, Called, Function, Tabulated

PRIMALS = ("exact", "gradient", "stochastic")
_DEFAULT = Config()


class Outgoing(NamedTuple):
    """What one robot tells a neighbour in a round."""

    sender: int
    receiver: int
    round: int  # rounds that the sender has behind it
    offsets: Float[np.ndarray, " robots"]  # its copies, T^(i), as offsets from the announced yaws [rad]


@dataclass(frozen=True, eq=False)
class Agreement:
    """What robot i remembers between two rounds; each row of `edge` and `dual` belongs to one neighbour.

    copies (N,): T^(i), to be sent next, as offsets from `origin` [rad]. agreed (N,): those sent last, from which
    `edge`, `dual` and the residuals come; they are the answer when the rounds end here. (In `twists` the N numbers
    are all robots' coordinates, N·k of them, and `yaws` means nothing.)
    """

    robot: int
    neighbours: tuple[int, ...]
    objective: Tabulated | Called
    origin: Float[np.ndarray, " robots"]  # announced yaws; zeros in the literal form
    copies: Float[np.ndarray, " robots"]
    agreed: Float[np.ndarray, " robots"]
    edge: Float[np.ndarray, "neighbours robots"]  # z_ij, Eq. (28)
    dual: Float[np.ndarray, "neighbours robots"]  # λ_ij, Eq. (29)
    penalty: float  # ρ of the next round
    round: int = 0
    primal_residual: float = float("inf")  # max over neighbours and yaws of |T^(i) − z_ij| [rad]
    dual_residual: float = float("inf")  # max over neighbours and yaws of ρ |z_ij − previous z_ij|

    @property
    def yaws(self) -> Float[np.ndarray, " robots"]:
        """This robot's copy of everyone's yaw [rad], in [−π, π)."""
        return geometry.wrap(self.origin + self.agreed)

    @property
    def yaw(self) -> float:
        """T_i* of Algorithm 1: the yaw this robot is to take [rad]."""
        return float(self.yaws[self.robot])

    @property
    def outbox(self) -> list[Outgoing]:
        """What this robot sends next: its copies to each neighbour."""
        return [Outgoing(self.robot, j, self.round, self.copies) for j in self.neighbours]


class Numbers(TypedDict, total=False):
    """Fields of `CADMM`, for a type checker."""

    penalty: float
    growth: float
    steps: int
    rate: float


class Options(Numbers, total=False):
    """All of them."""

    primal: str
    circle: bool
    seed: tuple[int, ...]


@suggesting("consensus: no setting", "consensus.CADMM")
@dataclass(frozen=True)
class CADMM:
    """How all robots of a team solve; `start` and `step` are one robot's. Raises ValueError for impossible values.

    circle=False is the paper's literal arithmetic on numbers in [−π, π].
    """

    penalty: float = _DEFAULT.penalty  # ρ at first, for objectives whose largest value is 1
    growth: float = _DEFAULT.penalty_growth  # ρ is multiplied by this each round
    primal: str = "exact"  # Eq. (27): global on tables and BFGS on functions; or steps, "gradient" or "stochastic"
    circle: bool = True
    steps: int = _DEFAULT.primal_steps  # of the primals that take steps
    rate: float = _DEFAULT.primal_rate  # [rad²] of such a step
    seed: tuple[int, ...] = ()  # with a robot's number and its round it says what the stochastic primal draws

    def __post_init__(self):
        for name in ("penalty", "growth", "rate"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"consensus: {name} must be positive and finite, got {getattr(self, name)}")
        if not self.steps >= 0:
            raise ValueError(f"consensus: steps must not be negative, got {self.steps}")
        if self.primal not in PRIMALS:
            choices = ", ".join(PRIMALS)
            raise ValueError(f"consensus: no primal update is called '{self.primal}'; choose one of {choices}")

    def start(
        self,
        robot: int,
        neighbours: Iterable[int],
        announced: ArrayLike,
        objective: ArrayLike | Function,
        *,
        scale: float = 1.0,
        copies: ArrayLike | None = None,
    ) -> Agreement:
        """Robot i before anything was exchanged: z = first copies, λ = 0, and the first primal update (27).

        announced: everyone's announced yaw (N,) [rad]. objective: robot i's gains (N, M) on M uniform yaws of [−π, π),
        or a function of the N yaws, to be called with unwrapped ones. scale divides it; all robots must use the same
        one (`scale_of`). copies: other first copies (N,) [rad] than the announced yaws. Raises ValueError for wrong
        shapes and values.
        """
        known = np.asarray(announced, float)
        n = len(known)
        first = known if copies is None else np.asarray(copies, float)
        if not scale > 0:
            raise ValueError(f"consensus: scale must be positive, got {scale}")
        if callable(objective):
            own = Called(objective, float(scale))
        else:
            gains = np.asarray(objective, float)
            if gains.ndim != 2 or len(gains) != n or gains.shape[1] < 4 or not np.isfinite(gains).all():
                raise ValueError(f"consensus: robot {robot} needs finite gains (N, M ≥ 4), N = {n}; got {gains.shape}")
            own = Tabulated(gains / scale)
        if known.ndim != 1 or first.shape != (n,) or not np.isfinite([known, first]).all():
            raise ValueError(f"consensus: robot {robot} needs a finite yaw of each robot, got {known} and {first}")
        origin = known if self.circle else np.zeros(n)
        first = geometry.wrap(first - origin)
        others = tuple(sorted(int(j) for j in neighbours))
        edge, dual = np.tile(first, (len(others), 1)), np.zeros((len(others), n))
        residual = float("inf") if others else 0.0
        state = Agreement(
            int(robot), others, own, origin, first, first, edge, dual, float(self.penalty),
            primal_residual=residual, dual_residual=residual,
        )  # fmt: skip
        copies = self._primal(state, edge, dual, state.penalty, 1)
        return dataclasses.replace(state, copies=copies, agreed=copies)

    def step(self, state: Agreement, inbox: Mapping) -> Agreement:
        """One round of robot i: z (28) and dual (29) from its neighbours' copies, then the next primal update (27).

        inbox: neighbour → the copies (N,) that it sent this round. A neighbour that is absent (its message was lost)
        keeps its old z and λ. If only one direction of a link fails, its two ends' duals no longer cancel, and the
        agreement that follows is a little off the optimum. Raises ValueError for a stranger's message or one of the
        wrong shape.
        """
        edge, dual = state.edge.copy(), state.dual.copy()
        for sender, theirs in inbox.items():
            if sender not in state.neighbours:
                raise ValueError(f"consensus: robot {state.robot} has no link to robot {sender}, yet a message from it")
            theirs = np.asarray(theirs, float)
            if theirs.shape != state.copies.shape or not np.isfinite(theirs).all():
                raise ValueError(f"consensus: robot {sender} sent {theirs.shape} copies or some that are not finite")
            row = state.neighbours.index(sender)
            edge[row] = (state.copies + theirs) / 2  # the same bits at both ends
            dual[row] += state.penalty * (state.copies - theirs) / 2  # T − z, and exactly opposite at the other end
        penalty = state.penalty * self.growth
        return dataclasses.replace(
            state,
            copies=self._primal(state, edge, dual, penalty, state.round + 2),
            agreed=state.copies,
            edge=edge,
            dual=dual,
            penalty=penalty,
            round=state.round + 1,
            primal_residual=float(np.abs(state.copies - edge).max(initial=0.0)),
            dual_residual=float(state.penalty * np.abs(edge - state.edge).max(initial=0.0)),
        )

    def _primal(self, state: Agreement, edge: np.ndarray, dual: np.ndarray, penalty: float, time: int) -> np.ndarray:
        """Eq. (27): argmin of −F(T) + Σ_j λ_ijᵀ(T − z_ij) + ρ/2 Σ_j ‖T − z_ij‖².

        The terms of the neighbours are one quadratic: its stiffness is ρ times their number, its centre the mean of z
        less Σ_j λ_ij over the stiffness. A stochastic step looks at one of the N terms f_ik of F, drawn anew, and takes
        its slope N times, which is right on average; steps grow shorter by √time, else they would never settle.
        time: how often this robot has come here.
        """
        stiffness, center = TIE, state.copies
        if state.neighbours:
            stiffness = penalty * len(state.neighbours)
            center = edge.mean(0) - dual.sum(0) / stiffness
        if self.primal == "exact":
            return state.objective.minimise(state.origin, state.copies, center, stiffness, self.circle)
        offsets, n, rate, shares = state.copies, len(state.copies), self.rate, np.ones((self.steps, 1))
        if self.primal == "stochastic":
            rng = np.random.default_rng([*self.seed, state.robot, time])
            rate, shares = rate / np.sqrt(time), n * np.eye(n)[rng.integers(n, size=self.steps)]
        for share in shares:
            ascent = share * state.objective.gradient(state.origin + offsets) - stiffness * (offsets - center)
            offsets = offsets + rate / (1 + rate * stiffness) * ascent  # damped: stable for any penalty
            offsets = offsets if self.circle else np.clip(offsets, -np.pi, np.pi)
        return offsets


def exchange(
    solver: CADMM,
    states: list[Agreement],
    deliver: Callable[[list[Outgoing]], Mapping[int, Mapping]],
    rounds: int = _DEFAULT.rounds,
    tolerance: float = _DEFAULT.tolerance,
) -> Iterator[list[Agreement]]:
    """The rounds of messages: yields the robots' states at first and after each round, until all residuals are small.

    deliver(outbox) → inboxes carries a round's messages, and alone decides who hears what: robot → sender → offsets.
    """
    yield states
    while rounds > 0 and max(max(s.primal_residual, s.dual_residual) for s in states) >= tolerance:
        inboxes = deliver([note for state in states for note in state.outbox])
        states = [solver.step(state, inboxes.get(state.robot, {})) for state in states]
        rounds -= 1
        yield states


@dataclass(frozen=True, eq=False)
class Started(Agreement):
    """What `start` gives to play rounds by hand: it remembers the solver, so that `step` needs but an inbox."""

    solver: CADMM = CADMM()


def start(
    robot: int,
    neighbours: Iterable[int],
    announced: ArrayLike,
    objective: ArrayLike | Function,
    *,
    scale: float = 1.0,
    copies: ArrayLike | None = None,
    **settings: Unpack[Options],
) -> Started:
    """`CADMM(**settings).start(…)`, for rounds played by hand."""
    solver = CADMM(**settings)
    state = solver.start(robot, neighbours, announced, objective, scale=scale, copies=copies)
    return Started(**vars(state), solver=solver)


def step(state: Agreement, inbox: Mapping, solver: CADMM | None = None) -> Agreement:
    """One robot's round, `CADMM.step`; solver None: the one that it was started with by `start`, else the default."""
    return (solver or getattr(state, "solver", CADMM())).step(state, inbox)
