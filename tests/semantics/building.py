"""A small language for writing core programs by hand, slot numbers and spans left out.

b = Build()
total = b.allwrite("total", INT, 0)
done = b.local("done", BOOL, False)
b.event("Add", ~done, b.atomic(total.set(total + PID)), done.set(True))
program = b.program()
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction

from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.core import BinaryOp, Direction, Home, ListOp, UnaryOp
from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    POS,
    STRING,
    ArrayType,
    EnumType,
    ListType,
    MapType,
    QueueType,
    RecordType,
    Robots,
    Type,
)

Literal = int | float | Fraction | bool | str


@dataclass(frozen=True, slots=True)
class E:
    """An expression with Python's operators; one that reads a place can be written to."""

    expr: core.Expr

    @property
    def type(self) -> Type:
        return self.expr.type

    # --- operators ------------------------------------------------------------------------------

    def __add__(self, other: E | Literal) -> E:
        return _binary(BinaryOp.ADD, self, other)

    def __sub__(self, other: E | Literal) -> E:
        return _binary(BinaryOp.SUB, self, other)

    def __mul__(self, other: E | Literal) -> E:
        return _binary(BinaryOp.MUL, self, other)

    def __truediv__(self, other: E | Literal) -> E:
        return _binary(BinaryOp.DIV, self, other)

    def __mod__(self, other: E | Literal) -> E:
        return _binary(BinaryOp.MOD, self, other)

    def __lt__(self, other: E | Literal) -> E:
        return _binary(BinaryOp.LT, self, other, BOOL)

    def __le__(self, other: E | Literal) -> E:
        return _binary(BinaryOp.LE, self, other, BOOL)

    def __gt__(self, other: E | Literal) -> E:
        return _binary(BinaryOp.LT, e(other, self.type), self, BOOL)

    def __ge__(self, other: E | Literal) -> E:
        return _binary(BinaryOp.LE, e(other, self.type), self, BOOL)

    def __and__(self, other: E | Literal) -> E:
        return _binary(BinaryOp.AND, self, other)

    def __or__(self, other: E | Literal) -> E:
        return _binary(BinaryOp.OR, self, other)

    def __rshift__(self, other: E | Literal) -> E:
        return _binary(BinaryOp.IMPLIES, self, other)

    def __invert__(self) -> E:
        return E(core.Unary(UnaryOp.NOT, self.expr, BOOL))

    def __neg__(self) -> E:
        return E(core.Unary(UnaryOp.NEG, self.expr, self.type))

    def eq(self, other: E | Literal) -> E:
        return _binary(BinaryOp.EQ, self, other, BOOL)

    def ne(self, other: E | Literal) -> E:
        return _binary(BinaryOp.NE, self, other, BOOL)

    def widened(self) -> E:
        return E(core.Unary(UnaryOp.WIDEN, self.expr, FLOAT))

    # --- parts ----------------------------------------------------------------------------------

    def __getitem__(self, index: E | Literal) -> E:
        match self.type:
            case MapType(key=key, value=value):
                return self._step(core.KeyStep(e(index, key).expr, value))
            case (
                ArrayType(element=element) | ListType(element=element) | QueueType(element=element)
            ):
                return self._step(core.IndexStep(e(index, INT).expr, element))
            case _:
                raise AssertionError(f"{self.type} has no elements")

    def field(self, name: str) -> E:
        assert isinstance(self.type, RecordType)
        position = self.type.position(name)
        assert position is not None
        return self._step(core.FieldStep(position, name, self.type.fields[position][1]))

    def at(self, robot: E | Literal) -> E:
        """The local or port of that robot (properties only)."""
        return E(core.Read(replace(self.place, robot=e(robot, INT).expr)))

    @property
    def primed(self) -> E:
        """The port after the environment's turn (contracts only)."""
        return E(core.Read(replace(self.place, primed=True)))

    def _step(self, step: core.Step) -> E:
        if isinstance(self.expr, core.Read):
            place = self.expr.place
            return E(core.Read(replace(place, steps=(*place.steps, step))))
        return E(core.Select(self.expr, step))

    # --- statements -----------------------------------------------------------------------------

    @property
    def place(self) -> core.Place:
        assert isinstance(self.expr, core.Read)
        return self.expr.place

    def set(self, value: E | Literal) -> core.Stmt:
        return core.Assign(self.place, e(value, self.type).expr)

    def append(self, value: E | Literal) -> core.Stmt:
        return core.Append(self.place, e(value, _element(self.type)).expr)

    def remove(self, value: E | Literal) -> core.Stmt:
        key = self.type.key if isinstance(self.type, MapType) else _element(self.type)
        return core.Remove(self.place, e(value, key).expr)

    def pop(self, into: E | None = None) -> core.Stmt:
        return core.Pop(self.place, into.place if into is not None else None)


