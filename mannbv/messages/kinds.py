"""The kinds of messages, with the layout of each field on the wire (Sections V-B and VI-D).

A field's layout is its little-endian numpy type and its number of axes; both codecs are made from these tables.
Every kind names its `robot`, from which it came first, and the planning `cycle`; relays pass it on unchanged.
Constructing a message checks it and brings its fields, lists or arrays alike, into their types on the wire; hence a
decoded message has been checked as well, and holds nothing of the sender's memory.
"""

from dataclasses import dataclass, field, fields
from typing import no_type_check

import numpy as np
import torch
from jaxtyping import Float32, Float64, Int8, Int32, UInt8
from torch import Tensor

from mannbv.config import Config
from mannbv.grid import FREE, OCCUPIED, Lattice, Occupancy
from mannbv.splats import SplatMap

_DEFAULT = Config()
_LEFT_OUT = torch.zeros(0)


@dataclass(frozen=True)
class Layout:
    """How a field travels."""

    dtype: str  # numpy's name
    axes: int = 0  # 0: a scalar
    raw: bool = False  # JSON writes base64 instead of decimals
    tensor: bool = False  # in memory a torch tensor
    optional: bool = False  # a last field, left out where it is empty


def _wire(
    dtype: str, axes: int = 0, raw: bool = False, tensor: bool = False, optional: bool = False
) -> dict[str, Layout]:
    return {"wire": Layout(dtype, axes, raw, tensor, optional)}


def layout(kind: "Message | type[Message]") -> dict[str, Layout]:
    """Field name → layout of a kind or message, in the order on the wire."""
    return {f.name: f.metadata["wire"] for f in fields(kind)}


def sent(message: "Message") -> dict[str, Layout]:
    """`layout` of the fields that are written."""
    return {name: w for name, w in layout(message).items() if not w.optional or len(getattr(message, name))}


def _fault(message: "Message", what: str) -> ValueError:
    return ValueError(f"{type(message).__name__.lower()} message: {what}")


def _scalar(message, name: str, value, wire: Layout):
    """One whole or real number of the wire's type."""
    dtype = np.dtype(wire.dtype)
    number, kinds = np.asarray(value), "iu" if dtype.kind == "u" else "iuf"
    if number.ndim or number.dtype.kind not in kinds:
        raise _fault(message, f"{name} must be one {'whole number' if kinds == 'iu' else 'number'}")
    if kinds == "iu":
        if not 0 <= int(number) <= np.iinfo(dtype).max:
            raise _fault(message, f"{name} must lie between 0 and {np.iinfo(dtype).max}, got {int(number)}")
        return int(number)
    with np.errstate(over="ignore"):  # what does not fit becomes infinite
        settled = float(number.astype(dtype))
    if not np.isfinite(settled):
        raise _fault(message, f"{name} must be finite")
    return settled


def _array(message, name: str, value, wire: Layout):
    """A copy of numbers along the wire's axes in its type."""
    value = np.asarray(value.detach().cpu() if isinstance(value, Tensor) else value)
    dtype = np.dtype(wire.dtype).newbyteorder("=")
    if value.ndim != wire.axes or value.dtype.kind not in "iuf":
        raise _fault(message, f"{name} must be numbers along {wire.axes} axes, got shape {value.shape}")
    with np.errstate(over="ignore", invalid="ignore"):  # what does not fit changes and is refused
        settled = value.astype(dtype)
    if not np.isfinite(settled).all() or (dtype.kind in "iu" and not np.array_equal(settled, value)):
        raise _fault(message, f"{name} must be finite numbers that fit {dtype}")
    return torch.from_numpy(settled) if wire.tensor else settled


def _plain(message, name: str, splats: SplatMap, wire: Layout) -> SplatMap:
    """A map on the CPU, in single precision, without gradients."""
    tensors = [t.detach().cpu().float() for t in splats.tensors()]
    if not all(bool(torch.isfinite(t).all()) for t in tensors):
        raise _fault(message, f"{name} must be finite")
    return SplatMap(*tensors)


