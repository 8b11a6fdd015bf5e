"""Expressions of a body as terms, with calls of external functions. [EXTERNAL]"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import assert_never

from koord.recheck import all_robots, maps, places, sums
from koord.recheck.body import RunningBody
from koord.recheck.sorts import Family, NotRecheckedError, Value
from koord.recheck.storage import Frame, Storage
from koord.recheck.terms import Term
from koord.recheck.values import Values
from koord.recheck.world import opened
from koord.syntax import core
from koord.syntax.core import BinaryOp, ListOp, UnaryOp
from koord.syntax.types import (
    ArrayType,
    BoolType,
    FloatType,
    GrowingType,
    MapType,
    Type,
    atoms,
    contains,
)
from koord.syntax.walk import nodes


def answer(body: RunningBody, e: core.ExternalCall) -> Value:
    """An answer that the summary allows; equal for equal arguments. [EXTERNAL]"""
    function = body.world.program.external(e.function)
    arguments = [body.value(argument) for argument in e.arguments]
    pairs = list(zip(arguments, function.parameters, strict=True))
    result = function.result.type
    if function.kind is core.ExternalKind.FRESH:
        if body.closed:
            raise NotRecheckedError("a fresh answer in a property is not rechecked", e.span)
        found: Value = body.v.fresh(f"{function.name} by {who(body.robot)}", result)
    else:
        flat = [term for a, p in pairs for term, _ in body.v.leaves(a, p.type)]
        found = body.v.applied(function.name, flat, result)
    if body.in_summary:
        return found
    for term, type_ in body.v.leaves(found, result):
        for bound in body.v.bounds(term, type_):
            body.require(bound)
    met, promised = _summary(body, function, arguments, found)
    body.fault_unless(met, f"what {function.name} requires is not met", e.span)
    if not (function.kind is core.ExternalKind.FUNCTION and _promise_always(body, function)):
        body.require(body.t.implies(met, promised))
    return found


def _summary(
    body: RunningBody, function: core.External, arguments: Sequence[Value], answer: Value
) -> tuple[Term, Term]:
    """The conditions that a function requires, and that it promises of an answer."""
    outer, body.bound = (
        body.bound,
        [
            *(
                body.s.stored(a, p.type)
                for a, p in zip(arguments, function.parameters, strict=True)
            ),
            body.s.stored(answer, function.result.type),
            *[None] * (function.bound - len(arguments) - 1),
        ],
    )
    inside, body.in_summary = body.in_summary, True
    met = body.t.conjunction([body.statement(r) for r in function.requires])
    # A promise that looks into a sealed list is left out: that only makes proofs harder.
    kept = [q for q in function.ensures if not _looks_inside(body, q)]
    promised = body.t.conjunction([body.statement(q) for q in kept])
    body.in_summary, body.bound = inside, outer
    return met, promised


def _promise_always(asking: RunningBody, function: core.External) -> bool:
    """Assert the summary for all arguments, if the number of robots is open; return whether.

    A mathematical function keeps it for all arguments, asked for or not. [EXTERNAL] Not where
    one is a list that is looked into, or a map: there it is supposed of each question. Of all maps
    it would be supposed of those that are none, which may contradict it.
    """
    v = asking.v
    types = [p.type for p in function.parameters]
    if v.robots is not None or any(_is_long(one, v) or contains(one, MapType) for one in types):
        return False
    if function.name not in v.promised:
        v.promised.add(function.name)
        binders: list[Term] = []
        with v.scoped(()):
            body = asking.apart()
            names = [f"{function.name} {p.name}" for p in function.parameters]
            asked: list[Value] = [
                sums.binder(body, name, p.type, binders)
                for name, p in zip(names, function.parameters, strict=True)
            ]
            flat = [
                term
                for a, p in zip(asked, function.parameters, strict=True)
                for term, _ in v.leaves(a, p.type)
            ]
            answer = v.applied(function.name, flat, function.result.type)
            met, promised = _summary(body, function, asked, answer)
            inside = [
                bound
                for a, p in zip(asked, function.parameters, strict=True)
                for term, type_ in v.leaves(a, p.type)
                for bound in v.bounds(term, type_)
            ]
            known = v.t.conjunction([met, *inside])
            v.ranges.append(v.t.for_all(binders, v.t.implies(known, promised)))
    return True


def _looks_inside(body: RunningBody, promise: core.Expr) -> bool:
    sealed = body.world.sealed
    return any(type_ in sealed for node in nodes(promise) for type_ in opened(node))


def _is_long(type_: Type, v: Values) -> bool:
    """Return whether a value contains lists that are sequences in SMT."""
    return any(isinstance(atom, GrowingType) and atom not in v.sealed for atom in atoms(type_))


def who(robot: Term | None) -> str:
    """The robot as a part of an unknown's name."""
    return "a robot" if robot is None or robot.value is None else robot.head


