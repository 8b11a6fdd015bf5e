"""Quantifiers in statements, over what there is a list of, and what is said of numbered robots."""

from __future__ import annotations

from collections.abc import Sequence
from typing import assert_never

from koord.recheck import all_robots
from koord.recheck.body import RunningBody
from koord.recheck.sorts import NotRecheckedError, Value
from koord.recheck.terms import Term
from koord.syntax import core
from koord.syntax.core import QuantifierKind
from koord.syntax.types import MapType, Type, contains


def quantified(body: RunningBody, e: core.Quantified) -> Term:
    slot, universal = e.variable.slot, e.quantifier is QuantifierKind.FORALL
    if isinstance(e.domain, core.AllValues):
        return every_value(body, e, e.domain.type)
    if all_robots.is_open(body, e.domain):
        return all_robots.quantified(body, e)
    result = body.t.truth(universal)
    for value in instances(body, e):
        # What is decided already is not looked at, and cannot fault.
        undecided = result if universal else body.t.negation(result)
        body.bound[slot] = body.s.stored(value, e.variable.type)
        with body.where(undecided):
            holds = body.condition(e.body)
        result = body.t.both(result, holds) if universal else body.t.either(result, holds)
    return result


def instances(body: RunningBody, e: core.Quantified) -> list[Value]:
    match e.domain:
        case core.RobotRange(agent=agent):
            kinds = body.world.kinds
            return [body.t.integer(i) for i, k in enumerate(kinds) if agent in (None, k)]
        case core.IntRange(low=low, high=high):
            return [body.t.integer(k) for k in fixed_range(body, low, high)]
        case core.Elements(sequence=over):
            return list(body.items(body.value(over), e.span))
        case core.AllValues():
            raise AssertionError("has no list of values")
    assert_never(e.domain)


def fixed_range(body: RunningBody, low: core.Expr, high: core.Expr) -> range:
    start, end = body.condition(low).value, body.condition(high).value
    if start is None or end is None:
        where = low if start is None else high
        raise NotRecheckedError(
            "a range whose bounds are not fixed by the text is not rechecked", where.span
        )
    return range(int(start), int(end))


def every_value(body: RunningBody, e: core.Quantified, type_: Type) -> Term:
    """A mathematical quantifier, in a summary."""
    assert e.quantifier is QuantifierKind.FORALL
    if contains(type_, MapType):
        raise NotRecheckedError("statements about all maps are not rechecked", e.span)
    binders: list[Term] = []
    body.bound[e.variable.slot] = body.s.stored(
        binder(body, e.variable.name, type_, binders), type_
    )
    with body.v.scoped((*body.v.scope, *binders)):
        holds = body.statement(e.body)
    ranges = [b for x in binders for b in body.v.bounds(x, type_)]
    return body.t.for_all(binders, body.t.implies(body.t.conjunction(ranges), holds))


def binder(body: RunningBody, name: str, type_: Type, binders: list[Term]) -> Value:
    """A value of variables of a quantifier, which are added to the others."""
    parts = body.v.parts(type_)
    if parts is not None:
        return tuple(binder(body, name + label, part, binders) for label, part in parts)
    symbol = body.t.symbol(f"?{name}", body.v.sort(type_))
    binders.append(symbol)
    return symbol


def of_robots(body: RunningBody, number: core.Expr, holds: Sequence[Term]) -> Term:
    """Whether something holds of the robot that the number names; false if there is none."""
    index = body.condition(number)
    return body.t.disjunction(
        body.t.both(body.t.equal(index, body.t.integer(i)), x) for i, x in enumerate(holds)
    )


def ran(body: RunningBody, e: core.Ran, robot: int) -> Term:
    position = body.state().robots[robot].ran
    positions = [p for kind, p in e.events if kind == body.world.kinds[robot]]
    return body.t.disjunction(body.t.equal(position, body.t.integer(p)) for p in positions)
