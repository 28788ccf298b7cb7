"""Checks of notebook 11: sizes of maps and messages, letters on a ring, a codec for yaws."""

from collections.abc import Callable

import networkx as nx
import numpy as np

from mannbv import messages, network
from mannbv.course.check.verdict import compare


def total(mine: Callable) -> bool:
    """mine(splat_counts) → the size of all maps as the paper's Tables III and V print it [MiB]."""
    cases = [([34_911, 26_800],), ([56_741, 51_055, 30_174, 50_368, 22_909],), ([1000],)]
    mib = 2**20
    mistakes = [
        (lambda counts: 56 * sum(counts), "these are bytes; which unit does the table use?"),
        (lambda counts: 56 * sum(counts) / 1e6, "the paper's MB is not a million bytes in these tables"),
        (lambda counts: 56 * sum(counts) / 1024, "these are KiB"),
        (lambda counts: 112 * sum(counts) / mib, "twice too large: numbers travel in single precision"),
        (lambda counts: 14 * sum(counts) / mib, "one byte a number? single precision takes more"),
        (lambda counts: 40 * sum(counts) / mib, "that is a splat of flatland"),
        (lambda counts: 248 * sum(counts) / mib, "a splat with harmonics and normals; the paper sends fewer numbers"),
        (lambda counts: 236 * sum(counts) / mib, "a splat with harmonics; the paper sends fewer numbers"),
        (lambda c: 56 * sum(c) * (len(c) - 1) / mib, "the paper counts each map once, not for each teammate"),
    ]  # fmt: skip
    return compare(mine, lambda counts: messages.centralized_bytes(counts) / mib, cases, mistakes)


def copies(mine: Callable) -> bool:
    """mine(n_robots) → bytes of one `messages.Copies` in binary [B]."""

    def truth(n):
        return len(messages.encode(messages.Copies(0, 0, 0, np.zeros(n)), "binary"))

    mistakes = [
        (lambda n: 8 * n, "these are the yaws alone; what stands before them?"),
        (lambda n: 14 + 8 * n, "4 B are missing: an array says how long it is"),
        (lambda n: 14 + 4 * n, "offsets are doubles, and an array says how long it is"),
        (lambda n: 18 + 4 * n, "that is single precision; offsets are doubles"),
        (lambda n: truth(n - 1), "one yaw is missing: a copy holds the sender's own as well"),
        (lambda n: truth(n) * (n - 1), "that is sent to everyone; one message is asked for"),
        (lambda n: len(messages.encode(messages.Copies(0, 0, 0, np.zeros(n)), "json")), "that is JSON"),
    ]
    return compare(mine, truth, [(2,), (3,), (5,), (10,)], mistakes)


def ring(mine: Callable) -> bool:
    """mine(n_robots) → transmissions when everyone sends every teammate a letter of its own on a ring."""

    def truth(n):
        lengths = dict(nx.all_pairs_shortest_path_length(network.build("ring", n)))
        return sum(sum(row.values()) for row in lengths.values())

    mistakes = [
        (lambda n: n * (n - 1), "as if everyone could hear everyone, or one letter served all"),
        (lambda n: n * n * (n - 1) / 2, "all letters go the same way round; the other way is shorter for half of them"),
        (lambda n: truth(n) / 2, "each pair sends two letters, one each way"),
        (lambda n: truth(n) / n, "these are the letters of one robot"),
        (lambda n: 2 * n, "only neighbours have written so far"),
        (lambda n: 2 * n * (n - 1), "each letter comes exactly two links far? some travel farther"),
    ]
    return compare(mine, truth, [(4,), (5,), (8,), (11,)], mistakes)


def pack(mine: Callable, unpack: Callable) -> bool:
    """mine(yaws (n,)) → bytes, at most 2 a yaw; unpack(bytes) → (n,) within 0.001 rad."""
    sweep = np.linspace(-np.pi, np.pi, 4001)[:-1]
    cases = [sweep, np.array([0.0]), np.array([-np.pi, np.nextafter(np.pi, 0)])]

    def outcome() -> int | None:
        packed = [mine(yaws) for yaws in cases]
        if any(data is None or data is ... for data in packed):
            return None
        if not all(isinstance(data, bytes) for data in packed):
            return 1
        if any(len(data) > 2 * len(yaws) for data, yaws in zip(packed, cases, strict=True)):
            return 2
        back = [unpack(data) for data in packed]
        if any(yaws is None or yaws is ... for yaws in back):
            return None
        if any(np.shape(a) != b.shape for a, b in zip(back, cases, strict=True)):
            return 3
        error = max(np.abs(np.asarray(a, float) - b).max() for a, b in zip(back, cases, strict=True))
        turned = max(np.abs(np.angle(np.exp(1j * (np.asarray(a) - b)))).max() for a, b in zip(back, cases, strict=True))
        return 0 if turned <= 0.001 else 4 if error < 0.1 else 5

    mistakes = [
        (lambda: 1, "bytes are wanted: the message must be ready to be sent"),
        (lambda: 2, "more than 2 B a yaw"),
        (lambda: 3, "what comes back has not as many yaws as went in"),
        (
            lambda: 4,
            "too coarse: an error of more than 0.001 rad. Are all levels of the two bytes spread over the circle?",
        ),
        (lambda: 5, "far off for some yaws: degrees for radians, or an integer that overflows at the ends?"),
    ]
    return compare(outcome, lambda: 0, [()], mistakes)
