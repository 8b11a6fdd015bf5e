"""How rounds go, and how far they go where something is in doubt. [SELECT]"""

from __future__ import annotations

from enum import Enum, IntEnum
from typing import NamedTuple


class Schedule(Enum):
    """How robots move."""

    IN_ORDER = "in order"
    AT_RANDOM = "at random"


class Stage(IntEnum):
    """How far a round was made."""

    WHOLE = 0
    GUARDS = 1  #: up to a robot that was picked, and whose guards are in doubt
    EVENT = 2  #: up to an event that was picked, and is in doubt
    CLAIMS = 3  #: through a turn after which not all claims hold, as far as code can tell
    ENVIRONMENT = 4  #: through the program turns; some model is in doubt
    SENSING = 5  #: through the program turns; sensors without a model are to be read
    END = 6  #: to its end, where not all claims hold, as far as code can tell


class Halt(NamedTuple):
    """Where a round halted: the stage, and the robot and the event that were picked.

    An event that was picked may have lost its lock since.
    """

    stage: int
    robot: int
    event: int | None
