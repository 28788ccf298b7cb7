import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from skimage.graph import MCP_Geometric

from mannbv import grid
from mannbv.config import Config
from mannbv.grid import FREE, OCCUPIED, UNKNOWN, Lattice, Occupancy


def random_costs(rng, shape=(17, 23), blocked=0.3):
    cost = rng.uniform(1, 5, shape)
    cost[rng.random(shape) < blocked] = np.inf
    return cost


def moves(cost):
    """Every legal move (a, b, price), written out by hand: a diagonal needs both cells beside it open."""
    nx, ny = cost.shape
    for x in range(nx):
        for y in range(ny):
            for dx, dy in [(1, 0), (0, 1), (1, 1), (1, -1)]:
                u, v = x + dx, y + dy
                if not (0 <= u < nx and 0 <= v < ny) or np.isinf([cost[x, y], cost[u, v]]).any():
                    continue
                if dx and dy and np.isinf([cost[u, y], cost[x, v]]).any():
                    continue
                yield (x, y), (u, v), math.hypot(dx, dy) * (cost[x, y] + cost[u, v]) / 2


def scipy_distance(cost, source):
    edges = list(moves(cost))
    rows, columns = (np.array([np.ravel_multi_index(edge[k], cost.shape) for edge in edges]) for k in (0, 1))
    prices = np.array([price for *_, price in edges])
    graph = coo_array((prices, (rows, columns)), (cost.size, cost.size)).tocsr()
    return dijkstra(graph, directed=False, indices=source[0] * cost.shape[1] + source[1]).reshape(cost.shape)


@pytest.mark.parametrize("seed", range(6))
def test_geodesic_and_astar_cost_what_scipy_says(seed):
    rng = np.random.default_rng(seed)
    cost = random_costs(rng)
    legal = {frozenset((a, b)): price for a, b, price in moves(cost)}
    open_cells = np.argwhere(np.isfinite(cost))
    source = open_cells[rng.integers(len(open_cells))]
    expected = scipy_distance(cost, source)
    assert_allclose(grid.geodesic(cost, source[None]), np.where(np.isfinite(cost), expected, np.inf), rtol=1e-12)
    assert np.isinf(expected[np.isfinite(cost)]).any() or np.isfinite(expected).sum() > 100
    for goal in open_cells[rng.integers(len(open_cells), size=25)]:
        way = grid.path(cost, source, goal)
        if np.isinf(expected[tuple(goal)]):
            assert way is None
            continue
        assert way[0].tolist() == source.tolist()
        assert way[-1].tolist() == goal.tolist()
        steps = [
            legal[frozenset((tuple(a), tuple(b)))] for a, b in zip(way[:-1].tolist(), way[1:].tolist(), strict=True)
        ]
        assert_allclose(sum(steps), expected[tuple(goal)], rtol=1e-12, atol=1e-12)


def test_geodesic_agrees_with_skimage_where_nothing_is_blocked(rng):
    cost = rng.uniform(1, 5, (20, 15))
    expected, _ = MCP_Geometric(cost).find_costs([(3, 4)])
    assert_allclose(grid.geodesic(cost, np.array([[3, 4]])), expected, rtol=1e-12)


def test_several_sources_take_the_nearest(rng):
    cost = random_costs(rng)
    sources = np.argwhere(np.isfinite(cost))[[3, 50, 120]]
    each = [grid.geodesic(cost, s[None]) for s in sources]
    assert_allclose(grid.geodesic(cost, sources), np.minimum.reduce(each), rtol=1e-12)


def test_a_limit_leaves_out_what_is_farther(rng):
    cost = random_costs(rng)
    source = np.argwhere(np.isfinite(cost))[:1]
    far = grid.geodesic(cost, source)
    assert_allclose(grid.geodesic(cost, source, 20.0), np.where(far <= 20, far, np.inf), rtol=1e-12)


def test_no_way_squeezes_between_two_blocked_cells():
    cost = np.array([[1.0, np.inf], [np.inf, 1.0]])
    assert grid.path(cost, (0, 0), (1, 1)) is None
    loose = np.array([[1.0, np.inf], [1.0, 1.0]])
    assert len(grid.path(loose, (0, 0), (1, 1))) == 3  # around the corner, not across it


def test_a_blocked_or_equal_end():
    cost = np.ones((3, 3))
    assert grid.path(cost, (1, 1), (1, 1)).tolist() == [[1, 1]]
    cost[2, 2] = np.inf
    assert grid.path(cost, (0, 0), (2, 2)) is None
    assert grid.path(cost, (2, 2), (0, 0)) is None


def test_cells_outside_the_lattice_are_named():
    for call in (
        lambda: grid.path(np.ones((3, 3)), (0, 0), (3, 0)),
        lambda: grid.geodesic(np.ones((3, 3)), np.array([[0, -1]])),
    ):
        with pytest.raises(ValueError, match="lies outside the lattice of"):
            call()


