"""Who talks to whom: communication graphs over robots 0 … n−1 (Section V-B)."""

from collections.abc import Callable

import networkx as nx
import numpy as np
from numpy.typing import ArrayLike


def _ring(n: int) -> nx.Graph:
    return nx.cycle_graph(n) if n > 2 else nx.path_graph(n)  # networkx closes a ring of one into a self-loop


GRAPHS: dict[str, Callable[[int], nx.Graph]] = {
    "complete": nx.complete_graph,
    "ring": _ring,
    "line": nx.path_graph,
    "star": lambda n: nx.star_graph(n - 1),  # robot 0 in the middle
}


def build(name: str, n: int) -> nx.Graph:
    """The graph called `name` in GRAPHS over n robots. Raises ValueError for another name or fewer than one robot."""
    if name not in GRAPHS:
        raise ValueError(f"network: no graph is called '{name}'; choose one of {', '.join(GRAPHS)}")
    if n < 1:
        raise ValueError(f"network: a team needs at least one robot, got {n}")
    return GRAPHS[name](int(n))


def in_range(positions: ArrayLike, radius: float) -> nx.Graph:
    """Links between robots at positions (n, d) [m] no further apart than `radius` [m]; may be disconnected."""
    positions = np.asarray(positions, float)
    distance = np.linalg.norm(positions[:, None] - positions, axis=-1)
    graph = nx.empty_graph(len(positions))
    graph.add_edges_from(np.argwhere(np.triu(distance <= radius, 1)).tolist())
    return graph


def check(graph: nx.Graph, n: int) -> None:
    """Raises ValueError unless `graph` is an undirected, connected graph without self-loops over robots 0 … n−1."""
    if n < 1:
        raise ValueError(f"network: a team needs at least one robot, got {n}")
    if not isinstance(graph, nx.Graph) or graph.is_directed() or graph.is_multigraph():
        raise ValueError(f"network: expected an undirected networkx.Graph, got {type(graph).__name__}")
    if set(graph.nodes) != set(range(n)):
        odd = sorted(map(str, set(graph.nodes) ^ set(range(n))))
        raise ValueError(f"network: nodes must be the robots 0 to {n - 1}; extra or missing: {', '.join(odd)}")
    loops = sorted(nx.nodes_with_selfloops(graph))
    if loops:
        raise ValueError(f"network: robot {loops[0]} is linked to itself; remove that edge")
    parts = [sorted(part) for part in nx.connected_components(graph)]
    if len(parts) > 1:
        named = " and ".join(str(part) for part in parts)
        raise ValueError(f"network: the robots {named} cannot reach each other; add a link between the parts")


def neighbours(graph: nx.Graph, robot: int) -> list[int]:
    """N_i, the robots one hop away, in ascending order."""
    return sorted(int(j) for j in graph.neighbors(robot))


def hops(graph: nx.Graph) -> list[list[tuple[int, int, int]]]:
    """How a message of every robot reaches all others: for each round of hops, its (sender, receiver, origin) triples.

    Each robot receives each origin's message exactly once, along a shortest way, from the lowest-numbered neighbour
    that already has it: n(n−1) transmissions in all, in as many rounds as the graph's diameter. On a complete graph
    that is one round with every ordered pair once.
    """
    distance = dict(nx.all_pairs_shortest_path_length(graph))
    rounds = [[] for _ in range(max((max(row.values()) for row in distance.values()), default=0))]
    for origin, row in sorted(distance.items()):
        for receiver, far in row.items():
            if far:
                sender = next(j for j in neighbours(graph, receiver) if row[j] == far - 1)
                rounds[far - 1].append((sender, int(receiver), int(origin)))
    return [sorted(triples) for triples in rounds]
