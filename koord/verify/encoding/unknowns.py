"""Fresh terms of a solver run: values of every type, and answers of mathematical functions."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import TypeAlias

from msgspec import Struct, field

from koord.semantics.domain import conjunction
from koord.semantics.expressions import statement
from koord.semantics.oracle import Key
from koord.semantics.statements import machine
from koord.semantics.storage import Cell, Storage, Tree, held
from koord.semantics.values import Rec, Seq, Table, Value, equal, listed
from koord.syntax import core
from koord.syntax.analysis.footprint import WriteExtent
from koord.syntax.core import BinaryOp
from koord.syntax.system import System
from koord.syntax.types import (
    BOOL,
    INT,
    ArrayType,
    EnumType,
    GrowingType,
    MapType,
    RecordType,
    Robots,
    ScalarType,
    Type,
    how_many,
    is_flat,
    part_types,
)
from koord.verify.encoding.externals import asked_of_all, encoded, scalars, vouched
from koord.verify.encoding.terms import Term, Terms

Symbolic: TypeAlias = "Value[Term]"

#: How long an arbitrary list may be where nothing says it; a verdict tells when this cut anything.
LIST_CAPACITY = 3

#: An arbitrary map has room for all keys, if there are no more of them than that.
KEYS = 6


class Unknowns(Struct):
    """The fresh terms of one solver run, with the constraints that come with them.

    ``constraints`` must hold whatever the program does (ranges of enumerations, functionality of
    external functions). ``limits`` names what the terms do not cover, if anything.
    """

    d: Terms
    program: core.Program
    robots: int
    constraints: list[Term] = field(default_factory=list)
    limits: list[str] = field(default_factory=list)
    _functions: dict[str, list[tuple[tuple[Symbolic, ...], Symbolic]]] = field(default_factory=dict)
    _summarised: set[str] = field(default_factory=set)
    _asked_of_all: frozenset[str] = frozenset()
    _vouched: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        self._asked_of_all = asked_of_all(self.program)
        self._vouched = frozenset(e.name for e in self.program.externals if vouched(e))

    @property
    def uncovered(self) -> list[str]:
        """Descriptions of the values that the terms do not cover, in order, for people to read."""
        return sorted(set(self.limits))

    def value(
        self,
        name: str,
        type_: Type,
        length: int | None = None,
        scalar: Callable[[str, Type], Term] | None = None,
    ) -> Symbolic:
        """An arbitrary value of a type. A list has ``length`` items, or few.

        ``scalar`` makes its scalars; fresh ones if it is left out.
        """
        made = scalar or self.d.fresh
        match type_:
            case RecordType(fields=fields):
                return Rec(tuple(self.value(f"{name}.{n}", t, scalar=made) for n, t in fields))
            case ArrayType(element=element, size=size):
                count = self.robots if size is Robots.ALL else size
                items = [self.value(f"{name}[{k}]", element, scalar=made) for k in range(count)]
                return listed(self.d, items)
            case GrowingType(element=element):
                return self._list(name, element, length, made)
            case MapType(key=key, value=value):
                entry = RecordType("entry", (("k", key), ("v", value)))
                entries = self._list(name, entry, length, made, how_many(key))
                assert isinstance(entries, Seq)
                pairs = tuple(
                    (item.fields[0], item.fields[1])
                    for item in entries.items
                    if isinstance(item, Rec)
                )
                self._distinct_keys(entries.length, [k for k, _ in pairs])
                return Table(entries.length, pairs)
            case EnumType(members=members):
                position = made(name, type_)
                self._require_between(0, position, len(members) - 1)
                return position
            case _:
                return made(name, type_)

    def storage(
        self, name: str, type_: Type, initial: Storage[Term], written: WriteExtent
    ) -> Storage[Term]:
        """Any state of a variable that started as ``initial`` and is written like that."""
        if written is WriteExtent.NEVER:
            return initial
        if isinstance(initial, Tree):
            types = part_types(type_, len(initial.parts))
            fields = type_.fields if isinstance(type_, RecordType) else ()
            labels = [name for name, _ in fields] or range(len(types))
            return Tree(
                tuple(
                    self.storage(f"{name}.{label}", part_type, part, written)
                    for label, part_type, part in zip(labels, types, initial.parts, strict=True)
                )
            )
        is_set = initial.is_set
        if self.d.known(is_set) is not True:
            is_set = self.d.fresh(f"{name}.set", BOOL)
        return Cell(is_set, self._changed(name, type_, initial.value, written))

    def _changed(self, name: str, type_: Type, initial: Symbolic, written: WriteExtent) -> Symbolic:
        """Any value of an atom, of the length it had if only its elements are written."""
        if isinstance(initial, Seq) and written is WriteExtent.PARTS:
            assert isinstance(type_, GrowingType)
            items = [self.value(f"{name}[{k}]", type_.element) for k in range(len(initial.items))]
            return Seq(initial.length, tuple(items))
        return self.value(name, type_)

    def function(
        self, external: core.External, arguments: tuple[Symbolic, ...], name: str
    ) -> Symbolic:
        """The answer of a mathematical function: equal arguments give equal answers. [EXTERNAL]"""
        if not self._is_symbol(external):
            return self.alike(external, arguments, name)
        if self.vouches_for(external) and external.name not in self._summarised:
            self._summarised.add(external.name)
            self.constraints += [self._axiom(external, promise) for promise in external.ensures]
        flat = encoded(self.d, external, arguments, self.robots)

        def applied(symbol: str, type_: Type) -> Term:
            return self.d.applied(symbol, flat, type_)

        return self.value(external.name, external.result.type, scalar=applied)

    def _is_symbol(self, external: core.External) -> bool:
        """Return whether a function is an uninterpreted symbol: its type decides, for all calls.

        Others are compared call by call: to know of lists when they are equal is hard for solvers.
        """
        if external.name in self._asked_of_all:
            return True
        variables = (external.result, *external.parameters)
        flat = all(is_flat(v.type) for v in variables)
        return flat and isinstance(external.result.type, ScalarType)

    def alike(
        self, external: core.External, arguments: tuple[Symbolic, ...], name: str
    ) -> Symbolic:
        """A fresh value, or the earlier one for equal arguments."""
        answer = self.value(name, external.result.type)
        asked = self._functions.setdefault(external.name, [])
        for earlier, its_answer in asked:
            same = conjunction(
                self.d, [equal(self.d, a, b) for a, b in zip(earlier, arguments, strict=True)]
            )
            agree = equal(self.d, its_answer, answer)
            self.constraints.append(self.d.binary(BinaryOp.IMPLIES, same, agree))
        asked.append((arguments, answer))
        return answer

    def chosen(self, low: Term, high: Term, type_: Type) -> Term:
        """A fresh value for ``choose``. The caller requires that it lies between the bounds."""
        return self.d.fresh("choose", type_)

    def vouches_for(self, external: core.External) -> bool:
        """Return whether the summary of a function was asserted for all its arguments at once."""
        return external.name in self._vouched

    def every(self, types: Sequence[Type], body: Callable[[tuple[Symbolic, ...]], Term]) -> Term:
        """The condition that a statement holds of all values of some types. [E-QUANT]

        What is known of terms that depend on these values is required of all values too.
        """
        d, outer = self.d, self.constraints
        ranges: list[Term] = []
        facts: list[Term] = []
        limits = list(self.limits)
        self.constraints = ranges
        values = tuple(self.value("of all", type_) for type_ in types)
        # Summaries only promise, and a promise about short lists is less: proofs hold all the same.
        self.limits = limits
        self.constraints = facts
        holds = body(values)
        self.constraints = outer
        variables = [scalar for value in values for scalar in scalars(value)]
        given = conjunction(d, ranges)
        known = d.binary(BinaryOp.IMPLIES, given, conjunction(d, facts))
        self.constraints.append(d.for_all(variables, known))
        return d.for_all(variables, d.binary(BinaryOp.IMPLIES, given, holds))

    def _axiom(self, external: core.External, promise: core.Expr) -> Term:
        """The axiom of a mathematical function: its summary for all arguments. [EXTERNAL]"""
        types, slots = [parameter.type for parameter in external.parameters], []
        while isinstance(promise, core.Quantified) and isinstance(promise.domain, core.AllValues):
            # One quantifier over everything is easier for solvers than one inside the other.
            types.append(promise.domain.type)
            slots.append(promise.variable.slot)
            promise = promise.body

        def kept(values: tuple[Symbolic, ...]) -> Term:
            arguments = values[: len(external.parameters)]
            answer = self.function(external, arguments, external.name)
            m = machine(self.d, nowhere, _Axiom(self))
            m.in_summary = True
            bound = [held(self.d, value) for value in (*arguments, answer)]
            m.memory.bound = [*bound, *[None] * (external.bound - len(bound))]
            for slot, value in zip(slots, values[len(arguments) :], strict=True):
                m.memory.bound[slot] = held(self.d, value)
            met = conjunction(self.d, [statement(m, duty) for duty in external.requires])
            return self.d.binary(BinaryOp.IMPLIES, met, statement(m, promise))

        # Summaries speak of no robot, so any system of that size will do.
        nowhere = System(self.program, (0,) * self.robots)
        return self.every(types, kept)

    def _require_between(self, low: int, value: Term, high: int) -> None:
        d = self.d
        self.constraints += [
            d.binary(BinaryOp.LE, d.const(low, INT), value),
            d.binary(BinaryOp.LE, value, d.const(high, INT)),
        ]

    def _list(
        self,
        name: str,
        element: Type,
        length: int | None,
        made: Callable[[str, Type], Term],
        most: int | None = None,
    ) -> Symbolic:
        """Any list of ``length`` items; else of at most ``most``, if that is little, or of few."""

        def items(count: int) -> tuple[Symbolic, ...]:
            return tuple(self.value(f"{name}[{k}]", element, scalar=made) for k in range(count))

        if length is not None:
            return listed(self.d, items(length))
        size = made(f"{name}.length", INT)
        if most is not None and most <= KEYS:
            self._require_between(0, size, most)
            return Seq(size, items(most))
        self._require_between(0, size, LIST_CAPACITY)
        limit = f"lists {_of_the_text(name)} of more than {LIST_CAPACITY} elements"
        if limit not in self.limits:
            self.limits.append(limit)
        return Seq(size, items(LIST_CAPACITY))

    def _distinct_keys(self, length: Term, keys: list[Symbolic]) -> None:
        for later in range(len(keys)):
            for earlier in range(later):
                beyond = self.d.binary(BinaryOp.LE, length, later)
                same = equal(self.d, keys[earlier], keys[later])
                self.constraints.append(
                    self.d.binary(BinaryOp.OR, beyond, self.d.unary(core.UnaryOp.NOT, same))
                )


def _of_the_text(name: str) -> str:
    """The program's name of an unknown: without what is before it, robot, round and element."""
    return re.split(r"[@#\[]", name, maxsplit=1)[0].rpartition(" ")[2]


class _Axiom(Struct, frozen=True):
    """The oracle for summaries as axioms: for all arguments, with nothing recorded."""

    unknowns: Unknowns

    def choose(self, key: Key, low: Term, high: Term, type_: Type) -> Term:
        raise AssertionError("summaries do not choose")

    def external(
        self, function: core.External, key: Key, arguments: tuple[Symbolic, ...]
    ) -> Symbolic:
        assert function.kind is core.ExternalKind.FUNCTION, "elaboration sees to it"
        return self.unknowns.function(function, arguments, function.name)

    def every(self, type_: Type, body: Callable[[Symbolic], Term]) -> Term:
        return self.unknowns.every((type_,), lambda values: body(values[0]))

    def vouches_for(self, function: core.External) -> bool:
        return True
