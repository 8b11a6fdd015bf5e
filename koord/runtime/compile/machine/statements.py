"""Compilation of statements to machine code, by the rules of chapter 3, or to doubt.

An event writes into cells of its own, which start as those of the robot; so does it read again what
it has written. Nothing of the fleet changes.
"""

from __future__ import annotations

from koord.machine.code import I64, Ir, word
from koord.runtime.compile.machine.body import Body
from koord.runtime.compile.machine.expressions import checked, elements, expression, located, truth
from koord.runtime.compile.machine.layout import NoCodeError, leaves
from koord.runtime.proposals import StopRequests
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home

#: Loops over the elements of longer arrays are left to Python, as they are written out.
_MOST_WRITTEN_OUT = 16


def block(body: Body, statements: core.Block) -> None:
    """Compile statements in order. [S-SEQ]"""
    for s in statements:
        statement(body, s)


def statement(body: Body, s: core.Stmt) -> None:
    """Compile one statement. Raises NoCodeError for what has no machine code."""
    body.budget.spend(1)
    match s:
        case core.Assign():
            _assign(body, s)
        case core.If():
            _if(body, s)
        case core.ForRange():
            _for_range(body, s)
        case core.ForEach():
            _for_each(body, s)
        case core.Break():
            body.leave_for(body.loops[-1])
        case core.Return():
            _return(body, s)
        case core.Atomic(lock_class=number, body=inner):
            # [ATOMIC]: entering is noted; who may enter is decided by the round.
            if body.locks is None:
                raise NoCodeError("an atomic block outside of events")
            body.b.store(body.b.or_(body.b.load(body.locks), word(1 << number)), body.locks)
            block(body, inner)
        case core.Stop():
            _ask(body, StopRequests.TO_STOP)
        case core.TryStop():
            _ask(body, StopRequests.TO_STOP_TOGETHER)
        case _:
            raise NoCodeError(type(s).__name__)


def _ask(body: Body, what: StopRequests) -> None:
    """Ask to stop; who has asked for more keeps to it. [STOP]"""
    if body.asked is None:
        raise NoCodeError("a stop outside of events")
    before = body.b.load(body.asked)
    more = body.b.icmp_signed("<", before, word(what.value))
    body.b.store(body.b.select(more, word(what.value), before), body.asked)


def _assign(body: Body, s: core.Assign) -> None:
    """Compile a write: the value first, then the path to the place. [S-ASSIGN]"""
    place = s.place
    value = expression(body, s.value)
    if place.variable.home is Home.ALLREAD:
        first = place.steps[0] if place.steps else None
        if not isinstance(first, core.IndexStep) or not isinstance(first.index, core.Pid):
            raise NoCodeError("an entry that is not the robot's own")
    if place.robot is not None:
        raise NoCodeError("another robot's")
    cells, at, type_ = located(body, place)
    if place.variable.home is not Home.BOUND and not cells.is_banked:
        raise NoCodeError("a write outside of events")
    if len(leaves(type_)) != len(value):
        raise NoCodeError("arrays of different lengths")
    body.store(cells, at, type_, value)


def _return(body: Body, s: core.Return) -> None:
    """Compile ``return``: of a function that is written out. [S-RETURN]"""
    frame = body.frame
    if frame.result is None or frame.type is None or s.value is None:
        raise NoCodeError("a return without a value")
    value = expression(body, s.value)
    if len(leaves(frame.type)) != len(value):
        raise NoCodeError("arrays of different lengths")
    body.store(frame.result, 0, frame.type, value)
    body.leave_for(frame.after)


def _if(body: Body, s: core.If) -> None:
    """Compile ``if``. [S-IF]"""
    b = body.b
    condition = truth(body, s.condition)
    then, otherwise, after = (b.append_basic_block(n) for n in ("then", "otherwise", "after"))
    b.cbranch(condition, then, otherwise)
    for start, inner in ((then, s.then), (otherwise, s.otherwise)):
        b.position_at_end(start)
        block(body, inner)
        b.branch(after)
    b.position_at_end(after)


def _for_range(body: Body, s: core.ForRange) -> None:
    """Compile a loop over a range: bounds are evaluated once. [S-FOR]"""
    b = body.b
    (low,), (high,) = expression(body, s.low), expression(body, s.high)
    trip = body.code.slot(I64)
    b.store(low, trip)
    head, inside, after = (b.append_basic_block(n) for n in ("head", "body", "after"))
    b.branch(head)
    b.position_at_end(head)
    now = b.load(trip)
    b.cbranch(b.icmp_signed("<", now, high), inside, after)
    b.position_at_end(inside)
    body.store(body.bound(s.variable), 0, s.variable.type, [now])
    _looped(body, s.body, after)
    b.store(checked(body, BinaryOp.ADD, b.load(trip), word(1)), trip)
    b.branch(head)
    b.position_at_end(after)


def _looped(body: Body, inner: core.Block, after: Ir) -> None:
    body.loops.append(after)
    block(body, inner)
    body.loops.pop()


def _for_each(body: Body, s: core.ForEach) -> None:
    """Compile a loop over elements of an array or a written list: it is written out. [S-FOREACH]"""
    items, _ = elements(body, s.sequence)
    if len(items) > _MOST_WRITTEN_OUT:
        raise NoCodeError("a long array")
    after = body.b.append_basic_block("after")
    for number, item in enumerate(items):
        if s.key is not None:
            body.store(body.bound(s.key), 0, s.key.type, [word(number)])
        body.store(body.bound(s.value), 0, s.value.type, item)
        _looped(body, s.body, after)
    body.b.branch(after)
    body.b.position_at_end(after)
