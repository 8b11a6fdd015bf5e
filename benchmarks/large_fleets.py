"""The coordinator of a large fleet: its datagrams and CPU over UDP, and fleets in virtual time.

*Without sockets*: what all other robots say is written by hand, so that 10,000 of them cost no more
than their messages. *On a simulated network*: all robots are in one process, and time is virtual.
*Over UDP*: the coordinator is a process of its own; the other robots are one
process, with a socket each, and rounds as long as that process needs. The coordinator's CPU, the
kernel's share of it included, does not depend on how long rounds are; *at 10 rounds/s* is the part
of a core that it would need then. *In virtual time* each robot is busy with each message for as
long as was measured of the coordinator, so that what waits for it waits, and at most 4 N messages
wait; every invariant of the protocol is checked all the time.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from select import select
from typing import TypeVar

from msgspec.structs import replace

from harness import Column, Report, main, note
from koord.runtime.chaos.network import CALM, LOSS, Faults, Network
from koord.runtime.chaos.storm import Journal, Ledgers, StormPlan, StormRobot, proposal_of, weather
from koord.runtime.node import Peer
from koord.runtime.proposals import INIT_ROUND
from koord.runtime.protocol.messages import (
    FIRST_INCARNATION,
    Acknowledge,
    Committed,
    Decide,
    Propose,
    RunMessage,
    digest,
)
from koord.runtime.protocol.setup import Setup, Timing
from koord.runtime.protocol.state import fresh
from koord.runtime.transports.transport import Visit
from koord.runtime.transports.udp import Udp, on_this_machine
from koord.runtime.wire.codec import Channel, DatagramReader, DatagramWriter
from koord.runtime.wire.frames import LONGEST, run_key

PORT = 47_000
KEY = run_key(b"a key", b"a run")
DELTA_S = 0.1

#: What the other robots need for a round in one process, for each robot.
MEMBER_S = 0.006

ROBOTS = (64, 128, 256, 512, 1000)
QUICK = (16, 64)

NETWORKS = {
    "calm": CALM,
    "10 % lost": replace(CALM, loss=0.1),
    "30 % lost, 5 % doubled, 50 ms jitter": LOSS,
    "coordinator killed every 2 s": replace(CALM, coordinator_dies_every_s=2.0, losses=0.0),
}


#: So many datagrams are handed on at once, as over UDP.
BATCH = 32

Answer = TypeVar("Answer", Decide, Committed)


class Crowd:
    """The ends of all robots but the coordinator: what is said to all arrives once for them."""

    def __init__(self, robots: int) -> None:
        self.plan = on_this_machine(robots, PORT)
        self.inboxes: list[deque[bytes]] = [deque() for _ in range(robots)]
        self._all = Udp(self.plan, 1)
        self._outbox: list[tuple[int, bytes]] = []
        self._own = {}
        for pid in range(2, robots):
            one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            one.setblocking(False)
            one.bind(self.plan.addresses[pid])
            self._own[one.fileno()] = (pid, one)

    def end(self, pid: int) -> Member:
        return Member(self, pid)

    def gather(self, timeout_s: float) -> None:
        """Wait for datagrams, and deal them out."""
        while came := self._all.receive(timeout_s):
            timeout_s = 0.0
            for inbox in self.inboxes[1:]:
                inbox.extend(came)
        for number in select(list(self._own), [], [], 0.0)[0]:
            pid, one = self._own[number]
            with suppress(BlockingIOError):
                while True:
                    self.inboxes[pid].append(one.recv(LONGEST + 1))

    def send(self, to: int, datagram: bytes) -> None:
        self._outbox.append((to, datagram))

    def flush(self) -> None:
        """Send what all have said, as robots do that have a processor each: at the same moment."""
        for to, datagram in self._outbox:
            self._all.send(to, datagram)
        self._outbox.clear()


class Member:
    """One robot's end of a crowd."""

    def __init__(self, crowd: Crowd, pid: int) -> None:
        self.dropped = 0
        self._crowd = crowd
        self._pid = pid

    def send(self, to: int, datagram: bytes) -> None:
        self._crowd.send(to, datagram)

    def tell(self, datagram: bytes) -> None:
        """Nobody but the coordinator tells anything to all in a calm run."""
        self._crowd.send(0, datagram)

    def receive(self, timeout_s: float) -> list[bytes]:
        inbox = self._crowd.inboxes[self._pid]
        came = list(inbox)
        inbox.clear()
        return came

    def visits(self) -> list[Visit]:
        return []

    def close(self) -> None:
        pass


def peer(setup: Setup, pid: int, transport: Udp | Member) -> Peer:
    channel = Channel(KEY, setup.robots, pid)
    robot = StormRobot(pid, Journal())
    return Peer(channel, setup, fresh(setup, pid), robot, transport, time.monotonic)


def others(setup: Setup) -> None:
    """Be all robots but the coordinator, for ever."""
    crowd = Crowd(setup.robots)
    peers = [peer(setup, pid, crowd.end(pid)) for pid in range(1, setup.robots)]
    for one in peers:
        one.start()
    while True:
        crowd.gather(0.002)
        for one in peers:
            one.turn(0.0)
        crowd.flush()


