"""What a robot has, and what stays the same through an episode."""

import dataclasses
import math
import typing
from dataclasses import dataclass, field

import networkx as nx
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from mannbv import consensus, grid, information, messages, planner, risk, splats, world
from mannbv.belief import Belief
from mannbv.camera import Camera, Frame
from mannbv.config import Config
from mannbv.mapping import LocalMap
from mannbv.splats import SplatMap

_DEFAULT = Config()


@dataclass(frozen=True)
class Guests:
    """Splats received from teammates, keyed by sender (n,) and id (n,): never fitted, never passed on.

    sent (n, p): what their senders' views tell of them, as it came with them. seen (n, p): what the holder's own
    keyframes tell of them, NaN until they are `met`.
    """

    splats: SplatMap
    senders: Tensor
    ids: Tensor
    sent: Float[Tensor, "n p"]
    seen: Float[Tensor, "n p"]

    @staticmethod
    def none(dim: int) -> "Guests":
        nobody = torch.zeros(0, dtype=torch.int64)
        nothing = torch.zeros(0, information.n_parameters(dim))
        return Guests(SplatMap.empty(dim), nobody, nobody, nothing, nothing)

    @property
    def prior(self) -> Float[Tensor, "n p"]:
        """All that is known of them (n, p): what their senders and, once they are met, the holder have seen."""
        return self.sent + torch.nan_to_num(self.seen)

    def received(self, message: messages.Splats) -> "Guests":
        """With a teammate's splats: a whole map replaces all of its earlier ones, a part those with the same ids.

        What the holder had seen of a splat that comes again, a little refined, stays known.
        """
        theirs, ids = self.senders == message.robot, message.ids.long()
        stale = theirs if message.whole else theirs & torch.isin(self.ids, ids)
        columns = (self.senders, self.ids, self.sent, self.seen)
        seen = torch.full_like(message.prior, torch.nan)
        again, place = _matched(ids, self.ids[theirs])
        seen[again] = self.seen[theirs][place]
        fresh = (torch.full_like(ids, message.robot), ids, message.prior, seen)
        joined = (torch.cat([old[~stale], new]) for old, new in zip(columns, fresh, strict=True))
        return Guests(splats.union(self.splats.select(~stale), message.splats), *joined)

    def seen_in(self, frames: tuple[Frame, ...], own: SplatMap, camera: Camera, config: Config) -> "Guests":
        """With what further keyframes of the holder tell of them; its own splats occlude."""
        if not (frames and self.splats.n_splats):
            return self
        shown = information.prior(self.splats, camera, [f.pose for f in frames], others=own, **config.noise)
        return dataclasses.replace(self, seen=self.seen + shown.to(self.seen))

    def met(self, own: SplatMap, camera: Camera, frames: tuple[Frame, ...], config: Config) -> "Guests":
        """With what the holder's keyframes tell of those that it has not looked for yet; its own splats occlude."""
        new = torch.isnan(self.seen).any(1)
        if not bool(new.any()):
            return self
        poses = [frame.pose for frame in frames]
        others = splats.union(self.splats.select(~new), own)
        told = information.prior(self.splats.select(new), camera, poses, others=others, **config.noise)
        return dataclasses.replace(self, seen=self.seen.index_copy(0, torch.nonzero(new)[:, 0], told.to(self.seen)))


def _matched(ids: Tensor, among: Tensor) -> tuple[Tensor, Tensor]:
    """Which of the ids (n,) are among others (k,), as a mask, and where each of those stands there."""
    ordered, order = torch.sort(among)
    place = torch.searchsorted(ordered, ids).clamp_max(max(len(ordered) - 1, 0))
    again = ordered[place] == ids if len(ordered) else torch.zeros_like(ids, dtype=torch.bool)
    return again, order[place[again]]


