"""The map: a frozen record of Gaussian splats g = (μ, Σ, o, c) (Section III-A), its union (16), and its files."""

import dataclasses
import math
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import ArrayLike
from torch import Tensor

from mannbv import archive, geometry

_SH_C0 = 0.28209479177387814  # the constant spherical harmonic: color = 0.5 + _SH_C0 · f_dc in the 3DGS layout
_MAX_SPLATS = 50_000_000


class FormatError(ValueError):
    """A file that holds no splat map; the message names the file, the fault and the remedy."""


@dataclass(frozen=True)
class SplatMap:
    """Gaussian splats in the world frame.

    means (n, d) [m]; log_scales (n, d), logarithms of standard deviations in metres; rotations (n, 2) as unit complex
    numbers (cos, sin) in flatland, (n, 4) as quaternions (w, x, y, z) in space; opacity_logits (n,); colors (n, 3).
    """

    means: Float[Tensor, "n d"]
    log_scales: Float[Tensor, "n d"]
    rotations: Float[Tensor, "n k"]
    opacity_logits: Float[Tensor, " n"]
    colors: Float[Tensor, "n 3"]

    def __post_init__(self):
        for field in dataclasses.fields(self):
            if not isinstance(getattr(self, field.name), Tensor):  # arrays and lists become tensors
                object.__setattr__(self, field.name, torch.as_tensor(np.asarray(getattr(self, field.name), np.float32)))
        if self.means.ndim != 2 or self.means.shape[1] not in (2, 3):
            raise ValueError(f"splat map: means must be (n, 2) or (n, 3), got {tuple(self.means.shape)}")
        n, d = self.means.shape
        shapes = {"log_scales": (n, d), "rotations": (n, 2 if d == 2 else 4), "opacity_logits": (n,), "colors": (n, 3)}
        for name, shape in shapes.items():
            if tuple(getattr(self, name).shape) != shape:
                got = tuple(getattr(self, name).shape)
                raise ValueError(f"splat map: {name} must be {shape} beside means {(n, d)}, got {got}")

    @property
    def dim(self) -> int:
        return self.means.shape[1]

    @property
    def n_splats(self) -> int:
        return self.means.shape[0]

    @property
    def opacities(self) -> Float[Tensor, " n"]:
        return torch.sigmoid(self.opacity_logits)

    @property
    def scales(self) -> Float[Tensor, "n d"]:
        """Standard deviations along the splat's own axes [m]."""
        return torch.exp(self.log_scales)

    def covariances(self) -> Float[Tensor, "n d d"]:
        """Σ = R S² Rᵀ [m²]."""
        return geometry.covariances(self.log_scales, self.rotations)

    def tensors(self) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        """The five fields in order."""
        return self.means, self.log_scales, self.rotations, self.opacity_logits, self.colors

    def select(self, index: ArrayLike) -> "SplatMap":
        """The splats at integer or boolean `index`, in that order."""
        rows = torch.as_tensor(index, device=self.means.device)
        rows = rows if rows.numel() else rows.long()  # an empty list has no type of its own
        return SplatMap(*(t[rows] for t in self.tensors()))

    def to(self, like: Tensor | torch.dtype | torch.device | str) -> "SplatMap":
        """As `torch.Tensor.to`: another device or precision."""
        return SplatMap(*(t.to(like) for t in self.tensors()))

    @staticmethod
    def empty(dim: int) -> "SplatMap":
        """A map without splats."""
        shapes = (0, dim), (0, dim), (0, 2 if dim == 2 else 4), (0,), (0, 3)
        return SplatMap(*(torch.zeros(shape) for shape in shapes))


def union(*maps: SplatMap) -> SplatMap:
    """The disjoint union of maps, Eq. (16), in the order of the arguments. Raises ValueError if dimensions differ."""
    if len({m.dim for m in maps}) != 1:
        raise ValueError(f"union: maps must share one dimension, got {[m.dim for m in maps]}")
    return SplatMap(*(torch.cat(parts) for parts in zip(*(m.tensors() for m in maps), strict=True)))


