"""Candidate invariants about one robot, or two, for Houdini.

They are made of what the program itself speaks of: states that its variables can be in (truth
values, members of enumerations, constants that they are compared with), the comparisons in its
guards, which numbers are remainders, who holds an allwrite variable, and how the numbers of two
robots compare.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, PropertyKind, UnaryOp
from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    RecordType,
    Robots,
    Type,
)
from koord.syntax.walk import nodes, rebuilt
from koord.verify.claims import Claim, ClaimKind

#: More are not worth the time that they take.
MOST_CANDIDATES = 700

#: So few are tried before other engines get their turn: in about 0.1 s.
FEW = 64

X = core.Variable(Home.BOUND, 0, "i", INT)
Y = core.Variable(Home.BOUND, 1, "j", INT)

_READ_X, _READ_Y = core.Read(core.Place(X)), core.Read(core.Place(Y))


def candidates(program: core.Program) -> tuple[Claim, ...]:
    """The candidate invariants of a program with one kind of robots; none for others."""
    from koord.syntax.printing.quoting import Quoting

    if len(program.agents) != 1:
        return ()
    found: dict[str, Claim] = {}
    quoting = Quoting.of(program)
    for condition in filter(_is_plain, _conditions(Vocabulary(program))):
        text = quoting.text(condition)
        stated = core.Property(text, PropertyKind.INVARIANT, condition, 2)
        found.setdefault(text, Claim(text, ClaimKind.PROPERTY, stated))
        if len(found) >= MOST_CANDIDATES:
            break
    return tuple(found.values())


#: What looks into lists and maps, or makes them.
_COMPOUND = (
    core.KeyStep | core.Builtin | core.Select | core.MakeList | core.MakeMap | core.MakeRecord
)


def _is_plain(condition: core.Expr) -> bool:
    """Return whether a statement is about scalars of robots only: others hardly ever help."""
    return not any(
        isinstance(node, _COMPOUND)
        or (isinstance(node, core.Const) and isinstance(node.value, str))
        or (isinstance(node, core.Place) and node.variable.home is Home.BOUND and node.steps)
        for node in nodes(condition)
    )


def _conditions(v: Vocabulary) -> Iterator[core.Expr]:
    """Yield closed statements, the simplest first."""
    states = v.states(_READ_X)
    facts = [*v.facts(_READ_X)]
    for fact in facts:
        yield _of_all(fact)
    for state, fact in product(states, [*states, *facts]):
        if not _same_subject(state, fact):
            yield _of_all(binary(BinaryOp.IMPLIES, state, fact))
    apart = binary(BinaryOp.NE, _READ_X, _READ_Y)
    relations = list(v.relations())
    for relation in relations:
        yield _of_pairs(relation)
    others = v.states(_READ_Y)
    pairs = [
        (k, n, binary(BinaryOp.AND, first, second))
        for (k, first), (n, second) in product(enumerate(states), enumerate(others))
        # Two robots cannot both be the one that a shared variable names.
        if not _same_subject(first, second)
    ]
    for k, n, both in pairs:
        if k <= n:
            yield _of_pairs(binary(BinaryOp.IMPLIES, apart, negated(both)))
    for _, _, both in pairs:
        for relation in relations:
            pair = binary(BinaryOp.AND, apart, both)
            yield _of_pairs(binary(BinaryOp.IMPLIES, pair, relation))


class Vocabulary(Struct, frozen=True):
    """The atoms of a program from which candidates are built."""

    program: core.Program

    @property
    def agent(self) -> core.Agent:
        return self.program.agents[0]

    # --- terms ----------------------------------------------------------------------------------

    def own(self, robot: core.Expr) -> Iterator[core.Expr]:
        """The scalars that each robot holds."""
        for entry in (*self.agent.locals, *(port.declaration for port in self.agent.ports)):
            yield from _scalars(core.Place(entry.variable, robot=robot))
        for entry in self.program.allread:
            type_ = entry.variable.type
            assert isinstance(type_, ArrayType)
            step = core.IndexStep(robot, type_.element)
            yield from _scalars(core.Place(entry.variable, (step,)))

    def shared(self) -> Iterator[core.Expr]:
        """The shared scalars."""
        for entry in self.program.allwrite:
            yield from _scalars(core.Place(entry.variable))

    def constants(self, type_: Type) -> list[core.Expr]:
        """A few numbers that the program mentions."""
        found = dict.fromkeys(
            node.value
            for node in nodes((self.agent.init, self.agent.events, self.program.allwrite))
            if isinstance(node, core.Const) and node.type == type_
        )
        for entry in (*self.agent.locals, *self.program.allread, *self.program.allwrite):
            if isinstance(entry.initial, core.Const) and entry.initial.type == type_:
                found[entry.initial.value] = None
        return [core.Const(value, type_) for value in list(found)[:4]]

    # --- literals -------------------------------------------------------------------------------

    def states(self, robot: core.Expr) -> list[core.Expr]:
        """The atoms on a robot's state: truth values, enumeration members, robots' numbers."""
        found: list[core.Expr] = []
        for term in self.own(robot):
            match term.type:
                case BoolType():
                    found += [term, negated(term)]
                case EnumType(members=members):
                    found += [
                        binary(BinaryOp.EQ, term, core.Const(k, term.type))
                        for k in range(len(members))
                    ]
                case IntType():
                    for constant in self._marks(term):
                        found += [binary(op, term, constant) for op in (BinaryOp.EQ, BinaryOp.NE)]
        for term in self.shared():
            if isinstance(term.type, IntType):
                found.append(binary(BinaryOp.EQ, term, robot))
        return found

    def _marks(self, term: core.Expr) -> list[core.Expr]:
        """The constants that an integer is compared with, which mark its states."""
        assert isinstance(term, core.Read)
        found: dict[core.Expr, None] = {}
        for node in nodes(self.agent.events):
            if isinstance(node, core.Binary) and node.op in (BinaryOp.EQ, BinaryOp.NE):
                for one, other in ((node.left, node.right), (node.right, node.left)):
                    if (
                        isinstance(one, core.Read)
                        and one.place.variable == term.place.variable
                        and isinstance(other, core.Const | core.Unary)
                    ):
                        found[other] = None
        return list(found)[:2]

    def facts(self, robot: core.Expr) -> Iterator[core.Expr]:
        """Yield facts that may hold of a robot: comparisons of guards, of numbers, of elements."""
        yield from self._remainders(robot)
        numbers = [t for t in self.own(robot) if isinstance(t.type, IntType | FloatType)]
        for comparison in self._guards(robot):
            yield from _variants(comparison)
        for one, other in product(numbers, repeat=2):
            if one != other and one.type == other.type:
                yield binary(BinaryOp.LE, one, other)
        for number in numbers:
            for constant in self.constants(number.type):
                yield binary(BinaryOp.LE, constant, number)
                yield binary(BinaryOp.LE, number, constant)
        for number in numbers:
            if isinstance(number.type, IntType):
                yield from self._pointed(number, robot)
        for term in self.shared():
            if isinstance(term.type, BoolType):
                yield term
                yield negated(term)

    def _remainders(self, robot: core.Expr) -> Iterator[core.Expr]:
        """Yield what is so of remainders: they are from 0 up to what something is divided by."""
        for node in nodes(self.agent.events):
            match node:
                case core.Assign(value=core.Binary(op=BinaryOp.MOD, right=right)):
                    number, most = core.Read(for_robot(node.place, robot)), _size(right)
                    if most is not None and _names_itself(node.place):
                        low = binary(BinaryOp.LE, core.Const(0, INT), number)
                        yield binary(BinaryOp.AND, low, binary(BinaryOp.LT, number, most))

    def _pointed(self, index: core.Expr, robot: core.Expr) -> Iterator[core.Expr]:
        """Yield facts of elements of allwrite arrays that an integer of a robot points at."""
        for entry in self.program.allwrite:
            type_ = entry.variable.type
            if not isinstance(type_, ArrayType) or type_.size is Robots.ALL:
                continue
            low = binary(BinaryOp.LE, core.Const(0, INT), index)
            high = binary(BinaryOp.LT, index, core.Const(type_.size, INT))
            inside = binary(BinaryOp.AND, low, high)
            yield inside
            step = core.IndexStep(index, type_.element)
            for part in _scalars(core.Place(entry.variable, (step,))):
                if isinstance(part.type, BoolType):
                    yield binary(BinaryOp.AND, inside, part)
                if isinstance(part.type, IntType):
                    yield binary(BinaryOp.AND, inside, binary(BinaryOp.EQ, part, robot))

    def relations(self) -> Iterator[core.Expr]:
        """Yield comparisons between two robots."""
        for mine, theirs in zip(self.own(_READ_X), self.own(_READ_Y), strict=True):
            if isinstance(mine.type, IntType):
                yield binary(BinaryOp.NE, mine, theirs)
            if isinstance(mine.type, IntType | FloatType):
                yield binary(BinaryOp.EQ, mine, theirs)
                yield binary(BinaryOp.LE, mine, theirs)
                yield binary(BinaryOp.LE, theirs, mine)

    def _guards(self, robot: core.Expr) -> list[core.Binary]:
        """The comparisons of numbers in guards, for a robot."""
        found: dict[core.Binary, None] = {}
        for event in self.agent.events:
            for node in nodes(event.guard):
                if (
                    isinstance(node, core.Binary)
                    and node.op in (BinaryOp.LT, BinaryOp.LE)
                    and not any(isinstance(n, core.Call | core.ExternalCall) for n in nodes(node))
                ):
                    found[for_robot(node, robot)] = None
        return list(found)


# --- expressions --------------------------------------------------------------------------------


def _scalars(place: core.Place) -> Iterator[core.Expr]:
    match place.type:
        case RecordType(fields=parts):
            for k, (name, type_) in enumerate(parts):
                step = core.FieldStep(k, name, type_)
                yield from _scalars(place.part(step))
        case BoolType() | IntType() | FloatType() | EnumType():
            yield core.Read(place)
        case _:
            return


def _size(e: core.Expr) -> core.Expr | None:
    """A number that is the same in all configurations, in few words; None if none is seen."""
    match e:
        case core.Const() | core.NumAgents():
            return e
        case core.Builtin(op=core.ListOp.LENGTH, arguments=(core.MakeList(items=items),)):
            return core.Const(len(items), INT)
        case _:
            return None


def _names_itself(place: core.Place) -> bool:
    """Return whether a robot's number is all that says which element of a variable it is."""
    return all(
        isinstance(step, core.IndexStep) and isinstance(step.index, core.Pid)
        for step in place.steps
    )


