"""Limits of a search: states, time and memory."""

from __future__ import annotations

import time
from collections.abc import Callable

from msgspec import Struct

_STATM = "/proc/self/statm"
_PAGE_BYTES = 4096

#: So many looks at a meter are cheap before one that is not.
_EVERY = 200

OUT_OF_TIME = "out of time"

#: Seconds between two reports of progress.
TELL_EVERY_S = 0.1


#: So many states are looked at in no time.
HANDFUL = 2_000

#: So many states are few: other ways to an answer get their turn after them.
FEW_STATES = 20_000

#: So many ways to go on from them are looked at where others wait.
FEW_EDGES = 100_000


#: As long as Python takes for a state, machine code takes for so many, or more.
_COMPILED_STATES = 32


class Limits(Struct, frozen=True):
    """Bounds of a search. ``deadline_s`` is a time on the search's clock; None means no bound.

    ``states`` are those of a search by Python.
    """

    states: int = 2_000_000
    memory_mb: int = 4_000
    rounds: int | None = None
    deadline_s: float | None = None

    @property
    def compiled_states(self) -> int:
        """So many states a search on machine code may see."""
        return self.states * _COMPILED_STATES


class LimitReachedError(Exception):
    """A limit is reached; the message says which."""


class Meter:
    """A check of the limits. It reads the clock and the memory only now and then."""

    def __init__(self, limits: Limits, clock: Callable[[], float] = time.monotonic) -> None:
        self.limits = limits
        self._clock = clock
        self._countdown = 1
        self._told_s = clock()

    def reached(self, states: int) -> str:
        """The limit that is reached, in words; empty if none is."""
        if states <= self.limits.states:
            self._countdown -= 1
            if self._countdown > 0:
                return ""
        return self.reached_now(states)

    def reached_now(self, states: int, most: int | None = None) -> str:
        """The limit that is reached, as :meth:`reached` says it, without waiting to look.

        ``most`` states are permitted, if that is not what the limits say.
        """
        most = self.limits.states if most is None else most
        if states > most:
            return f"more than {most} states"
        self._countdown = _EVERY
        deadline = self.limits.deadline_s
        if deadline is not None and self._clock() >= deadline:
            return OUT_OF_TIME
        if resident_mb() > self.limits.memory_mb:
            return f"more than {self.limits.memory_mb} MB of memory"
        return ""

    def is_time_to_tell(self) -> bool:
        """Return whether progress should be reported again."""
        if self._countdown != _EVERY:
            return False
        now = self._clock()
        if now - self._told_s < TELL_EVERY_S:
            return False
        self._told_s = now
        return True


def resident_mb() -> float:
    """The memory that this process holds, in MB; 0 where the system does not say."""
    try:
        with open(_STATM, encoding="ascii") as file:
            pages = int(file.read().split()[1])
    except (OSError, ValueError, IndexError):
        return 0.0
    return pages * _PAGE_BYTES / 1e6
