"""The true world of a flatland episode: what a camera sees of it, where a robot can go, where its surfaces are."""

import dataclasses
import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from scipy import ndimage

from mannbv import camera, geometry, grid
from mannbv.config import Config
from mannbv.kernels.flat import rays

SUBRAYS = 5  # rays across a pixel whose colours are averaged; odd: the middle one gives the depth
TEXTURES = {"plain": rays.PLAIN, "stripes": rays.STRIPES, "noise": rays.NOISE}
_MOST_CELLS = 20_000_000  # of a grid over a building
SNAP = 0.3  # [m] a path may begin and end this far from the nearest free cell's centre
_BIN = 0.5  # [m] bins that hold the segments in the search for the nearest


class SceneError(ValueError):
    """A scene that cannot be used; its one line names the file, the thing and the remedy."""


@dataclass(frozen=True, eq=False)
class World:
    """A flatland scene. A 3-D one offers the same methods; plans of the ground are the same for both.

    segments (s, 4): x0, y0, x1, y1 [m] of the surfaces. colors (s, 3) in [0, 1]. textures (s, 4): kind (a value of
    `TEXTURES`), period [m], contrast, phase [m]. starts (k, 3): x, y [m], yaw [rad]. goals (k, 2) [m].
    solids, rooms: what is filled by walls and furniture, and what lies inside the building (each with `contains`).
    notes: what was guessed when the scene was read, a line each.
    """

    name: str
    description: str
    segments: Float[np.ndarray, "s 4"]
    colors: Float[np.ndarray, "s 3"]
    textures: Float[np.ndarray, "s 4"]
    starts: Float[np.ndarray, "k 3"]
    goals: Float[np.ndarray, "g 2"]
    solids: object
    rooms: object
    notes: tuple[str, ...] = ()
    _memo: dict = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self):
        if len(self.segments) == 0:
            raise SceneError(f"{self.name}: no wall borders on free space; a scene needs rooms and walls")
        for name in ("segments", "colors", "textures", "starts", "goals"):
            if not np.isfinite(getattr(self, name)).all():
                raise SceneError(f"{self.name}: {name} must be finite numbers")

    @property
    def dim(self) -> int:
        return 2

    def placed(self, starts=None, goals=None) -> "World":
        """With other starts (k, 3) x, y [m], yaw [rad], or goals (k, 2) [m]."""
        return dataclasses.replace(
            self, starts=self.starts if starts is None else starts, goals=self.goals if goals is None else goals
        )

    def suited(self, config: Config) -> "World":
        """Itself: a plane has no height."""
        return self

    @property
    def lower(self) -> np.ndarray:
        """Lower corner (2,) of the box around all surfaces [m]."""
        return self.segments.reshape(-1, 2).min(0)

    @property
    def upper(self) -> np.ndarray:
        """Upper corner (2,) of the box around all surfaces [m]."""
        return self.segments.reshape(-1, 2).max(0)

    @property
    def area(self) -> float:
        """Floor area of the building [m²]; walls between rooms and furniture included where they belong to a room."""
        return self.rooms.area

    def sense(
        self,
        camera: camera.Camera,
        pose: geometry.Pose,
        max_depth=10.0,
        depth_noise=0.0,
        color_noise=0.0,
        rng: np.random.Generator | None = None,
    ) -> camera.Frame:
        """The RGB-D image of `camera` at `pose`, exact by ray casting; float32.

        Depth is taken along the axis at the pixel's centre, 0 where nothing lies within `max_depth` [m]. Colour is
        the mean of `SUBRAYS` rays across the pixel; it reaches beyond `max_depth`, and is black where there is no
        surface at all. Noise comes from `rng`: depth has the standard deviation depth_noise · depth, each colour
        channel color_noise. Raises ValueError for a camera of the wrong dimension, or noise without `rng`.
        """
        if camera.dim != self.dim or pose.dim != self.dim:
            raise ValueError(f"{self.name} is flatland: it needs a camera without height and a pose in the plane")
        check_noise(depth_noise, color_noise, rng)
        fine = (np.arange(camera.width * SUBRAYS) + 0.5) / SUBRAYS
        slopes = (fine - camera.width / 2) / camera.focal
        rotation, origin = pose.rotation.detach().double().numpy(force=True), pose.position.detach().double()
        right, forward = np.ascontiguousarray(rotation.T)
        hits = rays.cast(self.segments, origin.numpy(force=True), right, forward, slopes)
        color = rays.shade(self.segments, self.colors, self.textures, hits[1], hits[2], SUBRAYS)
        depth = hits[0][SUBRAYS // 2 :: SUBRAYS]
        return frame(color, depth, pose, max_depth, depth_noise, color_noise, rng)

    def solid(self, points) -> np.ndarray:
        """Which points (k, ≥ 2) [m] lie inside a wall or a piece of furniture."""
        return self.solids.contains(_plane(points))

    def inside(self, points) -> np.ndarray:
        """Which points (k, ≥ 2) [m] lie in the building, furniture and its inner walls included."""
        return self.rooms.contains(_plane(points))

    def clearance(self, points) -> np.ndarray:
        """Distance (k,) [m] from points (k, ≥ 2) to the nearest surface; 0 inside walls and furniture."""
        points = _plane(points)
        distance = np.zeros(len(points))
        free = ~self.solid(points)
        distance[free] = rays.clearance(np.ascontiguousarray(points[free]), self.segments, *self._bins)
        return distance

    @cached_property
    def _bins(self):
        shape = tuple(int(n) for n in np.ceil((self.upper - self.lower) / _BIN + 1e-9) + 1)
        return self.lower, _BIN, shape, *rays.bins(self.segments, self.lower, _BIN, shape)

    def surface_points(self, spacing=0.02) -> np.ndarray:
        """Points (n, 2) [m] on all surfaces that face the inside, no further than `spacing` [m] apart along each."""
        a, b = self.segments[:, :2], self.segments[:, 2:]
        counts = np.maximum(np.ceil(np.linalg.norm(b - a, axis=1) / spacing), 1).astype(int)
        which = np.repeat(np.arange(len(a)), counts)
        order = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        return a[which] + ((order + 0.5) / counts[which])[:, None] * (b - a)[which]

    def lattice(self, cell) -> grid.Lattice:
        """Cells of `cell` [m] over the building, with a margin of two cells. Raises SceneError for far too many."""
        size = self.upper - self.lower
        if np.prod(size / cell + 4) > _MOST_CELLS:
            raise SceneError(
                f"{self.name}: {size[0]:g} × {size[1]:g} m is too large for a grid of {cell:g} m cells; are the units "
                "metres? Else give larger cells"
            )
        return grid.Lattice.around(self.lower - 2 * cell, self.upper + 2 * cell, cell)

    def free_grid(self, cell, radius) -> tuple[grid.Lattice, np.ndarray]:
        """Where a disc of `radius` [m] fits: the lattice, and (nx, ny) bool for cells whose centre is inside the
        building, not solid, and at least `radius` from every surface. Kept for the next call: do not write to it."""
        if (cell, radius) not in self._memo:
            lattice = self.lattice(cell)
            centers = lattice.centers().reshape(-1, 2)
            free = self.inside(centers)
            free[free] = self.clearance(centers[free]) >= max(radius, 1e-9)
            free = free.reshape(lattice.shape)
            free.flags.writeable = False
            self._memo[cell, radius] = lattice, free
        return self._memo[cell, radius]

    def reachable_free(self, cell, radius, start) -> np.ndarray:
        """The part (nx, ny) of `free_grid` that a disc of `radius` [m] reaches from `start` (≥ 2,) [m]."""
        _, free = self.free_grid(cell, radius)
        labels, _ = ndimage.label(free)  # sides, not corners: a diagonal move needs both cells beside it
        x, y = self._free_cell(start, radius, cell)
        return labels == labels[x, y]

    def shortest_path(self, start, goal, radius, cell=0.05) -> np.ndarray:
        """The shortest way (k, 2) [m] of a disc of `radius` [m] over the true plan's 8-connected cells.

        Both ends are given points, the rest centres of cells. Raises ValueError, naming the scene and both ends, where
        there is none.
        """
        lattice, free = self.free_grid(cell, radius)
        start, goal = np.asarray(start, float)[:2], np.asarray(goal, float)[:2]
        ends = [self._free_cell(point, radius, cell) for point in (start, goal)]
        cells = grid.path(np.where(free, 1.0, np.inf), *ends)
        if cells is None:
            raise ValueError(
                f"{self.name}: no way for a robot of radius {radius:g} m from {_text(start)} to {_text(goal)}; "
                "choose another goal or a smaller radius"
            )
        return np.concatenate([start[None], lattice.centers(cells[1:-1]), goal[None]])

    def _free_cell(self, point, radius, cell) -> np.ndarray:
        """The free cell at `point`, or the nearest one within `SNAP`."""
        lattice, free = self.free_grid(cell, radius)
        index = np.clip(lattice.index(np.asarray(point, float)[None]), 0, np.array(lattice.shape) - 1)
        near, _ = grid.nearest(free, index)
        if not free.any() or math.dist(lattice.centers(near)[0], point[:2]) > SNAP:
            raise ValueError(
                f"{self.name}: {_text(point)} is no place for a robot of radius {radius:g} m; "
                "move it away from walls and furniture, or choose a smaller radius"
            )
        return near[0]

    def check_team(self, n_robots: int, radius=0.1, cell=0.05) -> None:
        """Raises ValueError unless `n_robots` robots of `radius` [m] can start, and each can reach its goal."""
        most = min(len(self.starts), len(self.goals))
        if n_robots < 1:
            raise ValueError(f"{self.name}: a team needs at least one robot, got {n_robots}")
        if n_robots > most:
            remedy = "ask for fewer robots" if most else "add some to the scene"
            raise ValueError(f"{self.name}: {n_robots} robots, but only {most} starts and goals; {remedy}")
        for what, places in (("starts", self.starts), ("goals", self.goals)):
            for k, place in enumerate(places[:n_robots]):
                if not self.inside(place[None])[0] or self.clearance(place[None])[0] < radius:
                    where = "inside a wall or furniture" if self.solid(place[None])[0] else "too near to a wall"
                    where = where if self.inside(place[None])[0] else "outside the building"
                    raise ValueError(
                        f"{self.name}: {what}[{k}] at {_text(place)} lies {where} for a robot of radius {radius:g} m; "
                        "move it into free space"
                    )
        for k in range(n_robots):
            self.shortest_path(self.starts[k], self.goals[k], radius, cell)


def check_noise(depth_noise, color_noise, rng) -> None:
    """Raises ValueError for noise without a generator."""
    if (depth_noise > 0 or color_noise > 0) and rng is None:
        raise ValueError("sense: noise needs a generator, pass rng=numpy.random.default_rng(seed)")


def frame(color, depth, pose: geometry.Pose, max_depth, depth_noise, color_noise, rng) -> camera.Frame:
    """What the sensor makes of true colours (…, 3) and depths (…) [m]: its range, its noise, single precision."""
    depth = np.where(depth <= max_depth, depth, 0.0)
    if depth_noise > 0:
        depth = np.maximum(depth * (1 + depth_noise * rng.standard_normal(depth.shape)), 0.0)
    if color_noise > 0:
        color = np.clip(color + color_noise * rng.standard_normal(color.shape), 0.0, 1.0)
    return camera.Frame(torch.tensor(color, dtype=torch.float32), torch.tensor(depth, dtype=torch.float32), pose)


def _plane(points) -> np.ndarray:
    return np.asarray(points, float)[:, :2]


def _text(point) -> str:
    return f"({point[0]:.2f}, {point[1]:.2f})"
