"""A deployed run as it is followed here: looked at, watched, shown, recorded, and judged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from koord.api.breaches import Grounds
from koord.api.deploy_recorder import Recorder
from koord.api.deploy_request import DeployRequest
from koord.api.deployed import Deployed, FleetHeard
from koord.api.fitting import Fitted
from koord.api.fleet_watch import FleetWatch
from koord.api.preflight import Approval, Looking
from koord.api.progress import Cancellation, CancelledError, Listener, asker
from koord.runtime.deploy.job import Job, Make, member_of
from koord.runtime.deploy.news import Kept, News
from koord.runtime.deploy.status import RobotReport
from koord.runtime.deploy.supervision import ProcessReport
from koord.runtime.motion.libraries import SIM, require
from koord.syntax.diagnostics import Diagnostic, KoordError, refusal
from koord.syntax.source import visible

if TYPE_CHECKING:
    from koord.api.deployed_parts import Parts
    from koord.api.live_page import LivePage


class Deployment(Struct, frozen=True):
    """A prepared run, with those who hear of it and have a say in it."""

    fitted: Fitted
    job: Job
    request: DeployRequest
    progress: Listener
    cancellation: Cancellation | None
    grounds: Grounds | None
    approve: Approval

    @property
    def is_cancelled(self) -> Callable[[], bool]:
        return asker(self.cancellation)


class FollowedRun:
    """What is made of all that robots tell while they run: made before them, as it makes them tell.

    Raises KoordError for what cannot be written, served or judged.
    """

    def __init__(self, of: Deployment, stack: ExitStack) -> None:
        job, request = of.job, of.request
        self.looking: Looking | None = None  #: None: people do not look, or not yet
        self._of = of
        self._parts = _parts(of, stack)
        self._recorder: Recorder | None = None
        if request.record is not None:
            self._recorder = Recorder(request.record, of.fitted.problem, self._parts, stack)
        self._watch = FleetWatch(of.fitted, job, of.grounds, request.pid)
        self._page = self._served(stack)

    def _served(self, stack: ExitStack) -> LivePage | None:
        """The page that is served while the run goes on, if that is wanted. Raises KoordError."""
        of = self._of
        if of.request.live is None:
            return None
        require(SIM, "sim")
        from koord.api.live_page import live_page

        page = live_page(of.fitted, of.job, self._watch, of.request.live, of.progress)
        return stack.enter_context(page)

    @property
    def make(self) -> Make:
        """What makes a robot of the run, which tells its part if that is wanted."""
        return member_of if self._parts is None else self._parts.member

    @property
    def keeps(self) -> Kept:
        """What robots are to tell: not more than somebody looks at, as telling takes time."""
        is_shown = self._page is not None
        rounds = is_shown or self._recorder is not None
        return Kept(rounds=rounds, states=self._watch.wants_states, poses=is_shown)

    def begin(self) -> None:
        """Let people look at the robots, now that these are there. (P-PREFLIGHT)"""
        of = self._of
        if of.job.waits:
            robots = of.job.robots if of.request.pid is None else 1
            self.looking = Looking(robots, of.approve, only_looks=of.request.preflight)

    def look(self, statuses: Mapping[int, RobotReport]) -> bool | None:
        """Ask people: True lets robots take part in the run, False stops them, None waits."""
        return None if self.looking is None else self.looking.hear(statuses)

    def hear(
        self,
        news: Sequence[News],
        processes: Mapping[int, ProcessReport] | None = None,
        *,
        is_sure: bool = True,
    ) -> None:
        """Watch, show and record what robots tell; ``is_sure``: none of them is turned away."""
        if self._page is not None:
            self._page.hear(news)
        self._watch.hear(news, processes)
        if self._page is not None:
            self._page.show_broken()
        if self._recorder is not None:
            self._recorder.hear(news, processes, is_sure=is_sure)

    def tell(
        self,
        statuses: Mapping[int, RobotReport],
        processes: Mapping[int, ProcessReport] | None = None,
    ) -> None:
        """Say how robots are doing."""
        of = self._of
        of.progress(FleetHeard.of(statuses, of.job.rounds, processes, self._watch.broken))

    def ended(
        self,
        statuses: Mapping[int, RobotReport],
        processes: Mapping[int, ProcessReport] | None = None,
        stuck: str | None = None,
    ) -> Deployed:
        """Make the result from the robots' last reports, with the trace that is wanted.

        Raises KoordError if people have refused the run.
        """
        of, parts = self._of, self._parts
        interrupted = of.is_cancelled()
        ended = replace(
            Deployed.of(of.job, of.fitted.problem, statuses, interrupted=interrupted),
            broken=self._watch.broken,
            unwatched=self._watch.unwatched,
            processes=dict(processes or {}),
            stuck=stuck,
            unmerged=self._unrecorded(),
        )
        if self.looking is not None and not self.looking.is_approved:
            return self._looked(ended, self.looking)
        if parts is None:
            return ended
        ended = replace(ended, aside=None if parts.aside is None else str(parts.aside))
        if parts.trouble is not None:
            ended = replace(ended, unmerged=parts.trouble.diagnostics + ended.unmerged)
        if of.request.trace is None:
            if not ended.unmerged:
                parts.remove()  # the recording has them
            return ended
        return self._traced(ended, parts, of.request.trace) if of.request.pid is None else ended

    def _unrecorded(self) -> tuple[Diagnostic, ...]:
        """Finish the recording, if there is one; return why it ends before the run, if it does."""
        trouble = None if self._recorder is None else self._recorder.close()
        if trouble is None:
            return ()
        request, parts = self._of.request, self._parts
        assert request.record is not None
        story = f"the recording ends early, as it cannot be written: {trouble.strerror}"
        is_left = parts is not None and request.trace is None
        hint = f"what robots told is left in {parts.folder}" if parts and is_left else None
        return refusal("K903", visible(request.record), story, hint).diagnostics

    def _looked(self, ended: Deployed, looking: Looking) -> Deployed:
        """The result where people only looked. Raises KoordError if they have refused a run."""
        if self._parts is not None:
            self._parts.remove()
        if not (self._of.request.preflight or ended.interrupted or ended.stuck):
            raise KoordError(looking.refusals(self._of.job.configuration.name))
        return replace(ended, preflight=looking.found)

    def _traced(self, ended: Deployed, parts: Parts, trace: str) -> Deployed:
        """Write the trace of all robots, and judge it.

        Who cancels the run waits for its trace; who does so now, or insists, does not.
        """
        of = self._of
        try:
            merged = parts.merged(of.progress, None if ended.interrupted else of.cancellation)
            merged.trace.save(trace)
        except KoordError as error:
            unmerged = ended.unmerged + error.diagnostics
            return replace(ended, unmerged=unmerged, left=str(parts.folder))
        except (CancelledError, KeyboardInterrupt):
            left = parts.unmerged(trace)
            return replace(ended, interrupted=True, unmerged=ended.unmerged + left.diagnostics)
        if not merged.has_all_told:
            return replace(ended, merged=merged, left=str(parts.folder))
        if of.request.state is None or not ended.interrupted:
            parts.remove()  # else the run may go on
        return replace(ended, merged=merged)


def _parts(of: Deployment, stack: ExitStack) -> Parts | None:
    """The parts that robots are to write; None if nobody wants to judge the run.

    Raises KoordError.
    """
    request, job = of.request, of.job
    trace, pid = request.trace, request.pid
    beside = request.record if trace is None else trace
    if beside is None:
        return None
    from koord.api.deployed_parts import Parts, check_judgeable, folder_of, part_files

    try:
        check_judgeable(of.fitted)
    except KoordError:
        if trace is None:
            return None  # what robots do is recorded all the same
        raise
    if trace is not None and pid is not None:
        return Parts.of(of.fitted, job, {pid: Path(trace)})
    pids = range(job.robots) if pid is None else (pid,)
    goes_on = (pid is not None or request.state is not None) and not request.fresh
    files, aside = stack.enter_context(part_files(folder_of(beside), pids, goes_on=goes_on))
    return Parts.of(of.fitted, job, files, aside)
