"""Replay of recorded runs by compiled programs, configuration by configuration. [RERUN]

What the reference semantics says of a run is worth something on the road only if the program that
drives there does the same. So a counterexample is given to the compiled program as well: the same
order, the same events, the same readings and answers.

Recordings in exact numbers are given as the nearest doubles, and floats that come out are the same
if they are so up to rounding. Inside a round, where a run that breaks a claim may end, a runtime
has no configuration: there the store counts, and what those have of their own who had a turn.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import islice, zip_longest
from typing import Any, TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from koord.refinement.replaying_host import RecordedSchedule, ReplayingHost
from koord.refinement.rounding import (
    Mended,
    Passed,
    Unjudged,
    as_doubles,
    judged,
    unrounded,
    unrounded_values,
)
from koord.refinement.running import Compiled, ready, schedule_of
from koord.refinement.translation import to_fault
from koord.runtime.compile import NumberTooLargeError
from koord.runtime.engine import RoundEngine
from koord.runtime.operations import FaultError
from koord.runtime.proposals import Decision
from koord.runtime.robot import Key, Robot, Turn
from koord.semantics.configurations import Configuration
from koord.semantics.configurations import Robot as RobotState
from koord.semantics.domain import Constant
from koord.semantics.recordings import Round
from koord.syntax.budget import ENDLESS, Budget, OutOfBudgetError
from koord.syntax.faults import FaultKind
from koord.syntax.types import FLOAT
from koord.syntax.walk import nodes
from koord.traces.changes import Change, changes, differences
from koord.traces.names import Names
from koord.traces.replay import quoted, same_output
from koord.traces.trace import BEFORE_ROUNDS, Emitted, Numbers, Trace

#: So many locations that differ are told.
_MOST_TOLD = 20

#: What is told besides, where that may be why a program departs.
_ROUNDED = "; it computes with doubles, and the recording is of exact numbers"


_TOO_LARGE = "a number is larger than any double"


class Departure(Struct, frozen=True):
    """The first difference of a compiled program from a run. ``round`` is -1 for INIT.

    ``changes`` has what the recording says as ``old``, and what the program did as ``new``.
    """

    round: int
    reason: str
    changes: tuple[Change, ...] = ()


#: What a compiled program makes of a run: None if it does the same, state for state.
Rerun: TypeAlias = "Departure | Unjudged | None"


def rerun(trace: Trace, made: Compiled | None = None, budget: Budget = ENDLESS) -> Rerun:
    """Replay a run: its first difference, or the violation that rounding mends; None if neither.

    Raises OutOfBudgetError, between two rounds.
    """
    nobody = _Nobody()
    try:
        made = ready(trace.system.program) if made is None else made
    except NumberTooLargeError:
        return Departure(nobody.round, _TOO_LARGE)
    running = _Rerun(trace, made, nobody)
    try:
        running.run(budget)
    except _DepartedError as error:
        found = error.departure
        return replace(found, reason=found.reason + _ROUNDED) if _rounds(trace) else found
    except OverflowError:
        return Departure(nobody.round, _TOO_LARGE)
    return running.judged() if _rounds(trace) else None


def _rounds(trace: Trace) -> bool:
    """Return whether a program may differ only because its floats are doubles."""
    types = (getattr(node, "type", None) for node in nodes(trace.system.program))
    return trace.numbers is Numbers.EXACT and FLOAT in types


class _DepartedError(Exception):
    """Raised with the difference, to end the replay."""

    def __init__(self, departure: Departure) -> None:
        super().__init__(departure.reason)
        self.departure = departure


class _Nobody:
    """A host for queries that were not recorded.

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
    """A replay in progress."""

    def __init__(self, trace: Trace, made: Compiled, nobody: _Nobody) -> None:
        self.trace, self.made, self.nobody = trace, made, nobody
        self.names = Names(trace.system)
        self.host = ReplayingHost(trace, made.names, nobody)
        self.translation = self.host.translation
        system = trace.system
        self.fleet = RoundEngine(made.classes, system.kinds, float(system.delta_s), self.host)
        self.passed = Passed()

    def run(self, budget: Budget) -> None:
        recording = self.trace.recording
        schedule = RecordedSchedule(recording.rounds, recording.opening.order)
        self.fleet.begin(recording.opening.order)
        self.compare(BEFORE_ROUNDS)
        for number, round_ in enumerate(recording.rounds):
            if budget.is_over():
                raise OutOfBudgetError
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
                if number + 1 == len(recording.rounds):
                    self.passed.turned = self.translation.configuration(self.fleet)
                self.fleet.environment_turn()
            self.compare(number)
        self.check_outputs()

    def check_turns(self, number: int, round_: Round, decision: Decision) -> None:
        """Check that the recorded events ran: guards may be false where floats are rounded."""
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
        """Check that the same output was written to streams, in the same order."""
        made, recorded = tuple(self.made.emitted(self.fleet.shown)), self.trace.outputs
        for one, other in zip_longest(made, recorded):
            if one is None or other is None or not self._is_same_output(one, other):
                wrote, was = ("nothing" if e is None else quoted(e) for e in (one, other))
                number = min(e.round for e in (one, other) if e is not None)
                reason = f"it writes {wrote}; recorded is {was}"
                raise _DepartedError(Departure(number, reason))

    def _is_same_output(self, made: Emitted, recorded: Emitted) -> bool:
        if self.trace.numbers is Numbers.EXACT:
            values = unrounded_values(recorded.written.values, made.written.values)
            made = replace(made, written=replace(made.written, values=values))
        return same_output(made, recorded)

    def compare(self, number: int, inside: Round | None = None) -> None:
        """Compare the configuration after a round, or at the end of a run ``inside`` one."""
        recorded = self.trace.configurations[number + 1]
        ended = self.fleet.ended
        if ended is not None and ended.fault.place == _NOT_RECORDED:
            raise _DepartedError(Departure(number, ended.fault.detail))
        found = self.translation.configuration(self.fleet)
        if ended is not None:
            found = replace(found, fault=to_fault(ended.fault, ended.robot))
        elif inside is not None:
            robots = _states(found.robots, recorded.robots)
            self.passed.last = replace(recorded, robots=robots, store=found.store)
            found = _within(found, recorded, inside.order)
        if inside is None:
            self.passed.last = found
            self.passed.ends.append(found)
        if self.trace.numbers is Numbers.EXACT:
            found = unrounded(recorded, found)
        told = tuple(islice(differences(self.names, recorded, found), _MOST_TOLD))
        if told:
            raise _DepartedError(Departure(number, "it comes to another configuration", told))

    def judged(self) -> Departure | Unjudged | None:
        """Judge the violation of the exact run on the program's own numbers."""
        found = judged(self.trace, self.passed)
        if not isinstance(found, Mended):
            return found
        trace, last = self.trace, self.passed.last
        assert last is not None  # it came to the end of the run
        told = changes(self.names, as_doubles(trace.configurations[-1]), last)
        number = len(trace.recording.rounds) - 1
        return Departure(number, found.reason, tuple(islice(told, _MOST_TOLD)))


def _states(
    found: Iterable[RobotState[Constant]], recorded: Iterable[RobotState[Constant]]
) -> tuple[RobotState[Constant], ...]:
    """Robots inside a round: their own variables as found, their events as recorded."""
    return tuple(
        replace(a, status=b.status, ran=b.ran, turn=b.turn)
        for a, b in zip(found, recorded, strict=True)
    )


def _within(
    found: Configuration[Constant], recorded: Configuration[Constant], order: Iterable[int]
) -> Configuration[Constant]:
    """The recorded configuration reduced to what a runtime knows inside a round."""
    robots = list(recorded.robots)
    for robot in order:
        seen = found.robots[robot]
        robots[robot] = replace(robots[robot], locals=seen.locals, ports=seen.ports)
    return replace(recorded, robots=tuple(robots), store=found.store, fault=None)
