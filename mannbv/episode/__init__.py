"""An episode: the loop, its scores, its record and the record's file (Section VI-A)."""

from mannbv.episode.loop import PRIORS, draw_team, run, score, why_not
from mannbv.episode.record import Record, RecordError, load

__all__ = ["PRIORS", "Record", "RecordError", "draw_team", "load", "run", "score", "why_not"]
