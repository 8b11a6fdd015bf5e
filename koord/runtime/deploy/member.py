"""A member of the protocol: a compiled robot with its store and journal. (R-BEGIN) (R-COMMIT)
(R-SNAPSHOT)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from koord.runtime.buffers import Buffer, Written
from koord.runtime.deploy.journal import Attributes, Journal, Page
from koord.runtime.encoding import decoder, encode
from koord.runtime.motion.world import Point
from koord.runtime.operations import FaultError
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
from koord.runtime.protocol.events import Reason
from koord.runtime.protocol.messages import LastRun, LogEntry
from koord.runtime.robot import Host, Robot, Status
from koord.runtime.shapes import ShapeError, from_plain, to_plain
from koord.runtime.store import AgreedStore

_STATUSES = {StopRequests.TO_STOP: Status.STOPPED, StopRequests.TO_STOP_TOGETHER: Status.ASKED}

_STORE = decoder(tuple[tuple[Any, ...], tuple[int, ...], EventFault | None])


class DivergedError(Exception):
    """Raised where the store differs from the decision's digest: an error in koord or in memory."""


class Platform(Host, Protocol):
    """The host of a deployed robot, which has a position and can be held there."""

    position: Point
    holding: bool


class Member:
    """A member: a robot with its program, its copy of the store, and its journal."""

    def __init__(self, robot: Robot, host: Platform, journal: Journal | None, program: str) -> None:
        """Make a member; ``program`` is the digest that its journal has to have."""
        self.robot = robot
        self.host = host
        self.store = AgreedStore(robot.SHARED, robot.numAgents)
        self.statuses = [Status.RUNNING] * robot.numAgents
        self.round = INIT_ROUND  #: the first round that it has not acted on
        self.mute = False  #: it has lost its locals, and can only hold what others decide
        self.holding: Reason | None = None
        self.fault: EventFault | None = None
        self.output: list[Written] = []  #: not yet shown
        self.seen: Callable[[LogEntry, Admitted | None], None] = _nobody
        self.tell: Callable[[LogEntry], Any] = _nothing  #: what is to be said of a round besides
        self._journal = journal
        self._program = program
        self._turns = 0
        self._proposal: Proposal | None = None

    # --- rounds ---------------------------------------------------------------------------------

    def propose(self, round_: int) -> Proposal | None:
        """Sense, run the first enabled event into a buffer, write the journal, and propose."""
        before = self._proposal
        if self.mute or round_ < self.round:
            return None
        if before is not None and before.round >= round_:
            return before if before.round == round_ else None
        fault = self._begin() if round_ == INIT_ROUND else self._sense()
        if fault is not None:
            made = Proposal(self.robot.pid, round_, (Attempt(None, fault=fault),))
        elif round_ == INIT_ROUND:
            made = self.robot.propose_init()
        else:
            made = self.robot.propose(round_)
        self._proposal = made
        self._write_down()
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
            fault = self.robot.evolve(self.host.read(self.robot))
            if fault is not None:
                return self.robot.located(fault)
        return None

    def commit(self, entry: LogEntry, kept: Admitted | None) -> None:
        """Act on a decision. [SHARED-ASSIGN] [SKIP] [STOP]"""
        decision = entry.decision
        if decision.fault is not None:
            self._end(decision.fault, kept)
            self.seen(entry, kept)
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
        self._act(kept, changed)
        self._after(entry.round)
        self.seen(entry, kept)

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
        for taken in decision.ran:
            asked = _STATUSES.get(taken.asked)
            if asked is not None and self.statuses[taken.robot] is not Status.STOPPED:
                self.statuses[taken.robot] = asked
        if Status.RUNNING not in self.statuses:
            self.statuses = [Status.STOPPED] * len(self.statuses)

    def has_proposed(self, round_: int) -> bool:
        """Return whether the robot has run an event for a round, or found none to run."""
        return self._proposal is not None and self._proposal.round == round_

    @property
    def all_stopped(self) -> bool:
        """True if all robots have stopped."""
        return all(status is Status.STOPPED for status in self.statuses)

    def hold(self, reason: Reason | None) -> None:
        """Come to a safe stop for a reason; None: go on."""
        self.holding = reason
        self.host.holding = reason is not None

    def decided(self, round_: int, proposals: Sequence[Proposal | None]) -> Decision:
        """Decide a round, now and then with the digest of the store after it."""
        there = {robot: p for robot, p in enumerate(proposals) if p is not None}
        robots = len(proposals)
        decision = decide(round_, there, rotating(max(round_, 0), robots))
        if round_ == INIT_ROUND or round_ % (1 + robots // 16) or decision.fault is not None:
            return decision
        after = AgreedStore(self.store.layout, robots)
        after.values = dict(self.store.values)
        try:
            after.apply(decision.writes)
        except ShapeError:
            return decision  # told where it is applied
        return Decision(
            decision.round, decision.ran, decision.skipped, decision.writes, after.digest()
        )

    # --- coming back ----------------------------------------------------------------------------

    def show(self) -> bytes:
        statuses = tuple(status.value for status in self.statuses)
        return encode((self.store.snapshot(), statuses, self.fault))

    def install(self, round_: int, store: bytes, ran: LastRun | None) -> None:
        """Replace the store; ``ran`` says which of the robot's own turns happened."""
        snapshot, statuses, self.fault = _STORE.decode(store)
        if round_ == INIT_ROUND:
            return  # nothing has been agreed on yet
        self.store.restore(snapshot)
        self.statuses = [Status(status) for status in statuses]
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

    def come_back(self) -> bool:
        """Resume from the journal. Without one the robot stays mute."""
        page = self._journal.read() if self._journal is not None else None
        if page is None or page.program != self._program:
            self.mute = True
            return False
        robot = self.robot
        try:
            if page.round == INIT_ROUND:
                self._begin()
            vars(robot).update(self._attributes(page.attributes))
            buffers = {event: self._buffer(event, plain) for event, plain in page.buffers}
        except (ShapeError, ValueError):
            self.mute = True
            return False
        robot._buffers = buffers
        robot.status = Status(page.status)
        self.round, self._turns, self._proposal = page.round, page.turns, page.proposal
        self.host.position = page.position
        return True

    def finish(self) -> None:
        """Do what is to be done when the robot leaves the run in good order."""

    def forget(self) -> None:
        """Forget the journal: the run is over."""
        if self._journal is not None:
            self._journal.forget()

    # --- the journal ----------------------------------------------------------------------------

    def _write_down(self) -> None:
        """Write the journal before a proposal is sent, once a round."""
        if self._journal is None or self.mute:
            return
        robot, proposal = self.robot, self._proposal
        pending = proposal is not None and proposal.round >= self.round
        buffers = robot._buffers.items() if pending else ()
        page = Page(
            self._program,
            self.round,
            robot.status.value,
            self._turns,
            self._plain(vars(robot)),
            self.host.position,
            proposal,
            tuple((event, self._plain(b.state)) for event, b in buffers if b.state),
        )
        self._journal.write(page)

    def _plain(self, state: dict[str, Any]) -> Attributes:
        own = {**self.robot.LOCALS, **self.robot.PORTS}
        return tuple(to_plain(shape, state[name]) for name, shape in own.items())

    def _attributes(self, plain: Attributes) -> dict[str, Any]:
        own = {**self.robot.LOCALS, **self.robot.PORTS}
        robots = self.robot.numAgents
        return {
            name: from_plain(shape, value, robots, unset=True)
            for (name, shape), value in zip(own.items(), plain, strict=True)
        }

    def _buffer(self, event: int | None, plain: Attributes) -> Buffer:
        buffer = Buffer(event)
        buffer.state = {**vars(self.robot), **self._attributes(plain)}
        assert self._proposal is None
        return buffer


def _nobody(entry: LogEntry, kept: Admitted | None) -> None:
    """Ignore a commit: the default observer."""


def _nothing(entry: LogEntry) -> None:
    """Add nothing to a round's report: the default note."""
