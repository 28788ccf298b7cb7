"""Every constant in one frozen record, with its unit, meaning and source.

"paper" cites the section; "chosen here" marks what the paper leaves open. `describe()` prints the table.
"""

import dataclasses
import difflib
import functools
import inspect
import math
import numbers
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields
from typing import TypedDict, TypeVar

from mannbv import archive

T = TypeVar("T")


class Noise(TypedDict):
    """Standard deviations of the likelihood, Eq. (4): of a colour channel [1] and of depth [m]."""

    sigma_color: float
    sigma_depth: float


def nearest(wrong: Iterable[str], known: Iterable[str]) -> str:
    """ "did you mean penalty?" for names that are not among the known ones; "" where none is like them."""
    likely = dict.fromkeys(match for name in wrong for match in difflib.get_close_matches(name, list(known), n=1))
    return f"did you mean {', '.join(likely)}?" if likely else ""


def suggesting(what: str, see: str) -> Callable[[type[T]], type[T]]:
    """For a dataclass: whoever gives its constructor a field that it has not is told in one line which was meant.

    what: how the error begins, as "config: no constant"; see: where all names stand. Raises ValueError.
    """

    def decorate(cls: type[T]) -> type[T]:
        init, names = cls.__init__, list(inspect.signature(cls).parameters)

        @functools.wraps(init)
        def checked(self, *args, **values):
            unknown = sorted(set(values).difference(names))
            if unknown:
                raise ValueError(f"{what} is called {', '.join(unknown)}; {nearest(unknown, names) or f'see {see}'}")
            init(self, *args, **values)

        cls.__init__ = checked
        return cls

    return decorate


def _constant(default, unit: str, meaning: str, source: str = "chosen here"):
    return field(default=default, metadata={"unit": unit, "meaning": meaning, "source": source})


_KINDS = {int: (numbers.Integral, "a whole number"), float: (numbers.Real, "a finite number"), str: (str, "a name")}
_CHOICES = {
    "moments": ("fresh", "kept"), "prior": ("recompute", "incremental"), "risk_from": ("body", "camera"),
    "weighs": ("acquired", "both"), "damped": ("prior", "views"), "spread": ("largest", "along"),
    "answers": ("gain", "gradient"),
}  # fmt: skip
_POSITIVE = frozenset([
    "image_width", "image_height", "fov", "max_depth", "step", "turn", "cell", "insert_spacing", "insert_scale",
    "sigma_color", "sigma_depth", "n_subgoals", "r_min", "beta1", "beta2", "gamma1", "risk_scale", "stride", "reach",
    "penalty", "penalty_growth", "scout_pixels", "free_share", "subgoal_yaws", "path_spacing", "primal_rate",
    "evidence_hit", "evidence_pass", "evidence_free", "evidence_occupied", "adam_epsilon",
])  # fmt: skip


