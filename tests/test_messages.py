import base64
import contextlib
import dataclasses
import json
import struct
import tracemalloc
import zlib

import networkx as nx
import numpy as np
import pytest
import torch

from mannbv import consensus, grid, messages, network, splats
from mannbv.messages import Copies, Grid, Ledger, Mailbox, Plan, Profile, Splats, Suggestion

CODECS = ["json", "binary"]


def random_map(rng, n, dim):
    widths = (dim, dim, 2 if dim == 2 else 4)
    return splats.SplatMap(
        *(torch.tensor(rng.normal(size=(n, k)), dtype=torch.float32) for k in widths),
        torch.tensor(rng.normal(size=n), dtype=torch.float32),
        torch.tensor(rng.uniform(size=(n, 3)), dtype=torch.float32),
    )


def one_of_each(rng, dim=2, n=7):
    """A message of every kind, with awkward numbers."""
    ids = rng.permutation(2**31 - 1 - np.arange(n)).astype(np.int32)
    return [
        Plan(3, 12, rng.normal(size=dim), -np.pi, rng.normal(size=(11, dim)).astype(np.float32)),
        Suggestion(3, 12, target=0, yaw=0.1 + 0.2, gain=1e-300, announced_gain=1 / 3, largest=2.5e7),
        Suggestion(3, 12, 0, 0.5, 7.0, 6.0, 7.0, gradient=rng.normal(size=dim * (dim + 1) // 2)),
        Copies(3, 12, round=29, offsets=np.array([0.0, -0.0, 1 / 3, 1e-17, -123456.789])),
        Profile(3, 12, 1, *reversed(consensus.quantise(rng.uniform(size=90)))),
        Splats(3, 12, random_map(rng, n, dim), ids, rng.exponential(size=(n, 9 if dim == 2 else 13))),
        Grid(3, 12, [-1.5, 2.0], 0.05, rng.integers(-1, 2, (13, 22))),
    ]


def leaves(message):
    """Every field as plain arrays, splat maps taken apart."""
    for f in dataclasses.fields(message):
        value = getattr(message, f.name)
        parts = value.tensors() if isinstance(value, splats.SplatMap) else (value,)
        for part in parts:
            yield f.name, np.asarray(part)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("codec", CODECS)
@pytest.mark.parametrize("kind", range(7))
def test_every_kind_comes_back_to_the_bit(kind, codec, dim):
    sent = one_of_each(np.random.default_rng(0), dim)[kind]
    got = messages.decode(messages.encode(sent, codec))
    assert type(got) is type(sent)
    for (name, before), (_, after) in zip(leaves(sent), leaves(got), strict=True):
        assert before.dtype == after.dtype, name
        assert before.shape == after.shape, name
        assert before.tobytes() == after.tobytes(), name


@pytest.mark.parametrize("codec", CODECS)
def test_an_empty_map_and_a_map_without_extras_travel(codec):
    for sent in (splats.SplatMap.empty(3), random_map(np.random.default_rng(1), 4, 2)):
        got = messages.decode(messages.encode(Splats(0, 0, sent), codec))
        assert got.splats.dim == sent.dim
        assert got.ids.tolist() == list(range(sent.n_splats))
        assert got.prior.shape == (sent.n_splats, 0)
        torch.testing.assert_close(got.splats.means, sent.means, rtol=0, atol=0)


def test_what_arrives_shares_nothing_with_what_was_sent():
    path, sent = np.zeros((2, 2)), random_map(np.random.default_rng(2), 3, 2)
    plan, whole = Plan(0, 0, [0, 0], 0, path), Splats(0, 0, sent)
    got = messages.decode(messages.encode(whole, "binary"))
    path += 1
    got.splats.means.add_(1)
    got.prior.add_(1)
    assert plan.path.max() == 0
    torch.testing.assert_close(got.splats.means - 1, sent.means)


def test_json_is_the_plain_object_it_looks_like():
    sent = Plan(1, 2, [0.1, 0.25], 3.0, [[0.1, 0.7]])
    assert json.loads(messages.encode(sent, "json")) == {
        "kind": "Plan", "robot": 1, "cycle": 2, "position": [0.1, 0.25], "yaw": 3.0, "path": [[0.1, 0.7]],
    }  # fmt: skip
    whole = Splats(0, 0, random_map(np.random.default_rng(3), 2, 2))
    rows = json.loads(messages.encode(whole, "json"))["splats"]
    assert rows["shape"] == [2, 10]
    means = np.frombuffer(base64.b64decode(rows["base64"]), "<f4").reshape(2, 10)[:, :2]
    np.testing.assert_array_equal(means, whole.splats.means.numpy())


def test_the_binary_layout_is_the_documented_one():
    data = messages.encode(Plan(1, 2, [0.5, 0.25], 3.0, [[1.5, 2.5], [3.5, 4.5]]), "binary")
    assert data == b"mb\x01\x00" + struct.pack("<HII2ddII4f", 1, 2, 2, 0.5, 0.25, 3.0, 2, 2, 1.5, 2.5, 3.5, 4.5)
    data = messages.encode(Copies(1, 2, 3, [0.5, -0.5]), "binary")
    assert data == b"mb\x01\x02" + struct.pack("<HIII2d", 1, 2, 3, 2, 0.5, -0.5)
    states = np.array([[-1, 0, 1], [1, 1, 0]], np.int8)
    packed = zlib.compress(bytes([0b10_10_01_00, 0b01_10]), 6)
    data = messages.encode(Grid(1, 2, [0, 0], 0.05, states), "binary")
    assert data.endswith(struct.pack("<III", 2, 3, len(packed)) + packed)


@pytest.mark.parametrize("codec", CODECS)
def test_a_gradient_is_written_only_where_there_is_one(codec):
    plain, more = Suggestion(1, 2, 0, 0.5, 3.0, 2.0, 3.0), Suggestion(1, 2, 0, 0.5, 3.0, 2.0, 3.0, [1.5, -2.0, 0.25])
    sizes = {"json": (108, 108 + len(',"gradient":[1.5,-2.0,0.25]')), "binary": (44, 44 + 4 + 3 * 8)}[codec]
    data = [messages.encode(message, codec) for message in (plain, more)]
    assert tuple(map(len, data)) == sizes
    assert messages.decode(data[0]).gradient.tolist() == []
    assert messages.decode(data[1]).gradient.tolist() == [1.5, -2.0, 0.25]
    for end in range(len(data[1])):  # the flag of the longer form stands at its beginning
        with pytest.raises(ValueError, match="that are no message"):
            messages.decode(data[1][:end])


@pytest.mark.parametrize("dim", [2, 3])
def test_a_splat_costs_its_float32_numbers(dim):
    rng = np.random.default_rng(4)

    def size(n, p):
        return len(messages.encode(Splats(0, 0, random_map(rng, n, dim), prior=np.zeros((n, p))), "binary"))

    per_splat = messages.centralized_bytes([1], dim)
    assert per_splat == {2: 40, 3: 56}[dim]
    assert size(101, 0) - size(100, 0) == per_splat + 4  # and an id
    assert size(101, 9) - size(100, 9) == per_splat + 4 + 36


def test_what_the_distributed_strategy_sends_has_one_size_whatever_the_numbers():
    rng, sizes = np.random.default_rng(5), {}
    for scale in (1e-6, 1.0, 1e6):
        plan = Plan(0, 0, rng.normal(size=2) * scale, 0.1, rng.normal(size=(20, 2)) * scale)
        said = Suggestion(1, 9, 0, *(rng.normal(size=3) * scale))
        for message in (plan, said, Copies(0, 3, 1, rng.normal(size=5) * scale)):
            sizes.setdefault(type(message), set()).add(len(messages.encode(message, "binary")))
    assert all(len(found) == 1 for found in sizes.values())
    assert len(messages.encode(Profile(0, 0, 1, 0.5, np.zeros(36, np.uint8)), "binary")) == 36 + 4 + 16


def test_a_grid_is_packed_and_squeezed():
    lattice = grid.Lattice((0.5, -1.0), 0.05, (200, 300))
    log_odds = np.zeros(lattice.shape, np.float32)
    log_odds[50:120, 60:200], log_odds[50:120, 60] = -1, 2
    sent = Grid.of(0, 1, grid.Occupancy(lattice, log_odds))
    data = messages.encode(sent, "binary")
    assert len(data) < 60_000 / 4 / 10
    got = messages.decode(data)
    assert got.lattice == lattice
    np.testing.assert_array_equal(got.state, grid.Occupancy(lattice, log_odds).state)


def as_json(**fields):
    return json.dumps(fields).encode()


GOOD = {"kind": "Copies", "robot": 0, "cycle": 0, "round": 0, "offsets": [0.0]}
SPLATS = {"kind": "Splats", "robot": 0, "cycle": 0, "whole": 0, "ids": {"shape": [0], "base64": ""}}
SPLATS["prior"] = {"shape": [0, 0], "base64": ""}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "0 B that are no message"),
        (b"\x80\x04\x95pickle", "no message"),
        (b"[" * 100_000, "no message"),
        (b"nonsense", "no message"),
        (b"[1, 2]", "whose kind is one of Plan"),
        (as_json(kind="os.system"), "whose kind is one of Plan"),
        (as_json(kind=["Plan"]), "whose kind is one of Plan"),
        (as_json(kind="Copies", robot=0), "has the fields robot, cycle, round, offsets"),
        (as_json(**GOOD, extra=1), "got robot, cycle, round, offsets, extra"),
        (as_json(**GOOD | {"robot": -1}), "robot must lie between 0 and 65535, got -1"),
        (as_json(**GOOD | {"robot": 10**40}), "robot must be one whole number"),
        (as_json(**GOOD | {"robot": True}), "robot must be one whole number"),
        (as_json(**GOOD | {"robot": 1.5}), "robot must be one whole number"),
        (as_json(**GOOD | {"offsets": [0.0, "1"]}), "offsets must be numbers along 1 axes"),
        (as_json(**GOOD | {"offsets": [[0.0]]}), "along 1 axes"),
        (as_json(**GOOD | {"offsets": [[0.0], 1.0]}), "no message"),
        (as_json(**GOOD | {"offsets": [float("nan")]}), "NaN is no finite number"),
        (json.dumps(GOOD).replace("[0.0]", "[1e999]").encode(), "finite"),
        (as_json(**SPLATS, splats={"shape": [0, 11], "base64": ""}), "10 or 14 numbers, got 11"),
        (as_json(**SPLATS, splats={"shape": [10**9, 14], "base64": "AAAA"}), "does not fit 3 B"),
        (as_json(**SPLATS, splats={"shape": [-1, -14], "base64": ""}), "shape of 2 lengths"),
        (as_json(**SPLATS, splats={"shape": [1, 10], "base64": "A" * 52 + "===="}), "no message"),
        (as_json(**SPLATS, splats=[[0.0] * 10]), "no message"),
        (b"mb\x01", "unknown kind"),
        (b"mb\x01\x63", "unknown kind"),
        (b"mb\x02\x00" + bytes(60), "no message"),
    ],
)
def test_junk_is_refused_in_one_line(data, words):
    with pytest.raises(ValueError, match=words) as error:
        messages.decode(data)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("codec", CODECS)
