"""The messages of the protocol. The sender and its incarnation travel beside them."""

from __future__ import annotations

import msgspec

from koord.runtime.proposals import Proposal
from koord.runtime.protocol.entries import LastRun, LogEntry, Position


class Propose(msgspec.Struct, frozen=True):
    """What the sender would do in the round. (R-BEGIN)"""

    proposal: Proposal


class Decide(msgspec.Struct, frozen=True):
    """What became of the round, if a majority takes it. (R-DECIDE)"""

    epoch: int
    entry: LogEntry


class Acknowledge(msgspec.Struct, frozen=True):
    """The sender holds the entry. ``again``: and has not heard that it is committed. (R-ACCEPT)"""

    epoch: int
    round: int
    digest: bytes
    again: bool = False


class Committed(msgspec.Struct, frozen=True):
    """A majority holds the entry: act. The next round begins in ``pause_s``. (R-MAJORITY)"""

    epoch: int
    round: int
    digest: bytes
    pause_s: float = 0.0


class Open(msgspec.Struct, frozen=True):
    """The round is open, on the history with this digest: who has not proposed, do. (R-OWED)"""

    epoch: int
    round: int
    chain: bytes


class Ask(msgspec.Struct, frozen=True):
    """The sender lacks what was committed from this round on. (R-ASK)"""

    round: int


class History(msgspec.Struct, frozen=True):
    """An entry that is committed, in this epoch or a lower one. ``last`` of what was asked for."""

    epoch: int
    entry: LogEntry
    last: bool = True


class Snapshot(msgspec.Struct, frozen=True):
    """Everything agreed on before ``round``. (R-SNAPSHOT)"""

    epoch: int
    round: int
    chain: bytes
    roster: tuple[int, ...]
    last_ran: tuple[LastRun | None, ...]
    store: bytes
    ended: bool = False  #: there are no more rounds


class Canvass(msgspec.Struct, frozen=True):
    """Would you have me as coordinator of this epoch? (R-CANVASS)"""

    epoch: int
    position: Position


class Support(msgspec.Struct, frozen=True):
    """The sender hears no coordinator either. Promises nothing. (R-CANVASS)"""

    epoch: int


class Candidacy(msgspec.Struct, frozen=True):
    """Asks for the promise of an epoch. (R-STAND)"""

    epoch: int
    position: Position


class Vote(msgspec.Struct, frozen=True):
    """The sender hears no lower epoch from now on. (R-VOTE)"""

    epoch: int


class Overruled(msgspec.Struct, frozen=True):
    """The sender has promised a higher epoch, this one. (R-OVERRULED)"""

    epoch: int


class Hello(msgspec.Struct, frozen=True):
    """The sender is back. ``empty``: and knows nothing, so needs a snapshot. (R-REJOIN)"""

    empty: bool


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
)
