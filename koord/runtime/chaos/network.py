"""A simulated network in virtual time: messages meet faults that are drawn from a seed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from enum import Enum
from heapq import heappop, heappush
from random import Random

from msgspec import Struct

from koord.runtime.node import Node, Participant
from koord.runtime.protocol.messages import Message
from koord.runtime.protocol.setup import Setup
from koord.runtime.protocol.state import Coordinator, State


class Faults(Struct, frozen=True):
    """Rates of faults: probabilities per message, or per robot and second; durations in seconds."""

    loss: float = 0.0
    duplication: float = 0.0
    least_delay_s: float = 0.001
    most_delay_s: float = 0.002
    crashes_per_s: float = 0.0
    least_outage_s: float = 0.1
    most_outage_s: float = 1.0
    for_ever: float = 0.0  #: the part of the crashes after which a robot does not come back
    losses: float = 0.2  #: the part of the crashes that a robot's disk does not survive
    cuts_per_s: float = 0.0  #: how often the network falls into two parts
    cut_s: float = 0.5
    coordinator_dies_every_s: float = 0.0
    reading_s: float = 0.0  #: how long a robot is busy with each message that it gets
    inbox: int = 1 << 30  #: so many messages wait for a robot at most; further ones are lost


CALM = Faults()

#: Radio in a bad place.
LOSS = Faults(loss=0.3, duplication=0.05, most_delay_s=0.05)

#: All of it at once.
CHAOS = Faults(
    loss=0.2,
    duplication=0.1,
    most_delay_s=0.15,
    crashes_per_s=0.15,
    cuts_per_s=0.2,
    cut_s=0.7,
)


class Delivery(Struct, frozen=True):
    """The arrival of a message."""

    sender: int
    incarnation: int
    to: int
    message: Message


class Reading(Struct, frozen=True):
    """The moment at which a robot has come to a message that had arrived."""

    delivery: Delivery


class Wake(Struct, frozen=True):
    """The expiry of a robot's timer, unless it was armed again."""

    robot: int


class Birth(Struct, frozen=True):
    """The restart of a robot that was down, with its disk or without."""

    robot: int
    has_disk: bool


class Weather(Struct, frozen=True):
    """The time to draw crashes and network cuts."""


Occurrence = Delivery | Reading | Wake | Birth | Weather

#: A scheduled occurrence: its time, a number that keeps the order of equal times, and what it is.
Due = tuple[float, int, Occurrence]


class Sent(Struct, frozen=True):
    """A datagram that was sent, whether or not it arrives; ``to`` is None for a multicast."""

    sender: int
    incarnation: int
    to: int | None
    message: Message


class Newborn(Struct, frozen=True):
    """A robot as it is switched on, with the initial state of its protocol."""

    robot: Participant
    setup: Setup
    state: State


class SwitchedOn(Enum):
    """The ways in which a robot is switched on."""

    FIRST = "for the first time"
    KEPT = "again, with its disk"
    LOST = "again, without its disk"


#: Switches a robot on: who, in which start of all robots', and how.
SwitchOn = Callable[[int, int, SwitchedOn], Newborn]

#: How often crashes and cuts are drawn.
WEATHER_S = 0.1


