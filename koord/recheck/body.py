"""Evaluation of one body: expressions and statements, as terms under the condition of their path.

Statements are guarded commands: each changes memory where its path holds and leaves it elsewhere.
Reads are from the memory of the robot that runs; writes to shared variables go to that memory and
are kept, in their order, as a sequence that can be made on any store.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from typing import assert_never

from koord.recheck import all_robots, blocks, externals, maps, places, quantifiers
from koord.recheck.memory import Fault, Frame, Memory, Write
from koord.recheck.storage import Crowd, State, Storage, Storages
from koord.recheck.terms import Term, Terms
from koord.recheck.values import Family, NotRecheckedError, Value, Values
from koord.recheck.world import World
from koord.syntax import core
from koord.syntax.core import BinaryOp, ListOp, UnaryOp
from koord.syntax.source import Span
from koord.syntax.types import ArrayType, BoolType, FloatType, MapType, Type


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
        self.frame: Frame | None = None
        self.broke: list[Term] = []
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
                return places.read(self, e.place)
            case core.Select():
                return places.part(self, self.value(e.base), e.base.type, (e.step,))
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
                return quantifiers.quantified(self, e)
            case core.Ran() | core.Stopped() if self.crowd is not None:
                return all_robots.of_robot(self, e)
            case core.Ran():
                return quantifiers.of_robots(
                    self, e.robot, [quantifiers.ran(self, e, i) for i in self.everyone()]
                )
            case core.Stopped():
                return quantifiers.of_robots(
                    self, e.robot, [self.state().robots[i].stopped for i in self.everyone()]
                )
            case core.MakeMap():
                return self._map(e)
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
            return all_robots.of_all(self, e, value)
        match e.op:
            case ListOp.LENGTH:
                return self.v.length(value, first.type)
            case ListOp.CONTAINS:
                return self.v.contains(value, self.value(e.arguments[1]), first.type)
            case ListOp.ANY | ListOp.ALL:
                join = self.t.disjunction if e.op is ListOp.ANY else self.t.conjunction
                return join(x for x in self.items(value, e.span) if isinstance(x, Term))
            case ListOp.MIN | ListOp.MAX:
                items = self.items(value, e.span)
                self.fault_unless(self.t.truth(bool(items)), "empty list", e.span)
                if not items:
                    return self.v.default(e.type)
                return self.v.least(items, greatest=e.op is ListOp.MAX)
            case ListOp.KEYS:
                raise NotRecheckedError("going through a map is not rechecked", e.span)
        assert_never(e.op)

    def _map(self, e: core.MakeMap) -> Value:
        """Of two entries with one key the later counts. [E-MAP]"""
        assert isinstance(e.type, MapType)
        made = maps.empty(self.v, e.type)
        for key, value in e.entries:
            made = maps.with_entry(self.v, made, self.value(key), self.value(value), e.type)
        return made

    def items(self, value: Value, span: Span) -> tuple[Value, ...]:
        if not isinstance(value, tuple):
            raise NotRecheckedError(
                "going through a map, or a list whose length is not fixed by the text, is not"
                " rechecked",
                span,
            )
        return value

    def state(self) -> State:
        assert isinstance(self.memory.state, State)
        return self.memory.state

    @property
    def crowd(self) -> Crowd | None:
        """The configuration that a property is about, if there may be any number of robots."""
        return self.memory.state if isinstance(self.memory.state, Crowd) else None

    def everyone(self) -> range:
        return range(len(self.world.kinds))

    # --- calls ----------------------------------------------------------------------------------

    def _call(self, e: core.Call) -> Value:
        """A call of a function defined in Koord: its body, with variables of its own. [E-CALL]"""
        function = self.world.program.function(e.function)
        arguments: list[Storage | None] = [
            self.s.stored(self.value(a), p.type)
            for a, p in zip(e.arguments, function.parameters, strict=True)
        ]
        outer = (self.bound, self.frame, self.broke, self.path, self.outside)
        self.outside, self.path = self.t.both(self.outside, self.path), self.t.truth(True)
        self.bound = [*arguments, *[None] * (function.bound - len(arguments))]
        frame = Frame(self.s.unset(e.type), e.type, self.t.truth(False))
        self.frame, self.broke = frame, []
        blocks.run(self, function.body)
        self.bound, self.frame, self.broke, self.path, self.outside = outer
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


def _common(e: core.Binary) -> Type:
    """The type in which two sides are compared: an array and a list are compared as lists."""
    if isinstance(e.left.type, ArrayType):
        return e.right.type
    return e.left.type