def e(value: E | Literal, type_: Type) -> E:
    """A literal as an expression of a type."""
    if isinstance(value, E):
        return value
    if isinstance(type_, EnumType) and isinstance(value, str):
        return E(core.Const(type_.members.index(value), type_))
    constant = Fraction(value) if type_ == FLOAT and not isinstance(value, str) else value
    assert not isinstance(constant, float)
    return E(core.Const(constant, type_))


def _binary(op: BinaryOp, left: E, right: E | Literal, type_: Type | None = None) -> E:
    other = e(right, left.type)
    return E(core.Binary(op, left.expr, other.expr, type_ if type_ is not None else left.type))


def _element(type_: Type) -> Type:
    assert isinstance(type_, ArrayType | ListType | QueueType)
    return type_.element


PID = E(core.Pid(INT))
N = E(core.NumAgents(INT))
DELTA = E(core.Delta(FLOAT))
TRUE = E(core.Const(True, BOOL))


def lst(element: Type, *items: E | Literal) -> E:
    return E(core.MakeList(tuple(e(x, element).expr for x in items), ListType(element)))


def array(element: Type, *items: E | Literal) -> E:
    made = tuple(e(x, element).expr for x in items)
    return E(core.MakeList(made, ArrayType(element, len(items))))


def queue(element: Type, *items: E | Literal) -> E:
    return E(core.MakeList(tuple(e(x, element).expr for x in items), QueueType(element)))


def table(key: Type, value: Type, *entries: tuple[E | Literal, E | Literal]) -> E:
    made = tuple((e(k, key).expr, e(v, value).expr) for k, v in entries)
    return E(core.MakeMap(made, MapType(key, value)))


def rec(type_: RecordType, *fields: E | Literal) -> E:
    pairs = zip(fields, type_.fields, strict=True)
    return E(core.MakeRecord(tuple(e(value, t).expr for value, (_, t) in pairs), type_))


def pos(x: E | Literal, y: E | Literal, z: E | Literal = 0) -> E:
    return rec(POS, x, y, z)


def length(of: E) -> E:
    return E(core.Builtin(ListOp.LENGTH, (of.expr,), INT))


def contains(of: E, value: E | Literal) -> E:
    key = of.type.key if isinstance(of.type, MapType) else _element(of.type)
    return E(core.Builtin(ListOp.CONTAINS, (of.expr, e(value, key).expr), BOOL))


def fold(op: ListOp, of: E) -> E:
    """``any``, ``all``, ``min``, ``max`` of a list."""
    type_ = BOOL if op in (ListOp.ANY, ListOp.ALL) else _element(of.type)
    return E(core.Builtin(op, (of.expr,), type_))


def stopped(robot: E | Literal) -> E:
    return E(core.Stopped(e(robot, INT).expr))


def ran(position: int, robot: E | Literal, kind: int = 0) -> E:
    return E(core.Ran(((kind, position),), e(robot, INT).expr))


# --- statements ---------------------------------------------------------------------------------


def when(condition: E, *then: core.Stmt, otherwise: Sequence[core.Stmt] = ()) -> core.Stmt:
    return core.If(condition.expr, then, tuple(otherwise))


def for_range(x: E, low: E | Literal, high: E | Literal, *body: core.Stmt) -> core.Stmt:
    return core.ForRange(x.place.variable, e(low, INT).expr, e(high, INT).expr, body)


def for_each(x: E, over: E, *body: core.Stmt, key: E | None = None) -> core.Stmt:
    name = key.place.variable if key is not None else None
    return core.ForEach(name, x.place.variable, over.expr, body)


def output(*values: E, stream: str = "stdout") -> core.Stmt:
    return core.Output(stream, tuple(v.expr for v in values))


def back(value: E | Literal, type_: Type = INT) -> core.Stmt:
    return core.Return(e(value, type_).expr)


BREAK = core.Break()
STOP = core.Stop()
TRYSTOP = core.TryStop()


# --- programs -----------------------------------------------------------------------------------


def bound(name: str, slot: int, type_: Type) -> E:
    """A bound variable of a body."""
    return E(core.Read(core.Place(core.Variable(Home.BOUND, slot, name, type_))))


