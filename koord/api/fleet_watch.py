"""The watch on the claims of a deployed run, where its robots are heard of. (P-WATCH)"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from koord.api.breaches import BrokenStatement, Grounds, broken_statements
from koord.api.fitting import Fitted
from koord.runtime.deploy.job import Job, ideal_host
from koord.runtime.deploy.news import News
from koord.runtime.deploy.supervision import ProcessReport
from koord.runtime.deploy.watching import Breach, FleetMonitor, joined
from koord.runtime.robot import AnsweringHost


class FleetWatch:
    """What is known of the claims of a run: what robots tell, and what all of them show."""

    def __init__(
        self, fitted: Fitted, job: Job, grounds: Grounds | None, pid: int | None = None
    ) -> None:
        """Watch a run; ``pid``: of this robot alone, as the others tell nothing here."""
        assert job.watched is not None
        self._program, self._grounds = fitted.program, grounds
        self._breaches: dict[int, tuple[Breach, ...]] = {}
        self._unwatched: set[str] = set()
        self._there = set(range(job.robots)) if pid is None else {pid}
        has_all = len(self._there) == job.robots
        claims = FleetMonitor.claims_of(job.watched)
        self.wants_states = bool(claims)  #: of robots, to look at claims
        self._of_others = set() if has_all else claims
        self.monitor = FleetMonitor(
            job.watched, job.classes, job.kinds, job.delta_s, _host(fitted, job)
        )

    def hear(
        self, news: Iterable[News], processes: Mapping[int, ProcessReport] | None = None
    ) -> None:
        """Take note of what robots tell, and look at what is known of all by now."""
        for one in news:
            self._breaches[one.status.pid] = one.status.breaches
            self._unwatched |= set(one.status.unwatched)
            for told in one.rounds:
                if told.state is not None:
                    self.monitor.hear(told.pid, told.state)
            for lasting in one.states:
                self.monitor.hear(one.status.pid, lasting.state, lasting.rounds)
        lost = {pid for pid, one in (processes or {}).items() if one.is_lost}
        self.monitor.look(self._there - lost)

    @property
    def breaches(self) -> tuple[Breach, ...]:
        """The breaches so far."""
        told = (self._breaches[pid] for pid in sorted(self._breaches))
        return joined(*told, self.monitor.breaches.all)

    @property
    def broken(self) -> tuple[BrokenStatement, ...]:
        """The claims that did not hold so far."""
        breaches = self.breaches
        if not breaches:  # as it is asked all the time, and texts need not be looked at
            return ()
        return tuple(broken_statements(self._program, breaches, self._grounds))

    @property
    def unwatched(self) -> tuple[str, ...]:
        """The claims of which nobody knew enough to look at them, or not for all robots."""
        return tuple(sorted({*self._unwatched, *self._of_others, *self.monitor.unknown}))


def _host(fitted: Fitted, job: Job) -> AnsweringHost:
    """What answers the questions of claims about all robots."""
    if job.platforms is None:
        return ideal_host(job, 0)
    from koord.api.platforms import claims_host

    return claims_host(fitted, job)
