"""A team of robots: Algorithm 1 and the four strategies."""

from mannbv.team.agreement import agree, evaluate, suggest
from mannbv.team.algorithm import cycle
from mannbv.team.exchange import Hear, Phase, each, exchange, hear
from mannbv.team.log import CycleLog, RobotLog, Seconds, SuggestionLog
from mannbv.team.robots import Choice, Guests, Mission, Robot
from mannbv.team.stages import look, meet, move, observe, plan, start
from mannbv.team.strategies import (
    REGISTRY,
    STRATEGIES,
    Strategy,
    announce,
    register,
    send_grid,
    send_guests,
    send_map,
    serve,
    serve_own,
    share,
    view_cone,
)

__all__ = [
    "REGISTRY",
    "STRATEGIES",
    "Choice",
    "CycleLog",
    "Guests",
    "Hear",
    "Mission",
    "Phase",
    "Robot",
    "RobotLog",
    "Seconds",
    "Strategy",
    "SuggestionLog",
    "agree",
    "announce",
    "cycle",
    "each",
    "evaluate",
    "exchange",
    "hear",
    "look",
    "meet",
    "move",
    "observe",
    "plan",
    "register",
    "send_grid",
    "send_guests",
    "send_map",
    "serve",
    "serve_own",
    "share",
    "start",
    "suggest",
    "view_cone",
]