def lifted(flat: SplatMap, heights: ArrayLike, std: float) -> SplatMap:
    """A flatland map repeated at `heights` (k,) [m]: 3-D splats, all of `flat` at the first height, then the next.

    Each keeps its colour and opacity, turns about the vertical as it did in the plane, and gets the standard deviation
    `std` [m] upwards. Raises ValueError for a map of space, or heights and `std` that are none.
    """
    at = torch.as_tensor(heights).to(flat.means)
    if flat.dim != 2:
        raise ValueError(f"lifted: the map is {flat.dim}-D already; give a flatland map")
    if at.ndim != 1 or not bool(torch.isfinite(at).all()):
        raise ValueError(f"lifted: heights must be a list of finite numbers [m], got {at.tolist()}")
    if not 0 < std < math.inf:
        raise ValueError(f"lifted: std must be a positive number of metres, got {std}")
    n, k = flat.n_splats, len(at)
    half = torch.atan2(flat.rotations[:, 1], flat.rotations[:, 0]) / 2
    quaternions = torch.stack([half.cos(), 0 * half, 0 * half, half.sin()], 1)
    means, log_scales, quaternions, logits, colors = (
        part.repeat(k, *[1] * (part.ndim - 1))
        for part in (flat.means, flat.log_scales, quaternions, flat.opacity_logits, flat.colors)
    )
    upwards = torch.full((n * k, 1), math.log(std)).to(log_scales)
    means = torch.cat([means, at.repeat_interleave(n)[:, None]], 1)
    return SplatMap(means, torch.cat([log_scales, upwards], 1), quaternions, logits, colors)


def save(splat_map: SplatMap, path: str | Path) -> None:
    """Write a map to `.npz` (both dimensions) or `.ply` (3-D, the standard 3DGS layout)."""
    path = Path(path)
    if path.suffix == ".npz":
        archive.write(path, archive.pack(splat_map))
    elif path.suffix == ".ply":
        _save_ply(archive.pack(splat_map), path)
    else:
        raise FormatError(f"{path}: unknown ending '{path.suffix}'; use .npz or .ply")


def load(path: str | Path) -> SplatMap:
    """Read a map from `.npz` or `.ply`; nothing in the file is ever executed.

    Raises FormatError for a file that is missing, truncated, of the wrong shape or not finite.
    """
    path = Path(path)
    if not path.is_file():
        raise FormatError(f"{path}: no such file")
    if path.suffix not in (".npz", ".ply"):
        raise FormatError(f"{path}: unknown ending '{path.suffix}'; use .npz or .ply")
    fields = (_load_npz if path.suffix == ".npz" else _load_ply)(path)
    try:
        splat_map = SplatMap(**{name: torch.from_numpy(values) for name, values in fields.items()})
    except ValueError as error:
        raise FormatError(f"{path}: {error}; save the map again") from None
    for name, values in fields.items():
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            raise FormatError(f"{path}: {name} of splat {bad[0, 0]} is not finite; remove it or save the map again")
    bad = np.flatnonzero(~fields["rotations"].any(1))
    if len(bad):
        raise FormatError(f"{path}: rotations of splat {bad[0]} is zero, no rotation; remove it or save the map again")
    return splat_map


def _load_npz(path: Path) -> dict[str, np.ndarray]:
    try:
        arrays = archive.read(path)
        fields = {f.name: arrays[f.name] for f in dataclasses.fields(SplatMap)}
    except archive.ArchiveError as error:
        raise FormatError(f"{path}: {error}; copy or save it again") from None
    for name, values in fields.items():
        if values.dtype.kind != "f":
            raise FormatError(f"{path}: {name} must hold floating-point numbers, got {values.dtype}; save it again")
    return {k: v.astype(np.float64 if v.dtype.itemsize == 8 else np.float32, order="C") for k, v in fields.items()}


_PLY_NAMES = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", *(f"scale_{k}" for k in range(3))]
_PLY_NAMES += [f"rot_{k}" for k in range(4)]
_PLY_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"}
_PLY_TYPES |= {f"{kind}{8 * size}": f"{kind[0]}{size}" for kind in ("int", "uint") for size in (1, 2, 4)}
_PLY_TYPES |= {"double": "f8", "float32": "f4", "float64": "f8"}