def coordinated(robots: int, rounds: int) -> dict[str, float]:
    """The coordinator's CPU seconds, datagrams and bytes a round, over UDP."""
    pace_s = max(DELTA_S, MEMBER_S * robots)
    # The others take their time, one after another: nothing is to be asked for again meanwhile.
    setup = Setup(robots, replace(Timing.of(pace_s, robots), resend_s=pace_s))
    child = os.fork()
    if child == 0:
        try:
            others(setup)
        finally:
            os._exit(1)
    try:
        transport = Udp(on_this_machine(robots, PORT), 0)
        one = peer(setup, 0, transport)
        one.start()

        def until(round_: int) -> None:
            while one.node.state.round < round_:
                one.turn(0.1)

        until(2)
        begun, sent, received = time.process_time(), transport.sent, one.counts.received
        until(2 + rounds)
        spent_s = time.process_time() - begun
        transport.close()
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    return {
        "cpu_s": spent_s / rounds,
        "sent": (transport.sent - sent) / rounds,
        "received": (one.counts.received - received) / rounds,
    }


def over_udp(report: Report) -> float:
    """Measure coordinators; return the seconds that the largest fleet's takes for a message."""
    table = report.table(
        "A coordinator over UDP, alone on a core",
        Column("robots", "robots"),
        Column("sent", "datagrams sent a round", 1),
        Column("received", "received", 1),
        Column("limit", "N − 1 each twice"),
        Column("cpu_ms", "CPU ms a round", 1),
        Column("message_us", "µs a message", 1),
        Column("share", "of a core at 10 rounds/s, %", 0),
    )
    message_s = 0.0
    for robots in QUICK if report.quick else ROBOTS:
        note(f"{robots} robots over UDP")
        found = coordinated(robots, 3 if report.quick else 10)
        limit = 2 * (robots - 1)
        told = f"{robots} robots: {found['received']} datagrams received a round"
        report.expect(found["received"] >= limit * 0.75, told)
        message_s = found["cpu_s"] / found["received"]
        table.rows.append(
            {
                "robots": robots,
                "sent": found["sent"],
                "received": found["received"],
                "limit": limit,
                "cpu_ms": 1e3 * found["cpu_s"],
                "message_us": 1e6 * message_s,
                "share": 100 * found["cpu_s"] * 10,
            }
        )
    return message_s


class Fed:
    """The end of a coordinator whose robots are written by hand: what it hears, and has told."""

    def __init__(self) -> None:
        self.dropped = 0
        self.inbox: deque[bytes] = deque()
        self.told: list[bytes] = []

    def send(self, to: int, datagram: bytes) -> None:
        raise AssertionError(f"robot {to} has said all that was to be said")

    def tell(self, datagram: bytes) -> None:
        self.told.append(datagram)

    def receive(self, timeout_s: float) -> list[bytes]:
        return [self.inbox.popleft() for _ in range(min(BATCH, len(self.inbox)))]

    def visits(self) -> list[Visit]:
        return []

    def close(self) -> None:
        pass


class ByHand:
    """A coordinator, and what all other robots tell it: one of them listens for all."""

    def __init__(self, robots: int) -> None:
        # Nothing is asked for again, however long it takes.
        setup = Setup(robots, Timing.of(0.0, robots, unhurried_s=3600.0))
        self.spent_s = 0.0
        self.told = self.told_bytes = 0  #: to all
        self._fed = Fed()
        self._peer = Peer(
            Channel(KEY, robots, 0),
            setup,
            fresh(setup, 0),
            StormRobot(0, Journal()),
            self._fed,
            lambda: 0.0,
        )
        self._writers = [DatagramWriter(Channel(KEY, robots, pid)) for pid in range(1, robots)]
        self._reader = DatagramReader(Channel(KEY, robots, 1))
        self._peer.start()

    def round(self, number: int) -> None:
        """Let all robots propose for a round, and acknowledge what is decided."""
        writers = enumerate(self._writers, 1)
        proposed = [Propose(proposal_of(pid, number)) for pid, _ in writers]
        decide = self._answer(number, proposed, Decide)
        mark = digest(decide.entry)
        # A majority is enough, but all of them are heard in the end.
        held = Acknowledge(decide.epoch, number, mark)
        committed = self._answer(number, [held] * len(self._writers), Committed)
        assert committed.digest == mark

    def _answer(self, number: int, said: Sequence[RunMessage], kind: type[Answer]) -> Answer:
        for writer, message in zip(self._writers, said, strict=True):
            self._fed.inbox += writer.datagrams(FIRST_INCARNATION, number, message)
        begun = time.process_time()
        while self._fed.inbox:
            self._peer.turn(0.0)
        self._peer.turn(0.0)
        self.spent_s += time.process_time() - begun
        told, self._fed.told = self._fed.told, []
        self.told += len(told)
        self.told_bytes += sum(map(len, told))
        letters = [one for one in map(self._reader.read, told) if one is not None]
        (answer,) = [one.message for one in letters if isinstance(one.message, kind)]
        return answer


