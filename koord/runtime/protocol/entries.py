"""Entries: what became of a round, and what is agreed on besides."""

from __future__ import annotations

from hashlib import blake2b

import msgspec

from koord.runtime.encoding import encode, flat_decision
from koord.runtime.proposals import Decision

DIGEST_BYTES = 16

#: What stands for the history before INIT.
GENESIS = bytes(DIGEST_BYTES)

#: The incarnation of a robot's first start.
FIRST_INCARNATION = 0


class Admission(msgspec.Struct, frozen=True):
    """A robot that is back counts again, in a new incarnation. (R-ADMIT)"""

    robot: int
    incarnation: int


class LogEntry(msgspec.Struct, frozen=True):
    """A round's decision with what goes with it; the unit that robots agree on.

    ``late`` are the robots whose proposal was not there in time. ``previous`` is the digest of the
    entry before this one, so that a digest stands for a history.
    """

    decision: Decision
    previous: bytes = GENESIS
    admitted: tuple[Admission, ...] = ()
    late: tuple[int, ...] = ()

    @property
    def round(self) -> int:
        return self.decision.round


def digest(entry: LogEntry) -> bytes:
    """The digest of the history that ends with an entry."""
    admitted = tuple((a.robot, a.incarnation) for a in entry.admitted)
    flat = (flat_decision(entry.decision), entry.previous, admitted, entry.late)
    return blake2b(encode(flat), digest_size=DIGEST_BYTES).digest()


class Held(msgspec.Struct, frozen=True):
    """An entry that a robot holds, and the epoch in which it took it."""

    epoch: int
    entry: LogEntry
    digest: bytes

    @property
    def round(self) -> int:
        return self.entry.decision.round


class LastRun(msgspec.Struct, frozen=True):
    """The last round in which a robot was let through, and the event that it ran."""

    round: int
    event: int | None


class Position(msgspec.Struct, frozen=True, order=True):
    """How much a robot holds: the round of its last entry, and how surely. (R-VOTE)

    ``epoch`` is that in which it accepted its last entry, COMMITTED if that is committed.
    """

    round: int
    epoch: int

    @property
    def open(self) -> int:
        """The first round that a robot in this position does not know to be committed."""
        return self.round + (self.epoch == COMMITTED)


#: Above every epoch.
COMMITTED = 2**62
