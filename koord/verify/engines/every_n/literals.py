"""Literals of lemmas, and what they are worth in configurations that somebody looked at.

A literal is a truth value, a member of an enumeration, or a comparison of two integers of one
kind, of robots i and j, shared variables, and elements of fixed arrays at an index k (elements of
arrays over robots are the robots' own); or, where
a program asks such things of all robots at once, that *there is* a robot of which one of them
holds. Each can be said in Koord, and worked out in a *snapshot*: the values that a sample or a
solver's model gives.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from functools import partial
from typing import TypeAlias, TypeVar

from msgspec import Struct

from koord.semantics.configurations import Configuration, Robot, Store
from koord.semantics.domain import Constant
from koord.semantics.storage import Cell, Storage, Tree
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, ListOp, QuantifierKind, UnaryOp
from koord.syntax.types import (
    BOOL,
    INT,
    ArrayType,
    BoolType,
    EnumType,
    IntType,
    RecordType,
    Robots,
    Type,
)
from koord.syntax.walk import nodes
from koord.verify.engines.every_n.kinds_of_integers import ROBOT, KindsOfIntegers, key_of

I = core.Variable(Home.BOUND, 0, "i", INT)  # noqa: E741 - as properties call it
J = core.Variable(Home.BOUND, 1, "j", INT)
K = core.Variable(Home.BOUND, 2, "k", INT)

READ_I, READ_J, READ_K = (core.Read(core.Place(v)) for v in (I, J, K))

#: How many constants of a kind integers are compared with.
_MOST_CONSTANTS = 4

#: Integers of one robot are compared with other integers of another where so few may be.
_FEW = 2

_SHARED = (Home.ALLREAD, Home.ALLWRITE)

#: More literals are not looked at: disjunctions of three of them would be too many.
_MOST_LITERALS = 160


V = TypeVar("V")

#: What a robot has, by home and slot: of what is an array over robots, its element.
Held: TypeAlias = "Mapping[Home, Mapping[int, Storage[V]]]"


class Part(Struct, frozen=True):
    """A scalar part of a variable. ``steps`` lead to it; an index stands at most once, and is k."""

    variable: core.Variable
    steps: tuple[core.Step, ...]
    type: Type
    size: int | None = None  #: of the array that k is an index of

    def at(self, robot: core.Expr | None) -> core.Expr:
        """The part as an expression, of a robot if each robot has it."""
        element = element_of(self.variable)
        if element is not None:
            assert robot is not None
            own = core.IndexStep(robot, element)
            return core.Read(core.Place(self.variable, (own, *self.steps)))
        return core.Read(core.Place(self.variable, self.steps, robot=robot))


def element_of(variable: core.Variable) -> Type | None:
    """The type of each robot's element of a shared array over robots; None of anything else."""
    match variable.type:
        case ArrayType(element=element, size=Robots.ALL) if variable.home in _SHARED:
            return element
    return None


#: The value of what is not set. Whatever reads it does not hold. [PROP-FAULT]
UNSET = object()


class Snapshot(Struct):
    """The values of a configuration's parts, as far as they are known.

    Of a part with an index it is a tuple. ``robots`` are those known, by number.
    """

    robots: dict[int, tuple[object, ...]]
    shared: tuple[object, ...]


#: Robots i and j (None: there is no other), and the index k.
Row: TypeAlias = "tuple[int, int | None, int]"


class Quantity(Struct, frozen=True):
    """A term: a part of robot i (1) or j (2), a shared part (0), a robot, k, a constant.

    ``look`` gives its value; None where it is unknown.
    """

    said: core.Expr
    of: int
    indexed: bool
    position: int = -1  #: among the parts
    value: Constant | None = None

    def look(self, here: Snapshot, row: Row) -> object:
        if self.value is not None:
            return self.value
        robot = row[0] if self.of == 1 else row[1]
        if self.of and robot is None:
            return None
        if self.position < 0:
            return robot if self.of else row[2]
        held = here.robots[robot] if robot is not None and self.of else here.shared
        found = held[self.position]
        if self.indexed:
            assert isinstance(found, tuple)
            return found[row[2]]
        return found


