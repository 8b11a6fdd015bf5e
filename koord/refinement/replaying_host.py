"""Replaying hosts: a host and a schedule that repeat a recorded run for compiled programs.

What the run left open comes from the recording, exact numbers as the nearest doubles. What nobody
recorded is asked of another host.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import Any

from msgspec import Struct, field

from koord.refinement.translation import PHASES, Translation, to_plain
from koord.runtime.compile.naming import PythonNames
from koord.runtime.motion.world import Point
from koord.runtime.ports import PLACES
from koord.runtime.proposals import Proposal
from koord.runtime.robot import Host, Key, Robot, Turn
from koord.semantics.domain import Constant
from koord.semantics.oracle import Phase
from koord.semantics.recordings import Answer, Concrete, Round
from koord.semantics.storage import contents
from koord.semantics.values import Rec, map_scalars
from koord.syntax.core import Direction, ExternalKind
from koord.syntax.types import FloatType, Type
from koord.traces.trace import BEFORE_ROUNDS, Trace


def as_given(value: Concrete, type_: Type) -> Any:
    """Convert a recorded value for a robot, with floats as doubles."""
    return to_plain(map_scalars(value, type_, _double))


def _double(number: Constant, type_: Type) -> Constant:
    return float(number) if isinstance(type_, FloatType) else number


class ReplayingHost:
    """The host of a recorded run; ``round`` is the open one."""

    def __init__(self, trace: Trace, names: PythonNames, other: Host) -> None:
        self.trace, self.other = trace, other
        self.round = 0
        self.translation = Translation(trace.system, names)
        opening, rounds = trace.recording.opening, trace.recording.rounds
        self._starts = {(s.home, s.slot, s.robot): s.value for s in opening.starts}
        self._functions = {function.name: function for function in trace.system.program.externals}
        self._known: dict[tuple[str, tuple[Any, ...]], Any] = {}  #: what functions answered
        #: By round, -1 for INIT.
        self._answers: dict[tuple[int, Phase, int, Key], Any] = {}
        answers = (opening.answers, *(round_.answers for round_ in rounds))
        for number, given_then in enumerate(answers, start=BEFORE_ROUNDS):
            for answer in given_then:
                given = self._given(answer)
                self._answers[number, answer.phase, answer.robot, answer.key] = given

    def _given(self, answer: Answer) -> Any:
        function = self._functions.get(answer.function or "")
        if function is None:
            return float(answer.value) if isinstance(answer.value, Fraction) else answer.value
        given = as_given(answer.value, function.result.type)
        if function.kind is ExternalKind.FUNCTION:
            types = (parameter.type for parameter in function.parameters)
            question = tuple(map(as_given, answer.arguments, types))
            self._known[function.name, question] = given
        return given

    def start(self, robot: int | None, name: str) -> Any:
        variable = self.translation.declaration(robot, name).variable
        found = self._starts.get((variable.home, variable.slot, robot))
        if found is None:
            return self.other.start(robot, name)
        return as_given(found, variable.own_type)

    def read(self, robot: Robot) -> Mapping[str, Any]:
        rounds = self.trace.recording.rounds
        if self.round >= len(rounds):
            return {}
        readings = {r.slot: r.value for r in rounds[self.round].readings if r.robot == robot.pid}
        ports = self.translation.ports(robot.pid).items()
        variables = ((name, port.declaration.variable) for name, port in ports)
        return {n: as_given(readings[v.slot], v.type) for n, v in variables if v.slot in readings}

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        _, given = self.translation.question(function, arguments)
        question = function, tuple(map(to_plain, given))
        where = self._where(turn, robot, key)
        if question in self._known:
            return self._known[question]
        if where in self._answers:
            return self._answers[where]
        return self.other.ask(turn, robot, key, function, arguments)

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        where = self._where(turn, robot, key)
        if where in self._answers:
            return self._answers[where]
        return self.other.choose(turn, robot, key, low, high)

    def _where(self, turn: Turn, robot: int, key: Key) -> tuple[int, Phase, int, Key]:
        return BEFORE_ROUNDS if turn is Turn.INIT else self.round, PHASES[turn], robot, key


class RecordedSchedule(Struct):
    """The schedule of a recorded run."""

    rounds: tuple[Round, ...]
    first: tuple[int, ...]
    open: int = field(default=0)

    def order(self, round_: int, robots: int) -> tuple[int, ...]:
        """The order of a round; robots without a turn in a cut round are left out."""
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
        """The event of a robot; None if it had no turn in a cut round."""
        round_ = self.rounds[self.open]
        return round_.events[robot] if robot in round_.order else None


def places(trace: Trace) -> list[list[Point]]:
    """The robots' positions before each round, and at the end; robots without one form a row."""
    return [
        [_place(trace, number, robot) for robot in range(trace.system.robots)]
        for number in range(len(trace.configurations))
    ]


def _place(trace: Trace, number: int, robot: int) -> Point:
    agent = trace.system.agent(robot)
    for port in agent.ports:
        variable = port.declaration.variable
        if port.direction is not Direction.SENSOR or variable.name not in PLACES:
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
