"""The hash of a run: who ran which event in each round, and where robots were, to the last bit."""

from __future__ import annotations

import hashlib

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
    """A hash of a run: in each round, the robots' events and their positions."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()

    def note(self, round_: int, events: Ints) -> None:
        """Hash the robots' events in a round, by position of the event, shape ``(n,)``."""
        self._hash.update(np.int64(round_).tobytes())
        self._hash.update(events.tobytes())

    def place(self, positions: Floats) -> None:
        """Hash the robots' positions, shape ``(n, 3)``."""
        self._hash.update(np.ascontiguousarray(positions, dtype=np.float64).tobytes())

    def hexdigest(self) -> str:
        """The hexadecimal digest so far."""
        return self._hash.hexdigest()
