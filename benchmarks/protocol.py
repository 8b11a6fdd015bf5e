"""The round-commit protocol in virtual time: datagrams a round, bad networks, all interleavings.

*Datagrams* are those sent in a calm round over the real wire, a multicast counted once; the limit
is 2N + 2 and the pieces that a decision is cut in. The paper's middleware has every robot send each
write to every other one: N² packets. *Bad networks* are simulated: progress is rounds in a given
time, against a calm network. *Interleavings* are explored for three robots.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence

from msgspec.structs import replace

from harness import RESULTS, Cell, Column, Report, main, note
from koord.runtime.chaos.network import CALM, CHAOS, LOSS, Faults
from koord.runtime.chaos.storm import Journal, StormPlan, StormRobot, weather
from koord.runtime.exploration.exploring import explore
from koord.runtime.exploration.world import ExplorationBounds
from koord.runtime.node import Peer
from koord.runtime.protocol.setup import Setup, Timing
from koord.runtime.protocol.state import fresh
from koord.runtime.wire.codec import Channel
from koord.runtime.wire.frames import run_key
from tests.runtime.hub import Hub, InProcess

ROUNDS = 40

KILLING = Faults(
    most_delay_s=0.005, coordinator_dies_every_s=5.0, least_outage_s=0.5, most_outage_s=1.0
)


class Counting(InProcess):
    """A transport that knows how many bytes it carried."""

    carried = 0

    def send(self, to: int, datagram: bytes) -> None:
        Counting.carried += len(datagram)
        super().send(to, datagram)

    def tell(self, datagram: bytes) -> None:
        Counting.carried += len(datagram)
        super().tell(datagram)


def calm(robots: int) -> dict[str, float]:
    """Datagrams, pieces and bytes of a round."""
    setup = Setup(robots, Timing.of(0.1, robots))
    hub, key, now = Hub(robots), run_key(b"a key", b"a run"), [0.0]
    peers = [
        Peer(
            Channel(key, robots, pid),
            setup,
            fresh(setup, pid),
            StormRobot(pid, Journal()),
            Counting(hub, pid),
            lambda: now[0],
        )
        for pid in range(robots)
    ]
    for peer in peers:
        peer.start()

    def until(round_: int) -> None:
        while any(peer.node.state.round < round_ for peer in peers):
            for peer in peers:
                peer.turn(0.0)
            if not any(hub.inboxes):
                due = [peer.node.due for peer in peers if peer.node.due is not None]
                now[0] = max(now[0], min(due))

    until(2)
    sent, messages, carried = hub.sent, sum(p.counts.sent for p in peers), Counting.carried
    received = sum(peer.counts.received for peer in peers)
    until(2 + ROUNDS)
    datagrams = (hub.sent - sent) / ROUNDS
    whole = (sum(p.counts.sent for p in peers) - messages) / ROUNDS
    return {
        "datagrams": datagrams,
        "pieces": datagrams - whole,
        "bytes": (Counting.carried - carried) / ROUNDS,
        "received": (sum(p.counts.received for p in peers) - received) / ROUNDS / robots,
    }


def datagrams(report: Report) -> None:
    table = report.table(
        "Datagrams sent in a calm round",
        Column("robots", "robots"),
        Column("datagrams", "datagrams", 1),
        Column("pieces", "of them further pieces", 1),
        Column("limit", "limit", 0),
        Column("paper", "paper: N²"),
        Column("bytes", "bytes", 0),
        Column("received", "messages received by a robot", 1),
    )
    for robots in (4, 8, 16) if report.quick else (4, 8, 16, 32, 64, 128):
        note(f"{robots} robots")
        found = calm(robots)
        limit = 2 * robots + 2 + found["pieces"]
        report.expect(found["datagrams"] <= limit, f"{robots} robots: {found} datagrams")
        table.rows.append({"robots": robots, **found, "limit": limit, "paper": robots**2})
    if not report.quick:
        plot(table.rows, "protocol")


def plot(rows: Sequence[Mapping[str, Cell]], name: str) -> None:
    """Datagrams by robots as a picture beside the results, if matplotlib is there."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return
    robots = [float(str(row["robots"])) for row in rows]
    figure = Figure(figsize=(5.5, 3.5), layout="constrained")
    axes = figure.add_subplot()
    axes.loglog(
        robots, [float(str(row["datagrams"])) for row in rows], "o-", label="sent, measured"
    )
    axes.loglog(robots, [2 * n + 2 for n in robots], ":", label="2N + 2")
    axes.loglog(robots, [n * n for n in robots], "s--", label="paper: N²")
    axes.set_xlabel("robots")
    axes.set_ylabel("datagrams a round")
    axes.legend()
    axes.grid(True, which="both", alpha=0.3)
    figure.savefig(RESULTS / f"{name}.svg", metadata={"Date": None})


