"""Files: written whole or not at all, read without trust; records as named arrays; JSON that knows no NaN."""

import contextlib
import dataclasses
import functools
import json
import math
import os
import re
import typing
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import EllipsisType
from typing import Any, BinaryIO, ClassVar, NoReturn, Protocol, TypeVar, cast, runtime_checkable

import numpy as np

_TRUSTED = 2**30  # [B] to which any archive may unpack; a larger one to `_RATIO` times its own size, no more
_RATIO = 100
_KINDS = "biufU"  # of arrays: truth, numbers and text
_HEADER = re.compile(
    rb"\{'descr': '([<>|=][%b]\d+)', 'fortran_order': (True|False), 'shape': \(([\d, ]*)\),? *\}\s*" % _KINDS.encode()
)


Record = TypeVar("Record")
Value = TypeVar("Value")


@runtime_checkable
class Dataclass(Protocol):
    """Any dataclass."""

    __dataclass_fields__: ClassVar[dict[str, dataclasses.Field]]


class ArchiveError(ValueError):
    """Why a file is no archive of the arrays asked for, in one line without its name."""


class Arrays(dict[str, np.ndarray]):
    """Named arrays from a file. Raises ArchiveError for one that is missing."""

    def __missing__(self, name: str) -> NoReturn:
        raise ArchiveError(f"it holds no {name}")


@contextlib.contextmanager
def whole(path: str | Path) -> Iterator[BinaryIO]:
    """A file to write into, which takes the place of `path` when all has gone well; folders are made.

    Whatever goes wrong, a full disk and Ctrl-C included, `path` stays as it was and nothing is left beside it.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with beside.open("wb") as file:
            yield file
        os.replace(beside, path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def tidy(folder: Path) -> None:
    """Remove what processes that were killed have left of `whole`."""
    for stale in folder.glob(".*.tmp"):
        stale.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write a text file (UTF-8, lines end as they do in `text`) whole or not at all."""
    with whole(path) as file:
        file.write(text.encode())


def write(path: str | Path, arrays: Mapping[str, np.ndarray], compressed: bool = False) -> None:
    """Write named arrays (.npz) whole or not at all. Raises TypeError for what only a pickle could hold."""
    for name, values in arrays.items():
        if values.dtype.kind not in _KINDS:
            raise TypeError(f"{path}: {name} is neither numbers nor text, so no array for an archive")
    with whole(path) as file:
        # pyright takes any of them for savez's own option allow_pickle
        (np.savez_compressed if compressed else np.savez)(file, **arrays)  # pyright: ignore[reportArgumentType]


def read(path: str | Path) -> Arrays:
    """The named arrays of an .npz file, each to the last bit; nothing in it is ever executed.

    Raises ArchiveError for a file that is missing, cut, damaged or something else, and for one that would unpack to
    absurdly more than it is. No header is believed before the bytes for it are there.
    """
    path = Path(path)
    if not path.is_file():
        raise ArchiveError("no such file")
    try:
        with zipfile.ZipFile(path) as file:
            size = sum(member.file_size for member in file.infolist())
            if size > max(_TRUSTED, _RATIO * path.stat().st_size):
                raise ValueError(f"{path.stat().st_size:,} B would unpack to {size:,} B")
            return Arrays((member.filename.removesuffix(".npy"), _array(file, member)) for member in file.infolist())
    except MemoryError:  # honest, but too large for this machine
        raise
    except Exception as error:  # of zipfile, its decompressors and numpy
        fault = " ".join(str(error).split()) or type(error).__name__
        raise ArchiveError(f"not a whole .npz archive ({fault})") from None


def _array(file: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    name = member.filename
    with file.open(member) as data:
        length = 2 if np.lib.format.read_magic(data) == (1, 0) else 4
        header = _HEADER.fullmatch(data.read(int.from_bytes(data.read(length), "little")))
        if header is None:
            raise ValueError(f"{name} holds neither numbers nor text")
        dtype, shape = np.dtype(header[1].decode()), [int(n) for n in re.findall(rb"\d+", header[3])]
        room = member.file_size - data.tell()
        if math.prod(shape) * dtype.itemsize != room:
            raise ValueError(f"{name} promises {shape} of {dtype}, there is room for {room:,} B")
        values = np.frombuffer(bytearray(data.read()), dtype).reshape(shape, order="F" if header[2] == b"True" else "C")
    return values.astype(dtype.newbyteorder("="), copy=False)


# ---- records as arrays ----------------------------------------------------------------------------------------------


def pack(record: Dataclass, prefix: str = "") -> dict[str, np.ndarray]:
    """The fields of a dataclass of tensors as named arrays, those of a dataclass inside it among them."""
    arrays = {}
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        arrays |= pack(value, prefix) if _is_record(value) else {prefix + field.name: value.detach().cpu().numpy()}
    return arrays


def unpack(
    kind: type[Record], arrays: Mapping[str, np.ndarray], prefix: str = "", row: int | EllipsisType = ...
) -> Record:
    """The inverse of `pack`: a record of that kind. Raises ArchiveError or KeyError where an array is missing."""
    import torch  # not above: a command that only writes a table need not wait for it

    values = []
    for name, part in typing.get_type_hints(kind).items():
        inside = _is_record(part)
        values.append(unpack(part, arrays, prefix, row) if inside else torch.from_numpy(arrays[prefix + name][row]))
    return kind(*values)


def stack(records: Iterable[Dataclass], prefix: str = "") -> dict[str, np.ndarray]:
    """Records of one kind and shape as an array for each field, with a row for each; nothing for no records."""
    rows = [pack(record, prefix) for record in records]
    return {name: np.stack([row[name] for row in rows]) for name in rows[0]} if rows else {}


def unstack(kind: type[Record], arrays: Mapping[str, np.ndarray], prefix: str = "") -> tuple[Record, ...]:
    """The inverse of `stack`. Raises ValueError for arrays of several lengths, else as `unpack`."""
    counts = {len(values) for name, values in arrays.items() if name.startswith(prefix) and values.ndim}
    if len(counts) > 1:
        raise ValueError(f"{prefix}… have {' and '.join(map(str, sorted(counts)))} rows")
    return tuple(unpack(kind, arrays, prefix, row) for row in range(max(counts, default=0)))


def _is_record(thing: object) -> bool:
    return dataclasses.is_dataclass(thing)


# ---- JSON -----------------------------------------------------------------------------------------------------------


def to_json(
    value: object, *, indent: int | None = None, separators: tuple[str, str] | None = None, sort_keys: bool = False
) -> str:
    """JSON, in which a number that does not exist (NaN, an infinity) is null; options as of `json.dumps`."""
    written = functools.partial(json.dumps, allow_nan=False, indent=indent, separators=separators, sort_keys=sort_keys)
    try:
        return written(value)
    except ValueError:
        return written(plain(value))


def plain(value: Value) -> Value:
    """The same dicts, lists and values with None for each number that does not exist; tuples become lists."""
    found: object = value
    if isinstance(value, dict):
        found = {key: plain(part) for key, part in value.items()}
    elif isinstance(value, list | tuple):
        found = [plain(part) for part in value]
    elif isinstance(value, float) and not math.isfinite(value):
        found = None
    return cast(Value, found)


def from_json(text: str | bytes) -> Any:
    """What JSON says. Raises ValueError for anything else, numbers that do not exist and bottomless nests included."""
    try:
        return json.loads(text, parse_constant=_finite, parse_float=_finite)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def _finite(text: str) -> float:
    if not math.isfinite(float(text)):
        raise ValueError(f"{text} is no finite number")
    return float(text)
