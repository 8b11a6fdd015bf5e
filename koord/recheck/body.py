"""Evaluation of one body: expressions and statements, as terms under the condition of their path.

Statements are guarded commands: each changes memory where its path holds and leaves it elsewhere.
Reads are from the memory of the robot that runs; writes to shared variables go to that memory and
are kept, in their order, as a sequence that can be made on any store.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from fractions import Fraction
from typing import assert_never

from koord.recheck import crowds, externals
from koord.recheck.loops import Loop
from koord.recheck.storage import Cell, Crowd, Field, Location, Many, State, Storage, Storages
from koord.recheck.terms import Term, Terms
from koord.recheck.values import Family, NotRecheckedError, Value, Values
from koord.recheck.world import World
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, ListOp, QuantifierKind, UnaryOp
from koord.syntax.source import Span
from koord.syntax.types import (
    INT,
    ArrayType,
    BoolType,
    FloatType,
    QueueType,
    Type,
)


@dataclass(frozen=True, slots=True)
class Write:
    """A write to a shared variable, where ``when`` holds."""

    when: Term
    variable: core.Variable
    locations: tuple[Location, ...]
    value: Value


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that goes wrong where ``when`` holds."""

    when: Term
    what: str
    span: Span

    def of(self, when: Term) -> Fault:
        """The same under another condition."""
        return Fault(when, self.what, self.span)


@dataclass(slots=True)
class Memory:
    """What a body reads and writes: M and cp of a robot, or in a property a configuration."""

    locals: list[Storage] = field(default_factory=list)
    ports: list[Storage] = field(default_factory=list)
    allread: list[Storage] = field(default_factory=list)
    allwrite: list[Storage] = field(default_factory=list)
    after: list[Storage] | None = None  #: ports after the environment's turn, while it runs
    #: In a property: the configuration that it is about.
    state: State | Crowd | None = None


@dataclass(slots=True)
class _Frame:
    """A running function: where it has returned, and what."""

    result: Storage
    type: Type | None
    returned: Term


