"""Symbolic inputs: everything a step leaves open becomes a fresh term, remembered for later.

What the semantics asks of its :class:`~koord.semantics.oracle.Inputs` is answered with constants
that a solver may choose; a model then says what they were, and :mod:`koord.verify.witness` writes
them down as a recording.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

from koord.semantics.configurations import System
from koord.semantics.domain import conjunction
from koord.semantics.expressions import statement
from koord.semantics.machine import machine
from koord.semantics.oracle import Key, Oracle, Phase
from koord.semantics.storage import Cell, Storage, Tree, held
from koord.semantics.values import Rec, Seq, Table, Value, equal, listed
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home
from koord.syntax.types import (
    BOOL,
    INT,
    ArrayType,
    EnumType,
    ListType,
    MapType,
    QueueType,
    RecordType,
    Robots,
    Type,
)
from koord.syntax.walk import nodes
from koord.verify.footprint import Written
from koord.verify.terms import Term, Terms

Symbolic: TypeAlias = "Value[Term]"

#: How long an arbitrary list may be where nothing says it; a verdict tells when this cut anything.
LIST_CAPACITY = 3


@dataclass(frozen=True, slots=True)
class SymbolicAnswer:
    """The term that stands for one answer; see :class:`koord.semantics.traces.recording.Answer`."""

    phase: Phase
    robot: int
    key: Key
    function: str | None
    arguments: tuple[Symbolic, ...]
    value: Symbolic


@dataclass(slots=True)
class Unknowns:
    """Fresh terms of one solver run, with the constraints that come with them.

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

    def value(self, name: str, type_: Type, length: int | None = None) -> Symbolic:
        """An arbitrary value of a type. A list has ``length`` items, or few."""
        match type_:
            case RecordType(fields=fields):
                return Rec(tuple(self.value(f"{name}.{n}", t) for n, t in fields))
            case ArrayType(element=element, size=size):
                count = self.robots if size is Robots.ALL else size
                items = [self.value(f"{name}[{k}]", element) for k in range(count)]
                return listed(self.d, items)
            case ListType(element=element) | QueueType(element=element):
                return self._list(name, element, length)
            case MapType(key=key, value=value):
                entries = self._list(name, RecordType("entry", (("k", key), ("v", value))), length)
                assert isinstance(entries, Seq)
                pairs = tuple(
                    (item.fields[0], item.fields[1])
                    for item in entries.items
                    if isinstance(item, Rec)
                )
                self._distinct_keys(entries.length, [k for k, _ in pairs])
                return Table(entries.length, pairs)
            case EnumType(members=members):
                position = self.d.fresh(name, type_)
                self._require_between(0, position, len(members) - 1)
                return position
            case _:
                return self.d.fresh(name, type_)

    def storage(
        self, name: str, type_: Type, initial: Storage[Term], written: Written
    ) -> Storage[Term]:
        """Any state of a variable that started as ``initial`` and is written like that."""
        if written is Written.NEVER:
            return initial
        if isinstance(initial, Tree):
            types = _part_types(type_, len(initial.parts))
            return Tree(
                tuple(
                    self.storage(f"{name}.{label}", part_type, part, written)
                    for (label, part_type), part in zip(types, initial.parts, strict=True)
                )
            )
        is_set = initial.is_set
        if self.d.known(is_set) is not True:
            is_set = self.d.fresh(f"{name}.set", BOOL)
        return Cell(is_set, self._changed(name, type_, initial.value, written))

    def _changed(self, name: str, type_: Type, initial: Symbolic, written: Written) -> Symbolic:
        """Any value of an atom, of the length it had if only its elements are written."""
        if isinstance(initial, Seq) and written is Written.PARTS:
            assert isinstance(type_, ListType | QueueType)
            items = [self.value(f"{name}[{k}]", type_.element) for k in range(len(initial.items))]
            return Seq(initial.length, tuple(items))
        return self.value(name, type_)

    def function(
        self, external: core.External, arguments: tuple[Symbolic, ...], name: str
    ) -> Symbolic:
        """The answer of a mathematical function: equal for equal arguments. [EXTERNAL]"""
        # By type, not by value: all calls of a function must be compared in one way.
        variables = (external.result, *external.parameters)
        if not any(_has_list(v.type) for v in variables) and not _is_compound(external.result.type):
            flat = [scalar for argument in arguments for scalar in _scalars(argument)]
            if self.vouches_for(external) and external.name not in self._summarised:
                self._summarised.add(external.name)
                self._require_summary(external)
            return self._applied(external, flat)
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

    def vouches_for(self, external: core.External) -> bool:
        """Whether the summary of a function was required of all its arguments at once.

        That is so where it says more than what one answer must be like. Elsewhere it is required
        answer by answer: solvers find it hard to come by a function that meets it everywhere.
        """
        return (
            external.kind is core.ExternalKind.FUNCTION
            and not any(_is_compound(v.type) for v in (external.result, *external.parameters))
            and any(
                isinstance(n, core.ExternalCall | core.AllValues) for n in nodes(external.ensures)
            )
        )

    def _require_summary(self, external: core.External) -> None:
        """A mathematical function meets its summary for all arguments, asked for or not.

        One axiom per promise, over the parameters and whatever the promise is about all of.
        """
        for promise in external.ensures:
            axiom = _Axiom(self)
            arguments = [axiom.variable(parameter.type) for parameter in external.parameters]
            answer = self.function(external, tuple(arguments), external.name)
            m = machine(self.d, axiom.nowhere(self.robots), axiom)
            m.in_summary = True
            bound = [held(self.d, value) for value in (*arguments, answer)]
            m.memory.bound = [*bound, *[None] * (external.bound - len(bound))]
            while isinstance(promise, core.Quantified) and isinstance(
                promise.domain, core.AllValues
            ):
                slot = promise.variable.slot
                m.memory.bound[slot] = held(self.d, axiom.variable(promise.domain.type))
                promise = promise.body
            met = [statement(m, requirement) for requirement in external.requires]
            holds = self.d.binary(BinaryOp.IMPLIES, conjunction(self.d, met), statement(m, promise))
            self.constraints.append(axiom.closed(holds))

    def _applied(self, external: core.External, flat: list[Term]) -> Term:
        """An application of an uninterpreted function symbol of Z3's."""
        result = external.result.type
        answer = self.d.applied(external.name, flat, result)
        if isinstance(result, EnumType):
            self._require_between(0, answer, len(result.members) - 1)
        return answer

    def _require_between(self, low: int, value: Term, high: int) -> None:
        d = self.d
        self.constraints += [
            d.binary(BinaryOp.LE, d.const(low, INT), value),
            d.binary(BinaryOp.LE, value, d.const(high, INT)),
        ]

    def _list(self, name: str, element: Type, length: int | None) -> Symbolic:
        if length is not None:
            return listed(self.d, [self.value(f"{name}[{k}]", element) for k in range(length)])
        size = self.d.fresh(f"{name}.length", INT)
        self._require_between(0, size, LIST_CAPACITY)
        limit = f"lists {_of_the_text(name)} of more than {LIST_CAPACITY} elements"
        if limit not in self.limits:
            self.limits.append(limit)
        items = tuple(self.value(f"{name}[{k}]", element) for k in range(LIST_CAPACITY))
        return Seq(size, items)

    def _distinct_keys(self, length: Term, keys: list[Symbolic]) -> None:
        for later in range(len(keys)):
            for earlier in range(later):
                beyond = self.d.binary(BinaryOp.LE, length, later)
                same = equal(self.d, keys[earlier], keys[later])
                self.constraints.append(
                    self.d.binary(BinaryOp.OR, beyond, self.d.unary(core.UnaryOp.NOT, same))
                )


