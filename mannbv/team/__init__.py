"""A team of robots: Algorithm 1 and the four strategies."""

from mannbv.team.agreement import agree, suggest
from mannbv.team.algorithm import cycle
from mannbv.team.log import CycleLog, RobotLog, Seconds, SuggestionLog
from mannbv.team.robots import Guests, Mission, Robot
from mannbv.team.stages import look, move, observe, plan, start
from mannbv.team.strategies import REGISTRY, STRATEGIES, Strategy, register, serve, serve_own, share_plans, view_cone

__all__ = [
    "REGISTRY",
    "STRATEGIES",
    "CycleLog",
    "Guests",
    "Mission",
    "Robot",
    "RobotLog",
    "Seconds",
    "Strategy",
    "SuggestionLog",
    "agree",
    "cycle",
    "look",
    "move",
    "observe",
    "plan",
    "register",
    "serve",
    "serve_own",
    "share_plans",
    "start",
    "suggest",
    "view_cone",
]
