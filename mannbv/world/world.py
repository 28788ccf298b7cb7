"""The true world of an episode, in the plane or in space: what a camera senses there, where a team starts and goes."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import ArrayLike

from mannbv.camera import Camera, Frame
from mannbv.config import Config
from mannbv.geometry import Pose
from mannbv.world.errors import SceneError
from mannbv.world.ground import EYE, Ground
from mannbv.world.segments import Segments
from mannbv.world.surfaces import Surfaces


@dataclass(frozen=True, eq=False)
class World:
    """A scene: what a camera meets in it and what a robot stands on.

    starts (k, d + 1): position [m], yaw [rad]. goals (k, d) [m]. In space z is that of the camera. notes: what was
    guessed when the scene was read, a line each. Raises SceneError for places that are not finite.
    """

    name: str
    description: str
    seen: Segments | Surfaces
    ground: Ground
    starts: Float[np.ndarray, "k _"]
    goals: Float[np.ndarray, "g _"]
    notes: tuple[str, ...] = ()

    def __post_init__(self):
        for name in ("starts", "goals"):
            if not np.isfinite(getattr(self, name)).all():
                raise SceneError(f"{self.name}: {name} must be finite numbers")

    @property
    def dim(self) -> int:
        """2 in flatland, 3 in space."""
        return self.seen.dim

    def placed(self, starts: ArrayLike | None = None, goals: ArrayLike | None = None) -> "World":
        """With other starts (k, 3) x, y [m], yaw [rad], or goals (k, 2) [m], at the height of the first start.

        Raises SceneError for rows of another length.
        """
        standing = len(self.starts) > 0
        above = self.starts[0, 2:-1] if standing else np.full(self.dim - 2, self.ground.floor + EYE)
        changes = {}
        for name, given, width in (("starts", starts, 3), ("goals", goals, 2)):
            if given is not None:
                rows = np.atleast_2d(np.asarray(given, float))
                if rows.shape[1:] != (width,):
                    raise SceneError(f"{self.name}: {name} must be rows of {width} finite numbers")
                changes[name] = np.concatenate([rows[:, :2], np.tile(above, (len(rows), 1)), rows[:, 2:]], 1)
        return dataclasses.replace(self, **changes)

    def suited(self, config: Config) -> "World":
        """With the cameras of starts and goals at the `camera_height` of a config above the floor of a space.

        Raises ValueError for a camera above what hangs over a start, and for another body than the plan was made for.
        """
        if self.seen.dim == 2:  # a plane has no height
            return self
        low, high = self.ground.body
        if (config.body_low, config.body_high) != (low, high):
            band = f"{low:g} to {high:g} m"
            raise ValueError(f"{self.name}: its plan is that of a body from {band}; leave body_low and body_high")
        starts, goals = self.starts.copy(), self.goals.copy()
        starts[:, 2] = goals[:, 2] = self.ground.floor + config.camera_height
        feet = np.column_stack([starts[:, :2], np.full(len(starts), self.ground.floor + low)])
        room = self.seen.cast(feet, np.tile([0.0, 0.0, 1.0], (len(feet), 1)))[0] + low
        hidden = np.flatnonzero(room <= config.camera_height)
        if len(hidden):
            raise ValueError(
                f"{self.name}: {room[hidden[0]]:.2f} m above starts[{hidden[0]}] hangs something, below a camera at "
                f"{config.camera_height:g} m; lower camera_height"
            )
        return dataclasses.replace(self, starts=starts, goals=goals)

    def sense(
        self,
        camera: Camera,
        pose: Pose,
        max_depth: float = 10.0,
        depth_noise: float = 0.0,
        color_noise: float = 0.0,
        rng: np.random.Generator | None = None,
    ) -> Frame:
        """The RGB-D image of `camera` at `pose`, by ray casting; float32.

        Depth is taken along the axis at the pixel's centre, 0 where nothing lies within `max_depth` [m]. Colour is
        averaged over the pixel; it reaches beyond `max_depth`, and is black where there is no surface at all. Noise
        comes from `rng`: depth has the standard deviation depth_noise · depth, each colour channel color_noise.
        Raises ValueError for a camera or pose of the wrong dimension, or noise without `rng`.
        """
        if not camera.dim == pose.dim == self.dim:
            raise ValueError(
                f"{self.name} has {self.dim} dimensions, but the camera {camera.dim} and the pose {pose.dim}; "
                "a camera of flatland has no height"
            )
        pose = pose.to(torch.zeros(0, dtype=torch.float64))
        color, depth = self.seen.view(camera, pose)
        depth = np.where(depth <= max_depth, depth, 0.0)
        if rng is None and (depth_noise > 0 or color_noise > 0):
            raise ValueError("sense: noise needs a generator, pass rng=numpy.random.default_rng(seed)")
        if rng is not None and depth_noise > 0:
            depth = np.maximum(depth * (1 + depth_noise * rng.standard_normal(depth.shape)), 0.0)
        if rng is not None and color_noise > 0:
            color = np.clip(color + color_noise * rng.standard_normal(color.shape), 0.0, 1.0)
        return Frame(torch.tensor(color, dtype=torch.float32), torch.tensor(depth, dtype=torch.float32), pose)

    def check_team(self, n_robots: int, radius: float = 0.1, cell: float = 0.05) -> None:
        """Raises ValueError unless `n_robots` robots of `radius` [m] can start, and each can reach its goal."""
        most = min(len(self.starts), len(self.goals))
        if n_robots < 1:
            raise ValueError(f"{self.name}: a team needs at least one robot, got {n_robots}")
        if n_robots > most:
            remedy = "ask for fewer robots" if most else "add some to the scene"
            raise ValueError(f"{self.name}: {n_robots} robots, but only {most} starts and goals; {remedy}")
        for what, places in (("starts", self.starts), ("goals", self.goals)):
            for k, place in enumerate(places[:n_robots]):
                if fault := self.ground.unfit(place, radius):
                    raise ValueError(f"{self.name}: {what}[{k}] at {fault}")
        try:
            for start, goal in zip(self.starts[:n_robots], self.goals[:n_robots], strict=True):
                self.ground.shortest_path(start, goal, radius, cell)
        except ValueError as error:
            raise ValueError(f"{self.name}: {error}") from None