def _of_the_text(name: str) -> str:
    """What the program calls it: the name of an unknown without robot, round and element."""
    return re.split(r"[@#\[]", name, maxsplit=1)[0]


def _part_types(type_: Type, count: int) -> list[tuple[str, Type]]:
    """Labels and types of the parts of a tree."""
    if isinstance(type_, RecordType):
        return list(type_.fields)
    assert isinstance(type_, ArrayType)
    return [(str(position), type_.element) for position in range(count)]


def _scalars(value: Symbolic) -> Iterator[Term]:
    if isinstance(value, Rec):
        for part in value.fields:
            yield from _scalars(part)
    elif isinstance(value, Seq):
        for part in value.items:
            yield from _scalars(part)
    elif isinstance(value, Table):
        raise AssertionError("maps are compared, not flattened")
    else:
        yield value


def _has_list(type_: Type) -> bool:
    """Whether equal values of a type may be held in different shapes."""
    match type_:
        case RecordType(fields=fields):
            return any(_has_list(field) for _, field in fields)
        case ArrayType(element=element):
            return _has_list(element)
        case _:
            return isinstance(type_, ListType | QueueType | MapType)


def _is_compound(type_: Type) -> bool:
    return isinstance(type_, RecordType | ArrayType | ListType | QueueType | MapType)


@dataclass(slots=True)
class _Axiom:
    """An oracle for summaries as axioms: arguments are variables of a quantifier."""

    unknowns: Unknowns
    variables: list[Term] = field(default_factory=list)

    def variable(self, type_: Type) -> Symbolic:
        made = self.unknowns.value("any", type_)
        self.variables += _scalars(made)
        return made

    def closed(self, formula: Term) -> Term:
        return self.unknowns.d.for_all(self.variables, formula)

    def nowhere(self, robots: int) -> System:
        """Summaries speak of no robot, so any system of that size will do."""
        return System(self.unknowns.program, (0,) * robots)

    def choose(self, key: Key, low: Term, high: Term, type_: Type) -> Term:
        raise AssertionError("summaries do not choose")

    def external(
        self, function: core.External, key: Key, arguments: tuple[Symbolic, ...]
    ) -> Symbolic:
        if function.kind is core.ExternalKind.FRESH:
            raise AssertionError("a summary asks a function that answers anew each time")
        return self.unknowns.function(function, arguments, function.name)

    def every(self, type_: Type, body: Callable[[Symbolic], Term]) -> Term:
        inner = _Axiom(self.unknowns)
        return inner.closed(body(inner.variable(type_)))

    def vouches_for(self, function: core.External) -> bool:
        return True


