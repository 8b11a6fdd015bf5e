"""Functions of lists and maps. [E-LIST]"""

from __future__ import annotations

from typing import TypeVar, assert_never

from koord.semantics.domain import disjunction
from koord.semantics.every_number import Crowd
from koord.semantics.machine import Machine
from koord.semantics.values import (
    Family,
    Seq,
    Table,
    Value,
    default,
    equal,
    inside,
    lookup,
    merge_known,
    scalar,
    sequence,
)
from koord.syntax import core
from koord.syntax.core import BinaryOp, ListOp
from koord.syntax.faults import FaultKind
from koord.syntax.types import INT, ArrayType, Robots

V = TypeVar("V")


def builtin(m: Machine[V], e: core.Builtin) -> Value[V]:
    """Apply a function of lists and maps. [E-LIST]"""
    first = e.arguments[0]
    if e.op is ListOp.LENGTH and isinstance(first.type, ArrayType):
        # A fixed array's length is known without reading what may still be unset.
        size = first.type.size
        return m.count() if size is Robots.ALL else m.d.const(size, INT)
    value = m.value(first)
    match e.op:
        case ListOp.LENGTH:
            assert isinstance(value, Seq | Table)
            return value.length
        case ListOp.CONTAINS:
            return contains(m, value, m.value(e.arguments[1]))
        case ListOp.ANY | ListOp.ALL:
            return any_or_all(m, e.op, sequence(value))
        case ListOp.MIN | ListOp.MAX:
            return extreme(m, e, sequence(value))
        case ListOp.KEYS:
            assert isinstance(value, Table)
            return Seq(value.length, tuple(key for key, _ in value.entries))
    assert_never(e.op)


def contains(m: Machine[V], value: Value[V], wanted: Value[V]) -> V:
    """Return the condition that a list has an element, or a map a key."""
    if isinstance(value, Table):
        entries: Table[V] = value
        found_key, _ = lookup(m.d, entries, wanted)
        return found_key
    items = sequence(value)
    if isinstance(items, Family):
        family: Family[V] = items
        return m.negated(family.every(lambda item: m.negated(equal(m.d, item, wanted))))
    found = [
        m.both(inside(m.d, k, items.length), equal(m.d, item, wanted))
        for k, item in enumerate(items.items)
    ]
    return disjunction(m.d, found)


def any_or_all(m: Machine[V], op: ListOp, items: Seq[V]) -> V:
    """Return the condition that some (or every) element of a list of Booleans is true."""
    if isinstance(items, Family):
        family: Family[V] = items
        if op is ListOp.ALL:
            return family.every(scalar)
        return m.negated(family.every(lambda item: m.negated(scalar(item))))
    result = m.truth(op is ListOp.ALL)
    for k, item in enumerate(items.items):
        here = inside(m.d, k, items.length)
        if op is ListOp.ANY:
            result = m.either(result, m.both(here, scalar(item)))
        else:
            result = m.both(result, m.d.binary(BinaryOp.IMPLIES, here, scalar(item)))
    return result


def extreme(m: Machine[V], e: core.Builtin, items: Seq[V]) -> V:
    """The least or greatest element of a list of numbers; of an empty one a fault."""
    some = m.d.binary(BinaryOp.LT, m.d.const(0, INT), items.length)
    m.fault_unless(some, FaultKind.EMPTY, e.span)
    op = BinaryOp.MIN if e.op is ListOp.MIN else BinaryOp.MAX
    if isinstance(items, Family):
        family: Family[V] = items
        return extreme_of_all(op, family)
    if not items.items:
        nothing: V = scalar(default(m.d, e.type, m.system.size))
        return nothing
    best = scalar(items.items[0])
    for k, item in enumerate(items.items[1:], start=1):
        better = m.d.binary(op, best, scalar(item))
        best = scalar(merge_known(m.d, inside(m.d, k, items.length), better, best))
    return best


def extreme_of_all(op: BinaryOp, items: Family[V]) -> V:
    """The least or greatest element of an array over the robots of a crowd."""
    crowd: Crowd[V] = items.crowd
    best: V = crowd.extreme(op, crowd.first, crowd.count, lambda i: scalar(items.at(i)))
    return best
