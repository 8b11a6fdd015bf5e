"""Loops of which one trip at most does something, whichever the answers want. [ELEMENTS]

``for i = 0, tasks: if owner[i] == -1 and not onTask: if wayIsClear(i): onTask = true …`` goes
through tasks in order, and yet may end with any free one, as each way may be clear or not. So the
order does not matter to what *may* happen: a loop is first come if its body is a block behind
conditions

- that cannot fault, and one of which is an answer that is free to be true or false,
- such that once the block has run no trip does anything: it leaves the loop, or makes a condition
  false that nothing makes true again.

Then it may end as it began, or with the block run for any one element that meets the other
conditions in what the loop began with, and in no other way.
"""

from __future__ import annotations

from koord.syntax import core
from koord.syntax.analysis.definedness import Sure
from koord.syntax.core import BinaryOp, Home, UnaryOp
from koord.syntax.types import BOOL
from koord.syntax.walk import chained, nodes, statements, written


def is_first_come(body: core.Block, variable: core.Variable, sure: Sure) -> bool:
    """Return whether a loop's body is first come; ``variable`` is the loop's."""
    conditions, block = _behind(body)
    open_ = [c for c in conditions if _is_open(c, sure)]
    closed = [c for c in conditions if not _is_open(c, sure)]
    if len(open_) != 1 or not all(sure.of(c) for c in conditions) or any(map(_asks, closed)):
        return False
    leaves = bool(block) and isinstance(block[-1], core.Break | core.Return)
    return leaves or any(_is_latch(c, block, variable) for c in closed)


def _behind(body: core.Block) -> tuple[list[core.Expr], core.Block]:
    """The conditions that stand before all that a body does, and what stands behind them."""
    conditions: list[core.Expr] = []
    while len(body) == 1 and isinstance(body[0], core.If) and not body[0].otherwise:
        conditions += chained(body[0].condition, BinaryOp.AND)
        body = body[0].then
    return conditions, body


def _is_open(e: core.Expr, sure: Sure) -> bool:
    """Return whether a condition is an answer of its own, and free: nothing is promised of it."""
    if not isinstance(e, core.ExternalCall) or any(map(_asks, e.arguments)):
        return False
    function = sure.system.program.external(e.function)
    is_free = not function.requires and not function.ensures
    is_fresh = function.kind is core.ExternalKind.FRESH and not function.constructs
    return is_free and is_fresh and function.result.type == BOOL


def _asks(e: core.Expr) -> bool:
    return any(isinstance(n, core.ExternalCall | core.Choose | core.Call) for n in nodes(e))


def _is_latch(condition: core.Expr, block: core.Block, variable: core.Variable) -> bool:
    """Return whether a condition is false once the block has run, and stays so."""
    match condition:
        case core.Unary(op=UnaryOp.NOT, operand=core.Read(place=place)):
            is_flag = True
        case core.Binary(
            op=BinaryOp.EQ, left=core.Read(place=place), right=core.Const(value=int(value))
        ) if value < 0:
            is_flag = False
        case _:
            return False
    if place.steps or place.robot is not None or place.variable.home not in _KEPT:
        return False
    writes = [s for s in statements(block) if _writes(s, place.variable)]
    if len(writes) != 1 or writes[0] not in block or not isinstance(writes[0], core.Assign):
        return False
    written_ = writes[0].value
    if is_flag:
        return isinstance(written_, core.Const) and written_.value is True
    # The loop's variable is no negative number.
    return isinstance(written_, core.Read) and written_.place == core.Place(variable, ())


#: What a robot reads of these is what it has written.
_KEPT = (Home.LOCAL, Home.ALLWRITE)


def _writes(s: core.Stmt, variable: core.Variable) -> bool:
    match s:
        case core.ForRange() | core.ForEach():
            return False  # their own variables are bound
        case _:
            return any(place.variable == variable for place in written(s))