def without_sockets(report: Report) -> None:
    """Measure coordinators of which all other robots are written by hand."""
    table = report.table(
        "A coordinator without sockets and journal",
        Column("robots", "robots"),
        Column("told", "datagrams to all a round", 1),
        Column("told_kb", "kB of them", 1),
        Column("cpu_ms", "CPU ms a round", 1),
        Column("message_us", "µs a message", 1),
        Column("per_s", "rounds/s on a core", 1),
    )
    for robots in QUICK if report.quick else (*ROBOTS, 10_000):
        note(f"{robots} robots by hand")
        fleet, rounds = ByHand(robots), max(3, 10_000 // robots)
        fleet.round(INIT_ROUND)
        fleet.round(0)
        fleet.spent_s, fleet.told, fleet.told_bytes = 0.0, 0, 0
        for number in range(1, 1 + rounds):
            fleet.round(number)
        spent_s = fleet.spent_s / rounds
        table.rows.append(
            {
                "robots": robots,
                "told": fleet.told / rounds,
                "told_kb": fleet.told_bytes / rounds / 1e3,
                "cpu_ms": 1e3 * spent_s,
                "message_us": 1e6 * spent_s / (2 * robots - 2),
                "per_s": 1 / spent_s,
            }
        )


def in_virtual_time(report: Report, message_s: float) -> None:
    """Run fleets whose robots need so many seconds for a message."""
    table = report.table(
        f"In virtual time, δ = {DELTA_S} s, {1e6 * message_s:.0f} µs a message",
        Column("robots", "robots"),
        Column("network", "network"),
        Column("seconds", "s", 0),
        Column("rounds", "rounds"),
        Column("progress", "of one every δ", 2),
        Column("late", "late, % of robot-rounds", 2),
        Column("datagrams", "datagrams a round", 0),
        Column("epochs", "epochs"),
        Column("broken", "invariants broken"),
        Column("cpu_s", "CPU s", 1),
    )
    lasts_s = 2.0 if report.quick else 10.0
    for robots in QUICK if report.quick else ROBOTS:
        for name, network in NETWORKS.items():
            note(f"{robots} robots in virtual time, {name}")
            faults: Faults = replace(network, reading_s=message_s, inbox=4 * robots)
            begun = time.process_time()
            course = StormPlan(storm_s=lasts_s)
            done = weather(Setup(robots, Timing.of(DELTA_S, robots)), faults, 1, course)
            report.expect(done.broken is None, f"{robots} robots, {name}: {done.broken}")
            table.rows.append(
                {
                    "robots": robots,
                    "network": name,
                    "seconds": lasts_s,
                    "rounds": done.rounds_in_storm,
                    "progress": done.rounds_in_storm * DELTA_S / lasts_s,
                    "late": 100 * done.skips_late / robots / max(done.rounds, 1),
                    "datagrams": done.datagrams / (done.rounds + 1),
                    "epochs": done.epochs,
                    "broken": int(done.broken is not None),
                    "cpu_s": time.process_time() - begun,
                }
            )


def simulated(report: Report) -> None:
    """Measure whole fleets on a calm simulated network, in one process, no invariant looked at."""
    table = report.table(
        f"All robots on a simulated network, δ = {DELTA_S} s",
        Column("robots", "robots"),
        Column("rounds", "rounds a simulated second", 1),
        Column("cpu_s", "CPU s of it", 2),
        Column("least_ms", "of the quickest round, ms", 0),
        Column("robot_us", "µs a robot and round", 0),
    )
    lasts_s = 1.0 if report.quick else 5.0
    for robots in QUICK if report.quick else (100, 1000):
        note(f"{robots} robots on a simulated network")
        setup = Setup(robots, Timing.of(DELTA_S, robots))
        network = Network(setup, CALM, 1, Ledgers(setup).switch_on)

        def until(time_s: float, network: Network = network) -> None:
            while network.now < time_s:
                network.step()
                network.sent.clear()

        until(3.5 * DELTA_S)
        before = max(state.round for state in network.running())
        spent_s = []
        for k in range(1, 1 + round(lasts_s / DELTA_S)):
            begun = time.process_time()
            until((3.5 + k) * DELTA_S)
            spent_s.append(time.process_time() - begun)
        rounds = max(state.round for state in network.running()) - before
        report.expect(rounds >= 0.9 * lasts_s / DELTA_S, f"{robots} robots: {rounds} rounds")
        table.rows.append(
            {
                "robots": robots,
                "rounds": rounds / lasts_s,
                "cpu_s": sum(spent_s) / lasts_s,
                "least_ms": 1e3 * min(spent_s),
                "robot_us": 1e6 * sum(spent_s) / robots / max(rounds, 1),
            }
        )


def benchmark(report: Report) -> None:
    without_sockets(report)
    simulated(report)
    in_virtual_time(report, over_udp(report))


if __name__ == "__main__":
    sys.exit(main("large_fleets", __doc__ or "", benchmark))
