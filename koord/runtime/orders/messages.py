"""What callers and robots say to each other, as data."""

from __future__ import annotations

from enum import Enum

from koord.runtime.proposals import Flat

ID_BYTES = 16
BOOT_BYTES = 16


class Wanted(Enum):
    """What a caller wants of a robot."""

    ASK = "ask"  #: an answer, and nothing else
    ALIVE = "alive"  #: nothing: people are there (O-ALIVE)
    ESTOP = "e-stop"
    STOP = "stop"
    LAND = "land"
    START = "start"
    RESET = "reset"


#: What may be obeyed without a stamp: it stops robots. (O-STOP)
STOPPING = frozenset({Wanted.ESTOP, Wanted.STOP, Wanted.LAND})


class Stamp(Flat, frozen=True):
    """A moment of a robot's process: its number, and its monotonic clock. (O-STAMP)"""

    boot: bytes
    at_s: float


class Request(Flat, frozen=True):
    """Message: what people want of one robot.

    ``said_at_s`` is the time of the wall, ``stamp`` the last that was heard from the robot.
    """

    id: bytes
    robot: int
    wanted: Wanted
    said_at_s: float
    stamp: Stamp | None


class Outcome(Enum):
    """What became of a request."""

    HEARD = "heard"  #: there was nothing to be done
    DONE = "done"
    REFUSED = "refused"  #: it does not fit to the robot's state, which is no mistake of the wire
    STALE = "stale"  #: it has to be said again, with the stamp of this answer


class Reply(Flat, frozen=True):
    """Message: a robot's answer to the request with this id.

    ``state`` is how the robot is doing, in words; ``why`` is why it was refused.
    """

    id: bytes
    robot: int
    outcome: Outcome
    state: str
    why: str
    stamp: Stamp


OrderMessage = Request | Reply
