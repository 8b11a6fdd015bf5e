"""A member of the protocol: a compiled robot with its store and journal. (R-BEGIN) (R-COMMIT)
(R-SNAPSHOT)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import msgspec

from koord.runtime.buffers import Buffer, Written
from koord.runtime.compile.watching import Watched
from koord.runtime.deploy.attributes import own_shapes, own_values
from koord.runtime.deploy.journal import (
    AnyRecord,
    Attributes,
    Checkpoint,
    Committed,
    DamagedError,
    Entered,
    Journal,
    Page,
    Recollection,
    Start,
    Vow,
)
from koord.runtime.deploy.preflight import Check
from koord.runtime.deploy.watching import RobotMonitor, RobotState
from koord.runtime.drivers.frames import LEVEL, Quaternion
from koord.runtime.encoding import decoder, encode
from koord.runtime.guardian.events import Order
from koord.runtime.motion.world import Point
from koord.runtime.operations import FaultError
from koord.runtime.orders.hearing import Obeyed
from koord.runtime.proposals import (
    INIT_ROUND,
    Admitted,
    Attempt,
    Decision,
    EventFault,
    Faulted,
    Proposal,
    StopRequests,
    decide,
    rotating,
)
from koord.runtime.protocol.committing import admitted_of
from koord.runtime.protocol.events import Reason
from koord.runtime.protocol.messages import Beacon, LastRun, LogEntry, Tentative
from koord.runtime.protocol.state import Durable, State, durable
from koord.runtime.robot import AnsweringHost, Robot, Status
from koord.runtime.shapes import ShapeError, from_plain
from koord.runtime.store import AgreedStore, is_digested

_STATUSES = {StopRequests.TO_STOP: Status.STOPPED, StopRequests.TO_STOP_TOGETHER: Status.ASKED}

_STORE = decoder(tuple[tuple[Any, ...], tuple[int, ...], EventFault | None])


#: How long a vehicle may take to come to its last stop before it is let go of all the same.
LANDING_S = 20.0


class DivergedError(Exception):
    """Raised where the store differs from the decision's digest: an error in koord or in memory."""


class Platform(AnsweringHost, Protocol):
    """The host of a deployed robot, which has a position and can be held there."""

    position: Point
    holding: bool

    def acted(self, robot: Robot) -> None:
        """Carry out what actuators say, now that a decision has let the robot act."""
        ...

    def tick(self, now_s: float, round_age_s: float | None, reason: Reason | None) -> float:
        """Take a step of control, if one is due; return when the next one is, inf: never.

        ``round_age_s`` is since the last commit, None before any; ``reason`` is why it is held.
        """
        ...

    def wait_with(self, meanwhile: Callable[[], float]) -> None:
        """Let this be done while a turn of the program takes long; it returns when it is due next.

        That is in so many seconds. (P-PLAN)
        """
        ...

    def beacon(self, now_s: float) -> Beacon | None:
        """What other robots should know of the vehicle now, if it is time to say it. (P-BEACON)"""
        ...

    def hear(self, sender: int, beacon: Beacon, now_s: float) -> None:
        """Take note of what another robot says of its vehicle."""
        ...

    def order(self, order: Order, now_s: float) -> Obeyed:
        """Do what people say, at once. (O-AT-ONCE)"""
        ...

    def alive(self, at_s: float) -> None:
        """Take note that people were there, with the e-stop in their hands. (O-ALIVE)"""
        ...

    def stop(self, now_s: float) -> None:
        """Begin to come to a safe stop for good, in the steps that follow."""
        ...

    def checks(self) -> tuple[Check, ...]:
        """What is found of the vehicle, before it is armed. (P-PREFLIGHT)"""
        ...

    @property
    def state(self) -> str:
        """How the vehicle is doing, in few words."""
        ...

    @property
    def attitude(self) -> Quaternion:
        """The attitude of the vehicle, w first."""
        ...

    @property
    def path(self) -> tuple[Point, ...]:
        """The path that the vehicle follows."""
        ...

    @property
    def is_at_rest(self) -> bool:
        """True if the vehicle stands on the ground, and does not move any more."""
        ...

    @property
    def remarks(self) -> tuple[str, ...]:
        """What people should know of the vehicle now."""
        ...

    def close(self) -> None:
        """Let go of the vehicle, after the last step."""
        ...


_BODILESS = "a point, without a vehicle"


