"""Deployment on robots' own computers: started, followed and gathered over SSH. (P-SSH)"""

from __future__ import annotations

import re
import secrets
import time
from collections.abc import Callable, Coroutine, Iterator, Mapping, Sequence
from os import PathLike
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from koord.api.command_lines import deploy_flags
from koord.api.configurations import check_start
from koord.api.deploy_request import DeployRequest, check_outputs
from koord.api.deployed import Deployed
from koord.api.files import file_name
from koord.api.fitting import Configurable, FitRequest, Fitted, fit, fit_request
from koord.api.preflight import Approval, Preflight, good_enough, refusals
from koord.api.programs import Loadable, Value
from koord.api.progress import Cancellation, CancelledError, Listener, Progress, asker, heard_by
from koord.api.remote_answers import (
    REFUSED,
    RobotAnswer,
    checks_of,
    complaints,
    has_reported,
    joined,
    process_of,
    status_of,
)
from koord.api.remote_files import Copied, copied, hosts_of
from koord.api.robots import Seconds
from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.motion.libraries import require
from koord.runtime.remote.logins import RUNS, RemoteEnd, RemoteError
from koord.runtime.remote.logins import Login as Login
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.source import Span
from koord.version import __version__

if TYPE_CHECKING:
    from koord.runtime.remote.computer import Computer
    from koord.runtime.remote.computers import Computers

#: How often people are asked whether to arm, until they have answered.
_ASK_S = 0.2

#: The commands there.
_LOOK, _RUN = "preflight", "deploy"

#: From the folder of a robot, `.koord/runs/RUN/PID`, to the home.
_HOME = "../../../.."


class RemoteLine(Progress, frozen=True, kw_only=True):
    """Progress: a line that a robot has said; ``pid`` is None if it is about all."""

    pid: int | None = None


class RemoteRequest(Struct, frozen=True):
    """The request for a deployment on robots' own computers. ``logs``: the folder of their logs.

    ``attach`` takes the last run there up, whether it has ended or not, and starts nothing.
    """

    wanted: FitRequest
    fitted: Fitted
    request: DeployRequest
    login: Login = Login()
    logs: str | None = None
    attach: bool = False


