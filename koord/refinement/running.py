"""Runs of compiled programs in one process, as traces."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from random import Random
from typing import TYPE_CHECKING

from msgspec import Struct, field
from msgspec.structs import replace

from koord.refinement.sampling_hosts import SampledHost
from koord.refinement.translation import Translation, to_fault, to_written
from koord.runtime.columns.counts import Counts
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.compile.machine.lazy import LazyTurns
from koord.runtime.compile.naming import PythonNames
from koord.runtime.engine import AtRandom, Deployed, Ended, RoundEngine, Schedule, Shown
from koord.runtime.proposals import INIT_ROUND, Decision
from koord.runtime.robot import Host, Robot
from koord.sampling.sampled_inputs import SampledInputs
from koord.sampling.values import Sampler
from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.semantics.recordings import Answer, Opening, Reading, Recording, Round
from koord.syntax import core
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Span
from koord.syntax.system import System
from koord.syntax.walk import nodes
from koord.traces.trace import Emitted, Numbers, Sources, Trace

if TYPE_CHECKING:
    from koord.refinement.sure_claims import SureClaims


class Compiled(Struct, frozen=True):
    """A program, and the classes compiled from it."""

    program: core.Program
    names: PythonNames
    classes: tuple[type[Robot], ...]
    #: The places of the program's text by the way that compiled programs name them.
    places: dict[str, core.Output]

    def emitted(self, shown: Iterable[Shown]) -> Iterator[Emitted]:
        """Yield the output of a fleet, in the form of traces."""
        for one in shown:
            robot = None if one.round == INIT_ROUND else one.robot
            for written in one.written:
                yield Emitted(one.round, robot, to_written(written, self.places[written.place]))


def ready(program: core.Program, classes: tuple[type[Robot], ...] = ()) -> Compiled:
    """Compile a program and load its classes, unless they are there already."""
    names = PythonNames(program)
    outputs = {
        place_of(names, node.span): node for node in nodes(program) if isinstance(node, core.Output)
    }
    return Compiled(program, names, classes or loaded(compiled(program)), outputs)


def place_of(names: PythonNames, span: Span) -> str:
    """The place of a span in compiled programs: without the file where it is their own."""
    where = f"{span.line}:{span.column}"
    return where if span.file == names.file else f"{span.file}:{where}"


class CompiledRun(Struct, frozen=True):
    """A run as a trace, with its end: the place of a fault, or a reason to stop early."""

    trace: Trace
    fault_place: str | None = None
    gave_up: KoordError | None = None
    counts: Counts | None = None  #: of who made the turns, where machine code was to


def schedule_of(decision: Decision, robots: int) -> tuple[tuple[int, ...], tuple[int | None, ...]]:
    """A round's order and events for a recording: robots that skip come last."""
    events: list[int | None] = [None] * robots
    for taken in decision.ran:
        events[taken.robot] = taken.event
    order = [taken.robot for taken in decision.ran]
    if decision.fault is not None:
        events[decision.fault.robot] = decision.fault.event
        order.append(decision.fault.robot)
    else:
        order += decision.skipped
    return tuple(order), tuple(events)


def opening_order(decision: Decision, robots: int) -> tuple[int, ...]:
    """The order of INIT; robots that it did not reach come last."""
    order, _ = schedule_of(decision, robots)
    return (*order, *(i for i in range(robots) if i not in order))


def ended_in(trace: Trace, ended: Ended | None) -> CompiledRun:
    """The end of a run, with or without a fault."""
    if ended is None:
        return CompiledRun(trace)
    *before, last = trace.configurations
    faulted = replace(last, fault=to_fault(ended.fault, ended.robot))
    return CompiledRun(replace(trace, configurations=(*before, faulted)), ended.fault.place)


class Recorder(Struct):
    """The recording of a run and its configurations, gathered from its fleet."""

    made: Compiled
    translation: Translation
    first: int | None = None  #: the number of the first round of a run that goes on; None: INIT
    opening: Opening = field(default=Opening(()))
    rounds: list[Round] = field(default_factory=list)
    configurations: list[Configuration[Constant]] = field(default_factory=list)

    def begun(self, opening: Opening, fleet: RoundEngine) -> None:
        """Record the end of INIT."""
        self.opening = opening
        self.configurations.append(self.translation.configuration(fleet))

    def round(
        self,
        decision: Decision,
        readings: tuple[Reading, ...],
        answers: tuple[Answer, ...],
        fleet: RoundEngine,
    ) -> None:
        """Record the end of a round, or its cut by a fault: then nobody read anything."""
        order, events = schedule_of(decision, self.translation.system.robots)
        cut = decision.fault is not None
        self.rounds.append(Round(order, events, () if cut else readings, answers, cut))
        last = self.configurations[-1]
        self.configurations.append(last if cut else self.translation.configuration(fleet))

    def trace(self, sources: Sources, recording: Recording, fleet: RoundEngine) -> Trace:
        """Make a trace of a recording of the first rounds, with their output."""
        rounds, first = len(recording.rounds), self.first
        shown = [one for one in fleet.shown if one.round < rounds]
        if first is not None:  # rounds are counted from there
            own = (one for one in fleet.shown if first <= one.round < first + rounds)
            shown = [replace(one, round=one.round - first) for one in own]
        return Trace(
            sources,
            self.translation.system,
            Numbers.DOUBLE,
            recording,
            tuple(self.configurations[: rounds + 1]),
            tuple(self.made.emitted(shown)),
        )