@pytest.mark.parametrize("kind", range(7))
def test_no_truncation_and_no_flipped_byte_does_more_than_raise_value_error(kind, codec):
    rng = np.random.default_rng(6)
    data = messages.encode(one_of_each(rng, n=2)[kind], codec)
    for cut in range(0, len(data), max(1, len(data) // 60)):
        with pytest.raises(ValueError, match="no message"):
            messages.decode(data[:cut])
    with pytest.raises(ValueError, match="no message"):
        messages.decode(data + b"\0")
    for at in rng.integers(0, len(data), 60):
        broken = bytearray(data)
        broken[at] ^= 1 << rng.integers(8)
        with contextlib.suppress(ValueError):
            got = messages.decode(broken)  # a number may have changed, and still be a sound one
            assert isinstance(got, messages.Message)


def test_promised_sizes_are_checked_before_memory_is_taken():
    head = b"mb\x01\x02" + struct.pack("<HII", 0, 0, 0)
    with pytest.raises(ValueError, match="offsets needs 34359738360 B, 8 are left"):
        messages.decode(head + struct.pack("<I", 2**32 - 1) + bytes(8))
    bomb = zlib.compress(bytes(30_000_000))
    start = b"mb\x01\x05" + struct.pack("<HII2dd", 0, 0, 2, 0.0, 0.0, 0.05)
    for shape, body in [
        ((2**31, 2**31), zlib.compress(b"")),
        ((8000, 8000), zlib.compress(bytes(100))),
        ((10, 10), bomb),
        ((10, 10), zlib.compress(bytes(25))[:-2]),
        ((10, 10), zlib.compress(bytes(25)) + b"x"),
        ((10, 10), b"no stream"),
        ((10, 10), zlib.compress(b"\xff" * 25)),  # 3 is no state
    ]:
        with pytest.raises(ValueError, match="no message"):
            messages.decode(start + struct.pack("<III", *shape, len(body)) + body)
    tracemalloc.start()
    with pytest.raises(ValueError, match="does not hold"):
        messages.decode(start + struct.pack("<III", 10, 10, len(bomb)) + bomb)
    with pytest.raises(ValueError, match="larger than"):
        messages.decode(start + struct.pack("<III", 30_000, 4000, len(bomb)) + bomb)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1_000_000
    good = zlib.compress(bytes(25))
    assert messages.decode(start + struct.pack("<III", 10, 10, len(good)) + good).state.shape == (10, 10)


def test_senders_are_checked_too(unchecked):
    rng = np.random.default_rng(7)
    dirty = random_map(rng, 2, 2)
    dirty.means[0, 0] = torch.inf
    for make, words in [
        (lambda: Plan(0, 0, [0.0, 0.0], np.nan, np.zeros((2, 2))), "plan message: yaw must be finite"),
        (lambda: Plan(0, 0, [0.0, 0.0], 0.0, np.zeros((2, 3))), "path"),
        (lambda: Plan(0, 0, [0.0, 0.0], 0.0, np.zeros((0, 2))), "path"),
        (lambda: Plan(0, 0, [0.0, 0.0], 0.0, np.full((1, 2), 1e300)), "path must be finite numbers that fit float32"),
        (lambda: Plan(70_000, 0, [0.0, 0.0], 0.0, np.zeros((2, 2))), "robot must lie between 0 and 65535"),
        (lambda: Copies(0, 0, 0, [np.inf]), "copies message: offsets must be finite"),
        (lambda: Profile(0, 0, 0, 1.0, [0.5, 300]), "levels must be finite numbers that fit uint8"),
        (lambda: Profile(0, 0, 0, 1e300, [1, 2]), "height must be finite"),
        (lambda: Splats(0, 0, np.zeros((2, 10))), "must be a SplatMap"),
        (lambda: Splats(0, 0, dirty), "splats must be finite"),
        (lambda: Splats(0, 0, random_map(rng, 2, 2), [0]), "2 splats need as many ids"),
        (lambda: Splats(0, 0, random_map(rng, 2, 2), [0, 2**40]), "ids must be finite numbers that fit int32"),
        (lambda: Grid(0, 0, [0, 0], 0.0, np.zeros((2, 2), int)), "positive cell"),
        (lambda: Grid(0, 0, [0, 0], 0.1, np.full((2, 2), 2)), "states must be"),
        (lambda: messages.encode(Copies(0, 0, 0, [0.0]), "pickle"), "no codec is called 'pickle'"),
        (lambda: messages.decode("text"), "expected bytes, got str"),
        (lambda: Mailbox("xml"), "no codec is called 'xml'"),
    ]:
        with pytest.raises(ValueError, match=words) as error:
            make()
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("codec", CODECS)
def test_the_post_delivers_in_order_and_the_ledger_holds_every_byte(codec):
    post = Mailbox(codec, Ledger(), network.build("line", 3))
    plan, said = Plan(0, 4, [0, 0], 0, np.zeros((2, 2))), Suggestion(0, 4, 1, 0.5, 1.0, 0.5)
    sizes = [post.send(0, 1, plan), post.send(0, 1, said), post.send(1, 2, plan, cycle=5)]
    assert sizes == [len(messages.encode(m, codec)) for m in (plan, said, plan)]
    ((sender, got),) = post.collect(1, Suggestion)
    assert sender == 0
    assert got is not said
    assert got.yaw == 0.5
    assert [type(m) for _, m in post.collect(1)] == [Plan]
    assert post.collect(1) == []
    ((sender, relayed),) = post.collect(2)
    assert (sender, relayed.robot) == (1, 0)
    ledger = post.ledger
    assert ledger.total() == sum(sizes)
    assert ledger.messages() == 3
    assert ledger.by_link() == {(0, 1): sizes[0] + sizes[1], (1, 2): sizes[2]}
    assert ledger.by_kind() == {"Plan": sizes[0] + sizes[2], "Suggestion": sizes[1]}
    assert ledger.by_cycle() == {4: sizes[0] + sizes[1], 5: sizes[2]}
    assert ledger.sent_by(1) == ledger.received_by(2) == sizes[2]
    assert ledger.sent_by(2) == 0
    assert Ledger.from_json(ledger.to_json()) == ledger
    for receiver in (0, 2):
        with pytest.raises(ValueError, match=f"robot 0 has no link to robot {receiver}"):
            post.send(0, receiver, plan)
    for text in ("{", "[[1, 2]]", "3", '[[0, 1, 0, "Plan", 0, 1, "many"]]'):
        with pytest.raises(ValueError, match=r"not written by Ledger\.to_json"):
            Ledger.from_json(text)


def test_a_relayed_message_is_counted_on_every_hop_and_kept_by_the_last():
    post = Mailbox("binary", network=network.build("line", 4))
    message = Copies(3, 0, 0, [0.25])
    post.send(2, 1, Copies(2, 0, 0, [0.5]))
    post.relay([3, 2, 1, 0], message)
    size = len(messages.encode(message, "binary"))
    assert post.ledger.by_link() == {(3, 2): size, (2, 1): 2 * size, (1, 0): size}
    assert post.collect(2) == []
    assert [m.offsets.tolist() for _, m in post.collect(1)] == [[0.5]]
    ((sender, got),) = post.collect(0)
    assert (sender, got.robot, got.offsets.tolist()) == (1, 3, [0.25])
    post.lost = lambda sender, receiver, message: receiver == 1
    post.relay([3, 2, 1, 0], message)  # nobody hands on what it never got
    assert all(post.collect(robot) == [] for robot in range(4))
    assert post.ledger.by_link() == {(3, 2): 2 * size, (2, 1): 3 * size, (1, 0): size}


def test_a_lost_message_costs_its_bytes_and_does_not_arrive():
    post = Mailbox("binary", lost=lambda sender, receiver, message: receiver == 1)
    message = Copies(0, 0, 0, [0.0])
    size = post.send(0, 1, message) + post.send(0, 2, message)
    assert post.collect(1) == []
    assert len(post.collect(2)) == 1
    assert post.ledger.total() == size


def flood(post, graph, outgoing):
    """Every robot's message relayed to all others."""
    held = [{i: message} for i, message in enumerate(outgoing)]
    for triples in network.hops(graph):
        for sender, receiver, origin in triples:
            post.send(sender, receiver, held[sender][origin])
        for robot in graph:
            held[robot] |= {message.robot: message for _, message in post.collect(robot)}
    return held


@pytest.mark.parametrize("graph", ["complete", "star", "line"])
def test_paper_totals_do_not_depend_on_the_graph(graph):
    rng, n = np.random.default_rng(8), 4
    graph, post = network.build(graph, n), Mailbox("binary")
    maps = [Splats(i, 0, random_map(rng, 10 * (i + 1), 2)) for i in range(n)]
    held = flood(post, graph, maps)
    assert all(set(box) == set(range(n)) for box in held)
    whole = [len(messages.encode(m, "binary")) for m in maps]
    assert post.ledger.paper_total("centralized") == sum(whole)
    assert post.ledger.total() == (n - 1) * sum(whole)
    flood(post, graph, [Plan(i, 0, [0, 0], 0, np.zeros((2, 2))) for i in range(n)])
    assert post.ledger.paper_total("centralized") == sum(whole)
    assert post.ledger.paper_total("distributed") == post.ledger.total() > (n - 1) * sum(whole)


def test_limited_sharing_counts_every_ordered_pair():
    rng, n = np.random.default_rng(9), 3
    post, guests = Mailbox("binary"), random_map(rng, 400, 3)
    for i, j in network.build("complete", n).to_directed().edges:
        post.send(i, j, Splats(i, 0, guests))
        post.send(i, j, Plan(i, 0, [0, 0], 0, np.zeros((2, 2))))
    each = len(messages.encode(Splats(0, 0, guests), "binary"))
    assert post.ledger.paper_total("limited") == n * (n - 1) * each
    relayed = Mailbox("binary", network=network.build("line", n))
    for i, j in post.ledger.by_link():
        relayed.relay(nx.shortest_path(relayed.network, i, j), Splats(i, 0, guests))
    assert relayed.ledger.paper_total("limited") == n * (n - 1) * each
    assert relayed.ledger.total() == (n * (n - 1) + 2) * each


TWO_AGENTS = {(34_911, 26_800): 3.26, (62_634, 60_898): 6.59, (161_396, 148_005): 16.50, (190_716, 189_123): 20.28}
FIVE_AGENTS = {
    (56_741, 51_055, 30_174, 50_368, 22_909): 11.19,
    (64_612, 55_718, 34_548, 61_713, 37_310): 13.55,
}


@pytest.mark.parametrize(("counts", "printed"), [*TWO_AGENTS.items(), *FIVE_AGENTS.items()])
def test_the_papers_centralized_tables(counts, printed):
    n_bytes = messages.centralized_bytes(counts)
    assert n_bytes / 2**20 == pytest.approx(printed, rel=0.012)
    assert n_bytes / 1e6 != pytest.approx(printed, rel=0.012)  # not in units of 10⁶ B
    assert n_bytes * 2 / 2**20 != pytest.approx(printed, rel=0.012)  # and not to each other robot


def test_the_papers_limited_sharing_table_and_its_exception():
    for n_robots, printed in {2: 0.050, 5: 0.50, 7: 1.050}.items():
        assert messages.limited_sharing_bytes(n_robots) == pytest.approx(printed * 1e6, rel=1e-12)
    with pytest.raises(ValueError, match="at least one robot"):
        messages.limited_sharing_bytes(0)
    assert messages.limited_sharing_bytes(10) == 2_250_000  # the table prints 2.150 MB, against its other rows


def test_the_ideal_exchange_is_a_pose_and_a_scalar():
    assert messages.ideal_exchange_bytes() == len(np.eye(4).tobytes() + struct.pack("<d", 1.0)) == 136


def test_agreement_by_real_messages_equals_agreement_in_memory():
    rng, n = np.random.default_rng(10), 4
    graph, announced = network.build("ring", n), rng.uniform(-3, 3, n)
    objectives = rng.uniform(size=(n, n, 24))
    scale, post = consensus.scale_of(objectives), Mailbox("json", network=nx.Graph(graph))
    states = [consensus.start(i, network.neighbours(graph, i), announced, objectives[i], scale=scale) for i in range(n)]
    for t in range(15):
        for state in states:
            for j in state.neighbours:
                post.send(state.robot, j, Copies(state.robot, 0, t, state.copies))
        inboxes = [{sender: m.offsets for sender, m in post.collect(i, Copies)} for i in range(n)]
        states = [consensus.step(state, inbox) for state, inbox in zip(states, inboxes, strict=True)]
    trace = consensus.solve(objectives, graph, announced, rounds=15, tolerance=0)
    np.testing.assert_array_equal([s.yaws for s in states], trace[-1].copies)
    assert post.ledger.messages() == 15 * 2 * n
    assert set(post.ledger.by_kind()) == {"Copies"}
