"""Agreement on any objectives F_i of the team's yaws, or twists of its poses, Eqs. (25)-(29); it knows no splats."""

from mannbv.consensus.cadmm import CADMM, PRIMALS, Agreement, Numbers, Outgoing, exchange, start, step
from mannbv.consensus.objectives import best_yaws, grid, interpolate, quantise, restore, scale_of, tabulate, value
from mannbv.consensus.solvers import SOLVERS, Round, Settings, register, solve
from mannbv.consensus.twists import TwistRound, solve_twists

__all__ = [
    "CADMM",
    "PRIMALS",
    "SOLVERS",
    "Agreement",
    "Numbers",
    "Outgoing",
    "Round",
    "Settings",
    "TwistRound",
    "best_yaws",
    "exchange",
    "grid",
    "interpolate",
    "quantise",
    "register",
    "restore",
    "scale_of",
    "solve",
    "solve_twists",
    "start",
    "step",
    "tabulate",
    "value",
]
