"""Messages of the protocol, and the log entries that they carry."""

from __future__ import annotations

from hashlib import blake2b

from msgspec import Struct

from koord.runtime.alike import keeps_last
from koord.runtime.encoding import encode
from koord.runtime.motion.world import Point
from koord.runtime.proposals import Decision, Flat, Proposal

DIGEST_BYTES = 16

#: What stands for the history before INIT.
GENESIS = bytes(DIGEST_BYTES)

#: The incarnation of a robot that enters a run at its beginning. (R-ENTER)
FIRST_INCARNATION = 0

#: An incarnation is a count times this, and a random number that no other robot has drawn.
INCARNATION_STEP = 1 << 48


def incarnation_above(known: int, drawn: int) -> int:
    """The incarnation whose count is one above a known one's. (R-LATE) (R-ADMIT)"""
    return (known // INCARNATION_STEP + 1) * INCARNATION_STEP + drawn % INCARNATION_STEP


class Admission(Flat, frozen=True):
    """An admission: a robot that is back counts again, in a new incarnation. (R-ADMIT)"""

    robot: int
    incarnation: int


class LogEntry(Flat, frozen=True):
    """A log entry: a round's decision with admissions; the unit that robots agree on.

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


@keeps_last
def digest(entry: LogEntry) -> bytes:
    """The digest of the history that ends with an entry."""
    return blake2b(encode(entry), digest_size=DIGEST_BYTES).digest()


class Held(Struct, frozen=True):
    """An entry that a robot holds, and the epoch in which it accepted it."""

    epoch: int
    entry: LogEntry
    digest: bytes

    @property
    def round(self) -> int:
        return self.entry.decision.round


class LastRun(Flat, frozen=True):
    """The last round in which a robot was admitted, and the event that it ran."""

    round: int
    event: int | None


class Position(Flat, frozen=True, order=True):
    """The position of a robot in the log: the round of its last entry, and its epoch. (R-VOTE)

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


class Propose(Flat, frozen=True):
    """Message: the sender's proposal for the round. (R-BEGIN)"""

    proposal: Proposal


class Decide(Flat, frozen=True):
    """Message: the decision of the round, if a majority accepts it. (R-DECIDE)"""

    epoch: int
    entry: LogEntry


class Acknowledge(Flat, frozen=True):
    """Message: the sender holds the entry. ``again``: it knows of no commit yet. (R-ACCEPT)"""

    epoch: int
    round: int
    digest: bytes
    again: bool = False


class Committed(Flat, frozen=True):
    """Message: a majority holds the entry; act. The next round begins in ``pause_s``.
    (R-MAJORITY)
    """

    epoch: int
    round: int
    digest: bytes
    pause_s: float = 0.0


class Open(Flat, frozen=True):
    """Message: the round is open, on the history with this digest; propose now. (R-OWED)"""

    epoch: int
    round: int
    chain: bytes


class Ask(Flat, frozen=True):
    """Message: the sender lacks what was committed from this round on. (R-ASK)"""

    round: int


class History(Flat, frozen=True):
    """Message: a committed entry, of this epoch or a lower one; ``last`` of those asked for."""

    epoch: int
    entry: LogEntry
    last: bool = True


class Snapshot(Flat, frozen=True):
    """Message: the agreed state before ``round``. (R-SNAPSHOT)"""

    epoch: int
    round: int
    chain: bytes
    roster: tuple[int, ...]
    last_ran: tuple[LastRun | None, ...]
    store: bytes
    ended: bool = False  #: there are no more rounds


class Canvass(Flat, frozen=True):
    """Message: the sender asks for support as coordinator of this epoch. (R-CANVASS)"""

    epoch: int
    position: Position


class Support(Flat, frozen=True):
    """Message: the sender hears no coordinator either. Promises nothing. (R-CANVASS)"""

    epoch: int


class Candidacy(Flat, frozen=True):
    """Message: the sender asks for the promise of an epoch. (R-STAND)"""

    epoch: int
    position: Position


class Vote(Flat, frozen=True):
    """Message: the sender accepts no lower epoch from now on. (R-VOTE)

    ``candidate`` is the incarnation that asked: its position was looked at, and it alone counts it.
    """

    epoch: int
    candidate: int


class Overruled(Flat, frozen=True):
    """Message: the sender has promised a higher epoch, this one. (R-OVERRULED)"""

    epoch: int


class Hello(Flat, frozen=True):
    """Message: the sender has lost its journal. ``empty``: it needs a snapshot. (R-REJOIN)"""

    empty: bool


class Recovery(Flat, frozen=True):
    """Message: the sender is back with its journal: what has it forgotten? (R-RESUME)"""

    start: int  #: the number of the sender's start


class RecoveryAnswer(Flat, frozen=True):
    """Message: what the sender has promised and holds, for a start of the receiver. (R-RESUME)"""

    start: int
    promised: int
    round: int
    tentative: Tentative | None


class Tentative(Flat, frozen=True):
    """An entry that is not known to be committed, and the epoch in which it was accepted."""

    epoch: int
    entry: LogEntry


Message = (
    Propose
    | Decide
    | Acknowledge
    | Committed
    | Open
    | Ask
    | History
    | Snapshot
    | Canvass
    | Support
    | Candidacy
    | Vote
    | Overruled
    | Hello
    | Recovery
    | RecoveryAnswer
)


class Beacon(Flat, frozen=True):
    """Beside the agreement: where the sender's vehicle is, and how it moves. (P-BEACON)

    No robot decides anything by it. ``age_s`` is that of the pose when this was sent.
    """

    position_m: Point
    velocity_mps: Point
    age_s: float


#: What robots of a run say to each other: of the protocol, and of where they are.
RunMessage = Message | Beacon
