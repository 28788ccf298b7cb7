"""Scores of an episode (Section VI-C): how they are measured, and what they are called."""

from mannbv.metrics.measures import (
    HEADINGS,
    coverage,
    path_scores,
    reference_path,
    traffic,
    travel_scores,
    true_surfaces,
    view_quality,
)
from mannbv.metrics.scores import SCORES, Row, Score

__all__ = [
    "HEADINGS", "SCORES", "Row", "Score", "coverage", "path_scores", "reference_path", "traffic", "travel_scores",
    "true_surfaces", "view_quality",
]  # fmt: skip
