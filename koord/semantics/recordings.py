"""Recordings: runs as data, and their execution by the rules. [RECORDING]

A recording holds the schedule and every value that the rules leave open. A recording and a system
determine a run: :func:`execute` takes it, rule by rule, and says at which step it is not one that
the rules allow.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeAlias

from msgspec import Struct

from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant, Domain
from koord.semantics.oracle import Key, Oracle, Phase
from koord.semantics.properties import holds_in
from koord.semantics.rounds import (
    IllegalStepError,
    Stepped,
    evolved,
    faulted_start,
    initialised,
    run_event,
    run_skip,
)
from koord.semantics.values import Value, identical
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.system import System
from koord.syntax.types import Type

Concrete: TypeAlias = "Value[Constant]"


class Answer(Struct, frozen=True):
    """A recorded answer to one ``choose`` (``function`` is None) or external call of a robot."""

    phase: Phase
    robot: int
    key: Key
    function: str | None
    arguments: tuple[Concrete, ...]
    value: Concrete


class Start(Struct, frozen=True):
    """A recorded start value of an arbitrary variable; ``robot`` is None for allwrite variables."""

    home: Home
    slot: int
    robot: int | None
    value: Concrete


class Reading(Struct, frozen=True):
    """A recorded reading of a sensor without a model, after a round."""

    robot: int
    slot: int
    value: Concrete


class Opening(Struct, frozen=True):
    """The recorded schedule and inputs of INIT; of RELOAD, which has no order."""

    order: tuple[int, ...]
    starts: tuple[Start, ...] = ()
    answers: tuple[Answer, ...] = ()


class Round(Struct, frozen=True):
    """The recorded schedule and inputs of one round.

    ``order`` is the order of the robots' program turns; ``events[i]`` the position of the event
    that robot i ran, None where it skipped. A round that is ``cut`` ends before the environment's
    turn (a violation inside the round, a fault); its order may lack robots.
    """

    order: tuple[int, ...]
    events: tuple[int | None, ...]
    readings: tuple[Reading, ...] = ()
    answers: tuple[Answer, ...] = ()
    cut: bool = False


class Recording(Struct, frozen=True):
    """A recorded run from INIT on. Of a lasso, rounds from number ``loop`` on repeat for ever."""

    opening: Opening
    rounds: tuple[Round, ...] = ()
    loop: int | None = None


class Reached(Struct, frozen=True):
    """Where a run is when another program goes on: its system, and the configuration. [RELOAD]"""

    system: System
    configuration: Configuration[Constant]


# --- inputs from a recording --------------------------------------------------------------------


class RecordedOracle(Struct):
    """An oracle of recorded answers for one turn of one robot."""

    phase: Phase
    robot: int
    answers: dict[Key, Answer]
    heard: list[Answer]

    def choose(self, key: Key, low: Constant, high: Constant, type_: Type) -> Constant:
        answer = self._answer(key, None)
        assert isinstance(answer.value, Constant)
        return answer.value

    def external(
        self, function: core.External, key: Key, arguments: tuple[Concrete, ...]
    ) -> Concrete:
        answer = self._answer(key, function.name)
        if not all(map(identical, answer.arguments, arguments)):
            raise IllegalStepError(
                "EXTERNAL", f"{function.name} was asked with other arguments than recorded"
            )
        return answer.value

    def every(self, type_: Type, body: Callable[[Concrete], Constant]) -> Constant:
        # All values of a type cannot be tried; a summary that speaks of them is taken on trust.
        return True

    def vouches_for(self, function: core.External) -> bool:
        return False

    def _answer(self, key: Key, function: str | None) -> Answer:
        answer = self.answers.get(key)
        if answer is None or answer.function != function:
            what = function or "choose"
            raise IllegalStepError("EXTERNAL", f"no answer of {what} was recorded for {key}")
        self.heard.append(answer)
        return answer


class RecordedInputs:
    """Inputs of one step from a recording. ``heard`` are the answers that were asked for."""

    def __init__(
        self,
        starts: Iterable[Start] = (),
        readings: Iterable[Reading] = (),
        answers: Iterable[Answer] = (),
        heard: list[Answer] | None = None,
    ) -> None:
        self.heard: list[Answer] = [] if heard is None else heard
        self._starts: dict[tuple[Home, int, int | None], Concrete] = {
            (s.home, s.slot, s.robot): s.value for s in starts
        }
        self._readings: dict[tuple[int, int], Concrete] = {
            (r.robot, r.slot): r.value for r in readings
        }
        self._answers: dict[tuple[Phase, int], dict[Key, Answer]] = {}
        for answer in answers:
            self._answers.setdefault((answer.phase, answer.robot), {})[answer.key] = answer

    def start(self, declaration: core.Declaration, robot: int | None) -> Concrete:
        variable = declaration.variable
        value = self._starts.get((variable.home, variable.slot, robot))
        if value is None:
            raise IllegalStepError("INIT", f"no initial value was recorded for {variable.name}")
        return value

    def sensor(self, robot: int, port: core.Port) -> Concrete:
        variable = port.declaration.variable
        value = self._readings.get((robot, variable.slot))
        if value is None:
            raise IllegalStepError(
                "ENV-FREE", f"no reading of {port.label} was recorded for robot {robot}"
            )
        return value

    def oracle(self, phase: Phase, robot: int) -> Oracle[Constant]:
        return RecordedOracle(phase, robot, self.answers(phase, robot), self.heard)

    def answers(self, phase: Phase, robot: int) -> dict[Key, Answer]:
        """The answers recorded for one turn of one robot, by key."""
        return self._answers.get((phase, robot), {})


# --- execution ----------------------------------------------------------------------------------


#: The rules whose steps end at a round: there what is claimed `at round` is asked. [PROP-ROUND]
ROUND_ENDS = ("INIT", "RELOAD", "ENV-TRANS")


class Step(Struct, frozen=True):
    """A step of a run: the rule, the robot, and the configuration reached.

    ``round`` counts from 0; INIT, and RELOAD that a recording begins with, belong to none (-1).
    ``event`` is the name of the event that the robot ran, None for a skip and for steps of the
    whole system.
    """

    rule: str
    round: int
    robot: int | None
    event: str | None
    stepped: Stepped[Constant]

    @property
    def configuration(self) -> Configuration[Constant]:
        return self.stepped.configuration

    @property
    def is_at_round(self) -> bool:
        """Whether the configuration is between two rounds."""
        return self.rule in ROUND_ENDS


def execute(
    d: Domain[Constant],
    system: System,
    recording: Recording,
    heard: list[Answer] | None = None,
    before: Reached | None = None,
) -> Iterator[Step]:
    """Execute a recorded run: yield its steps from INIT on. Raises IllegalStepError.

    With ``before`` it goes on from there instead of INIT. The answers that it asks for are added to
    ``heard``. Raises :class:`IllegalStepError` at the first step that the rules do not allow. Stops
    early after a fault.
    """
    from koord.semantics.reloading import reloaded

    heard = [] if heard is None else heard
    opening = recording.opening
    inputs = RecordedInputs(starts=opening.starts, answers=opening.answers, heard=heard)
    known: dict[tuple[str, tuple[Concrete, ...]], Concrete] = {}
    _consistent(system, opening.answers, known)
    if before is not None:
        stepped = reloaded(d, before.system, system, before.configuration, inputs)
        yield Step("RELOAD", -1, None, None, stepped)
    else:
        _permutation(opening.order, system.robots, whole=True)
        stepped = initialised(d, system, inputs, opening.order)
        if stepped.configuration.fault is None:
            _assumed(d, system, stepped.configuration, inputs)
        stepped = faulted_start(d, system, stepped)
        yield Step("INIT", -1, None, None, stepped)
    for number, round_ in enumerate(recording.rounds):
        if stepped.configuration.fault is not None:
            raise IllegalStepError("FAULT", "a faulted configuration has no successors")
        _consistent(system, round_.answers, known)
        _permutation(round_.order, system.robots, whole=not round_.cut)
        inputs = RecordedInputs(readings=round_.readings, answers=round_.answers, heard=heard)
        for robot in round_.order:
            position = round_.events[robot]
            at = stepped.configuration
            if position is None:
                stepped = run_skip(d, system, at, robot, inputs)
                yield Step("SKIP", number, robot, None, stepped)
            else:
                stepped = run_event(d, system, at, robot, position, inputs)
                name = system.agent(robot).events[position].name
                yield Step("EVENT-TRANS", number, robot, name, stepped)
            if stepped.configuration.fault is not None:
                _last(number, recording)
                return
        if round_.cut:
            _last(number, recording)
            return
        stepped = evolved(d, system, stepped.configuration, inputs)
        yield Step("ENV-TRANS", number, None, None, stepped)


def until(recording: Recording, last: Step) -> Recording:
    """The prefix of a recording that ends with a step, as a recording of its own."""
    if last.rule == "INIT":
        return Recording(recording.opening)
    rounds = recording.rounds[: last.round + 1]
    if last.robot is None:
        return Recording(recording.opening, rounds)
    *before, round_ = rounds
    order = round_.order[: round_.order.index(last.robot) + 1]
    events = tuple(event if i in order else None for i, event in enumerate(round_.events))
    answers = tuple(a for a in round_.answers if a.phase is Phase.PROG and a.robot in order)
    cut = Round(order, events, answers=answers, cut=True)
    return Recording(recording.opening, (*before, cut))


def _assumed(
    d: Domain[Constant], system: System, first: Configuration[Constant], inputs: RecordedInputs
) -> None:
    """Check that the configuration after INIT satisfies the assumptions. [PROP-ASSUME]"""
    for assumption in system.program.assumptions:
        holds, legality = holds_in(d, system, first, assumption.condition, assumption.bound, inputs)
        if holds is not True:
            raise IllegalStepError("PROP-ASSUME", f"{assumption.name} does not hold after INIT")
        for needed in legality:
            if needed.condition is not True:
                raise IllegalStepError(needed.rule, f"{needed.what} ({needed.span})")


def _last(number: int, recording: Recording) -> None:
    """Check that a run that ends inside a round has no further rounds."""
    if number + 1 < len(recording.rounds):
        raise IllegalStepError("RECORDING", f"round {number + 1} ends the run, but others follow")


def _permutation(order: tuple[int, ...], robots: int, *, whole: bool) -> None:
    """Check that an order names robots at most once, and all of them unless the round is cut."""
    legal = len(set(order)) == len(order) and all(0 <= i < robots for i in order)
    if not legal or (whole and len(order) != robots):
        raise IllegalStepError("EVENT-TRANS", f"{order} is no order of {robots} robots")


def _consistent(
    system: System,
    answers: Iterable[Answer],
    known: dict[tuple[str, tuple[Concrete, ...]], Concrete],
) -> None:
    """Check that external functions answer equal arguments equally, in the whole run. [EXTERNAL]"""
    kinds = {function.name: function.kind for function in system.program.externals}
    for answer in answers:
        if answer.function is None or kinds.get(answer.function) is not core.ExternalKind.FUNCTION:
            continue
        question = (answer.function, answer.arguments)
        if not identical(known.setdefault(question, answer.value), answer.value):
            raise IllegalStepError(
                "EXTERNAL", f"{answer.function} answered equal arguments differently"
            )
