"""Events and effects of the protocol machine."""

from __future__ import annotations

from enum import Enum

import msgspec

from koord.runtime.proposals import Admitted, Proposal
from koord.runtime.protocol.messages import LastRun, LogEntry, Message


class Timer(Enum):
    """The timers of a robot, one of each; arming it anew replaces the old time."""

    __hash__ = object.__hash__  # by what it is, which is quicker than by its name

    DEADLINE = "deadline"  #: the coordinator waits for proposals no longer (R-DECIDE)
    RESEND = "resend"  #: what is not answered is sent again (R-AGAIN)
    SILENCE = "silence"  #: the coordinator, or the majority, is not heard (R-SILENCE)
    HOLD = "hold"  #: a commit is overdue (R-HOLD)
    RECOVERY = "recovery"  #: not all others have said what was forgotten (R-RESUME)


class Reason(Enum):
    """The reasons why a robot holds its position."""

    NO_COORDINATOR = "no coordinator is heard"
    NO_MAJORITY = "fewer than a majority answer"
    ROUND_OPEN = "the round waits for robots that may not skip"
    UNDECIDED = "the round is not decided"
    BEHIND = "catching up"
    REJOINING = "rejoining"
    RECOVERING = "recovering"
    GATHERING = "waits for the other robots"
    NEVER_BEGAN = "lost its journal before INIT: start all robots again, with --fresh"
    UNWRITABLE = "its journal cannot be written"
    TWICE = "another robot has taken this pid"


# --- events ---------------------------------------------------------------------------------------


class Started(msgspec.Struct, frozen=True):
    """Event: the robot has been switched on. Comes once, first."""

    now: float


class Received(msgspec.Struct, frozen=True):
    """Event: a message of another robot has arrived."""

    now: float
    sender: int
    incarnation: int
    message: Message


class Expired(msgspec.Struct, frozen=True):
    """Event: an armed timer has expired."""

    now: float
    timer: Timer


class Proposed(msgspec.Struct, frozen=True):
    """Event: the robot has run its event into a buffer, as Begin demands."""

    now: float
    proposal: Proposal


class StoreShown(msgspec.Struct, frozen=True):
    """Event: the answer to ShowStore, the store before the round as bytes."""

    now: float
    to: int
    round: int
    store: bytes


Event = Started | Received | Expired | Proposed | StoreShown


# --- effects --------------------------------------------------------------------------------------


class Send(msgspec.Struct, frozen=True):
    """Effect: send a message to one robot."""

    to: int
    message: Message


class Tell(msgspec.Struct, frozen=True):
    """Effect: send a message to all other robots."""

    message: Message


class Save(msgspec.Struct, frozen=True):
    """Effect: write what is durable of the state to the disk; then only go on. (R-SAVE)"""


class Begin(msgspec.Struct, frozen=True):
    """Effect: after a delay, sense, run an event into a buffer, and propose it. (R-BEGIN)"""

    round: int
    after_s: float


class Commit(msgspec.Struct, frozen=True):
    """Effect: apply the writes. With ``kept`` the buffer is kept, otherwise discarded. (R-COMMIT)

    A robot that is back may find that it was let through with what it proposed before the crash.
    """

    entry: LogEntry
    kept: Admitted | None


class Install(msgspec.Struct, frozen=True):
    """Effect: replace the store by a snapshot's. (R-SNAPSHOT)

    ``ran`` is what this robot last ran, according to the others: a buffer for that round is kept.
    """

    round: int
    store: bytes
    ran: LastRun | None


class ShowStore(msgspec.Struct, frozen=True):
    """Effect: another robot needs the store as it is now; StoreShown answers."""

    to: int


class Hold(msgspec.Struct, frozen=True):
    """Effect: come to a safe stop and stay there. (R-HOLD)"""

    reason: Reason


class Resume(msgspec.Struct, frozen=True):
    """Effect: go on after Hold."""


class RunEnded(msgspec.Struct, frozen=True):
    """Effect: the run is over, by a fault, the last round, or another robot with this pid."""


class Arm(msgspec.Struct, frozen=True):
    """Effect: arm a timer; Expired comes after so many seconds unless it is armed again."""

    timer: Timer
    after_s: float


class Disarm(msgspec.Struct, frozen=True):
    """Effect: disarm a timer."""

    timer: Timer


Effect = (
    Save
    | Send
    | Tell
    | Begin
    | Commit
    | Install
    | ShowStore
    | Hold
    | Resume
    | RunEnded
    | Arm
    | Disarm
)
