"""Deployment: a program on one robot, or on processes of this machine for all robots."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from os import PathLike, fspath
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from msgspec import Struct
from msgspec.structs import replace

from koord.api.breaches import Grounds, grounds_of
from koord.api.configurations import check_start
from koord.api.deployed import Deployed, FleetHeard
from koord.api.drivers import localiser_registry, registry
from koord.api.files import check_writable, no_folder, same_file
from koord.api.fitting import Configurable, Fitted, fit, fit_request, is_placed, slack_of
from koord.api.fleet_watch import FleetWatch
from koord.api.preflight import Approval, Looking, good_enough
from koord.api.programs import Loadable, Value
from koord.api.progress import Cancellation, CancelledError, Listener, asker, heard_by
from koord.api.results import ArgumentError
from koord.api.robots import Seconds
from koord.api.undriven import Drivers, drivers_of, undriven, unserved
from koord.runtime.chaos.network import Faults
from koord.runtime.chaos.unreliable import Unreliable
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.compile.watching import watched
from koord.runtime.configuration.keys import SharedKey, shared_key
from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.deploy.ideal import unanswered
from koord.runtime.deploy.joining import knock
from koord.runtime.deploy.local import Launch, local_plan, transport_of
from koord.runtime.deploy.member import Platform
from koord.runtime.deploy.recording import DeploymentRecord
from koord.runtime.deploy.running import (
    CannotTakePartError,
    News,
    Runner,
    member_of,
    print_of,
)
from koord.runtime.deploy.running import Job as Job
from koord.runtime.deploy.status import RobotReport as RobotReport
from koord.runtime.deploy.supervised import SupervisedProcesses
from koord.runtime.deploy.supervision import ProcessReport
from koord.runtime.encoding import text_digest
from koord.runtime.motion.libraries import SIM, require
from koord.runtime.orders.lines import Addresses, Reach, robots_of
from koord.runtime.orders.places import Access, left
from koord.runtime.orders.reach import reach_of
from koord.runtime.ports import plain_name
from koord.runtime.protocol.handshake import Fingerprint
from koord.runtime.robot import Robot
from koord.runtime.transports.transport import Transport, TransportError
from koord.runtime.transports.udp import Udp
from koord.runtime.wire.frames import order_key
from koord.syntax import core
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity, refusal
from koord.syntax.problem import Problem
from koord.syntax.source import visible, whole_file
from koord.syntax.system import System

if TYPE_CHECKING:
    from koord.api.deployed_parts import Parts
    from koord.api.live_page import LivePage

#: Where a page is served if nobody says: on this machine alone, at any port.
LIVE = ("127.0.0.1", 0)

#: Where a robot notes where it is, if nobody says.
_STATE = ".koord"

#: Why a robot that runs by itself is not restarted.
NOT_RESTARTED = (
    "this is for robots that are all processes on this machine; what starts one restarts it"
)

#: Why a recording and a trace have names of their own.
NOT_TWICE = "this is the file of the trace as well: say another one"

#: How long processes are waited for at a time.
_WAIT_S = 0.2


class DeployRequest(Struct, frozen=True):
    """The request for a deployment. ``pid`` None: all robots, as processes on this machine."""

    pid: int | None = None
    rounds: int | None = None
    as_fast_as_possible: bool = False
    run: str | None = None
    state: str | None = None
    fresh: bool = False
    record: str | None = None
    restart: bool = False
    trace: str | None = None
    dry_run: bool = False
    allow_models: tuple[str, ...] = ()
    arm: bool = False
    preflight: bool = False
    rests_on: str | None = None
    live: tuple[str, int] | None = None  #: address and port
    loss: float = 0.0  #: the share of the datagrams that are lost on purpose


def deploy(
    program: Loadable,
    config: Configurable = None,
    *,
    pid: int | None = None,
    params: Mapping[str, Value] | None = None,
    delta_s: Seconds = None,
    rounds: int | None = None,
    as_fast_as_possible: bool = False,
    run: str | None = None,
    state: str | PathLike[str] | None = None,
    fresh: bool = False,
    record: str | PathLike[str] | None = None,
    restart: bool = False,
    trace: str | PathLike[str] | None = None,
    dry_run: bool = False,
    allow_models: Sequence[str] = (),
    arm: bool = False,
    approve: Approval | None = None,
    preflight: bool = False,
    rests_on: str | PathLike[str] | None = None,
    live: bool | tuple[str, int] = False,
    loss: float = 0.0,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> Deployed:
    """Run a program on the robot with this ``pid``, in this process; or on all robots.

    Without a ``pid`` each robot is a process on this machine. ``config`` is a configuration, or its
    file; else the file beside the program that has its name. The run ends after so many ``rounds``,
    when all robots have stopped, or on ``cancellation``: robots then stop safely. ``delta_s`` is
    the length of a round in seconds, instead of the configuration's. ``run`` is the name of the
    run, the same for all robots; ``state`` the folder of the robots' journals, with which a run
    goes on after crashes (with a ``pid``: ``.koord``), and ``fresh`` begins a new run all the same.
    What robots do is recorded in the file ``record``, as MCAP. ``restart`` (without a ``pid``):
    robots whose processes crash or are killed are started again, and go on where they were. The run
    ends where no round can be decided any more. What robots do is told in the file ``trace``: that
    of the run, judged by the rules (``merged`` of the result); with a ``pid`` the robot's part of
    it, for :func:`koord.merge`. With ``dry_run`` all vehicles are simulated, in real
    time; ``allow_models`` are ports (``Module.port``) that may be made up where nobody serves them.
    Vehicles stay where they are unless ``arm`` says that they may move. Before that robots look at
    themselves and each other: ``approve`` is asked a few times a second with what they have found
    (:class:`koord.api.preflight.Preflight`), until it answers True or False; without it they are
    armed if nothing is bad, and else refused. With ``preflight`` that is all that happens
    (``preflight`` of the result). The program's claims are
    watched while it runs: what did not hold is ``broken`` of the result, with the verdicts whose
    proofs need it if ``rests_on`` is the file of a report of :func:`koord.verify` that was made
    with ``rests_on``, as JSON. ``live`` serves a page of the run on this machine, or at an address
    and port, for everybody who can reach that. ``loss`` is the share of the arriving datagrams
    that are lost on purpose, to rehearse a bad network.
    ``progress`` hears :class:`FleetHeard`.

    Raises :class:`koord.KoordError` for what is wrong with the input, or with the network.

    >>> koord.deploy(program, "task.yaml", rounds=100, dry_run=True).is_complete
    True
    """
    request = DeployRequest(
        pid=pid,
        rounds=rounds,
        as_fast_as_possible=as_fast_as_possible,
        run=run,
        state=None if state is None else fspath(state),
        fresh=fresh,
        record=None if record is None else fspath(record),
        restart=restart,
        trace=None if trace is None else fspath(trace),
        dry_run=dry_run,
        allow_models=tuple(allow_models),
        arm=arm,
        preflight=preflight,
        rests_on=None if rests_on is None else fspath(rests_on),
        live=(LIVE if live else None) if isinstance(live, bool) else live,
        loss=loss,
    )
    if restart and pid is not None:
        raise ArgumentError("restart", NOT_RESTARTED)
    check_outputs(request)
    fitted = fit(fit_request(program, config, params, None, None, delta_s))
    job = job_of(fitted, request)
    return deploy_fitted(fitted, job, request, progress, cancellation, approve=approve)


def check_outputs(request: DeployRequest) -> None:
    """Check that trace and recording can be written. Raises KoordError and ArgumentError."""
    if request.trace is not None:
        check_writable(request.trace)
    if request.record is not None:
        check_writable(request.record)
        if request.trace is not None and same_file(request.record, request.trace):
            raise ArgumentError("record", NOT_TWICE)
        require(("mcap",), "record")


def job_of(fitted: Fitted, request: DeployRequest) -> Job:
    """The run as its robots know it. Raises KoordError."""
    robots = len(fitted.kinds)
    if request.pid is not None and not 0 <= request.pid < robots:
        story, hint = f"there is no robot {request.pid}", f"the pids are 0 to {robots - 1}"
        raise refusal("K932", fitted.configuration.name, story, hint)
    check_start(fitted)
    configuration, classes = fitted.configuration, loaded(compiled(fitted.program.core))
    assert configuration.delta_s is not None
    key = _key(configuration, request)
    missing: tuple[Diagnostic, ...] = ()
    drivers = Drivers()
    if not request.dry_run:
        drivers, found = drivers_of(configuration, registry(), localiser_registry())
        found += undriven(fitted)
        found += unserved(fitted, drivers, request.allow_models)
        missing = (*found, *_unanswered(fitted, classes, drivers))
    if request.as_fast_as_possible and (request.dry_run or drivers.made):
        missing += (_hurried(configuration),)
    if key is None:
        missing += (keyless(configuration),)
    if key is None or missing:
        raise KoordError(missing)
    if configuration.talk.encrypts:
        require(("cryptography",), "encrypt")
    run = request.run or configuration.talk.run
    is_exact = not request.dry_run and not drivers.made
    return Job(
        classes,
        fitted.kinds,
        configuration,
        key.key,
        run,
        delta_s=configuration.delta_s,
        pace_s=0.0 if request.as_fast_as_possible else configuration.delta_s,
        rounds=request.rounds,
        journals=None,
        starts=_starts(fitted),
        program=_program(fitted.program.core),
        insists=request.fresh,
        key_print="" if request.pid is None else print_of(key.key, run),
        warnings=key.warnings,
        is_local=request.pid is None,
        waits=request.preflight or (request.arm and bool(drivers.made)),
        platforms=_platforms(fitted, drivers, request),
        watched=watched(fitted.program.core, slack_of(fitted, is_exact=is_exact)),
    )


def _platforms(
    fitted: Fitted, drivers: Drivers, request: DeployRequest
) -> Callable[[Job, int], Platform] | None:
    """The platforms of vehicles; None: all robots are ideal points. Raises KoordError."""
    if not request.dry_run and not drivers.made:
        return None
    require(SIM, "sim")
    from koord.api.platforms import platforms, simulated

    if request.dry_run:
        return simulated(fitted)
    return platforms(fitted, drivers, arms=request.arm)


def _starts(fitted: Fitted) -> Mapping[tuple[int | None, str], Any]:
    """Starts as the program assumes them, equal for all robots; where they are is configured.

    Raises KoordError where there are none.
    """
    program = fitted.program.core
    if not program.assumptions or is_placed(program):
        return {}
    from koord.refinement.sampling_hosts import settled_starts
    from koord.runtime.compile.naming import PythonNames

    system = System(program, fitted.kinds, fitted.delta_s)
    return settled_starts(system, PythonNames(program), fitted.configuration.seed)


def _program(program: core.Program) -> Fingerprint:
    """What robots run, as all have to, whatever its file is called and however it is laid out."""
    parts = (
        program.agents,
        program.allread,
        program.allwrite,
        program.functions,
        program.externals,
        program.lock_classes,
    )
    # Nodes show what they mean, and not where they stand.
    params = tuple((f"param {one.name}", str(one.value)) for one in program.parameters)
    return (("program", text_digest(repr(parts), 8)), *params)


def _unanswered(
    fitted: Fitted, classes: tuple[type[Robot], ...], drivers: Drivers
) -> Iterator[Diagnostic]:
    """Yield the functions that no library answers."""
    answered = _library() if drivers.made else frozenset[str]()
    missing: set[str] = set()
    for pid, kind in enumerate(fitted.kinds):
        functions = classes[kind].EXTERNALS
        if pid in drivers.made:
            missing |= {name for name in functions if plain_name(name) not in answered}
        else:
            missing |= set(unanswered(functions))
    if missing:
        who = "robots" if drivers.made else "robots without a platform"
        story = f"{who} have no {', '.join(sorted(missing))}"
        hint = "write these functions in Koord, with a body"
        place = whole_file(fitted.configuration.name)
        yield Diagnostic("K932", Severity.ERROR, place, story, hint)


def _library() -> frozenset[str]:
    """The functions that robots on vehicles answer. Raises KoordError."""
    require(SIM, "sim")
    from koord.runtime.platform.world_host import ANSWERED

    return ANSWERED


def _key(configuration: RunConfiguration, request: DeployRequest) -> SharedKey | None:
    """The key of a run; None if robots that are to have one have none. Raises KoordError."""
    if request.pid is None:  # on one machine nobody else needs to know the key
        return SharedKey(secrets.token_bytes(32))
    return shared_key(configuration)


def _hurried(configuration: RunConfiguration) -> Diagnostic:
    story = "vehicles take their time, and rounds are to be as fast as possible"
    hint = "let rounds have their length"
    return Diagnostic("K932", Severity.ERROR, whole_file(configuration.name), story, hint)


def keyless(configuration: RunConfiguration) -> Diagnostic:
    """The diagnostic of robots on several computers that have no key. (K932)"""
    story = "the robots have no key in common"
    hint = "write one with `koord config key robots.key`, and add: network: {key_file: robots.key}"
    return Diagnostic("K932", Severity.ERROR, whole_file(configuration.name), story, hint)


def deploy_fitted(
    fitted: Fitted,
    job: Job,
    request: DeployRequest,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
    *,
    approve: Approval | None = None,
) -> Deployed:
    """As :func:`deploy`, for a prepared run. Raises KoordError."""
    if request.preflight:
        request = replace(request, record=None, trace=None, live=None)
    grounds = None
    if request.rests_on is not None:
        grounds = grounds_of(request.rests_on, fitted.program)
    deployment = _Deployment(fitted, job, request, heard_by(progress), cancellation, grounds)
    deployment = replace(deployment, approve=approve or good_enough)
    try:
        deployed = _all(deployment) if request.pid is None else _one(deployment, request.pid)
    except TransportError as error:
        raise refusal("K933", job.configuration.name, error.message, error.hint or None) from None
    except CannotTakePartError as error:
        where = error.file or job.configuration.name
        raise refusal("K939", where, error.message, error.hint) from None
    return replace(deployed, warnings=fitted.warnings + job.warnings)


class _Deployment(Struct, frozen=True):
    """A prepared run, with its listener and its cancellation."""

    fitted: Fitted
    job: Job
    request: DeployRequest
    tell: Listener
    cancellation: Cancellation | None
    grounds: Grounds | None
    approve: Approval = good_enough

    def looking(self, robots: int) -> Looking | None:
        """The time before the run, in which people look at robots; None: it begins at once."""
        if not self.job.waits:
            return None
        return Looking(robots, self.approve, only_looks=self.request.preflight)

    def looked(self, ended: Deployed, looking: Looking | None, parts: Parts | None) -> bool:
        """Return whether people only looked. Raises KoordError if they have refused a run."""
        if looking is None or looking.is_approved:
            return False
        if parts is not None:
            parts.remove()
        if not (self.request.preflight or ended.interrupted or ended.stuck):
            raise KoordError(looking.refusals(self.job.configuration.name))
        return True

    @property
    def is_cancelled(self) -> Callable[[], bool]:
        return asker(self.cancellation)

    def recorder(self, stack: ExitStack, parts: Parts | None) -> _Recorder | None:
        path = self.request.record
        if path is None:
            return None
        return _Recorder(path, self.fitted.problem, parts, stack)

    def unrecorded(self, recorder: _Recorder | None, parts: Parts | None) -> tuple[Diagnostic, ...]:
        """Finish the recording, if there is one; return why it ends before the run, if it does."""
        trouble = None if recorder is None else recorder.close()
        if trouble is None:
            return ()
        assert self.request.record is not None
        story = f"the recording ends early, as it cannot be written: {trouble.strerror}"
        is_left = parts is not None and self.request.trace is None
        hint = f"what robots told is left in {parts.folder}" if parts and is_left else None
        return refusal("K903", visible(self.request.record), story, hint).diagnostics

    def parts(self, stack: ExitStack, job: Job) -> Parts | None:
        """The parts that robots are to write; None if nobody wants to judge the run."""
        trace, pid = self.request.trace, self.request.pid
        if trace is None and self.request.record is None:
            return None
        from koord.api.deployed_parts import Parts, check_judgeable, folder_of, part_files

        try:
            check_judgeable(self.fitted)
        except KoordError:
            if trace is None:
                return None  # what robots do is recorded all the same
            raise
        if trace is not None and pid is not None:
            return Parts.of(self.fitted, job, {pid: Path(trace)})
        pids = range(job.robots) if pid is None else (pid,)
        beside = self.request.record if trace is None else trace
        assert beside is not None
        goes_on = (pid is not None or self.request.state is not None) and not self.request.fresh
        files, aside = stack.enter_context(part_files(folder_of(beside), pids, goes_on=goes_on))
        return Parts.of(self.fitted, job, files, aside)

    def traced(self, ended: Deployed, parts: Parts) -> Deployed:
        """Write the trace of all robots, if one is wanted, and judge it. Raises KoordError.

        Who cancels the run waits for its trace; who does so now, or insists, does not.
        """
        ended = replace(ended, aside=None if parts.aside is None else str(parts.aside))
        if self.request.trace is None:
            if not ended.unmerged:
                parts.remove()  # the recording has them
            return ended
        cancellation = None if ended.interrupted else self.cancellation
        try:
            merged = parts.merged(self.tell, cancellation)
            merged.trace.save(self.request.trace)
        except KoordError as error:
            unmerged = ended.unmerged + error.diagnostics
            return replace(ended, unmerged=unmerged, left=str(parts.folder))
        except (CancelledError, KeyboardInterrupt):
            left = parts.unmerged(self.request.trace)
            return replace(ended, interrupted=True, unmerged=ended.unmerged + left.diagnostics)
        if not merged.has_all_told:
            return replace(ended, merged=merged, left=str(parts.folder))
        if self.request.state is None or not ended.interrupted:
            parts.remove()  # else the run may go on
        return replace(ended, merged=merged)

    def lossy(self, transport: Transport, pid: int) -> Transport:
        """A network that loses what it is to lose."""
        loss = self.request.loss
        if not loss:
            return transport
        faults = Faults(loss=loss, least_delay_s=0.0, most_delay_s=0.0)
        return Unreliable(transport, faults, self.job.configuration.seed + pid)

    def page(self, stack: ExitStack, job: Job, watch: FleetWatch) -> LivePage | None:
        """The page that is served while the run goes on, if that is wanted. Raises KoordError."""
        if self.request.live is None:
            return None
        require(SIM, "sim")
        from koord.api.live_page import live_page

        served = live_page(self.fitted, job, watch, self.request.live, self.tell)
        return stack.enter_context(served)

    def heard(
        self,
        page: LivePage | None,
        watch: FleetWatch,
        news: Sequence[News],
        processes: Mapping[int, ProcessReport] | None = None,
    ) -> None:
        """Watch and show what robots tell."""
        if page is not None:
            page.hear(news)
        watch.hear(news, processes)
        if page is not None:
            page.show_broken()

    def ended(self, statuses: Mapping[int, RobotReport], watch: FleetWatch) -> Deployed:
        """Make the result from the robots' last reports."""
        interrupted = self.is_cancelled()
        ended = Deployed.of(self.job, self.fitted.problem, statuses, interrupted=interrupted)
        return replace(ended, broken=watch.broken, unwatched=watch.unwatched)


