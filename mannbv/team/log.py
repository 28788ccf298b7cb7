"""What a cycle reports: frozen records, kept by an episode and read by all that draws, counts or replays it."""

from dataclasses import dataclass
from typing import NamedTuple

from mannbv.plain import Plain


class SuggestionLog(NamedTuple):
    """The best view that robot i, sender, knows for robot k, target: argmax f_ik (Fig. 2b), yaw [rad] and gain [1]."""

    sender: int
    target: int
    yaw: float
    gain: float


@dataclass(frozen=True)
class RobotLog(Plain):
    """One robot in a cycle, with d coordinates.

    position (d,) [m], yaw [rad]: where it stood when the cycle began; status: "moving", "reached" or "stuck". splats,
    guests: its own and those that it was sent, after the share stage. view (d,) [m]: its next viewpoint, None without a
    plan; announced, chosen: the yaw there [rad] that is best for it alone, and the one agreed on. path (k, d) [m]: the
    announced waypoints; subgoals (m, d) [m]: the candidates of its route. risk, risk_inflated (k,) [m]: α of the
    waypoints on the map that planned them, with σ the splats' own and with what their means' posterior variances add,
    None where no splat counts; None altogether in records of versions that did not forecast.
    """

    position: tuple[float, ...]
    yaw: float
    status: str
    splats: int
    guests: int
    view: tuple[float, ...] | None
    announced: float
    chosen: float
    path: tuple[tuple[float, ...], ...] = ()
    subgoals: tuple[tuple[float, ...], ...] = ()
    risk: tuple[float | None, ...] | None = None
    risk_inflated: tuple[float | None, ...] | None = None


@dataclass(frozen=True)
class Seconds(Plain):
    """Seconds of the whole team in each stage of a cycle."""

    map: float = 0.0
    plan: float = 0.0
    share: float = 0.0
    evaluate: float = 0.0
    agree: float = 0.0
    move: float = 0.0

    @property
    def total(self) -> float:
        return sum(self.to_json().values())


@dataclass(frozen=True)
class CycleLog(Plain):
    """One cycle of a team: its number, its robots in their order, the views they suggested, how they agreed.

    residuals (rounds,): the largest of each round of ADMM [rad]; none of solvers that send no copies. team_gain,
    best_gain, own_gain [1]: the team's objective at the chosen yaws, at the best ones, and at the announced.
    """

    cycle: int
    robots: tuple[RobotLog, ...]
    suggestions: tuple[SuggestionLog, ...]
    residuals: tuple[float, ...]
    team_gain: float
    best_gain: float
    own_gain: float
    seconds: Seconds
