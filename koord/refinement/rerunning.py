"""Recorded runs, run again by compiled programs, configuration by configuration. [RERUN]

What the reference semantics says of a run is worth something on the road only if the program that
drives there does the same. So a counterexample is given to the compiled program as well: the same
order, the same events, the same readings and answers.

Recordings in exact numbers are given as the nearest doubles, and floats that come out are the same
if they are so up to rounding. Inside a round, where a run that breaks a claim may end, a runtime
has no configuration: there the store counts, and what those have of their own who had a turn.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import islice, zip_longest
from typing import Any

from koord.refinement.rehearsing import Rehearsal, Rehearsed
from koord.refinement.running import Compiled, ready, schedule_of
from koord.refinement.translating import Observer
from koord.runtime.compile import NumberTooLargeError
from koord.runtime.engine.fleet import Ended, Fleet
from koord.runtime.operations import FaultError
from koord.runtime.proposals import Decision, FaultKind
from koord.runtime.robot import Key, Robot, Turn
from koord.semantics.configurations import Configuration, Fault, Store
from koord.semantics.configurations import FaultKind as FaultName
from koord.semantics.configurations import Robot as RobotState
from koord.semantics.domain import DOUBLES, Constant
from koord.semantics.execution import RecordedInputs
from koord.semantics.replay import quoted, same_output
from koord.semantics.rounds import IllegalStepError
from koord.semantics.storage import Cell, Storage, Tree
from koord.semantics.traces.changes import Change, changes, differences
from koord.semantics.traces.names import Names
from koord.semantics.traces.recording import Round
from koord.semantics.traces.trace import (
    BEFORE_ROUNDS,
    Emitted,
    Numbers,
    Trace,
    ViolationKind,
)
from koord.semantics.turns import holds_in
from koord.semantics.values import Rec, Seq, Table, Value
from koord.syntax.source import NOWHERE
from koord.syntax.types import FLOAT
from koord.syntax.walk import nodes

#: Two floats are the same up to rounding if they are this close, relative to the larger of them
#: or, near zero, in their own unit.
ROUNDING = 1e-9

#: So many locations that differ are told.
_MOST_TOLD = 20

#: What is told besides, where that may be why a program departs.
_ROUNDED = "; it computes with doubles, and the recording is of exact numbers"


_TOO_LARGE = "a number is larger than any double"


@dataclass(frozen=True, slots=True)
class Departure:
    """Where a compiled program does something else. ``round`` is -1 for INIT.

    ``changes`` has what the recording says as ``old``, and what the program did as ``new``.
    """

    round: int
    reason: str
    changes: tuple[Change, ...] = ()


def rerun(trace: Trace, made: Compiled | None = None) -> Departure | None:
    """Where the compiled program departs from a run; None if it does the same, state for state."""
    nobody = _Nobody()
    try:
        made = ready(trace.system.program) if made is None else made
    except NumberTooLargeError:
        return Departure(nobody.round, _TOO_LARGE)
    running = _Rerun(trace, made, nobody)
    try:
        running.run()
    except _DepartedError as error:
        found = error.departure
        return replace(found, reason=found.reason + _ROUNDED) if _rounds(trace) else found
    except OverflowError:
        return Departure(nobody.round, _TOO_LARGE)
    return running.kept()


def _rounds(trace: Trace) -> bool:
    """Whether a program may depart because its floats are doubles."""
    types = (getattr(node, "type", None) for node in nodes(trace.system.program))
    return trace.numbers is Numbers.EXACT and FLOAT in types


class _DepartedError(Exception):
    """Carries the departure out of the run."""

    def __init__(self, departure: Departure) -> None:
        super().__init__(departure.reason)
        self.departure = departure


class _Nobody:
    """The host of what nobody recorded.

    A robot that asks it meets a fault. That need not be the end: an urgent event, which obliges a
    robot, is tried even where the robot runs another one.
    """

    def __init__(self) -> None:
        self.round = BEFORE_ROUNDS

    def start(self, robot: int | None, name: str) -> Any:
        raise _unheard(f"the start of {name}")

    def read(self, robot: Robot) -> Mapping[str, Any]:
        return {}

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        raise _unheard(f"an answer of {function}")

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        raise _unheard(f"a choice from {low} to {high}")


#: The place of a fault that no program has.
_NOT_RECORDED = "<recording>:0:0"


def _unheard(what: str) -> FaultError:
    reason = f"it asks for {what}, which nobody recorded"
    return FaultError(FaultKind.PRECONDITION, _NOT_RECORDED, reason)


class _Rerun:
    """A run under way."""

    def __init__(self, trace: Trace, made: Compiled, nobody: _Nobody) -> None:
        self.trace, self.made, self.nobody = trace, made, nobody
        self.names = Names(trace.system)
        self.observer = Observer(trace.system, made.names)
        self.host = Rehearsal(trace, made.names, nobody)
        system = trace.system
        self.fleet = Fleet(made.classes, system.kinds, float(system.delta_s), self.host)
        self.last: Configuration[Constant] | None = None  #: where the run ended, on doubles

    def run(self) -> None:
        recording = self.trace.recording
        schedule = Rehearsed(recording.rounds, recording.opening.order)
        self.fleet.begin(recording.opening.order)
        self.compare(BEFORE_ROUNDS)
        for number, round_ in enumerate(recording.rounds):
            if self.fleet.ended is not None:
                break  # in the fault that was recorded, or compare() would have said so
            self.host.round = self.nobody.round = number
            decision = self.fleet.program_turns(schedule)
            if decision.fault is None:  # compare() looks at faults
                self.check_turns(number, round_, decision)
            if round_.cut:
                self.compare(number, inside=round_)
                break
            if self.fleet.ended is None:
                self.fleet.environment_turn()
            self.compare(number)
        self.check_outputs()

    def check_turns(self, number: int, round_: Round, decision: Decision) -> None:
        """Whoever ran what was recorded: a guard may be false where floats are rounded."""
        _, events = schedule_of(decision, self.trace.system.robots)
        for robot in round_.order:
            recorded, ran = round_.events[robot], events[robot]
            if recorded != ran:
                of_kind = self.names.of(robot).events
                was = "skips" if recorded is None else f"runs {of_kind[recorded]}"
                reason = f"robot {robot} {was} in the recording, and " + (
                    "cannot here" if ran is None else f"runs {of_kind[ran]} here"
                )
                raise _DepartedError(Departure(number, reason))

    def check_outputs(self) -> None:
        """What was written to streams, in the same order."""
        made, recorded = tuple(self.made.emitted(self.fleet.shown)), self.trace.outputs
        for one, other in zip_longest(made, recorded):
            if one is None or other is None or not self._is_same_output(one, other):
                wrote, was = ("nothing" if e is None else quoted(e) for e in (one, other))
                number = min(e.round for e in (one, other) if e is not None)
                reason = f"it writes {wrote}; recorded is {was}"
                raise _DepartedError(Departure(number, reason))

    def _is_same_output(self, made: Emitted, recorded: Emitted) -> bool:
        if self.trace.numbers is Numbers.EXACT:
            values = _values(recorded.written.values, made.written.values)
            made = replace(made, written=replace(made.written, values=values))
        return same_output(made, recorded)

    def compare(self, number: int, inside: Round | None = None) -> None:
        """Compare what came after a round, or where the run ended ``inside`` one."""
        recorded = self.trace.configurations[number + 1]
        ended = self.fleet.ended
        if ended is not None and ended.fault.place == _NOT_RECORDED:
            raise _DepartedError(Departure(number, ended.fault.detail))
        found = self.observer.configuration(self.fleet)
        if ended is not None:
            found = replace(found, fault=_fault(ended))
        elif inside is not None:
            robots = _states(found.robots, recorded.robots)
            self.last = replace(recorded, robots=robots, store=found.store)
            found = _within(found, recorded, inside.order)
        if inside is None:
            self.last = found
        if self.trace.numbers is Numbers.EXACT:
            found = _unrounded(recorded, found)
        told = tuple(islice(differences(self.names, recorded, found), _MOST_TOLD))
        if told:
            raise _DepartedError(Departure(number, "it comes to another configuration", told))

    def kept(self) -> Departure | None:
        """Whether a property that exact numbers break holds of the program's own numbers."""
        trace, violation, last = self.trace, self.trace.violation, self.last
        ends = violation is not None and trace.recording.loop is None
        if not ends or trace.numbers is not Numbers.EXACT or last is None:
            return None
        assert violation is not None
        stated = [p for p in trace.system.program.properties if p.name == violation.name]
        if violation.kind is not ViolationKind.PROPERTY or not stated:
            return None
        recording = trace.recording
        answers = recording.rounds[-1].answers if recording.rounds else recording.opening.answers
        inputs = RecordedInputs(answers=answers)
        try:
            holds, _ = holds_in(
                DOUBLES, trace.system, last, stated[0].condition, stated[0].bound, inputs
            )
        except IllegalStepError:
            return None  # it asks a function about rounded numbers, of which nobody knows
        if holds is not True:
            return None
        told = changes(self.names, _as_doubles(trace.configurations[-1]), last)
        reason = f"on doubles, {violation.name} holds there"
        return Departure(violation.round, reason, tuple(islice(told, _MOST_TOLD)))


