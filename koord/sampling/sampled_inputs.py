"""Sampled inputs, remembered for the recording. [RECORDING]"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeAlias

from msgspec import Struct, field

from koord.sampling.values import Sampler, values_held, values_within
from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.semantics.expressions import evaluate
from koord.semantics.oracle import Key, Oracle, Phase
from koord.semantics.recordings import Answer, Concrete, Reading, Start
from koord.semantics.statements import machine
from koord.semantics.storage import held
from koord.semantics.values import Rec, Seq, Table, map_scalars
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.types import FLOAT, FloatType, Type

Question: TypeAlias = "tuple[str, tuple[Concrete, ...]]"

#: So many answers of an external function are tried before the run gives up.
TRIES = 400

#: An answer that the summary does not allow is mended so often before another is drawn.
_MENDED = 6

#: Summaries that mention other functions are followed so deep; what lies below is taken on trust.
_DEEPEST = 4

#: Of all values of a type, so many are tried on a summary that speaks of every one.
_SAMPLES = 6


class SampledInputs(Struct):
    """Inputs from a sampler. A repeated query gets the same answer until it is forgotten."""

    sampler: Sampler
    starts: dict[tuple[Home, int, int | None], Concrete] = field(default_factory=dict)
    readings: dict[tuple[int, int], Concrete] = field(default_factory=dict)
    answers: dict[tuple[Phase, int, Key], Answer] = field(default_factory=dict)
    functions: dict[Question, Concrete] = field(default_factory=dict)  #: for the whole run
    lengths: dict[tuple[Home, int, int | None], int | None] = field(default_factory=dict)
    types: dict[tuple[Home, int, int | None], Type] = field(default_factory=dict)
    samples: int = _SAMPLES  #: of all values of a type, for summaries; 0: these are taken on trust
    _seen: Configuration[Constant] | None = None
    _later: Callable[[], Configuration[Constant]] | None = None
    _around: dict[int | None, dict[Type, list[Concrete]]] = field(default_factory=dict)

    def look_at(self, configuration: Configuration[Constant]) -> None:
        """Use the values of a configuration as good guesses from now on."""
        self._seen, self._later = configuration, None
        self._around = {}

    def look_later(self, at: Callable[[], Configuration[Constant]]) -> None:
        """As :meth:`look_at`, once values are asked for."""
        self._later = at
        self._around = {}

    def forget_round(self) -> None:
        """Begin a new round: forget readings and answers."""
        self.readings = {}
        self.forget_answers()

    def forget_answers(self) -> None:
        """Forget the answers given since the round began."""
        self.answers = {}

    def is_given(self, key: tuple[Home, int, int | None] | tuple[int, int]) -> bool:
        """Return whether a start, or a reading, is fixed and cannot be drawn again."""
        return False

    # --- what the rules ask ---------------------------------------------------------------------

    def start(self, declaration: core.Declaration, robot: int | None) -> Concrete:
        variable = declaration.variable
        key = (variable.home, variable.slot, robot)
        if key not in self.starts:
            self.types[key], self.lengths[key] = variable.own_type, declaration.length
            self.redraw(key)
        return self.starts[key]

    def redraw(self, key: tuple[Home, int, int | None]) -> None:
        """Draw another start of a variable."""
        type_ = self.types[key]
        others = [value for k, value in self.starts.items() if k != key and self.types[k] == type_]
        known = others if self.sampler.chance(30) else []
        self.starts[key] = self.sampler.value(type_, known, self.lengths[key])

    def sensor(self, robot: int, port: core.Port) -> Concrete:
        variable = port.declaration.variable
        key = (robot, variable.slot)
        if key not in self.readings:
            self.readings[key] = self.sampler.value(
                variable.type, self.around(robot, variable.type)
            )
        return self.readings[key]

    def oracle(self, phase: Phase, robot: int) -> Oracle[Constant]:
        return _SampledOracle(self, phase, robot)

    # --- what is recorded -----------------------------------------------------------------------

    def recorded_starts(self) -> tuple[Start, ...]:
        return tuple(Start(*key, value) for key, value in self.starts.items())

    def recorded_readings(self) -> tuple[Reading, ...]:
        return tuple(Reading(*key, value) for key, value in self.readings.items())

    def recorded_answers(self, *, checks: bool = False) -> tuple[Answer, ...]:
        """The answers since the round began; those to properties only on request."""
        return tuple(
            answer for answer in self.answers.values() if checks or answer.phase is not Phase.CHECK
        )

    # --- guesses --------------------------------------------------------------------------------

    def around(self, robot: int | None, type_: Type) -> list[Concrete]:
        """Values of a type that the robot (or any robot) holds at present."""
        if self._later is not None:
            self.look_at(self._later())
        if self._seen is None:
            return []
        found = self._around.get(robot)
        if found is None:
            found = self._around[robot] = self._held(self._seen, robot)
        return found.get(type_, [])

    def _held(
        self, configuration: Configuration[Constant], robot: int | None
    ) -> dict[Type, list[Concrete]]:
        system, numbers = self.sampler.system, self.sampler.numbers
        found: dict[Type, list[Concrete]] = {}
        storages = [
            *zip(configuration.store.allread, system.program.allread, strict=True),
            *zip(configuration.store.allwrite, system.program.allwrite, strict=True),
        ]
        if robot is not None:
            state, agent = configuration.robots[robot], system.agent(robot)
            ports = (port.declaration for port in agent.ports)
            storages += zip(state.ports, ports, strict=True)
            storages += zip(state.locals, agent.locals, strict=True)
        for storage, entry in storages:
            for type_, value in values_held(numbers, storage, entry.variable.type):
                found.setdefault(type_, []).append(value)
        return found

    # --- external functions ---------------------------------------------------------------------

    def ask(
        self,
        function: core.External,
        arguments: tuple[Concrete, ...],
        robot: int | None,
        pending: dict[Question, Concrete],
    ) -> Concrete:
        """Answer a call of an external function so that its summary holds. [EXTERNAL]

        ``pending`` holds answers on trial: a summary may mention its own function. Raises
        KoordError if no answer is found.
        """
        question = (function.name, arguments)
        lasting = function.kind is core.ExternalKind.FUNCTION
        if lasting and question in self.functions:
            return self.functions[question]
        if question in pending:
            return pending[question]
        for drawn in self._candidates(function, arguments, robot):
            candidate: Concrete | None = drawn
            for _ in range(1 + _MENDED):
                if candidate is None:
                    break
                known = len(self.functions)
                pending[question] = candidate
                meets = len(pending) > _DEEPEST or self._meets(function, arguments, robot, pending)
                better = None if meets else self._mended(function, arguments, robot, pending)
                del pending[question]
                if meets:
                    if lasting:
                        self.functions[question] = candidate
                    return candidate
                # What was found out about other functions hung on this candidate.
                while len(self.functions) > known:
                    self.functions.popitem()
                candidate = better
        raise _no_answer(function, arguments)

    def _candidates(
        self, function: core.External, arguments: tuple[Concrete, ...], robot: int | None
    ) -> Iterable[Concrete]:
        type_ = function.result.type
        made = self.stand_in(function, arguments)
        first = [] if made is None else [made]
        known = list(self.around(robot, type_))
        for argument, parameter in zip(arguments, function.parameters, strict=True):
            known += [v for t, v in values_within(argument, parameter.type) if t == type_]
        return _Draws(self.sampler, type_, first, known)

    def stand_in(self, function: core.External, arguments: tuple[Concrete, ...]) -> Concrete | None:
        """The answer of the library's stand-in for a function, if there is one."""
        from koord.sampling.library import host

        implementation = host(function)
        if implementation is None:
            return None
        try:
            return self.coerced(implementation(*arguments), function.result.type)
        except (ValueError, OverflowError):  # numbers that are none, or too large for doubles
            return None

    def _meets(
        self,
        function: core.External,
        arguments: tuple[Concrete, ...],
        robot: int | None,
        pending: dict[Question, Concrete],
    ) -> bool:
        """Return whether the candidate answer meets the summary; any does if ``requires`` fails."""
        if not function.ensures:
            return True
        d = self.sampler.numbers.domain
        m = machine(d, self.sampler.system, _TrialOracle(self, robot, pending), robot=robot)
        m.memory.bound = [held(d, value) for value in arguments]
        reads = tuple(core.Read(core.Place(p)) for p in function.parameters)
        evaluate(m, core.ExternalCall(function.name, reads, function.result.type, 0))
        return all(d.known(needed.condition) is True for needed in m.legality)

    def _mended(
        self,
        function: core.External,
        arguments: tuple[Concrete, ...],
        robot: int | None,
        pending: dict[Question, Concrete],
    ) -> Concrete | None:
        """The candidate answer with a part changed as the summary suggests, where that is known."""
        from koord.sampling.constraint_guesses import placed, repairs

        d = self.sampler.numbers.domain
        answer = pending[function.name, arguments]
        m = machine(d, self.sampler.system, _TrialOracle(self, robot, pending), robot=robot)
        known = [held(d, value) for value in (*arguments, answer)]
        m.memory.bound = [*known, *[None] * (function.bound - len(known))]
        m.in_summary = True
        mended = [
            placed(answer, repair.path, repair.value)
            for promise in function.ensures
            for repair in repairs(m, promise)
            if repair.home is Home.BOUND and repair.slot == function.result.slot
        ]
        # Parts that are not there, such as elements of a shorter list, cannot be mended.
        mended = [other for other in mended if other != answer]
        return self.sampler.rng.choice(mended) if mended else None

    def coerced(self, value: Concrete, type_: Type) -> Concrete:
        """Convert the rationals of a value to floats of the run's domain."""
        d = self.sampler.numbers.domain

        def of(number: Constant, its: Type) -> Concrete:
            return d.const(number, FLOAT) if isinstance(its, FloatType) else number

        return map_scalars(value, type_, of)


