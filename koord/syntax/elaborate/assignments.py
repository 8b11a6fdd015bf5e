"""Assignments."""

from __future__ import annotations

from fractions import Fraction

from koord.syntax import ast, core
from koord.syntax.elaborate.body import Body
from koord.syntax.elaborate.changes import call_statement, pop_into
from koord.syntax.elaborate.coercion import POISON, fit, stores_list
from koord.syntax.elaborate.phrases import a
from koord.syntax.elaborate.places import meaning
from koord.syntax.elaborate.resolve_types import is_numeric
from koord.syntax.elaborate.targets import place_shown, target
from koord.syntax.types import FLOAT, INT


def assign(body: Body, s: ast.Assign) -> core.Block:
    """``target = value``"""
    value = s.value
    if isinstance(value, ast.Call | ast.MethodCall):
        name = _called(value)
        if name == "pop" and "pop" not in body.session.functions.own:
            return pop_into(body, s)
        own = name in body.session.functions.own
        if name in ("append", "remove") and not own and _same(_changed(value), s.target):
            # the functional spelling, x = append(x, v)
            return call_statement(body, ast.CallStmt(value, span=s.span))
    place = target(body, s.target)
    found = body.expr(value, place.type if place is not None else POISON)
    if place is None or found is None:
        return ()
    if stores_list(body, place, found, s.target.span.to(s.value.span)):
        return ()
    fitted = fit(body, found, place.type, value.span, place_shown(place, s.target))
    return () if fitted is None else (core.Assign(place, fitted, span=s.span),)


def _called(value: ast.Call | ast.MethodCall) -> str:
    return value.function.name if isinstance(value, ast.Call) else value.method.name


def _changed(value: ast.Call | ast.MethodCall) -> ast.Expr | None:
    if isinstance(value, ast.MethodCall):
        return value.receiver
    return value.arguments[0].value if value.arguments else None


def _same(one: ast.Expr | None, other: ast.Expr) -> bool:
    try:
        return one == other
    except RecursionError:  # trees that are refused for their depth later
        return False


def increment(body: Body, s: ast.Increment) -> core.Block:
    """``x++``, ``x--``"""
    place = target(body, s.target)
    if place is None:
        return ()
    old = meaning(body, s.target)  # once more, as what is read
    if not isinstance(old, core.Place):
        return ()
    if not is_numeric(place.type):
        sign = "++" if s.amount > 0 else "--"
        body.error("K229", s.span, f"`{sign}` applies to numbers, not to {a(place.type)}")
        return ()
    one = (
        core.Const(abs(s.amount), INT, span=s.span)
        if place.type == INT
        else core.Const(Fraction(abs(s.amount)), FLOAT, span=s.span)
    )
    op = core.BinaryOp.ADD if s.amount > 0 else core.BinaryOp.SUB
    read = core.Read(old, span=s.target.span)
    return (core.Assign(place, core.Binary(op, read, one, place.type, span=s.span), span=s.span),)