def _save_ply(fields: dict[str, np.ndarray], path: Path) -> None:
    if fields["means"].shape[1] != 3:
        raise FormatError(f"{path}: the .ply layout is for 3-D splats; save a flatland map as .npz")
    n = len(fields["means"])
    names = ["x", "y", "z", "nx", "ny", "nz", *_PLY_NAMES[3:]]  # viewers expect normals, all zero
    table = np.concatenate(
        [
            fields["means"],
            np.zeros((n, 3)),
            (fields["colors"] - 0.5) / _SH_C0,
            fields["opacity_logits"][:, None],
            fields["log_scales"],
            fields["rotations"],
        ],
        1,
    ).astype("<f4")
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {n}"]
    header += [f"property float {name}" for name in names] + ["end_header"]
    with archive.whole(path) as file:
        file.write(("\n".join(header) + "\n").encode() + table.tobytes())


def _ply_header(path: Path, lines: list[bytes]) -> tuple[int, np.dtype]:
    """Number of vertices and the record of one, from the header's lines."""
    if not lines or lines[0].strip() != b"ply":
        raise FormatError(f"{path}: does not begin with 'ply'; is it a 3DGS point cloud?")
    count, columns, element = None, [], None
    if [line.split()[1:2] for line in lines if line.startswith(b"format")] != [[b"binary_little_endian"]]:
        raise FormatError(f"{path}: only binary_little_endian .ply files are read; convert it first")
    for line in lines[1:]:
        words = line.decode("ascii", "replace").split()
        if words[:1] == ["element"]:
            element = words[1] if len(words) == 3 and words[2].isdigit() and len(words[2]) < 19 else None
            if element is None or (count is None) != (element == "vertex"):
                raise FormatError(
                    f"{path}: the header's line '{' '.join(words)}' should be one 'element vertex N' first"
                )
            count = int(words[2]) if element == "vertex" else count
        if words[:1] == ["property"] and element == "vertex":
            if len(words) != 3 or words[1] not in _PLY_TYPES:
                raise FormatError(f"{path}: cannot read the header's line '{' '.join(words)}'")
            columns.append((words[2], "<" + _PLY_TYPES[words[1]]))
    names = [name for name, _ in columns]
    missing = [name for name in _PLY_NAMES if name not in names]
    if count is None or missing or len(set(names)) < len(names):
        fault = f"lacks {', '.join(missing[:4])}" if missing else "has no vertices or names a property twice"
        raise FormatError(f"{path}: {fault}; expected the standard 3DGS properties")
    return count, np.dtype(columns)


def _load_ply(path: Path) -> dict[str, np.ndarray]:
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(65536)
        end = head.find(b"\nend_header\n")
        if end < 0:
            raise FormatError(f"{path}: no 'end_header' in its first 64 kB; not a whole .ply file")
        count, record = _ply_header(path, head[:end].splitlines())
        start = end + len(b"\nend_header\n")
        room = (size - start) // record.itemsize
        if count > _MAX_SPLATS or count > room:
            raise FormatError(
                f"{path}: the header promises {count} splats, the file has room for {room}; copy it again"
            )
        file.seek(start)
        rows = np.fromfile(file, record, count)
    if room > count and head[:end].count(b"\nelement ") == 1:
        warnings.warn(f"{path}: only the {count} splats its header promises are read, of {room}", stacklevel=3)
    if any(np.any(rows[name] != 0) for name in record.names or () if name.startswith("f_rest_")):
        warnings.warn(f"{path}: spherical harmonics beyond degree 0 are dropped", stacklevel=3)

    def columns(*names: str) -> np.ndarray:
        with np.errstate(over="ignore"):  # a double too large for a float becomes infinite, which `load` refuses
            return np.stack([rows[name] for name in names], 1).astype(np.float32)

    return {
        "means": columns("x", "y", "z"),
        "log_scales": columns(*(f"scale_{k}" for k in range(3))),
        "rotations": columns(*(f"rot_{k}" for k in range(4))),
        "opacity_logits": columns("opacity")[:, 0],
        "colors": 0.5 + np.float32(_SH_C0) * columns(*(f"f_dc_{k}" for k in range(3))),
    }
