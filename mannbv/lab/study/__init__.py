"""Many episodes: comparisons over strategies and seeds, and their statistics."""

from mannbv.lab.study.calibration import KINDS, Calibration, Forecasts, calibrate, calibration, forecasts
from mannbv.lab.study.comparison import Outcome, Progress, compare, run_file
from mannbv.lab.study.cycles import EpisodeLog, episode_of, picked
from mannbv.lab.study.progress import ProgressBar
from mannbv.lab.study.reduced import Agreement, SameViews, reduced, same_views
from mannbv.lab.study.resampling import Estimate, bootstrap
from mannbv.lab.study.results import Results, StudyError, assemble, gather, load, run_files, save
from mannbv.lab.study.snapshot import RobotSnapshot, Snapshot, ground_risk, midway, snapshot
from mannbv.lab.study.summary import Mean, interval, per_seed, summarise
from mannbv.lab.study.workers import EpisodeProgress

__all__ = [
    "KINDS",
    "Agreement",
    "Calibration",
    "EpisodeLog",
    "EpisodeProgress",
    "Estimate",
    "Forecasts",
    "Mean",
    "Outcome",
    "Progress",
    "ProgressBar",
    "Results",
    "RobotSnapshot",
    "SameViews",
    "Snapshot",
    "StudyError",
    "assemble",
    "bootstrap",
    "calibrate",
    "calibration",
    "compare",
    "episode_of",
    "forecasts",
    "gather",
    "ground_risk",
    "interval",
    "load",
    "midway",
    "per_seed",
    "picked",
    "reduced",
    "run_file",
    "run_files",
    "same_views",
    "save",
    "snapshot",
    "summarise",
]
