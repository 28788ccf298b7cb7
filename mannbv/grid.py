"""The ground plane in square cells: occupancy from depth, graph distances, frontiers (Sections III-D, VI-A).

Arrays are indexed [ix, iy]; cell (0, 0) has its lower corner at the lattice's origin.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage, spatial

from mannbv.config import Config
from mannbv.kernels import search

UNKNOWN, FREE, OCCUPIED = -1, 0, 1
_DEFAULT = Config()


@dataclass(frozen=True)
class Lattice:
    """Where the cells lie: origin (x, y) [m] of the lower corner, cell size [m], number of cells (nx, ny)."""

    origin: tuple[float, float]
    cell: float
    shape: tuple[int, int]

    @staticmethod
    def around(lower: ArrayLike, upper: ArrayLike, cell: float) -> "Lattice":
        """The smallest lattice over a box given by two corners [m]."""
        low, high = np.asarray(lower, float), np.asarray(upper, float)
        shape = np.ceil((high - low) / cell - 1e-9).astype(int)
        if not (np.isfinite(shape).all() and (shape > 0).all()):
            raise ValueError(f"grid: the box from {low.tolist()} to {high.tolist()} is empty")
        return Lattice((float(low[0]), float(low[1])), float(cell), (int(shape[0]), int(shape[1])))

    def index(self, points: ArrayLike) -> np.ndarray:
        """Cells (k, 2) that hold points (k, ≥ 2) [m]; may lie outside the lattice."""
        return np.floor((np.asarray(points, float)[:, :2] - self.origin) / self.cell).astype(np.int64)

    def inside(self, index: np.ndarray) -> np.ndarray:
        """Which cells (k, 2) belong to the lattice."""
        return np.all((index >= 0) & (index < self.shape), axis=1)

    def centers(self, index: ArrayLike | None = None) -> np.ndarray:
        """Centres [m] of the given cells (k, 2), or of all as (nx, ny, 2)."""
        if index is None:
            index = np.stack(np.meshgrid(*(np.arange(n) for n in self.shape), indexing="ij"), -1)
        return (np.asarray(index) + 0.5) * self.cell + self.origin

    def at(self, values: np.ndarray, points: ArrayLike, outside: float) -> np.ndarray:
        """Cell values under points (k, ≥ 2) [m]; `outside` where there is no cell."""
        index = self.index(points)
        inside = self.inside(index)
        clipped = np.where(inside[:, None], index, 0)
        return np.where(inside, values[clipped[:, 0], clipped[:, 1]], outside)


@dataclass(frozen=True)
class Occupancy:
    """What one robot knows of the ground: log_odds (nx, ny) of "occupied"; 0 where never seen."""

    lattice: Lattice
    log_odds: np.ndarray

    @staticmethod
    def unknown(lattice: Lattice) -> "Occupancy":
        return Occupancy(lattice, np.zeros(lattice.shape, np.float32))

    @property
    def state(self) -> np.ndarray:
        """(nx, ny) of UNKNOWN, FREE, OCCUPIED."""
        return np.where(self.log_odds == 0, UNKNOWN, np.where(self.log_odds > 0, OCCUPIED, FREE)).astype(np.int8)

    def carved(self, origin: ArrayLike, ends: ArrayLike, hits: ArrayLike, config: Config = _DEFAULT) -> "Occupancy":
        """After seeing rays from `origin` (≥ 2,) to `ends` (k, ≥ 2) [m]; `hits` (k,): the ray ended on a surface.

        A hit outweighs several passes, since a ray that grazes a wall also crosses the free part of its cells; one
        frame changes a cell at most once, and a hit wins over a pass. How much each tells: `evidence_…` of a config.
        """
        ends = np.asarray(ends, float)[:, :2]
        starts = np.broadcast_to(np.asarray(origin, float)[:2], ends.shape)
        window = self._window(starts, ends)
        free, hit = self._crossed(window, starts, ends, hits)
        log_odds = self.log_odds.copy()
        change = np.where(hit, config.evidence_hit, np.where(free, -config.evidence_pass, 0.0)).astype(np.float32)
        log_odds[window] = _bounded(log_odds[window] + change, (log_odds[window] != 0) | free | hit, config)
        return Occupancy(self.lattice, log_odds)

    def carved_around(
        self, origin: ArrayLike, ends: ArrayLike, hits: ArrayLike, low: float, high: float, config: Config = _DEFAULT
    ) -> "Occupancy":
        """`carved` for rays in space, of what stands between the heights `low` and `high` [m]; ends (k, 3) [m].

        A surface hit there is taken as certain. A ray says that a cell is free where it runs at most `low_ray` above
        `low`, or ends on the floor: something may stand beneath higher ones. These count only around the robot, too
        near for the steepest ray to be low, and only where nothing is known yet. Where something was hit, rays that
        clear the cell say little (`evidence_doubt`): it may hang above them. One that falls through the floor blocks.
        """
        origin, ends, hits = np.asarray(origin, float), np.array(ends, float), np.asarray(hits, bool)
        near, passed = config.low_ray, config.evidence_pass
        sinks = hits & (ends[:, 2] < low - near)  # to a storey below, through a hole that one would fall into
        ends[sinks] = origin + (ends[sinks] - origin) * ((origin[2] - low) / (origin[2] - ends[sinks, 2]))[:, None]
        along, fall = (ends - origin)[:, :2], origin[2] - ends[:, 2]
        length = np.linalg.norm(along, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            leave = np.where(ends[:, 2] > high, np.clip((origin[2] - high) / fall, 0, 1), 1.0)
            enter = np.where(ends[:, 2] < low + near, np.clip((origin[2] - low - near) / fall, 0, 1), 1.0)
            blind = (origin[2] - low - near) / np.max(fall / length, initial=0.0)  # [m] what no ray shows from near
            leave = np.minimum(leave, blind / length)
        start = np.broadcast_to(origin[:2], along.shape)
        window = self._window(start, ends)
        above, _ = self._crossed(window, start, start + leave[:, None] * along, np.zeros(len(ends), bool))
        blocked = sinks | (hits & (ends[:, 2] >= low) & (ends[:, 2] <= high))
        tell = blocked | ((enter < 1) & (hits | (ends[:, 2] >= low)))  # where no floor is met there may be none
        begin = start + enter[:, None] * along
        clear, hit = self._crossed(window, begin[tell], ends[tell, :2], blocked[tell])
        log_odds = self.log_odds.copy()
        old = log_odds[window]
        fresh = np.where(clear | (above & (old == 0)), old - passed, old)
        eased = np.where(old > 0, old - config.evidence_doubt * clear, fresh)
        new = np.where(hit, np.maximum(old, 0.0) + config.evidence_hit, eased).astype(np.float32)
        log_odds[window] = _bounded(new, (old != 0) | above | clear | hit, config)
        return Occupancy(self.lattice, log_odds)

    def _window(self, *points) -> tuple[slice, slice]:
        """The part of the cells around points (k, ≥ 2) [m], as far as they lie in the lattice."""
        cells = self.lattice.index(np.concatenate([p[:, :2] for p in points]))
        if not len(cells):
            return np.s_[:0, :0]
        low = np.clip(cells.min(0), 0, self.lattice.shape)
        high = np.clip(cells.max(0) + 1, low, self.lattice.shape)
        return np.s_[low[0] : high[0], low[1] : high[1]]

    def _crossed(self, window, starts, ends, hits) -> tuple[np.ndarray, np.ndarray]:
        """Which cells of a window rays cross, and in which they hit something; starts, ends (k, 2) [m], hits (k,)."""
        free, hit = (np.zeros_like(self.log_odds[window], bool) for _ in range(2))
        corner = np.array([part.start or 0 for part in window])
        starts, ends = ((points - self.lattice.origin) / self.lattice.cell - corner for points in (starts, ends))
        search.carve(free, hit, starts, ends, np.asarray(hits, bool))
        return free, hit

    def blocked(self, points: ArrayLike, config: Config = _DEFAULT) -> "Occupancy":
        """With the unknown cells that hold one of the points (k, ≥ 2) [m] taken for occupied."""
        cells = self.lattice.index(points)
        x, y = cells[self.lattice.inside(cells)].T
        log_odds = self.log_odds.copy()
        log_odds[x, y] = np.where(log_odds[x, y] == 0, config.evidence_hit, log_odds[x, y])
        return Occupancy(self.lattice, log_odds)

    def cropped(self, points: ArrayLike, margin: float) -> "Occupancy":
        """Only the box around the known cells and the given points (k, ≥ 2) [m], `margin` [m] wider on every side."""
        known = self.log_odds != 0
        along = [np.flatnonzero(known.any(1 - axis))[[0, -1]] for axis in (0, 1)] if known.any() else []
        cells = np.concatenate([np.array(along, int).reshape(2, -1).T, self.lattice.index(points)])
        rim = int(np.ceil(margin / self.lattice.cell))
        low = np.clip(cells.min(0) - rim, 0, np.array(self.lattice.shape) - 1)
        high = np.clip(cells.max(0) + rim + 1, low + 1, self.lattice.shape)
        corner = np.array(self.lattice.origin) + low * self.lattice.cell
        shape = (int(high[0] - low[0]), int(high[1] - low[1]))
        lattice = Lattice((float(corner[0]), float(corner[1])), self.lattice.cell, shape)
        return Occupancy(lattice, self.log_odds[low[0] : high[0], low[1] : high[1]])

    def merged(self, *others: "Occupancy", config: Config = _DEFAULT) -> "Occupancy":
        """Evidence of several robots, added up over a lattice that holds all of theirs (windows of one grid).

        Raises ValueError for grids whose cells do not coincide.
        """
        if all(o.lattice == self.lattice for o in others):
            lattice, spread = self.lattice, [self.log_odds, *(o.log_odds for o in others)]
        else:
            lattice, spread = _over_one_lattice([self, *others])
        layers = np.stack(spread)
        return Occupancy(lattice, _bounded(layers.sum(0), (layers != 0).any(0), config))


def _over_one_lattice(several: list[Occupancy]) -> tuple[Lattice, list[np.ndarray]]:
    """The smallest lattice that holds all, and each one's log-odds on it."""
    cell, base = several[0].lattice.cell, np.array(several[0].lattice.origin)
    shifts = np.stack([(np.array(o.lattice.origin) - base) / cell for o in several])
    if any(o.lattice.cell != cell for o in several) or np.abs(shifts - np.round(shifts)).max() > 1e-3:
        raise ValueError("grid: occupancies merge only where their cells coincide; give them the same cell and origin")
    low = np.round(shifts).astype(int)
    shape = (low + [o.lattice.shape for o in several]).max(0) - low.min(0)
    corner = base + low.min(0) * cell
    spread = []
    for (x, y), occupancy in zip(low - low.min(0), several, strict=True):
        layer = np.zeros(shape, np.float32)
        layer[x : x + occupancy.lattice.shape[0], y : y + occupancy.lattice.shape[1]] = occupancy.log_odds
        spread.append(layer)
    return Lattice((float(corner[0]), float(corner[1])), cell, (int(shape[0]), int(shape[1]))), spread


