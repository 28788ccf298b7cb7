"""What crosses every link of a team in one planning cycle, in really encoded bytes."""

import functools
from collections.abc import Callable, Iterable

import networkx as nx
import numpy as np
import torch

from mannbv import information, network, world
from mannbv import messages as wire
from mannbv.config import Config
from mannbv.splats import SplatMap

_GUESTS, _CELL = Config().guest_splats, Config().cell
_UNITS = {0: "B", 3: "kB", 6: "MB", 9: "GB"}


class _Scales(wire.Mailbox):
    """A mailbox that knows what each kind of message weighs [B]: what crosses here is made up, its size is not."""

    def __init__(self, graph: nx.Graph, sizes: dict[type, Callable[..., int]]):
        super().__init__(network=graph)
        self._sizes = sizes

    def carried(self, message: wire.Message) -> tuple[int, wire.Message]:
        return self._sizes[type(message)](message), message


def cycle_ledger(
    strategy: str, graph: str, robots: int, splats: int, rounds: int, waypoints: int, codec: str
) -> wire.Ledger:
    """Every message of a planning cycle [B], as the strategies of `team` send them, on the links of a graph.

    Plans and grids are of the ground, splats of space, with ids and prior; what they say is made up, and encoded once.
    """
    links = network.build(graph, robots)
    mailbox = _Scales(links, {
        wire.Plan: lambda said: _plan_sizes(robots, waypoints, codec)[said.robot],
        wire.Splats: lambda said: _splats_size(splats if said.whole else min(splats, _GUESTS), codec),
        wire.Grid: lambda said: _grid_size(codec),
        wire.Suggestion: lambda said: _answer_size(codec),
        wire.Copies: lambda said: _copies_sizes(robots, said.round, codec)[said.robot],
    })  # fmt: skip

    def say(message: Callable[[int], wire.Message], receivers: Callable[[int], Iterable[int | None]]) -> None:
        mailbox.deliver({i: [(k, message(i)) for k in receivers(i)] for i in range(robots)}, links)

    def everyone(_: int) -> list[None]:
        return [None]

    def each_other(i: int) -> list[int]:
        return [k for k in range(robots) if k != i]

    say(_plan, everyone)
    if strategy == "centralized":
        say(_whole_map, everyone)
        say(_grid, everyone)
        return mailbox.ledger
    if strategy == "limited":
        say(_guests, each_other)
    say(_answer, each_other)
    for turn in range(rounds):
        say(functools.partial(_copies, turn=turn), lambda i: network.neighbours(links, i))
    return mailbox.ledger


# what is said, in short: `_Scales` knows what it would weigh at length


@functools.cache
def _plan(i: int) -> wire.Plan:
    return wire.Plan(i, 0, np.zeros(2), 0.0, np.zeros((1, 2)))


@functools.cache
def _whole_map(i: int) -> wire.Splats:
    return wire.Splats(i, 0, SplatMap.empty(3), whole=1)


@functools.cache
def _guests(i: int) -> wire.Splats:
    return wire.Splats(i, 0, SplatMap.empty(3))


@functools.cache
def _grid(i: int) -> wire.Grid:
    return wire.Grid(i, 0, np.zeros(2), _CELL, np.zeros((0, 0)))


@functools.cache
def _answer(i: int) -> wire.Suggestion:
    return wire.Suggestion(i, 0, 0, 0.0, 0.0, 0.0)


@functools.lru_cache(2048)
def _copies(i: int, turn: int) -> wire.Copies:
    return wire.Copies(i, 0, turn, np.zeros(0))


@functools.lru_cache(256)
def _plan_sizes(robots: int, waypoints: int, codec: str) -> list[int]:
    rng = np.random.default_rng(robots)
    paths = rng.uniform(0, 9, (robots, waypoints, 2))
    made = (wire.Plan(k, 3, rng.uniform(0, 9, 2), rng.uniform(-3, 3), path) for k, path in enumerate(paths))
    return [len(wire.encode(plan, codec)) for plan in made]


@functools.cache
def _answer_size(codec: str) -> int:
    gains = np.random.default_rng(1).uniform(0, 3, 4)
    return len(wire.encode(wire.Suggestion(0, 3, 1, *gains), codec))


@functools.cache
def _copies_sizes(robots: int, turn: int, codec: str) -> list[int]:
    offsets = np.random.default_rng([robots, turn]).uniform(-3, 3, (robots, robots))
    return [len(wire.encode(wire.Copies(k, 3, turn, row), codec)) for k, row in enumerate(offsets)]


@functools.lru_cache(256)
def _splats_size(n: int, codec: str) -> int:
    rng, widths = np.random.default_rng(n), (3, 3, 4, 1, 3)
    means, scales, turns, opacity, colors = (torch.from_numpy(rng.random((n, w), np.float32)) for w in widths)
    splat_map = SplatMap(means, scales, turns, opacity[:, 0], colors)
    prior = torch.zeros(n, information.n_parameters(splat_map.dim))
    return len(wire.encode(wire.Splats(0, 3, splat_map, prior=prior, whole=1), codec))


@functools.cache
def _grid_size(codec: str) -> int:
    """A grid of the whole flat: what a robot knows of it in the end."""
    lattice, free = world.load("flat").ground.free_grid(_CELL, 0.0)
    return len(wire.encode(wire.Grid(0, 3, np.array(lattice.origin), lattice.cell, np.where(free, 0, 1)), codec))


def size_of(n_bytes: float) -> str:
    """Bytes in three digits at most: 136 B, 8.03 kB, 1 MB; a kB is 1000 B."""
    power = max((p for p in _UNITS if n_bytes >= 0.9995 * 10**p), default=0)
    return f"{n_bytes / 10**power:.3g} {_UNITS[power]}"