class Body:
    """One running body. ``robot`` is who runs it, None in a property."""

    def __init__(self, world: World, values: Values, robot: Term | None, memory: Memory) -> None:
        self.world = world
        self.v = values
        self.t: Terms = values.t
        self.s = Storages(values)
        self.robot = robot
        self.memory = memory
        self.bound: list[Storage | None] = []
        self.path: Term = self.t.truth(True)
        #: When this body is run at all: the path of its caller, or that an event is enabled. What
        #: is remembered only while it runs does not depend on that, so terms leave it out.
        self.outside: Term = self.t.truth(True)
        self.faults: list[Fault] = []
        self.legal: list[Term] = []  #: what answers satisfy if this body is run at all
        self.entered: dict[int, Term] = {}
        self.writes: list[Write] = []
        self.asked = self.stopped = self.t.truth(False)
        self._frame: _Frame | None = None
        self._broke: list[Term] = []
        self.in_summary = False
        #: Numbers that are surely those of robots, where it is open how many there are.
        self.here: list[Term] = []
        #: Whether this is a statement about configurations: no answer of it is anyone's to choose.
        self.closed = memory.state is not None

    def apart(self) -> Body:
        """A body that nobody runs and that knows of no configuration."""
        return Body(self.world, self.v, None, Memory())

    # --- paths ----------------------------------------------------------------------------------

    @contextmanager
    def where(self, condition: Term) -> Iterator[None]:
        """Go on under a further condition."""
        outer = self.path
        self.path = self.t.both(outer, condition)
        yield
        self.path = outer

    @contextmanager
    def among(self, index: Term, low: Term, high: Term) -> Iterator[None]:
        """Go on with a number of this range; it may be that of a robot, surely."""
        sure = low.value is not None and low.value >= 0 and high is self.v.count
        self.here += [index] if sure else []
        yield
        if sure:
            self.here.remove(index)

    def fault_unless(self, holds: Term, what: str, span: Span) -> None:
        when = self.t.conjunction([self.outside, self.path, self.t.negation(holds)])
        if when.value is not False:
            self.faults.append(Fault(when, what, span))

    def require(self, holds: Term) -> None:
        """Something that answers satisfy, if they are asked for."""
        # Behind a fault nothing is asked.
        going_on = self.t.conjunction([self.outside, self.path, self.t.negation(self.faulted())])
        needed = self.t.implies(going_on, holds)
        if needed.value is not True:
            self.legal.append(needed)

    def faulted(self) -> Term:
        return self.t.disjunction(fault.when for fault in self.faults)

    # --- expressions ----------------------------------------------------------------------------

    def condition(self, e: core.Expr) -> Term:
        value = self.value(e)
        assert isinstance(value, Term)
        return value

    def statement(self, e: core.Expr) -> Term:
        """Whether a statement holds: true, and evaluated without a fault."""
        faults, self.faults = self.faults, []
        outer, self.path = (self.path, self.outside), self.t.truth(True)
        self.outside = self.t.truth(True)
        holds = self.t.both(self.condition(e), self.t.negation(self.faulted()))
        self.faults, (self.path, self.outside) = faults, outer
        return holds

    def value(self, e: core.Expr) -> Value:
        """The value of an expression; faults are noted and evaluation goes on."""
        t = self.t
        match e:
            case core.Const():
                return self._constant(e)
            case core.Pid():
                assert self.robot is not None
                return self.robot
            case core.NumAgents():
                return self.v.count
            case core.Delta():
                return t.real(self.world.delta_s)
            case core.Read():
                return self._read(e.place)
            case core.Select():
                return self._part(self.value(e.base), e.base.type, (e.step,))
            case core.Unary():
                return self._unary(e)
            case core.Binary():
                return self._binary(e)
            case core.Builtin():
                return self._builtin(e)
            case core.MakeList(items=items) | core.MakeRecord(fields=items):
                return tuple(self.value(item) for item in items)
            case core.Call():
                return self._call(e)
            case core.ExternalCall():
                return externals.answer(self, e)
            case core.Choose():
                return self._choose(e)
            case core.Quantified():
                return self._quantified(e)
            case core.Ran() | core.Stopped() if self.crowd is not None:
                return crowds.of_robot(self, e)
            case core.Ran():
                return self._of_robots(e.robot, [self._ran(e, i) for i in self._everyone()])
            case core.Stopped():
                return self._of_robots(
                    e.robot, [self._state().robots[i].stopped for i in self._everyone()]
                )
            case core.MakeMap():
                raise NotRecheckedError("maps are not rechecked", e.span)
        assert_never(e)

    def _constant(self, e: core.Const) -> Term:
        match e.type:
            case BoolType():
                return self.t.truth(bool(e.value))
            case FloatType():
                assert not isinstance(e.value, str)
                return self.t.real(Fraction(e.value))
            case _:
                if isinstance(e.value, str):
                    return self.v.text(e.value)
                return self.t.integer(int(e.value))

    def _unary(self, e: core.Unary) -> Term:
        a = self.condition(e.operand)
        match e.op:
            case UnaryOp.NEG:
                return self.t.negative(a)
            case UnaryOp.NOT:
                return self.t.negation(a)
            case UnaryOp.WIDEN:
                return self.t.widened(a)
            case UnaryOp.ABS:
                zero = self.t.minus(a, a)
                return self.t.ite(self.t.less(a, zero), self.t.negative(a), a)
        assert_never(e.op)

    def _binary(self, e: core.Binary) -> Term:
        t = self.t
        if e.op in (BinaryOp.AND, BinaryOp.OR, BinaryOp.IMPLIES):
            left = self.condition(e.left)
            needed = t.negation(left) if e.op is BinaryOp.OR else left
            if needed.value is False:
                return t.truth(e.op is not BinaryOp.AND)
            with self.where(needed):
                right = self.condition(e.right)
            join = {BinaryOp.AND: t.both, BinaryOp.OR: t.either}.get(e.op, t.implies)
            return join(left, right)
        if e.op in (BinaryOp.EQ, BinaryOp.NE):
            same = self.v.equal(self.value(e.left), self.value(e.right), _common(e))
            return same if e.op is BinaryOp.EQ else t.negation(same)
        a, b = self.condition(e.left), self.condition(e.right)
        if e.op in (BinaryOp.DIV, BinaryOp.MOD):
            is_zero = t.equal(b, t.minus(b, b))
            self.fault_unless(t.negation(is_zero), "division by zero", e.right.span)
        match e.op:
            case BinaryOp.ADD:
                return t.plus(a, b)
            case BinaryOp.SUB:
                return t.minus(a, b)
            case BinaryOp.MUL:
                return t.times(a, b)
            case BinaryOp.DIV:
                return t.quotient(a, b) if isinstance(e.type, FloatType) else t.floored(a, b)
            case BinaryOp.MOD:
                return t.remainder(a, b)
            case BinaryOp.LT:
                return t.less(a, b)
            case BinaryOp.LE:
                return t.at_most(a, b)
            case BinaryOp.MIN:
                return t.ite(t.less(b, a), b, a)
            case BinaryOp.MAX:
                return t.ite(t.less(a, b), b, a)
        raise AssertionError(e.op)

    def _builtin(self, e: core.Builtin) -> Value:
        first = e.arguments[0]
        if e.op is ListOp.LENGTH and isinstance(first.type, ArrayType):
            return (
                self.v.count
                if self.v.is_family(first.type)
                else self.t.integer(self.v.size(first.type))
            )
        value = self.value(first)
        if isinstance(value, Family) and e.op not in (ListOp.LENGTH, ListOp.CONTAINS):
            return crowds.of_all(self, e, value)
        match e.op:
            case ListOp.LENGTH:
                return self.v.length(value)
            case ListOp.CONTAINS:
                return self.v.contains(value, self.value(e.arguments[1]), first.type)
            case ListOp.ANY | ListOp.ALL:
                join = self.t.disjunction if e.op is ListOp.ANY else self.t.conjunction
                return join(x for x in self._items(value, e.span) if isinstance(x, Term))
            case ListOp.MIN | ListOp.MAX:
                items = self._items(value, e.span)
                self.fault_unless(self.t.truth(bool(items)), "empty list", e.span)
                if not items:
                    return self.v.default(e.type)
                return self.v.least(items, greatest=e.op is ListOp.MAX)
        assert_never(e.op)

    def _items(self, value: Value, span: Span) -> tuple[Value, ...]:
        if not isinstance(value, tuple):
            raise NotRecheckedError(
                "going through a list whose length is not fixed by the text is not rechecked", span
            )
        return value

    # --- places ---------------------------------------------------------------------------------

    def _read(self, place: core.Place) -> Value:
        """Every read is from the robot's own memory. [LOOKUP]"""
        storage, type_ = self._root(place), place.variable.type
        steps = list(place.steps)
        while steps and not isinstance(storage, Cell):
            step = steps.pop(0)
            location = self._location(step)
            if isinstance(location, Term):
                self._check_index(location, storage, step.span)
            storage, type_ = self.s.below(storage, location, type_), step.type
        value, is_set = self.s.read(storage, type_)
        self.fault_unless(is_set, f"{place.variable.name} is read while unset", place.span)
        return self._part(value, type_, steps)

    def _check_index(self, index: Term, storage: Storage, span: Span) -> None:
        t = self.t
        if isinstance(storage, Many):
            there = crowds.is_robot(self, index)
        else:
            assert isinstance(storage, tuple)
            size = t.integer(len(storage))
            there = t.both(t.at_most(t.integer(0), index), t.less(index, size))
        self.fault_unless(there, "index out of range", span)

    def _part(self, value: Value, type_: Type, steps: Sequence[core.Step]) -> Value:
        for step in steps:
            location = self._location(step)
            if isinstance(location, Field):
                assert isinstance(value, tuple)
                value = value[location.position]
            else:
                there = (
                    crowds.is_robot(self, location)
                    if isinstance(value, Family)
                    else self.v.inside(value, location)
                )
                self.fault_unless(there, "index out of range", step.span)
                value = self.v.at(value, location, type_)
            type_ = step.type
        return value

    def _location(self, step: core.Step) -> Location:
        match step:
            case core.FieldStep(position=position):
                return Field(position)
            case core.IndexStep(index=index):
                return self.condition(index)
            case core.KeyStep():
                raise NotRecheckedError("maps are not rechecked", step.span)
        assert_never(step)

    def _root(self, place: core.Place) -> Storage:
        variable, memory = place.variable, self.memory
        match variable.home:
            case Home.BOUND:
                found = self.bound[variable.slot]
                return found if found is not None else self.s.unset(variable.type)
            case Home.ALLREAD:
                return memory.allread[variable.slot]
            case Home.ALLWRITE:
                return memory.allwrite[variable.slot]
            case Home.LOCAL | Home.PORT if memory.state is not None:
                return self._of_named(place)
            case Home.LOCAL:
                return memory.locals[variable.slot]
            case Home.PORT:
                if place.primed:
                    assert memory.after is not None
                    return memory.after[variable.slot]
                return memory.ports[variable.slot]
        assert_never(variable.home)

    def _of_named(self, place: core.Place) -> Storage:
        """``v@i``: the variable of the robot that the number names. [PROP-READ]"""
        assert place.robot is not None
        number, type_ = self.condition(place.robot), place.variable.type
        if self.crowd is not None:
            return crowds.named(self, place, number)
        found: Storage = self.s.unset(type_)
        there: list[Term] = []
        for i in reversed(self._everyone()):
            slot = self.world.slot_of(self.world.kinds[i], place.variable)
            if slot is None:
                continue
            here = self.t.equal(number, self.t.integer(i))
            robot = self._state().robots[i]
            own = robot.locals if place.variable.home is Home.LOCAL else robot.ports
            # The last one needs no condition: there is no such robot otherwise, which is a fault.
            found = self.s.merge(here, own[slot], found, type_) if there else own[slot]
            there.append(here)
        self.fault_unless(self.t.disjunction(there), "no such robot", place.robot.span)
        return found

    def _state(self) -> State:
        assert isinstance(self.memory.state, State)
        return self.memory.state

    @property
    def crowd(self) -> Crowd | None:
        """The configuration that a property is about, if there may be any number of robots."""
        return self.memory.state if isinstance(self.memory.state, Crowd) else None

    def _everyone(self) -> range:
        return range(len(self.world.kinds))

    # --- calls ----------------------------------------------------------------------------------

    def _call(self, e: core.Call) -> Value:
        """A call of a function defined in Koord: its body, with variables of its own. [E-CALL]"""
        function = self.world.program.function(e.function)
        arguments: list[Storage | None] = [
            self.s.stored(self.value(a), p.type)
            for a, p in zip(e.arguments, function.parameters, strict=True)
        ]
        outer = (self.bound, self._frame, self._broke, self.path, self.outside)
        self.outside, self.path = self.t.both(self.outside, self.path), self.t.truth(True)
        self.bound = [*arguments, *[None] * (function.bound - len(arguments))]
        frame = _Frame(self.s.unset(e.type), e.type, self.t.truth(False))
        self._frame, self._broke = frame, []
        self.run(function.body)
        self.bound, self._frame, self._broke, self.path, self.outside = outer
        value, is_set = self.s.read(frame.result, e.type)
        self.fault_unless(is_set, f"{e.function} returned nothing", e.span)
        return value

    def _choose(self, e: core.Choose) -> Value:
        if self.closed:
            raise NotRecheckedError("choose in a property is not rechecked", e.span)
        low, high = self.condition(e.low), self.condition(e.high)
        self.fault_unless(self.t.at_most(low, high), "empty range to choose from", e.span)
        chosen = self.v.fresh(f"choice by {externals.who(self.robot)}", e.type)
        assert isinstance(chosen, Term)
        self.require(self.t.both(self.t.at_most(low, chosen), self.t.at_most(chosen, high)))
        return chosen

    # --- properties -----------------------------------------------------------------------------

    def _quantified(self, e: core.Quantified) -> Term:
        slot, universal = e.variable.slot, e.quantifier is QuantifierKind.FORALL
        if isinstance(e.domain, core.AllValues):
            return self._every_value(e, e.domain.type)
        if crowds.is_open(self, e.domain):
            return crowds.quantified(self, e)
        result = self.t.truth(universal)
        for value in self._instances(e):
            # What is decided already is not looked at, and cannot fault.
            undecided = result if universal else self.t.negation(result)
            self.bound[slot] = self.s.stored(value, e.variable.type)
            with self.where(undecided):
                holds = self.condition(e.body)
            result = self.t.both(result, holds) if universal else self.t.either(result, holds)
        return result

    def _instances(self, e: core.Quantified) -> list[Value]:
        match e.domain:
            case core.RobotRange(agent=agent):
                kinds = self.world.kinds
                return [self.t.integer(i) for i, k in enumerate(kinds) if agent in (None, k)]
            case core.IntRange(low=low, high=high):
                return [self.t.integer(k) for k in self._range(low, high)]
            case core.Elements(sequence=over):
                return list(self._items(self.value(over), e.span))
            case core.AllValues():
                raise AssertionError("has no list of values")
        assert_never(e.domain)

    def _range(self, low: core.Expr, high: core.Expr) -> range:
        start, end = self.condition(low).value, self.condition(high).value
        if start is None or end is None:
            where = low if start is None else high
            raise NotRecheckedError(
                "a range whose bounds are not fixed by the text is not rechecked", where.span
            )
        return range(int(start), int(end))

    def _every_value(self, e: core.Quantified, type_: Type) -> Term:
        """A mathematical quantifier, in a summary."""
        assert e.quantifier is QuantifierKind.FORALL
        binders: list[Term] = []
        self.bound[e.variable.slot] = self.s.stored(
            self.binder(e.variable.name, type_, binders), type_
        )
        with self.v.scoped((*self.v.scope, *binders)):
            body = self.statement(e.body)
        ranges = [b for x in binders for b in self.v.bounds(x, type_)]
        return self.t.for_all(binders, self.t.implies(self.t.conjunction(ranges), body))

    def binder(self, name: str, type_: Type, binders: list[Term]) -> Value:
        """A value of variables of a quantifier, which are added to the others."""
        parts = self.v.parts(type_)
        if parts is not None:
            return tuple(self.binder(name + label, part, binders) for label, part in parts)
        binder = self.t.symbol(f"?{name}", self.v.sort(type_))
        binders.append(binder)
        return binder

    def _of_robots(self, number: core.Expr, holds: Sequence[Term]) -> Term:
        """Whether something holds of the robot that the number names; false if there is none."""
        index = self.condition(number)
        return self.t.disjunction(
            self.t.both(self.t.equal(index, self.t.integer(i)), x) for i, x in enumerate(holds)
        )

    def _ran(self, e: core.Ran, robot: int) -> Term:
        ran = self._state().robots[robot].ran
        positions = [p for kind, p in e.events if kind == self.world.kinds[robot]]
        return self.t.disjunction(self.t.equal(ran, self.t.integer(p)) for p in positions)

    # --- statements -----------------------------------------------------------------------------

    def run(self, block: core.Block) -> None:
        """The statements in order; what left the block does not go on."""
        outer = self.path
        for s in block:
            self._execute(s)
            left = [*self._broke[-1:], *([self._frame.returned] if self._frame else [])]
            self.path = self.t.both(outer, self.t.negation(self.t.disjunction(left)))
            if self.path.value is False:
                break
        self.path = outer

    def _execute(self, s: core.Stmt) -> None:
        t = self.t
        match s:
            case core.Assign():
                self.assign(s.place, self.value(s.value))
            case core.If():
                holds = self.condition(s.condition)
                for condition, block in ((holds, s.then), (t.negation(holds), s.otherwise)):
                    if condition.value is not False:
                        with self.where(condition):
                            self.run(block)
            case core.ForRange() if self._is_open(s.low) or self._is_open(s.high):
                low, high = self.condition(s.low), self.condition(s.high)
                Loop(self, low, high, s.variable, None, s.body, s.span).run()
            case core.ForRange():
                trips = [(None, t.integer(k)) for k in self._range(s.low, s.high)]
                self._loop(trips, None, s.variable, s.body)
            case core.ForEach():
                over = self.value(s.sequence)
                if isinstance(over, Family):
                    zero = t.integer(0)
                    Loop(self, zero, self.v.count, s.value, (over, s.key), s.body, s.span).run()
                    return
                items = self._items(over, s.span)
                numbered = [(t.integer(k), item) for k, item in enumerate(items)]
                self._loop(numbered, s.key, s.value, s.body)
            case core.Break():
                self._broke[-1] = t.either(self._broke[-1], self.path)
            case core.Return():
                self._return(s)
            case core.Atomic():
                entered = self.entered.get(s.lock_class, t.truth(False))
                self.entered[s.lock_class] = t.either(entered, self.path)
                self.run(s.body)
            case core.Stop():
                self.stopped = t.either(self.stopped, self.path)
            case core.TryStop():
                self.asked = t.either(self.asked, self.path)
            case core.Output():
                for shown in s.values:
                    self.value(shown)  # it may fault
            case core.Append():
                new = self.value(s.value)
                whole = self._read(s.place)
                self.assign(s.place, self.v.appended(whole, new, s.place.type))
            case core.Remove():
                self._remove(s)
            case core.Pop():
                self._pop(s)
            case _:
                assert_never(s)

    def _is_open(self, bound: core.Expr) -> bool:
        """Whether the bound of a loop is not a number, since that of robots is open."""
        return self.v.robots is None and self.condition(bound).value is None

    def _loop(
        self,
        trips: Sequence[tuple[Term | None, Value]],
        key: core.Variable | None,
        variable: core.Variable,
        body: core.Block,
    ) -> None:
        """One trip after the other, until one breaks out. [S-FOR] [S-FOREACH] [S-BREAK]"""
        self._broke.append(self.t.truth(False))
        outer = self.path
        for number, value in trips:
            left = [self._broke[-1], *([self._frame.returned] if self._frame else [])]
            self.path = self.t.both(outer, self.t.negation(self.t.disjunction(left)))
            if self.path.value is False:
                break
            if key is not None and number is not None:
                self.bound[key.slot] = self.s.stored(number, INT)
            self.bound[variable.slot] = self.s.stored(value, variable.type)
            self.run(body)
        self._broke.pop()
        self.path = outer

    def _return(self, s: core.Return) -> None:
        frame = self._frame
        assert frame is not None
        if s.value is not None:
            assert frame.type is not None
            result = self.s.stored(self.value(s.value), frame.type)
            frame.result = self.s.merge(self.path, result, frame.result, frame.type)
        frame.returned = self.t.either(frame.returned, self.path)

    # --- what loops over all robots need ----------------------------------------------------------

    def storage_of(self, variable: core.Variable) -> Storage:
        found = self._storages(variable.home)[variable.slot]
        return self.s.unset(variable.type) if found is None else found

    def set_storage(self, variable: core.Variable, storage: Storage) -> None:
        self._storages(variable.home)[variable.slot] = storage

    def tried(self, block: core.Block, condition: Term) -> tuple[Term, Term, Storage | None]:
        """Run a block by itself, where a condition holds: when it returns, when it breaks out of
        the loop that it is the body of, and what it returns.
        """
        outer = (self.path, self.outside, self._frame, self._broke)
        self.outside = self.t.conjunction([self.outside, self.path, condition])
        self.path, never = self.t.truth(True), self.t.truth(False)
        frame = self._frame
        if frame is not None:
            assert frame.type is not None
            self._frame = _Frame(self.s.unset(frame.type), frame.type, never)
        self._broke = [never]
        self.run(block)
        returned, result = never, None
        if self._frame is not None:
            returned, result = self._frame.returned, self._frame.result
        broken = self._broke[-1]
        self.path, self.outside, self._frame, self._broke = outer
        return returned, broken, result

    def returns(self, when: Term, result: Storage | None) -> None:
        """The running function has returned where a condition holds."""
        frame = self._frame
        assert frame is not None
        if result is not None:
            assert frame.type is not None
            frame.result = self.s.merge(when, result, frame.result, frame.type)
        frame.returned = self.t.either(frame.returned, when)

    def assign(self, place: core.Place, value: Value) -> None:
        """Write a place. [LOCAL-ASSIGN] [SHARED-ASSIGN] [ALLREAD] [ACTUATE]"""
        variable = place.variable
        locations = tuple(self._location(step) for step in place.steps)
        storages = self._storages(variable.home)
        before = storages[variable.slot]
        if before is None:
            before = self.s.unset(variable.type)
        self._check_place(place, before, locations)
        storages[variable.slot] = self.s.put(before, variable.type, locations, value, self.path)
        if variable.home in (Home.ALLREAD, Home.ALLWRITE):
            self.writes.append(Write(self.path, variable, locations, value))

    def _storages(self, home: Home) -> list[Storage] | list[Storage | None]:
        memory = self.memory
        match home:
            case Home.LOCAL:
                return memory.locals
            case Home.PORT:
                return memory.ports if memory.after is None else memory.after
            case Home.ALLREAD:
                return memory.allread
            case Home.ALLWRITE:
                return memory.allwrite
            case Home.BOUND:
                return self.bound
        assert_never(home)

    def _check_place(
        self, place: core.Place, storage: Storage, locations: Sequence[Location]
    ) -> None:
        """A place exists for writing, or the step that fails is a fault. [S-ASSIGN]"""
        type_, value = place.variable.type, None
        for step, location in zip(place.steps, locations, strict=True):
            if value is None and isinstance(storage, Cell):
                what = f"{place.variable.name} is written into while unset"
                self.fault_unless(storage.is_set, what, place.span)
                value = storage.value
            if value is not None:
                if isinstance(location, Field):
                    assert isinstance(value, tuple)
                    value = value[location.position]
                else:
                    there = self.v.inside(value, location)
                    self.fault_unless(there, "index out of range", step.span)
                    value = self.v.at(value, location, type_)
            else:
                assert not isinstance(storage, Cell)
                if isinstance(location, Term):
                    self._check_index(location, storage, step.span)
                storage = self.s.below(storage, location, type_)
            type_ = step.type

    def _remove(self, s: core.Remove) -> None:
        """The first equal element goes, if there is one. [S-REMOVE]"""
        wanted = self.value(s.value)
        whole = self._read(s.place)
        position = self.v.position(whole, wanted, s.place.type)
        found = self.t.at_most(self.t.integer(0), position)
        with self.where(found):
            self.assign(s.place, self.v.without(whole, position, s.place.type))

    def _pop(self, s: core.Pop) -> None:
        """The first of a queue goes, or the last of a list. [S-POP]"""
        t, type_ = self.t, s.place.type
        whole = self._read(s.place)
        length = self.v.length(whole)
        self.fault_unless(t.less(t.integer(0), length), "empty list", s.span)
        last = t.minus(length, t.integer(1))
        position = t.integer(0) if isinstance(type_, QueueType) else last
        taken = self.v.at(whole, position, type_)
        self.assign(s.place, self.v.without(whole, position, type_))
        if s.into is not None:
            self.assign(s.into, taken)


def _common(e: core.Binary) -> Type:
    """The type in which two sides are compared: an array and a list are compared as lists."""
    if isinstance(e.left.type, ArrayType):
        return e.right.type
    return e.left.type
