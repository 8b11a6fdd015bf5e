"""Robots whose messages and timers a test moves by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from koord.runtime.exploration.world import proposal_of
from koord.runtime.proposals import Proposal
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
from koord.runtime.protocol.messages import LogEntry, Message
from koord.runtime.protocol.setup import Setup, Timing
from koord.runtime.protocol.state import Durable, State, durable, fresh, recovered, returning


@dataclass(frozen=True, slots=True)
class Parcel:
    sender: int
    incarnation: int
    to: int
    message: Message


@dataclass(slots=True)
class Fleet:
    """All robots of a run. ``mail`` is what was sent and has not been moved yet."""

    setup: Setup
    states: dict[int, State] = field(default_factory=dict)
    mail: list[Parcel] = field(default_factory=list)
    datagrams: int = 0  #: sent, a message to all counted once
    acted: dict[int, list[LogEntry]] = field(default_factory=dict)
    kept: dict[int, list[int]] = field(default_factory=dict)
    timers: dict[int, dict[Timer, float]] = field(default_factory=dict)
    work: dict[int, int | None] = field(default_factory=dict)
    holds: dict[int, list[Reason | None]] = field(default_factory=dict)
    over: list[int] = field(default_factory=list)  #: those that were told that the run is
    effects: list[Effect] = field(default_factory=list)  #: of the last step
    disks: dict[int, Durable] = field(default_factory=dict)  #: what robots have saved
    now: float = 0.0

    def on(self, robot: int, state: State) -> None:
        """Switch a robot on."""
        self.states[robot] = state
        self.timers[robot] = {}
        self.work[robot] = None
        for table in (self.acted, self.kept):
            table.setdefault(robot, [])
        self.holds.setdefault(robot, [])
        self.do(robot, Started(self.now))

    def back(self, robot: int, incarnation: int) -> None:
        """Switch a robot on that has lost its journal."""
        self.on(robot, returning(self.setup, robot, incarnation))

    def resume(self, robot: int, start: int = 2, disk: Durable | None = None) -> None:
        """Switch a robot on that has its journal, or an old one."""
        kept = self.disks[robot] if disk is None else disk
        self.on(robot, recovered(self.setup, robot, kept, start))

    def off(self, robot: int) -> None:
        del self.states[robot]

    def do(self, robot: int, event: Event) -> None:
        self.states[robot], effects = step(self.setup, self.states[robot], event)
        self.effects = list(effects)
        for effect in effects:
            self._carry_out(robot, effect)

    def _carry_out(self, robot: int, effect: Effect) -> None:
        match effect:
            case Send(to=to, message=message):
                self.datagrams += 1
                self._post(robot, to, message)
            case Tell(message=message):
                self.datagrams += 1
                for other in range(self.setup.robots):
                    if other != robot:
                        self._post(robot, other, message)
            case Arm(timer=timer, after_s=after_s):
                self.timers[robot][timer] = self.now + after_s
            case Disarm(timer=timer):
                self.timers[robot].pop(timer, None)
            case Begin(round=round_):
                self.work[robot] = round_
            case Commit(entry=entry, kept=kept):
                self.acted[robot].append(entry)
                if kept is not None:
                    self.kept[robot].append(entry.round)
            case ShowStore(to=to):
                shown = StoreShown(self.now, to, self.states[robot].round, b"")
                self.do(robot, shown)
            case Hold(reason=reason):
                self.holds[robot].append(reason)
            case Resume():
                self.holds[robot].append(None)
            case Install():
                self.work[robot] = None
            case RunEnded():
                self.over.append(robot)
            case Save():
                self.disks[robot] = durable(self.states[robot])

    def _post(self, sender: int, to: int, message: Message) -> None:
        self.mail.append(Parcel(sender, self.states[sender].incarnation, to, message))

    # --- what tests do --------------------------------------------------------------------------

    def propose(self, robot: int, proposal: Proposal | None = None) -> None:
        """Let a robot make the proposal that it was asked for, or another."""
        round_ = self.work[robot]
        if proposal is None:
            assert round_ is not None
            proposal = proposal_of(robot, round_)
        self.work[robot] = None
        self.do(robot, Proposed(self.now, proposal))

    def fire(self, robot: int, timer: Timer) -> None:
        assert timer in self.timers[robot], f"{timer} of {robot} is not armed"
        del self.timers[robot][timer]
        self.do(robot, Expired(self.now, timer))

    def deliver(
        self, chosen: Callable[[Parcel], bool] = lambda _: True, *, keep: bool = False
    ) -> int:
        """Deliver what is chosen of the mail that is there now, and say how much that was."""
        parcels = [parcel for parcel in self.mail if chosen(parcel)]
        if not keep:
            self.mail = [parcel for parcel in self.mail if not chosen(parcel)]
        for parcel in parcels:
            if parcel.to in self.states:
                self.do(
                    parcel.to,
                    Received(self.now, parcel.sender, parcel.incarnation, parcel.message),
                )
        return len(parcels)

    def of(self, kind: type[Message], sender: int | None = None, to: int | None = None) -> bool:
        """Deliver messages of a kind only; whether there were any."""
        return bool(
            self.deliver(
                lambda p: (
                    isinstance(p.message, kind)
                    and sender in (None, p.sender)
                    and to in (None, p.to)
                )
            )
        )

    def lose(self, chosen: Callable[[Parcel], bool] = lambda _: True) -> None:
        self.mail = [parcel for parcel in self.mail if not chosen(parcel)]

    def run_round(self) -> None:
        """A round in which nothing is lost or late."""
        for robot, round_ in self.work.items():
            if robot in self.states and round_ is not None:
                self.propose(robot)
        self.settle()

    def settle(self) -> None:
        """Deliver everything, and what comes of it."""
        while self.deliver():
            pass

    def settle_without(self, deaf: int) -> None:
        """Deliver everything but what is for one robot, which is lost."""
        self.lose(lambda p: p.to == deaf)
        while self.deliver():
            self.lose(lambda p: p.to == deaf)

    @property
    def rounds(self) -> list[int]:
        """The round that each robot is at."""
        return [state.round for _, state in sorted(self.states.items())]


def fleet(
    robots: int = 3,
    timing: Timing | None = None,
    owing: frozenset[int] = frozenset(),
    rounds: int | None = None,
    kept: int = 64,
) -> Fleet:
    """Robots that have been switched on."""
    chosen = timing if timing is not None else Timing.of(0.1, robots)
    made = Fleet(Setup(robots, chosen, owing, rounds, kept=kept))
    for robot in range(robots):
        made.on(robot, fresh(made.setup, robot))
    return made


def begun(robots: int = 3, **settings: object) -> Fleet:
    """Robots that have committed INIT."""
    made = fleet(robots, **settings)  # type: ignore[arg-type]
    made.run_round()
    assert made.rounds == [0] * robots
    made.mail.clear()
    return made
