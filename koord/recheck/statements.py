"""Statements of a body, as guarded commands. Here a body gets its rules."""

from __future__ import annotations

from collections.abc import Sequence
from typing import assert_never

from koord.recheck import expressions, places, quantifiers
from koord.recheck.body import RunningBody
from koord.recheck.loops import LoopTerms
from koord.recheck.sorts import Family, Value
from koord.recheck.storage import Memory
from koord.recheck.terms import Term
from koord.recheck.values import Values
from koord.recheck.world import Instance
from koord.syntax import core
from koord.syntax.types import INT as INTEGER


def body(world: Instance, values: Values, robot: Term | None, memory: Memory) -> RunningBody:
    """A body that a robot runs; nobody in a property."""
    return RunningBody(world, values, robot, memory, (expressions.value, run))


def run(body: RunningBody, block: core.Block) -> None:
    """The statements in order; what left the block does not go on."""
    outer = body.path
    for s in block:
        execute(body, s)
        left = [*body.broke[-1:], *([body.frame.returned] if body.frame else [])]
        body.path = body.t.both(outer, body.t.negation(body.t.disjunction(left)))
        if body.path.value is False:
            break
    body.path = outer


def execute(body: RunningBody, s: core.Stmt) -> None:
    t = body.t
    match s:
        case core.Assign():
            places.assign(body, s.place, body.value(s.value))
        case core.If():
            holds = body.condition(s.condition)
            for condition, block in ((holds, s.then), (t.negation(holds), s.otherwise)):
                if condition.value is not False:
                    with body.where(condition):
                        run(body, block)
        case core.ForRange() if is_open(body, s.low) or is_open(body, s.high):
            low, high = body.condition(s.low), body.condition(s.high)
            LoopTerms(body, low, high, s.variable, None, s.body, s.span).run()
        case core.ForRange():
            trips = [(None, t.integer(k)) for k in quantifiers.fixed_range(body, s.low, s.high)]
            go_through(body, trips, None, s.variable, s.body)
        case core.ForEach():
            over = body.value(s.sequence)
            if isinstance(over, Family):
                zero = t.integer(0)
                LoopTerms(body, zero, body.v.count, s.value, (over, s.key), s.body, s.span).run()
                return
            items = body.items(over, s.span)
            numbered = [(t.integer(k), item) for k, item in enumerate(items)]
            go_through(body, numbered, s.key, s.value, s.body)
        case core.Break():
            body.broke[-1] = t.either(body.broke[-1], body.path)
        case core.Return():
            leave(body, s)
        case core.Atomic():
            entered = body.entered.get(s.lock_class, t.truth(False))
            body.entered[s.lock_class] = t.either(entered, body.path)
            run(body, s.body)
        case core.Stop():
            body.stopped = t.either(body.stopped, body.path)
        case core.TryStop():
            body.asked = t.either(body.asked, body.path)
        case core.Output():
            for shown in s.values:
                body.value(shown)  # it may fault
        case core.Append():
            new = body.value(s.value)
            whole = places.read(body, s.place)
            places.assign(body, s.place, body.v.appended(whole, new, s.place.type))
        case core.Remove():
            places.removed(body, s)
        case core.Pop():
            places.popped(body, s)
        case _:
            assert_never(s)


def is_open(body: RunningBody, bound: core.Expr) -> bool:
    """Whether the bound of a loop is not a number, since that of robots is open."""
    return body.v.robots is None and body.condition(bound).value is None


def go_through(
    body: RunningBody,
    trips: Sequence[tuple[Term | None, Value]],
    key: core.Variable | None,
    variable: core.Variable,
    block: core.Block,
) -> None:
    """One trip after the other, until one breaks out. [S-FOR] [S-FOREACH] [S-BREAK]"""
    body.broke.append(body.t.truth(False))
    outer = body.path
    for number, value in trips:
        left = [body.broke[-1], *([body.frame.returned] if body.frame else [])]
        body.path = body.t.both(outer, body.t.negation(body.t.disjunction(left)))
        if body.path.value is False:
            break
        if key is not None and number is not None:
            body.bound[key.slot] = body.s.stored(number, INTEGER)
        body.bound[variable.slot] = body.s.stored(value, variable.type)
        run(body, block)
    body.broke.pop()
    body.path = outer


def leave(body: RunningBody, s: core.Return) -> None:
    frame = body.frame
    assert frame is not None
    if s.value is not None:
        assert frame.type is not None
        result = body.s.stored(body.value(s.value), frame.type)
        frame.result = body.s.merge(body.path, result, frame.result, frame.type)
    frame.returned = body.t.either(frame.returned, body.path)