def value(body: RunningBody, e: core.Expr) -> Value:
    """Evaluate an expression; faults are recorded, and evaluation goes on."""
    t = body.t
    match e:
        case core.Const():
            return _constant(body, e)
        case core.Pid():
            assert body.robot is not None
            return body.robot
        case core.NumAgents():
            return body.v.count
        case core.Delta():
            return t.real(body.world.delta_s)
        case core.Read():
            return places.read(body, e.place)
        case core.Select():
            return places.part(body, body.value(e.base), e.base.type, (e.step,))
        case core.Unary():
            return _unary(body, e)
        case core.Binary():
            return _binary(body, e)
        case core.Builtin():
            return _builtin(body, e)
        case core.MakeList(items=items) | core.MakeRecord(fields=items):
            return tuple(body.value(item) for item in items)
        case core.Call():
            return _call(body, e)
        case core.ExternalCall():
            return answer(body, e)
        case core.Choose():
            return _choose(body, e)
        case core.Quantified():
            return sums.quantified(body, e)
        case core.Ran() | core.Stopped():
            return all_robots.of_robot(body, e)
        case core.MakeMap():
            return _map(body, e)
    assert_never(e)


def _constant(body: RunningBody, e: core.Const) -> Term:
    match e.type:
        case BoolType():
            return body.t.truth(bool(e.value))
        case FloatType():
            assert not isinstance(e.value, str)
            return body.t.real(Fraction(e.value))
        case _:
            if isinstance(e.value, str):
                return body.v.text(e.value)
            return body.t.integer(int(e.value))


def _unary(body: RunningBody, e: core.Unary) -> Term:
    a = body.condition(e.operand)
    match e.op:
        case UnaryOp.NEG:
            return body.t.negative(a)
        case UnaryOp.NOT:
            return body.t.negation(a)
        case UnaryOp.WIDEN:
            return body.t.widened(a)
        case UnaryOp.ABS:
            zero = body.t.minus(a, a)
            return body.t.ite(body.t.less(a, zero), body.t.negative(a), a)
    assert_never(e.op)


def _binary(body: RunningBody, e: core.Binary) -> Term:
    t = body.t
    if e.op in (BinaryOp.AND, BinaryOp.OR, BinaryOp.IMPLIES):
        left = body.condition(e.left)
        needed = t.negation(left) if e.op is BinaryOp.OR else left
        if needed.value is False:
            return t.truth(e.op is not BinaryOp.AND)
        with body.where(needed):
            right = body.condition(e.right)
        join = {BinaryOp.AND: t.both, BinaryOp.OR: t.either}.get(e.op, t.implies)
        return join(left, right)
    if e.op in (BinaryOp.EQ, BinaryOp.NE):
        same = body.v.equal(body.value(e.left), body.value(e.right), _common(e))
        return same if e.op is BinaryOp.EQ else t.negation(same)
    a, b = body.condition(e.left), body.condition(e.right)
    if e.op in (BinaryOp.DIV, BinaryOp.MOD):
        is_zero = t.equal(b, t.minus(b, b))
        body.fault_unless(t.negation(is_zero), "division by zero", e.right.span)
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
            return body.v.around(a) if b is body.v.count else t.remainder(a, b)
        case BinaryOp.LT:
            return t.less(a, b)
        case BinaryOp.LE:
            return t.at_most(a, b)
        case BinaryOp.MIN:
            return t.ite(t.less(b, a), b, a)
        case BinaryOp.MAX:
            return t.ite(t.less(a, b), b, a)
    raise AssertionError(e.op)


