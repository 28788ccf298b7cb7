"""How fast: every stage on fixed sizes, side by side with what it replaces."""

from mannbv.bench.sides import FULL, QUICK, Scale
from mannbv.bench.stages import STAGES
from mannbv.bench.suite import run
from mannbv.bench.targets import TARGETS, verdict
from mannbv.bench.timing import Result, interleave

__all__ = ["FULL", "QUICK", "STAGES", "TARGETS", "Result", "Scale", "interleave", "run", "verdict"]
