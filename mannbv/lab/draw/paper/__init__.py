"""The paper's figures, from records of real episodes."""

from mannbv.lab.draw.paper.centralized import growth_figure
from mannbv.lab.draw.paper.figures import FIGURES, beliefs_figure, paper_figures
from mannbv.lab.draw.paper.overview import overview_figure
from mannbv.lab.draw.paper.proposals import mask_figure
from mannbv.lab.draw.paper.sharing import sharing_figure

__all__ = [
    "FIGURES",
    "beliefs_figure",
    "growth_figure",
    "mask_figure",
    "overview_figure",
    "paper_figures",
    "sharing_figure",
]
