"""A node: the protocol's machine of a robot with its timers, program and transport.

A node knows neither sockets nor what time it is: whoever drives it says so. The same node runs over
real networks and over simulated ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from enum import Enum
from typing import Protocol, assert_never

from msgspec import Struct

from koord.runtime.proposals import Admitted, Proposal
from koord.runtime.protocol.events import (
    Arm,
    Begin,
    Commit,
    Disarm,
    Effect,
    Event,
    Expired,
    Hold,
    Install,
    Proposed,
    Reason,
    Received,
    Resume,
    RunEnded,
    Save,
    Send,
    ShowStore,
    Started,
    StoreShown,
    Tell,
    Timer,
)
from koord.runtime.protocol.machine import step
from koord.runtime.protocol.messages import Beacon, LastRun, LogEntry, Message, RunMessage
from koord.runtime.protocol.setup import Setup
from koord.runtime.protocol.state import State
from koord.runtime.transports.shared import SharedEnd
from koord.runtime.transports.transport import Transport
from koord.runtime.wire.codec import Channel, DatagramReader, DatagramWriter, is_handshake
from koord.runtime.wire.frames import Drops


class Participant(Protocol):
    """The program and platform of a robot, as the node sees them."""

    def propose(self, round_: int) -> Proposal | None:
        """Sense, run the first enabled event into a buffer, and propose. None: stay mute."""

    def save(self, state: State) -> bool:
        """Write what is durable of a state to the disk; return whether it is there for good.
        (R-SAVE)
        """

    def commit(self, entry: LogEntry, kept: Admitted | None) -> None:
        """Act on a decision: apply the writes; keep the buffer or discard it."""

    def show(self) -> bytes:
        """The store as bytes, for a robot that needs it."""

    def install(self, round_: int, store: bytes, ran: LastRun | None) -> None:
        """Replace the store; keep the buffer if it is of the round that ``ran`` names."""

    def hold(self, reason: Reason | None) -> None:
        """Come to a safe stop for a reason; None: go on."""


class Outbox(Protocol):
    """The channel for outgoing messages."""

    def send(self, to: int, message: Message) -> None:
        """Send to one robot."""

    def tell(self, message: Message) -> None:
        """Send to all other robots."""


class PendingWork(Enum):
    """The timers of the node itself, besides those of the machine."""

    __hash__ = object.__hash__

    ROUND = "round"  #: the next round begins, and the program has to run


#: How long a robot that cannot write waits before it tries again.
_WRITE_AGAIN_S = 0.5


class Node:
    """A driver of one robot's protocol machine. Not thread-safe.

    A robot that cannot write to its disk does and hears nothing until it can. (R-SAVE)
    """

    def __init__(self, setup: Setup, state: State, robot: Participant, outbox: Outbox) -> None:
        self.setup = setup
        self.state = state
        self.over = False
        self._robot = robot
        self._outbox = outbox
        self._due: dict[Timer | PendingWork, float] = {}
        self._soonest: float | None = None  #: of these
        self._is_soonest_known = True  #: they are as when that was looked for
        self._work = 0
        self._kept_back: list[Effect] = []  #: from a Save that failed on
        self._write_at = 0.0

    def start(self, now: float) -> None:
        self._do(Started(now))

    def receive(self, now: float, sender: int, incarnation: int, message: Message) -> None:
        if not self._kept_back:
            event = Received(now, sender, incarnation, message)
            self.state, effects = step(self.setup, self.state, event)
            if effects:
                self._carry_out_all(effects, now)

    def wake(self, now: float) -> None:
        """Expire every timer that is due."""
        if self._kept_back and not self._try_again(now):
            return
        due = self._due
        while not self._kept_back:
            soonest = self.due
            if soonest is None or soonest > now:
                return
            # Of those that are due at the same moment the one that was armed first.
            timer = next(one for one, at in due.items() if at == soonest)
            del due[timer]
            self._is_soonest_known = False
            if isinstance(timer, Timer):
                self._do(Expired(now, timer))
            else:
                proposal = self._robot.propose(self._work)
                if proposal is not None:
                    self._do(Proposed(now, proposal))

    @property
    def due(self) -> float | None:
        """The time at which to wake the node next, or None."""
        if self._kept_back:
            return self._write_at
        if not self._is_soonest_known:
            self._soonest = min(self._due.values()) if self._due else None
            self._is_soonest_known = True
        return self._soonest

    @property
    def is_unwritable(self) -> bool:
        """True if what was to be saved is not on the disk. (R-SAVE)"""
        return bool(self._kept_back)

    def _do(self, event: Event) -> None:
        self.state, effects = step(self.setup, self.state, event)
        if effects:
            self._carry_out_all(effects, event.now)

    def _carry_out_all(self, effects: Sequence[Effect], now: float) -> None:
        for done, effect in enumerate(effects):
            # Most are of the first kinds: a few of them in each round for each other robot.
            if type(effect) is Arm:
                self._due[effect.timer] = now + effect.after_s
            elif type(effect) is Disarm:
                self._due.pop(effect.timer, None)
            elif type(effect) is Send:
                self._outbox.send(effect.to, effect.message)
            elif type(effect) is Begin:
                self._work = effect.round
                self._due[PendingWork.ROUND] = now + effect.after_s
            elif type(effect) is Commit:
                self._due.pop(PendingWork.ROUND, None)
                self._robot.commit(effect.entry, effect.kept)
            elif type(effect) is Save:
                if not self._robot.save(self.state):
                    self._kept_back = list(effects[done:])
                    self._write_at = now + _WRITE_AGAIN_S
                    self._robot.hold(Reason.UNWRITABLE)
                    return
            else:
                self._carry_out(effect, now)
        self._is_soonest_known = False

    def _try_again(self, now: float) -> bool:
        """Try to write once more; return whether the robot goes on."""
        if now < self._write_at:
            return False
        effects, self._kept_back = self._kept_back, []
        self._carry_out_all(effects, now)
        if self._kept_back:
            return False
        self._robot.hold(self.state.holding)
        return True

    def _carry_out(self, effect: Effect, now: float) -> None:
        match effect:
            case Tell(message=message):
                self._outbox.tell(message)
            case Install(round=round_, store=store, ran=ran):
                self._due.pop(PendingWork.ROUND, None)
                self._robot.install(round_, store, ran)
            case ShowStore(to=to):
                self._do(StoreShown(now, to, self.state.round, self._robot.show()))
            case Hold(reason=reason):
                self._robot.hold(reason)
            case Resume():
                self._robot.hold(None)
            case RunEnded():
                self.over = True
            case Arm() | Disarm() | Send() | Save() | Begin() | Commit():
                raise AssertionError("is carried out by whoever has the effects after it")
            case _:
                assert_never(effect)


#: Seconds, from any beginning, never going back.
Clock = Callable[[], float]


class Counts(Struct):
    """Counters of messages and datagrams."""

    sent: int = 0  #: messages; one to all counts once
    datagrams: int = 0  #: the same in pieces
    received: int = 0  #: messages
    sent_bytes: int = 0  #: of datagrams, without the headers of the network
    arrived: int = 0  #: datagrams, of handshakes too
    arrived_bytes: int = 0


class Peer:
    """One robot of a run on a network: its node, its wire and its transport.

    ``on_handshake`` gets the datagrams of handshakes, ``on_beacon`` what is said beside the
    agreement.
    """

    def __init__(
        self,
        channel: Channel,
        setup: Setup,
        state: State,
        robot: Participant,
        transport: Transport,
        clock: Clock,
    ) -> None:
        self.counts = Counts()
        self.transport = transport
        self.node = Node(setup, state, robot, self)
        self.start_number = channel.start
        self.heard_at: dict[int, float] = {}  #: when each robot was heard last
        self.on_handshake: Callable[[bytes], None] = _ignored
        self.on_beacon: Callable[[int, Beacon], None] = _unheard
        self._writer = DatagramWriter(channel)
        opened = transport.opened(channel) if isinstance(transport, SharedEnd) else None
        self._reader = DatagramReader(channel, opened=opened)
        self._clock = clock
        self._read_at = -math.inf  #: when the last datagram was read

    @property
    def drops(self) -> Drops:
        """The datagrams that were dropped, by reason."""
        return self._reader.drops

    def start_of(self, robot: int) -> int:
        """The highest start heard from a robot; 0: none. (R-START)"""
        return self._reader.start_of(robot)

    def start_again(self, start: int) -> None:
        """Go on as in another start. (R-START)"""
        self.start_number = start
        self._writer.start_again(start)
        self._reader.start = start

    # --- the node's outbox ----------------------------------------------------------------------

    def send(self, to: int, message: Message) -> None:
        for datagram in self._datagrams(message):
            self.transport.send(to, datagram)

    def tell(self, message: RunMessage) -> None:
        for datagram in self._datagrams(message):
            self.transport.tell(datagram)

    def _datagrams(self, message: RunMessage) -> list[bytes]:
        state = self.node.state
        datagrams = self._writer.datagrams(state.incarnation, state.round, message)
        counts = self.counts
        counts.sent += 1
        counts.datagrams += len(datagrams)
        counts.sent_bytes += sum(map(len, datagrams))
        return datagrams

    # --- time -----------------------------------------------------------------------------------

    def start(self) -> None:
        """Start the robot."""
        self.node.start(self._clock())

    def turn(self, most_s: float) -> None:
        """Wait at most ``most_s`` seconds for datagrams, process them, and expire due timers.

        What has come is heard first: a timer may wait for nothing else.
        """
        node = self.node
        due = node.due
        if due is not None:
            left_s = due - self._clock()
            if left_s < most_s:
                most_s = left_s if left_s > 0.0 else 0.0
        datagrams = self.transport.receive(most_s)
        if datagrams:
            self._reader.round = node.state.round
            for datagram in datagrams:
                self.read(datagram)
        due = node.due
        if due is None:
            return
        # What this has made due at once needs no other look at the clock; the rest comes next time.
        now = self._read_at if datagrams else self._clock()
        if due <= now:
            node.wake(now)

    def read(self, datagram: bytes) -> None:
        """Process a datagram."""
        counts, size = self.counts, len(datagram)
        counts.arrived += 1
        counts.arrived_bytes += size
        now = self._read_at = self._clock()
        if is_handshake(datagram):
            self.on_handshake(datagram)
            return
        letter = self._reader.read(datagram)
        if letter is None:
            return
        counts.received += 1
        sender, message = letter.sender, letter.message
        self.heard_at[sender] = now
        if isinstance(message, Beacon):
            self.on_beacon(sender, message)
            return
        self.node.receive(now, sender, letter.incarnation, message)


def _ignored(datagram: bytes) -> None:
    """Drop a datagram of a handshake: this run had none."""


def _unheard(sender: int, beacon: Beacon) -> None:
    """Drop a beacon: this robot has no vehicle that could run into another."""
