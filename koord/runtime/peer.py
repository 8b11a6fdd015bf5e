"""A node on a real transport: letters in and out, and the time of a clock that is passed in."""

from __future__ import annotations

from collections.abc import Callable

from msgspec import Struct

from koord.runtime.node import Node, Participant
from koord.runtime.protocol.messages import Message
from koord.runtime.protocol.setup import Setup
from koord.runtime.protocol.state import State
from koord.runtime.transports.transport import Transport
from koord.runtime.wire.codec import DatagramReader, DatagramWriter, RunKey
from koord.runtime.wire.frames import Drops

#: Seconds, from any beginning, never going back.
Clock = Callable[[], float]


class Counts(Struct):
    """What went in and out."""

    sent: int = 0  #: messages; one to all counts once
    datagrams: int = 0  #: the same in pieces
    received: int = 0  #: messages


class Peer:
    """One robot of a run on a network."""

    def __init__(
        self,
        run: RunKey,
        setup: Setup,
        state: State,
        robot: Participant,
        transport: Transport,
        clock: Clock,
    ) -> None:
        self.counts = Counts()
        self.transport = transport
        self.node = Node(setup, state, robot, self)
        self._writer = DatagramWriter(run, state.pid)
        self._reader = DatagramReader(run, state.pid)
        self._clock = clock

    @property
    def drops(self) -> Drops:
        """The datagrams that were dropped, by reason."""
        return self._reader.drops

    # --- the node's outbox ----------------------------------------------------------------------

    def send(self, to: int, message: Message) -> None:
        for datagram in self._datagrams(message):
            self.transport.send(to, datagram)

    def tell(self, message: Message) -> None:
        for datagram in self._datagrams(message):
            self.transport.tell(datagram)

    def _datagrams(self, message: Message) -> list[bytes]:
        state = self.node.state
        datagrams = self._writer.datagrams(state.incarnation, state.round, message)
        self.counts.sent += 1
        self.counts.datagrams += len(datagrams)
        return datagrams

    # --- time -----------------------------------------------------------------------------------

    def start(self) -> None:
        """Switch the robot on."""
        self.node.start(self._clock())

    def turn(self, most_s: float) -> None:
        """Do what is due, wait for what comes, at most so long, and take it in."""
        self.node.wake(self._clock())
        due = self.node.due
        wait_s = most_s if due is None else min(most_s, max(0.0, due - self._clock()))
        datagrams = self.transport.receive(wait_s)
        if not datagrams:
            return
        self._reader.round = self.node.state.round
        for datagram in datagrams:
            letter = self._reader.read(datagram)
            if letter is not None:
                self.counts.received += 1
                self.node.receive(self._clock(), letter.sender, letter.incarnation, letter.message)
