"""The watch on the claims of a deployed run, where its robots are heard of. (P-WATCH)"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from koord.api.breaches import BrokenStatement, Grounds, broken_statements
from koord.api.fitting import Fitted
from koord.runtime.deploy.running import Job, RoundReport, ideal_host
from koord.runtime.deploy.status import RobotReport
from koord.runtime.deploy.supervision import ProcessReport
from koord.runtime.deploy.watching import Breach, FleetMonitor, joined
from koord.runtime.robot import AnsweringHost


class FleetWatch:
    """What is known of the claims of a run: what robots tell, and what all of them show."""

    def __init__(self, fitted: Fitted, job: Job, grounds: Grounds | None) -> None:
        self._program, self._grounds = fitted.program, grounds
        self._breaches: dict[int, tuple[Breach, ...]] = {}
        self._unwatched: set[str] = set()
        assert job.watched is not None
        self._watched = job.watched
        self._monitor: FleetMonitor | None = None
        if job.is_local:
            host = _host(fitted, job)
            self._monitor = FleetMonitor(job.watched, job.classes, job.kinds, job.delta_s, host)

    def hear(
        self,
        news: Iterable[tuple[RobotReport, tuple[RoundReport, ...]]],
        processes: Mapping[int, ProcessReport] | None = None,
    ) -> None:
        """Take note of what robots tell, and look at what is known of all by now."""
        for status, moments in news:
            self._breaches[status.pid] = status.breaches
            self._unwatched |= set(status.unwatched)
            if self._monitor is not None:
                for moment in moments:
                    if moment.state is not None:
                        self._monitor.hear(moment.pid, moment.state)
        if self._monitor is not None:
            lost = {pid for pid, one in (processes or {}).items() if one.is_lost}
            self._monitor.look(set(range(self._monitor.robots)) - lost)

    @property
    def breaches(self) -> tuple[Breach, ...]:
        """The breaches so far."""
        of_all = () if self._monitor is None else self._monitor.breaches.all
        return joined(*(self._breaches[pid] for pid in sorted(self._breaches)), of_all)

    @property
    def broken(self) -> tuple[BrokenStatement, ...]:
        """The claims that did not hold so far."""
        return tuple(broken_statements(self._program, self.breaches, self._grounds))

    @property
    def unwatched(self) -> tuple[str, ...]:
        """The claims of which nobody knew enough to look at them."""
        found = set(self._unwatched)
        if self._monitor is None:
            found |= FleetMonitor.claims_of(self._watched)
        else:
            found |= self._monitor.unknown
        return tuple(sorted(found))


def _host(fitted: Fitted, job: Job) -> AnsweringHost:
    """What answers the questions of claims about all robots."""
    if job.platforms is None:
        return ideal_host(job, 0)
    from koord.api.platforms import claims_host

    return claims_host(fitted, job)