def draw(*rows):
    """A state from a drawing: '.' free, '#' occupied, ' ' unknown; the first row is the top (largest y)."""
    codes = {".": FREE, "#": OCCUPIED, " ": UNKNOWN}
    return np.array([[codes[c] for c in row] for row in rows])[::-1].T


def test_frontiers_of_a_drawing():
    state = draw(
        "####### ",
        "#....#  ",
        "#....   ",  # the door's cell (4, 3) sees the unknown
        "#....#  ",
        "##..### ",
        " #..#   ",
        "   .    ",
    )
    groups = [{tuple(cell) for cell in group.tolist()} for group in grid.frontiers(state)]
    # (2, 1) has the unknown below it, (3, 0) on its sides: they touch, also by the corner
    assert sorted(map(sorted, groups)) == [[(2, 1), (3, 0)], [(4, 4)]]
    assert [len(g) for g in grid.frontiers(state, min_cells=2)] == [2]
    assert grid.frontiers(state, min_cells=3) == []


def test_frontiers_need_a_side_not_a_corner():
    assert grid.frontiers(draw("#.", " #")) == []
    assert len(grid.frontiers(draw(".#", " #"))) == 1
    # the lattice's own edge is no frontier
    assert grid.frontiers(np.full((4, 4), FREE)) == []


@pytest.mark.parametrize(
    ("seed", "config"), [*((seed, Config()) for seed in range(4)), (4, Config(evidence_hit=3.0, evidence_pass=0.75))]
)
def test_carving_marks_the_cells_that_a_dense_sampling_touches(seed, config):
    rng = np.random.default_rng(seed)
    lattice = Lattice((-1.0, 0.5), 0.25, (20, 16))
    origin = rng.uniform([-1, 0.5], [4, 4.5])
    ends = rng.uniform([-2, -0.5], [5, 5.5], (12, 2))  # some beyond the lattice
    hits = rng.random(12) < 0.5
    known = Occupancy.unknown(lattice).carved(origin, ends, hits, config)
    free, hit = np.zeros(lattice.shape, bool), np.zeros(lattice.shape, bool)
    for end, stop in zip(ends, hits, strict=True):
        cells = lattice.index(origin + np.linspace(0, 1, 20_001)[:, None] * (end - origin))
        last = cells[-1]
        if stop:
            cells = cells[(cells != last).any(1)]
            if lattice.inside(last[None])[0]:
                hit[tuple(last)] = True
        cells = cells[lattice.inside(cells)]
        free[cells[:, 0], cells[:, 1]] = True
    assert hit.any()
    assert free.any()
    worth = (2.0, -0.4) if config == Config() else (3.0, -0.75)
    assert_allclose(known.log_odds, np.where(hit, worth[0], np.where(free, worth[1], 0)), rtol=1e-6)


@pytest.mark.parametrize(
    ("end", "expected"), [((4.5, 1.5), [(1, 1), (2, 1), (3, 1), (4, 1)]), ((1.5, 3.0), [(1, 1), (1, 2), (1, 3)])]
)
def test_carving_along_an_axis(end, expected):
    known = Occupancy.unknown(Lattice((0.0, 0.0), 1.0, (6, 6))).carved((1.5, 1.5), [end], [False])
    assert [tuple(c) for c in np.argwhere(known.state == FREE).tolist()] == expected


def test_a_hit_outweighs_passes_and_a_tie_is_never_unknown():
    lattice = Lattice((0.0, 0.0), 1.0, (6, 3))
    ray = ([0.5, 1.5], [[5.5, 1.5]], [False])
    stop = ([0.5, 1.5], [[3.5, 1.5]], [True])
    known = Occupancy.unknown(lattice).carved(*ray).carved(*stop)
    assert known.state[3, 1] == OCCUPIED
    for passes in range(1, 12):  # five passes weigh as much as one hit
        known = Occupancy.unknown(lattice)
        for _ in range(passes):
            known = known.carved(*ray)
        known = known.carved(*stop)
        assert known.state[3, 1] == (OCCUPIED if passes <= 5 else FREE)
        assert known.state[1, 1] == FREE
    assert (known.state[:, [0, 2]] == UNKNOWN).all()


def test_evidence_ends_at_its_bounds():
    lattice, ray = Lattice((0.0, 0.0), 1.0, (4, 1)), ([0.5, 0.5], [[3.5, 0.5]], [True])
    known, tight = Occupancy.unknown(lattice), Occupancy.unknown(lattice)
    for _ in range(12):
        known, tight = known.carved(*ray), tight.carved(*ray, Config(evidence_free=1.5, evidence_occupied=5.0))
    assert_allclose(known.log_odds[[0, 3], 0], [-4, 8])
    assert_allclose(tight.log_odds[[0, 3], 0], [-1.5, 5])
    assert_allclose(tight.merged(tight).log_odds[[0, 3], 0], [-3, 8])
    assert_allclose(tight.merged(tight, config=Config(evidence_occupied=6.0)).log_odds[[0, 3], 0], [-3, 6])
    far = Occupancy.unknown(lattice).blocked([[2.5, 0.5]], Config(evidence_hit=3.0))
    assert_allclose(far.log_odds[:, 0], [0, 0, 3, 0])


