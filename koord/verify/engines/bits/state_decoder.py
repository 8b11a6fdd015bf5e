"""Decoding of states: the values that bits stand for, with names in Koord.

A *place* is a scalar of a configuration, or an atom over opaque values, with its name in Koord and
the values that its bits tell apart. What its bits say counts only where it is *inside*: set, within
the length of its list, and in the range that is followed. Elsewhere it is ``OUTSIDE``, whatever it
is.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import TypeAlias, TypeVar

from msgspec import Struct

from koord.semantics.domain import Constant
from koord.semantics.storage import Cell, Storage
from koord.semantics.values import Rec, Seq, Value
from koord.syntax import core
from koord.syntax.analysis.footprint import WriteExtent, footprint, statuses
from koord.syntax.analysis.sorts import Fields, Items, Scalar, Shape
from koord.syntax.analysis.symmetry import Symmetry
from koord.syntax.core import BinaryOp, Home
from koord.syntax.system import Status, System
from koord.syntax.types import (
    BOOL,
    INT,
    ArrayType,
    GrowingType,
    IntType,
    RecordType,
    Robots,
    SequenceType,
    StreamType,
    StringType,
    Type,
)
from koord.verify.engines.bits.cells import as_constant
from koord.verify.engines.bits.circuit import Circuit
from koord.verify.engines.bits.domain import Bit, BitDomain, Bits, literal
from koord.verify.engines.bits.graph import FALSE, TRUE, Graph
from koord.verify.engines.bits.numbers import Number
from koord.verify.engines.bits.opaque import EQUALS, Argument, OpaqueChoice

#: Between two opaque values that are the same.
EQUALS_SIGN = " == "

#: A place that may have more values than that is not spoken of.
MANY_VALUES = 300


T = TypeVar("T")


class RobotIndex(Struct, frozen=True):
    """The number of a robot, as a part of a name."""

    number: int


class ArrayIndex(Struct, frozen=True):
    """A number in brackets, as a part of a name."""

    number: int


Piece: TypeAlias = "str | RobotIndex | ArrayIndex"


class Outside(Struct, frozen=True):
    """The value of a place that is not inside."""


OUTSIDE = Outside()

#: What a place may hold: a scalar of the text, or nothing that is known.
Held: TypeAlias = "Constant | Outside"


class StateVariable(Struct, frozen=True):
    """A scalar of a configuration. Two are equal if their names are.

    ``type`` is None for a robot's status and for the event that it ran last. ``may_fault`` says
    whether to read it outside is a fault; ``moves`` whether the environment may change it, and
    ``written`` whether anything does. ``of_robots``: its integers are robots, where they may change
    places.
    """

    name: tuple[Piece, ...]
    type: Type | None
    bits: Bits
    values: tuple[Held, ...]
    inside: int = TRUE
    may_fault: bool = False
    moves: bool = False
    written: bool = True
    of_robots: bool = False

    @property
    def robots(self) -> tuple[int, ...]:
        return tuple(piece.number for piece in self.name if isinstance(piece, RobotIndex))

    @property
    def latches(self) -> tuple[int, ...]:
        """The literals of its bits that are not fixed."""
        match self.bits:
            case Bit(literal=x):
                return (x,)
            case Number(literals=literals):
                return tuple(x for x in literals if x > 1)
            case _:
                return ()

    def is_value(self, d: BitDomain, value: Held) -> int:
        """The literal that the place holds a value."""
        if isinstance(value, Outside):
            return self.inside ^ 1
        return d.graph.both(self.inside, self._coded(d, value))

    def _coded(self, d: BitDomain, value: Constant) -> int:
        match self.bits:
            case Bit(literal=x):
                return x if value else x ^ 1
            case Number(literals=literals, scale=scale):
                number = d.number(value) if isinstance(value, str) else None
                code = number.low if number is not None else int(Fraction(value) * (scale or 1))
                return _matches(d.graph, literals, code)
            case _:
                return TRUE if self.bits == value else FALSE


def _matches(g: Graph, literals: tuple[int, ...], code: int) -> int:
    return g.all_of(x if (code >> k) & 1 else x ^ 1 for k, x in enumerate(literals))


class _Where(Struct, frozen=True):
    """Properties that a place inherits from the variable that it is in."""

    d: BitDomain
    moves: bool
    written: WriteExtent


def places_of(
    system: System, circuit: Circuit, symmetry: Symmetry | None
) -> tuple[StateVariable, ...]:
    """All places of a state whose values are few enough."""
    found = list(_variables(system, circuit, symmetry))
    found += _atoms(circuit, found)
    return tuple(p for p in found if p.values)


def _variables(
    system: System, circuit: Circuit, symmetry: Symmetry | None
) -> Iterator[StateVariable]:
    program, state, d = system.program, circuit.start, circuit.d
    print_, sensed = footprint(program), _sensed(program)
    few = (None,) * len(program.allread), (None,) * len(program.allwrite)
    entries, shared = (symmetry.entries, symmetry.allwrite) if symmetry else few

    def where(home: Home, kind: int, slot: int) -> _Where:
        how = print_.get((home, kind, slot), WriteExtent.NEVER)
        return _Where(d, home is Home.PORT and (kind, slot) in sensed, how)

    for slot, entry in enumerate(program.allread):
        type_ = entry.variable.type
        assert isinstance(type_, ArrayType)
        stored = state.store.allread[slot]
        for i, part in enumerate(() if isinstance(stored, Cell) else stored.parts):
            name = (entry.variable.name, "[", RobotIndex(i), "]")
            at = where(Home.ALLREAD, 0, slot)
            yield from _stored(at, name, type_.element, part, entries[slot])
    for slot, entry in enumerate(program.allwrite):
        at = where(Home.ALLWRITE, 0, slot)
        stored = state.store.allwrite[slot]
        yield from _stored(at, (entry.variable.name,), entry.variable.type, stored, shared[slot])
    possible = statuses(program)
    for i, robot in enumerate(state.robots):
        agent, kind = program.agents[robot.kind], robot.kind
        at_robot = ("@", RobotIndex(i))
        for slot, entry in enumerate(agent.locals):
            shape = symmetry.locals[kind][slot] if symmetry else None
            at = where(Home.LOCAL, kind, slot)
            own = (entry.variable.name, *at_robot)
            yield from _stored(at, own, entry.variable.type, robot.locals[slot], shape)
        for slot, port in enumerate(agent.ports):
            shape = symmetry.ports[kind][slot] if symmetry else None
            v = port.declaration.variable
            at = where(Home.PORT, kind, slot)
            own = (port.label, *at_robot)
            yield from _stored(at, own, v.type, robot.ports[slot], shape)
        # Robots that all asked are stopped at the end of the program turns only.
        asks, own = Status.ASKED in possible[kind], ("stopped", *at_robot)
        states = tuple(_values(d, INT, robot.status))
        yield StateVariable(own, None, robot.status, states, moves=asks)
        ran = tuple(_values(d, INT, robot.ran))
        yield StateVariable(("ran", *at_robot), None, robot.ran, ran, moves=True)


def _sensed(program: core.Program) -> set[tuple[int, int]]:
    """The ports that the environment may change, by kind and slot."""
    found = set()
    for kind, agent in enumerate(program.agents):
        for module in agent.modules:
            model = module.environment is not None
            for position in module.ports:
                port = agent.ports[position]
                if model or port.direction is core.Direction.SENSOR:
                    found.add((kind, port.declaration.variable.slot))
    return found


def _stored(
    at: _Where, name: tuple[Piece, ...], type_: Type, stored: Storage[Bits], shape: Shape | None
) -> Iterator[StateVariable]:
    if isinstance(stored, Cell):
        inside = literal(stored.is_set)
        yield from _valued(at, name, type_, stored.value, shape, inside)
        return
    for label, part, below, its_shape in _parts(name, type_, stored.parts, shape):
        yield from _stored(at, label, part, below, its_shape)


def _parts(
    name: tuple[Piece, ...], type_: Type, parts: tuple[T, ...], shape: Shape | None
) -> Iterator[tuple[tuple[Piece, ...], Type, T, Shape | None]]:
    """Yield fields and elements, with their names."""
    match type_:
        case RecordType(fields=fields):
            for k, ((label, its_type), part) in enumerate(zip(fields, parts, strict=True)):
                inner = shape.parts[k] if isinstance(shape, Fields) else None
                yield (*name, f".{label}"), its_type, part, inner
        case SequenceType(element=element):
            over_robots = isinstance(type_, ArrayType) and type_.size is Robots.ALL
            inner = shape.element if isinstance(shape, Items) else None
            for k, part in enumerate(parts):
                index: Piece = RobotIndex(k) if over_robots else ArrayIndex(k)
                yield (*name, "[", index, "]"), element, part, inner


def _valued(
    at: _Where,
    name: tuple[Piece, ...],
    type_: Type,
    value: Value[Bits],
    shape: Shape | None,
    inside: int,
) -> Iterator[StateVariable]:
    d = at.d
    match value:
        case Rec(fields=parts):
            for label, its_type, below, its_shape in _parts(name, type_, parts, shape):
                yield from _valued(at, label, its_type, below, its_shape, inside)
        case Seq(length=length, items=items):
            listed = isinstance(type_, GrowingType)
            if listed and at.written is not WriteExtent.PARTS:
                yield from _scalar(at, ("length(", *name, ")"), INT, length, None, inside)
            elements = _parts(name, type_, items, shape)
            for k, (label, its_type, item, its_shape) in enumerate(elements):
                there = inside
                if listed:
                    longer = literal(d.binary(BinaryOp.LT, d.const(k, INT), length))
                    there = d.graph.both(inside, longer)
                yield from _valued(at, label, its_type, item, its_shape, there)
        case Bit() | Number() | OpaqueChoice() | bool() | int() | Fraction() | str():
            yield from _scalar(at, name, type_, value, shape, inside)
        case _:
            return  # a map: it has no place for each key


def _scalar(
    at: _Where,
    name: tuple[Piece, ...],
    type_: Type,
    bits: Bits,
    shape: Shape | None,
    inside: int,
) -> Iterator[StateVariable]:
    if isinstance(type_, StreamType):
        return
    faults, written = inside != TRUE, at.written is not WriteExtent.NEVER
    if isinstance(bits, Number) and bits.loose != FALSE:
        inside = at.d.graph.both(inside, bits.loose ^ 1)
    values = tuple(_values(at.d, type_, bits))
    outside = (OUTSIDE,) if values and inside != TRUE else ()
    of_robots = isinstance(shape, Scalar) and isinstance(type_, IntType)
    yield StateVariable(
        name, type_, bits, (*values, *outside), inside, faults, at.moves, written, of_robots
    )


def _values(d: BitDomain, type_: Type, bits: Bits) -> Iterator[Held]:
    match bits:
        case Bit():
            yield from (False, True)
        case Number(low=low, high=high, scale=scale):
            if high - low >= MANY_VALUES:
                return
            for k in range(low, high + 1):
                if isinstance(type_, StringType):
                    yield d.text_of(k)
                else:
                    yield as_constant(k, scale)
        case OpaqueChoice():
            return
        case _:
            yield bits


def _atoms(circuit: Circuit, known: list[StateVariable]) -> Iterator[StateVariable]:
    """Yield the relations, and equalities, of opaque values that variables hold, as places."""
    latches = {latch.literal for latch in circuit.latches}
    holders: dict[Argument, StateVariable] = {}
    for place in known:
        if isinstance(place.bits, OpaqueChoice) and place.inside == TRUE:
            holders.setdefault(place.bits.parts[0][0], place)
    for (relation, arguments), x in circuit.d.opaques.atoms.get(1, {}).items():
        held = [holders[a] for a in arguments if a in holders]
        if x not in latches or len(held) < len(arguments):
            continue
        between = EQUALS_SIGN if relation == EQUALS else ", "
        inner: tuple[Piece, ...] = held[0].name
        for place in held[1:]:
            inner = (*inner, between, *place.name)
        name = inner if relation == EQUALS else (f"{relation}(", *inner, ")")
        yield StateVariable(name, BOOL, Bit(x), (False, True), moves=any(p.moves for p in held))
