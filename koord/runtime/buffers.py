"""Events of compiled programs, and what running one would change: nothing has happened yet."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from msgspec import Struct

from koord.runtime.proposals import EventFault, StopRequests


class Event(Struct, frozen=True):
    """An event of a compiled program. Without ``pre`` it is always enabled."""

    name: str
    effect: Callable[[Any], None]
    pre: Callable[[Any], bool] | None = None
    urgent: bool = False


class Written(Struct, frozen=True):
    """The output of one statement to a stream; ``place`` is that of the statement. [OUTPUT]"""

    stream: str
    place: str
    values: tuple[Any, ...]


class Tried(NamedTuple):
    """What a tentative event has changed of its robot, by attribute, and its output."""

    changes: Mapping[str, Any]
    output: tuple[Written, ...] = ()


class Buffer:
    """A tentative event (None: INIT): its changes, which take effect only on commit.

    ``in_pre`` says of a fault that already ``pre`` cannot be evaluated: then the event does not
    oblige the robot.
    """

    __slots__ = ("asked", "event", "fault", "in_pre", "locks", "output", "state", "writes")

    def __init__(self, event: int | None) -> None:
        self.event = event
        self.state: dict[str, Any] = {}
        self.writes: list[tuple[str, tuple[Any, ...], Any]] = []
        self.locks: set[int] = set()
        self.output: list[Written] = []
        self.asked = StopRequests.NOTHING
        self.fault: EventFault | None = None
        self.in_pre = False