def storms(report: Report) -> None:
    table = report.table(
        "Bad networks, 8 robots, rounds of 0.1 s",
        Column("network", "network"),
        Column("runs", "runs"),
        Column("rounds", "rounds", 0),
        Column("progress", "of a calm network", 2),
        Column("taken", "proposals in time", 2),
        Column("epochs", "epochs a run", 1),
        Column("broken", "invariants broken"),
    )
    runs = 2 if report.quick else 8
    course = StormPlan(storm_s=10.0)
    reference = 0.0
    networks = {
        "calm": CALM,
        "30 % lost, 50 ms jitter": LOSS,
        "coordinator killed every 5 s": KILLING,
        "chaos": CHAOS,
        "chaos, twice the loss": replace(CHAOS, loss=0.4),
    }
    for name, faults in networks.items():
        note(name)
        setup = Setup(8, Timing.of(0.1, 8))
        done = [weather(setup, faults, seed, course) for seed in range(runs)]
        broken = [one.broken for one in done if one.broken is not None]
        report.expect(not broken, f"{name}: {broken[:1]}")
        rounds = sum(one.rounds_in_storm for one in done) / runs
        reference = reference or rounds
        late = sum(one.skips_late for one in done) / (8 * sum(one.rounds for one in done))
        table.rows.append(
            {
                "network": name,
                "runs": runs,
                "rounds": rounds,
                "progress": rounds / reference,
                "taken": 1 - late,
                "epochs": sum(one.epochs for one in done) / runs,
                "broken": len(broken),
            }
        )


def interleavings(report: Report) -> None:
    table = report.table(
        "All interleavings of three robots",
        Column("what", "what"),
        Column("states", "states"),
        Column("transitions", "transitions"),
        Column("depth", "depth"),
        Column("complete", "to the end"),
        Column("committed", "entries committed"),
        Column("cpu_s", "CPU s", 1),
    )
    most = 20_000 if report.quick else 1_000_000
    cases = {
        "a round": ExplorationBounds(rounds=1, epoch=0, crashes=0, eager=False, states=most),
        "two rounds": ExplorationBounds(rounds=2, epoch=0, crashes=0, states=most),
        "a crash, two elections": ExplorationBounds(rounds=1, epoch=2, crashes=1, states=most),
        "a crash and a restart": ExplorationBounds(
            rounds=1, epoch=2, crashes=1, restarts=1, states=most
        ),
        "switched on, sent again": ExplorationBounds(
            rounds=0, epoch=1, settled=False, resends=True, states=most
        ),
    }
    for what, bounds in cases.items():
        note(what)
        begun = time.process_time()
        found = explore(bounds)
        report.expect(found.violation is None, f"{what}: {found.violation}")
        table.rows.append(
            {
                "what": what,
                "states": found.states,
                "transitions": found.transitions,
                "depth": found.depth,
                "complete": found.complete,
                "committed": found.committed,
                "cpu_s": time.process_time() - begun,
            }
        )


def benchmark(report: Report) -> None:
    datagrams(report)
    storms(report)
    interleavings(report)


if __name__ == "__main__":
    sys.exit(main("protocol", __doc__ or "", benchmark))