def _builtin(body: RunningBody, e: core.Builtin) -> Value:
    first = e.arguments[0]
    if e.op is ListOp.LENGTH and isinstance(first.type, ArrayType):
        return (
            body.v.count
            if body.v.is_family(first.type)
            else body.t.integer(body.v.size(first.type))
        )
    value = body.value(first)
    if isinstance(value, Family) and e.op not in (ListOp.LENGTH, ListOp.CONTAINS):
        return all_robots.of_all(body, e, value)
    match e.op:
        case ListOp.LENGTH:
            return body.v.length(value, first.type)
        case ListOp.CONTAINS:
            return body.v.contains(value, body.value(e.arguments[1]), first.type)
        case ListOp.ANY | ListOp.ALL:
            join = body.t.disjunction if e.op is ListOp.ANY else body.t.conjunction
            return join(x for x in body.items(value, e.span) if isinstance(x, Term))
        case ListOp.MIN | ListOp.MAX:
            items = body.items(value, e.span)
            body.fault_unless(body.t.truth(bool(items)), "empty list", e.span)
            if not items:
                return body.v.default(e.type)
            return body.v.least(items, greatest=e.op is ListOp.MAX)
        case ListOp.KEYS:
            raise NotRecheckedError("going through a map is not rechecked", e.span)
    assert_never(e.op)


def _map(body: RunningBody, e: core.MakeMap) -> Value:
    """Evaluate a map literal: of two entries with one key the later counts. [E-MAP]"""
    assert isinstance(e.type, MapType)
    made = maps.empty(body.v, e.type)
    for key, value in e.entries:
        made = maps.with_entry(body.v, made, body.value(key), body.value(value), e.type)
    return made


def _call(body: RunningBody, e: core.Call) -> Value:
    """Call a function defined in Koord: its body, with variables of its own. [E-CALL]"""
    function = body.world.program.function(e.function)
    arguments: list[Storage | None] = [
        body.s.stored(body.value(a), p.type)
        for a, p in zip(e.arguments, function.parameters, strict=True)
    ]
    outer = (body.bound, body.frame, body.broke, body.path, body.outside)
    body.outside, body.path = body.t.both(body.outside, body.path), body.t.truth(True)
    body.bound = [*arguments, *[None] * (function.bound - len(arguments))]
    frame = Frame(body.s.unset(e.type), e.type, body.t.truth(False))
    body.frame, body.broke = frame, []
    body.run(function.body)
    body.bound, body.frame, body.broke, body.path, body.outside = outer
    value, is_set = body.s.read(frame.result, e.type)
    body.fault_unless(is_set, f"{e.function} returned nothing", e.span)
    return value


def _choose(body: RunningBody, e: core.Choose) -> Value:
    if body.closed:
        raise NotRecheckedError("choose in a property is not rechecked", e.span)
    low, high = body.condition(e.low), body.condition(e.high)
    body.fault_unless(body.t.at_most(low, high), "empty range to choose from", e.span)
    chosen = body.v.fresh(f"choice by {who(body.robot)}", e.type)
    assert isinstance(chosen, Term)
    body.require(body.t.both(body.t.at_most(low, chosen), body.t.at_most(chosen, high)))
    return chosen


def _common(e: core.Binary) -> Type:
    """The type in which two sides are compared: an array and a list as lists."""
    if isinstance(e.left.type, ArrayType):
        return e.right.type
    return e.left.type
