"""Completion of traces by answers that only the rules ask for. [EXTERNAL] [REPLAY]

A robot asks its library what its program asks. A summary may mention further functions
(``result == pathsClear(b, a)``), and so may an assumption or a contract: the rules look at these,
too, and want the answers in the recording. For a run of robots nobody asked; so they are asked
here, of the library that the reference has, and only where the rules and not the program want to
know. The model of a robot that is switched off asks nobody, either.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from random import Random
from typing import TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from koord.sampling.initial_state_search import settle_robot
from koord.sampling.sampled_inputs import SampledInputs
from koord.sampling.values import Sampler
from koord.semantics.configurations import Configuration
from koord.semantics.domain import DOUBLES, Constant
from koord.semantics.oracle import Inputs, Key, Oracle, Phase
from koord.semantics.properties import holds_in
from koord.semantics.recordings import (
    Answer,
    Concrete,
    Opening,
    Reached,
    Reading,
    RecordedInputs,
    Recording,
    Round,
)
from koord.semantics.reloading import reloaded
from koord.semantics.rounds import IllegalStepError, evolved, initialised, run_event, run_skip
from koord.syntax import core
from koord.syntax.core import Direction
from koord.syntax.system import System
from koord.syntax.types import Type
from koord.syntax.walk import nodes
from koord.traces.trace import Numbers, Trace

#: What a function answers to arguments, asked by a robot.
Library: TypeAlias = Callable[[core.External, tuple[Concrete, ...], int | None], Concrete]


def with_summaries(
    trace: Trace,
    library: Library,
    passed: Callable[[int], None] = lambda number: None,
    before: Reached | None = None,
) -> Trace:
    """Complete a trace with the answers that summaries and assumptions need, of its own library.

    A trace that breaks a rule before that is returned as far as it was looked at: replay will say
    where. ``passed`` hears of each round; the run goes on from ``before`` if that is given. Raises
    KoordError where no answer is found that its own summary allows.
    """
    completing = Completing(trace.system, library, before)
    recording = trace.recording
    for answers in (recording.opening.answers, *(round_.answers for round_ in recording.rounds)):
        completing.remember(answers)
    opening = completing.opening(recording.opening)
    rounds = []
    for number, round_ in enumerate(recording.rounds):
        rounds.append(completing.round(round_))
        passed(number)
    return replace(trace, recording=Recording(opening, tuple(rounds)))


class PutOffError(Exception):
    """Raised where a library defers an answer, as it would change afterwards."""


class Completing:
    """The completion of a run, from INIT on and round by round.

    Once the run has broken a rule (which replay finds, too), has ended in a fault, or once the
    library has put off a question, the rest of it stays as it is.
    """

    def __init__(self, system: System, library: Library, before: Reached | None = None) -> None:
        """Complete a run from INIT on; with ``before`` one that goes on from there. [RELOAD]"""
        self.put_off = False  #: whether the library did not answer
        self._system, self._before = system, before
        self._asking = _Asking(system, library)
        self._last: Configuration[Constant] | None = None  #: None: nothing more is looked at

    def remember(self, answers: tuple[Answer, ...]) -> None:
        """Record the answers of functions anywhere in the run."""
        self._asking.remember(answers)

    def opening(self, opening: Opening) -> Opening:
        """Complete the opening. Raises KoordError."""
        self.remember(opening.answers)
        starts = RecordedInputs(starts=opening.starts)
        inputs = CompletedInputs(starts, by_place(opening.answers), self._asking.missing)
        system, before = self._system, self._before
        try:
            if before is not None:
                at = before.configuration
                start = reloaded(DOUBLES, before.system, system, at, inputs).configuration
            else:
                start = initialised(DOUBLES, system, inputs, opening.order).configuration
                if start.fault is None:
                    for assumption in system.program.assumptions:
                        e, bound = assumption.condition, assumption.bound
                        holds_in(DOUBLES, system, start, e, bound, inputs)
        except IllegalStepError:
            return opening
        except PutOffError:
            self.put_off = True
            return opening
        self._go_on(start)
        return replace(opening, answers=inputs.answers)

    def round(self, round_: Round) -> Round:
        """Complete the next round. Raises KoordError."""
        if self._last is None:
            return round_
        self.remember(round_.answers)
        told = by_place(round_.answers)
        inputs = CompletedInputs(RecordedInputs(), told, self._asking.missing)
        readings = round_.readings
        at, self._last = self._last, None
        try:
            at = program_turns(self._system, at, round_, inputs)
            if not round_.cut and at.fault is None:
                readings = with_readings(self._system, at, readings, self._asking.sampled)
                inputs.others = RecordedInputs(readings=readings)
                at = evolved(DOUBLES, self._system, at, inputs).configuration
            self._go_on(at)
        except IllegalStepError:
            pass  # replay finds the same step, and tells of it
        except PutOffError:
            self.put_off = True
        return replace(round_, answers=inputs.answers, readings=readings)

    def _go_on(self, configuration: Configuration[Constant]) -> None:
        self._last = configuration if configuration.fault is None else None


def program_turns(
    system: System, configuration: Configuration[Constant], round_: Round, inputs: Inputs[Constant]
) -> Configuration[Constant]:
    """The configuration after the program turns of a round, up to a fault."""
    for robot in round_.order:
        position = round_.events[robot]
        if position is None:
            stepped = run_skip(DOUBLES, system, configuration, robot, inputs)
        else:
            stepped = run_event(DOUBLES, system, configuration, robot, position, inputs)
        configuration = stepped.configuration
        if configuration.fault is not None:
            break
    return configuration


def mentioned(program: core.Program) -> frozenset[int]:
    """The sites of calls in summaries and contracts, and in the functions these call."""
    summaries = tuple((function.requires, function.ensures) for function in program.externals)
    modules = (module for agent in program.agents for module in agent.modules)
    contracts = tuple(module.contracts for module in modules)
    return asked_in(program, (summaries, contracts))


def asked_in(program: core.Program, part: object) -> frozenset[int]:
    """The sites of calls of external functions in a part, and in the functions that it calls."""
    parts = [part]
    sites, called = set[int](), set[str]()
    while parts:
        for node in nodes(parts.pop()):
            if isinstance(node, core.ExternalCall):
                sites.add(node.site)
            elif isinstance(node, core.Call) and node.function not in called:
                called.add(node.function)
                parts.append(program.function(node.function).body)
    return frozenset(sites)


def asked_by_rules(trace: Trace) -> frozenset[tuple[str, tuple[Concrete, ...]]]:
    """The questions of a trace that no program asks: perhaps nobody gave the answers."""
    recording, sites = trace.recording, mentioned(trace.system.program)
    by_program, by_rules = set[tuple[str, tuple[Concrete, ...]]](), []
    for answers in (recording.opening.answers, *(one.answers for one in recording.rounds)):
        for answer in answers:
            if answer.function is None:
                continue
            question = answer.function, answer.arguments
            if answer.phase is Phase.CHECK or answer.key[0] in sites:
                by_rules.append(question)
            else:
                by_program.add(question)
    return frozenset(by_rules) - by_program


def asking_contracts(
    program: core.Program, agent: core.Agent
) -> list[tuple[core.Module, core.Contract]]:
    """The contracts of an agent that ask external functions, each with its module."""
    return [
        (module, contract)
        for module in agent.modules
        for contract in module.contracts
        if asked_in(program, (contract.requires, contract.ensures))
    ]


def _sensors(system: System, robot: int) -> list[core.Port]:
    """The sensors of a robot that no model writes."""
    agent = system.agent(robot)
    free = [module.ports for module in agent.modules if module.environment is None]
    ports = [agent.ports[position] for positions in free for position in positions]
    return [port for port in ports if port.direction is Direction.SENSOR]


class _Asking:
    """The known answers of external functions in the whole run, and the library for others."""

    def __init__(self, system: System, library: Library) -> None:
        self.system = system
        self.library = library
        # What a summary says of every value is taken on trust, as replay does. [REPLAY]
        self.sampled = SampledInputs(Sampler(self.system, Numbers.DOUBLE, Random(0)), samples=0)
        self.sites: frozenset[int] = mentioned(self.system.program)

    def remember(self, answers: tuple[Answer, ...]) -> None:
        kinds = {function.name: function.kind for function in self.system.program.externals}
        for answer in answers:
            if kinds.get(answer.function or "") is core.ExternalKind.FUNCTION:
                assert answer.function is not None
                self.sampled.functions[answer.function, answer.arguments] = answer.value

    def ask(
        self, function: core.External, arguments: tuple[Concrete, ...], robot: int | None
    ) -> Concrete:
        known = self.sampled.functions
        if (function.name, arguments) not in known:
            known[function.name, arguments] = self.library(function, arguments, robot)
        return known[function.name, arguments]

    def missing(
        self,
        phase: Phase,
        robot: int,
        key: Key,
        function: core.External | None,
        arguments: tuple[Concrete, ...],
    ) -> Concrete | None:
        """Answer a query that only the rules make. Models choose the least value."""
        if function is None:
            return arguments[0] if phase is Phase.ENV else None
        if phase in (Phase.INIT, Phase.PROG) and key[0] not in self.sites:
            return None
        return self.ask(function, arguments, robot)


def with_readings(
    system: System,
    configuration: Configuration[Constant],
    given: tuple[Reading, ...],
    sampled: SampledInputs,
) -> tuple[Reading, ...]:
    """The readings of a round, with values made up for sensors that nobody read.

    Raises KoordError where none are found that contracts allow.
    """
    told = {(reading.robot, reading.slot) for reading in given}
    sampled.forget_round()
    for robot in range(system.robots):
        sensors = {(robot, p.declaration.variable.slot): p for p in _sensors(system, robot)}
        if told.issuperset(sensors):
            continue
        settle_robot(DOUBLES, system, configuration, robot, sampled)
        made_up = (Reading(*key, sampled.sensor(robot, p)) for key, p in sensors.items())
        given = (*(reading for reading in given if reading.robot != robot), *made_up)
    return given


#: Who answers what a recording lacks: of a turn of a robot, an external function (None: a
#: ``choose``, from a number on) and what it is asked about; None if it should have been recorded.
Ask: TypeAlias = Callable[
    [Phase, int, Key, core.External | None, "tuple[Concrete, ...]"], "Concrete | None"
]


#: Where an answer is given in a round: in a turn of a robot, under a key.
Where: TypeAlias = "tuple[Phase, int, Key]"


def by_place(answers: Iterable[Answer]) -> dict[Where, Answer]:
    """The answers of a round, each by its place."""
    return {(answer.phase, answer.robot, answer.key): answer for answer in answers}


class CompletedInputs:
    """The inputs of a round: recorded ones, and answers ``made`` beyond these."""

    def __init__(self, others: RecordedInputs, told: Mapping[Where, Answer], ask: Ask) -> None:
        self.others = others  #: starts and readings
        self.ask = ask
        self._told = told
        self._made: dict[Where, Answer] = {}

    @property
    def made(self) -> tuple[Answer, ...]:
        return tuple(self._made.values())

    @property
    def answers(self) -> tuple[Answer, ...]:
        return (*self._told.values(), *self.made)

    def start(self, declaration: core.Declaration, robot: int | None) -> Concrete:
        return self.others.start(declaration, robot)

    def sensor(self, robot: int, port: core.Port) -> Concrete:
        return self.others.sensor(robot, port)

    def oracle(self, phase: Phase, robot: int) -> Oracle[Constant]:
        return _Oracle(self, phase, robot)

    def find(
        self,
        where: Where,
        function: core.External | None,
        arguments: tuple[Concrete, ...],
    ) -> Concrete | None:
        known = self._told.get(where) or self._made.get(where)
        if known is None:
            value = self.ask(*where, function, arguments)
            if value is None:
                return None
            name, given = (None, ()) if function is None else (function.name, arguments)
            known = self._made[where] = Answer(*where, name, given, value)
        return known.value


class _Oracle(Struct, frozen=True):
    inputs: CompletedInputs
    phase: Phase
    robot: int

    def choose(self, key: Key, low: Constant, high: Constant, type_: Type) -> Constant:
        found = self.inputs.find((self.phase, self.robot, key), None, (low,))
        if found is None:
            raise IllegalStepError("CHOOSE", f"no answer of choose was recorded for {key}")
        assert isinstance(found, Constant)
        return found

    def external(
        self, function: core.External, key: Key, arguments: tuple[Concrete, ...]
    ) -> Concrete:
        found = self.inputs.find((self.phase, self.robot, key), function, arguments)
        if found is None:
            raise IllegalStepError("EXTERNAL", f"no answer of {function.name} was recorded")
        return found

    def every(self, type_: Type, body: Callable[[Concrete], Constant]) -> Constant:
        return True

    def vouches_for(self, function: core.External) -> bool:
        return False
