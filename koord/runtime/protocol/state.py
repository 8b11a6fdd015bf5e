"""The state of the protocol machine, and the context of one step. See specs/protocol/README.md."""

from __future__ import annotations

from functools import lru_cache
from itertools import chain
from typing import Any, TypeVar

import msgspec
from msgspec.structs import replace

from koord.runtime.proposals import INIT_ROUND, Proposal
from koord.runtime.protocol.events import (
    Arm,
    Disarm,
    Effect,
    Hold,
    Reason,
    Resume,
    Send,
    Tell,
    Timer,
)
from koord.runtime.protocol.messages import (
    COMMITTED,
    FIRST_INCARNATION,
    GENESIS,
    Held,
    LastRun,
    Message,
    Position,
)
from koord.runtime.protocol.setup import Setup

T = TypeVar("T")


class Follower(msgspec.Struct, frozen=True):
    """Office: follows a coordinator, or (None) knows of none."""

    leader: int | None


class Canvassing(msgspec.Struct, frozen=True):
    """Office: asks who would support it as coordinator of an epoch. (R-CANVASS)"""

    epoch: int
    supporters: frozenset[int]


class Candidate(msgspec.Struct, frozen=True):
    """Office: has promised itself its epoch, and gathers votes. (R-STAND)"""

    voters: frozenset[int]


#: So many proposals are in a row.
_ROW = 32