def deploy_remotely(
    program: Loadable,
    config: Configurable = None,
    *,
    login: Login | None = None,
    params: Mapping[str, Value] | None = None,
    delta_s: Seconds = None,
    rounds: int | None = None,
    as_fast_as_possible: bool = False,
    run: str | None = None,
    state: str | PathLike[str] | None = None,
    fresh: bool = False,
    record: str | PathLike[str] | None = None,
    trace: str | PathLike[str] | None = None,
    logs: str | PathLike[str] | None = None,
    dry_run: bool = False,
    allow_models: Sequence[str] = (),
    arm: bool = False,
    approve: Approval | None = None,
    preflight: bool = False,
    attach: bool = False,
    rests_on: str | PathLike[str] | None = None,
    loss: float = 0.0,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> Deployed:
    """Run a program on all robots, each on its own computer, over SSH.

    A robot's computer is reached at the ``ip`` of its device. ``login`` says how, where OpenSSH's
    own configuration does not: keys and an agent as ``ssh`` has them, host keys that are known. The
    same version of koord has to be there. ``state`` is a folder in the home there; with it the same
    call goes on with a run after crashes. What robots say ``progress`` hears as
    :class:`RemoteLine`, and ``logs`` is a folder for it. Parts and recordings are fetched, and made
    one ``trace`` and one ``record``. With ``arm`` robots are looked at first, and ``approve`` is
    asked about all of them. On ``cancellation`` robots stop safely. With ``attach`` nothing is
    started: the last run there is taken up, to follow it, to stop it, or to fetch what it has
    written. The rest is as for :func:`koord.deploy`.

    Raises :class:`koord.KoordError` for what is wrong with the input, or with a computer (K946).

    >>> koord.deploy_remotely(program, "fleet.yaml", rounds=100, trace="run.json").merged.ok
    True
    """
    request = DeployRequest(
        rounds=rounds,
        as_fast_as_possible=as_fast_as_possible,
        run=run,
        state=file_name(state),
        fresh=fresh,
        record=file_name(record),
        trace=file_name(trace),
        dry_run=dry_run,
        allow_models=tuple(allow_models),
        arm=arm,
        preflight=preflight,
        rests_on=file_name(rests_on),
        loss=loss,
    )
    check_outputs(request)
    wanted = fit_request(program, config, params, None, None, delta_s, located=not dry_run)
    kept = file_name(logs)
    made = RemoteRequest(wanted, fit(wanted), request, login or Login(), kept, attach)
    return deploy_over_ssh(made, progress, cancellation, approve=approve)


def deploy_over_ssh(
    run: RemoteRequest,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
    *,
    approve: Approval | None = None,
) -> Deployed:
    """As :func:`deploy_remotely`, for a program that fits. Raises KoordError."""
    check_start(run.fitted)
    hosts = dict(hosts_of(run.fitted.configuration))
    files = copied(run.wanted, run.fitted.configuration, run.request.rests_on)
    require(("asyncssh",), "ssh")
    from koord.runtime.remote.computers import Computers

    tell = heard_by(progress)

    def said(pid: int, line: str) -> None:
        tell(RemoteLine(f"robot {pid} | {line}", pid=pid))

    name = re.sub(r"[^\w.-]", "_", run.request.run or run.fitted.configuration.talk.run)
    # Names are in the order in which runs were started, as `attach` takes up the last one.
    now_ns = time.time_ns()
    micros = now_ns // 1000 % 1_000_000
    stamp = f"{time.strftime('%Y%m%dT%H%M%S', time.gmtime(now_ns // 10**9))}{micros:06}"
    folder = RUNS / f"{stamp}-{secrets.token_hex(2)}-{name}"
    with Computers(hosts, run.login, folder, said) as computers:
        remote = _Remote(run, files, computers, tell, cancellation, approve or good_enough)
        try:
            return remote.run()
        except CancelledError:
            return remote.ended({}, interrupted=True)


class _Remote(Struct, frozen=True):
    """A run on robots' computers."""

    of: RemoteRequest
    copied: Copied
    computers: Computers
    tell: Listener
    cancellation: Cancellation | None
    approve: Approval

    @property
    def configuration(self) -> RunConfiguration:
        return self.of.fitted.configuration

    def run(self) -> Deployed:
        """Do all, from the first connection to the trace. Raises KoordError and CancelledError."""
        from koord.api.gathering import Gathering

        request = self.of.request
        self._connect()
        if self.of.attach:
            self._take_up()
        else:
            self._each(lambda pid, computer: computer.copy(self.copied.files))
            if request.preflight or (request.arm and not request.dry_run):
                found = self._looked()
                if request.preflight:
                    return replace(self.ended({}, interrupted=False), preflight=found)
                self._ask(found)
            self._begin()
        ends = self.computers.follow(_RUN, asker(self.cancellation), self._is_hopeless)
        interrupted = asker(self.cancellation)()
        refused = [pid for pid, end in ends.items() if end.code == REFUSED]
        if refused and not interrupted:
            raise KoordError(tuple(self._refusals({pid: ends[pid] for pid in refused})))
        ended = self.ended(ends, interrupted=interrupted)
        name = self.configuration.name
        gathering = Gathering(request.trace, request.record, self.of.logs, name)
        ended = gathering.logged(ended, self.computers)
        ended = gathering.recorded(ended, self.computers)
        return gathering.traced(ended, self.computers, self.tell, self.cancellation)

    def ended(self, ends: Mapping[int, RemoteEnd], *, interrupted: bool) -> Deployed:
        """The result, of how robots' commands have ended."""
        fitted = self.of.fitted
        answers = {pid: RobotAnswer.of(end) for pid, end in ends.items()}
        watched = joined(answers)
        return Deployed(
            problem=fitted.problem,
            statuses={pid: status_of(pid, one) for pid, one in answers.items()},
            agents=tuple(agent.name for agent in fitted.program.core.agents),
            kinds=fitted.kinds,
            rounds=self.of.request.rounds,
            interrupted=interrupted,
            processes={pid: process_of(pid, end) for pid, end in ends.items()},
            broken=watched.broken,
            unwatched=watched.unwatched,
            warnings=fitted.warnings,
        )

    def _connect(self) -> None:
        """Connect to all. Raises KoordError and CancelledError."""
        hosts = [one.place.host for one in self.computers.all.values()]
        self.tell(RemoteLine(f"connecting to {', '.join(dict.fromkeys(hosts))}"))
        self._each(lambda pid, computer: computer.open(__version__))

    def _take_up(self) -> None:
        """Find the last run there. Raises KoordError and CancelledError. (P-SSH-ATTACH)"""
        runs: dict[int, tuple[str, ...]] = {}

        async def found(pid: int, computer: Computer) -> None:
            runs[pid] = await computer.runs()

        self._each(found)
        last = max((run for each in runs.values() for run in each), default=None)
        story = "no run was started there" if last is None else f"it has no part in the run {last}"
        without = {pid: RemoteError(story) for pid, each in runs.items() if last not in each}
        if last is None or without:
            raise KoordError(tuple(self._unusable(without)))
        self.tell(RemoteLine(f"the run {last}"))
        for computer in self.computers.all.values():
            computer.take_up(last)

    def _each(
        self,
        action: Callable[[int, Computer], Coroutine[object, object, None]],
        *,
        is_whole: bool = False,
    ) -> None:
        """Do something with all computers, to its end if it has to be ``is_whole``.

        Raises KoordError and CancelledError.
        """
        is_cancelled = asker(self.cancellation)
        _, wrong = self.computers.each(action, (lambda: False) if is_whole else is_cancelled)
        if is_cancelled():
            raise CancelledError("deploying")
        if wrong:
            raise KoordError(tuple(self._unusable(wrong)))

    def _start(self, name: str, words: Sequence[str]) -> None:
        """Start a command of koord on all computers. Raises KoordError and CancelledError."""

        async def started(pid: int, computer: Computer) -> None:
            own = (self.of.login.koord, "deploy", *self.copied.words, f"--pid={pid}", *words)
            await computer.start(name, own, has_key=self.copied.has_key)

        try:
            # Of what was cancelled nobody would know whether it runs.
            self._each(started, is_whole=True)
        except (KoordError, CancelledError, KeyboardInterrupt):
            self.computers.stop(name)  # some may be under way
            raise

    def _flags(self, request: DeployRequest) -> tuple[str, ...]:
        wanted = self.of.wanted
        state = request.state
        if state is not None:
            state = str(PurePosixPath(_HOME) / state)  # an absolute one stays as it is
        request = replace(request, pid=None, state=state)
        return (*deploy_flags(request, wanted.params, wanted.delta_s), "--json")

    def _looked(self) -> Preflight:
        """Let robots look at themselves and each other. (P-SSH-ARM)

        Raises KoordError and CancelledError.
        """
        request = replace(self.of.request, preflight=True, arm=False, state=None)
        self._start(_LOOK, self._flags(request))
        ends = self.computers.follow(_LOOK, asker(self.cancellation), lambda ends: False)
        if asker(self.cancellation)():
            raise CancelledError("looking at robots")
        checks = {pid: checks_of(end) for pid, end in ends.items()}
        blind = {pid: ends[pid] for pid, found in checks.items() if not found}
        if blind:
            raise KoordError(tuple(self._refusals(blind)))
        return Preflight(checks, len(checks))

    def _ask(self, found: Preflight) -> None:
        """Ask whether to arm. Raises KoordError if not, and CancelledError."""
        while (answer := self.approve(found)) is None and found.is_good:
            if asker(self.cancellation)():
                raise CancelledError("asking")
            time.sleep(_ASK_S)
        if not (answer and found.is_good):
            raise KoordError(refusals(found, self.configuration.name))

    def _begin(self) -> None:
        """Start all robots. Raises KoordError and CancelledError."""
        from koord.api.gathering import PART, RECORD

        request = self.of.request
        words: list[str] = []
        words += [] if request.trace is None else [f"--trace={PART}"]
        words += [] if request.record is None else [f"--record={RECORD}"]
        self._start(_RUN, (*self._flags(request), *words))

    def _is_hopeless(self, ends: Mapping[int, RemoteEnd]) -> bool:
        """Return whether those that are left can decide no round any more. (P-SSH-END)"""
        robots = len(self.computers.all)
        lost = [end for end in ends.values() if not has_reported(end)]
        return any(end.code == REFUSED for end in ends.values()) or 2 * len(lost) >= robots

    def _place(self, pid: int) -> Span:
        return self.configuration.place(*self.configuration.robots[pid].vehicle.path, "ip")

    def _unusable(self, wrong: Mapping[int, RemoteError]) -> Iterator[Diagnostic]:
        for pid, error in sorted(wrong.items()):
            host = self.computers.all[pid].place.host
            story = f"the computer of robot {pid} ({host}): {error.message}"
            place = self._place(pid)
            yield Diagnostic("K946", Severity.ERROR, place, story, error.hint or None)

    def _refusals(self, ends: Mapping[int, RemoteEnd]) -> Iterator[Diagnostic]:
        for pid, end in sorted(ends.items()):
            for one in complaints(end):
                story = f"robot {pid} cannot take part: {one.message}"
                yield Diagnostic("K946", Severity.ERROR, self._place(pid), story, one.hint)
