"""What a robot maximises: F_i of the team's N yaws, tabulated yaw by yaw or given as a function (Section V-C).

Tables hold gains on M uniform yaws, −π + 2π m / M, of a periodic function, linear in between. Linear, since its
largest value stands at a node, where a view was evaluated, so that nothing promises more than the best of those; and
since gains in flatland ripple from node to node: on 105 profiles of the flat at 1°, against yaws four times as dense,
smoother interpolants erred more (trigonometric 2.2 % rms, cubic 1.8, linear 1.7) and their best yaws reached less of
what could be had (0.975, 0.980 and 0.989). In space, where profiles are smooth, linear gives away 0.1 %. The team
objective is separable, F_i(T) = Σ_k f_ik(T_k), so a table per (i, k) says everything, and the optimum is known: for
each k the best node of Σ_i f_ik.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from numpy.typing import ArrayLike
from scipy import optimize, signal

from mannbv import geometry

Function = Callable[[np.ndarray], float]  # F_i of the N yaws
Objectives = np.ndarray | Sequence[Function]  # a table (N, N, M), or N functions
TIE = 1e-12  # stiffness where nothing pulls: of equally good yaws the one nearest to the present wins


def grid(n_yaws: int) -> Float[np.ndarray, " yaws"]:
    """The M uniform yaws of a table or a profile [rad], −π + 2π m / M."""
    return 2 * np.pi * np.arange(n_yaws) / n_yaws - np.pi


def interpolate(gains: Float[np.ndarray, "*rows yaws"], yaws: ArrayLike, slope: bool = False) -> np.ndarray:
    """Periodic functions at one yaw [rad] each, linear between the nodes of their tables; or their slopes [1/rad].

    A slope is the central difference over one pitch to either side: continuous, and 0 on top of an even hill.
    """
    at, n = np.asarray(yaws, float), gains.shape[-1]
    if slope:
        pitch = 2 * np.pi / n
        return (interpolate(gains, at + pitch) - interpolate(gains, at - pitch)) / (2 * pitch)
    place = (at + np.pi) * n / (2 * np.pi)
    place = np.where(np.abs(place - np.rint(place)) < 1e-9, np.rint(place), place)  # a node keeps its very gain
    low = np.floor(place)
    shape = np.broadcast_shapes(gains.shape[:-1], low.shape)
    table, node = np.broadcast_to(gains, (*shape, n)), np.broadcast_to(low.astype(int), shape)[..., None]
    here, there = (np.take_along_axis(table, index % n, -1)[..., 0] for index in (node, node + 1))
    between = here + (place - low) * (there - here)
    return np.clip(between, np.minimum(here, there), np.maximum(here, there))  # rounding must not exceed the nodes


@dataclass(frozen=True, eq=False)
class Tabulated:
    """F(yaws) = Σ_k f_k(yaws[k]), from a table gains (N, M)."""

    gains: Float[np.ndarray, "robots yaws"]

    def value(self, yaws: np.ndarray) -> float:
        return float(interpolate(self.gains, yaws).sum())

    def gradient(self, yaws: np.ndarray) -> np.ndarray:
        return interpolate(self.gains, yaws, slope=True)

    def minimise(
        self, origin: np.ndarray, first: np.ndarray, center: np.ndarray, stiffness: float, circle: bool
    ) -> np.ndarray:
        """argmin over real offsets x (N,) of −F(origin + x) + stiffness/2 ‖x − center‖², globally; `first` is unused.

        N searches in one dimension: between two nodes this is a parabola, whose minimum is known. On the circle f_k is
        periodic, so a minimiser lies within ±π of the quadratic's: any other one can come 2π nearer for free. Off the
        circle, x is confined to [−π, π].
        """
        n = self.gains.shape[1]
        pitch = 2 * np.pi / n
        lowest = np.floor((origin + center) / pitch).astype(int) - 1 if circle else np.zeros(len(center), int)
        nodes = lowest[:, None] + np.arange(n + (3 if circle else 1))
        ends, values = pitch * nodes - np.pi - origin[:, None], np.take_along_axis(self.gains, nodes % n, 1)
        slopes = np.diff(values) / pitch
        lows = np.clip(center[:, None] + slopes / stiffness, ends[:, :-1], ends[:, 1:])
        energy = stiffness / 2 * (lows - center[:, None]) ** 2 - values[:, :-1] - slopes * (lows - ends[:, :-1])
        return np.take_along_axis(lows, energy.argmin(1)[:, None], 1)[:, 0]


@dataclass(frozen=True, eq=False)
class Called:
    """F as a function of the N yaws, divided by `scale`; slope: its gradient, by default its own `.gradient(yaws)`."""

    function: Function
    scale: float = 1.0
    slope: Callable[[np.ndarray], np.ndarray] | None = None

    def __call__(self, yaws: np.ndarray) -> float:
        return self.value(yaws)

    def value(self, yaws: np.ndarray) -> float:
        value = float(self.function(np.array(yaws))) / self.scale
        if not np.isfinite(value):
            raise ValueError(f"consensus: an objective returned {value} at yaws {np.round(yaws, 4).tolist()}")
        return value

    def gradient(self, yaws: np.ndarray) -> np.ndarray:
        slope = self.slope or getattr(self.function, "gradient", None)
        if slope is not None:
            return np.asarray(slope(np.array(yaws)), float) / self.scale
        nudges = 1e-5 * np.eye(len(yaws))
        return np.array([(self.value(yaws + nudge) - self.value(yaws - nudge)) / 2e-5 for nudge in nudges])

    def minimise(
        self, origin: np.ndarray, first: np.ndarray, center: np.ndarray, stiffness: float, circle: bool
    ) -> np.ndarray:
        """As `Tabulated.minimise`, but a local minimum, by BFGS from `first`."""

        def energy(x):
            return stiffness / 2 * ((x - center) ** 2).sum() - self.value(origin + x)

        def slope(x):
            return stiffness * (x - center) - self.gradient(origin + x)

        if circle:
            return optimize.minimize(energy, first, jac=slope, method="BFGS", options={"gtol": 1e-8}).x
        box = [(-np.pi, np.pi)] * len(center)
        options = {"gtol": 1e-8, "ftol": 1e-15}
        return optimize.minimize(energy, first, jac=slope, method="L-BFGS-B", bounds=box, options=options).x


def checked(objectives: Objectives) -> np.ndarray | list[Function]:
    """The (N, N, M) table or the list of N functions. Raises ValueError for anything else."""
    if isinstance(objectives, (list, tuple)) and objectives and all(callable(f) for f in objectives):
        return list(objectives)
    try:
        table = np.asarray(objectives, float)
    except (TypeError, ValueError):
        raise ValueError("consensus: objectives must be an (N, N, M) array or a list of N functions") from None
    if table.size == 0:
        raise ValueError("consensus: no objectives; a team needs at least one robot")
    if table.ndim != 3 or table.shape[0] != table.shape[1]:
        raise ValueError(f"consensus: objectives must be of shape (N, N, M) or N functions, got {table.shape}")
    if table.shape[2] < 4:
        raise ValueError(f"consensus: objectives need at least 4 yaws a view, got {table.shape[2]}")
    bad = np.argwhere(~np.isfinite(table))
    if len(bad):
        i, k, m = bad[0].tolist()
        raise ValueError(f"consensus: the gain of robot {k}'s view in robot {i}'s map is not finite at yaw number {m}")
    return table


def scale_of(objectives: Objectives | Function) -> float:
    """The largest absolute gain in a table of any shape; 1 for an all-zero table and for functions.

    Divide every robot's objective by the *same* number, else robots with small gains count too much. A team gets it
    exactly by telling each other one scalar: the largest of every robot's own `scale_of`.
    """
    if callable(objectives) or (isinstance(objectives, list) and all(callable(f) for f in objectives)):
        return 1.0
    return float(np.abs(np.asarray(objectives, float)).max()) or 1.0


def value(objectives: Objectives, yaws: ArrayLike) -> float:
    """The team's objective Σ_i F_i(yaws), Eq. (25), in the objectives' own unit; no table's exceeds that of its
    `best_yaws`."""
    if all(callable(f) for f in objectives):
        return sum(Called(f).value(np.asarray(yaws, float)) for f in objectives)
    return float(interpolate(np.asarray(objectives, float).sum(0), yaws).sum())


def tabulate(
    functions: Sequence[Function], announced: ArrayLike, n_yaws: int = 72
) -> Float[np.ndarray, "robots robots yaws"]:
    """Functions as an (N, N, M) table: each yaw in turn swept, the others as announced. Exact if F is separable."""
    near = np.asarray(announced, float)
    n = len(near)
    table = np.empty((n, n, n_yaws))
    for i, k in np.ndindex(n, n):
        yaws = np.tile(near, (n_yaws, 1))
        yaws[:, k] = grid(n_yaws)
        table[i, k] = [Called(functions[i]).value(row) for row in yaws]
    return table


def best_yaws(gains: Float[np.ndarray, "robots yaws"], near: ArrayLike) -> Float[np.ndarray, " robots"]:
    """argmax of each row [rad]; of equally good yaws the one nearest to `near` (N,), which on a flat top is `near`."""
    here, top = np.asarray(near, float), gains.max(1)
    nodes = grid(gains.shape[1])
    away = np.where(gains == top[:, None], np.abs(geometry.wrap(nodes - here[:, None])), np.inf)
    return np.where(interpolate(gains, here) == top, geometry.wrap(here), nodes[away.argmin(1)])


def quantise(
    gains: Float[np.ndarray, " yaws"], bins: int = 36, bits: int = 8
) -> tuple[UInt8[np.ndarray, " bins"], float]:
    """A profile in few bytes: `bins` levels of at most 8 bits above its minimum, and the height of one level.

    The minimum itself is not kept, since an argmax does not need it.
    """
    if not (bins >= 4 and 1 <= bits <= 8):
        raise ValueError(f"consensus: a profile needs at least 4 bins of 1 to 8 bits, got {bins} of {bits}")
    coarse = signal.resample(gains, bins)
    height = float(np.ptp(coarse)) / (2**bits - 1)
    levels = np.round((coarse - coarse.min()) / (height or 1.0))
    return levels.astype(np.uint8), height


def restore(levels: UInt8[np.ndarray, " bins"], height: float, n_yaws: int) -> Float[np.ndarray, " yaws"]:
    """The profile of `quantise` on M yaws, less its minimum."""
    return signal.resample(levels * float(height), n_yaws)
