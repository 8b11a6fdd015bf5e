"""``koord deploy FILE CONFIG``: run a program on a robot, or on processes for all of them."""

from __future__ import annotations

import argparse
import secrets
import signal
import sys
import time
from argparse import ArgumentTypeError
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from types import FrameType

from msgspec.structs import replace

from koord.api.files import check_writable
from koord.cli.arguments import (
    add_files,
    add_json,
    add_settings,
    check_files,
    delta,
    rounds,
)
from koord.cli.deployed import Board, as_document, summary
from koord.cli.diagnostics import Report
from koord.cli.exits import Exit
from koord.cli.fitting import asked, check_start
from koord.cli.terminal import visible
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.configuration.model import Configuration
from koord.runtime.deploy.ideal import unanswered
from koord.runtime.deploy.local import Launch, launched
from koord.runtime.deploy.networks import local_plan, transport_of
from koord.runtime.deploy.recording import Record
from koord.runtime.deploy.running import Job, Moment, Runner
from koord.runtime.deploy.status import Status
from koord.runtime.robot import Robot
from koord.runtime.transports.transport import TransportError
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity, refusal
from koord.syntax.problem import Problem
from koord.syntax.source import whole_file


def configure(parser: argparse.ArgumentParser) -> None:
    add_files(parser, several=False)
    parser.add_argument("config", metavar="CONFIG", help="the configuration of the run (.yaml)")
    parser.add_argument("--pid", metavar="I", type=int, help="run the robot with this pid")
    parser.add_argument(
        "--all-local", action="store_true", help="run all robots, as processes on this machine"
    )
    parser.add_argument(
        "--rounds", metavar="R", type=rounds, help="end after so many rounds (go on until Ctrl-C)"
    )
    parser.add_argument(
        "--delta",
        metavar="SECONDS",
        type=delta,
        help="the length of a round, instead of the configuration's",
    )
    parser.add_argument(
        "--as-fast-as-possible", action="store_true", help="begin each round when the last is over"
    )
    parser.add_argument("--run", metavar="NAME", help="the name of the run, the same for all")
    parser.add_argument(
        "--state",
        metavar="DIR",
        help="where a robot notes where it is, to go on after a crash (.koord)",
    )
    parser.add_argument(
        "--fresh", action="store_true", help="forget what was noted: this is a first start"
    )
    parser.add_argument("--record", metavar="FILE", help="record what robots do, as MCAP")
    add_settings(parser)
    add_json(parser, "how each robot ended")
    parser.epilog = (
        "exit codes: 0 the rounds were done, or all robots have stopped, 1 a fault ended the run, "
        "2 errors in the input, 3 robots stopped before all rounds were "
        "done, 130 stopped with Ctrl-C (a second one "
        "stops at once)"
    )


def main(arguments: argparse.Namespace) -> int:
    check_files([arguments.file, arguments.config, *arguments.properties])
    if arguments.all_local == (arguments.pid is not None):
        raise ArgumentTypeError("say --pid I for one robot, or --all-local for all of them")
    if arguments.record is not None:
        check_writable(arguments.record)
        if find_spec("mcap") is None:
            raise ArgumentTypeError("--record needs the MCAP library: pip install 'koord[record]'")
    report = Report()
    wanted = None
    try:
        wanted = job_of(arguments, report)
    except KoordError as error:
        report.add(error.diagnostics)
    report.print(sys.stderr, as_json=False)
    if wanted is None or report.errors:
        return Exit.BAD_INPUT
    job, problem = wanted
    if not arguments.json:
        print(visible(str(problem)), flush=True)
    deploy = _all if arguments.all_local else _one
    try:
        return deploy(arguments, job, problem)
    except TransportError as error:
        raise refusal("K933", job.configuration.name, error.message, error.hint or None) from None


# --- what is to be run ----------------------------------------------------------------------------