@dataclass
class Kind:
    """One kind of robot, in the making."""

    name: str = ""
    locals: list[core.Declaration] = field(default_factory=list)
    ports: list[core.Port] = field(default_factory=list)
    modules: list[core.Module] = field(default_factory=list)
    init: core.Block = ()
    init_bound: int = 0
    events: list[core.Event] = field(default_factory=list)

    def agent(self) -> core.Agent:
        return core.Agent(
            self.name,
            tuple(self.locals),
            tuple(self.ports),
            tuple(self.modules),
            self.init,
            self.init_bound,
            tuple(self.events),
        )


@dataclass
class Build:
    """A core program in the making. Declarations go to the last kind that was begun."""

    name: str = "built"
    kinds: list[Kind] = field(default_factory=lambda: [Kind()])
    shared_read: list[core.Declaration] = field(default_factory=list)
    shared_write: list[core.Declaration] = field(default_factory=list)
    functions: list[core.Function] = field(default_factory=list)
    externals: list[core.External] = field(default_factory=list)
    locks: dict[int, set[str]] = field(default_factory=dict)
    assumptions: list[core.Assumption] = field(default_factory=list)
    properties: list[core.Property] = field(default_factory=list)
    sites: int = 0

    @property
    def kind(self) -> Kind:
        return self.kinds[-1]

    def agent(self, name: str) -> None:
        """Begin a kind of robot."""
        if self.kinds == [Kind()]:
            self.kinds = []
        self.kinds.append(Kind(name))

    # --- variables ------------------------------------------------------------------------------

    def local(
        self, name: str, type_: Type, initial: E | Literal | core.Start = core.Start.UNSET
    ) -> E:
        return _declare(self.kind.locals, Home.LOCAL, name, type_, initial, type_)

    def allread(
        self, name: str, type_: Type, initial: E | Literal | core.Start = core.Start.UNSET
    ) -> E:
        whole = ArrayType(type_, Robots.ALL)
        return _declare(self.shared_read, Home.ALLREAD, name, whole, initial, type_)

    def allwrite(
        self, name: str, type_: Type, initial: E | Literal | core.Start = core.Start.UNSET
    ) -> E:
        return _declare(self.shared_write, Home.ALLWRITE, name, type_, initial, type_)

    def sensor(
        self,
        name: str,
        type_: Type,
        initial: E | Literal | core.Start = core.Start.ARBITRARY,
        module: str = "Unit",
    ) -> E:
        return self._port(name, type_, initial, module, Direction.SENSOR)

    def actuator(
        self,
        name: str,
        type_: Type,
        initial: E | Literal | core.Start = core.Start.UNSET,
        module: str = "Unit",
    ) -> E:
        return self._port(name, type_, initial, module, Direction.ACTUATOR)

    def _port(
        self,
        name: str,
        type_: Type,
        initial: E | Literal | core.Start,
        module: str,
        direction: Direction,
    ) -> E:
        ports = self.kind.ports
        value = initial if isinstance(initial, core.Start) else e(initial, type_).expr
        variable = core.Variable(Home.PORT, len(ports), name, type_)
        ports.append(core.Port(module, direction, core.Declaration(variable, value)))
        return E(core.Read(core.Place(variable)))

    # --- behaviour ------------------------------------------------------------------------------

    def event(
        self,
        name: str,
        guard: E,
        *effect: core.Stmt,
        urgent: bool = False,
        bound: int = 0,
    ) -> int:
        """Declare an event and return its position."""
        classes = frozenset(_lock_classes(effect))
        self.kind.events.append(core.Event(name, urgent, guard.expr, effect, bound, classes))
        return len(self.kind.events) - 1

    def init(self, *body: core.Stmt, bound: int = 0) -> None:
        self.kind.init, self.kind.init_bound = body, bound

    def atomic(self, *body: core.Stmt, lock: int = 0) -> core.Stmt:
        self.locks.setdefault(lock, set())
        return core.Atomic(lock, body)

    def module(
        self,
        name: str = "Unit",
        environment: Sequence[core.Stmt] | None = None,
        contracts: Sequence[core.Contract] = (),
        bound: int = 0,
    ) -> None:
        """Put the ports that bear this module's name under it."""
        ports = tuple(k for k, port in enumerate(self.kind.ports) if port.module == name)
        block = tuple(environment) if environment is not None else None
        self.kind.modules.append(core.Module(name, ports, block, bound, tuple(contracts)))

    def site(self) -> int:
        self.sites += 1
        return self.sites

    def choose(self, low: E | Literal, high: E | Literal, type_: Type = FLOAT) -> E:
        ends = e(low, type_).expr, e(high, type_).expr
        return E(core.Choose(*ends, type_, self.site()))

    def function(
        self, name: str, parameters: Sequence[E], result: Type, *body: core.Stmt, bound: int = 0
    ) -> None:
        variables = tuple(p.place.variable for p in parameters)
        slots = max(bound, len(variables))
        self.functions.append(core.Function(name, variables, result, body, slots))

    def call(self, name: str, *arguments: E | Literal) -> E:
        function = next(f for f in self.functions if f.name == name)
        assert function.result is not None
        pairs = zip(arguments, function.parameters, strict=True)
        values = tuple(e(a, p.type).expr for a, p in pairs)
        return E(core.Call(name, values, function.result, self.site()))

    def external(
        self,
        name: str,
        parameters: Sequence[E],
        result: E,
        *,
        requires: Sequence[E] = (),
        ensures: Sequence[E] = (),
        fresh: bool = False,
        bound: int = 0,
    ) -> None:
        variables = tuple(p.place.variable for p in parameters)
        self.externals.append(
            core.External(
                name,
                variables,
                result.place.variable,
                core.ExternalKind.FRESH if fresh else core.ExternalKind.FUNCTION,
                tuple(x.expr for x in requires),
                tuple(x.expr for x in ensures),
                max(bound, len(variables) + 1),
            )
        )

    def ask(self, name: str, *arguments: E | Literal) -> E:
        function = next(f for f in self.externals if f.name == name)
        pairs = zip(arguments, function.parameters, strict=True)
        values = tuple(e(a, p.type).expr for a, p in pairs)
        return E(core.ExternalCall(name, values, function.result.type, self.site()))

    # --- properties -----------------------------------------------------------------------------

    def assume(self, condition: E, name: str = "start", bound: int = 2) -> None:
        self.assumptions.append(core.Assumption(name, condition.expr, bound))

    def invariant(self, name: str, condition: E, *, at_round: bool = False, bound: int = 2) -> None:
        kind = core.PropertyKind.AT_ROUND if at_round else core.PropertyKind.INVARIANT
        self.properties.append(core.Property(name, kind, condition.expr, bound))

    def program(self) -> core.Program:
        return core.Program(
            self.name,
            tuple(kind.agent() for kind in self.kinds),
            tuple(self.shared_read),
            tuple(self.shared_write),
            tuple(self.functions),
            tuple(self.externals),
            tuple(core.LockClass(k, ()) for k in sorted(self.locks)),
            tuple(self.assumptions),
            tuple(self.properties),
        )


