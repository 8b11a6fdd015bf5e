"""The processes of a run under supervision: those that end before their time are noticed."""

from __future__ import annotations

import time
from collections.abc import Mapping

from msgspec import structs

from koord.runtime.deploy.local import Launch, launched
from koord.runtime.deploy.news import News
from koord.runtime.deploy.status import RobotReport
from koord.runtime.deploy.supervision import EndCause, ProcessReport, Supervisor


class SupervisedProcesses:
    """A process for each robot of a run, and what a supervisor has done about them."""

    def __init__(self, launch: Launch, *, restarts: bool) -> None:
        """Start a process for each robot; ``restarts`` of those that crash."""
        job = launch.job
        self._fleet = launched(launch)
        self._supervisor = Supervisor(job.robots, job.owing, time.monotonic(), restarts=restarts)
        self._overdue: set[int] = set()

    @property
    def statuses(self) -> Mapping[int, RobotReport]:
        """The last report of each robot."""
        return self._supervisor.statuses

    @property
    def processes(self) -> Mapping[int, ProcessReport]:
        """What became of each robot's process."""
        return self._supervisor.processes

    @property
    def stuck(self) -> str | None:
        """Why no round could be decided any more, so that all were told to stop."""
        return self._supervisor.stuck

    @property
    def is_over(self) -> bool:
        """True if no process will report anything more."""
        return self._fleet.is_over

    @property
    def is_accepted(self) -> bool:
        """True if each robot has begun, or ended."""
        return self._fleet.is_over or len(self.statuses) == len(self.processes)

    def turn(self, timeout_s: float) -> list[News]:
        """Wait for reports, and return them; do what is to be done about processes that ended.

        Raises TransportError, if a robot could not begin.
        """
        supervisor, fleet = self._supervisor, self._fleet
        news = [
            structs.replace(said, status=supervisor.heard(said.status))
            for said in fleet.news(timeout_s)
        ]
        for pid, failure in fleet.failures.items():
            if not supervisor.processes[pid].restarts:
                raise failure
        now = time.monotonic()
        for end in fleet.ended():
            if end.pid in self._overdue:
                end = structs.replace(end, cause=EndCause.DEAF)
            if supervisor.ended(end, now):
                fleet.replace(end.pid)
            if supervisor.processes[end.pid].end is end:
                news.append(News(supervisor.statuses[end.pid]))
        if supervisor.is_stuck(now):
            self.stop()
        for pid in supervisor.overdue(now):
            self._overdue.add(pid)
            fleet.processes[pid].kill()
        return news

    def go(self) -> None:
        """Let all robots take part in the run. (P-PREFLIGHT)"""
        self._fleet.go()

    def stop(self) -> None:
        """Tell all robots to stop safely; one that does not is killed after a while."""
        if not self._supervisor.is_stopping:
            self._supervisor.stop(time.monotonic())
            self._fleet.stop()

    def close(self) -> None:
        """End all processes at once."""
        self._fleet.kill()
        self._fleet.join()