class Literal(Struct, frozen=True):
    """An atom or its negation: ``left op right``, or ``left`` is ``right``'s value."""

    left: Quantity
    op: BinaryOp
    right: Quantity
    positive: bool
    cost: int

    @property
    def of(self) -> int:
        """The robots that it is about: 1 of i, 2 of j, 3 of both."""
        return self.left.of | self.right.of

    @property
    def indexed(self) -> bool:
        return self.left.indexed or self.right.indexed

    def look(self, here: Snapshot, row: Row) -> bool | None:
        """The truth of the literal; None where it is about a robot that is unknown."""
        a, b = self.left.look(here, row), self.right.look(here, row)
        return compared(a, self.op, b, positive=self.positive)

    def said(self, *, denied: bool = False) -> core.Expr:
        """The literal, or its negation, in Koord."""
        left, right, positive = self.left.said, self.right.said, self.positive is not denied
        if left.type == BOOL:
            return left if positive else core.Unary(UnaryOp.NOT, left, BOOL)
        if self.op is BinaryOp.EQ:
            op = BinaryOp.EQ if positive else BinaryOp.NE
            return core.Binary(op, left, right, BOOL)
        if positive:
            return core.Binary(BinaryOp.LE, left, right, BOOL)
        return core.Binary(BinaryOp.LT, right, left, BOOL)


def compared(a: object, op: BinaryOp, b: object, *, positive: bool) -> bool | None:
    """The truth of a comparison of two values, or of its negation."""
    if a is None or b is None:
        return None
    if a is UNSET or b is UNSET:
        return False
    if op is BinaryOp.EQ:
        return (a == b) is positive
    assert isinstance(a, int)
    assert isinstance(b, int)
    return (a <= b) is positive


class Existence(Struct, frozen=True):
    """That there is a robot of which a literal (of robot i) holds.

    Of the robots of a snapshot that is: a robot that somebody has to find is not in it. That there
    is none is said of robot i or j.
    """

    witness: Literal

    @property
    def of(self) -> int:
        return 0

    @property
    def indexed(self) -> bool:
        return self.witness.indexed

    @property
    def cost(self) -> int:
        return self.witness.cost + 2

    def look(self, here: Snapshot, row: Row) -> bool:
        return any(self.witness.look(here, (robot, None, row[2])) is True for robot in here.robots)


#: What a disjunction consists of.
AnyLiteral: TypeAlias = "Literal | Existence"


def follows(weaker: AnyLiteral, stronger: AnyLiteral) -> bool:
    """Return whether it can be seen at once that a literal follows from another."""
    if isinstance(weaker, Literal) and isinstance(stronger, Existence):
        return False
    whose = isinstance(weaker, Literal)
    a = weaker if isinstance(weaker, Literal) else weaker.witness
    b = stronger if isinstance(stronger, Literal) else stronger.witness
    if a.op is not b.op or twin_of(a.left, whose=whose) != twin_of(b.left, whose=whose):
        return False
    if twin_of(a.right, whose=whose) == twin_of(b.right, whose=whose):
        return a.positive is b.positive
    constants = a.right.value is not None and b.right.value is not None
    return constants and a.op is BinaryOp.EQ and b.positive and not a.positive