@suggesting("config: no constant", "config.describe()")
@dataclass(frozen=True)
class Config:
    """One run's constants. Make a variant with `config.replace(level=0.05)`."""

    # camera and motion
    image_width: int = _constant(64, "px", "width of the image")
    image_height: int = _constant(64, "px", "height of the image, in 3-D only")
    fov: float = _constant(math.pi / 2, "rad", "field of view, both axes", "paper VI-B")
    max_depth: float = _constant(10.0, "m", "range of the depth sensor", "Habitat's default")
    depth_noise: float = _constant(0.0, "1", "std of depth, as a share of depth", "paper VI-B: none")
    color_noise: float = _constant(0.0, "1", "std of each colour channel", "paper VI-B: none")
    step: float = _constant(0.05, "m", "length of a forward move", "paper VI-B")
    turn: float = _constant(math.radians(5), "rad", "angle of a turn", "paper VI-B")
    robot_radius: float = _constant(0.1, "m", "radius of the robot's disc", "Habitat's default")
    cell: float = _constant(0.05, "m", "cell of the occupancy grid", "paper VI-B")
    scout_pixels: int = _constant(128, "px", "a side of the image that only carves the ground, at most")
    free_share: float = _constant(0.7071067811865476, "1", "share of max_depth that is free where nothing is in range")
    # the ground, as log-odds of "occupied"
    evidence_hit: float = _constant(2.0, "1", "what a surface met in a cell adds; more than several passes")
    evidence_pass: float = _constant(0.4, "1", "what a ray through a cell takes away")
    evidence_doubt: float = _constant(0.1, "1", "… in 3-D, where something was hit: it may hang above the ray")
    evidence_free: float = _constant(4.0, "1", "no cell is surer than this to be free")
    evidence_occupied: float = _constant(8.0, "1", "… and than this to be occupied")
    low_ray: float = _constant(
        0.2, "m", "in 3-D a ray is low up to this above body_low; one that ends as far below falls into a hole"
    )
    ground_margin: float = _constant(1.0, "m", "around what is known, the robot and its goal, that a robot plans on")
    camera_height: float = _constant(1.25, "m", "of the camera above the floor, in 3-D only", "Habitat's default")
    body_low: float = _constant(0.1, "m", "in 3-D robots step over what is lower", "a public active-mapping harness")
    body_high: float = _constant(1.3, "m", "in 3-D robots pass below what is higher", "a public active-mapping harness")
    # mapping, Eq. (2)
    depth_weight: float = _constant(0.5, "1", "ψ, weight of depth in the mapping loss, Eq. (2)")
    explained_opacity: float = _constant(0.7, "1", "a pixel more opaque than this may be explained by the map")
    explained_depth: float = _constant(0.05, "1", "… if its depth differs by less than this share of it")
    explained_near: float = _constant(1.0, "m", "… or of this, where it is nearer")
    insert_opacity: float = _constant(0.8, "1", "opacity of a new splat")
    insert_spacing: int = _constant(1, "px", "at most one new splat in a square of so many pixels a side")
    insert_scale: float = _constant(0.6, "1", "std of a new splat, as a share of that spacing at its depth")
    fit_steps: int = _constant(24, "1", "optimiser steps a keyframe")
    fit_window: int = _constant(6, "1", "latest keyframes that are fitted")
    fit_older: int = _constant(2, "1", "older keyframes, drawn anew each time, that join them")
    moments: str = _constant("fresh", "", "Adam's memory: fresh each keyframe (moves all) or kept (moves what is seen)")
    densify_error: float = _constant(1.0, "1", "half way, a pixel wrong by more than this gets a splat; 1: never")
    learning_rate: float = _constant(1.0, "1", "factor on every parameter group's learning rate")
    rate_mean: float = _constant(0.002, "m", "Adam's step for means")
    rate_scale: float = _constant(0.03, "1", "Adam's step for log-scales")
    rate_rotation: float = _constant(0.03, "1", "Adam's step for rotations, complex numbers or quaternions")
    rate_opacity: float = _constant(0.05, "1", "Adam's step for opacity logits")
    rate_color: float = _constant(0.02, "1", "Adam's step for colours")
    adam_beta1: float = _constant(0.8, "1", "Adam's memory of slopes; short, for a few dozen steps a keyframe")
    adam_beta2: float = _constant(0.95, "1", "Adam's memory of their squares, likewise")
    adam_epsilon: float = _constant(1e-8, "1", "Adam's guard against division by 0", "Kingma and Ba 2015")
    prune_opacity: float = _constant(0.05, "1", "splats fainter than this are removed")
    prune_scale: float = _constant(0.5, "m", "splats with a larger std are removed")
    # information, Eqs. (3)-(5), (14), (15)
    sigma_color: float = _constant(0.05, "1", "std of a colour channel in the likelihood, Eq. (4)")
    sigma_depth: float = _constant(0.05, "m", "std of depth in the likelihood, Eq. (4)")
    damping_mean: float = _constant(100.0, "1/m²", "λ for means: 0.1 m before any view")
    damping_scale: float = _constant(1.0, "1", "λ for log-scales: a factor e before any view")
    damping_rotation: float = _constant(1.0, "1/rad²", "λ for rotations: 1 rad before any view")
    damping_opacity: float = _constant(0.25, "1", "λ for opacity logits: 2 before any view")
    damping_color: float = _constant(10.0, "1", "λ for colours: 0.3 before any view")
    prior: str = _constant("recompute", "", "information of past keyframes: recompute (on today's map) or incremental")
    weighs: str = _constant(
        "acquired", "", "what V̄ of Eq. (14) weighs: acquired information, or both, as Eq. (15) says"
    )
    damped: str = _constant("prior", "", "where λ enters: once, on the prior, or on all views, as Section III-B says")
    n_yaws: int = _constant(360, "1", "uniform yaws of a profile")
    # risk, Eqs. (6)-(9)
    measure: str = _constant("avar", "", "risk measure, a name in risk.MEASURES", "paper III-C")
    level: float = _constant(0.1, "1", "ε, the worst share of outcomes")
    spread: str = _constant(
        "largest", "", "σ of Eq. (8), where a splat is not round: largest, or along the line of sight"
    )
    risk_opacity: float = _constant(0.0, "1", "fainter splats count for no risk")
    risk_from: str = _constant("body", "", "in 3-D, distances to splats are from the robot's body or from its camera")
    block_opacity: float = _constant(1.0, "1", "splats more opaque block cells that no depth has shown; 1: none does")
    # masks, Eqs. (10)-(13)
    r_min: float = _constant(0.5, "m", "smallest mask radius, Eq. (10)")
    r_max: float = _constant(10.0, "m", "largest mask radius, and longest way to a splat that still weighs; 0: none")
    beta1: float = _constant(1.0, "m", "β₁ of the mask radius, Eq. (10)")
    beta2: float = _constant(2.0, "1/m", "β₂ of the mask radius, Eq. (10)")
    gamma1: float = _constant(1.0, "1", "γ₁ of the proximity weight, Eq. (13)", "sibling paper")
    gamma2: float = _constant(1.0, "1/m", "γ₂ of the proximity weight, Eq. (13)", "sibling paper")
    # planning
    risk_weight: float = _constant(3.0, "1", "A*: a metre at α = 0 costs 1 + this")
    risk_scale: float = _constant(0.3, "m", "A*: the extra cost falls by e for each such step of α")
    risk_floor: float = _constant(3.0, "1", "A*: prices grow no more below α = −risk_scale times this")
    margin: float = _constant(0.1, "m", "A*: distance kept from occupied cells, beyond the robot's radius")
    min_frontier: int = _constant(10, "cells", "smaller frontiers are ignored", "a public active-mapping harness")
    n_subgoals: int = _constant(4, "1", "frontiers nearest to the goal among which information decides")
    detour: float = _constant(0.15, "1", "a candidate subgoal may lengthen the way by this share")
    slack: float = _constant(0.5, "m", "… and by this")
    tried_radius: float = _constant(0.3, "m", "subgoals this near to one that showed nothing new are passed over")
    subgoal_yaws: int = _constant(72, "1", "uniform yaws of the profiles that rank subgoals")
    stride: float = _constant(0.8, "m", "distance travelled between two chosen views")
    path_spacing: float = _constant(0.25, "m", "between the waypoints that are announced and masked")
    reach: float = _constant(0.2, "m", "a goal this near is reached", "Habitat's success radius")
    patience: int = _constant(3, "1", "cycles in a row without any route after which a robot is given up")
    max_cycles: int = _constant(80, "1", "planning cycles before an episode ends")
    # agreement, Eqs. (25)-(29)
    solver: str = _constant("cadmm", "", "a name in consensus.SOLVERS", "paper V-C")
    network: str = _constant("complete", "", "communication graph, a name in network.GRAPHS")
    penalty: float = _constant(0.05, "1", "ρ of C-ADMM, for gains scaled to a largest value of 1")
    penalty_growth: float = _constant(1.1, "1", "ρ is multiplied by this each round")
    primal_steps: int = _constant(5, "1", "steps a round of the solvers that solve (27) by steps uphill")
    primal_rate: float = _constant(0.2, "rad²", "length of such a step")
    rounds: int = _constant(30, "1", "T_ADMM")
    tolerance: float = _constant(0.01, "rad", "agreement ends when both residuals are smaller")
    answers: str = _constant("gain", "", "what a suggestion tells of the announced view: its gain, or its gradient too")
    dense_gradient: int = _constant(1_000_000, "1", "splats times pixels up to which that gradient is exact")
    codec: str = _constant("json", "", "what messages are written in: json or binary", "paper VI-D: JSON")
    # sharing
    share_scale: float = _constant(0.0, "m", "splats with a larger std are not sent; 0: all are")
    guest_splats: int = _constant(400, "1", "splats sent along with a suggested view, at most", "paper VI-D")

    def __post_init__(self):
        for f in fields(self):
            value, kind = getattr(self, f.name), type(f.default)
            fits = isinstance(value, _KINDS[kind][0]) and not isinstance(value, bool)
            if not fits or (kind is not str and not math.isfinite(value)):
                raise ValueError(f"config: {f.name} must be {_KINDS[kind][1]}, got {value!r}")
            if kind is not str and value < 0:
                raise ValueError(f"config: {f.name} must not be negative, got {value}")
            if f.name in _POSITIVE and not value > 0:
                raise ValueError(f"config: {f.name} must be positive, got {value}")
            object.__setattr__(self, f.name, kind(value))  # numbers of numpy cannot be written as JSON
        if not 0 < self.level < 1:
            raise ValueError(f"config: level must lie strictly between 0 and 1, got {self.level}")
        for name, choices in _CHOICES.items():
            value = getattr(self, name)
            if value not in choices:
                meant = nearest([value], choices)
                raise ValueError(
                    f"config: {name} must be {' or '.join(choices)}, got {value}" + f"; {meant}" * bool(meant)
                )
        for name in ("adam_beta1", "adam_beta2"):
            if not getattr(self, name) < 1:
                raise ValueError(f"config: {name} must be below 1, got {getattr(self, name)}")
        if not self.body_low < self.body_high:
            raise ValueError(f"config: body_low must be below body_high, got {self.body_low} and {self.body_high}")
        if 0 < self.r_max < self.r_min:
            raise ValueError(f"config: r_max must be at least r_min, or 0, got {self.r_max} and {self.r_min}")
        if not self.fov < math.pi:
            raise ValueError(f"config: fov must be below π rad, got {self.fov}")
        if self.n_yaws < 4:
            raise ValueError(f"config: n_yaws must be at least 4, got {self.n_yaws}")

    @property
    def noise(self) -> Noise:
        """The standard deviations of the likelihood, Eq. (4), as `information.fisher` and its kin take them."""
        return {"sigma_color": self.sigma_color, "sigma_depth": self.sigma_depth}

    def replace(self, **changes: float | str) -> "Config":
        """A copy with some constants changed. Raises ValueError for a name that is none of them."""
        return dataclasses.replace(self, **changes)

    def to_json(self) -> str:
        return archive.to_json(dataclasses.asdict(self))

    @staticmethod
    def from_json(text: str) -> "Config":
        """The inverse of `to_json`; constants that are not named keep their defaults. Raises ValueError."""
        try:
            values = archive.from_json(text)
        except ValueError as error:
            raise ValueError(f"config: not valid JSON ({error}); was it written by to_json?") from None
        if not isinstance(values, dict):
            raise ValueError("config: expected a JSON object of constants")
        return Config().replace(**values)