# --- inputs of one step -------------------------------------------------------------------------


@dataclass(slots=True)
class SymbolicOracle:
    """Answers for one turn as fresh terms."""

    inputs: SymbolicInputs
    phase: Phase
    robot: int

    def choose(self, key: Key, low: Term, high: Term, type_: Type) -> Term:
        noted = self.inputs.noted(self.phase, self.robot, key)
        if noted is not None:
            assert not isinstance(noted.value, Rec | Seq | Table)
            return noted.value
        value = self.inputs.unknowns.d.fresh("choose", type_)
        self.inputs.note(SymbolicAnswer(self.phase, self.robot, key, None, (), value))
        return value

    def external(
        self, function: core.External, key: Key, arguments: tuple[Symbolic, ...]
    ) -> Symbolic:
        noted = self.inputs.noted(self.phase, self.robot, key)
        if noted is not None:
            return noted.value
        if function.kind is core.ExternalKind.FUNCTION:
            value = self.inputs.unknowns.function(function, arguments, function.name)
        else:
            value = self.inputs.unknowns.value(function.name, function.result.type)
        name = function.name
        self.inputs.note(SymbolicAnswer(self.phase, self.robot, key, name, arguments, value))
        return value

    def every(self, type_: Type, body: Callable[[Symbolic], Term]) -> Term:
        d = self.inputs.unknowns.d
        bound = self.inputs.unknowns.value("every", type_)
        return d.for_all(list(_scalars(bound)), body(bound))

    def vouches_for(self, function: core.External) -> bool:
        return self.inputs.unknowns.vouches_for(function)


class _SummaryOracle(SymbolicOracle):
    """Answers for a summary that is looked at afterwards, as a replay will look at it."""

    def every(self, type_: Type, body: Callable[[Symbolic], Term]) -> Term:
        return True


@dataclass(slots=True)
class SymbolicInputs:
    """Inputs of one step as fresh terms, in the order in which they were asked for."""

    unknowns: Unknowns
    label: str
    starts: list[tuple[Home, int, int | None, Symbolic]] = field(default_factory=list)
    readings: list[tuple[int, int, Symbolic]] = field(default_factory=list)
    answers: dict[tuple[Phase, int, Key], SymbolicAnswer] = field(default_factory=dict)

    def answer_summaries(self, system: System) -> None:
        """Note what summaries ask of functions, where they were taken for granted so far.

        A replay checks every summary, so it needs those answers too. [EXTERNAL]
        """
        for answer in list(self.answers.values()):
            if answer.function is None:
                continue
            external = system.program.external(answer.function)
            if not self.unknowns.vouches_for(external):
                continue
            d = self.unknowns.d
            m = machine(d, system, _SummaryOracle(self, answer.phase, answer.robot))
            m.in_summary = True
            m.trail = [*answer.key[1:], answer.key[0]]
            known = [held(d, value) for value in (*answer.arguments, answer.value)]
            m.memory.bound = [*known, *[None] * (external.bound - len(known))]
            for promise in external.ensures:
                statement(m, promise)

    def noted(self, phase: Phase, robot: int, key: Key) -> SymbolicAnswer | None:
        """The answer already given for a key: a turn that is looked at twice is one turn."""
        return self.answers.get((phase, robot, key))

    def note(self, answer: SymbolicAnswer) -> None:
        """Remember an answer."""
        self.answers[answer.phase, answer.robot, answer.key] = answer

    def start(self, declaration: core.Declaration, robot: int | None) -> Symbolic:
        variable = declaration.variable
        type_ = variable.type
        if variable.home is Home.ALLREAD:
            assert isinstance(type_, ArrayType)
            type_ = type_.element
        name = variable.name if robot is None else f"{variable.name}@{robot}"
        value = self.unknowns.value(name, type_, declaration.length)
        self.starts.append((variable.home, variable.slot, robot, value))
        return value

    def sensor(self, robot: int, port: core.Port) -> Symbolic:
        variable = port.declaration.variable
        name = f"{port.module}.{variable.name}@{robot}#{self.label}"
        value = self.unknowns.value(name, variable.type)
        self.readings.append((robot, variable.slot, value))
        return value

    def oracle(self, phase: Phase, robot: int) -> Oracle[Term]:
        return SymbolicOracle(self, phase, robot)


__all__ = ["SymbolicAnswer", "SymbolicInputs", "Unknowns"]
