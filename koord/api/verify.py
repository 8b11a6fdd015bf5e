"""Verification: a verdict on each property of a program, on one system or several.

Solvers work in processes of their own, so that calls in several threads know nothing of each other
([0036](../../specs/decisions/0036-threads-verify-in-processes.md)).
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from enum import Enum
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, TypeAlias, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from koord.api.programs import Loadable, Program, program_of
from koord.api.progress import Cancellation, Listener, asker, cores, teller
from koord.api.results import ArgumentError
from koord.api.robots import Robots, Seconds, delta_of, fleet_of, system_of
from koord.syntax.source import counted
from koord.syntax.system import System
from koord.verify import engine_names
from koord.verify.effort import Deadline
from koord.verify.helpers import Helpers, PortableWork

if TYPE_CHECKING:
    from koord.api.cache import Cache
    from koord.api.courier import Cluster
    from koord.api.verify_report import VerifyReport
    from koord.verify.cache.verifying import CachedVerification
    from koord.verify.job_process import JobChannel
    from koord.verify.proof_core import ProofCore
    from koord.verify.strategy.resumption import PastVerification
    from koord.verify.verdicts import Bounds, Report
    from koord.verify.verdicts import Verdict as Found

T = TypeVar("T")

#: What asks a solver, with all that it is made of.
_NEEDED = (
    "koord.sampling.coded_rounds",
    "koord.sampling.constraint_guesses",
    "koord.sampling.library",
    "koord.sampling.run_extension",
    "koord.semantics.reloading",
    "koord.syntax.printing.quoting",
    "koord.traces.rendering",
    "koord.traces.replay",
    "koord.verify.cache.kept",
    "koord.verify.cache.verifying",
    "koord.verify.certificates",
    "koord.verify.engines.bits.engine",
    "koord.verify.engines.bits.liveness_engine",
    "koord.verify.engines.bmc.engine",
    "koord.verify.engines.every_n.consequences",
    "koord.verify.engines.every_n.engine",
    "koord.verify.engines.every_n.liveness_engine",
    "koord.verify.engines.every_n.loops",
    "koord.verify.engines.every_n.progress_lemmas",
    "koord.verify.engines.explicit.engine",
    "koord.verify.engines.explicit.exhaustive",
    "koord.verify.engines.explicit.fair_compiled",
    "koord.verify.engines.explicit.liveness_engine",
    "koord.verify.engines.explicit.second_look",
    "koord.verify.engines.horn.engine",
    "koord.verify.export.smtlib",
    "koord.verify.export.tla.module",
    "koord.verify.instants",
    "koord.verify.lasso_witness",
    "koord.verify.promises",
    "koord.verify.proof_core",
    "koord.verify.strategy.confirmation",
    "koord.verify.strategy.few_robots",
    "koord.verify.strategy.liveness",
    "koord.verify.strategy.rounds_question",
    "koord.verify.strategy.time_limits",
    "koord.verify.strategy.verification",
    "koord.verify.witness",
)


class Engine(Enum):
    """The engine to use."""

    AUTO = "auto"  #: induction, then whichever of the others fits the program
    ABC = "abc"  #: the same as bits, but that abc looks for proofs, if it is installed
    BITS = "bits"  #: finite instances bit by bit: SAT, IC3
    BMC = "bmc"  #: bounded model checking, round by round
    SPACER = "spacer"  #: constrained Horn clauses: reals and integers, all rounds
    SEARCH = "search"  #: all configurations one by one
    INDUCTION = "induction"  #: for all rounds at once


#: Who is asked; None: whoever the strategy says.
_ENGINES = {
    engine: None if engine is Engine.AUTO else engine_names.Engine(engine.value)
    for engine in Engine
}


#: What a cache knows of a system: its report, or some of it.
Known: TypeAlias = "Report | PastVerification"


class Question(Struct, frozen=True):
    """A verification query: a program with robots; ``every_n``: any number of them."""

    program: Program
    system: System
    every_n: bool = False


class Options(Struct, frozen=True, kw_only=True):
    """The options of a verification. ``ends_at`` is its deadline, as of `time.monotonic`."""

    rounds: int = 20
    engine: Engine = Engine.AUTO
    properties: tuple[str, ...] = ()
    ends_at: float | None = None
    property_timeout_s: float | None = None
    jobs: int = 1
    max_violations: int = 1
    seed: int = 0
    instants: bool = False
    rests_on: bool = False
    wcet: bool = False
    cache: Cache | None = None
    helpers: Helpers | None = None  #: who does what can be done on other machines

    @property
    def left_s(self) -> float | None:
        """The seconds left until the deadline; None: no limit."""
        return None if self.ends_at is None else max(0.0, self.ends_at - time.monotonic())

    @property
    def bounds(self) -> Bounds:
        """The bounds of engines, from now on."""
        from koord.verify.verdicts import Bounds

        return Bounds(self.rounds, self.left_s, self.max_violations, self.property_timeout_s)


def verify(
    program: Loadable,
    *,
    robots: Robots = None,
    rounds: int = 20,
    delta_s: Seconds = None,
    properties: Sequence[str] = (),
    engine: Engine | str = Engine.AUTO,
    timeout_s: float | None = None,
    property_timeout_s: float | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    max_violations: int = 1,
    instants: bool = False,
    rests_on: bool = False,
    wcet: bool = False,
    seed: int = 0,
    cache: Cache | None = None,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> VerifyReport:
    """Verify each property of a program; return verdicts, with a run for each violated one.

    ``robots`` is how many there are, how many of each kind (``{"Car": 2, "Drone": 1}``), or
    ``"any"`` for every number of them; ``delta_s`` how long a round takes, in seconds. Without
    them, what the program states. ``rounds`` is how far bounded engines look. ``properties`` are
    the names of those that are verified (all).

    ``timeout_s`` is the time for everything, ``property_timeout_s`` that for each property, in
    seconds of the wall; ``jobs`` the number of processes (as many as there are cores), and
    ``cluster`` the address of a Dask scheduler whose workers do what can be done elsewhere.
    ``max_violations`` asks for several ways to break a property, ``instants`` for verdicts between
    the ends of rounds, ``rests_on`` for what the proofs need, ``wcet`` for the worst-case execution
    times of events. ``seed`` is of all that is random.

    What a ``cache`` knows is not asked again, and what is found is kept there. It is left alone
    with ``instants``, with ``rests_on`` and where several violations are asked for.

    ``progress`` hears what is being done, and verdicts as they come, as
    :class:`koord.VerdictProgress`; after ``cancellation`` the report has what is known.

    Raises :class:`koord.KoordError` for a program with errors, or that is too large for so many
    robots, :class:`koord.ArgumentError` for arguments that do not fit it.

    >>> report = koord.verify("task.krd", robots=3, rounds=20)
    >>> report.holds
    True
    """
    loaded = program_of(program)
    fleet = fleet_of(robots)
    question = Question(
        loaded, system_of(loaded.core, fleet, delta_of(delta_s)), every_n=fleet.any_number
    )
    if wcet and fleet.any_number:
        raise ArgumentError("wcet", "is about one number of robots: say how many there are")
    options = Options(
        rounds=rounds,
        engine=engine_of(engine, every_n=fleet.any_number),
        properties=tuple(properties),
        ends_at=None if timeout_s is None else time.monotonic() + timeout_s,
        property_timeout_s=property_timeout_s,
        jobs=jobs or cores(),
        max_violations=max_violations,
        seed=seed,
        instants=instants,
        rests_on=rests_on,
        wcet=wcet,
        cache=cache,
    )
    tell, interrupted = teller(progress), asker(cancellation)

    def known(report: VerifyReport) -> None:
        if progress is not None:
            from koord.api.verify_report import VerdictProgress

            told = f"{counted(len(report.report.verdicts), 'claim')} settled"
            progress(VerdictProgress(told, report=report))

    with helped(options, cluster, tell, interrupted) as (options, _):
        (report,) = verify_each([question], options, tell, interrupted, known)
    return report


@contextmanager
def helped(
    options: Options,
    address: str | None,
    tell: Callable[[str], None],
    interrupted: Callable[[], bool],
) -> Iterator[tuple[Options, Cluster | None]]:
    """Within the context, options by which the cluster at an address helps, and that cluster.

    None of them does without an address. Raises KoordError if there is no cluster.
    """
    if address is None:
        yield options, None
        return
    from koord.api.courier import cluster_at

    with cluster_at(address, tell, interrupted) as cluster:
        yield replace(options, helpers=cluster.helpers), cluster


def engine_of(engine: Engine | str, *, every_n: bool) -> Engine:
    """The engine of a request. Raises ArgumentError if it is missing, or does not fit."""
    try:
        found = Engine(engine)
    except ValueError:
        known = ", ".join(each.value for each in Engine)
        raise ArgumentError("engine", f"there is no {engine!r}; there are {known}") from None
    if every_n and found is not Engine.AUTO:
        raise ArgumentError("robots", "any number has an engine of its own: leave out `engine=`")
    if found is Engine.ABC:
        from koord.verify.engines.bits.abc import installed

        if installed() is None:
            raise ArgumentError(
                "engine",
                "abc is not here (Debian: apt-get install berkeley-abc); "
                "`engine='bits'` needs none",
            )
    return found


def verify_each(
    questions: Sequence[Question],
    options: Options,
    tell: Callable[[str], None],
    interrupted: Callable[[], bool],
    heard: Callable[[VerifyReport], None] = lambda report: None,
) -> Iterator[VerifyReport]:
    """Yield the verdicts on some systems, in order.

    Several are asked about in processes of their own, ``options.jobs`` at a time. Once it is
    ``interrupted`` the answers are what is known by then, and there may be fewer of them. Of one
    that is asked about alone the verdicts that are known are ``heard`` whenever there are more.
    """
    looked_up = [_looked_up(question, options) for question in questions]
    if not all(cached is not None and cached.answer is not None for cached in looked_up):
        check_loadable()
        load_for_threads()
    if len(questions) == 1:
        answered = _answer(questions[0], options, tell, interrupted, _known(looked_up[0]), heard)
        report = _kept(looked_up[0], _confirmed(answered, questions[0], options))
        if options.wcet and not report.interrupted:
            report = _measured(report, options.seed, tell, interrupted)
        yield report
        return
    from koord.verify.processes import Pool
    from koord.verify.strategy.time_limits import load

    load()

    def answer(
        question: Question, jobs: int, known: Known | None, tell: JobChannel
    ) -> VerifyReport:
        return _answer(question, replace(options, jobs=jobs), tell, interrupted, known)

    with Pool(options.jobs, tell, interrupted, options.helpers) as pool:
        work = []
        for question, cached in zip(questions, looked_up, strict=True):
            # Beside the last one nobody else has anything to do in the end.
            jobs = options.jobs if question is questions[-1] else 1
            known = _known(cached)
            work_on = partial(answer, question, jobs, known)
            is_known = cached is not None and cached.answer is not None
            portable = None if is_known else _portable(question, options, known)
            job = pool.submit(_named(question, questions), work_on, portable=portable)
            work.append((question, cached, job))
        for question, cached, job in work:
            try:
                found = pool.answer(job)
            except KeyboardInterrupt:
                return
            if found is None:
                yield _unanswered(question, options, job.end)
            else:
                # Another machine has other clocks.
                found = replace(found, ends_at=options.ends_at)
                yield _kept(cached, _confirmed(found, question, options))


def _looked_up(question: Question, options: Options) -> CachedVerification | None:
    """What the cache knows about a system; None where it is not asked."""
    more = options.max_violations > 1 or options.instants or options.rests_on
    if options.cache is None or more:
        return None
    return options.cache.looked_up(
        question.system,
        options.bounds,
        _engine(question, options),
        names=frozenset(options.properties),
        seed=options.seed,
    )


def _known(cached: CachedVerification | None) -> Known | None:
    return None if cached is None else cached.answer or cached.past


def _kept(cached: CachedVerification | None, report: VerifyReport) -> VerifyReport:
    """A report, of which a cache keeps what is new."""
    return report if cached is None else replace(report, at_ends=cached.ended(report.at_ends))


def _engine(question: Question, options: Options) -> engine_names.Engine | None:
    """Who is asked; None: whoever the strategy says."""
    return engine_names.Engine.EVERY_N if question.every_n else _ENGINES[options.engine]


def _measured(
    report: VerifyReport,
    seed: int,
    tell: Callable[[str], None],
    interrupted: Callable[[], bool],
) -> VerifyReport:
    """The report with execution times, which are those of this machine."""
    from koord.api.traces import sources_of
    from koord.api.verdicts import Parts
    from koord.api.wcet import execution_times

    tell("execution times")
    parts, times = Parts(), None
    with parts.enduring("the execution times"):
        times = execution_times(report.system, sources_of(report.program), seed, interrupted)
    return replace(report, execution_times=times, failed=(*report.failed, *parts.failures))


def _confirmed(report: VerifyReport, question: Question, options: Options) -> VerifyReport:
    """The report; where other machines helped, what breaks claims is replayed on this one."""
    if options.helpers is None:
        return report
    from koord.verify.strategy.confirmation import confirmed

    assert report.system == question.system, "it is an answer to another question"
    between = report.between
    if between is not None and report.shadows is not None:
        between = confirmed(report.shadows.system, between)
    return replace(report, at_ends=confirmed(report.system, report.at_ends), between=between)


class _SystemQuestion(PortableWork, frozen=True):
    """A system to verify on another machine."""

    question: Question
    options: Options  #: with neither a deadline, a cache nor helpers
    deadline: Deadline
    known: Known | None

    def __call__(self, tell: JobChannel) -> VerifyReport:
        options = replace(self.options, ends_at=self.deadline.at)
        return _answer(self.question, options, tell, lambda: False, self.known)


def _portable(question: Question, options: Options, known: Known | None) -> PortableWork:
    """The question of a system for another machine, which has a process for each."""
    own = replace(options, jobs=1, ends_at=None, helpers=None, cache=None)
    return _SystemQuestion(question, own, Deadline(options.ends_at), known)


def check_loadable() -> None:
    """Raise MemoryError if there is too little memory to load Z3, which would crash.

    Another process tries it, which is done only where memory is limited.
    """
    try:
        from resource import RLIM_INFINITY, RLIMIT_AS, getrlimit
    except ImportError:
        return
    if (
        getrlimit(RLIMIT_AS)[0] == RLIM_INFINITY
        or "koord.verify.strategy.verification" in sys.modules
    ):
        return

    def loads(tell: JobChannel) -> bool:
        try:
            _load_engines()
        except Exception:  # of whatever kind, for want of memory
            return False
        return True

    if not in_process(loads, lambda text: None, lambda: False):
        raise MemoryError


def load_for_threads() -> None:
    """If there are other threads, load the modules that processes need before one is forked.

    A module that another thread is loading at that moment would never be there in the process.
    """
    others = [t for t in threading.enumerate() if t is not threading.main_thread() and not t.daemon]
    if not others and threading.current_thread() is threading.main_thread():
        return
    _load_engines()


def _load_engines() -> None:
    for name in _NEEDED:
        import_module(name)


def in_process(
    work: Callable[[JobChannel], T], tell: Callable[[str], None], interrupted: Callable[[], bool]
) -> T:
    """Run work with a solver in a process of its own.

    Raises what the work raises, KeyboardInterrupt if it is ``interrupted``, and MemoryError where
    the process dies.
    """
    from koord.verify.processes import Pool

    with Pool(1, tell, interrupted) as pool:
        job = pool.submit("", work)
        found = pool.answer(job)
    if found is None:
        raise MemoryError(job.end)
    return found


def _named(question: Question, questions: Sequence[Question]) -> str:
    """The name of a system among others in progress messages."""
    if len({id(each.program) for each in questions}) == len(questions):
        return question.system.program.name
    return f"{question.system.robots} robots"


def _unanswered(question: Question, options: Options, end: str) -> VerifyReport:
    """The report for a system whose process died."""
    from koord.api.verify_report import VerifyReport
    from koord.verify.claims import claims_of, liveness_of
    from koord.verify.engine_names import Engine
    from koord.verify.obstacles import Failed
    from koord.verify.verdicts import Outcome, Report, Verdict

    system = question.system
    failed = (Failed(Engine.NONE, end),)
    verdicts = tuple(
        Verdict(claim, Outcome.UNKNOWN, Engine.NONE, 0.0, reason=end, obstacles=failed)
        for claim in (*claims_of(system), *liveness_of(system))
    )
    report = Report(verdicts, (), 0.0)
    return VerifyReport(question.program, system, options.bounds, report, ends_at=options.ends_at)


def _answer(
    question: Question,
    options: Options,
    tell: Callable[[str], None],
    interrupted: Callable[[], bool],
    known: Known | None,
    heard: Callable[[VerifyReport], None] = lambda report: None,
) -> VerifyReport:
    """The report on one system: if any number of robots is asked for, on an example."""
    from koord.api.verdicts import Parts
    from koord.api.verify_report import VerifyReport
    from koord.verify.claims import claims_of, liveness_of
    from koord.verify.effort import Deadline
    from koord.verify.verdicts import Report

    system = question.system
    names = [claim.name for claim in (*claims_of(system), *liveness_of(system))]
    shadows = None
    between: list[str] = []
    if options.instants:
        from koord.verify import instants

        left = Deadline.after(options.left_s)
        shadows = in_process(
            lambda tell: instants.shadowed(system, left, options.seed), tell, interrupted
        )
        between = [*shadows.names, *(claim.name for claim, _ in shadows.unsaid)]
    check_names(options.properties, [*names, *between])
    choice = _engine(question, options)
    bounds = options.bounds
    own = [name for name in options.properties if name in names]
    report = Report((), (), 0.0)
    if isinstance(known, Report):
        report = known
    elif own or not options.properties:
        # The engines are not loaded where nobody is asked.
        from koord.verify.strategy.time_limits import verify_apart

        verdicts: dict[str, Found] = {}

        def settled(verdict: Found) -> None:
            if not own or verdict.claim.name in own:
                verdicts[verdict.claim.name] = verdict
                by_now = Report(tuple(verdicts.values()), (), 0.0, every_n=question.every_n)
                heard(VerifyReport(question.program, system, bounds, by_now))

        report = verify_apart(
            system,
            bounds,
            choice,
            names=own,
            seed=options.seed,
            jobs=options.jobs,
            helpers=options.helpers,
            progress=tell,
            interrupted=interrupted,
            past=known,
            settled=settled,
        )
    found = None
    if shadows is None or report.interrupted:
        shadows = None
    else:
        found = instants.verified(
            shadows,
            options.bounds,
            choice,
            wanted=lambda name: not options.properties or name in options.properties,
            seed=options.seed,
            jobs=options.jobs,
            helpers=options.helpers,
            progress=tell,
            interrupted=interrupted,
        )
    parts = Parts()
    rests_on = None
    if options.rests_on and not report.interrupted:
        with parts.enduring("what the proofs rest on"):
            rests_on = _rests_on(system, report, options, tell, interrupted)
    return VerifyReport(
        question.program,
        system,
        bounds,
        report,
        found,
        shadows,
        rests_on,
        tuple(parts.failures),
        options.ends_at,
    )


def _rests_on(
    system: System,
    report: Report,
    options: Options,
    tell: Callable[[str], None],
    interrupted: Callable[[], bool],
) -> ProofCore | None:
    """The proof core of a report; None where the search was cancelled."""
    from koord.verify.proof_core import proof_core

    bounds, seed = options.bounds, options.seed

    def work(tell: JobChannel) -> ProofCore:
        return proof_core(system, report.verdicts, bounds, seed=seed, progress=tell)

    try:
        return in_process(work, tell, interrupted)
    except KeyboardInterrupt:
        return None


def check_names(wanted: Sequence[str], known: Sequence[str]) -> None:
    """Check that properties exist: a misspelt name must not pass. Raises ArgumentError."""
    for word in wanted:
        if word not in known:
            listed = ", ".join(known)
            raise ArgumentError("properties", f"there is no {word!r}; there are {listed}")