class Language(Struct, frozen=True):
    """The parts and literals of a program with one kind of robots."""

    own: tuple[Part, ...]
    shared: tuple[Part, ...]
    literals: tuple[AnyLiteral, ...]
    swapped: tuple[int, ...]  #: by literal: the one with i and j exchanged
    size: int  #: of the arrays that k is an index of; 1 if there is no k

    @staticmethod
    def of_program(program: core.Program) -> Language:
        agent = program.agents[0]
        declared = (*agent.locals, *(port.declaration for port in agent.ports))
        own = [p for d in declared for p in _parts(d.variable, (), d.variable.type)]
        shared: list[Part] = []
        for d in (*program.allread, *program.allwrite):
            element = element_of(d.variable)
            if element is not None:
                own += _parts(d.variable, (), element)
            else:
                shared += _parts(d.variable, (), d.variable.type)
        sizes = [part.size for part in (*own, *shared) if part.size is not None]
        size = max(sizes, key=sizes.count, default=1)
        own = [part for part in own if part.size in (None, size)]
        shared = [part for part in shared if part.size in (None, size)]
        literals = _literals(program, own, shared, size if sizes else None)[:_MOST_LITERALS]
        places = {(twin_of(x.left), x.op, twin_of(x.right), x.positive): x for x in literals}
        numbers = {id(x): number for number, x in enumerate(literals)}
        swapped = []
        for number, x in enumerate(literals):
            twin = places.get((_exchanged(x.left), x.op, _exchanged(x.right), x.positive))
            if twin is None and x.op is BinaryOp.EQ:
                twin = places.get((_exchanged(x.right), x.op, _exchanged(x.left), x.positive))
            swapped.append(number if twin is None else numbers[id(twin)])
        said: list[AnyLiteral] = [*literals]
        if asks_everybody(program):
            said += _existences(literals)[: _MOST_LITERALS - len(said)]
        swapped += range(len(swapped), len(said))
        return Language(tuple(own), tuple(shared), tuple(said), tuple(swapped), size)

    def snapshot(
        self,
        robots: Mapping[int, Held[V]],
        shared: Sequence[Storage[V]],
        read: Callable[[Cell[V], Type], object],
    ) -> Snapshot:
        """The values of a configuration."""
        known = {
            number: tuple(
                _value(held[part.variable.home][part.variable.slot], part, read)
                for part in self.own
            )
            for number, held in robots.items()
        }
        common = tuple(_value(shared[part.variable.slot], part, read) for part in self.shared)
        return Snapshot(known, common)

    def sampled(self, configuration: Configuration[Constant]) -> Snapshot:
        """The values of a configuration that was reached."""
        store = configuration.store

        def element(storage: Storage[Constant], number: int) -> Storage[Constant]:
            assert isinstance(storage, Tree)
            return storage.parts[number]

        robots = {
            number: self.held(robot, store, partial(element, number=number))
            for number, robot in enumerate(configuration.robots)
        }
        return self.snapshot(robots, store.allwrite, _set_value)

    def held(
        self, robot: Robot[V], store: Store[V], element: Callable[[Storage[V]], Storage[V]]
    ) -> Held[V]:
        """What a robot has; ``element`` takes its element of an array over robots."""
        shared: dict[Home, dict[int, Storage[V]]] = {home: {} for home in _SHARED}
        for variable in dict.fromkeys(part.variable for part in self.own):
            if variable.home in shared:
                whole = store.allread if variable.home is Home.ALLREAD else store.allwrite
                shared[variable.home][variable.slot] = element(whole[variable.slot])
        own = {Home.LOCAL: robot.locals, Home.PORT: robot.ports}
        return shared | {home: dict(enumerate(kept)) for home, kept in own.items()}

    def rows(self, here: Snapshot) -> Iterator[Row]:
        """The choices of i, j and k: pairs of different robots, or one where there is no other."""
        numbers = list(here.robots)
        for i in numbers:
            for k in range(self.size):
                if len(numbers) == 1:
                    yield i, None, k
                for j in numbers:
                    if j != i:
                        yield i, j, k


def _set_value(cell: Cell[Constant], type_: Type) -> object:
    return cell.value if cell.is_set is True else UNSET


def _value(storage: Storage[V], part: Part, read: Callable[[Cell[V], Type], object]) -> object:
    steps = part.steps
    for k, step in enumerate(steps):
        assert isinstance(storage, Tree)
        if isinstance(step, core.IndexStep):
            rest = Part(part.variable, steps[k + 1 :], part.type)
            return tuple(_value(below, rest, read) for below in storage.parts)
        assert isinstance(step, core.FieldStep)
        storage = storage.parts[step.position]
    assert isinstance(storage, Cell)
    return read(storage, part.type)


