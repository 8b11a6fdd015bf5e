"""Extension of a run of a reduced program to the whole program, by sampled inputs. [T-CONE]"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction

from msgspec import field
from msgspec.structs import replace

from koord.sampling.running import ProgramTurn, Run
from koord.sampling.sampled_inputs import SampledInputs
from koord.sampling.values import Sampler
from koord.semantics.domain import Constant
from koord.semantics.oracle import Key, Phase
from koord.semantics.recordings import Answer, Concrete, Reading, Recording, Start
from koord.semantics.storage import contents
from koord.semantics.values import Rec, Seq, Table
from koord.syntax import core
from koord.syntax.core import ExternalKind, Home
from koord.syntax.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    GrowingType,
    IntType,
    MapType,
    RecordType,
    Robots,
    Type,
)
from koord.traces.trace import Numbers


def extended(recording: Recording, sampler: Sampler) -> Recording:
    """A recording of the sampler's whole system that extends a recording of a part of it.

    Raises KoordError or IllegalStepError where none was found.
    """
    inputs = _Given(sampler)
    inputs.learn(recording)
    run = Run(sampler.system, Numbers.EXACT, inputs)
    opening = recording.opening
    inputs.give(opening.starts, (), opening.answers)
    run.begin(opening.order)
    for round_ in recording.rounds:
        inputs.give((), round_.readings, round_.answers)
        for robot in round_.order:
            if run.configuration.fault is None:
                run.make(ProgramTurn(robot, round_.events[robot]))
        if run.configuration.fault is not None:
            break
        if not round_.cut:
            run.evolve()
    made = run.recording()
    rounds = zip(made.rounds, recording.rounds, strict=False)
    return Recording(
        replace(made.opening, answers=_joined(made.opening.answers, opening.answers)),
        tuple(replace(new, answers=_joined(new.answers, old.answers)) for new, old in rounds),
        recording.loop,
    )


def _joined(made: tuple[Answer, ...], given: tuple[Answer, ...]) -> tuple[Answer, ...]:
    """The sampled answers, and the recorded ones that nobody has asked for yet."""
    asked = {(a.phase, a.robot, a.key) for a in made}
    return (*made, *(a for a in given if (a.phase, a.robot, a.key) not in asked))


class _Given(SampledInputs):
    """Inputs that are recorded for each step where possible, and sampled otherwise."""

    _starts: dict[tuple[Home, int, int | None], Concrete] = field(default_factory=dict)
    _readings: dict[tuple[int, int], Concrete] = field(default_factory=dict)
    _answers: dict[tuple[Phase, int, Key], Answer] = field(default_factory=dict)

    def learn(self, recording: Recording) -> None:
        """Fix the answers of external functions to the recorded ones, from the start."""
        lasting = {
            function.name
            for function in self.sampler.system.program.externals
            if function.kind is ExternalKind.FUNCTION
        }
        of_rounds = (answer for round_ in recording.rounds for answer in round_.answers)
        for answer in (*recording.opening.answers, *of_rounds):
            if answer.function is not None and answer.function in lasting:
                self.functions[answer.function, answer.arguments] = answer.value

    def give(
        self, starts: Iterable[Start], readings: Iterable[Reading], answers: Iterable[Answer]
    ) -> None:
        """Provide the recorded inputs of the next step."""
        self._starts = {(s.home, s.slot, s.robot): s.value for s in starts}
        self._readings = {(r.robot, r.slot): r.value for r in readings}
        self._answers = {(a.phase, a.robot, a.key): a for a in answers}
        self.forget_answers()

    def forget_answers(self) -> None:
        self.answers = dict(self._answers)

    def is_given(self, key: tuple[Home, int, int | None] | tuple[int, int]) -> bool:
        return key in self._starts or key in self._readings

    def redraw(self, key: tuple[Home, int, int | None]) -> None:
        if key in self._starts:
            self.starts[key] = self._starts[key]
        else:
            super().redraw(key)

    def sensor(self, robot: int, port: core.Port) -> Concrete:
        variable = port.declaration.variable
        key = (robot, variable.slot)
        if key in self._readings:
            self.readings[key] = self._readings[key]
        elif key not in self.readings and self._seen is not None:
            # A sensor that goes on to read what it read is the plainest one.
            last = self._seen.robots[robot].ports[variable.slot]
            value, is_set = contents(self.sampler.numbers.domain, last, variable.type)
            if is_set:
                self.readings[key] = value
        return super().sensor(robot, port)


class Plain(Sampler):
    """A sampler of each type's plainest value: 0, false, empty."""

    start_tries = 50  # it hardly draws anything else, however often it is asked

    def value(
        self, type_: Type, known: Iterable[Concrete] = (), length: int | None = None
    ) -> Concrete:
        match type_:
            case IntType() | EnumType():
                return 0
            case FloatType():
                return self.real(Fraction(0))
            case BoolType():
                return False
            case RecordType(fields=fields):
                return Rec(tuple(self.value(part) for _, part in fields))
            case ArrayType(element=element, size=size):
                count = self.system.robots if size is Robots.ALL else size
                return Seq(count, tuple(self.value(element) for _ in range(count)))
            case GrowingType(element=element):
                return Seq(length or 0, tuple(self.value(element) for _ in range(length or 0)))
            case MapType():
                return Table(0, ())
            case _:
                return super().value(type_, (), length)

    def between(self, low: Constant, high: Constant, type_: Type) -> Constant:
        return low
