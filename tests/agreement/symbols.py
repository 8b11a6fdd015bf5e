"""Concrete values with fresh symbols in the place of their scalars, and the way back.

Lists and maps keep a concrete shape, but their length may be a symbol too: then they have items
behind their end that must not matter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from random import Random
from typing import TypeAlias

import z3

from koord.semantics.configurations import Configuration, Robot, Store
from koord.semantics.domain import Constant
from koord.semantics.oracle import Key, Oracle, Phase
from koord.semantics.recordings import Answer, Concrete, Reading, Start
from koord.semantics.storage import Cell, Storage, Tree
from koord.semantics.values import Rec, Seq, Table, Value, default
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.system import System
from koord.syntax.types import (
    BOOL,
    INT,
    ArrayType,
    ListType,
    MapType,
    QueueType,
    RecordType,
    Type,
)
from koord.verify.encoding.terms import Term, Terms
from tests.generators.configurations import value

Symbolic: TypeAlias = "Value[Term]"


@dataclass(slots=True)
class Symbols:
    """Fresh symbols with what each stands for. ``share`` is the part of scalars that get one."""

    d: Terms
    random: Random
    robots: int
    share: float
    _meanings: list[tuple[z3.ExprRef, z3.ExprRef]] = field(default_factory=list)

    # --- there ----------------------------------------------------------------------------------

    def scalar(self, concrete: Constant, type_: Type) -> Term:
        if self.random.random() >= self.share:
            return self.d.const(concrete, type_)
        symbol = self.d.fresh("s", type_)
        self._meanings.append((symbol, self.d.lifted(concrete, symbol.sort())))
        return symbol

    def value(self, concrete: Concrete, type_: Type) -> Symbolic:
        match concrete, type_:
            case Rec(fields=fields), RecordType():
                pairs = zip(fields, type_.fields, strict=True)
                return Rec(tuple(self.value(part, t) for part, (_, t) in pairs))
            case Seq(items=items), ArrayType(element=element):
                return Seq(len(items), tuple(self.value(item, element) for item in items))
            case Seq(items=items), ListType(element=element) | QueueType(element=element):
                length, padding = self._length(len(items), element)
                padded = [*items, *padding]
                return Seq(length, tuple(self.value(item, element) for item in padded))
            case Table(entries=entries), MapType(key=key, value=held):
                pair = RecordType("entry", (("key", key), ("value", held)))
                length, padding = self._length(len(entries), pair)
                behind = [tuple(p.fields) for p in padding if isinstance(p, Rec)]
                all_entries = [*entries, *behind]
                return Table(
                    length, tuple((self.value(k, key), self.value(v, held)) for k, v in all_entries)
                )
            case _:
                assert not isinstance(concrete, Rec | Seq | Table)
                return self.scalar(concrete, type_)

    def _length(self, count: int, element: Type) -> tuple[Term, list[Concrete]]:
        """A length, and items behind the end where it is a symbol."""
        length = self.scalar(count, INT)
        if self.d.known(length) is not None:
            return length, []
        beyond = self.random.choice((0, 0, 1, 2))
        return length, [value(self.random, element, self.robots) for _ in range(beyond)]

    def storage(self, concrete: Storage[Constant], type_: Type) -> Storage[Term]:
        if isinstance(concrete, Tree):
            types = part_types(type_, len(concrete.parts))
            pairs = zip(concrete.parts, types, strict=True)
            return Tree(tuple(self.storage(part, t) for part, t in pairs))
        is_set = self.scalar(concrete.is_set, BOOL)
        if self.d.known(is_set) is False:
            return Cell(False, default(self.d, type_, self.robots))
        return Cell(is_set, self.value(concrete.value, type_))

    def storages(
        self, concrete: Sequence[Storage[Constant]], types: Sequence[Type]
    ) -> tuple[Storage[Term], ...]:
        return tuple(self.storage(s, t) for s, t in zip(concrete, types, strict=True))

    def store(self, system: System, concrete: Store[Constant]) -> Store[Term]:
        allread, allwrite = shared_types(system)
        return Store(
            self.storages(concrete.allread, allread), self.storages(concrete.allwrite, allwrite)
        )

    def configuration(
        self, system: System, concrete: Configuration[Constant]
    ) -> Configuration[Term]:
        """A configuration at the start of a round: copies are the store itself."""
        store = self.store(system, concrete.store)
        robots = []
        for number, robot in enumerate(concrete.robots):
            locals_, ports = own_types(system, number)
            robots.append(
                Robot(
                    robot.kind,
                    self.storages(robot.locals, locals_),
                    self.storages(robot.ports, ports),
                    store,
                    self.scalar(robot.status, INT),
                    self.scalar(robot.ran, INT),
                )
            )
        return Configuration(tuple(robots), store, concrete.round)

    # --- and back -------------------------------------------------------------------------------

    def evaluated(self, terms: Sequence[Term]) -> list[Constant]:
        """The constants that terms simplify to once every symbol is replaced by its meaning."""
        symbolic = [t for t in terms if isinstance(t, z3.ExprRef)]
        if not symbolic:
            return [t for t in terms if not isinstance(t, z3.ExprRef)]
        # All at once: terms share much.
        together = z3.Function("together", *[t.sort() for t in symbolic], self.d.sort(BOOL))(
            *symbolic
        )
        simplified = z3.simplify(z3.substitute(together, self._meanings))
        found = iter([constant(child) for child in simplified.children()])
        return [next(found) if isinstance(t, z3.ExprRef) else t for t in terms]


def constant(term: z3.ExprRef) -> Constant:
    """The constant that a term is. A term that is none did not simplify as it should have."""
    if z3.is_true(term) or z3.is_false(term):
        return bool(z3.is_true(term))
    if z3.is_int_value(term):
        return int(term.as_long())
    assert z3.is_rational_value(term), f"{term} is no constant"
    return term.as_fraction()  # type: ignore[no-any-return]


# --- the types of what a configuration holds ------------------------------------------------------


def part_types(type_: Type, count: int) -> list[Type]:
    """The types of the parts of a tree."""
    if isinstance(type_, RecordType):
        return [field for _, field in type_.fields]
    assert isinstance(type_, ArrayType)
    return [type_.element] * count


def shared_types(system: System) -> tuple[list[Type], list[Type]]:
    program = system.program
    return (
        [entry.variable.type for entry in program.allread],
        [entry.variable.type for entry in program.allwrite],
    )


def own_types(system: System, robot: int) -> tuple[list[Type], list[Type]]:
    agent = system.agent(robot)
    return (
        [entry.variable.type for entry in agent.locals],
        [port.declaration.variable.type for port in agent.ports],
    )


# --- inputs ---------------------------------------------------------------------------------------


@dataclass(slots=True)
class Asked:
    """Inputs that are recorded where they were, and arbitrary where a path was not taken."""

    symbols: Symbols
    starts: dict[tuple[Home, int, int | None], Start]
    readings: dict[tuple[int, int], Reading]
    answers: dict[tuple[Phase, int, Key], Answer]
    given: dict[tuple[Phase, int, Key], Symbolic] = field(default_factory=dict)

    def start(self, declaration: core.Declaration, robot: int | None) -> Symbolic:
        variable = declaration.variable
        type_ = variable.type
        if variable.home is Home.ALLREAD:
            assert isinstance(type_, ArrayType)
            type_ = type_.element
        return self.symbols.value(self.starts[variable.home, variable.slot, robot].value, type_)

    def sensor(self, robot: int, port: core.Port) -> Symbolic:
        variable = port.declaration.variable
        reading = self.readings[robot, variable.slot]
        return self.symbols.value(reading.value, variable.type)

    def oracle(self, phase: Phase, robot: int) -> Oracle[Term]:
        return AskedOracle(self, phase, robot)

    def answer(self, where: tuple[Phase, int, Key], type_: Type) -> Symbolic:
        if where not in self.given:
            recorded = self.answers.get(where)
            if recorded is None:
                symbols = self.symbols
                concrete: Concrete = value(symbols.random, type_, symbols.robots)
            else:
                concrete = recorded.value
            self.given[where] = self.symbols.value(concrete, type_)
        return self.given[where]


@dataclass(slots=True)
class AskedOracle:
    """The answers of one turn."""

    inputs: Asked
    phase: Phase
    robot: int

    def choose(self, key: Key, low: Term, high: Term, type_: Type) -> Term:
        answer = self.inputs.answer((self.phase, self.robot, key), type_)
        assert not isinstance(answer, Rec | Seq | Table)
        return answer

    def external(
        self, function: core.External, key: Key, arguments: tuple[Symbolic, ...]
    ) -> Symbolic:
        return self.inputs.answer((self.phase, self.robot, key), function.result.type)

    def vouches_for(self, function: core.External) -> bool:
        return False

    def every(self, type_: Type, body: Callable[[Symbolic], Term]) -> Term:
        return True
