"""Counting bytes: an account of what was really serialised, the mailbox that keeps it, and the paper's formulas."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import networkx as nx

from mannbv import archive
from mannbv.messages.codec import CODECS, decode, encode
from mannbv.messages.kinds import Message
from mannbv.network import hops

Letter = tuple[int | None, Message]  # to a robot, or to everybody
Entry = tuple[int, int, int, str, int]  # sender, receiver, origin, kind, cycle

SPLAT_BYTES = {2: 40, 3: 56}  # float32: 10 numbers in flatland, 14 in space
GUEST_BYTES = 25_000  # the paper's size of one limited-sharing message


def centralized_bytes(splat_counts: Iterable[int], dim: int = 3) -> int:
    """Bytes of one uplink of every robot's whole map, at 56 B a splat (40 B in flatland).

    The paper's Tables II and V print these in units of 2²⁰ B and call them MB.
    """
    return sum(int(n) for n in splat_counts) * SPLAT_BYTES[dim]


def limited_sharing_bytes(n_robots: int) -> int:
    """Bytes of one limited-sharing exchange: N(N−1) ordered pairs, 25 000 B each.

    The paper's Table VI prints these in units of 10⁶ B: 0.05, 0.5 and 1.05 MB for 2, 5 and 7 robots. For ten it prints
    2.15 where the formula, and the other rows, give 2.25.
    """
    if n_robots < 1:
        raise ValueError(f"messages: a team needs at least one robot, got {n_robots}")
    return int(n_robots) * (int(n_robots) - 1) * GUEST_BYTES


def ideal_exchange_bytes() -> int:
    """The paper's ideal exchange of the distributed method: 17 float64, a 4×4 pose and one scalar, 136 B."""
    return (4 * 4 + 1) * 8


@dataclass
class Ledger:
    """Messages and bytes [B] on every link, by kind and cycle; rows are only ever added to.

    `rows` maps (sender, receiver, origin, kind, cycle) to [messages, bytes]; origin differs from sender in a relay.
    """

    rows: dict[Entry, list[int]] = field(default_factory=dict)

    def copy(self) -> "Ledger":
        """An account of its own, with the same rows."""
        return Ledger({key: list(row) for key, row in self.rows.items()})

    def sent(self, sender: int, receiver: int, kind: str, cycle: int, n_bytes: int, origin: int | None = None) -> None:
        """Enter one message of `n_bytes` = len(of the really serialised bytes)."""
        key = (int(sender), int(receiver), int(sender if origin is None else origin), kind, int(cycle))
        row = self.rows.setdefault(key, [0, 0])
        row[0] += 1
        row[1] += int(n_bytes)

    def _sums(self, part) -> dict:
        sums = {}
        for key, (_, n_bytes) in self.rows.items():
            sums[part(key)] = sums.get(part(key), 0) + n_bytes
        return dict(sorted(sums.items()))

    def total(self) -> int:
        return sum(n_bytes for _, n_bytes in self.rows.values())

    def messages(self) -> int:
        """Number of messages."""
        return sum(count for count, _ in self.rows.values())

    def by_link(self) -> dict[tuple[int, int], int]:
        """(sender, receiver) → bytes."""
        return self._sums(lambda key: key[:2])

    def by_kind(self) -> dict[str, int]:
        return self._sums(lambda key: key[3])

    def by_cycle(self) -> dict[int, int]:
        return self._sums(lambda key: key[4])

    def sent_by(self, robot: int) -> int:
        return self._sums(lambda key: key[0]).get(robot, 0)

    def received_by(self, robot: int) -> int:
        return self._sums(lambda key: key[1]).get(robot, 0)

    def paper_total(self, strategy: str) -> int:
        """Bytes as the paper counts them: centralized, one uplink of each map a cycle (whoever else it went to, and
        without plans or grids); limited, the splats of all ordered pairs, once each however many hops they took;
        otherwise everything.
        """
        if strategy not in ("centralized", "limited"):
            return self.total()
        firsts = {}  # (origin, cycle) → bytes of splats on each of the origin's own links
        for (sender, _, origin, kind, cycle), (_, n_bytes) in self.rows.items():
            if kind == "Splats" and sender == origin:
                firsts.setdefault((origin, cycle), []).append(n_bytes)
        return sum(max(sizes) if strategy == "centralized" else sum(sizes) for sizes in firsts.values())

    def to_json(self) -> str:
        return archive.to_json([[*key, *row] for key, row in sorted(self.rows.items())])

    @staticmethod
    def from_json(text: str) -> "Ledger":
        """Raises ValueError for anything that `to_json` did not write."""
        try:
            rows = {
                (int(s), int(r), int(o), str(k), int(c)): [int(m), int(b)]
                for s, r, o, k, c, m, b in archive.from_json(text)
            }
        except (ValueError, TypeError) as error:
            raise ValueError(f"ledger: not written by Ledger.to_json ({error})") from None
        return Ledger(rows)


