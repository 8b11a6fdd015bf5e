"""Decoding of states: the values that bits stand for, with the expressions that read them.

A *place* is a scalar of a configuration, or an atom over opaque values, with the values that its
bits tell apart. What its bits say counts only where it is *inside*: set, within the length of its
list, and in the range that is followed. Elsewhere it is ``OUTSIDE``, whatever it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Any, TypeAlias, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.domain import Constant
from koord.semantics.storage import Cell, Storage
from koord.semantics.values import Rec, Seq, Value
from koord.syntax import core
from koord.syntax.analysis.footprint import WriteExtent, footprint, statuses
from koord.syntax.analysis.sorts import Fields, Items, Scalar, Shape
from koord.syntax.analysis.symmetry import Symmetry
from koord.syntax.core import BinaryOp, Home
from koord.syntax.system import Status
from koord.syntax.types import (
    BOOL,
    INT,
    ArrayType,
    GrowingType,
    IntType,
    RecordType,
    SequenceType,
    StreamType,
    StringType,
    Type,
    is_by_robot,
)
from koord.syntax.walk import last_site, rebuilt
from koord.verify.engines.bits.cells import as_constant
from koord.verify.engines.bits.circuit import Circuit
from koord.verify.engines.bits.domain import Bit, BitDomain, Bits, literal
from koord.verify.engines.bits.graph import FALSE, TRUE, Graph
from koord.verify.engines.bits.numbers import Number
from koord.verify.engines.bits.opaque import EQUALS, Argument, OpaqueChoice
from koord.verify.ledger import VerificationProblem

#: A place that may have more values than that is not spoken of.
MANY_VALUES = 300


T = TypeVar("T")


class Outside(Struct, frozen=True):
    """The value of a place that is not inside."""


OUTSIDE = Outside()

#: What a place may hold: a scalar of the text, or nothing that is known.
Held: TypeAlias = "Constant | Outside"


class StateVariable(Struct, frozen=True):
    """A scalar of a configuration. In what reads it, bound variable k stands for ``robots[k]``.

    ``type`` is None for a robot's status and for the event that it ran last. ``may_fault`` says
    whether to read it outside is a fault; ``moves`` whether the environment may change it, and
    ``written`` whether anything does. ``of_robots``: its integers are robots, where they may change
    places.
    """

    expr: core.Expr
    robots: tuple[int, ...]
    type: Type | None
    bits: Bits
    values: tuple[Held, ...]
    inside: int = TRUE
    may_fault: bool = False
    moves: bool = False
    written: bool = True
    of_robots: bool = False

    def of(self, robots: Sequence[core.Expr]) -> core.Expr:
        """The expression about other robots."""
        found: core.Expr = _of(self.expr, robots)
        return found

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


def _of(node: Any, robots: Sequence[core.Expr]) -> Any:
    match node:
        case core.Read(place=core.Place(variable=core.Variable(home=Home.BOUND, slot=slot))):
            return robots[slot]
        case core.Variable():
            return node
        case _:
            return rebuilt(node, lambda part: _of(part, robots))


def _robot(k: int) -> core.Read:
    return core.Read(core.Place(core.Variable(Home.BOUND, k, f"robot{k}", INT)))


def _matches(g: Graph, literals: tuple[int, ...], code: int) -> int:
    return g.all_of(x if (code >> k) & 1 else x ^ 1 for k, x in enumerate(literals))


class _At(Struct, frozen=True):
    """A part of a variable, and properties that it inherits from that."""

    d: BitDomain
    moves: bool
    written: WriteExtent
    place: core.Place
    robots: tuple[int, ...]

    def field(self, position: int, label: str, type_: Type) -> _At:
        return replace(self, place=self.place.part(core.FieldStep(position, label, type_)))

    def element(self, k: int, type_: Type, *, of_robot: bool) -> _At:
        if not of_robot:
            index: core.Expr = core.Const(k, INT)
            return replace(self, place=self.place.part(core.IndexStep(index, type_)))
        index = _robot(len(self.robots))
        place = self.place.part(core.IndexStep(index, type_))
        return replace(self, place=place, robots=(*self.robots, k))


def places_of(
    problem: VerificationProblem, circuit: Circuit, symmetry: Symmetry | None
) -> tuple[StateVariable, ...]:
    """All places of a state whose values are few enough, with their types in the text."""
    found = list(_variables(problem, circuit, symmetry))
    found += _atoms(problem.original.program, circuit, found)
    return tuple(p for p in found if p.values)


def _variables(
    problem: VerificationProblem, circuit: Circuit, symmetry: Symmetry | None
) -> Iterator[StateVariable]:
    program, state, d = problem.original.program, circuit.start, circuit.d
    print_, sensed = footprint(problem.system.program), _sensed(program)
    few = (None,) * len(program.allread), (None,) * len(program.allwrite)
    entries, shared = (symmetry.entries, symmetry.allwrite) if symmetry else few

    def at(v: core.Variable, kind: int, robots: tuple[int, ...] = ()) -> _At:
        how = print_.get((v.home, kind, v.slot), WriteExtent.NEVER)
        moves = v.home is Home.PORT and (kind, v.slot) in sensed
        return _At(d, moves, how, core.Place(v, (), _robot(0) if robots else None), robots)

    for slot, entry in enumerate(program.allread):
        type_ = entry.variable.type
        assert isinstance(type_, ArrayType)
        stored = state.store.allread[slot]
        for i, part in enumerate(() if isinstance(stored, Cell) else stored.parts):
            element = at(entry.variable, 0).element(i, type_.element, of_robot=True)
            yield from _stored(element, part, entries[slot])
    for slot, entry in enumerate(program.allwrite):
        stored = state.store.allwrite[slot]
        yield from _stored(at(entry.variable, 0), stored, shared[slot])
    possible = statuses(problem.system.program)
    for i, robot in enumerate(state.robots):
        agent, kind = program.agents[robot.kind], robot.kind
        for slot, entry in enumerate(agent.locals):
            shape = symmetry.locals[kind][slot] if symmetry else None
            yield from _stored(at(entry.variable, kind, (i,)), robot.locals[slot], shape)
        for slot, port in enumerate(agent.ports):
            shape = symmetry.ports[kind][slot] if symmetry else None
            v = port.declaration.variable
            yield from _stored(at(v, kind, (i,)), robot.ports[slot], shape)
        # Robots that all asked are stopped at the end of the program turns only.
        asks, stopped = Status.ASKED in possible[kind], core.Stopped(_robot(0))
        states = tuple(_values(d, INT, robot.status))
        yield StateVariable(stopped, (i,), None, robot.status, states, moves=asks)
        ran = tuple(_values(d, INT, robot.ran))
        yield StateVariable(core.Ran((), _robot(0)), (i,), None, robot.ran, ran, moves=True)


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


def _stored(at: _At, stored: Storage[Bits], shape: Shape | None) -> Iterator[StateVariable]:
    if isinstance(stored, Cell):
        yield from _valued(at, stored.value, shape, literal(stored.is_set))
        return
    for below, part, its_shape in _parts(at, stored.parts, shape):
        yield from _stored(below, part, its_shape)


def _parts(
    at: _At, parts: tuple[T, ...], shape: Shape | None
) -> Iterator[tuple[_At, T, Shape | None]]:
    """Yield fields and elements."""
    match at.place.type:
        case RecordType(fields=fields):
            for k, ((label, its_type), part) in enumerate(zip(fields, parts, strict=True)):
                inner = shape.parts[k] if isinstance(shape, Fields) else None
                yield at.field(k, label, its_type), part, inner
        case SequenceType(element=element) as type_:
            of_robot = is_by_robot(type_)
            inner = shape.element if isinstance(shape, Items) else None
            for k, part in enumerate(parts):
                yield at.element(k, element, of_robot=of_robot), part, inner


def _valued(
    at: _At, value: Value[Bits], shape: Shape | None, inside: int
) -> Iterator[StateVariable]:
    d, type_ = at.d, at.place.type
    match value:
        case Rec(fields=parts):
            for below, part, its_shape in _parts(at, parts, shape):
                yield from _valued(below, part, its_shape, inside)
        case Seq(length=length, items=items):
            listed = isinstance(type_, GrowingType)
            if listed and at.written is not WriteExtent.PARTS:
                counted = core.Builtin(core.ListOp.LENGTH, (core.Read(at.place),), INT)
                yield from _scalar(at, counted, length, None, inside)
            for k, (below, item, its_shape) in enumerate(_parts(at, items, shape)):
                there = inside
                if listed:
                    longer = literal(d.binary(BinaryOp.LT, d.const(k, INT), length))
                    there = d.graph.both(inside, longer)
                yield from _valued(below, item, its_shape, there)
        case Bit() | Number() | OpaqueChoice() | bool() | int() | Fraction() | str():
            yield from _scalar(at, core.Read(at.place), value, shape, inside)
        case _:
            return  # a map: it has no place for each key


def _scalar(
    at: _At, expr: core.Expr, bits: Bits, shape: Shape | None, inside: int
) -> Iterator[StateVariable]:
    type_ = expr.type
    if isinstance(type_, StreamType):
        return
    faults, written = inside != TRUE, at.written is not WriteExtent.NEVER
    if isinstance(bits, Number) and bits.loose != FALSE:
        inside = at.d.graph.both(inside, bits.loose ^ 1)
    values = tuple(_values(at.d, type_, bits))
    outside = (OUTSIDE,) if values and inside != TRUE else ()
    of_robots = isinstance(shape, Scalar) and isinstance(type_, IntType)
    yield StateVariable(
        expr,
        at.robots,
        type_,
        bits,
        (*values, *outside),
        inside,
        faults,
        at.moves,
        written,
        of_robots,
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


def _atoms(
    program: core.Program, circuit: Circuit, known: list[StateVariable]
) -> Iterator[StateVariable]:
    """Yield the relations, and equalities, of opaque values that variables hold, as places."""
    latches = {latch.literal for latch in circuit.latches}
    holders: dict[Argument, StateVariable] = {}
    for place in known:
        if isinstance(place.bits, OpaqueChoice) and place.inside == TRUE:
            holders.setdefault(place.bits.parts[0][0], place)
    site = last_site(program)
    for (relation, arguments), x in circuit.d.opaques.atoms.get(1, {}).items():
        held = [holders[a] for a in arguments if a in holders]
        if x not in latches or len(held) < len(arguments):
            continue
        operands: list[core.Expr] = []
        robots: tuple[int, ...] = ()
        for place in held:
            operands.append(place.of([_robot(len(robots) + k) for k, _ in enumerate(place.robots)]))
            robots += place.robots
        expr: core.Expr
        if relation == EQUALS:
            expr = core.Binary(BinaryOp.EQ, operands[0], operands[1], BOOL)
        else:
            site += 1
            expr = core.ExternalCall(relation, tuple(operands), BOOL, site)
        moves = any(p.moves for p in held)
        yield StateVariable(expr, robots, BOOL, Bit(x), (False, True), moves=moves)