def _one(of: _Deployment, pid: int) -> Deployed:
    """Run one robot, in this process."""
    job, request = of.job, of.request
    # Nothing is written before it is sure that this robot can talk to the others.
    try:
        transport = of.lossy(transport_of(job.configuration, job.run, pid), pid)
    except TransportError:
        with suppress(OSError):
            knock(job.party(pid), job.configuration.robots[pid].address)
        raise
    with ExitStack() as stack:
        stack.callback(transport.close)
        stack.enter_context(_found_here(job, reach_of(job.configuration, (pid,))))
        job = stack.enter_context(_noting(job, request.state or _STATE))
        parts = of.parts(stack, job)
        recorder = of.recorder(stack, parts)
        make = member_of if parts is None else parts.member
        watch = FleetWatch(of.fitted, job, of.grounds, pid)
        page = of.page(stack, job, watch)
        runner = Runner(job, pid, transport, make=make)
        runner.keeps_rounds, runner.keeps_poses = True, page is not None

        looking = of.looking(1)

        def report(news: News) -> None:
            if looking is not None:
                answer = looking.hear({pid: news.status})
                if answer:
                    runner.go()
            of.heard(page, watch, [news])
            of.tell(FleetHeard.of({pid: news.status}, job.rounds, broken=watch.broken))
            if recorder is not None:
                recorder.hear([news], is_sure=True)

        def is_told_to_stop() -> bool:
            refused = looking is not None and looking.is_over and not looking.is_approved
            return refused or of.is_cancelled()

        last = runner.run(is_told_to_stop, report)
        report(runner.news())
        unrecorded = of.unrecorded(recorder, parts)
        trouble = None if parts is None else parts.trouble
        if parts is not None and request.trace is None and not (trouble or unrecorded):
            parts.remove()  # the recording has it
    ended = of.ended({pid: last}, watch)
    if of.looked(ended, looking, parts):
        return replace(ended, preflight=None if looking is None else looking.found)
    if parts is not None and parts.aside is not None:
        ended = replace(ended, aside=str(parts.aside))
    return replace(ended, unmerged=(trouble.diagnostics if trouble else ()) + unrecorded)


