"""An episode: the loop, its scores, its record and the record's file (Section VI-A)."""

from mannbv.episode.loop import draw_team, run, score, why_not
from mannbv.episode.record import Record, RecordError, from_arrays, load, to_arrays

__all__ = [
    "Record", "RecordError", "draw_team", "from_arrays", "load", "run", "score", "to_arrays", "why_not",
]  # fmt: skip
