"""What a robot maximises: F_i of the team's N yaws, tabulated yaw by yaw or given as a function (Section V-C).

Tables hold gains on M uniform yaws, −π + 2π m / M, of a periodic function; between them it is the trigonometric
interpolant. The team objective is separable, F_i(T) = Σ_k f_ik(T_k), so a table per (i, k) says everything.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from scipy import optimize, signal

from mannbv import geometry

TIE = 1e-12  # stiffness where nothing pulls: of equally good yaws the one nearest to the present wins


def grid(n_yaws: int) -> Float[np.ndarray, " yaws"]:
    """The M uniform yaws of a table [rad], from −π."""
    return 2 * np.pi * np.arange(n_yaws) / n_yaws - np.pi


def interpolate(gains: Float[np.ndarray, "*rows yaws"], yaws, slope: bool = False) -> np.ndarray:
    """Periodic functions at one yaw [rad] each, by trigonometric interpolation of their tables; or their slopes."""
    n = gains.shape[-1]
    order = np.arange(n // 2 + 1)
    share = np.where((order == 0) | (2 * order == n), 1.0, 2.0) / n
    waves = share * np.fft.rfft(gains) * np.exp(1j * order * (np.asarray(yaws)[..., None] + np.pi))
    return ((1j * order * waves) if slope else waves).real.sum(-1)


@dataclass(frozen=True, eq=False)
class Tabulated:
    """F(yaws) = Σ_k f_k(yaws[k]), from a table gains (N, M)."""

    gains: Float[np.ndarray, "robots yaws"]

    def value(self, yaws: np.ndarray) -> float:
        return float(interpolate(self.gains, yaws).sum())

    def gradient(self, yaws: np.ndarray) -> np.ndarray:
        return interpolate(self.gains, yaws, slope=True)

    def minimise(self, origin, first, center, stiffness, circle: bool) -> np.ndarray:
        """argmin over real offsets x (N,) of −F(origin + x) + stiffness/2 ‖x − center‖², globally; `first` is unused.

        N searches in one dimension. On the circle f_k is periodic, so a minimiser lies within ±π of the quadratic's:
        any other one can come 2π nearer for free. The M nodes of that window decide, a parabola refines. Off the
        circle, x is confined to [−π, π].
        """
        rows, n = np.arange(len(self.gains)), self.gains.shape[1]
        pitch = 2 * np.pi / n
        lowest = np.floor((origin + center) / pitch).astype(int) - 1 if circle else np.zeros(len(rows), int)
        nodes = lowest[:, None] + np.arange(n + (3 if circle else 1))
        offsets = pitch * nodes - np.pi - origin[:, None]
        energy = stiffness / 2 * (offsets - center[:, None]) ** 2 - np.take_along_axis(self.gains, nodes % n, 1)
        best = energy.argmin(1)
        middle = np.clip(best, 1, nodes.shape[1] - 2)
        before, here, after = (energy[rows, middle + k] for k in (-1, 0, 1))
        bend = before - 2 * here + after
        shift = np.where(bend > 0, (before - after) / np.where(bend > 0, 2 * bend, 1.0), best - middle)
        refined = offsets[rows, middle] + pitch * np.clip(shift, -1, 1)
        return refined if circle else np.clip(refined, -np.pi, np.pi)


@dataclass(frozen=True, eq=False)
class Called:
    """F as a function of the N yaws, divided by `scale`; its own `.gradient(yaws)` is used where it has one."""

    function: Any
    scale: float = 1.0

    def __call__(self, yaws: np.ndarray) -> float:
        return self.value(yaws)

    def value(self, yaws: np.ndarray) -> float:
        value = float(self.function(np.array(yaws))) / self.scale
        if not np.isfinite(value):
            raise ValueError(f"consensus: an objective returned {value} at yaws {np.round(yaws, 4).tolist()}")
        return value

    def gradient(self, yaws: np.ndarray) -> np.ndarray:
        if hasattr(self.function, "gradient"):
            return np.asarray(self.function.gradient(np.array(yaws)), float) / self.scale
        nudges = 1e-5 * np.eye(len(yaws))
        return np.array([(self.value(yaws + nudge) - self.value(yaws - nudge)) / 2e-5 for nudge in nudges])

    def minimise(self, origin, first, center, stiffness, circle: bool) -> np.ndarray:
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


def checked(objectives) -> np.ndarray | list:
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


def scale_of(objectives) -> float:
    """The largest absolute gain in a table of any shape; 1 for an all-zero table and for functions.

    Divide every robot's objective by the *same* number, else robots with small gains count too much. A team gets it
    exactly by telling each other one scalar: the largest of every robot's own `scale_of`.
    """
    if callable(objectives) or (isinstance(objectives, list) and all(callable(f) for f in objectives)):
        return 1.0
    return float(np.abs(np.asarray(objectives, float)).max()) or 1.0


def value(objectives, yaws) -> float:
    """The team's objective Σ_i F_i(yaws), Eq. (25), in the objectives' own unit."""
    parts = [Called(f) if callable(f) else Tabulated(np.asarray(f, float)) for f in objectives]
    return sum(part.value(np.asarray(yaws, float)) for part in parts)


def tabulate(functions, announced, n_yaws: int = 72) -> Float[np.ndarray, "robots robots yaws"]:
    """Functions as an (N, N, M) table: each yaw in turn swept, the others as announced. Exact if F is separable."""
    n = len(announced)
    table = np.empty((n, n, n_yaws))
    for i, k in np.ndindex(n, n):
        yaws = np.tile(np.asarray(announced, float), (n_yaws, 1))
        yaws[:, k] = grid(n_yaws)
        table[i, k] = [Called(functions[i]).value(row) for row in yaws]
    return table


def best_yaws(gains: Float[np.ndarray, "robots yaws"], near) -> Float[np.ndarray, " robots"]:
    """argmax of each row [rad], refined between the nodes; of equally good yaws the one nearest to `near` (N,)."""
    near = np.asarray(near, float)
    here = np.zeros(len(gains))
    return geometry.wrap(near + Tabulated(gains).minimise(near, here, here, TIE, circle=True))


def quantise(gains: Float[np.ndarray, " yaws"], bins=36, bits=8) -> tuple[UInt8[np.ndarray, " bins"], float]:
    """A profile in few bytes: `bins` levels of at most 8 bits above its minimum, and the height of one level.

    The minimum itself is not kept, since an argmax does not need it.
    """
    if not (bins >= 4 and 1 <= bits <= 8):
        raise ValueError(f"consensus: a profile needs at least 4 bins of 1 to 8 bits, got {bins} of {bits}")
    coarse = signal.resample(gains, bins)
    height = float(np.ptp(coarse)) / (2**bits - 1)
    levels = np.round((coarse - coarse.min()) / (height or 1.0))
    return levels.astype(np.uint8), height


def restore(levels: UInt8[np.ndarray, " bins"], height, n_yaws: int) -> Float[np.ndarray, " yaws"]:
    """The profile of `quantise` on M yaws, less its minimum."""
    return signal.resample(levels * float(height), n_yaws)