@dataclass(frozen=True)
class Choice:
    """How a robot comes to its view in a cycle. gains (N, M): its F_i, of every robot's view on M uniform yaws.

    suggestions: what teammates said of its view. profiles: their gains of it over all yaws, where a solver sends them.
    agreement: its part in C-ADMM; copies: what neighbours sent in this round. yaw: the one that it takes [rad].
    """

    gains: Float[np.ndarray, "robots yaws"]
    suggestions: tuple[messages.Suggestion, ...] = ()
    profiles: tuple[messages.Profile, ...] = ()
    agreement: consensus.Agreement | None = None
    copies: dict[int, np.ndarray] = field(default_factory=dict)
    yaw: float = math.nan

    def replace(self, **changes: object) -> "Choice":
        return dataclasses.replace(self, **changes)

    @property
    def state(self) -> consensus.Agreement:
        """Its part in C-ADMM. Raises ValueError before the rounds have begun."""
        if self.agreement is None:
            raise ValueError("team: the rounds of C-ADMM have not begun")
        return self.agreement

    @property
    def scale(self) -> float:
        """The largest gain of the whole team, as far as it was told: everyone divides its objective by the same."""
        return max([float(self.gains.max()), *(said.largest for said in self.suggestions)]) or 1.0


@dataclass(frozen=True)
class Robot:
    """Everything one robot has: where it is, its private map, what it was sent, what it plans.

    position, goal (d,) [m]; yaw [rad]. frames: taken but not yet mapped. trail (k, d): where it has been [m].
    grids: teammates' grounds (centralized only). plans: the announced plans, by robot, its own included; none of
    robots at their goals. tried: (x, y) [m] of subgoals already looked at. status: "moving", "reached" or "stuck";
    stuck: cycles in a row without a route. collisions: steps that ended nearer to a true surface than its radius.
    cycle: the one that it is in; choice: how it comes to its view there, None before and after.
    """

    index: int
    position: np.ndarray
    yaw: float
    goal: np.ndarray
    local: LocalMap
    ground: grid.Occupancy
    guests: Guests
    trail: np.ndarray
    frames: tuple[Frame, ...] = ()
    grids: dict[int, grid.Occupancy] = field(default_factory=dict)
    plans: dict[int, messages.Plan] = field(default_factory=dict)
    route: planner.Route | None = None
    tried: tuple[np.ndarray, ...] = ()
    status: typing.Literal["moving", "reached", "stuck"] = "moving"
    stuck: int = 0
    collisions: int = 0
    cycle: int = 0
    choice: Choice | None = None

    def replace(self, **changes: object) -> "Robot":
        return dataclasses.replace(self, **changes)

    @property
    def deciding(self) -> Choice:
        """Its choice. Raises ValueError before it has evaluated, and after its move."""
        if self.choice is None:
            raise ValueError(f"team: robot {self.index} has evaluated nothing yet in this cycle")
        return self.choice

    @property
    def announced(self) -> float:
        """The yaw that this robot would choose alone [rad]."""
        return self.plans[self.index].yaw if self.index in self.plans else self.yaw

    def belief(self, config: Config = _DEFAULT) -> Belief:
        """What it may evaluate on: its own map and its guests, its own ground and the grids it was sent.

        The ground is cut to what is known, its own place and its goal, with `ground_margin` around. By `block_opacity`,
        opaque splats tell of what stands where no depth has shown the ground; never of what is free.
        """
        both = splats.union(self.local.splats, self.guests.splats)
        ground = self.ground.merged(*self.grids.values(), config=config)
        ground = ground.cropped(np.stack([self.position, self.goal]), config.ground_margin)
        if config.block_opacity < 1:
            solid = risk.in_reach(both, self.position[2:], config) & (both.opacities > config.block_opacity)
            ground = ground.blocked(both.means[solid].numpy(), config)
        return Belief(both, torch.cat([self.local.prior, self.guests.prior]), ground, len(self.local.keyframes))


@dataclass(frozen=True)
class Mission:
    """What stays the same through an episode."""

    world: world.World
    camera: Camera
    config: Config
    network: nx.Graph
    strategy: str
    seed: int

    @property
    def scout(self) -> Camera:
        """The camera for looks that only carve the ground: the same view in at most `scout_pixels` a side."""
        config = self.config
        width, height = (min(n, config.scout_pixels) for n in (config.image_width, config.image_height))
        return Camera.of_dim(self.world.dim, width, height, config.fov)

    def rng(self, cycle: int, robot: int) -> np.random.Generator:
        """The generator of one robot in one cycle, so that a resumed run draws the same numbers."""
        return np.random.default_rng([self.seed, cycle, robot])
