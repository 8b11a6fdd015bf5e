"""Runs of compiled programs in one process, as traces."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from random import Random

from msgspec import Struct, field

from koord.refinement.sampling_host import SampledHost
from koord.refinement.value_translation import Observer, to_written
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.compile.naming import Names
from koord.runtime.engine.fleet import Fleet, Shown
from koord.runtime.engine.schedules import AtRandom, Deployed, Schedule
from koord.runtime.proposals import INIT_ROUND, Decision
from koord.runtime.robot import Robot
from koord.sampling.sampled_inputs import SampledInputs
from koord.sampling.values import Sampler
from koord.semantics.configurations import Configuration, Fault, FaultKind
from koord.semantics.domain import Constant
from koord.semantics.recordings import Opening, Recording, Round
from koord.syntax import core
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import NOWHERE, Span
from koord.syntax.system import System
from koord.syntax.walk import nodes
from koord.traces.trace import Emitted, Numbers, Sources, Trace


class Compiled(Struct, frozen=True):
    """A program, and the classes that were compiled from it."""

    program: core.Program
    names: Names
    classes: tuple[type[Robot], ...]
    #: The places of the program's text by the way that compiled programs name them.
    places: dict[str, core.Output]

    def emitted(self, shown: Iterable[Shown]) -> Iterator[Emitted]:
        """What a fleet wrote to streams, as traces have it."""
        for one in shown:
            robot = None if one.round == INIT_ROUND else one.robot
            for written in one.written:
                yield Emitted(one.round, robot, to_written(written, self.places[written.place]))


def ready(program: core.Program) -> Compiled:
    """Compile a program and load what was made of it."""
    names = Names(program)
    outputs = {
        place_of(names, node.span): node for node in nodes(program) if isinstance(node, core.Output)
    }
    return Compiled(program, names, loaded(compiled(program)), outputs)


def place_of(names: Names, span: Span) -> str:
    """How compiled programs name a place: without the file where it is their own."""
    where = f"{span.line}:{span.column}"
    return where if span.file == names.file else f"{span.file}:{where}"


class Ran(Struct, frozen=True):
    """A run as a trace, and what it ended with: a place of a fault, a reason to stop early."""

    trace: Trace
    fault_place: str | None = None
    gave_up: KoordError | None = None


def schedule_of(decision: Decision, robots: int) -> tuple[tuple[int, ...], tuple[int | None, ...]]:
    """A round's order and events as recordings have them: those that skip come last."""
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


class _Recorder(Struct):
    """Gathers the recording of a run from what its fleet and its host did."""

    made: Compiled
    system: System
    inputs: SampledInputs
    observer: Observer
    opening: Opening = field(default=Opening(()))
    rounds: list[Round] = field(default_factory=list)
    configurations: list[Configuration[Constant]] = field(default_factory=list)

    def see(self, fleet: Fleet) -> Configuration[Constant]:
        seen = self.observer.configuration(fleet)
        self.configurations.append(seen)
        self.inputs.forget_round()
        self.inputs.look_at(seen)
        return seen

    def round_of(self, decision: Decision, *, cut: bool) -> Round:
        order, events = schedule_of(decision, self.system.robots)
        readings = () if cut else self.inputs.recorded_readings()
        return Round(order, events, readings, self.inputs.recorded_answers(), cut)


def run(
    made: Compiled,
    system: System,
    sources: Sources,
    schedule: Schedule,
    rounds: int,
    rng: Random,
    largest: int | None = None,
) -> Ran:
    """Run a compiled program for so many rounds, or until it faults or stops.

    A run ends, too, when a variable holds more than ``largest`` scalars, or digits of a number:
    programs that nobody wrote let lists double in every round.

    Everything that is left open hangs on the generator. A run for which no start, readings or
    answers are found ends where it got to.
    """
    inputs = SampledInputs(Sampler(system, Numbers.DOUBLE, rng))
    host = SampledHost(system, made.names, inputs)
    observer = Observer(system, made.names)
    recorder = _Recorder(made, system, inputs, observer)
    fleet = Fleet(made.classes, system.kinds, float(system.delta_s), host)
    gave_up: KoordError | None = None
    try:
        _play(fleet, host, recorder, schedule, rounds, largest)
    except KoordError as error:
        gave_up = error
    return _ran(fleet, recorder, sources, gave_up)


def _play(
    fleet: Fleet,
    host: SampledHost,
    recorder: _Recorder,
    schedule: Schedule,
    rounds: int,
    largest: int | None,
) -> None:
    inputs, robots = recorder.inputs, recorder.system.robots
    order = schedule.order(INIT_ROUND, robots)
    host.settle_start(order)
    fleet.begin(order)
    recorder.opening = Opening(
        order, inputs.recorded_starts(), inputs.recorded_answers(checks=True)
    )
    seen = recorder.see(fleet)
    while fleet.ended is None and len(recorder.rounds) < rounds and not fleet.all_stopped:
        if largest is not None and max(map(size_of, fleet.robots)) > largest:
            return
        decision = fleet.program_turns(schedule)
        if decision.fault is not None:
            recorder.rounds.append(recorder.round_of(decision, cut=True))
            recorder.configurations.append(seen)
            return
        host.settle_readings(recorder.observer.configuration(fleet))
        fleet.environment_turn()
        recorder.rounds.append(recorder.round_of(decision, cut=False))
        seen = recorder.see(fleet)


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


def _ran(fleet: Fleet, recorder: _Recorder, sources: Sources, gave_up: KoordError | None) -> Ran:
    configurations = recorder.configurations
    shown = [one for one in fleet.shown if one.round < len(recorder.rounds)]
    ended = fleet.ended if gave_up is None else None
    if ended is not None:
        fault = Fault(FaultKind(ended.fault.kind.value), ended.robot, NOWHERE, ended.fault.detail)
        last = configurations.pop()
        configurations.append(
            Configuration(last.robots, last.store, last.round, last.turn, last.taken, fault)
        )
    trace = Trace(
        sources,
        recorder.system,
        Numbers.DOUBLE,
        Recording(recorder.opening, tuple(recorder.rounds)),
        tuple(configurations),
        tuple(recorder.made.emitted(shown)),
    )
    return Ran(trace, None if ended is None else ended.fault.place, gave_up)


__all__ = ["AtRandom", "Compiled", "Deployed", "Ran", "place_of", "ready", "run"]