class Gathered(msgspec.Struct, frozen=True):
    """The proposals of a round by robot, None: not there.

    They are in rows, so that for each that comes one row is made anew, and not as many places as
    there are robots.
    """

    rows: tuple[tuple[Proposal | None, ...], ...]

    @staticmethod
    def nothing(robots: int) -> Gathered:
        """What is gathered of so many robots at first."""
        whole, rest = divmod(robots, _ROW)
        return Gathered(((None,) * _ROW,) * whole + (((None,) * rest,) if rest else ()))

    def of(self, robot: int) -> Proposal | None:
        """The proposal of a robot."""
        return self.rows[robot // _ROW][robot % _ROW]

    def having(self, proposal: Proposal) -> Gathered:
        """These, and the proposal of another robot."""
        row, place = divmod(proposal.robot, _ROW)
        return Gathered(put(self.rows, row, put(self.rows[row], place, proposal)))

    @property
    def all(self) -> tuple[Proposal | None, ...]:
        """Those of all robots."""
        return tuple(chain.from_iterable(self.rows))


class Coordinator(msgspec.Struct, frozen=True):
    """Office: decides rounds in its epoch. (R-OPEN)

    ``gathered`` counts the proposals that are there; ``holders`` of its tentative entry, and who
    was ``heard`` since it was last asked whether a majority is (R-SILENCE), are a bit for each
    robot; ``overdue``: the deadline for proposals is over; ``guests`` are to be
    admitted; ``began``: when the round began.
    """

    proposals: Gathered
    gathered: int = 0
    holders: int = 0
    heard: int = 0
    overdue: bool = False
    guests: tuple[tuple[int, int], ...] = ()
    began: float = 0.0


class Rejoining(msgspec.Struct, frozen=True):
    """Office: is back without a journal, and waits for a snapshot. (R-REJOIN)"""


class Retired(msgspec.Struct, frozen=True):
    """Office: another robot has its pid; it says and does nothing any more. (R-ADMIT)"""


Office = Follower | Canvassing | Candidate | Coordinator | Rejoining | Retired


class Recovering(msgspec.Struct, frozen=True):
    """A recovery: the number of the start, and who has answered. (R-RESUME)"""

    start: int
    answered: frozenset[int] = frozenset()


class State(msgspec.Struct, frozen=True):
    """The state of one robot in the protocol."""

    pid: int
    incarnation: int
    office: Office
    roster: tuple[int, ...]
    last_ran: tuple[LastRun | None, ...]
    promised: int = 0
    seen: int = 0
    round: int = INIT_ROUND
    chain: bytes = GENESIS
    tentative: Held | None = None
    log: tuple[Held, ...] = ()
    mine: Proposal | None = None
    recovery: Recovering | None = None  #: it is back with its journal, and asks what it forgot
    target: int = INIT_ROUND  #: the highest round known to be open somewhere (R-ASK)
    holding: Reason | None = None
    ended: bool = False
    tries: int = 0  #: how often in a row something was sent again (R-AGAIN)

    @property
    def is_voter(self) -> bool:
        """True if the robot may acknowledge and vote."""
        return self.is_on_roster and self.recovery is None

    @property
    def is_on_roster(self) -> bool:
        """True if it is this incarnation of the robot that counts."""
        return self.roster[self.pid] == self.incarnation

    @property
    def is_behind(self) -> bool:
        return self.round < self.target

    @property
    def leader(self) -> int | None:
        """The coordinator that the robot follows; itself, if it is one."""
        match self.office:
            case Follower(leader=leader):
                return leader
            case Coordinator():
                return self.pid
            case _:
                return None

    @property
    def position(self) -> Position:
        if self.tentative is not None:
            return Position(self.round, self.tentative.epoch)
        return Position(self.round - 1, COMMITTED)

    def counts(self, robot: int, incarnation: int) -> bool:
        """Return whether a vote or an acknowledgement counts. (R-MAJORITY) (R-OFFICE)

        Who is about to be admitted by the tentative entry counts in neither incarnation.
        """
        if self.tentative is not None:
            for admission in self.tentative.entry.admitted:
                if admission.robot == robot:
                    return False
        return self.roster[robot] == incarnation


def fresh(setup: Setup, pid: int) -> State:
    """The state of a robot that is switched on for the first time in this run. (R-ENTER)"""
    office: Office = Follower(setup.coordinator(0))
    if pid == setup.coordinator(0):
        office = Coordinator(Gathered.nothing(setup.robots))
    return _new(setup, pid, FIRST_INCARNATION, office)


def returning(setup: Setup, pid: int, incarnation: int) -> State:
    """The state of a robot that is back without its journal. (R-REJOIN)

    ``incarnation`` is one that the robot never had.
    """
    return _new(setup, pid, incarnation, Rejoining())


class Durable(msgspec.Struct, frozen=True):
    """The part of the state that is on the robot's disk. (R-SAVE)"""

    incarnation: int
    promised: int
    round: int
    chain: bytes
    roster: tuple[int, ...]
    last_ran: tuple[LastRun | None, ...]
    tentative: Held | None
    log: tuple[Held, ...]
    mine: Proposal | None
    ended: bool


def durable(state: State) -> Durable:
    """The part of a state that a crash must not lose. (R-SAVE)"""
    return Durable(
        state.incarnation,
        state.promised,
        state.round,
        state.chain,
        state.roster,
        state.last_ran,
        state.tentative,
        state.log,
        state.mine,
        state.ended,
    )


def must_save(before: State, after: State) -> bool:
    """Return whether a step changed what messages may speak of. (R-SAVE)"""
    return (
        before.promised != after.promised
        or before.incarnation != after.incarnation
        or (after.tentative is not None and before.tentative is not after.tentative)
        or (after.mine is not None and before.mine is not after.mine)
    )


def recovered(setup: Setup, pid: int, kept: Durable, start: int) -> State:
    """The state of a robot that is back with its journal. (R-RESUME)

    One that was not admitted yet has told nothing that counts, and goes on to rejoin.
    """
    if kept.roster[pid] != kept.incarnation:
        return returning(setup, pid, kept.incarnation)
    return State(
        pid=pid,
        incarnation=kept.incarnation,
        office=Follower(None),
        roster=kept.roster,
        last_ran=kept.last_ran,
        promised=kept.promised,
        seen=kept.promised,
        round=kept.round,
        chain=kept.chain,
        tentative=kept.tentative,
        log=kept.log,
        mine=kept.mine,
        recovery=Recovering(start),
        target=kept.round,
        ended=kept.ended,
    )


def _new(setup: Setup, pid: int, incarnation: int, office: Office) -> State:
    return State(
        pid=pid,
        incarnation=incarnation,
        office=office,
        roster=_everyone_first(setup.robots),
        last_ran=_nobody(setup.robots),
    )


@lru_cache(maxsize=8)
def _everyone_first(robots: int) -> tuple[int, ...]:
    """The roster at first, one object for all robots of a process."""
    return (FIRST_INCARNATION,) * robots


@lru_cache(maxsize=8)
def _nobody(robots: int) -> tuple[LastRun | None, ...]:
    """What robots last ran at first, one object for all robots of a process."""
    return (None,) * robots


def put(items: tuple[T, ...], place: int, item: T) -> tuple[T, ...]:
    """A tuple with another item in one place."""
    changed = list(items)  # the quickest way: a large fleet does this for each proposal
    changed[place] = item
    return tuple(changed)


#: Waits for answers are doubled so many times at most.
MOST_DOUBLINGS = 2


class StepContext:
    """The state and effects of one call of ``step``."""

    __slots__ = ("effects", "now", "setup", "state")

    def __init__(self, setup: Setup, state: State, now: float) -> None:
        self.setup = setup
        self.state = state
        self.now = now
        self.effects: list[Effect] = []

    def change(self, **fields: Any) -> None:
        """Replace fields of the state."""
        self.state = replace(self.state, **fields)

    def take(self, office: Office) -> None:
        self.state = replace(self.state, office=office)

    # --- effects --------------------------------------------------------------------------------

    def want(self, effect: Effect) -> None:
        self.effects.append(effect)

    def send(self, to: int, message: Message) -> None:
        if to != self.state.pid:
            self.effects.append(Send(to, message))

    def tell(self, message: Message) -> None:
        if self.setup.robots > 1:
            self.effects.append(Tell(message))

    def arm(self, timer: Timer, after_s: float) -> None:
        self.effects.append(Arm(timer, after_s))

    def disarm(self, timer: Timer) -> None:
        self.effects.append(Disarm(timer))

    def hold(self, reason: Reason) -> None:
        if self.state.holding is not reason:
            self.change(holding=reason)
            self.effects.append(Hold(reason))

    def resume(self) -> None:
        if self.state.holding is not None:
            self.change(holding=None)
            self.effects.append(Resume())

    # --- waiting --------------------------------------------------------------------------------

    def await_answer(self, extra_s: float = 0.0) -> None:
        """Start waiting for an answer to something new. (R-AGAIN)"""
        if self.state.tries:
            self.change(tries=0)
        self.arm(Timer.RESEND, extra_s + self.setup.timing.resend_s)

    def await_longer(self) -> None:
        """Go on waiting, for twice as long as before, but not until others give this robot up."""
        tries = min(self.state.tries + 1, MOST_DOUBLINGS)
        self.change(tries=tries)
        timing = self.setup.timing
        self.arm(Timer.RESEND, min(timing.resend_s * 2**tries, timing.silence_s / 3))

    def watch_leader(self) -> None:
        """Restart the timer of silence: the coordinator was heard. (R-SILENCE)"""
        self.arm(Timer.SILENCE, self.setup.timing.silence_s)

    def hear(self, epoch: int) -> None:
        """Note that an epoch exists, so that elections start above it."""
        if epoch > self.state.seen:
            self.change(seen=epoch)

    def promise(self, epoch: int) -> None:
        """Accept from no epoch below this one any more, and step down from a lower office."""
        if epoch > self.state.promised:
            self.change(promised=epoch, seen=max(self.state.seen, epoch))
        else:
            self.hear(epoch)

    def follow_nobody(self) -> None:
        """Step down, and wait for a candidate; the time depends on the pid. (R-SILENCE)"""
        state, setup = self.state, self.setup
        self.take(Follower(None))
        self.disarm(Timer.DEADLINE)
        slots = setup.distance(state.pid, state.seen)
        self.arm(Timer.SILENCE, setup.timing.slot_s * slots)
