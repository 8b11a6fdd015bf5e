"""Literals of a program by the types of its variables: what integers and truth values may say."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence

from koord.semantics.domain import Constant
from koord.syntax import core
from koord.syntax.core import BinaryOp, ListOp, UnaryOp
from koord.syntax.types import BOOL, INT, BoolType, EnumType, IntType, Type
from koord.syntax.walk import nodes
from koord.verify.engines.every_n.bound import READ_H, READ_I, READ_J, READ_K
from koord.verify.engines.every_n.kinds_of_integers import ROBOT, KindsOfIntegers, key_of
from koord.verify.engines.every_n.literals import (
    COUNT,
    OF_H,
    OF_I,
    OF_J,
    AnyLiteral,
    Existence,
    Literal,
    Quantity,
)
from koord.verify.engines.every_n.parts import Part

#: How many constants of a kind integers are compared with.
_MOST_CONSTANTS = 4

#: Integers of one robot are compared with other integers of another where so few may be.
_FEW = 2


def quantities_of_two(
    own: Sequence[Part], mutual: Sequence[Part], shared: Sequence[Part]
) -> list[Quantity]:
    """What literals of two robots compare."""
    both = OF_I | OF_J
    pairs = ((OF_I, READ_I, READ_J), (OF_J, READ_J, READ_I))
    return [
        *quantities_of(OF_I, own),
        *quantities_of(OF_J, own),
        *(
            Quantity(p.at(owner, other), both, False, n, owner=bit)
            for bit, owner, other in pairs
            for n, p in enumerate(mutual)
        ),
        *(Quantity(p.at(None), 0, p.size is not None, n) for n, p in enumerate(shared)),
    ]


def quantities_of(robot: int, own: Sequence[Part]) -> list[Quantity]:
    said = {OF_I: READ_I, OF_J: READ_J, OF_H: READ_H}[robot]
    return [Quantity(p.at(said), robot, p.size is not None, n) for n, p in enumerate(own)]


def literals_of(
    program: core.Program, quantities: Sequence[Quantity], size: int | None
) -> list[Literal]:
    """All literals, the simplest first."""
    atoms: list[tuple[Quantity, BinaryOp, Quantity, int]] = []
    for q in quantities:
        match q.said.type:
            case BoolType():
                atoms.append((q, BinaryOp.EQ, _constant(True, BOOL), 1))
            case EnumType(members=members) as type_:
                for number in range(len(members)):
                    atoms.append((q, BinaryOp.EQ, _constant(number, type_), 1))
            case _:
                pass
    atoms += _comparisons(program, [q for q in quantities if q.said.type == INT], size)
    atoms.sort(key=lambda atom: atom[3])
    return [
        Literal(left, op, right, positive, cost + _is_weak(left, right, positive=positive))
        for left, op, right, cost in atoms
        for positive in (True, False)
    ]


def is_about_numbers(x: Literal) -> bool:
    """Return whether a literal compares with a robot's own number: in a ring that says little."""
    return any(q.of and q.position == -1 for q in (x.left, x.right))


def _is_weak(left: Quantity, right: Quantity, *, positive: bool) -> bool:
    """Return whether a literal says of one of several values that it is not the one."""
    return not positive and right.value is not None and left.said.type != BOOL


def existences(literals: Sequence[AnyLiteral]) -> list[AnyLiteral]:
    """That there is a robot of which a literal holds."""
    return [Existence(x) for x in literals if isinstance(x, Literal) and x.of == OF_I]


def asks_everybody(program: core.Program) -> bool:
    """Return whether events ask whether some robot, or every one, is so."""
    return any(
        (isinstance(node, core.Quantified) and isinstance(node.domain, core.RobotRange))
        or (isinstance(node, core.ForRange) and any(_counts(n) for n in nodes(node.high)))
        or (isinstance(node, core.Builtin) and node.op in (ListOp.ANY, ListOp.ALL))
        for node in nodes(program.agents)
    )


def is_ring(program: core.Program) -> bool:
    """Return whether robots speak of the next one round a ring: of the last number, or modulo."""
    said = (
        tuple(agent.events for agent in program.agents),
        tuple(function.body for function in program.functions),
    )
    return any(
        (node.op is BinaryOp.MOD and _counts(node.right))
        or (node.op is BinaryOp.SUB and _counts(node.left) and node.right == core.Const(1, INT))
        for node in nodes(said)
        if isinstance(node, core.Binary)
    )


def _counts(node: object) -> bool:
    return isinstance(node, core.NumAgents)


def _constant(value: Constant, type_: Type) -> Quantity:
    assert isinstance(value, int)
    if isinstance(type_, IntType) and value < 0:
        inner = core.Const(-value, type_)
        return Quantity(core.Unary(UnaryOp.NEG, inner, INT), 0, False, value=value)
    return Quantity(core.Const(value, type_), 0, False, value=value)


#: How many robots there are.
_NUMBER = Quantity(core.NumAgents(INT), 0, False, COUNT)


def _comparisons(
    program: core.Program, integers: Sequence[Quantity], size: int | None
) -> Iterator[tuple[Quantity, BinaryOp, Quantity, int]]:
    """Yield comparisons of integers of one kind."""
    kinds = KindsOfIntegers.of(program)
    by_kind: dict[Hashable, list[Quantity]] = {}
    for q in integers:
        assert isinstance(q.said, core.Read)
        by_kind.setdefault(kinds.kind(key_of(q.said.place, 0)), []).append(q)
    i, j = Quantity(READ_I, OF_I, False), Quantity(READ_J, OF_J, False)
    by_kind.setdefault(kinds.kind(ROBOT), []).extend([i, j])
    k = Quantity(READ_K, 0, True)
    if size is not None:
        by_kind.setdefault(kinds.kind(("below", size)), []).append(k)
    for kind, members in by_kind.items():
        is_ordered, is_robot = kinds.is_ordered(kind), i in members
        few = len({q.position for q in members if q.of}) <= _FEW
        constants = kinds.constants(kind)[:_MOST_CONSTANTS]
        if k in members and size is not None:
            # Where an index may point.
            constants, is_ordered = list(dict.fromkeys([*constants, 0, size])), True
        for constant in constants:
            c = _constant(constant, INT)
            for q in members:
                if q.position >= 0:
                    yield q, BinaryOp.EQ, c, 2
                if q.position >= 0 and is_ordered:
                    yield q, BinaryOp.LE, c, 4
                    yield c, BinaryOp.LE, q, 4
        if is_robot:
            # Whether there is a robot of that number.
            for q in members:
                if q.position >= 0:
                    yield _constant(0, INT), BinaryOp.LE, q, 5
                    yield _NUMBER, BinaryOp.LE, q, 5
        for a, b in ((a, b) for n, a in enumerate(members) for b in members[n + 1 :]):
            numbers = (a.position < 0) + (b.position < 0)
            of_two = a.of and b.of and a.of != b.of and a.position != b.position
            if of_two and not few and not numbers:
                continue
            if numbers < 2:
                yield a, BinaryOp.EQ, b, 2
            if is_ordered and k not in (a, b):
                yield a, BinaryOp.LE, b, 3
                yield b, BinaryOp.LE, a, 3
