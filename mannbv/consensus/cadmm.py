"""One robot's part in C-ADMM, Eqs. (27)-(29): a frozen record and the step that follows an inbox (Section V-C).

Copies are real offsets from the yaw each owner announced and start at 0, so that sums and means are those of ℝᴺ as
Remark 1 asks, yet the yaws live on a circle: 3.1 and −3.1 meet at π, and wrapping happens only in what is read off.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from mannbv import geometry
from mannbv.consensus.objectives import TIE, Called, Tabulated

PRIMALS = ("exact", "gradient")


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
    growth: float
    primal: str
    circle: bool
    steps: int
    rate: float
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


def start(
    robot,
    neighbours,
    announced,
    objective,
    *,
    penalty=0.05,
    growth=1.1,
    primal: str = "exact",
    circle: bool = True,
    scale=1.0,
    copies=None,
    steps: int = 5,
    rate=0.2,
) -> Agreement:
    """Robot i before anything was exchanged: z = first copies, λ = 0, and the first primal update (27).

    announced: everyone's announced yaw (N,) [rad]. objective: robot i's gains (N, M) on M uniform yaws of [−π, π), or
    a function of the N yaws, to be called with unwrapped ones. scale divides it; all robots must use the same one
    (`scale_of`). copies: other first copies (N,) [rad] than the announced yaws. primal: "exact", global on tables and
    BFGS on functions, or "gradient", the paper's: `steps` steps of `rate`. circle=False is the paper's literal
    arithmetic on numbers in [−π, π]. Raises ValueError for wrong shapes and values.
    """
    announced = np.asarray(announced, float)
    n = len(announced)
    first = announced if copies is None else np.asarray(copies, float)
    objective = Called(objective, float(scale)) if callable(objective) else np.asarray(objective, float)
    if isinstance(objective, np.ndarray):
        if objective.ndim != 2 or len(objective) != n or objective.shape[1] < 4 or not np.isfinite(objective).all():
            raise ValueError(f"consensus: robot {robot} needs finite gains (N, M ≥ 4), N = {n}; got {objective.shape}")
        objective = Tabulated(objective / scale)
    if announced.ndim != 1 or first.shape != (n,) or not np.isfinite([announced, first]).all():
        raise ValueError(f"consensus: robot {robot} needs a finite yaw of each robot, got {announced} and {first}")
    if not (penalty > 0 and growth > 0 and scale > 0):
        raise ValueError(f"consensus: penalty, growth and scale must be positive, got {penalty}, {growth}, {scale}")
    if primal not in PRIMALS:
        raise ValueError(f"consensus: no primal update is called '{primal}'; choose one of {', '.join(PRIMALS)}")
    if circle:
        origin, first = announced, geometry.wrap(first - announced)
    else:
        origin, first = np.zeros(n), geometry.wrap(first)
    neighbours = tuple(sorted(int(j) for j in neighbours))
    alone = {} if neighbours else {"primal_residual": 0.0, "dual_residual": 0.0}
    state = Agreement(
        robot=int(robot),
        neighbours=neighbours,
        objective=objective,
        origin=origin,
        copies=first,
        agreed=first,
        edge=np.tile(first, (len(neighbours), 1)),
        dual=np.zeros((len(neighbours), n)),
        penalty=float(penalty),
        growth=float(growth),
        primal=primal,
        circle=bool(circle),
        steps=int(steps),
        rate=float(rate),
        **alone,
    )
    copies = _primal(state, state.edge, state.dual, state.penalty)
    return dataclasses.replace(state, copies=copies, agreed=copies)


def step(state: Agreement, inbox) -> Agreement:
    """One round of robot i: z (28) and dual (29) from its neighbours' copies, then the next primal update (27).

    inbox: neighbour → the copies (N,) that it sent this round. A neighbour that is absent (its message was lost) keeps
    its old z and λ. If only one direction of a link fails, its two ends' duals no longer cancel, and the agreement
    that follows is a little off the optimum. Raises ValueError for a stranger's message or one of the wrong shape.
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
    penalty = state.penalty * state.growth
    return dataclasses.replace(
        state,
        copies=_primal(state, edge, dual, penalty),
        agreed=state.copies,
        edge=edge,
        dual=dual,
        penalty=penalty,
        round=state.round + 1,
        primal_residual=float(np.abs(state.copies - edge).max(initial=0.0)),
        dual_residual=float(state.penalty * np.abs(edge - state.edge).max(initial=0.0)),
    )


def _primal(state: Agreement, edge: np.ndarray, dual: np.ndarray, penalty: float) -> np.ndarray:
    """Eq. (27): argmin of −F(T) + Σ_j λ_ijᵀ(T − z_ij) + ρ/2 Σ_j ‖T − z_ij‖².

    The terms of the neighbours are one quadratic: its stiffness is ρ times their number, its centre the mean of z less
    Σ_j λ_ij over the stiffness.
    """
    stiffness, center = TIE, state.copies
    if state.neighbours:
        stiffness = penalty * len(state.neighbours)
        center = edge.mean(0) - dual.sum(0) / stiffness
    if state.primal == "exact":
        return state.objective.minimise(state.origin, state.copies, center, stiffness, state.circle)
    offsets = state.copies
    for _ in range(state.steps):
        ascent = state.objective.gradient(state.origin + offsets) - stiffness * (offsets - center)
        offsets = offsets + state.rate / (1 + state.rate * stiffness) * ascent  # damped: stable for any penalty
        offsets = offsets if state.circle else np.clip(offsets, -np.pi, np.pi)
    return offsets
