"""Proposals and decisions: a round's data between robots. [EVENT-TRANS] [ATOMIC]

Nothing here knows of sockets, clocks or programs. A robot runs its event into a buffer and makes a
:class:`Proposal` of it; whoever coordinates the round makes a :class:`Decision` of the proposals;
on the decision every robot applies the writes to its copy of the store, and keeps or throws away
its buffer. Output, locals and actuators never leave the robot: they are in the buffer alone.

All values are *plain* (:data:`Plain`), so that any codec of typed data can carry them, and what
robots tell each other of are arrays without names there (:class:`Flat`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from msgspec import Struct

from koord.syntax.faults import FaultKind

#: A value that any codec can carry. An enumeration member is its position, a record the tuple of
#: its fields, a list, queue or array the tuple of its items, a map the tuple of its
#: ``(key, value)`` pairs in their order; ``None`` is an atom that is not set (parts of records and
#: fixed arrays only). Integers are unbounded.
if TYPE_CHECKING:
    Plain = bool | int | float | str | tuple["Plain", ...] | None
else:

    class _Anything(type):
        """Of values that are looked at where they are decoded (``koord.runtime.encoding``)."""

        def __instancecheck__(cls, value: object) -> bool:
            return True

    class Plain(metaclass=_Anything):
        """What a decoder makes of such a value."""


#: The round of INIT, which comes before round 0.
INIT_ROUND = -1


class Flat(Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """Data that travel: encoded as the array of their fields, to save bytes."""


class Write(Flat, frozen=True):
    """A write to one location of the shared store. [LOCATION] [SHARED-ASSIGN]

    ``variable`` counts the allread variables of the program first, then the allwrite ones
    (:class:`koord.runtime.store.Layout`). ``path`` leads from the variable to the location: an
    index or the position of a field is an ``int``, a key is the key itself; a path ends at its
    first key. The empty path is the whole variable. For an allread variable ``path[0]`` is the
    robot that writes.
    """

    variable: int
    path: tuple[Plain, ...]
    value: Plain


class EventFault(Flat, frozen=True):
    """A fault of a robot's event; ``place`` is ``file:line:column``. [FAULT]"""

    kind: FaultKind
    place: str
    detail: str = ""


class StopRequests(Enum):
    """The requests of a robot's event to stop. [STOP]"""

    NOTHING = 0
    TO_STOP_TOGETHER = 1  #: ``trystop()``
    TO_STOP = 2  #: ``stop``


class Attempt(Flat, frozen=True):
    """An event that a robot has run into a buffer, as the others see it.

    ``event`` is its position in the robot's events, None for INIT. ``locks`` are the lock classes
    that it entered, ascending. With a ``fault`` nothing else of the attempt counts but its locks.
    """

    event: int | None
    writes: tuple[Write, ...] = ()
    locks: tuple[int, ...] = ()
    asked: StopRequests = StopRequests.NOTHING
    fault: EventFault | None = None


class Proposal(NamedTuple):
    """A robot's proposal for a round. A NamedTuple, because thousands are made in each round.

    The first of the ``attempts`` whose lock classes are all free is what the robot does; if there
    is none, it skips. Mostly there is one attempt (a robot that skips anyway has none). A robot
    with urgent events that are enabled proposes all of these, the first in program order first, and
    is ``urgent``: the round must not be decided without it, because it must not skip. [SKIP]
    """

    robot: int
    round: int  #: from 0; INIT_ROUND for INIT
    attempts: tuple[Attempt, ...] = ()
    urgent: bool = False


class Admitted(Flat, frozen=True):
    """An admitted robot, and the event (the attempt's) that it ran."""

    robot: int
    event: int | None
    asked: StopRequests = StopRequests.NOTHING


class Faulted(Flat, frozen=True):
    """The robot whose fault ends the run. [FAULT]"""

    robot: int
    event: int | None
    fault: EventFault


class Decision(Flat, frozen=True):
    """The decision of a round: the same for every robot.

    ``ran`` are the robots let through, in their order; every other robot skipped, after them.
    ``writes`` are theirs, in that order: later ones win. ``digest`` is that of the store after the
    writes (``AgreedStore.digest``); empty where nobody asked for it. A round with a ``fault``
    ends the run: robots stop.
    """

    round: int
    ran: tuple[Admitted, ...]
    skipped: tuple[int, ...]
    writes: tuple[Write, ...]
    digest: bytes = b""
    fault: Faulted | None = None


# --- the decision ---------------------------------------------------------------------------------


def decide(round_: int, proposals: Mapping[int, Proposal], order: Iterable[int]) -> Decision:
    """Decide a round: admit robots in an order, at most one per lock class. [EVENT-TRANS] [ATOMIC]

    ``order`` names every robot of the run once. A robot without a proposal skips: a late message
    is a SKIP. One that is not let through with any of its attempts skips as well, after all that
    are; so whatever class keeps it out was taken before its turn. A fault ends the round where it
    happens: neither those let through before it nor the robot itself are asked to undo anything,
    for a faulted run has no next round. A model of the environment that faulted did so before the
    round, so that nobody runs in it. [SKIP] [FAULT] [ENV-TRANS]
    """
    stumbled = _stumbled(round_, proposals)
    if stumbled is not None:
        return Decision(round_, (), (), (), fault=stumbled)
    taken: set[int] = set()
    ran: list[Admitted] = []
    skipped: list[int] = []
    writes: list[Write] = []
    for robot in order:
        proposal = proposals.get(robot)
        attempt = _let_through(proposal, taken) if proposal is not None else None
        if attempt is None:
            skipped.append(robot)
            continue
        if attempt.fault is not None:
            faulted = Faulted(robot, attempt.event, attempt.fault)
            return Decision(round_, tuple(ran), tuple(skipped), tuple(writes), fault=faulted)
        taken.update(attempt.locks)
        ran.append(Admitted(robot, attempt.event, attempt.asked))
        writes += attempt.writes
    return Decision(round_, tuple(ran), tuple(skipped), tuple(writes))


def _stumbled(round_: int, proposals: Mapping[int, Proposal]) -> Faulted | None:
    """The first robot whose model faulted at the end of the round before."""
    if round_ == INIT_ROUND:
        return None
    for robot in sorted(proposals):
        for attempt in proposals[robot].attempts:
            if attempt.event is None and attempt.fault is not None:
                return Faulted(robot, None, attempt.fault)
    return None


def _let_through(proposal: Proposal, taken: set[int]) -> Attempt | None:
    for attempt in proposal.attempts:
        if taken.isdisjoint(attempt.locks):
            return attempt
    return None


def rotating(round_: int, robots: int) -> tuple[int, ...]:
    """The rotating order: in N rounds each of N robots is first once."""
    first = round_ % robots if robots else 0
    return (*range(first, robots), *range(first))