class Untimed:
    """What moves robots by reckoning, whenever their sensors are read."""

    attitude: Quaternion = LEVEL
    path: tuple[Point, ...] = ()
    is_at_rest = True
    remarks: tuple[str, ...] = ()
    state = _BODILESS

    def also_answer(self, program: type[Robot]) -> None:
        pass

    def acted(self, robot: Robot) -> None:
        pass

    def wait_with(self, meanwhile: Callable[[], float]) -> None:
        pass

    def tick(self, now_s: float, round_age_s: float | None, reason: Reason | None) -> float:
        return math.inf

    def beacon(self, now_s: float) -> Beacon | None:
        return None

    def hear(self, sender: int, beacon: Beacon, now_s: float) -> None:
        pass

    def order(self, order: Order, now_s: float) -> Obeyed:
        return Obeyed(_BODILESS)

    def alive(self, at_s: float) -> None:
        pass

    def checks(self) -> tuple[Check, ...]:
        return ()

    def stop(self, now_s: float) -> None:
        pass

    def close(self) -> None:
        pass


class Member:
    """A member: a robot with its program, its copy of the store, and its journal."""

    def __init__(self, robot: Robot, host: Platform) -> None:
        """Make a member; others may listen in between what its program asks and its ``host``."""
        self.robot = robot
        self.host = host
        self.store = AgreedStore(robot.SHARED, robot.numAgents)
        self.statuses = [Status.RUNNING] * robot.numAgents
        self.run = b""  #: the identity of the run, once it takes part in one
        self.round = INIT_ROUND  #: the first round that it has not acted on
        self.mute = False  #: it has lost its locals, and can only hold what others decide
        self.holding: Reason | None = None
        self.fault: EventFault | None = None
        self.output: list[Written] = []  #: not yet shown
        self.seen: Callable[[LogEntry, Admitted | None], None] = _nobody
        self.tell: Callable[[LogEntry], Any] = _nothing  #: what is to be said of a round besides
        self.unwritable: str | None = None  #: why its journal cannot be written
        self.monitor: RobotMonitor | None = None
        self.is_alone = False  #: nobody hears here what the others tell of their states
        self.state: RobotState | None = None  #: when the round began that was proposed for last
        self.tells_states = True  #: somebody wants to know them
        self._journal: Journal | None = None
        self._identity: tuple[Entered, Start] | None = None
        self._unwritten: list[AnyRecord] = []
        self._is_rewritten = False  #: the journal needs a checkpoint
        self._turns = 0
        self._proposal: Proposal | None = None
        self._written: tuple[Proposal | None, Tentative | None] = (None, None)

    # --- rounds ---------------------------------------------------------------------------------

    def propose(self, round_: int) -> Proposal | None:
        """Sense, run the first enabled event into a buffer, and propose."""
        before = self._proposal
        if self.mute or round_ < self.round:
            return None
        if before is not None and before.round >= round_:
            return before if before.round == round_ else None
        fault = self._begin() if round_ == INIT_ROUND else self._sense()
        if fault is None and round_ != INIT_ROUND:
            self._observe(round_)
        if fault is not None:
            made = Proposal(self.robot.pid, round_, (Attempt(None, fault=fault),))
        elif round_ == INIT_ROUND:
            made = self.robot.propose_init()
        else:
            made = self.robot.propose(round_)
        self._proposal = made
        return made

    def _begin(self) -> EventFault | None:
        """Declare the allwrite variables before any robot's INIT. [INIT]"""
        robot = self.robot
        try:
            robot.declare()
        except FaultError as error:
            return robot.located(error.fault)
        self.store.declare(vars(robot))
        vars(robot).update(self.store.values)
        return None

    def _sense(self) -> EventFault | None:
        """Take the environment's turns since the last program turn. [ENV-TRANS]"""
        while self._turns:
            self._turns -= 1
            fault = self._evolve()
            if fault is not None:
                return self.robot.located(fault)
        return None

    def _evolve(self) -> EventFault | None:
        """Take one turn of the environment."""
        robot, monitor = self.robot, self.monitor
        is_watched = monitor is not None and monitor.has_contracts
        held = dict(vars(robot)) if is_watched else {}
        fault = robot.evolve(robot.host.read(robot))
        if monitor is not None and is_watched and fault is None:
            monitor.evolved(held, self.round - 1 - self._turns)
        return fault

    def _observe(self, round_: int) -> None:
        """Look at the state when a round begins. (P-WATCH)"""
        if self.monitor is not None:
            self.monitor.begun(round_, self.store.values)
            if self.tells_states:
                self.state = RobotState.of(self.robot, round_, self.store, is_alone=self.is_alone)

    def watch(self, watched: Watched, kinds: int) -> None:
        """Watch the claims that the robot, of one of so many kinds, can judge by itself."""
        self.monitor = RobotMonitor(watched, self.robot, self.host, kinds)

    def commit(self, entry: LogEntry, kept: Admitted | None) -> None:
        """Act on a decision. [SHARED-ASSIGN] [SKIP] [STOP]"""
        is_new = entry.round >= self.round
        self._apply(entry, kept)
        self._note_commit(entry)
        if is_new:
            self.seen(entry, kept)

    def _apply(self, entry: LogEntry, kept: Admitted | None) -> None:
        decision = entry.decision
        if decision.fault is not None:
            self._end(decision.fault, kept)
            return
        if entry.round == INIT_ROUND and self._proposal is None:
            self._begin()
        changed = self.store.apply(decision.writes)
        if decision.digest and decision.digest != self.store.digest():
            raise DivergedError(f"the store differs after round {entry.round}")
        self._note_statuses(decision)
        if entry.round < self.round:  # acted on before a crash
            self.robot.refresh(changed)
            return
        if kept is not None and not self.has_proposed(entry.round):
            self.mute = True  # it was let through with something that it no longer knows
        self._act(kept, changed)
        self._after(entry.round)

    def _end(self, faulted: Faulted, kept: Admitted | None) -> None:
        """End the run; output up to a fault is written. [FAULT] [OUTPUT]"""
        self.fault = faulted.fault
        if not self.mute and kept is not None:
            self.output += self.robot.outcome(kept.event)
        elif not self.mute and faulted.robot == self.robot.pid:
            self.output += self.robot.outcome(faulted.event)

    def _act(self, kept: Admitted | None, changed: dict[str, Any]) -> None:
        if kept is None or self.mute:
            self.robot.discard(changed)
            return
        self.output += self.robot.commit(kept.event, changed)
        self.host.acted(self.robot)

    def _after(self, round_: int) -> None:
        if round_ != INIT_ROUND:
            self._turns += 1
        self._at(round_ + 1)

    def _at(self, round_: int) -> None:
        """Note that all rounds before this one have been acted on."""
        self.round = round_
        self.robot.status = self.statuses[self.robot.pid]

    def _note_statuses(self, decision: Decision) -> None:
        """Update the statuses of robots. [STOP] [END-PROG]"""
        is_changed = False
        for taken in decision.ran:
            if taken.asked is StopRequests.NOTHING:
                continue
            if self.statuses[taken.robot] is not Status.STOPPED:
                self.statuses[taken.robot] = _STATUSES[taken.asked]
                is_changed = True
        if is_changed and Status.RUNNING not in self.statuses:
            self.statuses = [Status.STOPPED] * len(self.statuses)

    def has_proposed(self, round_: int) -> bool:
        """Return whether the robot has run an event for a round, or found none to run."""
        return self._proposal is not None and self._proposal.round == round_

    @property
    def all_stopped(self) -> bool:
        """True if all robots have stopped."""
        own = self.statuses[self.robot.pid]  # of most it is known by their own
        return own is Status.STOPPED and all(one is Status.STOPPED for one in self.statuses)

    def hold(self, reason: Reason | None) -> None:
        """Come to a safe stop for a reason; None: go on."""
        self.holding = reason
        self.host.holding = reason is not None

    def decided(self, round_: int, proposals: Sequence[Proposal | None]) -> Decision:
        """Decide a round, now and then with the digest of the store after it."""
        there = {robot: p for robot, p in enumerate(proposals) if p is not None}
        robots = len(proposals)
        decision = decide(round_, there, rotating(max(round_, 0), robots))
        if not is_digested(round_, robots) or decision.fault is not None:
            return decision
        try:
            after = self.store.digest_after(decision.writes)
        except ShapeError:
            return decision  # told where it is applied
        return Decision(decision.round, decision.ran, decision.skipped, decision.writes, after)

    # --- coming back ----------------------------------------------------------------------------

    def show(self) -> bytes:
        statuses = tuple(status.value for status in self.statuses)
        return encode((self.store.snapshot(), statuses, self.fault))

    def install(self, round_: int, store: bytes, ran: LastRun | None) -> None:
        """Replace the store; ``ran`` says which of the robot's own turns happened."""
        self._restore(store)
        self._is_rewritten = True
        self._unwritten.clear()
        changed = dict(self.store.values)
        mine = self._proposal
        if round_ <= self.round:
            # The pending proposal may yet be let through, and the journal has no shared variables.
            self.robot.refresh(changed)
            return
        missed = round_ - max(self.round, 0)
        if mine is not None and ran is not None and ran.round == mine.round >= self.round:
            self._act(Admitted(self.robot.pid, ran.event), changed)
            if mine.round < round_ - 1:
                self.robot.discard({})  # and it skipped since
        elif ran is not None and ran.round >= self.round:
            self.mute = True  # it was let through with something that it no longer knows
        else:
            self.robot.discard(changed)
        self._turns += missed
        self._at(round_)

    def _restore(self, store: bytes) -> None:
        snapshot, statuses, self.fault = _STORE.decode(store)
        self.store.restore(snapshot)
        self.statuses = [Status(status) for status in statuses]

    def recall(self, what: Recollection) -> None:
        """Be where the journal says that the robot was. (R-RESUME) Raises DamagedError."""
        page = what.page
        try:
            if what.checkpoint is not None:
                self._restore(what.checkpoint.store)
                self.mute = what.checkpoint.mute
                self._at(what.checkpoint.round)
            for entry in what.entries:
                if page is not None and entry.round >= page.round:
                    self._take_up(page)
                    page = None
                self._apply(entry, admitted_of(entry, self.robot.pid) if page is None else None)
            if page is not None:
                self._take_up(page)
            elif what.page is None and self.round > INIT_ROUND:
                self.mute = True
        except (ShapeError, ValueError, KeyError, DivergedError, msgspec.MsgspecError) as error:
            raise DamagedError(f"it does not fit the program: {error}") from None
        self.output.clear()  # it was written before the crash
        self._written = (self._proposal, None)

    def _take_up(self, page: Page) -> None:
        """Be as before the last proposal, which may still be let through."""
        robot = self.robot
        if page.round == INIT_ROUND:
            self._begin()
        vars(robot).update(self._attributes(page.attributes))
        vars(robot).update(self.store.values)
        robot._buffers = {event: self._buffer(event, plain) for event, plain in page.buffers}
        robot.status = Status(page.status)
        self.round, self._turns, self._proposal = page.round, page.turns, page.proposal
        self.host.position = page.position

    def finish(self) -> None:
        """Do what is to be done when the robot leaves the run in good order."""

    def forget(self) -> None:
        """Forget the journal: the run is over."""
        if self._journal is not None:
            self._journal.forget()

    # --- the journal ----------------------------------------------------------------------------

    def keep(self, journal: Journal, entered: Entered, start: Start) -> None:
        """Keep a journal from now on, which says that the robot has entered a run."""
        self._journal, self._identity = journal, (entered, start)

    @property
    def written(self) -> int:
        """The bytes that its disk was given for its journal."""
        return 0 if self._journal is None else self._journal.written

    def save(self, state: State) -> bool:
        """Write what messages may speak of; return whether it is on the disk. (R-SAVE)"""
        journal, identity = self._journal, self._identity
        if journal is None or identity is None:
            return True
        kept = durable(state)
        held = kept.tentative
        tentative = None if held is None else Tentative(held.epoch, held.entry)
        vow = Vow(kept.incarnation, kept.promised, tentative)
        try:
            if (self._is_rewritten or journal.is_long) and kept.round == self.round:
                journal.begin(*identity, self._checkpoint(kept), vow, *self._page())
                self._is_rewritten = False
            else:
                new = self._page() if self._proposal is not self._written[0] else ()
                journal.add(*self._unwritten, *new, vow)
        except OSError as error:
            self.unwritable = error.strerror or str(error)
            return False
        self.unwritable = None
        self._unwritten.clear()
        self._written = (self._proposal, tentative)
        return True

    def _checkpoint(self, kept: Durable) -> Checkpoint:
        return Checkpoint(
            kept.round,
            kept.chain,
            kept.roster,
            kept.last_ran,
            self.show(),
            kept.ended,
            self.mute,
        )

    def _note_commit(self, entry: LogEntry) -> None:
        """Write a commit, which need not be on the disk at once."""
        journal = self._journal
        if journal is None or self._is_rewritten:
            return
        told = self._written[1]
        known = told is not None and told.entry == entry
        self._unwritten.append(Committed(None if known else entry))
        try:
            journal.add(*self._unwritten, sync=False)
        except OSError:
            return  # it is written with what is next
        self._unwritten.clear()

    def _page(self) -> tuple[Page, ...]:
        """The robot itself, unless it is mute."""
        if self.mute:
            return ()
        robot, proposal = self.robot, self._proposal
        pending = proposal is not None and proposal.round >= self.round
        buffers = robot._buffers.items() if pending else ()
        page = Page(
            self.round,
            robot.status.value,
            self._turns,
            own_values(robot, vars(robot)),
            self.host.position,
            proposal,
            tuple((event, own_values(robot, b.state)) for event, b in buffers if b.state),
        )
        return (page,)

    def _attributes(self, plain: Attributes) -> dict[str, Any]:
        own, robots = own_shapes(self.robot), self.robot.numAgents
        return {
            name: from_plain(shape, value, robots, unset=True)
            for (name, shape), value in zip(own.items(), plain, strict=True)
        }

    def _buffer(self, event: int | None, plain: Attributes) -> Buffer:
        buffer = Buffer(event)
        buffer.state = {**vars(self.robot), **self._attributes(plain)}
        return buffer


def _nobody(entry: LogEntry, kept: Admitted | None) -> None:
    """Ignore a commit: the default observer."""


def _nothing(entry: LogEntry) -> None:
    """Add nothing to a round's report: the default note."""
