"""Recorded runs, run again by compiled programs: a host and a schedule that do as was recorded.

What the run left open comes from the recording, exact numbers as the nearest doubles. What nobody
recorded is asked of another host.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import Any

from msgspec import Struct, field

from koord.refinement.sampling_host import starting
from koord.refinement.value_translation import to_plain, to_value
from koord.runtime.compile.naming import Names
from koord.runtime.motion.world import Point
from koord.runtime.proposals import Proposal
from koord.runtime.robot import Host, Key, Robot, Turn
from koord.semantics.oracle import Phase
from koord.semantics.recordings import Concrete, Round
from koord.semantics.storage import contents
from koord.semantics.values import Rec
from koord.syntax import core
from koord.syntax.core import Direction, ExternalKind, Home
from koord.syntax.types import ArrayType, FloatType, MapType, RecordType, SequenceType, Type
from koord.traces.trace import Trace

_PHASES = {Turn.INIT: Phase.INIT, Turn.PROG: Phase.PROG, Turn.ENV: Phase.ENV}


def as_given(value: Concrete, type_: Type) -> Any:
    """A recorded value as a host gives it to a robot, floats as doubles."""
    return _doubles(to_plain(value), type_)


def _doubles(value: Any, type_: Type) -> Any:
    match type_:
        case FloatType():
            return float(value)
        case RecordType(fields=fields):
            pairs = zip(value, fields, strict=True)
            return tuple(_doubles(part, of) for part, (_, of) in pairs)
        case SequenceType(element=element):
            return tuple(_doubles(item, element) for item in value)
        case MapType(key=key, value=held):
            return tuple((_doubles(k, key), _doubles(v, held)) for k, v in value)
        case _:
            return value


class Rehearsal:
    """The host of a run that was recorded; ``round`` is the one that is open."""

    def __init__(self, trace: Trace, names: Names, other: Host) -> None:
        self.trace, self.names, self.other = trace, names, other
        self.round = 0
        program, opening = trace.system.program, trace.recording.opening
        self._starts = {(s.home, s.slot, s.robot): s.value for s in opening.starts}
        self._declared = dict(starting(program, names))
        self._kinds = {function.name: function for function in program.externals}
        self._said: dict[tuple[str, tuple[Any, ...]], Any] = {}
        #: By round, -1 for INIT.
        self._answers: dict[int, dict[tuple[Phase, int, Key], Any]] = {}
        rounds = trace.recording.rounds
        answers = (opening.answers, *(round_.answers for round_ in rounds))
        for number, given_then in enumerate(answers, start=-1):
            known: dict[tuple[Phase, int, Key], Any] = {}
            self._answers[number] = known
            for answer in given_then:
                where = (answer.phase, answer.robot, answer.key)
                function = self._kinds.get(answer.function or "")
                if function is None:
                    value = answer.value
                    known[where] = float(value) if isinstance(value, Fraction) else value
                    continue
                given = as_given(answer.value, function.result.type)
                known[where] = given
                if function.kind is ExternalKind.FUNCTION:
                    self._said[function.name, self._question(function, answer.arguments)] = given

    def start(self, robot: int | None, name: str) -> Any:
        kind = None if robot is None else self.trace.system.kinds[robot]
        variable = self._declared[kind, name].variable
        found = self._starts.get((variable.home, variable.slot, robot))
        if found is None:
            return self.other.start(robot, name)
        type_ = variable.type
        if variable.home is Home.ALLREAD:
            assert isinstance(type_, ArrayType)
            type_ = type_.element
        return as_given(found, type_)

    def read(self, robot: Robot) -> Mapping[str, Any]:
        rounds, kind = self.trace.recording.rounds, self.trace.system.kinds[robot.pid]
        if self.round >= len(rounds):
            return {}
        agent = self.trace.system.agent(robot.pid)
        types = {p.declaration.variable.slot: p.declaration.variable for p in agent.ports}
        return {
            self.names.attribute(types[reading.slot], kind): as_given(
                reading.value, types[reading.slot].type
            )
            for reading in rounds[self.round].readings
            if reading.robot == robot.pid
        }

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        pairs = zip(arguments, self._kinds[function].parameters, strict=True)
        question = function, tuple(to_plain(to_value(given, p.type)) for given, p in pairs)
        if question in self._said:
            return self._said[question]
        number = -1 if turn is Turn.INIT else self.round
        where = (_PHASES[turn], robot, key)
        if where in self._answers.get(number, {}):
            return self._answers[number][where]
        return self.other.ask(turn, robot, key, function, arguments)

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        number = -1 if turn is Turn.INIT else self.round
        where = (_PHASES[turn], robot, key)
        if where in self._answers.get(number, {}):
            return self._answers[number][where]
        return self.other.choose(turn, robot, key, low, high)

    def _question(
        self, function: core.External, arguments: tuple[Concrete, ...]
    ) -> tuple[Any, ...]:
        pairs = zip(arguments, function.parameters, strict=True)
        return tuple(as_given(value, parameter.type) for value, parameter in pairs)


class Rehearsed(Struct):
    """The schedule of a run that was recorded."""

    rounds: tuple[Round, ...]
    first: tuple[int, ...]
    open: int = field(default=0)

    def order(self, round_: int, robots: int) -> tuple[int, ...]:
        """Those who had no turn any more in a round that was cut have none."""
        self.open = round_
        return self.first if round_ < 0 else self.rounds[round_].order

    def events(self, robot: Robot) -> Iterable[int] | None:
        event = self._event(robot.pid)
        return () if event is None else (event,)

    def willing(self, robot: Robot) -> bool:
        return self._event(robot.pid) is not None

    def hears(self, proposal: Proposal) -> bool:
        return True

    def _event(self, robot: int) -> int | None:
        """Who had no turn any more in a round that was cut ran nothing."""
        round_ = self.rounds[self.open]
        return round_.events[robot] if robot in round_.order else None


def places(trace: Trace) -> list[list[Point]]:
    """Where robots are before each round, and at the end. Those that have no place form a row."""
    return [
        [_place(trace, number, robot) for robot in range(trace.system.robots)]
        for number in range(len(trace.configurations))
    ]


def _place(trace: Trace, number: int, robot: int) -> Point:
    agent = trace.system.agent(robot)
    for port in agent.ports:
        variable = port.declaration.variable
        if port.direction is not Direction.SENSOR or variable.name not in ("psn", "position"):
            continue
        storage = trace.configurations[number].robots[robot].ports[variable.slot]
        value, is_set = contents(trace.numbers.domain, storage, variable.type)
        if not is_set:
            continue
        parts = [float(c) for c in value.fields] if isinstance(value, Rec) else [_number(value)]  # type: ignore[arg-type]
        x, y, z = (*parts, 0.0, 0.0)[:3]
        return x, y, z
    return 2.0 * robot, 0.0, 0.0


def _number(value: Concrete) -> float:
    assert isinstance(value, int | float | Fraction)
    return float(value)
