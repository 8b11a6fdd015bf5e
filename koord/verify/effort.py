"""Budgets: deadlines in time, and effort in solver units, which is equal on every machine."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from msgspec import Struct

#: What part of its time somebody may take longer to end in good order, and in seconds at least.
GRACE, GRACE_S = 0.05, 0.1


#: The same of somebody's share of the time, while others wait.
OVERTIME = 0.2


class Deadline(Struct):
    """A deadline for solver queries; None: never.

    ``cpu_at`` is one in the time of this process' own work, which passes no faster where others
    work as well.
    """

    at: float | None = None
    cpu_at: float | None = None

    def __reduce__(self) -> tuple[object, ...]:
        # Clocks of other machines are others: it is sent as what is left of it.
        left_s = None if self.at is None else self.at - time.monotonic()
        cpu_left_s = None if self.cpu_at is None else self.cpu_at - time.process_time()
        return _deadline, (left_s, cpu_left_s)

    @staticmethod
    def after(seconds: float | None) -> Deadline:
        return Deadline(None if seconds is None else time.monotonic() + seconds)

    def left_s(self) -> float | None:
        left = []
        if self.at is not None:
            left.append(self.at - time.monotonic())
        if self.cpu_at is not None:
            left.append(self.cpu_at - time.process_time())
        return max(0.0, min(left)) if left else None

    def is_near(self) -> bool:
        """Return whether a solver that stops now may have stopped because of the deadline."""
        left = self.left_s()
        return left is not None and left < 0.05

    def passed(self) -> bool:
        left = self.left_s()
        return left is not None and left <= 0

    @contextmanager
    def sharing(self, part: float) -> Iterator[float | None]:
        """Share the remaining time: within the context, only a part of it is left.

        It yields the moment when somebody is to be ended who does not look at the clock.
        """
        whole = self.at
        ended = None
        if whole is not None:
            now = time.monotonic()
            share = part * max(0.0, whole - now)
            self.at, ended = now + share, now + (1 + OVERTIME) * share
        try:
            yield ended
        finally:
            self.at = whole

    def at_last(self) -> float | None:
        """The time at which to end a process that ignores the deadline, with time left to
        report.
        """
        left = self.left_s()
        if self.at is None or left is None:
            return None
        return self.at + max(GRACE_S, GRACE * left) / 2

    def sooner(self, seconds: float) -> Deadline:
        """The earlier deadline: this one, or a number of seconds from now."""
        soon = time.monotonic() + seconds
        return Deadline(soon if self.at is None else min(self.at, soon), self.cpu_at)

    def of_work(self, seconds: float) -> Deadline:
        """The same deadline, or a number of seconds of this process' own CPU time."""
        soon = time.process_time() + seconds
        return Deadline(self.at, soon if self.cpu_at is None else min(self.cpu_at, soon))


def _deadline(left_s: float | None, cpu_left_s: float | None) -> Deadline:
    cpu_at = None if cpu_left_s is None else time.process_time() + cpu_left_s
    return Deadline(Deadline.after(left_s).at, cpu_at)


#: Roughly what a solver does in a second, in its own units.
PER_SECOND = 10_000_000


class Effort(Struct):
    """The work a solver may still do, in its own units: equal on every machine, loaded or not.

    So whether a proof is found does not depend on how fast it is looked for.
    """

    left: int

    @staticmethod
    def of_seconds(seconds: float) -> Effort:
        """The effort that a solver spends in about that time."""
        return Effort(int(seconds * PER_SECOND))

    def limit(self, at_most: int) -> int:
        """The limit of one query: all effort that is left, or ``at_most`` of it (0: all)."""
        return min(self.left, at_most or self.left)
