"""What the numbers are measured against: two bounds for each, the one to reach and a stretch."""

from collections.abc import Sequence
from dataclasses import dataclass

from mannbv.lab.bench.timing import Result, with_unit


@dataclass(frozen=True)
class Target:
    """Upper bounds on a result's median, in its unit; with `ratio`, lower bounds on how many times ours it takes."""

    key: str
    reach: float
    stretch: float | None = None
    ratio: bool = False

    def judged(self, results: Sequence[Result]) -> dict:
        """The target beside what was measured, None if nothing was, for JSON."""
        found = next((result for result in results if result.key == self.key), None)
        row = {"key": self.key, "to_reach": self.reach, "stretch": self.stretch, "at_least": self.ratio}
        if found is None:
            return row | {"title": self.key, "unit": "", "measured": None, "met": None, "stretch_met": None}
        measured = found.row()["ratio"]["median"] if self.ratio else found.median
        unit = "times" if self.ratio else found.unit
        return row | {
            "title": found.title, "unit": unit, "measured": measured, "met": self._met(measured, self.reach),
            "stretch_met": None if self.stretch is None else self._met(measured, self.stretch),
        }  # fmt: skip

    def _met(self, measured: float, bound: float) -> bool:
        return measured >= bound if self.ratio else measured <= bound


TARGETS = (
    Target("large.forward", 0.080, 0.060),
    Target("large.backward", 0.180, 0.125),
    Target("large.fisher", 0.250, 0.180),
    Target("pair.forward", 1.5, 1.5),
    Target("pair.backward", 2.5, 1.8),
    Target("pair.fisher", 4.5, 3.4),
    Target("small.forward", 0.0036),
    Target("small.backward", 0.007),
    Target("small.fisher", 0.009),
    Target("gram.fisher", 0.0006),
    Target("flat.fisher", 0.0005),
    Target("flat.profile", 0.002),
    Target("flat.slopes", 20.0, ratio=True),
    Target("space.steps", 20.0, ratio=True),
    Target("keyframe", 0.5),
    Target("sense.large", 0.6),
    Target("first.warm", 1.0),
    Target("first.cold", 25.0),
    Target("memory", 4e9),
    Target("job", 60.0, 20.0),
)


def verdict(judged: dict) -> str:
    """A judged target in words."""
    sign = "at least" if judged["at_least"] else "at most"
    bounds = [("to reach", judged["to_reach"], judged["met"]), ("stretch", judged["stretch"], judged["stretch_met"])]
    if judged["measured"] is None:
        return f"target  {judged['title']}: not measured this time"
    words = [
        f"{name} {sign} {with_unit(bound, judged['unit'])}: {'yes' if met else 'no'}"
        for name, bound, met in bounds
        if bound
    ]
    return f"target  {judged['title']}: {with_unit(judged['measured'], judged['unit'])}; {', '.join(words)}"
