"""The page of a deployed fleet, served while it moves: read-only. (P-LIVE)"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from koord.api.fitting import Fitted
from koord.api.fleet_watch import FleetWatch
from koord.api.progress import Listener
from koord.api.served_page import PATIENCE_S, served_page
from koord.runtime.deploy.job import Job
from koord.runtime.deploy.news import News
from koord.sim.mirror import FleetMirror
from koord.sim.running import Cast, header_in


class LivePage:
    """What the page shows: where robots are, what they do, and what does not hold."""

    def __init__(self, fitted: Fitted, job: Job, watch: FleetWatch) -> None:
        scene, source = fitted.scene, fitted.program.source
        differing = fitted.problem.differing
        cast = Cast(source.name, source.text, job.classes, job.kinds, differing)
        header = header_in(cast, scene)
        monitor = watch.monitor
        starts = [placed.start for placed in scene.robots]
        self.mirror = FleetMirror(header, starts, monitor.robots, monitor.store)
        monitor.seen = self.mirror.begun
        self._watch = watch
        self._broken: set[tuple[str, tuple[int, ...]]] = set()

    def hear(self, news: Iterable[News]) -> None:
        """Show what robots tell; who watches hears of it afterwards."""
        news = list(news)
        self.mirror.hear(news)
        for one in news:
            for note in one.status.notes:
                self.mirror.remark(one.status.pid, note)

    def show_broken(self) -> None:
        """Show the claims that did not hold, of which that is not shown yet."""
        for one in self._watch.broken:
            if one.key not in self._broken:
                self._broken.add(one.key)
                words = f"{one.place}, in round {one.round + 1}"
                self.mirror.violated(one.claim, words, one.robots)


@contextmanager
def live_page(
    fitted: Fitted, job: Job, watch: FleetWatch, address: tuple[str, int], tell: Listener
) -> Iterator[LivePage]:
    """Serve the page of a fleet at an address and port (0: any). Raises KoordError."""
    page = LivePage(fitted, job, watch)
    cure = "say another address, or leave it out"
    with served_page(page.mirror.log, tell, cure, address) as live:
        try:
            yield page
        finally:
            page.show_broken()
            page.mirror.end("the run is over")
            live.wait_for_watchers(PATIENCE_S)
