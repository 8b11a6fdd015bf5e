"""Random runs: legal recordings of a system, with what the rules leave open chosen by chance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from random import Random
from typing import TypeAlias, TypeVar

from koord.semantics.configurations import Configuration
from koord.semantics.domain import EXACT, Constant
from koord.semantics.oracle import Key, Oracle, Phase
from koord.semantics.properties import holds_in
from koord.semantics.recordings import Answer, Opening, Reading, Recording, Round, Start
from koord.semantics.rounds import (
    IllegalStepError,
    Stepped,
    enabled,
    evolved,
    initialised,
    run_event,
    run_skip,
)
from koord.semantics.values import Value
from koord.syntax import core
from koord.syntax.core import ExternalKind, Home
from koord.syntax.system import System
from koord.syntax.types import INT, ArrayType, Type
from tests.generators.configurations import value

Concrete: TypeAlias = "Value[Constant]"
Functions: TypeAlias = "dict[tuple[str, tuple[Concrete, ...]], Concrete]"
T = TypeVar("T")

#: How often a step is tried with other answers, before it counts as impossible.
ATTEMPTS = 25


@dataclass(slots=True)
class RandomOracle:
    """Answers by chance, the same for the same question of one turn; each is noted."""

    inputs: RandomInputs
    phase: Phase
    robot: int

    def choose(self, key: Key, low: Constant, high: Constant, type_: Type) -> Constant:
        noted = self._noted(key)
        if noted is not None:
            assert isinstance(noted, Constant)
            return noted
        assert not isinstance(low, str)
        assert not isinstance(high, str)
        if type_ == INT:
            assert isinstance(low, int)
            chosen: Constant = self.inputs.random.randint(low, max(low, int(high)))
        else:
            chosen = low + (high - low) * self.inputs.random.choice((0, 1)) / 1
        self._note(key, None, (), chosen)
        return chosen

    def external(
        self, function: core.External, key: Key, arguments: tuple[Concrete, ...]
    ) -> Concrete:
        noted = self._noted(key)
        if noted is not None:
            return noted
        question = (function.name, arguments)
        answer = self.inputs.functions.get(question)
        if answer is None or function.kind is ExternalKind.FRESH:
            answer = value(self.inputs.random, function.result.type, self.inputs.robots)
        if function.kind is ExternalKind.FUNCTION:
            self.inputs.functions[question] = answer
        self._note(key, function.name, arguments, answer)
        return answer

    def vouches_for(self, function: core.External) -> bool:
        return False

    def every(self, type_: Type, body: Callable[[Concrete], Constant]) -> Constant:
        return True

    def _noted(self, key: Key) -> Concrete | None:
        answer = self.inputs.answers.get((self.phase, self.robot, key))
        return answer.value if answer is not None else None

    def _note(
        self, key: Key, function: str | None, arguments: tuple[Concrete, ...], answer: Concrete
    ) -> None:
        self.inputs.answers[self.phase, self.robot, key] = Answer(
            self.phase, self.robot, key, function, arguments, answer
        )


@dataclass(slots=True)
class RandomInputs:
    """Inputs by chance for one step, noted for a recording."""

    random: Random
    robots: int
    functions: Functions
    starts: dict[tuple[Home, int, int | None], Start] = field(default_factory=dict)
    readings: dict[tuple[int, int], Reading] = field(default_factory=dict)
    answers: dict[tuple[Phase, int, Key], Answer] = field(default_factory=dict)

    def start(self, declaration: core.Declaration, robot: int | None) -> Concrete:
        variable = declaration.variable
        type_ = variable.type
        if variable.home is Home.ALLREAD:
            assert isinstance(type_, ArrayType)
            type_ = type_.element
        started = value(self.random, type_, self.robots, declaration.length)
        where = (variable.home, variable.slot, robot)
        self.starts[where] = Start(*where, started)
        return started

    def sensor(self, robot: int, port: core.Port) -> Concrete:
        variable = port.declaration.variable
        if (robot, variable.slot) in self.readings:
            return self.readings[robot, variable.slot].value
        read = value(self.random, variable.type, self.robots)
        self.readings[robot, variable.slot] = Reading(robot, variable.slot, read)
        return read

    def oracle(self, phase: Phase, robot: int) -> Oracle[Constant]:
        return RandomOracle(self, phase, robot)


@dataclass(slots=True)
class Player:
    """Plays a system by chance. ``functions`` are the external functions, as far as asked."""

    random: Random
    system: System
    functions: Functions = field(default_factory=dict)

    def opening(self) -> tuple[Opening, Stepped[Constant]] | None:
        """INIT, or None where no attempt was legal."""
        order = self._order()
        tried = self._attempt(partial(self._start, order))
        if tried is None:
            return None
        inputs, stepped = tried
        starts, answers = tuple(inputs.starts.values()), tuple(inputs.answers.values())
        return Opening(order, starts, answers), stepped

    def _start(self, order: tuple[int, ...], inputs: RandomInputs) -> Stepped[Constant]:
        """INIT, where the assumptions hold after it. [PROP-ASSUME]"""
        stepped = initialised(EXACT, self.system, inputs, order)
        first = stepped.configuration
        for assumption in self.system.program.assumptions:
            e, bound = assumption.condition, assumption.bound
            holds, _ = holds_in(EXACT, self.system, first, e, bound, inputs)
            if holds is not True:
                raise IllegalStepError("PROP-ASSUME", assumption.name)
        return stepped

    def round(
        self, start: Configuration[Constant]
    ) -> tuple[Round, list[Configuration[Constant]]] | None:
        """One round and the configurations in it, or None where the environment has no turn."""
        order = self._order()
        moves: list[int | None] = [None] * self.system.robots
        answers: list[Answer] = []
        seen: list[Configuration[Constant]] = []
        moved: list[int] = []
        configuration = start
        for robot in order:
            position, step = self._move(configuration, robot)
            if step is None:
                return Round(tuple(moved), tuple(moves), (), tuple(answers), cut=True), seen
            inputs, stepped = step
            moved.append(robot)
            moves[robot] = position
            answers += inputs.answers.values()
            configuration = stepped.configuration
            seen.append(configuration)
            if configuration.fault is not None:
                return Round(tuple(moved), tuple(moves), (), tuple(answers), cut=True), seen
        tried = self._attempt(lambda inputs: evolved(EXACT, self.system, configuration, inputs))
        if tried is None:
            return None
        inputs, stepped = tried
        seen.append(stepped.configuration)
        answers += inputs.answers.values()
        readings = tuple(inputs.readings.values())
        return Round(order, tuple(moves), readings, tuple(answers)), seen

    def _move(
        self, configuration: Configuration[Constant], robot: int
    ) -> tuple[int | None, tuple[RandomInputs, Stepped[Constant]] | None]:
        """A turn of one robot: an enabled event, or a skip where that is legal."""
        scratch = RandomInputs(self.random, self.system.robots, dict(self.functions))
        positions = enabled(EXACT, self.system, configuration, robot, scratch)
        options: list[int | None] = [*positions, *positions, None]
        self.random.shuffle(options)
        for position in [*options, None]:
            step = partial(self._step, configuration, robot, position)
            tried = self._attempt(step)
            if tried is not None:
                return position, tried
        return None, None

    def _step(
        self,
        configuration: Configuration[Constant],
        robot: int,
        position: int | None,
        inputs: RandomInputs,
    ) -> Stepped[Constant]:
        if position is None:
            return run_skip(EXACT, self.system, configuration, robot, inputs)
        return run_event(EXACT, self.system, configuration, robot, position, inputs)

    def _attempt(self, step: Callable[[RandomInputs], T]) -> tuple[RandomInputs, T] | None:
        """The first legal outcome of a step, with the answers that led to it."""
        for _ in range(ATTEMPTS):
            functions = dict(self.functions)
            inputs = RandomInputs(self.random, self.system.robots, functions)
            try:
                outcome = step(inputs)
            except IllegalStepError as refused:
                if not (inputs.answers or inputs.readings or inputs.starts):
                    return None
                if refused.rule in ("STOP", "SELECT", "SKIP") and not inputs.answers:
                    return None
                continue
            self.functions = functions
            return inputs, outcome
        return None

    def _order(self) -> tuple[int, ...]:
        order = list(range(self.system.robots))
        self.random.shuffle(order)
        return tuple(order)


def recording(random: Random, system: System, rounds: int) -> Recording | None:
    """A legal recording of at most that many rounds, or None where INIT has no legal outcome."""
    player = Player(random, system)
    opened = player.opening()
    if opened is None:
        return None
    opening, stepped = opened
    configuration = stepped.configuration
    played: list[Round] = []
    while len(played) < rounds and configuration.fault is None:
        found = player.round(configuration)
        if found is None:
            break
        round_, seen = found
        if not seen:
            break
        played.append(round_)
        configuration = seen[-1]
        if round_.cut:
            break
    return Recording(opening, tuple(played))
