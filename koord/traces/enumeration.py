"""Exhaustive enumeration of a robot's turns, over all inputs that they may receive.

A turn is run again and again; each time it asks for something that is left open, the next untried
value is given. The answers are noted, so that each outcome comes with what a recording needs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import islice
from typing import Generic, TypeVar

from msgspec import Struct, field

from koord.semantics.domain import EXACT, Constant
from koord.semantics.expressions import evaluate, statement
from koord.semantics.machine import Machine
from koord.semantics.oracle import Key, NoOracle, Oracle, Phase
from koord.semantics.recordings import Answer, Concrete, Reading, Start
from koord.semantics.statements import machine
from koord.semantics.storage import Cell, Storage
from koord.semantics.values import Rec, Seq, Table
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.system import System
from koord.syntax.types import INT, Type
from koord.traces.value_bounds import Found, Location, StatementReader, candidates

T = TypeVar("T")

#: Of so many values one at a time can be tried.
_MOST_OPTIONS = 100_000


class UnboundedError(Exception):
    """Raised where an input has too many values to enumerate."""


class _DeadEndError(Exception):
    """Raised where an input has no possible value."""


class Chooser(Struct):
    """A depth-first walk through a tree of choices."""

    _path: list[tuple[int, int]] = field(default_factory=list)
    _depth: int = 0

    def pick(self, options: Iterable[T]) -> T:
        """Return the option of the present path at the next choice."""
        choices = list(islice(options, _MOST_OPTIONS + 1))
        if len(choices) > _MOST_OPTIONS:
            raise UnboundedError(
                f"something that is left open has more than {_MOST_OPTIONS} values"
            )
        if not choices:
            raise _DeadEndError
        if self._depth == len(self._path):
            self._path.append((0, len(choices)))
        position, _ = self._path[self._depth]
        self._depth += 1
        return choices[position]

    def restart(self) -> bool:
        """Advance to the next path; return whether there is one."""
        del self._path[self._depth :]
        while self._path and self._path[-1][0] + 1 == self._path[-1][1]:
            self._path.pop()
        if not self._path:
            return False
        position, count = self._path[-1]
        self._path[-1] = (position + 1, count)
        self._depth = 0
        return True


class Given(Struct, frozen=True):
    """The inputs that led to one outcome of a turn: starts, readings and answers."""

    starts: tuple[Start, ...] = ()
    readings: tuple[Reading, ...] = ()
    answers: tuple[Answer, ...] = ()


class Explored(Struct, Generic[T], frozen=True):
    """One outcome of a turn, with the inputs that led to it."""

    outcome: T
    given: Given


def explored(
    inputs: Callable[[Chooser], ExploringInputs], turn: Callable[[ExploringInputs], T]
) -> Iterator[Explored[T]]:
    """Yield every outcome of a turn."""
    chooser, more = Chooser(), True
    while more:
        asked = inputs(chooser)
        try:
            outcome = turn(asked)
        except _DeadEndError:
            pass
        else:
            yield Explored(outcome, asked.given())
        more = chooser.restart()


class ExploringInputs(Struct):
    """Inputs of one step that enumerate all values. ``ports`` are the robot's before the step.

    ``starting`` says what the assumptions say about arbitrary starts.
    """

    system: System
    chooser: Chooser
    starting: Found = field(default_factory=dict)
    ports: tuple[Storage[Constant], ...] = ()
    _starts: dict[tuple[Home, int, int | None], Start] = field(default_factory=dict)
    _readings: dict[tuple[int, int], Reading] = field(default_factory=dict)
    _answers: dict[tuple[Phase, int, Key], Answer] = field(default_factory=dict)

    def given(self) -> Given:
        return Given(
            tuple(self._starts.values()),
            tuple(self._readings.values()),
            tuple(self._answers.values()),
        )

    def start(self, declaration: core.Declaration, robot: int | None) -> Concrete:
        variable = declaration.variable
        where = (variable.home, variable.slot, robot)
        type_ = variable.own_type
        found = candidates(type_, where, self.starting, self.system.robots, declaration.length)
        self._starts[where] = Start(*where, self._pick(found, variable.name))
        return self._starts[where].value

    def sensor(self, robot: int, port: core.Port) -> Concrete:
        variable = port.declaration.variable
        found = candidates(
            variable.type, (variable.slot,), self._promised(robot, port), self.system.robots
        )
        reading = Reading(robot, variable.slot, self._pick(found, variable.name))
        self._readings[robot, variable.slot] = reading
        return reading.value

    def oracle(self, phase: Phase, robot: int) -> Oracle[Constant]:
        return _ExploringOracle(self, phase, robot)

    def answer(
        self,
        where: tuple[Phase, int, Key],
        function: core.External | None,
        arguments: tuple[Concrete, ...],
        values: Callable[[], Iterator[Concrete] | None],
    ) -> Concrete:
        """The answer to a query: the same one whenever it is asked in this turn."""
        noted = self._answers.get(where)
        if noted is None:
            name = function.name if function is not None else "choose"
            value = self._pick(values(), name)
            asked = function.name if function is not None else None
            noted = Answer(*where, asked, arguments, value)
            self._answers[where] = noted
        return noted.value

    def _pick(self, values: Iterator[Concrete] | None, name: str) -> Concrete:
        if values is None:
            raise UnboundedError(f"{name} may have any number of values")
        return self.chooser.pick(values)

    def _promised(self, robot: int, port: core.Port) -> Found:
        """The restrictions that contracts of a port's module put on sensors after the turn."""
        agent = self.system.agent(robot)
        module = next(m for m in agent.modules if m.name == port.module)
        m: Machine[Constant] = machine(
            EXACT, self.system, NoOracle(), robot=robot, ports=self.ports
        )
        ensured: list[core.Expr] = []
        for contract in module.contracts:
            m.memory.bound = [None] * contract.bound
            if all(statement(m, e) is True for e in contract.requires):
                ensured += contract.ensures
        return sensors_reader(m).restrictions(ensured)


