"""One robot's part of a round as data: what it proposes, what is decided. [EVENT-TRANS] [ATOMIC]

Nothing here knows of sockets, clocks or programs. A robot runs its event into a buffer and makes a
:class:`Proposal` of it; whoever coordinates the round makes a :class:`Decision` of the proposals;
on the decision every robot applies the writes to its copy of the store, and keeps or throws away
its buffer. Output, locals and actuators never leave the robot: they are in the buffer alone.

All values are *plain* (:data:`Plain`), so that any codec of typed data can carry them.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from msgspec import Struct

from koord.syntax.faults import FaultKind

#: A value that any codec can carry. An enumeration member is its position, a record the tuple of
#: its fields, a list, queue or array the tuple of its items, a map the tuple of its
#: ``(key, value)`` pairs in their order; ``None`` is an atom that is not set (parts of records and
#: fixed arrays only). Integers are unbounded.
Plain = bool | int | float | str | tuple["Plain", ...] | None

#: The round of INIT, which comes before round 0.
INIT_ROUND = -1


class Write(Struct, frozen=True):
    """One written location of the shared store. [LOCATION] [SHARED-ASSIGN]

    ``variable`` counts the allread variables of the program first, then the allwrite ones
    (:class:`koord.runtime.store.Layout`). ``path`` leads from the variable to the location: an
    index or the position of a field is an ``int``, a key is the key itself; a path ends at its
    first key. The empty path is the whole variable. For an allread variable ``path[0]`` is the
    robot that writes.
    """

    variable: int
    path: tuple[Plain, ...]
    value: Plain


class Fault(Struct, frozen=True):
    """A fault of a robot's event; ``place`` is ``file:line:column``. [FAULT]"""

    kind: FaultKind
    place: str
    detail: str = ""


class Asked(Enum):
    """What a robot's event asked for besides writing. [STOP]"""

    NOTHING = 0
    TO_STOP_TOGETHER = 1  #: ``trystop()``
    TO_STOP = 2  #: ``stop``


class Attempt(Struct, frozen=True):
    """One event that a robot has run into a buffer, as far as the others are concerned.

    ``event`` is its position in the robot's events, None for INIT. ``locks`` are the lock classes
    that it entered, ascending. With a ``fault`` nothing else of the attempt counts but its locks.
    """

    event: int | None
    writes: tuple[Write, ...] = ()
    locks: tuple[int, ...] = ()
    asked: Asked = Asked.NOTHING
    fault: Fault | None = None


class Proposal(NamedTuple):
    """What a robot would do in a round; thousands of robots say so thousands of times.

    The first of the ``attempts`` whose lock classes are all free is what the robot does; if there
    is none, it skips. Mostly there is one attempt (a robot that skips anyway has none). A robot
    with urgent events that are enabled proposes all of these, the first in program order first, and
    is ``urgent``: the round must not be decided without it, because it must not skip. [SKIP]
    """

    robot: int
    round: int  #: from 0; INIT_ROUND for INIT
    attempts: tuple[Attempt, ...] = ()
    urgent: bool = False


class Taken(Struct, frozen=True):
    """A robot that was let through, and the event (the attempt's) that it ran."""

    robot: int
    event: int | None
    asked: Asked = Asked.NOTHING


class Faulted(Struct, frozen=True):
    """The robot whose fault ends the run. [FAULT]"""

    robot: int
    event: int | None
    fault: Fault


class Decision(Struct, frozen=True):
    """What became of a round: the same for every robot.

    ``ran`` are the robots let through, in their order; every other robot skipped, after them.
    ``writes`` are theirs, in that order: later ones win. ``digest`` is that of the store after the
    writes (:meth:`koord.runtime.store.Store.digest`); empty where nobody asked for it. A round with
    a ``fault`` ends the run: robots stop.
    """

    round: int
    ran: tuple[Taken, ...]
    skipped: tuple[int, ...]
    writes: tuple[Write, ...]
    digest: bytes = b""
    fault: Faulted | None = None