def run(
    made: Compiled,
    system: System,
    sources: Sources,
    schedule: Schedule,
    rounds: int,
    rng: Random,
    largest: int | None = None,
    *,
    kernels: bool = False,
    is_over: Callable[[], bool] = lambda: False,
) -> CompiledRun:
    """Run a compiled program for so many rounds, or until it faults or stops, or ``is_over``.

    With ``kernels`` its turns are made by machine code from the first round on, where there is any,
    and of whatever properties code is sure of, the reference has to be.

    A run ends, too, when a variable holds more than ``largest`` scalars, or digits of a number:
    programs that nobody wrote let lists double in every round.

    Everything that is left open hangs on the generator. A run for which no start, readings or
    answers are found ends where it got to.
    """
    translation = Translation(system, made.names)
    host = SampledHost(translation, SampledInputs(Sampler(system, Numbers.DOUBLE, rng)))
    recorder = Recorder(made, translation)
    claims = _claims_of(system) if kernels else None
    turns = None if claims is None else claims.turns
    fleet = engine_of(made, system, host, kernels=kernels, turns=turns)
    gave_up: KoordError | None = None
    try:
        _play(fleet, host, recorder, schedule, rounds, largest, claims, is_over)
    except KoordError as error:
        gave_up = error
    recording = Recording(recorder.opening, tuple(recorder.rounds))
    trace = recorder.trace(sources, recording, fleet)
    ran = ended_in(trace, fleet.ended) if gave_up is None else CompiledRun(trace, None, gave_up)
    counts = getattr(fleet, "counts", Counts()) if kernels else None
    return replace(ran, counts=counts)


def _claims_of(system: System) -> SureClaims | None:
    """The properties that machine code looks at; None where there is no NumPy."""
    with suppress(ModuleNotFoundError):
        from koord.refinement.sure_claims import SureClaims

        return SureClaims(system)
    return None


def engine_of(
    made: Compiled,
    system: System,
    host: Host,
    *,
    kernels: bool,
    turns: LazyTurns | None = None,
) -> RoundEngine:
    """The engine of a run; with ``kernels`` by machine code from the first round on, if it can be.

    ``turns`` is that code, if somebody has asked for more than turns. Without NumPy, which comes
    with the extras of worlds, it cannot.
    """
    given = (made.classes, system.kinds, float(system.delta_s), host)
    if kernels:
        with suppress(ModuleNotFoundError):
            from koord.runtime.columns.engine import ColumnEngine

            code = LazyTurns(system.program) if turns is None else turns
            return ColumnEngine(*given, code, after=0)
    return RoundEngine(*given)


def _play(
    fleet: RoundEngine,
    host: SampledHost,
    recorder: Recorder,
    schedule: Schedule,
    rounds: int,
    largest: int | None,
    claims: SureClaims | None,
    is_over: Callable[[], bool],
) -> None:
    def check(configuration: Configuration[Constant]) -> None:
        if claims is not None:
            claims.check(fleet, configuration, inputs)

    inputs = host.inputs
    order = schedule.order(INIT_ROUND, host.system.robots)
    host.settle_start(order)
    fleet.begin(order)
    answers = inputs.recorded_answers(checks=True)
    recorder.begun(Opening(order, inputs.recorded_starts(), answers), fleet)
    while fleet.ended is None and len(recorder.rounds) < rounds and not fleet.all_stopped:
        inputs.forget_round()
        inputs.look_at(recorder.configurations[-1])
        if is_over() or (largest is not None and max(map(size_of, fleet.robots)) > largest):
            return
        decision = fleet.program_turns(schedule)
        if decision.fault is None:
            configuration = host.translation.configuration(fleet)
            check(configuration)
            host.settle_readings(configuration)
            fleet.environment_turn()
        recorder.round(decision, inputs.recorded_readings(), inputs.recorded_answers(), fleet)
        check(recorder.configurations[-1])


def size_of(robot: Robot) -> int:
    """The size of the largest value that any variable of a robot holds."""
    return max(map(_size, vars(robot).values()), default=0)


def _size(value: object) -> int:
    match value:
        case tuple():
            return sum(map(_size, value)) + 1
        case dict():
            return sum(map(_size, value)) + sum(map(_size, value.values())) + 1
        case int():
            return 1 + value.bit_length() // 8
        case _:
            return 1


__all__ = ["AtRandom", "Compiled", "CompiledRun", "Deployed", "place_of", "ready", "run"]