class _ExploringOracle(Struct):
    """The oracle of one turn that enumerates all answers."""

    inputs: ExploringInputs
    phase: Phase
    robot: int

    def choose(self, key: Key, low: Constant, high: Constant, type_: Type) -> Constant:
        def values() -> Iterator[Concrete] | None:
            if type_ != INT:
                return iter([low]) if low == high else None
            assert isinstance(low, int)
            assert isinstance(high, int)
            # Of an empty range nothing can be chosen: that is a fault, and any answer will do.
            return iter(range(low, max(low, high) + 1))

        value = self.inputs.answer((self.phase, self.robot, key), None, (), values)
        assert not isinstance(value, Rec | Seq | Table)
        return value

    def external(
        self, function: core.External, key: Key, arguments: tuple[Concrete, ...]
    ) -> Concrete:
        def values() -> Iterator[Concrete] | None:
            system = self.inputs.system
            result = function.result
            m: Machine[Constant] = machine(EXACT, system, NoOracle(), bound=function.bound)
            m.memory.bound[: len(arguments)] = [Cell(True, value) for value in arguments]
            found = result_reader(m, result).restrictions(function.ensures)
            return candidates(result.type, (), found, system.robots)

        return self.inputs.answer((self.phase, self.robot, key), function, arguments, values)

    def every(self, type_: Type, body: Callable[[Concrete], Constant]) -> Constant:
        values = candidates(type_, (), {}, self.inputs.system.robots)
        if values is None:
            raise UnboundedError("a summary speaks of every value of a type")
        return all(body(value) is True for value in values)

    def vouches_for(self, function: core.External) -> bool:
        return False


# --- reading statements ---------------------------------------------------------------------------


def reader(
    m: Machine[Constant],
    is_open: Callable[[core.Place], bool],
    address: Callable[[core.Variable, int | None], Location],
) -> StatementReader:
    """A reader of statements in which ``m`` knows everything that is not open."""

    def value_of(e: core.Expr, bound: Mapping[int, int]) -> Constant | None:
        before, faults = m.memory.bound, m.faults
        m.memory.bound = [*before, *[None] * (1 + max(bound, default=0))]
        for slot, number in bound.items():
            m.memory.bound[slot] = Cell(True, number)
        m.faults = []
        value = evaluate(m, e)
        faulted = bool(m.faults)
        m.memory.bound, m.faults = before, faults
        return None if faulted or isinstance(value, Rec | Seq | Table) else value

    return StatementReader(m.system.kinds, is_open, address, value_of)


def starts_reader(system: System) -> StatementReader:
    """A reader of assumptions: open are all variables of the configuration after INIT."""

    def address(variable: core.Variable, robot: int | None) -> Location:
        # The first index of an allread variable says whose entry it is.
        where = (variable.home, variable.slot)
        return where if variable.home is Home.ALLREAD else (*where, robot)

    m: Machine[Constant] = machine(EXACT, system, NoOracle())
    return reader(m, lambda place: place.variable.home is not Home.BOUND, address)


def sensors_reader(m: Machine[Constant]) -> StatementReader:
    """A reader of contracts' ``ensures``: open are the ports after the turn."""
    return reader(m, lambda place: place.primed, lambda variable, _: (variable.slot,))


def result_reader(m: Machine[Constant], result: core.Variable) -> StatementReader:
    """A reader of an external function's ``ensures``: open is the answer."""

    def is_open(place: core.Place) -> bool:
        return place.variable.home is Home.BOUND and place.variable.slot == result.slot

    return reader(m, is_open, lambda _variable, _robot: ())
