"""How fast: every stage on fixed sizes, side by side with what it replaces."""

from mannbv.lab.bench.sides import FULL, QUICK, Scale
from mannbv.lab.bench.stages import STAGES
from mannbv.lab.bench.suite import run
from mannbv.lab.bench.targets import TARGETS, verdict
from mannbv.lab.bench.timing import Result, interleave

__all__ = ["FULL", "QUICK", "STAGES", "TARGETS", "Result", "Scale", "interleave", "run", "verdict"]