def _bounded(log_odds: np.ndarray, seen: np.ndarray, config: Config) -> np.ndarray:
    """Clipped evidence. A tie in a seen cell counts as occupied, to be careful: exactly 0 means never seen."""
    tie = seen & (np.abs(log_odds) < 1e-3)
    return np.where(tie, 1e-3, np.clip(log_odds, -config.evidence_free, config.evidence_occupied)).astype(np.float32)


def within(cells: np.ndarray, distance: float, cell: float) -> np.ndarray:
    """Which cells' centres lie nearer than `distance` [m] to the centre of a marked cell."""
    if not cells.any():
        return np.zeros_like(cells, bool)
    return ndimage.distance_transform_edt(~cells) * cell < distance


def nearest(cells: np.ndarray, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For cells (k, 2): the nearest marked cell (k, 2) and the distance to it in cells; inf where none is marked."""
    if not cells.any():
        return index, np.full(len(index), np.inf)
    distance, where = ndimage.distance_transform_edt(~cells, return_indices=True)
    x, y = index.T
    return where[:, x, y].T, distance[x, y]


def beside(cells: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For places (k, 2) on the lattice, in cells from its corner: the marked cell (k, 2) whose centre is nearest, and
    how far that cell is from the place's own, in cells; inf where none is marked.

    Unlike `nearest` it knows on which side of its cell a place lies, so that a wall of one cell has two sides.
    """
    inner = np.floor(places).astype(int)
    outside, found = ~cells[inner[:, 0], inner[:, 1]], inner.copy()
    if outside.any():
        rim = np.argwhere(cells & ~ndimage.minimum_filter(cells, 3))  # where a way in must end
        if not len(rim):
            return inner, np.full(len(inner), np.inf)
        found[outside] = rim[spatial.cKDTree(rim + 0.5).query(places[outside])[1]]
    return found, np.linalg.norm(found - inner, axis=1)


def _check_cells(cost: np.ndarray, cells: np.ndarray) -> None:
    """The kernels do not look whether a cell exists."""
    wrong = cells[((cells < 0) | (cells >= cost.shape)).any(1)]
    if len(wrong):
        raise ValueError(f"grid: cell {tuple(wrong[0].tolist())} lies outside the lattice of {cost.shape} cells")


def geodesic(cost: np.ndarray, sources: np.ndarray, limit: float = np.inf) -> np.ndarray:
    """Cheapest cost (nx, ny), in cells, from the nearest source cell (k, 2); inf where there is no way.

    cost (nx, ny): price of a cell, inf where blocked; 1 everywhere gives the graph distance ‖·‖_g of Eq. (13).
    """
    sources = np.asarray(sources, np.int64).reshape(-1, 2)
    _check_cells(cost, sources)
    return search.shortest(np.asarray(cost, float), sources, np.array([-1, -1]), float(limit))[0]


def path(cost: np.ndarray, start: ArrayLike, goal: ArrayLike) -> np.ndarray | None:
    """Cells (k, 2) of a cheapest path by A*, both ends included; None where there is no way."""
    start, goal = np.asarray(start, np.int64), np.asarray(goal, np.int64)
    _check_cells(cost, np.stack([start, goal]))
    distance, parent = search.shortest(np.asarray(cost, float), start[None], goal, np.inf)
    if not np.isfinite(distance[goal[0], goal[1]]):
        return None
    cells, here = [], int(goal[0] * cost.shape[1] + goal[1])
    while here >= 0:
        cells.append(divmod(here, cost.shape[1]))
        here = int(parent[cells[-1]])
    return np.array(cells[::-1])


def frontiers(state: np.ndarray, min_cells: int = 1) -> list[np.ndarray]:
    """Frontiers: 8-connected groups, of at least `min_cells`, of free cells beside an unknown one; (k, 2) each."""
    unknown = ndimage.binary_dilation(state == UNKNOWN, structure=[[0, 1, 0], [1, 1, 1], [0, 1, 0]])
    labels, count = ndimage.label((state == FREE) & unknown, structure=np.ones((3, 3)))
    boxes = ndimage.find_objects(labels)
    groups = [np.argwhere(labels[box] == k + 1) + [s.start for s in box] for k, box in enumerate(boxes[:count])]
    return [group for group in groups if len(group) >= min_cells]
