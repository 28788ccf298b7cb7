"""Pictures: building blocks on axes, and the figures of a team and of a comparison."""

from mannbv.draw.canvas import COLORS, figure, robot_color, save, show, style
from mannbv.draw.comparison import compare_figure
from mannbv.draw.cost import cost_figure
from mannbv.draw.parts import ground, path, plan, profile, risk, splats, strip, view, zone
from mannbv.draw.team import team_figure

__all__ = [
    "COLORS",
    "compare_figure",
    "cost_figure",
    "figure",
    "ground",
    "path",
    "plan",
    "profile",
    "risk",
    "robot_color",
    "save",
    "show",
    "splats",
    "strip",
    "style",
    "team_figure",
    "view",
    "zone",
]
