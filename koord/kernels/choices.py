"""What a turn leaves open, as choices that the caller of a kernel makes. [CHOOSE] [EXTERNAL]
[ENV-FREE]

Each input has a number of candidates; the kernel says whether those chosen are legal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from typing import Any

from msgspec import Struct, field

from koord.kernels.terms import NoKernelError, Scalar, TermDomain
from koord.semantics.domain import EXACT, Constant
from koord.semantics.machine import Machine
from koord.semantics.oracle import Key, NoOracle, Oracle, Phase
from koord.semantics.recordings import Concrete
from koord.semantics.statements import machine
from koord.semantics.values import Rec, Seq, Table, Value
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home
from koord.syntax.system import System
from koord.syntax.types import BOOL, INT, Type
from koord.syntax.walk import nodes
from koord.traces.enumeration import result_reader, sensors_reader
from koord.traces.value_bounds import StatementReader, candidates

#: An input with more candidates is left to Python.
_MOST_CANDIDATES = 4_096


class ChoiceInputs(Struct):
    """The inputs of one turn. ``counts`` are the numbers of candidates, by choice."""

    domain: TermDomain
    system: System
    counts: list[int] = field(default_factory=list)
    _answers: dict[tuple[Phase, int, Key], Value[Scalar]] = field(default_factory=dict)

    def start(self, declaration: core.Declaration, robot: int | None) -> Value[Scalar]:
        raise NoKernelError("starts are enumerated before")

    def sensor(self, robot: int, port: core.Port) -> Value[Scalar]:
        agent = self.system.agent(robot)
        module = next(m for m in agent.modules if m.name == port.module)
        m: Machine[Constant] = machine(EXACT, self.system, NoOracle(), robot=robot)
        ensured = [e for c in module.contracts if _is_free(c) for e in c.ensures]
        found = _closed(sensors_reader(m)).restrictions(ensured)
        variable = port.declaration.variable
        known = candidates(variable.type, (variable.slot,), found, self.system.robots)
        return self.pick(known, f"{port.module}.{variable.name}")

    def oracle(self, phase: Phase, robot: int) -> Oracle[Scalar]:
        return _ChoiceOracle(self, phase, robot)

    def answer(
        self, where: tuple[Phase, int, Key], made: Callable[[], Value[Scalar]]
    ) -> Value[Scalar]:
        """The answer to a query: the same one whenever it is asked in this turn."""
        if where not in self._answers:
            self._answers[where] = made()
        return self._answers[where]

    def pick(self, values: Iterator[Concrete] | None, name: str) -> Value[Scalar]:
        """One of some values, whichever the caller chooses."""
        if values is None:
            raise NoKernelError(f"{name} may have any number of values")
        options = list(islice(values, _MOST_CANDIDATES + 1))
        if not options or len(options) > _MOST_CANDIDATES:
            raise NoKernelError(f"{name} has {len(options) or 'no'} values to choose from")
        if len(options) == 1:
            return _scalars(options[0])
        chosen = self.domain.choice(len(self.counts), len(options))
        self.counts.append(len(options))
        return self._selected(chosen, options)

    def _selected(self, chosen: Scalar, options: list[Any]) -> Value[Scalar]:
        first = options[0]
        if isinstance(first, Rec):
            columns = zip(*(option.fields for option in options), strict=True)
            return Rec(tuple(self._selected(chosen, list(column)) for column in columns))
        if isinstance(first, Seq | Table):
            raise NoKernelError("a list or a map is left open")
        d = self.domain
        if not isinstance(first, bool) and options == list(range(first, first + len(options))):
            return d.binary(BinaryOp.ADD, chosen, first) if first else chosen
        value: Scalar = first
        for position, option in enumerate(options[1:], 1):
            value = d.ite(d.binary(BinaryOp.EQ, chosen, position), option, value)
        return value


class _ChoiceOracle(Struct):
    """The oracle of one turn that lets the caller choose."""

    inputs: ChoiceInputs
    phase: Phase
    robot: int

    def choose(self, key: Key, low: Scalar, high: Scalar, type_: Type) -> Scalar:
        if type_ != INT or not isinstance(low, int) or not isinstance(high, int):
            raise NoKernelError("choose has bounds that are computed")

        def made() -> Value[Scalar]:
            return self.inputs.pick(iter(range(low, max(low, high) + 1)), "choose")

        value = self.inputs.answer((self.phase, self.robot, key), made)
        assert not isinstance(value, Rec | Seq | Table)
        return value

    def external(
        self, function: core.External, key: Key, arguments: tuple[Value[Scalar], ...]
    ) -> Value[Scalar]:
        if function.kind is core.ExternalKind.FUNCTION:
            raise NoKernelError(f"{function.name} is a mathematical function")

        def made() -> Value[Scalar]:
            system = self.inputs.system
            m: Machine[Constant] = machine(EXACT, system, NoOracle(), bound=function.bound)
            found = _closed(result_reader(m, function.result)).restrictions(function.ensures)
            known = candidates(function.result.type, (), found, system.robots)
            return self.inputs.pick(known, function.name)

        return self.inputs.answer((self.phase, self.robot, key), made)

    def every(self, type_: Type, body: Callable[[Value[Scalar]], Scalar]) -> Scalar:
        values = candidates(type_, (), {}, self.inputs.system.robots)
        if values is None:
            raise NoKernelError("a summary speaks of every value of a type")
        d, holds = self.inputs.domain, self.inputs.domain.const(True, BOOL)
        for value in values:
            holds = d.binary(BinaryOp.AND, holds, body(_scalars(value)))
        return holds

    def vouches_for(self, function: core.External) -> bool:
        return False


def _scalars(value: Any) -> Value[Scalar]:
    """A value of constants as one of the domain of terms, of which constants are a part."""
    return value  # type: ignore[no-any-return]


def _is_free(contract: core.Contract) -> bool:
    return all(isinstance(e, core.Const) and e.value is True for e in contract.requires)


def _closed(reader: StatementReader) -> StatementReader:
    """A reader of statements that knows only what the text says by itself."""

    def value(e: core.Expr, bound: Mapping[int, int]) -> Constant | None:
        for node in nodes(e):
            if isinstance(node, core.Place) and not (
                node.variable.home is Home.BOUND and node.variable.slot in bound
            ):
                return None
        return reader.evaluate(e, bound)

    return StatementReader(reader.kinds, reader.is_open, reader.address, value)