def _all(of: _Deployment) -> Deployed:
    """Run all robots, each in a process."""
    job, request, tell = of.job, of.request, of.tell
    with ExitStack() as stack:
        state = request.state
        scratch = None
        if state is None and request.restart:
            state = scratch = stack.enter_context(TemporaryDirectory(prefix="koord-"))
        if state is not None:
            job = stack.enter_context(_noting(job, state))
        parts = of.parts(stack, job)
        recorder = of.recorder(stack, parts)
        make = member_of if parts is None else parts.member
        plan = local_plan(job.configuration, job.robots)
        stack.enter_context(_found_here(job, Addresses(tuple(enumerate(plan.addresses)))))
        watch = FleetWatch(of.fitted, job, of.grounds)
        page = of.page(stack, job, watch)
        is_shown = page is not None
        launch = Launch(
            job,
            plan,
            make,
            lambda plan, pid: of.lossy(Udp(plan, pid), pid),
            keeps_rounds=True,
            keeps_poses=is_shown,
            scratch=scratch,
        )
        fleet = SupervisedProcesses(launch, restarts=request.restart)
        stack.callback(fleet.close)
        tell(FleetHeard.of({}, job.rounds))
        looking = of.looking(job.robots)
        while not fleet.is_over:
            news = fleet.turn(_WAIT_S)
            match None if looking is None else looking.hear(fleet.statuses):
                case True:
                    fleet.go()
                case False:
                    fleet.stop()
                case None:
                    pass
            of.heard(page, watch, news, fleet.processes)
            if recorder is not None:
                recorder.hear(news, is_sure=fleet.is_accepted, processes=fleet.processes)
            tell(FleetHeard.of(fleet.statuses, job.rounds, fleet.processes, watch.broken))
            if of.is_cancelled():
                fleet.stop()
        tell(FleetHeard.of(fleet.statuses, job.rounds, fleet.processes, watch.broken))
        ended = replace(
            of.ended(fleet.statuses, watch),
            processes=dict(fleet.processes),
            stuck=fleet.stuck,
            unmerged=of.unrecorded(recorder, parts),
        )
        if of.looked(ended, looking, parts):
            return replace(ended, preflight=None if looking is None else looking.found)
        return ended if parts is None else of.traced(ended, parts)


