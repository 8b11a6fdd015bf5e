"""Progress and cancellation of calls, and the number of processes."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import TypeAlias

from msgspec import Struct


class Progress(Struct, frozen=True):
    """Progress of a call, as a message: ``bmc, round 3 of 20``.

    ``round`` and ``time_s`` are set by runs of robots: the rounds that are over, and the seconds
    of the run.
    """

    message: str
    round: int | None = None
    time_s: float | None = None


#: What hears of progress. It is called from the thread that asked for the work, often.
Listener: TypeAlias = Callable[[Progress], None]


class Cancellation:
    """A cancellation of calls, from another thread.

    They stop within a second or so, and answer with what they know by then::

        stop = koord.Cancellation()
        threading.Timer(60.0, stop.cancel).start()
        report = koord.verify("task.krd", cancellation=stop)
        report.interrupted  # True if it was cut short
    """

    def __init__(self) -> None:
        self._requested = False

    def cancel(self) -> None:
        """Cancel the calls. A second call has no effect."""
        self._requested = True

    @property
    def requested(self) -> bool:
        """True if the calls have been cancelled."""
        return self._requested


class CancelledError(Exception):
    """Raised where a call was cancelled before it had anything to return."""


def heard_by(listener: Listener | None) -> Listener:
    """The listener of a call; one that ignores progress if it is None."""
    return (lambda progress: None) if listener is None else listener


def teller(listener: Listener | None) -> Callable[[str], None]:
    """A function for engines' messages, which the listener hears as :class:`Progress`."""
    if listener is None:
        return lambda text: None
    return lambda text: listener(Progress(text))


def asker(cancellation: Cancellation | None, timeout_s: float | None = None) -> Callable[[], bool]:
    """A function that tells engines whether to stop: on cancellation, or after a time."""
    if timeout_s is not None:
        ends_at, cancelled = time.monotonic() + timeout_s, asker(cancellation)
        return lambda: cancelled() or time.monotonic() >= ends_at
    if cancellation is None:
        return lambda: False
    return lambda: cancellation.requested


def ended(cancellation: Cancellation | None, doing: str) -> CancelledError | TimeoutError:
    """The exception of a call that ended before it had anything to return."""
    if cancellation is not None and cancellation.requested:
        return CancelledError(doing)
    return TimeoutError(f"the time was up {doing}")


#: Processes of one call.
MOST_JOBS = 1_000


def cores() -> int:
    """The number of processes that can work in parallel, by the cores that the system allows."""
    ours = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return min(ours or 1, MOST_JOBS)