def _states(
    found: Iterable[RobotState[Constant]], recorded: Iterable[RobotState[Constant]]
) -> tuple[RobotState[Constant], ...]:
    """Robots inside a round: what they hold as was found, what they are at as was recorded."""
    return tuple(
        replace(a, status=b.status, ran=b.ran, turn=b.turn)
        for a, b in zip(found, recorded, strict=True)
    )


def _fault(ended: Ended) -> Fault:
    """The fault in the semantics' words; its place is not compared."""
    return Fault(FaultName(ended.fault.kind.value), ended.robot, NOWHERE, ended.fault.detail)


def _within(
    found: Configuration[Constant], recorded: Configuration[Constant], order: Iterable[int]
) -> Configuration[Constant]:
    """The recorded configuration with all that a runtime knows inside a round."""
    robots = list(recorded.robots)
    for robot in order:
        seen = found.robots[robot]
        robots[robot] = replace(robots[robot], locals=seen.locals, ports=seen.ports)
    return replace(recorded, robots=tuple(robots), store=found.store, fault=None)


# --- floats, as doubles -------------------------------------------------------------------------


def _as_doubles(recorded: Configuration[Constant]) -> Configuration[Constant]:
    """The nearest doubles for exact numbers that are none."""

    def all_of(storages: tuple[Storage[Constant], ...]) -> tuple[Storage[Constant], ...]:
        return tuple(map(storage, storages))

    def storage(one: Storage[Constant]) -> Storage[Constant]:
        if isinstance(one, Tree):
            return Tree(all_of(one.parts))
        return Cell(one.is_set, value(one.value))

    def value(one: Value[Constant]) -> Value[Constant]:
        match one:
            case Fraction():
                return float(one)
            case Rec(fields=fields):
                return Rec(tuple(map(value, fields)))
            case Seq(length=length, items=items):
                return Seq(length, tuple(map(value, items)))
            case Table(length=length, entries=entries):
                return Table(length, tuple((value(k), value(v)) for k, v in entries))
            case _:
                return one

    def store(one: Store[Constant]) -> Store[Constant]:
        return Store(all_of(one.allread), all_of(one.allwrite))

    robots = tuple(
        replace(r, locals=all_of(r.locals), ports=all_of(r.ports), copy=store(r.copy))
        for r in recorded.robots
    )
    return replace(recorded, robots=robots, store=store(recorded.store))


