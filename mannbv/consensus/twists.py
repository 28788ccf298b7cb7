"""C-ADMM on whole poses, in Remark 1's Lie-algebra form: copies are twists relative to the announced poses.

A twist is a vector, so that Eqs. (26)-(29) stay as they are: N robots with k degrees of freedom each are N·k numbers
in place of N yaws. Only who evaluates an objective knows what a twist does to a pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Unpack

import networkx as nx
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from mannbv import network as networks
from mannbv.consensus.cadmm import Agreement
from mannbv.consensus.objectives import Called, Function
from mannbv.consensus.solvers import Options, Settings, explicit, played

SOLVERS = {"cadmm": "exact", "cadmm-gradient": "gradient"}


@dataclass(frozen=True, eq=False)
class TwistRound:
    """Where the team stands after a round of messages; twists [m, rad] move each robot from its announced pose."""

    twists: Float[np.ndarray, "robots t"]  # each robot's own
    copies: Float[np.ndarray, "robots robots t"]  # copies[i, k]: robot i's copy of robot k's twist
    primal_residual: float = 0.0  # largest of the robots' [m, rad]
    dual_residual: float = 0.0  # largest of the robots'
    penalty: float = 0.0  # ρ of this round
    states: tuple[Agreement, ...] = ()


@explicit
def solve_twists(
    objectives: Sequence[Function],
    network: nx.Graph,
    directions: ArrayLike,
    solver: str = "cadmm",
    **settings: Unpack[Options],
) -> list[TwistRound]:
    """The team's poses that maximise Σ_i F_i, Eq. (25), as a trace of rounds of twists; the last one is the answer.

    objectives: N functions F_i(twists (N, t)) of the robots' twists from their announced poses; a method or attribute
    `.gradient(twists)`, (N, t), is used where there is one. directions: (N, k, t), the k twists along which each robot
    may move, as `information.directions` gives them for a freedom: one a robot is the yaw, all of se(d) the pose.
    solver: "cadmm" (BFGS on each robot's own problem, a local optimum) or "cadmm-gradient" (the paper's few steps).
    network, settings: as in `solve`. Raises ValueError, in one line, for bad input.
    """
    if solver not in SOLVERS:
        raise ValueError(f"consensus: no solver of twists is called '{solver}'; choose one of {', '.join(SOLVERS)}")
    if not objectives or not all(callable(f) for f in objectives):
        raise ValueError("consensus: objectives of twists must be a list of N functions")
    chosen, n = Settings(**settings), len(objectives)
    networks.check(network, n)
    ways = np.asarray(directions, float)
    if ways.ndim != 3 or len(ways) != n or 0 in ways.shape or not np.isfinite(ways).all():
        raise ValueError(f"consensus: directions must be finite and ({n}, k, t), got {ways.shape}")

    def stand(states: Sequence[Agreement], residuals: tuple[float, float], penalty: float) -> TwistRound:
        copies = np.stack([_twists(state.agreed, ways) for state in states])
        return TwistRound(copies[range(n), range(n)], copies, residuals[0], residuals[1], penalty, tuple(states))

    scaled = [_along(f, ways, float(chosen.scale or 1.0)) for f in objectives]
    still = np.zeros((n, ways[..., 0].size))
    return played(chosen.cadmm(SOLVERS[solver]), scaled, network, still[0], still, chosen, stand)


def _twists(coordinates: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(N, t) from the N·k numbers that robots agree on."""
    return np.einsum("nk,nkt->nt", coordinates.reshape(directions.shape[:2]), directions)


def _along(function: Function, directions: np.ndarray, scale: float) -> Called:
    """F as a function of the N·k coordinates along the directions, with its gradient where F has one."""
    gradient = getattr(function, "gradient", None)

    def value(coordinates: np.ndarray) -> float:
        return function(_twists(coordinates, directions))

    def slope(coordinates: np.ndarray) -> np.ndarray:
        assert gradient is not None
        found = np.asarray(gradient(_twists(coordinates, directions)), float)
        return np.einsum("nt,nkt->nk", found, directions).ravel()

    return Called(value, scale, None if gradient is None else slope)
