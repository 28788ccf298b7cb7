"""Messages to bytes and back: JSON, as in the paper, and a compact binary form. Nothing received is ever executed.

Binary, little-endian: b"mb", version (1 B), kind (1 B, its place in KINDS, and 128 more where an optional field is
there), then the fields in order. A scalar is its number; an array its lengths (4 B an axis), then its numbers; a
Grid's states are two lengths, the number of compressed bytes (4 B), and those. JSON: an object with "kind" and the
fields; decimals that read back to the same bits, or {"shape", "base64"} for splats, ids, priors and grids. Sizes are
checked before anything is allocated.
"""

import base64
import math
import struct
import zlib

import numpy as np

from mannbv import archive
from mannbv.messages.kinds import KINDS, Grid, Layout, Message, layout, sent, splat_map, splat_rows

CODECS = ("json", "binary")
_MAGIC = b"mb\x01"
_MAX_CELLS = 1 << 26
_MORE = 128
_PLACES = np.array([0, 2, 4, 6], np.uint8)  # of four cells in a byte


def encode(message: Message, codec: str = "json") -> bytes:
    """A message as bytes. Raises ValueError for an unknown codec."""
    if codec not in CODECS:
        raise ValueError(f"messages: no codec is called '{codec}'; choose one of {', '.join(CODECS)}")
    values = {name: getattr(message, name) for name in sent(message)}
    if "splats" in values:
        values["splats"] = splat_rows(values["splats"])
    return _to_json(message, values) if codec == "json" else _to_binary(message, values)


def decode(data: bytes | bytearray | memoryview) -> Message:
    """The message in `data` (bytes), whichever codec wrote it. Raises ValueError, in one line, for anything else."""
    if not isinstance(data, (bytes, bytearray, memoryview)):
        raise ValueError(f"messages: expected bytes, got {type(data).__name__}")
    data = bytes(data)
    try:
        kind, values = _from_binary(data) if data[:3] == _MAGIC else _from_json(data)
        if "splats" in values:
            values["splats"] = splat_map(values["splats"])
        return kind(**values)
    except (ValueError, TypeError, KeyError, OverflowError, struct.error, zlib.error) as error:
        why = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"messages: {len(data)} B that are no message ({why})") from None


def _pack(state: np.ndarray) -> bytes:
    """Cells −1, 0, 1 as two bits each, compressed."""
    cells = (state.reshape(-1) + 1).astype(np.uint8)
    cells = np.pad(cells, (0, -len(cells) % 4)).reshape(-1, 4)
    return zlib.compress(np.bitwise_or.reduce(cells << _PLACES, axis=1).tobytes(), 6)


def _unpack(packed: bytes, shape) -> np.ndarray:
    size = math.prod(shape)
    n_bytes = -(-size // 4)
    if size > _MAX_CELLS:
        raise ValueError(f"a grid of {shape} cells is larger than {_MAX_CELLS}")
    stream = zlib.decompressobj()
    raw = stream.decompress(packed, n_bytes + 1)  # a little may unpack to a lot: stop there
    if len(raw) != n_bytes or not stream.eof or stream.unused_data:
        raise ValueError(f"the compressed grid does not hold {shape} cells")
    cells = (np.frombuffer(raw, np.uint8)[:, None] >> _PLACES) & 3
    return cells.reshape(-1)[:size].reshape(shape).astype(np.int8) - 1


def _to_binary(message: Message, values: dict) -> bytes:
    wires = sent(message)
    parts = [_MAGIC, bytes([KINDS.index(type(message)) + _MORE * any(wire.optional for wire in wires.values())])]
    for name, wire in wires.items():
        value = np.asarray(values[name], wire.dtype)
        if wire.axes:
            parts.append(struct.pack(f"<{wire.axes}I", *value.shape))
        body = value.tobytes()
        if isinstance(message, Grid) and name == "state":
            body = _pack(value)
            parts.append(struct.pack("<I", len(body)))
        parts.append(body)
    return b"".join(parts)


def _from_binary(data: bytes) -> tuple[type, dict]:
    if len(data) < 4 or data[3] % _MORE >= len(KINDS):
        raise ValueError("unknown kind")
    kind, at, values = KINDS[data[3] % _MORE], 4, {}
    for name, wire in layout(kind).items():
        if wire.optional and data[3] < _MORE:
            continue
        dtype = np.dtype(wire.dtype)
        shape = struct.unpack_from(f"<{wire.axes}I", data, at)
        at += 4 * wire.axes
        if kind is Grid and name == "state":
            (size,) = struct.unpack_from("<I", data, at)
            at += 4
        else:
            size = math.prod(shape) * dtype.itemsize
        if size > len(data) - at:
            raise ValueError(f"{name} needs {size} B, {len(data) - at} are left")
        body, at = data[at : at + size], at + size
        if kind is Grid and name == "state":
            values[name] = _unpack(body, shape)
        else:
            array = np.frombuffer(body, dtype).reshape(shape)
            values[name] = array if wire.axes else array[()]
    if at != len(data):
        raise ValueError(f"{len(data) - at} B too many")
    return kind, values


def _to_json(message: Message, values: dict) -> bytes:
    record: dict[str, object] = {"kind": type(message).__name__}
    for name, wire in sent(message).items():
        value = np.asarray(values[name], wire.dtype)
        if wire.raw:
            body = _pack(value) if isinstance(message, Grid) else value.tobytes()
            record[name] = {"shape": value.shape, "base64": base64.b64encode(body).decode()}
        else:
            record[name] = _shortest(value)
    return archive.to_json(record, separators=(",", ":")).encode()


def _shortest(value: np.ndarray):
    """Nested lists with the fewest decimals that read back to the same bits in the array's own precision."""
    return value.astype(str).astype(float).tolist() if value.dtype == np.float32 else value.tolist()


def _from_json(data: bytes) -> tuple[type, dict]:
    record = archive.from_json(data)
    kinds = {kind.__name__: kind for kind in KINDS}
    if not isinstance(record, dict) or not isinstance(record.get("kind"), str) or record["kind"] not in kinds:
        raise ValueError(f"expected an object whose kind is one of {', '.join(kinds)}")
    kind = kinds[record.pop("kind")]
    wires = layout(kind)
    if not {name for name, wire in wires.items() if not wire.optional} <= record.keys() <= wires.keys():
        raise ValueError(f"a {kind.__name__} has the fields {', '.join(wires)}; got {', '.join(record)}")
    return kind, {name: _json_field(kind, name, wire, record[name]) for name, wire in wires.items() if name in record}


def _json_field(kind: type, name: str, wire: Layout, value):
    if not wire.axes:
        return value
    if not wire.raw:
        array = np.asarray(value)
        if array.dtype.kind not in "iuf" or array.ndim != wire.axes:  # an empty list has lost its other lengths
            raise ValueError(f"{name} must be numbers along {wire.axes} axes")
        return array
    shape, body = value["shape"], base64.b64decode(value["base64"], validate=True)
    whole = isinstance(shape, list) and all(type(n) is int and n >= 0 for n in shape)
    if not whole or len(shape) != wire.axes or len(value) != 2:
        raise ValueError(f"{name} must have a shape of {wire.axes} lengths")
    if kind is Grid:
        return _unpack(body, tuple(shape))
    if math.prod(shape) * np.dtype(wire.dtype).itemsize != len(body):
        raise ValueError(f"{name} of shape {shape} does not fit {len(body)} B")
    return np.frombuffer(body, wire.dtype).reshape(shape)