def contract(name: str, requires: Sequence[E], ensures: Sequence[E]) -> core.Contract:
    return core.Contract(name, tuple(x.expr for x in requires), tuple(x.expr for x in ensures))


def forall(x: E, body: E, domain: core.QuantifierDomain | None = None) -> E:
    """Over all robots, if nothing else is said."""
    over = domain if domain is not None else core.RobotRange()
    universal = core.QuantifierKind.FORALL
    return E(core.Quantified(universal, x.place.variable, over, body.expr))


def exists(x: E, body: E, domain: core.QuantifierDomain | None = None) -> E:
    over = domain if domain is not None else core.RobotRange()
    existential = core.QuantifierKind.EXISTS
    return E(core.Quantified(existential, x.place.variable, over, body.expr))


#: Bound variables of properties, by convention in the first two slots.
I = bound("i", 0, INT)  # noqa: E741
J = bound("j", 1, INT)


def _declare(
    declarations: list[core.Declaration],
    home: Home,
    name: str,
    type_: Type,
    initial: E | Literal | core.Start,
    value_type: Type,
) -> E:
    variable = core.Variable(home, len(declarations), name, type_)
    value = initial if isinstance(initial, core.Start) else e(initial, value_type).expr
    declarations.append(core.Declaration(variable, value))
    return E(core.Read(core.Place(variable)))


def _lock_classes(block: Sequence[core.Stmt]) -> set[int]:
    found: set[int] = set()
    for s in block:
        match s:
            case core.Atomic(lock_class=lock, body=body):
                found |= {lock} | _lock_classes(body)
            case core.If(then=then, otherwise=otherwise):
                found |= _lock_classes(then) | _lock_classes(otherwise)
            case core.ForRange(body=body) | core.ForEach(body=body):
                found |= _lock_classes(body)
            case _:
                pass
    return found


__all__ = ["BOOL", "FLOAT", "INT", "POS", "STRING", "Build", "E"]
