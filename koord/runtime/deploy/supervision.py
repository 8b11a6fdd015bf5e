"""Supervision: what is done about a robot whose process ends before the run is over.

A :class:`Supervisor` starts no processes and knows no clock: whoever drives it tells it what has
happened and when (seconds, from any beginning).
"""

from __future__ import annotations

from enum import Enum
from typing import assert_never

from msgspec import Struct, to_builtins
from msgspec.structs import replace

from koord.runtime.deploy.member import LANDING_S
from koord.runtime.deploy.status import RobotReport, continued, unheard
from koord.runtime.proposals import INIT_ROUND

#: A process that ends within so many seconds of its start has died at once; one that does so as
#: often in a row is not started again.
AT_ONCE_S, MOST_DEATHS = 3.0, 5

#: How long robots are waited for that can decide no round any more: what the others said before
#: they died may still be on its way.
STUCK_S = 2.0

#: How long robots are waited for that were told to stop: vehicles land first.
STOP_S = LANDING_S + 5.0


class EndCause(Enum):
    """The cause of a process's end."""

    DONE = "done"  #: the run was over
    STOPPED = "stopped"  #: it was asked to, and stopped safely
    KILLED = "killed"  #: by a signal
    CRASHED = "crashed"
    DEAF = "deaf"  #: it was told to stop, did not, and was killed
    AWAY = "away"  #: it was on a computer of its own; how is in the detail


class ProcessEnd(Struct, frozen=True):
    """The end of a robot's process."""

    pid: int
    cause: EndCause
    round: int | None = None  #: that it was in when it was last heard; None: it never was
    signal: int | None = None  #: that killed it, or that it stopped at
    detail: str | None = None  #: what it crashed with

    def __str__(self) -> str:
        took_part = self.round is not None and self.round > INIT_ROUND
        when = f"in round {self.round}" if took_part else "before it took part"
        match self.cause:
            case EndCause.DONE:
                return "done"
            case EndCause.STOPPED:
                asked = "" if self.signal is None else f" as it was asked to (signal {self.signal})"
                return f"its process stopped{asked} {when}"
            case EndCause.KILLED:
                return f"its process was killed (signal {self.signal}) {when}"
            case EndCause.CRASHED:
                return f"its process crashed {when}: {self.detail}"
            case EndCause.DEAF:
                return f"its process did not stop, and was killed {when}"
            case EndCause.AWAY:
                return self.detail or "it has not told how it ended"
            case _:
                assert_never(self.cause)


class ProcessState(Enum):
    """The state of a robot's process."""

    RUNNING = "running"
    OVER = "over"  #: it ended with the run, or was told to
    LOST = "lost"  #: it ended before its time, and was not started again
    GIVEN_UP = "given up"  #: nor will it be, as it died at once too often


class ProcessReport(Struct, frozen=True):
    """What became of a robot's process."""

    state: ProcessState = ProcessState.RUNNING
    restarts: int = 0  #: how often it was started again
    end: ProcessEnd | None = None  #: how it last ended before its time; None: it did not

    @property
    def is_running(self) -> bool:
        return self.state is ProcessState.RUNNING

    @property
    def is_lost(self) -> bool:
        """True if it ended before its time, and was not started again."""
        return self.state in (ProcessState.LOST, ProcessState.GIVEN_UP)

    @property
    def restarted(self) -> str:
        """How often it was started again, in words; nothing if it was not."""
        if not self.restarts:
            return ""
        often = "once" if self.restarts == 1 else f"{self.restarts} times"
        return f"restarted {often}"

    @property
    def story(self) -> str:
        """How it last ended, and what was done about it; nothing if it did not."""
        is_given_up = self.state is ProcessState.GIVEN_UP
        given_up = f"given up, as it died at once {MOST_DEATHS} times" if is_given_up else ""
        told = ("" if self.end is None else str(self.end), self.restarted, given_up)
        return "; ".join(filter(None, told))

    def to_dict(self) -> dict[str, object]:
        """The report as plain data, with its story."""
        return {**to_builtins(self), "story": self.story}