def job_of(arguments: argparse.Namespace, report: Report) -> tuple[Job, Problem] | None:
    """The run, and what it is a run of. Raises KoordError."""
    wanted = asked(arguments, report)
    found = None if wanted is None else wanted.fitted(report)
    if found is None:
        return None
    check_start(found)
    configuration, classes = found.configuration, loaded(compiled(found.loaded.core))
    assert configuration.delta_s is not None
    _check_functions(classes, configuration, report)
    key, run = _secret(arguments, configuration, report)
    job = Job(
        classes,
        found.kinds,
        configuration,
        key,
        run,
        delta_s=configuration.delta_s,
        pace_s=0.0 if arguments.as_fast_as_possible else configuration.delta_s,
        rounds=arguments.rounds,
        journals=None,
    )
    return job, found.loaded.problem(found.kinds, Fraction(repr(configuration.delta_s)))


def _check_functions(
    classes: tuple[type[Robot], ...], configuration: Configuration, report: Report
) -> None:
    missing = sorted({name for one in classes for name in unanswered(one.EXTERNALS)})
    if missing:
        story = f"robots without a platform have no {', '.join(missing)}"
        hint = "write these functions in Koord, with a body"
        report.add((_diagnostic("K932", configuration.name, story, hint),))


def _secret(
    arguments: argparse.Namespace, configuration: Configuration, report: Report
) -> tuple[bytes, str]:
    """The key and the name of the run; on one machine nobody else needs to know them."""
    run = arguments.run or configuration.talk.run
    if arguments.all_local:
        return secrets.token_bytes(32), f"{run} {secrets.token_hex(4)}"
    if configuration.talk.key is None:
        story = "the robots have no key in common"
        hint = f"add: network: {{key: {secrets.token_hex(16)}}}"
        report.add((_diagnostic("K932", configuration.name, story, hint),))
        return b"", run
    return configuration.talk.key, run


def _diagnostic(code: str, name: str, story: str, hint: str | None) -> Diagnostic:
    return Diagnostic(code, Severity.ERROR, whole_file(name), story, hint)


# --- running it -----------------------------------------------------------------------------------


class Interrupts:
    """How often Ctrl-C was pressed: first it stops safely, then at once."""

    def __init__(self, at_once: Callable[[], None] = lambda: None) -> None:
        self.count = 0
        self.at_once = at_once

    def __enter__(self) -> Interrupts:
        self._before = signal.signal(signal.SIGINT, self._pressed)
        return self

    def __exit__(self, *_: object) -> None:
        signal.signal(signal.SIGINT, self._before)

    def _pressed(self, number: int, frame: FrameType | None) -> None:
        self.count += 1
        if self.count > 1:
            self.at_once()
            raise KeyboardInterrupt


def _one(arguments: argparse.Namespace, job: Job, problem: Problem) -> int:
    """One robot, in this process."""
    pid = arguments.pid
    if not 0 <= pid < job.robots:
        story = f"there is no robot {pid}"
        hint = f"the pids are 0 to {job.robots - 1}"
        raise refusal("K932", job.configuration.name, story, hint)
    # Nothing is written before it is sure that this robot can talk to the others.
    transport = transport_of(job.configuration, job.run, pid)
    with ExitStack() as stack:
        stack.callback(transport.close)
        job = stack.enter_context(_noting(job, arguments.state or ".koord"))
        journal = job.journal(pid)
        if arguments.fresh and journal is not None:
            journal.forget()
        recorder = _recorder(arguments, problem, stack)
        runner = Runner(job, pid, transport)
        runner.keeps_moments = recorder is not None
        interrupts = stack.enter_context(Interrupts())
        board = stack.enter_context(Board(job.robots, job.rounds))

        def report(status: Status) -> None:
            board.show({pid: status})
            if recorder is not None:
                recorder.hear([(status, tuple(runner.moments))], is_sure=True)
                runner.moments.clear()

        last = runner.run(lambda: interrupts.count > 0, report)
        report(last)
    _tell({pid: last}, job, problem, as_json=arguments.json)
    return _ended({pid: last}, job, interrupts)


