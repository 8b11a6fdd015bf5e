"""The hash of a run: who ran which event in each round, and where robots were, to the last bit."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Sequence

import numpy as np

from koord.runtime.motion.arrays import Floats, Ints
from koord.runtime.proposals import Decision

#: Of a robot that skipped, and of one that began.
SKIPPED, BEGAN = -1, -2


def events_of(decision: Decision, robots: int) -> Ints:
    """The position of the event that each robot ran."""
    events = np.full(robots, SKIPPED, np.int64)
    for taken in decision.ran:
        events[taken.robot] = BEGAN if taken.event is None else taken.event
    return events


class Digest:
    """A hash of a run of so many robots: in each round, their events and their positions."""

    def __init__(self, robots: int) -> None:
        self._hash = hashlib.sha256()
        self._robots = robots
        self._nothing = np.full(robots, SKIPPED, np.int64).tobytes()

    def note(self, decision: Decision) -> None:
        """Hash the robots' events in a round, by position of the event."""
        ran = decision.ran
        events = events_of(decision, self._robots).tobytes() if ran else self._nothing
        self._begin(decision.round, events)

    def _begin(self, number: int, events: bytes) -> None:
        self._hash.update(number.to_bytes(8, sys.byteorder, signed=True))
        self._hash.update(events)

    def place(self, positions: Floats) -> None:
        """Hash the robots' positions, shape ``(n, 3)``."""
        self._hash.update(np.ascontiguousarray(positions, dtype=np.float64).reshape(-1).data)

    def pass_idle(self, first: int, places: Sequence[Floats]) -> None:
        """Hash rounds in which nobody acted, from the first on, each with the robots' positions."""
        for number, place in enumerate(places, first):
            self._begin(number, self._nothing)
            self.place(place)

    def reload(self, number: int, text: str) -> None:
        """Hash that another program goes on before a round: events are counted by its text."""
        self._hash.update(number.to_bytes(8, sys.byteorder, signed=True))
        self._hash.update(hashlib.sha256(text.encode("utf-8", "surrogatepass")).digest())

    def hexdigest(self) -> str:
        """The hexadecimal digest so far."""
        return self._hash.hexdigest()