class Supervisor:
    """The supervisor of a run: the processes of its robots, and their last reports."""

    def __init__(self, robots: int, owing: frozenset[int], now: float, *, restarts: bool) -> None:
        """Begin with a process for each robot. ``owing`` have to be heard in every round."""
        self.processes = {pid: ProcessReport() for pid in range(robots)}
        self.statuses: dict[int, RobotReport] = {}
        self.is_stopping = False
        self.stuck: str | None = None  #: why no round can be decided any more
        self._owing = owing
        self._restarts = restarts
        self._started = dict.fromkeys(range(robots), now)
        self._deaths = dict.fromkeys(range(robots), 0)  #: at once, in a row
        self._before: dict[int, RobotReport] = {}  #: the last report of earlier processes
        self._has_begun = False
        self._stuck_since: float | None = None
        self._stopping_since = 0.0

    def heard(self, status: RobotReport) -> RobotReport:
        """Note a robot's report; return it with what its earlier processes counted."""
        before = self._before.get(status.pid)
        known = status if before is None else continued(before, status)
        self.statuses[status.pid] = known
        self._has_begun = self._has_begun or status.round > INIT_ROUND
        return known

    def ended(self, end: ProcessEnd, now: float) -> bool:
        """Note the end of a robot's process; return whether to start another now."""
        pid, known = end.pid, self.processes[end.pid]
        if end.cause is EndCause.DONE or (end.cause is EndCause.STOPPED and self.is_stopping):
            self.processes[pid] = replace(known, state=ProcessState.OVER)
            return False
        self._before[pid] = self.statuses.setdefault(pid, unheard(pid))
        at_once = now - self._started[pid] < AT_ONCE_S
        self._deaths[pid] = self._deaths[pid] + 1 if at_once else 0
        self.processes[pid] = replace(known, state=self._state_after(end), end=end)
        if not self.processes[pid].is_running:
            return False
        self.processes[pid] = replace(self.processes[pid], restarts=known.restarts + 1)
        self._started[pid] = now
        return True

    def _state_after(self, end: ProcessEnd) -> ProcessState:
        """The state of a process that ended before its time; it runs if it is started again."""
        # Nobody could tell it anything once all others are done and have left.
        is_over = self.is_stopping or any(map(_is_done, self.statuses.values()))
        if not self._restarts or is_over or end.cause is EndCause.STOPPED:
            return ProcessState.LOST
        if self._deaths[end.pid] >= MOST_DEATHS:
            return ProcessState.GIVEN_UP
        return ProcessState.RUNNING

    def stop(self, now: float) -> None:
        """Note that all robots are told to stop."""
        if not self.is_stopping:
            self.is_stopping, self._stopping_since = True, now

    def is_stuck(self, now: float) -> bool:
        """Return whether no round can be decided any more, for a while now; ``stuck`` says why."""
        reason = None if self.is_stopping else self._hindrance()
        if reason is None:
            self._stuck_since = None
            return False
        if self._stuck_since is None:
            self._stuck_since = now
        if now - self._stuck_since < STUCK_S:
            return False
        self.stuck = reason
        return True

    def overdue(self, now: float) -> tuple[int, ...]:
        """The robots that were told to stop, and have had time enough."""
        if not self.is_stopping or now - self._stopping_since < STOP_S:
            return ()
        return tuple(pid for pid, process in self.processes.items() if process.is_running)

    def _hindrance(self) -> str | None:
        """Why robots that run cannot decide a round any more, or None. (R-MAJORITY) (R-OWED)"""
        gone = [pid for pid, process in self.processes.items() if not process.is_running]
        running = [pid for pid, process in self.processes.items() if process.is_running]
        done = [pid for pid in running if pid in self.statuses and _is_done(self.statuses[pid])]
        if not running or not gone or done:
            return None  # who is done tells the others, and leaves soon
        robots = len(self.processes)
        if not self._has_begun:
            return f"the run cannot begin without {_named(gone)}"
        if len(running) < robots // 2 + 1:
            return (
                f"no round can be decided any more without {_named(gone)}: "
                f"{len(running)} of {robots} is no majority"
            )
        if missed := [pid for pid in gone if pid in self._owing]:
            return f"no round can be decided any more without {_named(missed)}, which may not skip"
        return None


def _is_done(status: RobotReport) -> bool:
    return status.is_over or status.all_stopped


def _named(pids: list[int]) -> str:
    """Robots by their pids: ``robot 1``, ``robots 1 and 2``."""
    if len(pids) == 1:
        return f"robot {pids[0]}"
    return f"robots {', '.join(map(str, pids[:-1]))} and {pids[-1]}"