class Network:
    """A network of robots: their states, messages in transit, and the time."""

    def __init__(
        self,
        setup: Setup,
        faults: Faults,
        seed: int,
        switch_on: SwitchOn,
        carry: Callable[[Message], Message] = lambda message: message,
    ) -> None:
        """Make a network; ``carry`` encodes and decodes each message, as a wire does."""
        self.setup = setup
        self.faults = faults
        self.now = 0.0
        self.sent: list[Sent] = []  #: since whoever watches has looked last
        self.nodes: list[Node | None] = [None] * setup.robots
        self.crashes = 0
        self.crowded = 0  #: messages lost as too many were waiting
        self._random = Random(seed)
        self._due: list[Due] = []
        self._busy_until = [0.0] * setup.robots
        self._awaited = [-1.0] * setup.robots  #: the time of the last Wake that is still to come
        self._number = 0
        self._births = 0
        self._new = switch_on
        self._carry = carry
        self._cut: frozenset[int] = frozenset()
        self._cut_until = 0.0
        self._killed_at = 0.0
        for robot in range(setup.robots):
            self._switch_on(robot, SwitchedOn.FIRST)
        self._later(WEATHER_S, Weather())

    def step(self) -> int | None:
        """Let the next occurrence happen; return the robot that it concerns, if any."""
        at, _, what = heappop(self._due)
        self.now = max(self.now, at)
        match what:
            case Delivery() as delivery if self.faults.reading_s > 0:
                self._queue(delivery)
                return None
            case (Delivery() as delivery) | Reading(delivery=delivery):
                return self._hand_over(delivery)
            case Wake(robot=robot):
                if self._awaited[robot] == at:
                    self._awaited[robot] = -1.0
                node = self.nodes[robot]
                if node is None or node.due is None or node.due > self.now:
                    return None
                node.wake(self.now)
                self._await(robot)
                return robot
            case Birth(robot=robot, has_disk=has_disk):
                self._switch_on(robot, SwitchedOn.KEPT if has_disk else SwitchedOn.LOST)
                return robot
            case Weather():
                self._draw_weather()
                return None

    def running(self) -> Iterator[State]:
        """The states of the robots that are up."""
        return (node.state for node in self.nodes if node is not None)

    def crash(self, robot: int, outage_s: float | None, *, has_disk: bool = True) -> None:
        """Switch a robot off, for a number of seconds, or for ever (None)."""
        self.nodes[robot] = None
        self.crashes += 1
        if outage_s is not None:
            self._later(outage_s, Birth(robot, has_disk))

    # --- the robots' outboxes -------------------------------------------------------------------

    def post(self, sender: int, to: int | None, message: Message) -> None:
        """Send a datagram; its fate is drawn for each receiver."""
        node = self.nodes[sender]
        assert node is not None
        incarnation = node.state.incarnation
        self.sent.append(Sent(sender, incarnation, to, message))
        arriving = self._carry(message)
        receivers = (to,) if to is not None else range(self.setup.robots)
        faults = self.faults
        for receiver in receivers:
            copies = 1 + (self._random.random() < faults.duplication)
            for _ in range(copies):
                if receiver == sender or self._random.random() < faults.loss:
                    continue
                delay = self._random.uniform(faults.least_delay_s, faults.most_delay_s)
                self._later(delay, Delivery(sender, incarnation, receiver, arriving))

    def _queue(self, delivery: Delivery) -> None:
        """Let a message wait until its receiver has read those before it."""
        to, reading_s = delivery.to, self.faults.reading_s
        begin = max(self.now, self._busy_until[to])
        if begin - self.now > reading_s * self.faults.inbox:
            self.crowded += 1
            return
        self._busy_until[to] = begin + reading_s
        self._later(begin + reading_s - self.now, Reading(delivery))

    def _hand_over(self, delivery: Delivery) -> int | None:
        """Let a robot read a message; return the robot, if it could."""
        to = delivery.to
        node = self.nodes[to]
        if node is None or self._is_cut(delivery.sender, to):
            return None
        node.receive(self.now, delivery.sender, delivery.incarnation, delivery.message)
        self._await(to)
        return to

    # --- time -----------------------------------------------------------------------------------

    def _later(self, after_s: float, what: Occurrence) -> None:
        self._at(self.now + after_s, what)

    def _at(self, time_s: float, what: Occurrence) -> None:
        self._number += 1
        heappush(self._due, (time_s, self._number, what))

    def _await(self, robot: int) -> None:
        node = self.nodes[robot]
        due = None if node is None else node.due
        if due is not None:
            wake_s = max(self.now, due)  # and no sum, which may be rounded to before it
            if self._awaited[robot] != wake_s:
                self._awaited[robot] = wake_s
                self._at(wake_s, Wake(robot))

    # --- crashes and cuts -----------------------------------------------------------------------

    def _switch_on(self, robot: int, how: SwitchedOn) -> None:
        self._births += 1
        new = self._new(robot, self._births, how)
        node = Node(new.setup, new.state, new.robot, _Outbox(self, robot))
        self.nodes[robot] = node
        node.start(self.now)
        self._await(robot)

    def _draw_weather(self) -> None:
        faults, draw = self.faults, self._random
        self._later(WEATHER_S, Weather())
        spare = self.setup.robots - self.setup.majority - self._lost - self._newcomers()
        for robot, node in enumerate(self.nodes):
            if node is None or not draw.random() < faults.crashes_per_s * WEATHER_S:
                continue
            # A majority has to remember; disks do.
            loses = draw.random() < faults.losses
            if spare > 0 or not loses:
                spare -= loses
                self._outage(robot, has_disk=not loses)
        every = faults.coordinator_dies_every_s
        if every and self.now - self._killed_at >= every:
            for robot, node in enumerate(self.nodes):
                if node is not None and isinstance(node.state.office, Coordinator):
                    self._killed_at = self.now
                    self._outage(robot, has_disk=True)
                    break
        if self.now >= self._cut_until:
            self._cut = frozenset()
            if self.setup.robots > 1 and draw.random() < faults.cuts_per_s * WEATHER_S:
                size = draw.randrange(1, self.setup.robots)
                self._cut = frozenset(draw.sample(range(self.setup.robots), size))
                self._cut_until = self.now + faults.cut_s

    @property
    def _lost(self) -> int:
        """Robots that are down and will be back without a disk, or never."""
        coming = sum(isinstance(what, Birth) and what.has_disk for _, _, what in self._due)
        return sum(node is None for node in self.nodes) - coming

    def _newcomers(self) -> int:
        """Robots that are back and not yet admitted: for a majority they count as down."""
        return sum(1 for state in self.running() if not state.is_on_roster or state.round < 0)

    def _outage(self, robot: int, *, has_disk: bool) -> None:
        faults, draw = self.faults, self._random
        for_ever = draw.random() < faults.for_ever
        outage_s = draw.uniform(faults.least_outage_s, faults.most_outage_s)
        self.crash(robot, None if for_ever else outage_s, has_disk=has_disk)

    def _is_cut(self, one: int, other: int) -> bool:
        return self.now < self._cut_until and (one in self._cut) != (other in self._cut)


class _Outbox(Struct, frozen=True):
    network: Network
    robot: int

    def send(self, to: int, message: Message) -> None:
        self.network.post(self.robot, to, message)

    def tell(self, message: Message) -> None:
        self.network.post(self.robot, None, message)
