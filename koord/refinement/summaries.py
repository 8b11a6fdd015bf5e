"""Answers that only summaries and properties ask for, added to a trace. [EXTERNAL] [REPLAY]

A robot asks its library what its program asks. A summary may mention further functions
(``result == pathsClear(b, a)``), and so may an assumption: the rules look at these, too, and want
the answers in the recording. For a run of robots nobody asked; so they are asked here, of the
library that the reference has, and only where the rules and not the program want to know.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from random import Random

from koord.semantics.configurations import Configuration, System
from koord.semantics.domain import DOUBLES, Constant
from koord.semantics.execution import RecordedInputs
from koord.semantics.oracle import Key, Oracle, Phase
from koord.semantics.rounds import IllegalStepError, evolved, initialised, run_event, run_skip
from koord.semantics.runs.answering import SampledInputs
from koord.semantics.runs.sampling import Sampler
from koord.semantics.traces.recording import Answer, Concrete, Recording, Round
from koord.semantics.traces.trace import Numbers, Trace
from koord.semantics.turns import holds_in
from koord.syntax import core
from koord.syntax.types import Type
from koord.syntax.walk import nodes


def with_summaries(trace: Trace) -> Trace:
    """The trace with the answers that its summaries and assumptions want.

    A trace that breaks a rule before that is returned as far as it was looked at: replay will say
    where. Raises KoordError where no answer is found that its own summary allows.
    """
    if not _mentioned(trace.system.program) and not trace.system.program.assumptions:
        return trace
    asking = _Asking(trace.system)
    opening, rounds = trace.recording.opening, list(trace.recording.rounds)
    for answers in (opening.answers, *(round_.answers for round_ in rounds)):
        asking.remember(answers)
    try:
        inputs = asking.inputs(opening.answers, starts=RecordedInputs(starts=opening.starts))
        start = initialised(DOUBLES, trace.system, inputs, opening.order).configuration
        if start.fault is None:
            for assumption in trace.system.program.assumptions:
                e, bound = assumption.condition, assumption.bound
                holds_in(DOUBLES, trace.system, start, e, bound, inputs)
        opening = replace(opening, answers=tuple(inputs.answers))
        for number, round_ in enumerate(rounds):
            if start.fault is not None:
                break
            readings = RecordedInputs(readings=round_.readings)
            inputs = asking.inputs(round_.answers, starts=readings)
            start = _round(trace.system, start, round_, inputs)
            rounds[number] = replace(round_, answers=tuple(inputs.answers))
    except IllegalStepError:
        pass  # replay finds the same step, and tells of it
    return replace(trace, recording=Recording(opening, tuple(rounds)))


def _round(
    system: System, configuration: Configuration[Constant], round_: Round, inputs: _Inputs
) -> Configuration[Constant]:
    for robot in round_.order:
        position = round_.events[robot]
        if position is None:
            configuration = run_skip(DOUBLES, system, configuration, robot, inputs).configuration
        else:
            stepped = run_event(DOUBLES, system, configuration, robot, position, inputs)
            configuration = stepped.configuration
        if configuration.fault is not None:
            return configuration
    if round_.cut:
        return configuration
    return evolved(DOUBLES, system, configuration, inputs).configuration


def _mentioned(program: core.Program) -> frozenset[int]:
    """The sites of the calls that stand in summaries."""
    summaries = tuple((function.requires, function.ensures) for function in program.externals)
    calls = (node for node in nodes(summaries) if isinstance(node, core.ExternalCall))
    return frozenset(call.site for call in calls)


@dataclass
class _Asking:
    """What is known of external functions in the whole run, and whom to ask for more."""

    system: System
    sampled: SampledInputs = field(init=False)
    sites: frozenset[int] = field(init=False)

    def __post_init__(self) -> None:
        self.sampled = SampledInputs(Sampler(self.system, Numbers.DOUBLE, Random(0)))
        self.sites = _mentioned(self.system.program)

    def remember(self, answers: tuple[Answer, ...]) -> None:
        kinds = {function.name: function.kind for function in self.system.program.externals}
        for answer in answers:
            if kinds.get(answer.function or "") is core.ExternalKind.FUNCTION:
                assert answer.function is not None
                self.sampled.functions[answer.function, answer.arguments] = answer.value

    def inputs(self, answers: tuple[Answer, ...], starts: RecordedInputs) -> _Inputs:
        return _Inputs(self, starts, list(answers))


@dataclass
class _Inputs:
    """Inputs of one round: what was recorded, and what only the rules ask."""

    asking: _Asking
    others: RecordedInputs
    answers: list[Answer]
    _known: dict[tuple[Phase, int, Key], Answer] = field(init=False)

    def __post_init__(self) -> None:
        self._known = {(a.phase, a.robot, a.key): a for a in self.answers}

    def start(self, declaration: core.Declaration, robot: int | None) -> Concrete:
        return self.others.start(declaration, robot)

    def sensor(self, robot: int, port: core.Port) -> Concrete:
        return self.others.sensor(robot, port)

    def oracle(self, phase: Phase, robot: int) -> Oracle[Constant]:
        return _Oracle(self, phase, robot)

    def find(
        self, where: tuple[Phase, int, Key], ask: Callable[[], Answer | None]
    ) -> Answer | None:
        found = self._known.get(where)
        if found is None:
            found = ask()
            if found is not None:
                self._known[where] = found
                self.answers.append(found)
        return found


@dataclass(frozen=True, slots=True)
class _Oracle:
    inputs: _Inputs
    phase: Phase
    robot: int

    def choose(self, key: Key, low: Constant, high: Constant, type_: Type) -> Constant:
        found = self.inputs.find((self.phase, self.robot, key), lambda: None)
        if found is None:
            raise IllegalStepError("CHOOSE", f"no answer of choose was recorded for {key}")
        assert isinstance(found.value, Constant)
        return found.value

    def external(
        self, function: core.External, key: Key, arguments: tuple[Concrete, ...]
    ) -> Concrete:
        asking = self.inputs.asking

        def ask() -> Answer | None:
            if self.phase is not Phase.CHECK and key[0] not in asking.sites:
                return None
            value = asking.sampled.ask(function, arguments, self.robot, {})
            return Answer(self.phase, self.robot, key, function.name, arguments, value)

        found = self.inputs.find((self.phase, self.robot, key), ask)
        if found is None:
            raise IllegalStepError("EXTERNAL", f"no answer of {function.name} was recorded")
        return found.value

    def every(self, type_: Type, body: Callable[[Concrete], Constant]) -> Constant:
        return True

    def vouches_for(self, function: core.External) -> bool:
        return False
