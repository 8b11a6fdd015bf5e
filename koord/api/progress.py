"""How work tells what it is doing, how it is ended from elsewhere, and in how many processes."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import TypeAlias

from msgspec import Struct


class Progress(Struct, frozen=True):
    """What is being done now: ``bmc, round 3 of 20``.

    ``round`` and ``time_s`` are set by runs of robots: the rounds that are over, and the seconds
    of the run.
    """

    message: str
    round: int | None = None
    time_s: float | None = None


#: What hears of progress. It is called from the thread that asked for the work, often.
Listener: TypeAlias = Callable[[Progress], None]


class Cancellation:
    """Ends calls that it is given to, from another thread.

    They stop within a second or so, and answer with what they know by then::

        stop = koord.Cancellation()
        threading.Timer(60.0, stop.cancel).start()
        report = koord.verify("task.krd", cancellation=stop)
        report.interrupted  # True if it was cut short
    """

    def __init__(self) -> None:
        self._requested = False

    def cancel(self) -> None:
        """End the calls. To ask twice is the same as to ask once."""
        self._requested = True

    @property
    def requested(self) -> bool:
        """Whether somebody has asked for the end."""
        return self._requested


class CancelledError(Exception):
    """A call was cancelled before there was anything to answer."""


def heard_by(listener: Listener | None) -> Listener:
    """What work tells its progress to; nobody hears it where nobody wants to."""
    return (lambda progress: None) if listener is None else listener


def teller(listener: Listener | None) -> Callable[[str], None]:
    """What engines tell their progress to: words, which the listener hears as :class:`Progress`."""
    if listener is None:
        return lambda text: None
    return lambda text: listener(Progress(text))


def asker(cancellation: Cancellation | None, timeout_s: float | None = None) -> Callable[[], bool]:
    """What engines ask whether to stop: when somebody cancels, or so many seconds from now."""
    if timeout_s is not None:
        ends_at, cancelled = time.monotonic() + timeout_s, asker(cancellation)
        return lambda: cancelled() or time.monotonic() >= ends_at
    if cancellation is None:
        return lambda: False
    return lambda: cancellation.requested


def ended(cancellation: Cancellation | None, doing: str) -> CancelledError | TimeoutError:
    """What is raised if a call was to stop before there was anything to answer."""
    if cancellation is not None and cancellation.requested:
        return CancelledError(doing)
    return TimeoutError(f"the time was up {doing}")


#: Processes of one call.
MOST_JOBS = 1_000


def cores() -> int:
    """How many processes can work at the same time, where the system has only some cores for us."""
    ours = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return min(ours or 1, MOST_JOBS)
