"""The state of the protocol machine, and the context of one step. See specs/protocol/README.md."""

from __future__ import annotations

from typing import Any

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


class Coordinator(msgspec.Struct, frozen=True):
    """Office: decides rounds in its epoch. (R-OPEN)

    ``heard`` since it was last asked whether a majority is (R-SILENCE); ``overdue``: the deadline
    for proposals is over; ``guests`` are to be admitted; ``began``: when the round began.
    """

    proposals: tuple[Proposal | None, ...]
    holders: frozenset[int] = frozenset()
    heard: frozenset[int] = frozenset()
    overdue: bool = False
    guests: tuple[tuple[int, int], ...] = ()
    began: float = 0.0


class Rejoining(msgspec.Struct, frozen=True):
    """Office: is back after a crash, and waits for a snapshot. (R-REJOIN)"""


class Retired(msgspec.Struct, frozen=True):
    """Office: another robot has its pid; it says and does nothing any more. (R-ADMIT)"""


Office = Follower | Canvassing | Candidate | Coordinator | Rejoining | Retired


class State(msgspec.Struct, frozen=True):
    """The state of one robot in the protocol."""

    pid: int
    incarnation: int
    spare: int  #: a new incarnation, should this turn out to be no first start (R-FRESH)
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
    target: int = INIT_ROUND  #: the highest round known to be open somewhere (R-ASK)
    holding: Reason | None = None
    ended: bool = False
    tries: int = 0  #: how often in a row something was sent again (R-AGAIN)

    @property
    def is_voter(self) -> bool:
        """True if the robot's acknowledgements and votes count."""
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


def fresh(setup: Setup, pid: int, spare: int) -> State:
    """The state of a robot that is switched on for the first time in this run."""
    office: Office = Follower(setup.coordinator(0))
    if pid == setup.coordinator(0):
        office = Coordinator((None,) * setup.robots)
    return _new(setup, pid, FIRST_INCARNATION, spare, office)


def returning(setup: Setup, pid: int, incarnation: int) -> State:
    """The state of a robot that is back. ``incarnation`` is above all that it had."""
    return _new(setup, pid, incarnation, incarnation, Rejoining())


def _new(setup: Setup, pid: int, incarnation: int, spare: int, office: Office) -> State:
    return State(
        pid=pid,
        incarnation=incarnation,
        spare=spare,
        office=office,
        roster=(FIRST_INCARNATION,) * setup.robots,
        last_ran=(None,) * setup.robots,
    )


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
        self.change(tries=0)
        self.arm(Timer.RESEND, extra_s + self.setup.timing.resend_s)

    def await_longer(self) -> None:
        """Go on waiting, for twice as long as before."""
        tries = min(self.state.tries + 1, MOST_DOUBLINGS)
        self.change(tries=tries)
        self.arm(Timer.RESEND, self.setup.timing.resend_s * 2**tries)

    def watch_leader(self) -> None:
        """Restart the timer of silence: the coordinator was heard. (R-SILENCE)"""
        self.arm(Timer.SILENCE, self.setup.timing.silence_s)

    def hear(self, epoch: int) -> None:
        """Note that an epoch exists, so that elections start above it."""
        if epoch > self.state.seen:
            self.change(seen=epoch)

    def promise(self, epoch: int) -> None:
        """Accept from no epoch below this one any more, and step down from a lower office."""
        self.hear(epoch)
        if epoch > self.state.promised:
            self.change(promised=epoch)

    def follow_nobody(self) -> None:
        """Step down, and wait for a candidate; the time depends on the pid. (R-SILENCE)"""
        state, setup = self.state, self.setup
        self.take(Follower(None))
        self.disarm(Timer.DEADLINE)
        slots = setup.distance(state.pid, state.seen)
        self.arm(Timer.SILENCE, setup.timing.slot_s * slots)
