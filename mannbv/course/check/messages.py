"""Exercises of notebook 11: sizes of maps and messages, letters on a ring, a codec for yaws."""

from collections.abc import Callable
from types import SimpleNamespace

import networkx as nx
import numpy as np

from mannbv import geometry, messages, network
from mannbv.course.check.verdict import AGREES, ask, exercise, judged, plain

_MIB = 2**20


@exercise(cases=[([34_911, 26_800],), ([56_741, 51_055, 30_174, 50_368, 22_909],), ([1000],)])
def total(counts):
    """my_total(splat_counts) → the size of all maps as the paper's Tables III and V print it [MiB]."""
    return {
        AGREES: messages.centralized_bytes(counts) / _MIB,
        "these are bytes; which unit does the table use?": 56 * sum(counts),
        "the paper's MB is not a million bytes in these tables": 56 * sum(counts) / 1e6,
        "these are KiB": 56 * sum(counts) / 1024,
        "twice too large: numbers travel in single precision": 112 * sum(counts) / _MIB,
        "one byte a number? single precision takes more": 14 * sum(counts) / _MIB,
        "that is a splat of flatland": 40 * sum(counts) / _MIB,
        "a splat with harmonics and normals; the paper sends fewer numbers": 248 * sum(counts) / _MIB,
        "a splat with harmonics; the paper sends fewer numbers": 236 * sum(counts) / _MIB,
        "the paper counts each map once, not for each teammate": 56 * sum(counts) * (len(counts) - 1) / _MIB,
    }


def _copies(n_robots: int, codec: str = "binary") -> int:
    return len(messages.encode(messages.Copies(0, 0, 0, np.zeros(n_robots)), codec))


@exercise(cases=[(2,), (3,), (5,), (10,)])
def copies(n):
    """my_copies(n_robots) → bytes of one `messages.Copies` in binary [B]."""
    return {
        AGREES: _copies(n),
        "these are the yaws alone; what stands before them?": 8 * n,
        "4 B are missing: an array says how long it is": 14 + 8 * n,
        "offsets are doubles, and an array says how long it is": 14 + 4 * n,
        "that is single precision; offsets are doubles": 18 + 4 * n,
        "one yaw is missing: a copy holds the sender's own as well": _copies(n - 1),
        "that is sent to everyone; one message is asked for": _copies(n) * (n - 1),
        "that is JSON": _copies(n, "json"),
    }


def _letters(n: int) -> int:
    lengths = dict(nx.all_pairs_shortest_path_length(network.build("ring", n)))
    return sum(sum(row.values()) for row in lengths.values())


@exercise(cases=[(4,), (5,), (8,), (11,)])
def ring(n):
    """my_ring(n_robots) → transmissions when everyone sends every teammate a letter of its own on a ring."""
    return {
        AGREES: _letters(n),
        "as if everyone could hear everyone, or one letter served all": n * (n - 1),
        "all letters go the same way round; the other way is shorter for half of them": n * n * (n - 1) / 2,
        "each pair sends two letters, one each way": _letters(n) / 2,
        "these are the letters of one robot": _letters(n) / n,
        "only neighbours have written so far": 2 * n,
        "each letter comes exactly two links far? some travel farther": 2 * n * (n - 1),
    }


def _codec(dtype: str, step: float) -> tuple[Callable, Callable]:
    """Whole steps of an angle [rad], as integers of a type."""
    return (
        lambda yaws: np.round(np.asarray(yaws) / step).astype(dtype).tobytes(),
        lambda data: np.frombuffer(data, dtype) * step,
    )


@judged(
    truth=_codec("<i2", np.pi / 32767),
    mistakes=[
        ((lambda yaws: list(yaws), lambda data: np.array(data)),
         "bytes are wanted: the message must be ready to be sent", lambda seen: not seen.bytes),
        ((lambda yaws: np.asarray(yaws, "<f4").tobytes(), lambda data: np.frombuffer(data, "<f4")),
         "more than 2 B a yaw", lambda seen: not seen.short),
        ((_codec("<i2", 0.0002)[0], _codec("i1", 0.0002)[1]),
         "what comes back has not as many yaws as went in", lambda seen: not seen.whole),
        (_codec("i1", np.pi / 127),
         "too coarse: an error of more than 0.001 rad. Are all levels of the two bytes spread over the circle?",
         lambda seen: seen.turned > 0.001 and seen.worst < 0.1),
        (_codec("<i2", 0.00005),
         "far off for some yaws: degrees for radians, or an integer that overflows at the ends?",
         lambda seen: not seen.turned <= 0.001),
    ],
)  # fmt: skip
def pack(pack: Callable, unpack: Callable) -> SimpleNamespace:
    """my_pack(yaws (n,)) → bytes, at most 2 a yaw; my_unpack(bytes) → (n,) within 0.001 rad.

    What becomes of three sets of yaws on the way there and back.
    """
    sets = [np.linspace(-np.pi, np.pi, 4001)[:-1], np.array([0.0]), np.array([-np.pi, np.nextafter(np.pi, 0)])]
    packed = [ask(pack, yaws.copy()) for yaws in sets]
    seen = SimpleNamespace(bytes=all(isinstance(data, bytes) for data in packed), short=False, whole=False)
    back: list[np.ndarray] = []
    if seen.bytes:
        seen.short = all(len(data) <= 2 * len(yaws) for data, yaws in zip(packed, sets, strict=True))
        back = [plain(ask(unpack, data)) for data in packed]
        seen.whole = all(a.shape == b.shape for a, b in zip(back, sets, strict=True))
    if seen.whole:
        off = np.concatenate(back) - np.concatenate(sets)
        seen.worst, seen.turned = np.abs(off).max(), np.abs(geometry.wrap(off)).max()
    return seen
