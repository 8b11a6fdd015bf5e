"""Peers of a run in one process, driven in virtual time: the wire, the protocol, and a robot."""

from __future__ import annotations

from dataclasses import dataclass, field

from koord.runtime.chaos.storm import Journal, StormRobot
from koord.runtime.node import Peer
from koord.runtime.protocol.setup import Setup
from koord.runtime.protocol.state import State, fresh
from koord.runtime.transports.transport import Transport
from koord.runtime.wire.codec import Channel
from koord.runtime.wire.frames import run_key
from tests.runtime.hub import Hub

KEY = b"the key of the tests"


@dataclass(slots=True)
class Together:
    """All robots of a run. ``now`` moves when nothing else can."""

    setup: Setup
    hub: Hub
    now: float = 0.0
    peers: list[Peer] = field(default_factory=list)
    ledgers: list[StormRobot] = field(default_factory=list)

    def join(self, state: State, transport: Transport, run: bytes = b"tests") -> Peer:
        ledger = StormRobot(state.pid, Journal())
        channel = Channel(run_key(KEY, run), self.setup.robots, state.pid)
        peer = Peer(channel, self.setup, state, ledger, transport, lambda: self.now)
        self.peers.append(peer)
        self.ledgers.append(ledger)
        peer.start()
        return peer

    def run(self, until_round: int, most_steps: int = 20_000) -> None:
        """Until all have come so far."""
        for _ in range(most_steps):
            for peer in self.peers:
                peer.turn(0.0)
            if all(peer.node.state.round >= until_round for peer in self.peers):
                return
            if not any(self.hub.inboxes):
                due = [peer.node.due for peer in self.peers if peer.node.due is not None]
                self.now = max(self.now, min(due))
        raise AssertionError(f"at {[peer.node.state.round for peer in self.peers]}")


def together(setup: Setup) -> Together:
    made = Together(setup, Hub(setup.robots))
    for pid in range(setup.robots):
        made.join(fresh(setup, pid), made.hub.transport(pid))
    return made
