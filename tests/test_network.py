import networkx as nx
import numpy as np
import pytest

from mannbv import network


def links(graph):
    return {tuple(sorted(edge)) for edge in graph.edges}


def test_graphs_have_the_links_of_their_names():
    assert links(network.build("complete", 4)) == {(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)}
    assert links(network.build("ring", 4)) == {(0, 1), (1, 2), (2, 3), (0, 3)}
    assert links(network.build("line", 4)) == {(0, 1), (1, 2), (2, 3)}
    assert links(network.build("star", 4)) == {(0, 1), (0, 2), (0, 3)}


@pytest.mark.parametrize("name", network.GRAPHS)
@pytest.mark.parametrize("n", [1, 2, 3, 10])
def test_every_graph_suits_every_team_size(name, n):
    network.check(network.build(name, n), n)


def test_neighbours_are_sorted():
    graph = nx.Graph([(2, 3), (2, 0), (2, 1)])
    assert network.neighbours(graph, 2) == [0, 1, 3]
    assert network.neighbours(graph, 3) == [2]


def test_links_in_range_follow_the_distances():
    graph = network.in_range([[0.0, 0.0], [1.0, 0.0], [2.5, 0.0], [1.0, 0.9]], 1.0)
    assert links(graph) == {(0, 1), (1, 3)}
    assert list(graph.nodes) == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("graph", "n", "words"),
    [
        (nx.empty_graph(0), 0, "at least one robot, got 0"),
        (nx.path_graph(3), 4, "extra or missing: 3"),
        (nx.Graph([("a", "b")]), 2, "must be the robots 0 to 1"),
        (nx.Graph([(0, 1), (1, 1)]), 2, "robot 1 is linked to itself"),
        (nx.Graph([(0, 2), (1, 3)]), 4, r"\[0, 2\] and \[1, 3\] cannot reach"),
        (nx.empty_graph(3), 3, r"\[0\] and \[1\] and \[2\]"),
        (nx.DiGraph([(0, 1)]), 2, "undirected"),
        (nx.MultiGraph([(0, 1)]), 2, "undirected"),
        (np.ones((2, 2)), 2, "undirected networkx.Graph, got ndarray"),
    ],
)
def test_a_bad_graph_is_named(graph, n, words, unchecked):
    with pytest.raises(ValueError, match=words) as error:
        network.check(graph, n)
    assert "\n" not in str(error.value)


def test_bad_names_and_sizes():
    with pytest.raises(ValueError, match=r"no graph is called 'mesh'.*complete"):
        network.build("mesh", 3)
    with pytest.raises(ValueError, match="at least one robot"):
        network.build("ring", 0)


GRAPHS = [network.build(name, 5) for name in network.GRAPHS]
GRAPHS += [nx.barbell_graph(3, 2), nx.random_labeled_tree(9, seed=4), nx.path_graph(2), nx.empty_graph(1)]


@pytest.mark.parametrize("graph", GRAPHS)
def test_relays_bring_every_message_to_every_robot_once_and_early(graph):
    n = len(graph)
    arrived = {robot: {robot: 0} for robot in graph}  # robot → origin → hops after which it has the message
    for hop, triples in enumerate(network.hops(graph), 1):
        for sender, receiver, origin in triples:
            assert graph.has_edge(sender, receiver)
            assert arrived[sender][origin] < hop  # nobody passes on what it does not have yet
            assert origin not in arrived[receiver]
            arrived[receiver][origin] = hop
    distance = dict(nx.all_pairs_shortest_path_length(graph))
    assert arrived == distance
    assert sum(len(triples) for triples in network.hops(graph)) == n * (n - 1)
    assert len(network.hops(graph)) == nx.diameter(graph)


def test_on_a_complete_graph_every_ordered_pair_talks_once():
    (triples,) = network.hops(network.build("complete", 4))
    assert triples == [(i, j, i) for i in range(4) for j in range(4) if i != j]