class Mailbox:
    """A mailbox for robots in one process. What arrives has been through bytes, and every byte is in the ledger.

    It goes on from the account of a `ledger`, which stays as it is. network: where given, messages cross only its
    links. lost(sender, receiver, message) → True drops a message, whose
    bytes have been sent all the same.
    """

    def __init__(
        self,
        codec: str = "json",
        ledger: Ledger | None = None,
        network: nx.Graph | None = None,
        lost: Callable[[int, int, Message], bool] | None = None,
    ):
        if codec not in CODECS:
            raise ValueError(f"messages: no codec is called '{codec}'; choose one of {', '.join(CODECS)}")
        self.codec, self.network, self.lost = codec, network, lost
        self.ledger = Ledger() if ledger is None else ledger.copy()
        self._boxes: dict[int, list[tuple[int, Message]]] = {}
        self._written: tuple[Message, bytes] | None = None

    def send(self, sender: int, receiver: int, message: Message, cycle: int | None = None) -> int:
        """Write, count and deliver a message; returns its bytes. `cycle` is the message's own by default.

        Raises ValueError where the two robots are not linked, or are the same.
        """
        if sender == receiver or (self.network is not None and not self.network.has_edge(sender, receiver)):
            raise ValueError(f"messages: robot {sender} has no link to robot {receiver}")
        size, arrived = self.carried(message)
        kind, cycle = type(message).__name__, message.cycle if cycle is None else cycle
        self.ledger.sent(sender, receiver, kind, cycle, size, message.robot)
        if self.lost is None or not self.lost(sender, receiver, message):
            self._boxes.setdefault(receiver, []).append((sender, arrived))
        return size

    def carried(self, message: Message) -> tuple[int, Message]:
        """The bytes that a message is, and the message that they are read as."""
        if self._written is None or self._written[0] is not message:  # to several robots it is written once
            self._written = message, encode(message, self.codec)
        return len(self._written[1]), decode(self._written[1])

    def relay(self, way: Sequence[int], message: Message, cycle: int | None = None) -> None:
        """Send a message along `way`, robots from the first sender to the receiver; those between only pass it on."""
        for sender, receiver in pairwise(way):
            waiting = len(self._boxes.get(receiver, []))
            self.send(sender, receiver, message, cycle)
            if len(self._boxes.get(receiver, [])) == waiting:
                return  # lost on the way
            if receiver != way[-1]:
                message = self._boxes[receiver].pop()[1]

    def collect(self, receiver: int, kind: type = Message) -> list[tuple[int, Message]]:
        """Takes out what arrived for `receiver`, as (sender, message) in order; of one kind only, if asked."""
        box = self._boxes.get(receiver, [])
        self._boxes[receiver] = [item for item in box if not isinstance(item[1], kind)]
        return [item for item in box if isinstance(item[1], kind)]

    def deliver(self, said: Mapping[int, Iterable[Letter]], graph: nx.Graph) -> dict[int, list[Message]]:
        """What every robot hears, in order, when all have spoken: said, robot → its letters; over the links of a graph.

        A message to one robot takes a shortest way; one to everybody goes hop by hop, so that each robot hears it once.
        Robots on the way pass on what has arrived.
        """
        spread: dict[int, dict[int, list[Message]]] = {robot: {} for robot in said}
        for robot, letters in said.items():
            for receiver, message in letters:
                if receiver is None:
                    spread[robot].setdefault(robot, []).append(message)
                else:
                    near = graph.has_edge(robot, receiver)
                    self.relay([robot, receiver] if near else nx.shortest_path(graph, robot, receiver), message)
        heard = {robot: [message for _, message in self.collect(robot)] for robot in said}
        for hop in hops(graph) if any(spread.values()) else ():
            for sender, receiver, origin in hop:
                for message in spread[sender].get(origin, ()):
                    self.send(sender, receiver, message)
            for robot in said:
                for _, message in self.collect(robot):
                    spread[robot].setdefault(message.robot, []).append(message)
                    heard[robot].append(message)
        return heard
