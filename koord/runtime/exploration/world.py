"""The transition system of a few robots and an adversarial network.

The network is the *set* of messages sent so far. A message in it may arrive at any time, any number
of times, or never: this is loss, delay, duplication and reordering at once. Timers run down
whenever they like, since safety must not depend on durations. Robots crash, and come back with
their disk, with an old one, or without; a robot may also be switched on twice.

Robots and messages are numbered, and a robot's step is worked out once: what happens to the whole
is then a look-up in tables.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from enum import Enum
from typing import assert_never

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.exploration.claims import ProposalOf
from koord.runtime.proposals import Attempt, Proposal, Write
from koord.runtime.protocol.events import (
    Arm,
    Begin,
    Commit,
    Disarm,
    Effect,
    Event,
    Expired,
    Install,
    Proposed,
    Received,
    Save,
    Send,
    ShowStore,
    Started,
    StoreShown,
    Tell,
    Timer,
)
from koord.runtime.protocol.machine import step
from koord.runtime.protocol.messages import INCARNATION_STEP, Decide, Held, Message
from koord.runtime.protocol.setup import Setup
from koord.runtime.protocol.state import (
    Canvassing,
    Coordinator,
    Durable,
    State,
    durable,
    fresh,
    put,
    recovered,
    returning,
)

#: Only what changes what can be sent; holding changes nothing for the others.
_TIMERS = frozenset({Timer.DEADLINE, Timer.SILENCE, Timer.RECOVERY})


class Disk(Enum):
    """The disks with which a robot may come back."""

    KEPT = "its disk"
    OLD = "an old disk"
    LOST = "no disk"


class ExplorationBounds(Struct, frozen=True):
    """The bounds of an exploration. Within them it is exhaustive."""

    robots: int = 3
    rounds: int = 1  #: besides INIT
    epoch: int = 2  #: the highest that anybody stands for
    crashes: int = 1
    restarts: int = 0
    disks: frozenset[Disk] = frozenset({Disk.KEPT, Disk.LOST})  #: at restarts
    twins: int = 0  #: robots that are switched on a second time, on another machine
    settled: bool = (
        True  #: begin when all robots have committed INIT, not when they are switched on
    )
    eager: bool = True  #: robots propose as soon as they may; the message can still be late
    resends: bool = False  #: let robots send again what is not answered; it is all there already
    depth: int | None = None  #: so many events; None: to the end
    states: int = 2_000_000  #: give up after so many


class Local(msgspec.Struct, frozen=True):
    """A robot's state (None: it is down) with its timers and its disk.

    ``work`` is the round that it has to propose for. ``older`` are its disk before it was last
    written, and the first. A robot that is ``mute`` has lost its locals, and proposes nothing. One
    that brought back an old disk is not ``trusted``: its recovery ends when all have answered.
    """

    pid: int
    state: State | None
    timers: frozenset[Timer]
    work: int | None
    disk: Durable
    older: tuple[Durable, ...]
    mute: bool = False
    trusted: bool = True


class Parcel(msgspec.Struct, frozen=True):
    """A message in transit."""

    sender: int
    incarnation: int
    to: int
    message: Message


class Act(Enum):
    """The steps of a robot other than receiving a message."""

    WORK = "proposes"
    CRASH = "crashes"
    KEPT = "is back with its disk"
    OLD = "is back with the disk of a moment ago"
    OLDEST = "is back with its first disk"
    LOST = "is back without its disk"
    TWIN = "is switched on a second time"


Cause = int | Timer | Act  #: an ``int`` is the number of the message that arrives


_DISKS = {Act.KEPT: Disk.KEPT, Act.OLD: Disk.OLD, Act.OLDEST: Disk.OLD, Act.LOST: Disk.LOST}


class ProtocolState(msgspec.Struct, frozen=True):
    """A global state: the robots, the set of messages, used-up bounds, committed entries.

    ``locals`` are those of the robots, in their order, and then those of twins.
    """

    locals: tuple[int, ...]
    sent: int = 0
    crashes: int = 0
    restarts: int = 0
    old: int = 0  #: disks that were brought back
    acted: int = 0  #: which history: from INIT on, what anybody has ever committed first


class RobotAction(Struct, frozen=True):
    """The effect of one cause on one robot."""

    local: int
    sent: int
    committed: tuple[Held, ...]


class Transition(Struct, frozen=True):
    """A transition of the global state. ``robot`` is a place in ``locals``."""

    robot: int
    cause: Cause
    world: ProtocolState
    committed: tuple[Held, ...]


def proposal_of(robot: int, round_: int) -> Proposal:
    """The test program: robots 0 and 1 want one lock class; all write different values."""
    write = Write(0, (robot,), round_)
    if round_ < 0:
        return Proposal(robot, round_, (Attempt(None, (write,)),))
    locks = (0,) if robot < 2 else ()
    return Proposal(robot, round_, (Attempt(0, (write,), locks),))


class Explorer:
    """The transition tables, and the transitions that they give."""

    def __init__(
        self, setup: Setup, bounds: ExplorationBounds, propose: ProposalOf = proposal_of
    ) -> None:
        self.setup = setup
        self.bounds = bounds
        self.propose = propose
        self._timers = _TIMERS | {Timer.RESEND} if bounds.resends else _TIMERS
        self.locals: list[Local] = []
        self.parcels: list[Parcel] = []
        self._local_numbers: dict[Local, int] = {}
        self._parcel_numbers: dict[Parcel, int] = {}
        self._to = [0] * setup.robots  #: per robot, the bits of what is sent to it
        self._moves: dict[tuple[int, Cause], RobotAction | None] = {}
        self._histories: list[tuple[Held, ...]] = [()]
        self._longer: dict[tuple[int, Held], int] = {}  #: histories, by what was added to which
        self._rivals: list[int] = []  #: per message, the bits of those that contradict it

    def initial(self) -> ProtocolState:
        """The initial state: all robots have been switched on, at once."""
        world = ProtocolState((-1,) * self.setup.robots)
        for robot in range(self.setup.robots):
            state = fresh(self.setup, robot)
            disk = durable(state)
            started = self._started(Local(robot, state, frozenset(), None, disk, (disk,)))
            world = self._after(world, robot, started)
        return self._settled(world) if self.bounds.settled else world

    def _settled(self, world: ProtocolState) -> ProtocolState:
        """The state after everyone has committed INIT and saved, with no message in transit."""
        while any(state.round < 0 for state in self.states(world)):
            world = next(
                transition.world
                for transition in self.transitions(world)
                if isinstance(transition.cause, int) or transition.cause is Act.WORK
            )
        return replace(world, sent=0, locals=tuple(map(self._all_saved, world.locals)))

    def _all_saved(self, number: int) -> int:
        """The number of a robot's state with all of it on its only disk."""
        local = self.locals[number]
        assert local.state is not None
        disk = durable(local.state)
        return self._number(replace(local, disk=disk, older=(disk,)))

    def transitions(self, world: ProtocolState) -> Iterator[Transition]:
        """Yield all transitions that change the state."""
        for robot, local in enumerate(world.locals):
            if self.locals[local].state is None:
                if world.restarts < self.bounds.restarts:
                    yield from self._restarts(world, robot)
                continue
            for cause in self._causes(world, local):
                move = self._move(local, cause)
                if move is None or (move.local == local and not move.sent & ~world.sent):
                    continue
                yield Transition(robot, cause, self._after(world, robot, move), move.committed)
            if world.crashes < self.bounds.crashes:
                off = put(world.locals, robot, self._number(_down(self.locals[local])))
                crashed = replace(world, locals=off, crashes=world.crashes + 1)
                yield Transition(robot, Act.CRASH, crashed, ())
        if len(world.locals) < self.setup.robots + self.bounds.twins:
            for robot in range(self.setup.robots):
                yield self._twin(world, robot)

    def states(self, world: ProtocolState) -> Iterator[State]:
        """The states of the robots that are up."""
        for local in world.locals:
            state = self.locals[local].state
            if state is not None:
                yield state

    def sent(self, world: ProtocolState) -> Iterator[Parcel]:
        """The messages ever sent."""
        return self.these(world.sent)

    def these(self, messages: int) -> Iterator[Parcel]:
        """The messages of a set of bits."""
        return (self.parcels[number] for number in _bits(messages))

    def acted(self, world: ProtocolState) -> tuple[Held, ...]:
        """The entries first committed by any robot, from INIT on."""
        return self._histories[world.acted]

    def contradiction(self, before: ProtocolState, after: ProtocolState) -> Parcel | None:
        """A message just sent that contradicts an earlier one of its epoch, or None."""
        for number in _bits(after.sent & ~before.sent):
            if self._rivals[number] & after.sent:
                return self.parcels[number]
        return None

    def tell(self, robot: int, cause: Cause) -> str:
        """Describe a transition in one line."""
        match cause:
            case int(number):
                parcel = self.parcels[number]
                return f"{robot} gets from {parcel.sender}: {parcel.message}"
            case Timer() as timer:
                return f"{robot}: {timer.value} runs down"
            case Act() as act:
                return f"{robot} {act.value}"
            case _:
                assert_never(cause)

    # --- one robot ------------------------------------------------------------------------------

    def _causes(self, world: ProtocolState, local: int) -> Iterator[Cause]:
        one = self.locals[local]
        yield from _bits(world.sent & self._to[one.pid])
        yield from (
            timer
            for timer in Timer
            if timer in one.timers and (one.trusted or timer is not Timer.RECOVERY)
        )
        if one.work is not None:
            yield Act.WORK

    def _move(self, number: int, cause: Cause) -> RobotAction | None:
        key = (number, cause)
        if key not in self._moves:
            self._moves[key] = self._worked_out(self.locals[number], cause)
        return self._moves[key]

    def _worked_out(self, local: Local, cause: Cause) -> RobotAction | None:
        state = local.state
        assert state is not None
        over = state.round >= self.bounds.rounds
        match cause:
            case int(number):
                parcel = self.parcels[number]
                event: Event = Received(0.0, parcel.sender, parcel.incarnation, parcel.message)
            case Timer() as timer:
                if over and timer is Timer.DEADLINE:
                    return None
                local = replace(local, timers=local.timers - {timer})
                event = Expired(0.0, timer)
            case Act.WORK:
                assert local.work is not None
                if over:
                    return None
                event = Proposed(0.0, self.propose(state.pid, local.work))
                local = replace(local, work=None)
            case _:
                raise AssertionError(cause)
        return self._stepped(local, event)

    def _stepped(self, local: Local, event: Event) -> RobotAction | None:
        assert local.state is not None
        state, effects = step(self.setup, local.state, event)
        local = replace(local, state=state)
        sent = 0
        committed: list[Held] = []
        for effect in effects:
            if isinstance(effect, Commit):
                committed.append(next(h for h in state.log if h.entry is effect.entry))
            elif isinstance(effect, ShowStore):
                shown = StoreShown(0.0, effect.to, state.round, b"")
                after, more = step(self.setup, state, shown)
                local = replace(local, state=after)
                for extra in more:
                    local, bits = self._carried_out(local, extra)
                    sent |= bits
            else:
                local, bits = self._carried_out(local, effect)
                sent |= bits
        if _highest_epoch(state) > self.bounds.epoch:
            return None
        move = RobotAction(self._number(local), sent, tuple(committed))
        return self._with_work(local, move) if self.bounds.eager else move

    def _with_work(self, local: Local, move: RobotAction) -> RobotAction:
        """The robot's step, followed by its own proposal if one is due."""
        assert local.state is not None
        if local.work is None or local.state.round >= self.bounds.rounds:
            return move
        worked = self._worked_out(local, Act.WORK)
        assert worked is not None
        return RobotAction(worked.local, move.sent | worked.sent, move.committed + worked.committed)

    def _carried_out(self, local: Local, effect: Effect) -> tuple[Local, int]:
        state = local.state
        assert state is not None
        match effect:
            case Save():
                return self._saved(local, state), 0
            case Send(to=to, message=message):
                return local, self._post(state, (to,), message)
            case Tell(message=message):
                others = (i for i in range(self.setup.robots) if i != state.pid)
                return local, self._post(state, others, message)
            case Arm(timer=timer) if timer in self._timers:
                return replace(local, timers=local.timers | {timer}), 0
            case Disarm(timer=timer):
                return replace(local, timers=local.timers - {timer}), 0
            case Begin(round=round_):
                return replace(local, work=None if local.mute else round_), 0
            case Install():
                return replace(local, work=None), 0
            case _:
                return local, 0

    def _saved(self, local: Local, state: State) -> Local:
        """The robot after it has written to its disk. (R-SAVE)"""
        older = local.older
        if Disk.OLD in self.bounds.disks:
            older = tuple(dict.fromkeys((older[0], local.disk)))
        return replace(local, disk=durable(state), older=older)

    def _post(self, state: State, to: Iterable[int], message: Message) -> int:
        bits = 0
        for robot in to:
            parcel = Parcel(state.pid, state.incarnation, robot, message)
            number = self._parcel_numbers.get(parcel)
            if number is None:
                number = self._parcel_numbers[parcel] = len(self.parcels)
                self.parcels.append(parcel)
                self._to[robot] |= 1 << number
                self._rivals.append(self._rivals_of(parcel, number))
            bits |= 1 << number
        return bits

    def _rivals_of(self, parcel: Parcel, number: int) -> int:
        """The messages so far that are of another entry for the same epoch and round."""
        mine, found = parcel.message, 0
        if isinstance(mine, Decide):
            for other, one in enumerate(self.parcels[:number]):
                its = one.message
                if (
                    isinstance(its, Decide)
                    and (its.epoch, its.entry.round) == (mine.epoch, mine.entry.round)
                    and its.entry != mine.entry
                ):
                    found |= 1 << other
                    self._rivals[other] |= 1 << number
        return found

    def _number(self, local: Local) -> int:
        """The number of a robot's state, without details that make no difference."""
        if local.state is not None:
            state = replace(local.state, tries=0, holding=None)
            if isinstance(state.office, Coordinator):
                # Being heard keeps a coordinator in office; so does a timer that does not expire.
                state = replace(state, office=replace(state.office, heard=0))
            local = replace(local, state=state)
        number = self._local_numbers.get(local)
        if number is None:
            number = self._local_numbers[local] = len(self.locals)
            self.locals.append(local)
        return number

    # --- the whole ------------------------------------------------------------------------------

    def _started(self, local: Local) -> RobotAction:
        move = self._stepped(local, Started(0.0))
        assert move is not None
        return move

    def _restarts(self, world: ProtocolState, robot: int) -> Iterator[Transition]:
        """Yield the ways in which a robot may be back; an old disk is brought back once."""
        down = self.locals[world.locals[robot]]
        start = world.restarts + 1
        written = {Act.KEPT: down.disk, Act.OLD: down.older[-1], Act.OLDEST: down.older[0]}
        for act, disk in _DISKS.items():
            if disk not in self.bounds.disks or (disk is Disk.OLD and (world.old or down.mute)):
                continue
            if disk is Disk.LOST:
                back = self._without_disk(down.pid, start)
            else:
                state = recovered(self.setup, down.pid, written[act], start)
                trusted = disk is Disk.KEPT and down.trusted
                back = replace(down, state=state, disk=written[act], trusted=trusted)
            after = self._after(world, robot, self._started(back))
            old = world.old + (disk is Disk.OLD)
            yield Transition(robot, act, replace(after, restarts=start, old=old), ())

    def _twin(self, world: ProtocolState, pid: int) -> Transition:
        """A second process with a pid, which has no disk."""
        start = self.bounds.restarts + len(world.locals)
        widened = replace(world, locals=(*world.locals, -1))
        move = self._started(self._without_disk(pid, start))
        return Transition(
            len(world.locals), Act.TWIN, self._after(widened, len(world.locals), move), ()
        )

    def _without_disk(self, pid: int, start: int) -> Local:
        state = returning(self.setup, pid, start * INCARNATION_STEP)
        disk = durable(state)
        return Local(pid, state, frozenset(), None, disk, (disk,), mute=True)

    def _after(self, world: ProtocolState, robot: int, move: RobotAction) -> ProtocolState:
        acted = world.acted
        for held in move.committed:
            history = self._histories[acted]
            if held.round + 1 != len(history):
                continue
            key = (acted, held)
            if key not in self._longer:
                self._longer[key] = len(self._histories)
                self._histories.append((*history, held))
            acted = self._longer[key]
        locals_ = put(world.locals, robot, move.local)
        return replace(world, locals=locals_, sent=world.sent | move.sent, acted=acted)


def _highest_epoch(state: State) -> int:
    standing = state.office.epoch if isinstance(state.office, Canvassing) else 0
    return max(state.promised, standing)


def _down(local: Local) -> Local:
    """A robot after a crash: only its disk is left."""
    return replace(local, state=None, timers=frozenset(), work=None)


def _bits(number: int) -> Iterator[int]:
    while number:
        lowest = number & -number
        yield lowest.bit_length() - 1
        number ^= lowest
