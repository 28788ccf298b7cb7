"""What a robot has, and what stays the same through an episode."""

import dataclasses
from dataclasses import dataclass, field

import networkx as nx
import numpy as np
import torch

from mannbv import grid, information, messages, planner, risk, splats, world
from mannbv.camera import Camera, Frame
from mannbv.config import Config
from mannbv.mapping import LocalMap
from mannbv.objective import Belief
from mannbv.splats import SplatMap

_SCOUT = 128  # [px]; chosen here


@dataclass(frozen=True)
class Guests:
    """Splats received from teammates, keyed by sender (n,) and id (n,): never fitted, never passed on."""

    splats: SplatMap
    senders: torch.Tensor
    ids: torch.Tensor
    prior: torch.Tensor

    @staticmethod
    def none(dim: int) -> "Guests":
        nobody = torch.zeros(0, dtype=torch.int64)
        return Guests(SplatMap.empty(dim), nobody, nobody, torch.zeros(0, information.n_parameters(dim)))

    def _where(self, keep: torch.Tensor) -> "Guests":
        return Guests(self.splats.select(keep), self.senders[keep], self.ids[keep], self.prior[keep])

    def received(self, message: messages.Splats) -> "Guests":
        """With a teammate's splats: a whole map replaces all of its earlier ones, a part those with the same ids."""
        theirs = self.senders == message.robot
        stale = theirs if message.whole else theirs & torch.isin(self.ids, message.ids.long())
        kept = self._where(~stale)
        senders = torch.full((message.splats.n_splats,), message.robot)
        ids = message.ids.long()
        return Guests(
            splats.union(kept.splats, message.splats),
            torch.cat([kept.senders, senders]),
            torch.cat([kept.ids, ids]),
            torch.cat([kept.prior, message.prior]),
        )


@dataclass(frozen=True)
class Robot:
    """Everything one robot has: where it is, its private map, what it was sent, what it plans.

    position, goal (d,) [m]; yaw [rad]. frames: taken but not yet mapped. trail (k, d): where it has been [m].
    plans: the announced plans, by robot, its own included; none of robots at their goals. heard: teammates' grids
    (centralized only). tried: (x, y) [m] of subgoals already looked at. status: "moving", "reached" or "stuck";
    stuck: cycles in a row without a route. collisions: steps that ended nearer to a true surface than its radius.
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
    heard: dict[int, grid.Occupancy] = field(default_factory=dict)
    plans: dict[int, messages.Plan] = field(default_factory=dict)
    route: planner.Route | None = None
    tried: tuple = ()
    status: str = "moving"
    stuck: int = 0
    collisions: int = 0

    def replace(self, **changes) -> "Robot":
        return dataclasses.replace(self, **changes)

    @property
    def announced(self) -> float:
        """The yaw that this robot would choose alone [rad]."""
        return self.plans[self.index].yaw if self.index in self.plans else self.yaw

    def belief(self, config: Config | None = None) -> Belief:
        """What it may evaluate on: its own map and its guests, its own ground and the grids it was sent.

        The ground is cut to what is known, its own place and its goal, with a metre around. By the `block_opacity` of a
        config, opaque splats tell of what stands where no depth has shown the ground; never of what is free.
        """
        both = splats.union(self.local.splats, self.guests.splats)
        ground = self.ground.merged(*self.heard.values()).cropped(np.stack([self.position, self.goal]), 1.0)
        if config is not None and config.block_opacity < 1:
            solid = risk.in_reach(both, self.position[2:], config) & (both.opacities > config.block_opacity)
            ground = ground.blocked(both.means[solid].numpy())
        return Belief(both, torch.cat([self.local.prior, self.guests.prior]), ground)


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
        """The camera for looks that only carve the ground: the same view in at most `_SCOUT` pixels a side."""
        width, height = (min(n, _SCOUT) for n in (self.config.image_width, self.config.image_height))
        return Camera.of_dim(self.world.dim, width, height, self.config.fov)

    def rng(self, cycle: int, robot: int) -> np.random.Generator:
        """The generator of one robot in one cycle, so that a resumed run draws the same numbers."""
        return np.random.default_rng([self.seed, cycle, robot])
