"""The paper's figures, from records of real episodes."""

from mannbv.draw.paper.album import FIGURES, beliefs_figure, paper_figures
from mannbv.draw.paper.growth import growth_figure
from mannbv.draw.paper.overview import overview_figure
from mannbv.draw.paper.proposals import mask_figure
from mannbv.draw.paper.sharing import sharing_figure

__all__ = [
    "FIGURES",
    "beliefs_figure",
    "growth_figure",
    "mask_figure",
    "overview_figure",
    "paper_figures",
    "sharing_figure",
]
