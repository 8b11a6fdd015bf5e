"""The language of lemmas of a program: the parts of its variables, and all literals of them."""

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
from koord.verify.engines.every_n.bound import READ_I, READ_J, READ_K
from koord.verify.engines.every_n.conditions import UNSET, Asked, Condition, conditions_of
from koord.verify.engines.every_n.kinds_of_integers import ROBOT, KindsOfIntegers, key_of
from koord.verify.engines.every_n.literals import (
    COUNT,
    AnyLiteral,
    ConditionLiteral,
    Existence,
    Literal,
    Quantity,
    Row,
    Snapshot,
    twin_of,
)

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


class Language(Struct, frozen=True):
    """The parts and literals of a program with one kind of robots."""

    own: tuple[Part, ...]
    shared: tuple[Part, ...]
    literals: tuple[AnyLiteral, ...]
    conditions: tuple[Condition, ...]
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
        conditions = conditions_of(program, size)
        said: list[AnyLiteral] = [*literals]
        for position, each in enumerate(conditions):
            # Of i, then of j.
            for of in (1, 2) if each.of else (0,):
                for positive in (True, False):
                    said.append(ConditionLiteral(each, position, of, positive))
                    swapped.append(len(swapped) + {0: 0, 1: 2, 2: -2}[of])
        if asks_everybody(program):
            said += _existences(literals)[: max(0, _MOST_LITERALS - len(said))]
        swapped += range(len(swapped), len(said))
        return Language(
            tuple(own), tuple(shared), tuple(said), tuple(conditions), tuple(swapped), size
        )

    def snapshot(
        self,
        robots: Mapping[int, Held[V]],
        shared: Sequence[Storage[V]],
        read: Callable[[Cell[V], Type], object],
        count: int,
        asked: Asked,
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
        return Snapshot(count, known, common, asked)

    def sampled(self, configuration: Configuration[Constant], asked: Asked) -> Snapshot:
        """The values of a configuration that was reached."""
        store = configuration.store

        def element(storage: Storage[Constant], number: int) -> Storage[Constant]:
            assert isinstance(storage, Tree)
            return storage.parts[number]

        robots = {
            number: self.held(robot, store, partial(element, number=number))
            for number, robot in enumerate(configuration.robots)
        }
        return self.snapshot(robots, store.allwrite, _set_value, len(robots), asked)

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
    i, j = Quantity(READ_I, 1, False), Quantity(READ_J, 2, False)
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