# For maps of space, chosen here: a splat to four pixels, finer where those fail; a room at 128×128 takes some 24,000.
SPACE = Config(
    insert_spacing=2, densify_error=0.05, fit_steps=48, fit_older=8, learning_rate=0.5, moments="kept",
    risk_opacity=0.5, block_opacity=0.5, share_scale=0.1,
)  # fmt: skip

# By dimension and name. "paper": images, cells, steps and turns of Section VI-B; "quick": an episode to wait for.
PRESETS = {
    2: {"quick": Config(), "paper": Config(image_width=800, image_height=800)},
    3: {
        "quick": SPACE.replace(densify_error=1.0, fit_steps=24),
        "paper": SPACE.replace(densify_error=1.0, fit_steps=24, insert_spacing=6, image_width=800, image_height=800),
    },
}


def describe(config: Config | None = None) -> str:
    """A table of every constant: name, value, unit, meaning, source."""
    config = config or Config()
    rows = [(f.name, getattr(config, f.name), *f.metadata.values()) for f in fields(config)]
    text = [(n, f"{v:.4g}" if isinstance(v, float) else str(v), u, m, s) for n, v, u, m, s in rows]
    widths = [max(len(row[k]) for row in text) for k in range(4)]
    lines = ("  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=False)) + "  " + row[4] for row in text)
    return "\n".join(lines)
