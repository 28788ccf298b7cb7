"""Pictures: building blocks on axes, and the figures of a team and of a comparison."""

from mannbv.lab.draw.calibration import calibration_figure
from mannbv.lab.draw.canvas import COLORS, figure, robot_color, save, show, style
from mannbv.lab.draw.comparison import compare_figure
from mannbv.lab.draw.cost import cost_figure
from mannbv.lab.draw.paper import (
    beliefs_figure,
    growth_figure,
    mask_figure,
    overview_figure,
    paper_figures,
    sharing_figure,
)
from mannbv.lab.draw.parts import ground, path, plan, profile, risk, splats, strip, view, zone
from mannbv.lab.draw.team import team_figure

__all__ = [
    "COLORS",
    "beliefs_figure",
    "calibration_figure",
    "compare_figure",
    "cost_figure",
    "figure",
    "ground",
    "growth_figure",
    "mask_figure",
    "overview_figure",
    "paper_figures",
    "path",
    "plan",
    "profile",
    "risk",
    "robot_color",
    "save",
    "sharing_figure",
    "show",
    "splats",
    "strip",
    "style",
    "team_figure",
    "view",
    "zone",
]