def test_merging_adds_evidence_and_keeps_what_is_known():
    lattice = Lattice((0.0, 0.0), 1.0, (4, 1))
    layers = [Occupancy(lattice, np.array([[a], [b], [c], [0]], np.float32)) for a, b, c in [(2, -4, 2), (0, 8, -2)]]
    merged = layers[0].merged(layers[1])
    assert merged.state[:, 0].tolist() == [OCCUPIED, OCCUPIED, OCCUPIED, UNKNOWN]
    assert_allclose(merged.log_odds[:2, 0], [2, 4])
    with pytest.raises(ValueError, match="cells coincide"):
        layers[0].merged(Occupancy.unknown(Lattice((0.3, 0.0), 1.0, (5, 1))))


def test_cropping_keeps_what_is_known_in_place(rng):
    lattice = Lattice((-1.0, 2.0), 0.1, (40, 30))
    known = Occupancy.unknown(lattice).carved((0.5, 3.5), rng.uniform([0, 3], [2, 4.5], (10, 2)), [True] * 10)
    small = known.cropped(np.array([[2.5, 4.6]]), 0.3)
    assert small.log_odds.size < known.log_odds.size
    points = lattice.centers().reshape(-1, 2)
    assert_allclose(
        small.lattice.at(small.log_odds, points, 0.0), lattice.at(known.log_odds, points, 0.0)
    )  # nothing known is lost
    assert small.lattice.inside(small.lattice.index([[2.5, 4.6]]))[0]


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(0.02, 0.9))
def test_within_and_nearest_agree_with_brute_force(seed, share):
    rng = np.random.default_rng(seed)
    cells = rng.random((9, 12)) < share
    index = rng.integers(0, [9, 12], (15, 2))
    marked = np.argwhere(cells)
    if not len(marked):
        assert not grid.within(cells, 1.0, 0.1).any()
        assert np.isinf(grid.nearest(cells, index)[1]).all()
        return
    every = np.argwhere(np.ones_like(cells))
    apart = np.linalg.norm(every[:, None] - marked, axis=-1).min(1).reshape(cells.shape)
    assert (grid.within(cells, 0.25, 0.1) == (apart * 0.1 < 0.25)).all()
    found, distance = grid.nearest(cells, index)
    assert cells[found[:, 0], found[:, 1]].all()
    assert_allclose(distance, apart[index[:, 0], index[:, 1]])
    assert_allclose(np.linalg.norm(found - index, axis=1), distance)


def test_lattices_count_cells_from_their_corner():
    lattice = Lattice.around((-1.0, 2.0), (0.0, 2.35), 0.1)
    assert lattice.shape == (10, 4)
    assert lattice.index([[-1.0, 2.0], [-0.91, 2.31], [-1.01, 2.0]]).tolist() == [[0, 0], [0, 3], [-1, 0]]
    assert lattice.inside(np.array([[0, 0], [9, 3], [10, 0], [-1, 0], [0, 4]])).tolist() == [
        True,
        True,
        False,
        False,
        False,
    ]
    assert_allclose(lattice.centers([[0, 0], [9, 3]]), [[-0.95, 2.05], [-0.05, 2.35]])
    assert_allclose(lattice.centers()[9, 3], [-0.05, 2.35])
    index = np.argwhere(np.ones(lattice.shape))
    assert (lattice.index(lattice.centers(index)) == index).all()
    values = np.arange(40.0).reshape(10, 4)
    assert lattice.at(values, [[-0.05, 2.35], [5.0, 5.0]], -7.0).tolist() == [39.0, -7.0]


@pytest.mark.parametrize("upper", [(1.0, 0.0), (0.0, 1.0), (math.nan, 1.0), (math.inf, 1.0)])
def test_an_empty_box_is_named(upper):
    with pytest.raises(ValueError, match="grid: the box from"), np.errstate(invalid="ignore"):
        Lattice.around((0.0, 0.0), upper, 0.1)


def test_windows_of_one_grid_merge_as_the_whole_grids_do(rng):
    lattice = grid.Lattice((-1.0, 0.5), 0.05, (40, 30))
    whole = []
    for low, high in (((2, 3), (20, 15)), ((12, 8), (38, 29))):
        log_odds = np.zeros(lattice.shape, np.float32)
        log_odds[low[0] : high[0], low[1] : high[1]] = rng.normal(0, 1, (high[0] - low[0], high[1] - low[1]))
        whole.append(grid.Occupancy(lattice, log_odds))
    merged = whole[0].merged(whole[1])
    windows = [o.cropped(np.zeros((0, 2)), 0.0) for o in whole]
    joined = windows[0].merged(windows[1])
    assert joined.lattice.shape == (36, 26)
    at = joined.lattice.at(joined.log_odds, lattice.centers().reshape(-1, 2), 0.0).reshape(lattice.shape)
    assert np.allclose(at, merged.log_odds, atol=1e-6)
