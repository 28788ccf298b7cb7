"""What crosses every link of a team in one planning cycle, in really encoded bytes."""

import functools

import networkx as nx
import numpy as np
import torch

from mannbv import information, network, world
from mannbv import messages as wire
from mannbv.config import Config
from mannbv.splats import SplatMap

_GUESTS, _CELL = Config().guest_splats, Config().cell
_UNITS = {0: "B", 3: "kB", 6: "MB", 9: "GB"}


def cycle_ledger(strategy: str, graph: str, robots, splats, rounds, waypoints, codec: str) -> wire.Ledger:
    """Every message of a planning cycle [B], as the strategies of `team` send them, on the links of a graph.

    Plans and grids are of the ground, splats of space, with ids and prior; what they say is made up, and encoded once.
    """
    ledger, (to_all, to_one, links) = wire.Ledger(), _ways(graph, robots)

    def everyone(kind: str, sizes) -> None:
        for sender, receiver, origin in to_all:
            ledger.sent(sender, receiver, kind, 0, sizes[origin], origin)

    def letters(kind: str, n_bytes) -> None:
        for sender, receiver, origin in to_one:
            ledger.sent(sender, receiver, kind, 0, n_bytes, origin)

    everyone("Plan", _plan_sizes(robots, waypoints, codec))
    if strategy == "centralized":
        everyone("Splats", [_splats_size(splats, codec)] * robots)
        everyone("Grid", [_grid_size(codec)] * robots)
        return ledger
    if strategy == "limited":
        letters("Splats", _splats_size(min(splats, _GUESTS), codec))
    letters("Suggestion", _answer_size(codec))
    for sizes in (_copies_sizes(robots, turn, codec) for turn in range(rounds)):
        for sender, receiver in links:
            ledger.sent(sender, receiver, "Copies", 0, sizes[sender])
    return ledger


@functools.lru_cache(64)
def _ways(name: str, robots: int):
    """(sender, receiver, origin) of news to all and of a letter to each teammate; (sender, receiver) on every link."""
    graph = network.build(name, robots)
    pairs = [(i, k) for i in range(robots) for k in range(robots) if i != k]
    hops = [(*step, i) for i, k in pairs for step in nx.utils.pairwise(nx.shortest_path(graph, i, k))]
    links = [(i, k) for i in range(robots) for k in network.neighbours(graph, i)]
    return [step for hop in network.hops(graph) for step in hop], hops, links


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


def size_of(n_bytes) -> str:
    """Bytes in three digits at most: 136 B, 8.03 kB, 1 MB; a kB is 1000 B."""
    power = max((p for p in _UNITS if n_bytes >= 0.9995 * 10**p), default=0)
    return f"{n_bytes / 10**power:.3g} {_UNITS[power]}"
