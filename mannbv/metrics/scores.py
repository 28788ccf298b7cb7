"""What a row of `results.json` holds, and the one table of every score's name, unit, direction and label."""

import dataclasses
from dataclasses import dataclass

from mannbv.plain import Plain

_MEASURES = {"avar": "AV@R", "var": "V@R"}


@dataclass(frozen=True)
class Row(Plain):
    """One robot's scores when its episode has ended; `SCORES` has their units and labels.

    None is a number that does not exist, as the overhead of a path that never reached the goal, or one that the version
    which wrote it did not measure. fate: "reached", or what kept the robot from its goal.
    """

    strategy: str
    seed: int
    robot: int
    reached: bool | None = None
    cycles: int | None = None
    path_length_m: float | None = None
    path_overhead: float | None = None
    collisions: int | None = None
    min_clearance_m: float | None = None
    spl: float | None = None
    total_risk_m: float | None = None
    total_risk_true_m: float | None = None
    risk_gain_m: float | None = None
    risk_gain_true_m: float | None = None
    reference_clearance_m: float | None = None
    psnr_db: float | None = None
    depth_mae_m: float | None = None
    bytes_sent: int | None = None
    bytes_received: int | None = None
    coverage: float | None = None
    fate: str | None = None
    seconds: float | None = None
    bytes_plan: int | None = None
    bytes_suggestion: int | None = None
    bytes_copies: int | None = None
    bytes_profile: int | None = None
    bytes_splats: int | None = None
    bytes_grid: int | None = None
    bytes_paper: int | None = None


@dataclass(frozen=True)
class Score:
    """One score. key: its name in rows and summaries; label: what it is and, behind a comma, where or of what.

    unit: as printed, of a row's value times `scale`; better: 1 where more is better, −1 where less is, else 0;
    decimals: as printed, None for three digits. of_team: worked out from a team's rows, see `study.per_seed`.
    """

    key: str
    label: str
    unit: str = "1"
    better: int = 0
    decimals: int | None = 2
    scale: float = 1.0
    of_team: bool = False

    @property
    def axis(self) -> str:
        """Label and unit, as for an axis."""
        return f"{self.label} [{self.unit}]"

    @property
    def head(self) -> tuple[str, str, str]:
        """The three lines of a table's head: what with its better direction, where, the unit."""
        what, _, where = self.label.partition(", ")
        return what + {1: " ↑", -1: " ↓", 0: ""}[self.better], where, f"[{self.unit}]"

    def of(self, measure: str) -> "Score":
        """The score with the name of the risk measure that `config.measure` chose."""
        return dataclasses.replace(self, label=self.label.replace(_MEASURES["avar"], _MEASURES.get(measure, measure)))

    def scaled(self, unit: str, scale: float) -> "Score":
        """The score in another unit: values of rows times `scale`."""
        return dataclasses.replace(self, unit=unit, scale=scale)


_PERCENT = {"unit": "%", "scale": 100.0, "decimals": 1}
_BYTES = {"unit": "B", "decimals": None}
_GAIN = Score("risk_gain_m", "AV@R gain, own map", "m", 1)
_GAIN_TRUE = Score("risk_gain_true_m", "AV@R gain, true surfaces", "m", 1)

SCORES = {
    score.key: score
    for score in (
        Score("reached", "robots at their goals", better=1, **_PERCENT),
        Score("cycles", "cycles under way", better=-1, decimals=1),
        Score("path_length_m", "way driven", "m", -1),
        Score("path_overhead", "path overhead", better=-1, **_PERCENT),
        Score("collisions", "collisions", better=-1, decimals=0),
        Score("min_clearance_m", "least clearance, driven", "m", 1),
        Score("spl", "SPL", better=1),
        Score("total_risk_m", "AV@R, own map", "m", 1),
        Score("total_risk_true_m", "AV@R, true surfaces", "m", 1),
        _GAIN,
        _GAIN_TRUE,
        Score("reference_clearance_m", "least clearance, reference path", "m", 1),
        Score("psnr_db", "PSNR", "dB", 1),
        Score("depth_mae_m", "depth error", "m", -1),
        Score("bytes_sent", "sent, in all", better=-1, **_BYTES),
        Score("bytes_received", "received, in all", better=-1, **_BYTES),
        Score("coverage", "free floor seen", better=1, **_PERCENT),
        Score("seconds", "computing time, whole team", "s", -1),
        Score("bytes_plan", "plans, sent", **_BYTES),
        Score("bytes_suggestion", "suggestions, sent", **_BYTES),
        Score("bytes_copies", "copies, sent", **_BYTES),
        Score("bytes_profile", "profiles, sent", **_BYTES),
        Score("bytes_splats", "splats, sent", **_BYTES),
        Score("bytes_grid", "grids, sent", **_BYTES),
        Score("bytes_paper", "paper's count, in all", better=-1, **_BYTES),
        dataclasses.replace(_GAIN, key="risk_gain_share", of_team=True, **_PERCENT),
        dataclasses.replace(_GAIN_TRUE, key="risk_gain_true_share", of_team=True, **_PERCENT),
        Score("sent_per_cycle_b", "sent by a robot, a cycle", better=-1, of_team=True, **_BYTES),
        Score("received_per_cycle_b", "received by a robot, a cycle", better=-1, of_team=True, **_BYTES),
        Score("paper_per_cycle_b", "paper's count, a cycle", better=-1, of_team=True, **_BYTES),
    )
}
