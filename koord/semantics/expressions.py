"""Evaluation of expressions: the rules of chapter 2, each cited where it stands.

Those about places and quantifiers have files of their own, below this one.
"""

from __future__ import annotations

from typing import TypeVar, assert_never

from koord.semantics import places, quantifiers
from koord.semantics.domain import NumberTooLongError, disjunction
from koord.semantics.every_number import Crowd
from koord.semantics.machine import Machine
from koord.semantics.storage import Cell, held
from koord.semantics.values import (
    Family,
    Rec,
    Seq,
    Table,
    Value,
    default,
    equal,
    insert,
    inside,
    listed,
    lookup,
    merge_known,
    scalar,
    sequence,
)
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, ListOp
from koord.syntax.faults import FaultKind
from koord.syntax.types import INT, ArrayType, Robots
from koord.syntax.walk import nodes

V = TypeVar("V")


def evaluate(m: Machine[V], e: core.Expr) -> Value[V]:
    """Evaluate an expression on the machine's memory. Total: faults are logged. [E-CONST]"""
    match e:
        case core.Read():
            return places.read(m, e.place)
        case core.Const():
            return m.d.const(e.value, e.type)
        case core.Binary():
            return binary(m, e)
        case core.Unary():
            return m.d.unary(e.op, scalar(evaluate(m, e.operand)))
        case core.Pid():
            return m.pid()
        case core.NumAgents():
            return m.count()
        case core.Delta():
            return m.d.const(m.system.delta_s, e.type)
        case core.Select():
            return places.select(m, e)
        case core.Builtin():
            return builtin(m, e)
        case core.MakeList():
            return listed(m.d, [evaluate(m, item) for item in e.items])
        case core.MakeRecord():
            return Rec(tuple(evaluate(m, part) for part in e.fields))
        case core.MakeMap():
            return make_map(m, e)
        case core.Call():
            return call(m, e)
        case core.ExternalCall():
            return external_call(m, e)
        case core.Choose():
            return choose(m, e)
        case core.Quantified():
            return quantified(m, e)
        case core.Ran():
            return places.ran(m, e)
        case core.Stopped():
            return places.stopped(m, e)
    assert_never(e)


def condition(m: Machine[V], e: core.Expr) -> V:
    """Evaluate a Boolean expression."""
    try:
        return scalar(evaluate(m, e))
    except NumberTooLongError as error:
        raise error.about(variables_in(e), e.span) from None


def variables_in(part: object) -> tuple[str, ...]:
    """The variables and ports that a part of a program reads, by name."""
    reads = (node.place.variable for node in nodes(part) if isinstance(node, core.Read))
    return tuple(dict.fromkeys(read.name for read in reads if read.home is not Home.BOUND))


def statement(m: Machine[V], e: core.Expr) -> V:
    """Return the condition that a statement is true and evaluates without a fault. [PROP-FAULT]"""
    faults, faulted = m.faults, m.faulted
    m.faults = []
    holds = condition(m, e)
    for fault, _ in m.faults:
        holds = m.both(holds, m.negated(fault))
    m.faults, m.faulted = faults, faulted
    return holds


# --- operators ----------------------------------------------------------------------------------


def binary(m: Machine[V], e: core.Binary) -> Value[V]:
    """Evaluate a binary operator. [E-EQUAL] [E-ARITH] [E-SHORT]"""
    match e.op:
        case BinaryOp.AND | BinaryOp.IMPLIES:
            left = condition(m, e.left)
            if m.d.known(left) is False:
                return m.truth(e.op is BinaryOp.IMPLIES)
            right = scalar(m.within(left, lambda: evaluate(m, e.right)))
            return m.d.binary(e.op, left, right)
        case BinaryOp.OR:
            left = condition(m, e.left)
            if m.d.known(left) is True:
                return m.truth(True)
            right = scalar(m.within(m.negated(left), lambda: evaluate(m, e.right)))
            return m.d.binary(e.op, left, right)
        case BinaryOp.EQ | BinaryOp.NE:
            same = equal(m.d, evaluate(m, e.left), evaluate(m, e.right))
            return same if e.op is BinaryOp.EQ else m.negated(same)
        case BinaryOp.DIV | BinaryOp.MOD:
            left, right = scalar(evaluate(m, e.left)), scalar(evaluate(m, e.right))
            zero = m.d.const(0, e.right.type)
            m.fault_unless(m.d.binary(BinaryOp.NE, right, zero), FaultKind.DIVISION, e.right.span)
            return m.d.binary(e.op, left, right)
        case _:
            left, right = scalar(evaluate(m, e.left)), scalar(evaluate(m, e.right))
            return m.d.binary(e.op, left, right)


