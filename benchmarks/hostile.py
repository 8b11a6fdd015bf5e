"""A million hostile datagrams: what it takes to reject one, and that nothing comes of any.

Each kind is made from real datagrams of the protocol, of the sizes that it sends. A datagram is
rejected when it is counted under the reason that it deserves; the robot's state must be the same
object as before. The limit is 5 µs a datagram, and 10 µs where robots encrypt. What robots say to
each other costs what the last table has.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from importlib.util import find_spec
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
from koord.runtime.wire.codec import Channel, DatagramReader, DatagramWriter, HandshakeReader
from koord.runtime.wire.frames import Drop, fleet_key, run_key
from tests.runtime.hub import Hub

ROBOTS = 16
#: Where datagrams are authenticated, and where they are encrypted as well.
LIMITS_S = {False: 5e-6, True: 10e-6}
SHARED_KEY = b"the key of all robots"
KEY = run_key(SHARED_KEY, b"a run")

#: Under which reasons a datagram of each kind may be counted.
KINDS: dict[str, tuple[Drop, ...]] = {
    "random": (Drop.SIZE, Drop.NOT_KOORD, Drop.VERSION, Drop.STRANGER),
    "truncated": (Drop.SIZE, Drop.FORGED),
    "bit flipped": (
        Drop.FORGED,
        Drop.NOT_KOORD,
        Drop.VERSION,
        Drop.STRANGER,
        Drop.ENCRYPTED,
        Drop.UNENCRYPTED,
    ),
    "replayed": (Drop.REPLAYED,),
    "wrong key": (Drop.FORGED,),
    "of another run": (Drop.FORGED,),
    "from a stranger": (Drop.STRANGER,),
}


def said() -> list[Message]:
    """What robots say in a round."""
    decision: Decision = decided(3, [proposal_of(i, 3) for i in range(ROBOTS)])
    return [
        Propose(proposal_of(1, 3)),
        Decide(0, LogEntry(decision, bytes(16))),
        Acknowledge(0, 3, bytes(16)),
        Committed(0, 3, bytes(16), 0.1),
    ]


def real(key: bytes, pid: int, many: int, *, encrypts: bool) -> list[bytes]:
    """Datagrams as robots send them."""
    writer = DatagramWriter(Channel(key, ROBOTS, pid, encrypts=encrypts))
    made: list[bytes] = []
    while len(made) < many:
        for message in said():
            made += writer.datagrams(0, 3, message)
    return made[:many]


def hostile(kind: str, many: int, *, encrypts: bool) -> Iterator[bytes]:
    """Datagrams of a kind; made outside of what is measured."""
    random = Random(kind)
    good = real(KEY, 1, 64, encrypts=encrypts)
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


def prepared(kind: str, many: int, *, encrypts: bool) -> list[bytes]:
    match kind:
        case "wrong key":
            another = run_key(b"another key altogether", b"a run")
            return real(another, 1, many, encrypts=encrypts)
        case "of another run":
            return real(run_key(SHARED_KEY, b"another run"), 1, many, encrypts=encrypts)
        case "from a stranger":
            return real(KEY, 10 * ROBOTS - 1, many, encrypts=encrypts)
        case _:
            return list(hostile(kind, many, encrypts=encrypts))


def attacked(report: Report, kind: str, many: int, *, encrypts: bool) -> float:
    """CPU seconds that a datagram takes."""
    hub = Hub(ROBOTS)
    setup = Setup(ROBOTS, Timing.of(0.1, ROBOTS))
    robot = StormRobot(0, Journal())
    channel = Channel(KEY, ROBOTS, 0, encrypts=encrypts)
    peer = Peer(channel, setup, fresh(setup, 0), robot, hub.transport(0), float)
    door = HandshakeReader(fleet_key(SHARED_KEY, "koord"), ROBOTS, encrypts=encrypts)

    def knock(datagram: bytes) -> None:
        door.read(datagram)

    peer.on_handshake = knock
    peer.start()
    peer.turn(0.0)  # its own proposal
    if kind == "replayed":
        hub.inboxes[0].extend(real(KEY, 1, 64, encrypts=encrypts))
        peer.turn(0.0)
        peer.drops.clear()
    before = peer.node.state
    taken = 0.0
    left = many
    while left:
        part = min(left, 20_000)
        hub.inboxes[0].extend(prepared(kind, part, encrypts=encrypts))
        begun = time.process_time()
        peer.turn(0.0)
        taken += time.process_time() - begun
        left -= part
    counted = {drop: n for drop, n in (peer.drops + door.drops).items() if n}
    report.expect(sum(counted.values()) == many, f"{kind}: {counted} of {many}")
    report.expect(set(counted) <= set(KINDS[kind]), f"{kind}: counted as {counted}")
    report.expect(peer.node.state is before, f"{kind}: the state has changed")
    return taken / many


def spoken(many: int, *, encrypts: bool) -> tuple[float, float]:
    """CPU seconds that it takes to write a datagram, and to read one."""
    writer = DatagramWriter(Channel(KEY, ROBOTS, 1, encrypts=encrypts))
    reader = DatagramReader(Channel(KEY, ROBOTS, 0, encrypts=encrypts))
    messages, datagrams = said(), list[bytes]()
    begun = time.process_time()
    for k in range(many):
        datagrams += writer.datagrams(0, 3, messages[k % len(messages)])
    written = time.process_time()
    letters = sum(reader.read(datagram) is not None for datagram in datagrams)
    read = time.process_time()
    assert letters == many
    return (written - begun) / len(datagrams), (read - written) / len(datagrams)


def benchmark(report: Report) -> None:
    many = 3_000 if report.quick else 1_000_000 // len(KINDS) + 1
    forms = [False, True] if find_spec("cryptography") is not None else [False]
    for encrypts in forms:
        table = report.table(
            f"Hostile datagrams, {many:,} of each kind" + ", to robots that encrypt" * encrypts,
            Column("kind", "kind"),
            Column("us", "µs each"),
            *LIMITS,
        )
        limit_s = LIMITS_S[encrypts]
        for kind in KINDS:
            note(kind)
            each_s = attacked(report, kind, many, encrypts=encrypts)
            table.rows.append(
                {
                    "kind": kind,
                    "us": round(each_s * 1e6, 3),
                    "limit": f"{limit_s * 1e6:.0f} µs",
                    "met": each_s <= limit_s,
                }
            )
    table = report.table(
        "Datagrams between robots",
        Column("form", "form"),
        Column("write", "µs to write one"),
        Column("read", "µs to read one"),
    )
    for encrypts in forms:
        write_s, read_s = spoken(min(many, 20_000), encrypts=encrypts)
        form = "encrypted" if encrypts else "authenticated"
        times = {"write": round(write_s * 1e6, 2), "read": round(read_s * 1e6, 2)}
        table.rows.append({"form": form, **times})


if __name__ == "__main__":
    sys.exit(main("hostile", __doc__ or "", benchmark))