# --- floats, up to rounding ---------------------------------------------------------------------


def _unrounded(
    recorded: Configuration[Constant], found: Configuration[Constant]
) -> Configuration[Constant]:
    """What was found, with the recorded numbers for floats that are so up to rounding."""

    def robot(a: RobotState[Constant], b: RobotState[Constant]) -> RobotState[Constant]:
        locals_, ports = _all(a.locals, b.locals), _all(a.ports, b.ports)
        return replace(b, locals=locals_, ports=ports, copy=_store(a.copy, b.copy))

    return replace(
        found,
        robots=tuple(map(robot, recorded.robots, found.robots)),
        store=_store(recorded.store, found.store),
    )


def _store(recorded: Store[Constant], found: Store[Constant]) -> Store[Constant]:
    return Store(_all(recorded.allread, found.allread), _all(recorded.allwrite, found.allwrite))


def _all(
    recorded: tuple[Storage[Constant], ...], found: tuple[Storage[Constant], ...]
) -> tuple[Storage[Constant], ...]:
    return tuple(map(_storage, recorded, found))


def _storage(recorded: Storage[Constant], found: Storage[Constant]) -> Storage[Constant]:
    match recorded, found:
        case Tree(parts=a), Tree(parts=b):
            return Tree(_all(a, b))
        case Cell(is_set=True, value=a), Cell(is_set=True, value=b):
            return Cell(True, _value(a, b))
        case _:
            return found


def _values(
    recorded: tuple[Value[Constant], ...], found: tuple[Value[Constant], ...]
) -> tuple[Value[Constant], ...]:
    """Item by item; what one has more than the other is the found one's."""
    return (*map(_value, recorded, found), *found[len(recorded) :])


def _value(recorded: Value[Constant], found: Value[Constant]) -> Value[Constant]:
    match recorded, found:
        case Fraction(), float():
            near = math.isclose(recorded, found, rel_tol=ROUNDING, abs_tol=ROUNDING)
            return recorded if near else found
        case Rec(fields=a), Rec(fields=b):
            return Rec(_values(a, b))
        case Seq(items=a), Seq(items=b) if len(a) == len(b):
            return Seq(len(b), _values(a, b))
        case Table(entries=a), Table(entries=b) if len(a) == len(b):
            pairs = zip(a, b, strict=True)
            return Table(len(b), tuple((_value(k, m), _value(v, w)) for (k, v), (m, w) in pairs))
        case _:
            return found
