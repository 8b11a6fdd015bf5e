"""Runs of a program by the rules of the semantics, step by step."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from enum import Enum
from random import Random
from typing import BinaryIO, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from koord.api.programs import Loadable, Program, program_of
from koord.api.progress import Cancellation, CancelledError, Listener, Progress, asker, ended
from koord.api.results import ArgumentError, Result
from koord.api.robots import Robots, Seconds, delta_of, fleet_of, system_of
from koord.api.traces import Trace, sources_of
from koord.sampling.made_rounds import MadeRound as MadeRound
from koord.sampling.made_rounds import TakenStep as TakenStep
from koord.sampling.monitors import Monitor
from koord.sampling.policies import AtRandom, First, Play
from koord.sampling.running import Run, new_run
from koord.semantics.configurations import Configuration, Fault
from koord.semantics.domain import Constant
from koord.syntax.budget import Budget, OutOfBudgetError
from koord.syntax.source import Span, counted
from koord.syntax.system import System
from koord.traces.trace import Numbers, Tracer, Violation, ViolationKind
from koord.traces.trace import Trace as Recorded
from koord.traces.unfinished import GrowingTrace

Name = TypeVar("Name", bound=Enum)


class Policy(Enum):
    """The scheduling policy of a run."""

    FIRST = "first"  #: the first enabled event in the order of the program, as robots do
    RANDOM = "random"  #: any allowed step, by the seed


class Ending(Struct, frozen=True):
    """The end of a run, or its present state."""

    system: System
    configuration: Configuration[Constant]
    rounds: int  #: that are over
    begun: bool  #: whether INIT is over
    all_stopped: bool
    violation: Violation | None
    interrupted: bool = False

    @staticmethod
    def of(run: Run, violation: Violation | None, *, interrupted: bool = False) -> Ending:
        """The present state of a run."""
        return Ending(
            run.system,
            run.configuration,
            run.round,
            run.begun,
            run.all_stopped,
            violation,
            interrupted,
        )

    @property
    def fault(self) -> Fault | None:
        """The fault that ended the run, or None."""
        return self.configuration.fault

    @property
    def broken(self) -> bool:
        """True if the run ended in a fault, or in the violation of a claim."""
        return self.fault is not None or self.violation is not None

    @property
    def place(self) -> Span | None:
        """The place in the text of the fault or violated claim."""
        program, violation = self.system.program, self.violation
        if self.fault is not None:
            return self.fault.span
        if violation is None:
            return None
        if violation.kind is ViolationKind.PROPERTY:
            return next(p.span for p in program.properties if p.name == violation.name)
        contracts = (c for a in program.agents for m in a.modules for c in m.contracts)
        return next(c.span for c in contracts if c.name == violation.name)


class RunReport(Result, frozen=True):
    """The result of a run: its trace, and how it ended."""

    program: Program
    trace: Trace
    ending: Ending

    @property
    def rounds(self) -> int:
        """The number of finished rounds."""
        return self.ending.rounds

    @property
    def fault(self) -> Fault | None:
        """The fault that ended the run, or None."""
        return self.ending.fault

    @property
    def violation(self) -> Violation | None:
        """The claim that the run broke, or None."""
        return self.ending.violation

    @property
    def interrupted(self) -> bool:
        """True if the run was cancelled."""
        return self.ending.interrupted

    def to_dict(self) -> dict[str, object]:
        """The trace as plain data, as ``koord run --json`` prints it."""
        return self.trace.to_dict()

    def __repr__(self) -> str:
        how = "interrupted" if self.interrupted else "done"
        if self.fault is not None:
            how = f"fault: {self.fault.kind.value}"
        elif self.violation is not None:
            how = f"violated: {self.violation.name}"
        return f"<RunReport {self.trace.recorded.problem}: {how}, {counted(self.rounds, 'round')}>"

    def _repr_html_(self) -> str:
        return self.trace._repr_html_()


class RunSession(Struct):
    """A run by a policy in progress; ``tracer`` gathers its trace, if there is one."""

    program: Program
    system: System
    play: Play
    tracer: Tracer | None
    cancelled: Callable[[], bool]
    interrupted: bool = False

    def parts(self) -> Iterator[TakenStep | MadeRound]:
        """Yield the steps of the run, or whole rounds. What is cancelled halfway does not count.

        Raises KoordError where an assumption, a contract or a summary cannot be met, and
        CancelledError where it is ended before there is a start.
        """
        begun = False
        try:
            for part in self.play.parts():
                begun = True
                if self.tracer is not None:
                    if isinstance(part, MadeRound):
                        self.tracer.add_round(part.number, part.configuration, part.written)
                    else:
                        self.tracer.add(part.step)
                yield part
                if self.play.is_told and self.cancelled():
                    self.interrupted = True
                    return
        except OutOfBudgetError:
            if not begun:
                raise CancelledError("while looking for a start") from None
            self.interrupted = True

    @property
    def ending(self) -> Ending:
        """The present state of the run."""
        return Ending.of(self.play.run, self.play.violation, interrupted=self.interrupted)

    def recorded(self) -> Recorded:
        """The trace of the run so far."""
        assert self.tracer is not None
        play = self.play
        return self.tracer.trace(
            sources_of(self.program),
            self.system,
            play.run.numbers,
            play.recording(),
            play.violation,
        )

    def part(self, file: BinaryIO) -> Callable[[], None]:
        """Begin a growing file of the trace; return a function that appends the new part."""
        part, tracer = GrowingTrace(file), self.tracer

        def grow() -> None:
            if tracer is not None and tracer.configurations:
                part.grow(self.recorded())

        return grow


def run(
    program: Loadable,
    *,
    robots: Robots = None,
    rounds: int = 20,
    delta_s: Seconds = None,
    policy: Policy | str = Policy.FIRST,
    numbers: Numbers | str = Numbers.EXACT,
    seed: int = 0,
    timeout_s: float | None = None,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> RunReport:
    """Run a program by the rules of the semantics, up to a fault or a violation.

    ``robots`` is how many there are, or how many of each kind (``{"Car": 2}``); ``delta_s`` how
    long a round takes, in seconds. Without them, what the program states. ``policy`` says which of
    the allowed steps is taken: ``"first"``, as robots do, or ``"random"``, by the ``seed``; what
    the program leaves open is chosen by the seed as well. ``numbers`` is what a float is:
    ``"exact"``, a rational, or ``"double"``, as on robots.

    ``progress`` hears of each round; after ``cancellation``, or ``timeout_s`` seconds, the report
    has the run up to there.

    Raises :class:`koord.KoordError` for a program with errors, or where no start, answer or reading
    meets what is assumed of it; :class:`koord.ArgumentError` for arguments that do not fit; and
    :class:`koord.CancelledError` or TimeoutError where it is ended before there is a start.

    >>> koord.run("task.krd", rounds=5).violation
    """
    loaded = program_of(program)
    fleet = fleet_of(robots)
    if fleet.any_number:
        raise ArgumentError("robots", "a run needs a number of robots")
    session = session_of(
        loaded,
        system_of(loaded.core, fleet, delta_of(delta_s)),
        HowToRun(rounds, _one_of(Policy, "policy", policy), _one_of(Numbers, "numbers", numbers)),
        seed,
        None if cancellation is None and timeout_s is None else asker(cancellation, timeout_s),
    )
    try:
        for part in session.parts():
            if progress is not None and (isinstance(part, MadeRound) or part.step.robot is None):
                made = session.play.run.round
                progress(Progress(f"round {made} of {rounds}", round=made))
    except CancelledError as error:
        raise ended(cancellation, str(error)) from None
    return RunReport(loaded, Trace(session.recorded()), session.ending)


class HowToRun(Struct, frozen=True):
    """The options of a run: rounds, policy, numbers, trace, and whether there is a recording."""

    rounds: int
    policy: Policy = Policy.FIRST
    numbers: Numbers = Numbers.EXACT
    traced: bool = True
    recorded: bool = True


def session_of(
    program: Program, system: System, how: HowToRun, seed: int, cancelled: Callable[[], bool] | None
) -> RunSession:
    """Prepare a run; ``cancellation`` may be None."""
    rng = Random(seed)
    # A trace outlives whoever is asked whether to go on.
    heard = system if cancelled is None else replace(system, budget=Budget(cancelled))
    run = new_run(heard, how.numbers, rng, kept=how.traced or how.recorded)
    policy = First() if how.policy is Policy.FIRST else AtRandom(rng)
    play = Play(run, policy, how.rounds, Monitor(run.d, heard, run.inputs))
    tracer = Tracer() if how.traced else None
    return RunSession(program, system, play, tracer, cancelled or (lambda: False))


def _one_of(names: type[Name], argument: str, given: Name | str) -> Name:
    try:
        return names(given)
    except ValueError:
        known = ", ".join(str(each.value) for each in names)
        raise ArgumentError(argument, f"there is no {given!r}; there are {known}") from None