@no_type_check  # for the checks of tests: lists may come in, and leave as arrays
@dataclass(frozen=True, eq=False)
class Message:
    """What every message says: where it came from first, and in which planning cycle."""

    robot: int = field(metadata=_wire("<u2"))
    cycle: int = field(metadata=_wire("<u4"))

    def __post_init__(self):
        for name, wire in layout(self).items():
            value = getattr(self, name)
            settle = _plain if isinstance(value, SplatMap) else _array if wire.axes else _scalar
            object.__setattr__(self, name, settle(self, name, value, wire))
        self._check()

    def _check(self):
        pass


@no_type_check
@dataclass(frozen=True, eq=False)
class Plan(Message):
    """(T_i, P_i) of Algorithm 1, line 5: a robot's candidate view and its planned path."""

    position: Float64[np.ndarray, " d"] = field(metadata=_wire("<f8", 1))  # (d,) of the view [m]
    yaw: float = field(metadata=_wire("<f8"))  # of the view [rad]
    path: Float32[np.ndarray, "k d"] = field(metadata=_wire("<f4", 2))  # (K, d) [m]

    def _check(self):
        d, path = len(self.position), self.path.shape
        if d not in (2, 3) or path[0] < 1 or path[1] != d:
            raise _fault(self, f"position must be (d,) and path (K ≥ 1, d) with d = 2 or 3; got {(d,)} and {path}")


@no_type_check
@dataclass(frozen=True, eq=False)
class Suggestion(Message):
    """What robot `robot`'s map says of robot `target`'s view, Eq. (23): its best yaw and two gains, and a gradient.

    Section V-B returns "the scalar EIG and its gradient with respect to T_i"; the gradient is sent where a config asks.
    """

    target: int = field(metadata=_wire("<u2"))
    yaw: float = field(metadata=_wire("<f8"))  # argmax f_ik [rad]
    gain: float = field(metadata=_wire("<f8"))  # at that yaw
    announced_gain: float = field(metadata=_wire("<f8"))  # at the announced yaw
    # the sender's largest gain over all the views it evaluates: the largest of all robots' scales the objectives
    largest: float = field(metadata=_wire("<f8"), default=0.0)
    # of the gain at the announced view by its pose, (d + d(d−1)/2,) in the twist of `Pose.moved` [1/m, 1/rad]
    gradient: np.ndarray | tuple[()] = field(metadata=_wire("<f8", 1, optional=True), default=())


@no_type_check
@dataclass(frozen=True, eq=False)
class Copies(Message):
    """T^(i) of one C-ADMM round, Algorithm 1, line 11: offsets from the announced yaws."""

    round: int = field(metadata=_wire("<u4"))
    offsets: Float64[np.ndarray, " n"] = field(metadata=_wire("<f8", 1))  # (N,) [rad]


@no_type_check
@dataclass(frozen=True, eq=False)
class Profile(Message):
    """f_ik over all yaws of robot `target`'s view, as `consensus.quantise` writes it."""

    target: int = field(metadata=_wire("<u2"))
    height: float = field(metadata=_wire("<f4"))  # of one level, in units of gain
    levels: UInt8[np.ndarray, " bins"] = field(metadata=_wire("|u1", 1))  # (bins,)