def _variants(comparison: core.Binary) -> Iterator[core.Expr]:
    """A comparison, its negation, and both with a round of slack, if it is about reals."""
    left, right = comparison.left, comparison.right
    yield comparison
    other = BinaryOp.LE if comparison.op is BinaryOp.LT else BinaryOp.LT
    yield binary(other, right, left)
    if left.type == FLOAT:
        for one, two in ((left, right), (right, left)):
            later = core.Binary(BinaryOp.ADD, two, core.Delta(FLOAT), FLOAT)
            yield binary(BinaryOp.LE, one, later)
            yield binary(BinaryOp.LT, one, later)


def for_robot(node: Any, robot: core.Expr) -> Any:
    """An expression of a robot's turn as a property's expression about that robot."""
    if isinstance(node, core.Pid):
        return robot
    if isinstance(node, core.Variable):
        return node
    made = rebuilt(node, lambda part: for_robot(part, robot))
    if isinstance(made, core.Place) and made.variable.home in (Home.LOCAL, Home.PORT):
        return replace(made, robot=robot)
    return made


def binary(op: BinaryOp, left: core.Expr, right: core.Expr) -> core.Binary:
    """A comparison, or a connective of two statements."""
    return core.Binary(op, left, right, BOOL)


def negated(e: core.Expr) -> core.Expr:
    """The denial of a statement."""
    return core.Unary(UnaryOp.NOT, e, BOOL)


def _of_all(body: core.Expr) -> core.Expr:
    return core.Quantified(core.QuantifierKind.FORALL, X, core.RobotRange(), body)


def _of_pairs(body: core.Expr) -> core.Expr:
    inner = core.Quantified(core.QuantifierKind.FORALL, Y, core.RobotRange(), body)
    return core.Quantified(core.QuantifierKind.FORALL, X, core.RobotRange(), inner)


def _same_subject(one: core.Expr, other: core.Expr) -> bool:
    """Return whether two states are of one variable, so that neither says anything of the other."""
    return _subject(one) is not None and _subject(one) == _subject(other)


def _subject(e: core.Expr) -> core.Expr | None:
    match e:
        case core.Unary(op=UnaryOp.NOT, operand=operand):
            return _subject(operand)
        case core.Read():
            return e
        case core.Binary(op=BinaryOp.EQ | BinaryOp.NE, left=left):
            return left
        case _:
            return None
