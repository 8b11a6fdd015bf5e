"""Quantifiers over robots, ranges and elements. [E-QUANT]"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeAlias, TypeVar

from koord.semantics.domain import disjunction
from koord.semantics.every_number import Crowd, NotFiniteError
from koord.semantics.machine import Machine
from koord.semantics.storage import (
    held,
)
from koord.semantics.values import (
    Family,
    Seq,
    Table,
    Value,
    inside,
    scalar,
    sequence,
)
from koord.syntax import core
from koord.syntax.core import BinaryOp, ListOp
from koord.syntax.faults import FaultKind
from koord.syntax.types import INT

V = TypeVar("V")

#: Low, high, the value that an integer stands for, and whether it counts.
Range: TypeAlias = "tuple[V, V, Callable[[V], Value[V]], Callable[[V], V]]"


def quantified(m: Machine[V], e: core.Quantified) -> Value[V]:
    """Evaluate a quantifier over finitely many values, one after the other. [E-QUANT]"""
    slot = e.variable.slot
    if m.system.crowd is not None and (over := span_of(m, e.domain)) is not None:
        return quantified_over(m, e, *over)
    universal = e.quantifier is core.QuantifierKind.FORALL
    result = m.truth(universal)
    for label, here, value in instances(m, e):
        m.system.budget.spend()
        # As with ``and`` and ``or``: what is decided already is not looked at.
        undecided = result if universal else m.negated(result)
        if m.d.known(undecided) is False:
            break
        m.memory.bound[slot] = held(m.d, value)
        relevant = m.both(undecided, here)
        m.trail.append(label)
        holds = scalar(m.within(relevant, lambda: m.value(e.body)))
        m.trail.pop()
        if universal:
            result = m.both(result, m.d.binary(BinaryOp.IMPLIES, here, holds))
        else:
            result = m.either(result, m.both(here, holds))
    return result


def span_of(m: Machine[V], over: core.QuantifierDomain) -> Range[V] | None:
    """The integers ``[low, high)`` of a quantifier over a crowd, which the domain cannot list.

    With them the value that each stands for, and the condition under which it counts.
    """
    crowd: Crowd[V] | None = m.system.crowd
    assert crowd is not None
    match over:
        case core.RobotRange(agent=agent):
            kind = agent

            def counts(i: V) -> V:
                return m.truth(True) if kind is None else crowd.is_of(i, kind)

            return crowd.first, crowd.count, lambda i: i, counts
        case core.IntRange(low=low, high=high):
            start, end = scalar(m.value(low)), scalar(m.value(high))
            if listable(m, low, high, start, end):
                return None
            return start, end, lambda i: i, lambda i: m.truth(True)
        case core.Elements(sequence=elements):
            items = sequence(m.value(elements))
            if not isinstance(items, Family):
                return None
            return crowd.first, crowd.count, items.at, lambda i: m.truth(True)
        case core.AllValues():
            return None


def quantified_over(
    m: Machine[V],
    e: core.Quantified,
    low: V,
    high: V,
    value: Callable[[V], Value[V]],
    counts: Callable[[V], V],
) -> V:
    """Evaluate a quantifier over integers that cannot be listed: value and faults. [E-QUANT]

    As with lists, a fault counts only if what comes before leaves the outcome undecided. Most often
    no instance can have one: that is seen where the outcome is worked out, and asked of no other.
    """
    crowd: Crowd[V] | None = m.system.crowd
    assert crowd is not None
    universal = e.quantifier is core.QuantifierKind.FORALL
    may_fault: list[bool] = []

    def undecided(i: V) -> V:
        """Return the condition that the instance for ``i`` does not decide the quantifier."""
        holds, _ = looked_at(m, e, value(i))
        return going_on(i, holds)

    def going_on(i: V, holds: V) -> V:
        wanted = holds if universal else m.negated(holds)
        return m.d.binary(BinaryOp.IMPLIES, counts(i), wanted)

    def first_looked_at(i: V) -> V:
        holds, faults = looked_at(m, e, value(i))
        broken = m.both(counts(i), disjunction(m.d, faults)) if faults else m.truth(False)
        may_fault.append(not crowd.is_never(low, i, high, broken))
        return going_on(i, holds)

    def sound(i: V) -> V:
        _, faults = looked_at(m, e, value(i))
        if not faults:
            return m.truth(True)
        broken = m.both(counts(i), disjunction(m.d, faults))
        return m.negated(m.both(broken, crowd.every(low, i, undecided)))

    every = crowd.every(low, high, first_looked_at)
    if not may_fault or any(may_fault):
        safe = crowd.every(low, high, sound)
        m.fault_unless(safe, FaultKind.UNSET, e.span, "in a quantifier")
    return every if universal else m.negated(every)


def looked_at(m: Machine[V], e: core.Quantified, value: Value[V]) -> tuple[V, list[V]]:
    """Evaluate the body of a quantifier for one value: the result, and conditions of its faults."""
    inner = m.apart()
    inner.memory.bound[e.variable.slot] = held(m.d, value)
    holds = scalar(inner.value(e.body))
    crowd: Crowd[V] | None = m.system.crowd
    assert crowd is not None
    for needed in inner.legality:
        # Nothing is left open in a statement but functions, which answer alike everywhere.
        crowd.assume(needed.condition)
    return holds, [fault for fault, _ in inner.faults]


def instances(m: Machine[V], e: core.Quantified) -> Iterator[tuple[int, V, Value[V]]]:
    """Yield the values of a bound variable, each with a number and the condition that it counts."""
    match e.domain:
        case core.RobotRange(agent=agent):
            for robot, kind in enumerate(m.system.kinds):
                if agent is None or kind == agent:
                    yield robot, m.truth(True), m.d.const(robot, INT)
        case core.IntRange(low=low, high=high):
            yield from integers(m, low, high)
        case core.Elements(sequence=over):
            items = sequence(m.value(over))
            for k, item in enumerate(items.items):
                here = inside(m.d, k, items.length)
                if m.d.known(here) is not False:
                    yield k, here, item
        case core.AllValues():
            raise AssertionError("expressions ask the oracle")


def integers(m: Machine[V], low: core.Expr, high: core.Expr) -> Iterator[tuple[int, V, V]]:
    """Yield the integers in ``[low, high)``, each with its condition.

    First as Python's own, which the keys of answers are made of. [RECORDING]
    """
    start, end = scalar(m.value(low)), scalar(m.value(high))
    first, last = limit(m, low, start, least=True), limit(m, high, end, least=False)
    for k in range(first, last):
        m.system.budget.spend()
        number = m.d.const(k, INT)
        above = m.d.binary(BinaryOp.LE, start, number)
        here = m.both(above, m.d.binary(BinaryOp.LT, number, end))
        if m.d.known(here) is not False:
            yield k, here, number


def listable(m: Machine[V], low: core.Expr, high: core.Expr, start: V, end: V) -> bool:
    """Return whether the domain knows bounds of a range, so that its integers can be listed."""
    if m.system.crowd is None:
        return True
    try:
        limit(m, low, start, least=True)
        limit(m, high, end, least=False)
    except NotFiniteError:
        return False
    return True


def limit(m: Machine[V], e: core.Expr, value: V, *, least: bool) -> int:
    """A bound on an integer that the domain knows in part: itself, or from its structure."""
    known = m.d.known(value)
    if known is not None:
        assert isinstance(known, int)
        return known
    match e:
        case core.Builtin(op=ListOp.LENGTH, arguments=(over,)):
            if least:
                return 0
            items = m.value(over)
            assert isinstance(items, Seq | Table)
            return len(items.items if isinstance(items, Seq) else items.entries)
        case core.Binary(op=BinaryOp.ADD, left=left, right=right):
            values = scalar(m.value(left)), scalar(m.value(right))
            return limit(m, left, values[0], least=least) + limit(m, right, values[1], least=least)
        case core.Binary(op=BinaryOp.SUB, left=left, right=right):
            values = scalar(m.value(left)), scalar(m.value(right))
            return limit(m, left, values[0], least=least) - limit(
                m, right, values[1], least=not least
            )
        case _:
            raise NotFiniteError(e.span, "the range has no bound that is known beforehand")