def _recorder(
    arguments: argparse.Namespace, problem: Problem, stack: ExitStack
) -> _Recorder | None:
    return None if arguments.record is None else _Recorder(arguments.record, problem, stack)


@contextmanager
def _noting(job: Job, path: str, of: Iterable[int] = ()) -> Iterator[Job]:
    """The run with a folder of journals, made if need be.

    A start that is refused leaves none: neither the folder nor journals ``of`` these robots, of
    which this is the first start. Raises KoordError.
    """
    folder = Path(path)
    made = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise refusal("K903", path, f"cannot be written: {error.strerror}", None) from None
    job = replace(job, journals=folder)
    try:
        yield job
    except (KoordError, TransportError):
        for journal in map(job.journal, of):
            if journal is not None:
                journal.forget()
        for one in made:
            with suppress(OSError):  # others may have noted something
                one.rmdir()
        raise


def _all(arguments: argparse.Namespace, job: Job, problem: Problem) -> int:
    """All robots, each in a process."""
    with ExitStack() as stack:
        if arguments.state is not None:
            job = stack.enter_context(_noting(job, arguments.state, of=range(job.robots)))
        recorder = _recorder(arguments, problem, stack)
        plan = local_plan(job.configuration, job.robots)
        fleet = launched(Launch(job, plan, keeps_moments=recorder is not None))
        stack.callback(fleet.join)
        stack.callback(fleet.kill)
        interrupts = stack.enter_context(Interrupts(at_once=fleet.kill))
        board = stack.enter_context(Board(job.robots, job.rounds))
        while not fleet.is_over:
            news = list(fleet.news(0.2))
            if fleet.failures:
                raise fleet.failures[0]
            if recorder is not None:
                heard = fleet.statuses.keys() | set(fleet.died)
                recorder.hear(news, is_sure=len(heard) == job.robots or fleet.is_over)
            board.show(fleet.statuses)
            if interrupts.count and not board.is_stopping:
                board.is_stopping = True
                fleet.stop()
        board.show(fleet.statuses)
    _tell(fleet.statuses, job, problem, as_json=arguments.json)
    return _ended(fleet.statuses, job, interrupts)


class _Recorder:
    """The record of a run, begun when it is sure that it is not refused, with all told by then."""

    def __init__(self, path: str, problem: Problem, stack: ExitStack) -> None:
        self._path, self._problem, self._stack = path, problem, stack
        self._record: Record | None = None
        self._early: list[tuple[Status, tuple[Moment, ...]]] = []

    def hear(self, news: Iterable[tuple[Status, tuple[Moment, ...]]], *, is_sure: bool) -> None:
        """Write down what robots told."""
        self._early += news
        if not is_sure:
            return
        if self._record is None:
            file = self._stack.enter_context(Path(self._path).open("wb"))  # noqa: SIM115
            self._record = Record(file)
            self._stack.callback(self._record.close)
            self._record.describe(self._problem)
        for status, moments in self._early:
            now = time.time_ns()
            self._record.moments(moments, now)
            self._record.status(status, now)
        self._early.clear()
        self._record.flush()


def _tell(statuses: dict[int, Status], job: Job, problem: Problem, *, as_json: bool) -> None:
    if as_json:
        print(as_document(statuses, problem))
    else:
        print(summary(statuses, job))


def _ended(statuses: dict[int, Status], job: Job, interrupts: Interrupts) -> int:
    if any(status.fault or status.trouble for status in statuses.values()):
        return Exit.VIOLATED
    if interrupts.count:
        return Exit.INTERRUPTED
    done = [s for s in statuses.values() if s.is_over or s.all_stopped or job.rounds is None]
    return Exit.OK if statuses and len(done) == len(statuses) else Exit.UNKNOWN