@no_type_check
@dataclass(frozen=True, eq=False)
class Splats(Message):
    """A whole map or some of its splats, with their ids and their prior information; float32 on the wire.

    A splat is 14 numbers = 56 B in space, 10 = 40 B in flatland; ids add 4 B and a prior of p columns 4p B each.
    """

    splats: SplatMap = field(metadata=_wire("<f4", 2, raw=True))
    # left out: ids 0 … n−1, and a prior of no columns
    ids: Int32[Tensor, " n"] = field(metadata=_wire("<i4", 1, raw=True, tensor=True), default=_LEFT_OUT)
    prior: Float32[Tensor, "n p"] = field(metadata=_wire("<f4", 2, raw=True, tensor=True), default=_LEFT_OUT)
    whole: int = field(metadata=_wire("|u1"), default=0)  # 1: all that the sender has, earlier ones are gone

    def __post_init__(self):
        if not isinstance(self.splats, SplatMap):
            raise _fault(self, f"splats must be a SplatMap, got {type(self.splats).__name__}")
        n = self.splats.n_splats
        object.__setattr__(self, "ids", torch.arange(n, dtype=torch.int32) if self.ids is _LEFT_OUT else self.ids)
        object.__setattr__(self, "prior", torch.zeros(n, 0) if self.prior is _LEFT_OUT else self.prior)
        super().__post_init__()

    def _check(self):
        n = self.splats.n_splats
        if len(self.ids) != n or len(self.prior) != n:
            raise _fault(self, f"{n} splats need as many ids and prior rows, got {len(self.ids)}, {len(self.prior)}")


@no_type_check
@dataclass(frozen=True, eq=False)
class Grid(Message):
    """What a robot knows of the ground: states (nx, ny) of unknown −1, free 0, occupied 1, and where the cells lie.

    On the wire four cells a byte, compressed by zlib.
    """

    origin: Float64[np.ndarray, " 2"] = field(metadata=_wire("<f8", 1))  # (2,) of the lower corner [m]
    cell: float = field(metadata=_wire("<f8"))  # [m]
    state: Int8[np.ndarray, "nx ny"] = field(metadata=_wire("|i1", 2, raw=True))  # (nx, ny)

    def _check(self):
        if self.origin.shape != (2,) or not self.cell > 0:
            raise _fault(self, f"needs an origin (2,) and a positive cell, got {self.origin.shape} and {self.cell}")
        if self.state.size and not (self.state.min() >= -1 and self.state.max() <= 1):
            raise _fault(self, "states must be -1 (unknown), 0 (free) or 1 (occupied)")

    @staticmethod
    def of(robot: int, cycle: int, occupancy: Occupancy) -> "Grid":
        """The message of a `grid.Occupancy`."""
        lattice = occupancy.lattice
        return Grid(robot, cycle, np.array(lattice.origin), lattice.cell, occupancy.state)

    @property
    def occupancy(self) -> Occupancy:
        """As evidence: each state is worth one look, by the default constants, whatever those of the sender are."""
        worth = [_DEFAULT.evidence_hit, -_DEFAULT.evidence_pass]
        log_odds = np.select([self.state == OCCUPIED, self.state == FREE], worth, 0.0)
        return Occupancy(self.lattice, log_odds.astype(np.float32))

    @property
    def lattice(self) -> Lattice:
        nx, ny = self.state.shape
        return Lattice((float(self.origin[0]), float(self.origin[1])), self.cell, (nx, ny))


KINDS = (Plan, Suggestion, Copies, Profile, Splats, Grid)
_WIDTHS = {2: (2, 2, 2, 1, 3), 3: (3, 3, 4, 1, 3)}  # columns of a splat's fields in a row of 10 or 14


def splat_rows(splats: SplatMap) -> Float32[np.ndarray, "n columns"]:
    """A map as rows of 10 (flatland) or 14 numbers: mean, log-scale, rotation, opacity logit, colour."""
    columns = [t if t.ndim == 2 else t[:, None] for t in splats.tensors()]
    return torch.cat(columns, 1).detach().cpu().float().numpy()


def splat_map(rows: Float32[np.ndarray, "n columns"]) -> SplatMap:
    """The map of `splat_rows`. Raises ValueError for rows of another width."""
    dim = {10: 2, 14: 3}.get(rows.shape[1])
    if dim is None:
        raise ValueError(f"splats message: a splat is 10 or 14 numbers, got {rows.shape[1]}")
    parts = [part.contiguous() for part in torch.from_numpy(rows.copy()).split(_WIDTHS[dim], 1)]
    means, scales, rotations, opacity, colors = parts
    return SplatMap(means, scales, rotations, opacity[:, 0], colors)