def _found_here(job: Job, reach: Reach) -> AbstractContextManager[object]:
    """Let people of this machine find the robots of this process. (O-HERE)"""
    is_whole = len(robots_of(reach)) == job.robots
    access = Access(order_key(job.key), job.encrypts, reach, is_whole)
    return left(job.configuration.name, access)


@contextmanager
def _noting(job: Job, path: str) -> Iterator[Job]:
    """The run with a folder of journals, which is made if need be.

    A start that is refused leaves no empty one. Raises KoordError.
    """
    folder = Path(path)
    made = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise no_folder(folder, error) from None
    job = replace(job, journals=folder)
    try:
        yield job
    except (KoordError, TransportError):
        for one in made:
            with suppress(OSError):  # others may have noted something
                one.rmdir()
        raise


class _Recorder:
    """The record of a run, begun once the run is accepted, with all earlier reports."""

    def __init__(self, path: str, problem: Problem, parts: Parts | None, stack: ExitStack) -> None:
        self._path, self._problem, self._stack = path, problem, stack
        self._tails = {} if parts is None else parts.tails()
        self._record: DeploymentRecord | None = None
        self._trouble: OSError | None = None
        self._early: list[News] = []

    def hear(
        self,
        news: Iterable[News],
        processes: Mapping[int, ProcessReport] | None = None,
        *,
        is_sure: bool,
    ) -> None:
        """Record the reports of robots, and what became of their own ``processes``, if any."""
        if self._trouble is not None:
            return
        self._early += news
        if not is_sure:
            return
        with self._trying():
            self._write(processes or {})

    @contextmanager
    def _trying(self) -> Iterator[None]:
        """Robots go on where there is no room for more: the recording then ends before that."""
        try:
            yield
        except OSError as error:
            self._trouble = error
            if self._record is not None:
                with suppress(OSError):
                    self._record.restore()

    def close(self) -> OSError | None:
        """Finish the recording; return why it ends before the run, if it does."""
        if self._record is not None and self._trouble is None:
            with self._trying():
                self._record.close()
        self._record = None
        return self._trouble

    def _write(self, processes: Mapping[int, ProcessReport]) -> None:
        if self._record is None:
            # Without a buffer: what is not written can be taken back.
            file = self._stack.enter_context(Path(self._path).open("wb", buffering=0))  # noqa: SIM115
            self._record = DeploymentRecord(file)
            self._stack.callback(self.close)
            self._record.describe(self._problem)
        for one in self._early:
            now = time.time_ns()
            self._record.rounds(one.rounds, now)
            self._record.status(one.status, now, processes.get(one.status.pid))
        self._early.clear()
        for pid, tail in self._tails.items():
            self._record.told(pid, tail.lines(), time.time_ns())
        self._record.flush()