def _parts(
    variable: core.Variable, steps: tuple[core.Step, ...], type_: Type, size: int | None = None
) -> Iterator[Part]:
    match type_:
        case BoolType() | IntType() | EnumType():
            yield Part(variable, steps, type_, size)
        case RecordType(fields=fields):
            for position, (name, below) in enumerate(fields):
                step = core.FieldStep(position, name, below)
                yield from _parts(variable, (*steps, step), below, size)
        case ArrayType(element=element, size=int(count)) if size is None:
            index = core.IndexStep(READ_K, element)
            yield from _parts(variable, (*steps, index), element, count)
        case _:
            return


def twin_of(q: Quantity, *, whose: bool = True) -> tuple[object, ...]:
    """What tells one quantity from another; ``whose``: also those of i from those of j."""
    return q.of if whose else q.of > 0, q.position, q.indexed, q.value, q.said.type


def _exchanged(q: Quantity) -> tuple[object, ...]:
    return {1: 2, 2: 1}.get(q.of, 0), q.position, q.indexed, q.value, q.said.type


# --- literals -----------------------------------------------------------------------------------


def _literals(
    program: core.Program, own: Sequence[Part], shared: Sequence[Part], size: int | None
) -> list[Literal]:
    """All literals, the simplest first."""
    quantities = [
        *(Quantity(p.at(READ_I), 1, p.size is not None, n) for n, p in enumerate(own)),
        *(Quantity(p.at(READ_J), 2, p.size is not None, n) for n, p in enumerate(own)),
        *(Quantity(p.at(None), 0, p.size is not None, n) for n, p in enumerate(shared)),
    ]
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


def _is_weak(left: Quantity, right: Quantity, *, positive: bool) -> bool:
    """Return whether a literal says of one of several values that it is not the one."""
    return not positive and right.value is not None and left.said.type != BOOL


def _existences(literals: Sequence[Literal]) -> list[AnyLiteral]:
    """That there is a robot of which a literal holds."""
    return [Existence(x) for x in literals if x.of == 1]


def asks_everybody(program: core.Program) -> bool:
    """Return whether events or claims ask whether some robot, or every one, is so."""
    claims = [_under_robots(stated.condition) for stated in program.properties]
    bodies = [function.body for function in program.functions]
    return any(
        (isinstance(node, core.Quantified) and isinstance(node.domain, core.RobotRange))
        or (isinstance(node, core.ForRange) and any(_counts(n) for n in nodes(node.high)))
        or (isinstance(node, core.Builtin) and node.op in (ListOp.ANY, ListOp.ALL))
        for node in nodes((program.agents, bodies, claims))
    )


def _counts(node: object) -> bool:
    return isinstance(node, core.NumAgents)


def _under_robots(condition: core.Expr) -> core.Expr:
    """What a statement says of the robots that it is about."""
    while (
        isinstance(condition, core.Quantified)
        and condition.quantifier is QuantifierKind.FORALL
        and isinstance(condition.domain, core.RobotRange)
    ):
        condition = condition.body
    return condition


def _constant(value: Constant, type_: Type) -> Quantity:
    assert isinstance(value, int)
    if isinstance(type_, IntType) and value < 0:
        inner = core.Const(-value, type_)
        return Quantity(core.Unary(UnaryOp.NEG, inner, INT), 0, False, value=value)
    return Quantity(core.Const(value, type_), 0, False, value=value)


def _comparisons(
    program: core.Program, integers: Sequence[Quantity], size: int | None
) -> Iterator[tuple[Quantity, BinaryOp, Quantity, int]]:
    """Yield comparisons of integers of one kind."""
    kinds = KindsOfIntegers.of(program)
    by_kind: dict[Hashable, list[Quantity]] = {}
    for q in integers:
        assert isinstance(q.said, core.Read)
        by_kind.setdefault(kinds.kind(key_of(q.said.place, 0)), []).append(q)
    i, j = Quantity(READ_I, 1, False), Quantity(READ_J, 2, False)
    by_kind.setdefault(kinds.kind(ROBOT), []).extend([i, j])
    k = Quantity(READ_K, 0, True)
    if size is not None:
        by_kind.setdefault(kinds.kind(("below", size)), []).append(k)
    for kind, members in by_kind.items():
        is_ordered = kinds.is_ordered(kind)
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
