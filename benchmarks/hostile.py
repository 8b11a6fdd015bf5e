"""A million hostile datagrams: what it takes to reject one, and that nothing comes of any.

Each kind is made from real datagrams of the protocol, of the sizes that it sends. A datagram is
rejected when it is counted under the reason that it deserves; the robot's state must be the same
object as before. The limit is 5 µs a datagram.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from random import Random

from harness import LIMITS, Column, Report, main, note
from koord.runtime.chaos.storm import Journal, StormRobot, proposal_of
from koord.runtime.node import Peer
from koord.runtime.proposals import Decision
from koord.runtime.protocol.messages import (
    Acknowledge,
    Committed,
    Decide,
    LogEntry,
    Message,
    Propose,
)
from koord.runtime.protocol.setup import Setup, Timing, decided
from koord.runtime.protocol.state import fresh
from koord.runtime.wire.codec import Channel, DatagramWriter
from koord.runtime.wire.frames import Drop, run_key
from tests.runtime.hub import Hub

ROBOTS = 16
LIMIT_S = 5e-6
SHARED_KEY = b"the key of all robots"
KEY = run_key(SHARED_KEY, b"a run")

#: Under which reasons a datagram of each kind may be counted.
KINDS: dict[str, tuple[Drop, ...]] = {
    "random": (Drop.SIZE, Drop.NOT_KOORD, Drop.VERSION, Drop.STRANGER),
    "truncated": (Drop.SIZE, Drop.FORGED),
    "bit flipped": (Drop.FORGED, Drop.NOT_KOORD, Drop.VERSION, Drop.STRANGER),
    "replayed": (Drop.REPLAYED,),
    "wrong key": (Drop.FORGED,),
    "of another run": (Drop.FORGED,),
    "from a stranger": (Drop.STRANGER,),
}


def real(key: bytes, pid: int, many: int) -> list[bytes]:
    """Datagrams as robots send them."""
    writer = DatagramWriter(Channel(key, ROBOTS, pid))
    decision: Decision = decided(3, [proposal_of(i, 3) for i in range(ROBOTS)])
    messages: list[Message] = [
        Propose(proposal_of(1, 3)),
        Decide(0, LogEntry(decision, bytes(16))),
        Acknowledge(0, 3, bytes(16)),
        Committed(0, 3, bytes(16), 0.1),
    ]
    made: list[bytes] = []
    while len(made) < many:
        for message in messages:
            made += writer.datagrams(0, 3, message)
    return made[:many]


def hostile(kind: str, many: int) -> Iterator[bytes]:
    """Datagrams of a kind; made outside of what is measured."""
    random = Random(kind)
    good = real(KEY, 1, 64)
    for k in range(many):
        one = good[k % len(good)]
        match kind:
            case "random":
                yield random.randbytes(random.randrange(1401))
            case "truncated":
                yield one[: random.randrange(len(one))]
            case "bit flipped":
                changed = bytearray(one)
                bit = random.randrange(len(one) * 8)
                changed[bit // 8] ^= 1 << bit % 8
                yield bytes(changed)
            case _:
                yield one


def prepared(kind: str, many: int) -> list[bytes]:
    match kind:
        case "wrong key":
            return real(run_key(b"another key altogether", b"a run"), 1, many)
        case "of another run":
            return real(run_key(SHARED_KEY, b"another run"), 1, many)
        case "from a stranger":
            return real(KEY, 10 * ROBOTS - 1, many)
        case _:
            return list(hostile(kind, many))


def attacked(report: Report, kind: str, many: int) -> float:
    """CPU seconds that a datagram takes."""
    hub = Hub(ROBOTS)
    setup = Setup(ROBOTS, Timing.of(0.1, ROBOTS))
    robot = StormRobot(0, Journal())
    channel = Channel(KEY, ROBOTS, 0)
    peer = Peer(channel, setup, fresh(setup, 0), robot, hub.transport(0), float)
    peer.start()
    peer.turn(0.0)  # its own proposal
    if kind == "replayed":
        hub.inboxes[0].extend(real(KEY, 1, 64))
        peer.turn(0.0)
        peer.drops.clear()
    before = peer.node.state
    taken = 0.0
    left = many
    while left:
        part = min(left, 20_000)
        hub.inboxes[0].extend(prepared(kind, part))
        begun = time.process_time()
        peer.turn(0.0)
        taken += time.process_time() - begun
        left -= part
    counted = {drop: n for drop, n in peer.drops.items() if n}
    report.expect(sum(counted.values()) == many, f"{kind}: {counted} of {many}")
    report.expect(set(counted) <= set(KINDS[kind]), f"{kind}: counted as {counted}")
    report.expect(peer.node.state is before, f"{kind}: the state has changed")
    return taken / many


def benchmark(report: Report) -> None:
    many = 3_000 if report.quick else 1_000_000 // len(KINDS) + 1
    table = report.table(
        f"Hostile datagrams, {many:,} of each kind",
        Column("kind", "kind"),
        Column("us", "µs each"),
        *LIMITS,
    )
    for kind in KINDS:
        note(kind)
        each_s = attacked(report, kind, many)
        table.rows.append(
            {
                "kind": kind,
                "us": round(each_s * 1e6, 3),
                "limit": "5 µs",
                "met": each_s <= LIMIT_S,
            }
        )


if __name__ == "__main__":
    sys.exit(main("hostile", __doc__ or "", benchmark))