def make_map(m: Machine[V], e: core.MakeMap) -> Value[V]:
    """Make a map from entries: of two with one key the later counts. [E-MAP]"""
    made: Table[V] = Table(m.d.const(0, INT), ())
    for key, value in e.entries:
        made = insert(m.d, made, evaluate(m, key), evaluate(m, value))
    return made


def call(m: Machine[V], e: core.Call) -> Value[V]:
    """Call a function defined in Koord: run its body on bound slots of its own. [E-CALL]"""
    function = m.system.program.function(e.function)
    arguments = [held(m.d, evaluate(m, argument)) for argument in e.arguments]
    caller = m.memory
    outer = (caller.bound, caller.broke, caller.returned, caller.result)
    caller.bound = [*arguments, *[None] * (function.bound - len(arguments))]
    caller.broke = caller.returned = m.truth(False)
    caller.result = None
    m.trail.append(e.site)
    m.run(function.body)
    m.trail.pop()
    result = m.memory.result
    m.memory.bound, m.memory.broke, m.memory.returned, m.memory.result = outer
    if result is None:
        result = Cell(m.truth(False), default(m.d, e.type, m.system.size))
    assert isinstance(result, Cell)
    m.fault_unless(result.is_set, FaultKind.UNSET, e.span, f"{e.function} returned nothing")
    return result.value


# --- what is left open --------------------------------------------------------------------------


def choose(m: Machine[V], e: core.Choose) -> Value[V]:
    """Evaluate ``choose``: ask the oracle; the answer has to lie in the range. [CHOOSE]"""
    low, high = scalar(evaluate(m, e.low)), scalar(evaluate(m, e.high))
    m.fault_unless(m.d.binary(BinaryOp.LE, low, high), FaultKind.CHOICE, e.span)
    value = m.oracle.choose((e.site, *m.trail), low, high, e.type)
    between = m.both(m.d.binary(BinaryOp.LE, low, value), m.d.binary(BinaryOp.LE, value, high))
    # An empty range is a fault already; then any value will do.
    empty = m.d.binary(BinaryOp.LT, high, low)
    m.require("CHOOSE", m.either(empty, between), "a chosen value lies in its range", e.span)
    return value


def external_call(m: Machine[V], e: core.ExternalCall) -> Value[V]:
    """Call an external function: ask the oracle, and require the function's summary. [EXTERNAL]"""
    function = m.system.program.external(e.function)
    arguments = tuple(evaluate(m, argument) for argument in e.arguments)
    answer = m.oracle.external(function, (e.site, *m.trail), arguments)
    if m.in_summary:
        # Summaries that mention external functions speak of them without summaries of their own.
        return answer
    bound = m.memory.bound
    known = [held(m.d, value) for value in (*arguments, answer)]
    m.memory.bound = [*known, *[None] * (function.bound - len(known))]
    m.in_summary = True
    m.trail.append(e.site)
    met = m.truth(True)
    for requirement in function.requires:
        holds = statement(m, requirement)
        m.fault_unless(holds, FaultKind.PRECONDITION, e.span, function.name)
        met = m.both(met, holds)
    promises = () if m.oracle.vouches_for(function) else function.ensures
    for promise in promises:
        holds = m.d.binary(BinaryOp.IMPLIES, met, statement(m, promise))
        what = f"the answer of {function.name} meets its summary"
        m.require("EXTERNAL", holds, what, promise.span)
    m.trail.pop()
    m.in_summary = False
    m.memory.bound = bound
    return answer


def quantified(m: Machine[V], e: core.Quantified) -> Value[V]:
    """Evaluate a quantifier; one over all values of a type (summaries only) by the oracle.
    [E-QUANT]
    [E-QUANT]
    """
    if not isinstance(e.domain, core.AllValues):
        return quantifiers.quantified(m, e)

    def body(value: Value[V]) -> V:
        m.memory.bound[e.variable.slot] = held(m.d, value)
        return statement(m, e.body)

    assert e.quantifier is core.QuantifierKind.FORALL
    return m.oracle.every(e.domain.type, body)


# --- functions of lists and maps ----------------------------------------------------------------


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