class _Draws(Struct, frozen=True):
    """Candidates for an answer: the library's own, then a limited number of random ones."""

    sampler: Sampler
    type: Type
    first: list[Concrete]
    known: list[Concrete]

    def __iter__(self) -> Iterator[Concrete]:
        yield from self.first
        for _ in range(TRIES):
            yield self.sampler.value(self.type, self.known)


def _no_answer(function: core.External, arguments: tuple[Concrete, ...]) -> KoordError:
    from koord.traces.rendering import show_value

    shown = ", ".join(
        show_value(value, parameter.type)
        for value, parameter in zip(arguments, function.parameters, strict=True)
    )
    if len(shown) > 60:
        shown = f"{shown[:57]}..."
    return KoordError(
        (
            Diagnostic(
                "K921",
                Severity.ERROR,
                function.span,
                f"no answer of {function.name}({shown}) was found in {TRIES} tries "
                "that meets its `ensures`",
                f"write {function.name} in Koord, with a body, or loosen its summary if it is "
                "contradictory",
            ),
        )
    )


class _SampledOracle(Struct):
    """The oracle of one robot's turn, which draws each answer when it is first asked for."""

    inputs: SampledInputs
    phase: Phase
    robot: int

    def choose(self, key: Key, low: Constant, high: Constant, type_: Type) -> Constant:
        place = (self.phase, self.robot, key)
        answer = self.inputs.answers.get(place)
        if answer is not None and _is_between(low, answer.value, high):
            assert isinstance(answer.value, Constant)
            return answer.value
        value = self.inputs.sampler.between(low, high, type_)
        self.inputs.answers[place] = Answer(self.phase, self.robot, key, None, (), value)
        return value

    def external(
        self, function: core.External, key: Key, arguments: tuple[Concrete, ...]
    ) -> Concrete:
        place = (self.phase, self.robot, key)
        answer = self.inputs.answers.get(place)
        if answer is not None and answer.arguments == arguments:
            return answer.value
        value = self.inputs.ask(function, arguments, self.robot, {})
        self.inputs.answers[place] = Answer(
            self.phase, self.robot, key, function.name, arguments, value
        )
        return value

    def vouches_for(self, function: core.External) -> bool:
        return False

    def every(self, type_: Type, body: Callable[[Concrete], Constant]) -> Constant:
        # Some were tried when the answer was found; a replay takes it on trust as well.
        return True


class _TrialOracle(Struct):
    """The oracle while a summary is checked: nothing is recorded."""

    inputs: SampledInputs
    robot: int | None
    pending: dict[Question, Concrete]

    def choose(self, key: Key, low: Constant, high: Constant, type_: Type) -> Constant:
        return self.inputs.sampler.between(low, high, type_)

    def external(
        self, function: core.External, key: Key, arguments: tuple[Concrete, ...]
    ) -> Concrete:
        return self.inputs.ask(function, arguments, self.robot, self.pending)

    def vouches_for(self, function: core.External) -> bool:
        return False

    def every(self, type_: Type, body: Callable[[Concrete], Constant]) -> Constant:
        """Check a statement on sampled values of a type; all of them cannot be tried."""
        if len(self.pending) > 1:
            return True
        known = self.inputs.around(self.robot, type_)
        drawn = (self.inputs.sampler.value(type_, known) for _ in range(self.inputs.samples))
        return all(body(value) for value in drawn)


def _is_between(low: Constant, value: Concrete, high: Constant) -> bool:
    if isinstance(value, str | Rec | Seq | Table) or isinstance(low, str) or isinstance(high, str):
        return False
    return low <= value <= high
