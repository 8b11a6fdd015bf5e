"""What a robot knows. The table of specs/protocol/README.md, and what each office needs besides."""

from __future__ import annotations

import msgspec

from koord.runtime.proposals import INIT_ROUND, Proposal
from koord.runtime.protocol.entries import (
    COMMITTED,
    FIRST_INCARNATION,
    GENESIS,
    Held,
    LastRun,
    Position,
)
from koord.runtime.protocol.events import Reason
from koord.runtime.protocol.setup import Setup


class Follower(msgspec.Struct, frozen=True):
    """Hears a coordinator, or (None) nobody."""

    leader: int | None


class Canvassing(msgspec.Struct, frozen=True):
    """Asks who would have it as coordinator of an epoch. (R-CANVASS)"""

    epoch: int
    supporters: frozenset[int]


class Candidate(msgspec.Struct, frozen=True):
    """Has promised itself its epoch, and gathers votes. (R-STAND)"""

    voters: frozenset[int]


class Coordinator(msgspec.Struct, frozen=True):
    """Decides rounds in its epoch. (R-OPEN)

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
    """Is back, and waits for a snapshot. (R-REJOIN)"""


class Retired(msgspec.Struct, frozen=True):
    """Another robot has its pid. It says and does nothing any more. (R-ADMIT)"""


Office = Follower | Canvassing | Candidate | Coordinator | Rejoining | Retired


class State(msgspec.Struct, frozen=True):
    """All that one robot knows."""

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
        """Whether its acknowledgements and votes count."""
        return self.roster[self.pid] == self.incarnation

    @property
    def is_behind(self) -> bool:
        return self.round < self.target

    @property
    def leader(self) -> int | None:
        """The coordinator it follows; itself, if it is one."""
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
        """Whether a vote or an acknowledgement counts. (R-MAJORITY) (R-OFFICE)

        Who is about to be admitted by the tentative entry counts in neither incarnation.
        """
        if self.tentative is not None:
            for admission in self.tentative.entry.admitted:
                if admission.robot == robot:
                    return False
        return self.roster[robot] == incarnation


def fresh(setup: Setup, pid: int, spare: int) -> State:
    """A robot that is switched on for the first time in this run."""
    office: Office = Follower(setup.coordinator(0))
    if pid == setup.coordinator(0):
        office = Coordinator((None,) * setup.robots)
    return _new(setup, pid, FIRST_INCARNATION, spare, office)


def returning(setup: Setup, pid: int, incarnation: int) -> State:
    """A robot that has been in this run before. ``incarnation`` is above all that it had."""
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
