"""The true world of a 3-D episode: the surfaces that a camera sees, and the plan of the ground that a robot needs."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from mannbv import camera, geometry, grid
from mannbv.config import Config
from mannbv.world import flat
from mannbv.world.surfaces import Surfaces

_DEFAULT = Config()
BODY = (_DEFAULT.body_low, _DEFAULT.body_high)  # [m] above the floor: what a robot can run into
SAMPLES = 0.05  # [m] between samples of the surfaces


@dataclass(frozen=True, eq=False)
class Space:
    """A building in space; offers what `flat.World` does, so that the same episode runs in both.

    ground: the plan of what stands in the height of a robot's body above `floor` [m]. starts (k, 4): x, y, z [m], yaw
    [rad]; goals (k, 3) [m]; z is that of the camera. notes: what was guessed when the scene was read, a line each.
    """

    name: str
    description: str
    surfaces: Surfaces
    ground: flat.World
    floor: float
    starts: Float[np.ndarray, "k 4"]
    goals: Float[np.ndarray, "g 3"]
    notes: tuple[str, ...] = ()

    @staticmethod
    def over(ground: flat.World, surfaces: Surfaces, floor=0.0, height=_DEFAULT.camera_height, notes=()) -> "Space":
        """Surfaces around a plan: its name, starts and goals, with the camera `height` [m] above the `floor`."""
        z = floor + height
        starts = np.insert(ground.starts, 2, z, axis=1)
        goals = np.insert(ground.goals, 2, z, axis=1)
        return Space(ground.name, ground.description, surfaces, ground, floor, starts, goals, tuple(notes))

    @property
    def dim(self) -> int:
        return 3

    def placed(self, starts=None, goals=None) -> "Space":
        """With other starts (k, 3) x, y [m], yaw [rad], or goals (k, 2) [m], at the height of the present ones."""
        z = self.starts[0, 2] if len(self.starts) else self.floor + _DEFAULT.camera_height
        starts = self.starts if starts is None else np.insert(starts, 2, z, axis=1)
        return dataclasses.replace(
            self, starts=starts, goals=self.goals if goals is None else np.insert(goals, 2, z, axis=1)
        )

    def suited(self, config: Config) -> "Space":
        """With the cameras of starts and goals at the `camera_height` of a config above the floor.

        Raises ValueError for a camera above what hangs over a start, and for another body than the plan was made for.
        """
        if (config.body_low, config.body_high) != BODY:
            band = f"{BODY[0]:g} to {BODY[1]:g} m"
            raise ValueError(f"{self.name}: its plan is that of a body from {band}; leave body_low and body_high")
        starts, goals = self.starts.copy(), self.goals.copy()
        starts[:, 2] = goals[:, 2] = self.floor + config.camera_height
        feet = np.column_stack([starts[:, :2], np.full(len(starts), self.floor + BODY[0])])
        room = self.surfaces.cast(feet, np.tile([0.0, 0.0, 1.0], (len(feet), 1)))[0] + BODY[0]
        low = np.flatnonzero(room <= config.camera_height)
        if len(low):
            raise ValueError(
                f"{self.name}: {room[low[0]]:.2f} m above starts[{low[0]}] hangs something, below a camera at "
                f"{config.camera_height:g} m; lower camera_height"
            )
        return dataclasses.replace(self, starts=starts, goals=goals)

    @property
    def lower(self) -> np.ndarray:
        """Lower corner (3,) of the box around all surfaces [m]."""
        return self.surfaces.lower

    @property
    def upper(self) -> np.ndarray:
        """Upper corner (3,) of the box around all surfaces [m]."""
        return self.surfaces.upper

    @property
    def area(self) -> float:
        """Floor area [m²]."""
        return self.ground.area

    def sense(
        self,
        camera: camera.Camera,
        pose: geometry.Pose,
        max_depth=10.0,
        depth_noise=0.0,
        color_noise=0.0,
        rng: np.random.Generator | None = None,
    ) -> camera.Frame:
        """The RGB-D image of `camera` at `pose`; arguments, noise and errors as in `flat.World.sense`.

        Depth is exact at the pixels' centres; colour is the texture there, averaged over about a pixel.
        """
        if camera.dim != self.dim or pose.dim != self.dim:
            raise ValueError(f"{self.name} is in space: it needs a camera with a height and a pose in space")
        flat.check_noise(depth_noise, color_noise, rng)
        pose = pose.to(torch.zeros(0, dtype=torch.float64))
        origin = pose.position.detach().numpy(force=True)
        directions = (camera.rays(pose.position) @ pose.rotation.T).detach().numpy(force=True)
        depth, faces = self.surfaces.cast(np.broadcast_to(origin, directions.shape), directions)
        color = self.surfaces.seen(origin, directions, faces, 1 / camera.focal)
        shape = camera.shape
        return flat.frame(
            color.reshape(*shape, 3), depth.reshape(shape), pose, max_depth, depth_noise, color_noise, rng
        )

    def surface_points(self, spacing=SAMPLES) -> np.ndarray:
        """Points (n, 3) [m] on all surfaces."""
        return self.surfaces.sampled(spacing)

    # ---- the ground ----------------------------------------------------------------------------------------------

    def solid(self, points) -> np.ndarray:
        """As `flat.World.solid`, of what stands in the height of the body."""
        return self.ground.solid(points)

    def inside(self, points) -> np.ndarray:
        """Which points (k, ≥ 2) [m] lie in the building."""
        return self.ground.inside(points)

    def clearance(self, points) -> np.ndarray:
        """Horizontal distance (k,) [m] from points (k, ≥ 2) to what stands in the height of the body."""
        return self.ground.clearance(points)

    def lattice(self, cell) -> grid.Lattice:
        return self.ground.lattice(cell)

    def free_grid(self, cell, radius) -> tuple[grid.Lattice, np.ndarray]:
        return self.ground.free_grid(cell, radius)

    def reachable_free(self, cell, radius, start) -> np.ndarray:
        return self.ground.reachable_free(cell, radius, start)

    def shortest_path(self, start, goal, radius, cell=0.05) -> np.ndarray:
        """`flat.World.shortest_path` as (k, 3) [m], at the height of `start` (3,)."""
        way = self.ground.shortest_path(start, goal, radius, cell)
        return np.insert(way, 2, np.asarray(start, float)[2], axis=1)

    def check_team(self, n_robots: int, radius=0.1, cell=0.05) -> None:
        """As `flat.World.check_team`."""
        starts, goals = np.delete(self.starts, 2, axis=1), self.goals[:, :2]
        dataclasses.replace(self.ground, starts=starts, goals=goals).check_team(n_robots, radius, cell)
