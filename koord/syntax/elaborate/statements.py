"""Statements: one case per form."""

from __future__ import annotations

from typing import assert_never

from koord.syntax import ast, core
from koord.syntax.elaborate import loops
from koord.syntax.elaborate.assignments import assign, increment
from koord.syntax.elaborate.body import MAX_DEPTH, Body, Where
from koord.syntax.elaborate.changes import call_statement
from koord.syntax.elaborate.coercion import fit
from koord.syntax.elaborate.resolve_types import resolve
from koord.syntax.elaborate.session import AtomicBlock
from koord.syntax.elaborate.streams import output
from koord.syntax.elaborate.symbols import Role
from koord.syntax.types import BOOL, STREAM

_PROGRAM = frozenset({Where.EFFECT, Where.INIT})
#: Where a body has variables of its own, gone when it ends.
_OWN_VARIABLES = frozenset({Where.FUNCTION, Where.ENVIRONMENT})


def block(body: Body, statements: ast.Block) -> core.Block:
    """The statements in order; wrong ones are left out, and told."""
    if body.depth >= MAX_DEPTH:
        body.error(
            "K231",
            statements[0].span,
            f"this is nested more than {MAX_DEPTH} deep",
            "make a function of the inner ones",
        )
        return ()
    body.depth += 1
    result: list[core.Stmt] = []
    for s in statements:
        match s:
            case ast.Assign():
                made = assign(body, s)
            case ast.If():
                made = if_(body, s)
            case ast.ForRange():
                made = loops.for_range(body, s)
            case ast.ForEach():
                made = loops.for_each(body, s)
            case ast.CallStmt():
                made = call_statement(body, s)
            case ast.Increment():
                made = increment(body, s)
            case ast.Atomic():
                made = _atomic(body, s)
            case ast.Break():
                made = loops.break_(body, s)
            case ast.Return():
                made = _return(body, s)
            case ast.Stop() | ast.TryStop():
                made = _stop(body, s)
            case ast.Output():
                made = output(body, s)
            case ast.LocalDecl():
                made = _local(body, s)
            case ast.Pass():
                made = ()
            case _:
                assert_never(s)
        result.extend(made)
    body.depth -= 1
    return tuple(result)


def if_(body: Body, s: ast.If) -> core.Block:
    """``if … elif … else`` as nested two-way choices."""
    if len(s.arms) + body.depth > MAX_DEPTH:
        body.error(
            "K231",
            s.arms[MAX_DEPTH - body.depth][0].span,
            f"this is nested more than {MAX_DEPTH} deep: an `elif` is an `if` in the `else` before",
        )
        return ()
    arms: list[tuple[core.Expr | None, core.Block]] = []
    for condition, then in s.arms:
        tested = fit(
            body, body.expr(condition, BOOL), BOOL, condition.span, "the condition of `if`"
        )
        arms.append((tested, body.block(then)))
    otherwise = body.block(s.otherwise) if s.otherwise is not None else ()
    for tested, inner in reversed(arms):
        if tested is None:
            return ()
        otherwise = (core.If(tested, inner, otherwise, span=s.span),)
    return otherwise


def _atomic(body: Body, s: ast.Atomic) -> core.Block:
    if body.where is not Where.EFFECT:
        body.error(
            "K225",
            s.span,
            f"`atomic` has no place in {body.where.value}",
            "it keeps the events of robots apart; only effects need it",
        )
        body.block(s.body)
        return ()
    if body.atomic is not None:
        body.error(
            "K214",
            s.span,
            "`atomic` stands inside `atomic`",
            "the outer one locks the whole effect already: leave this one out",
        )
        return body.block(s.body)
    blocks = body.session.atomic_blocks
    body.atomic = blocks.setdefault(id(s), AtomicBlock(len(blocks)))
    inner = body.block(s.body)
    made = core.Atomic(body.atomic.number, inner, span=s.span)
    body.atomic = None
    return (made,)


def _return(body: Body, s: ast.Return) -> core.Block:
    if body.where is not Where.FUNCTION:
        body.error(
            "K221",
            s.span,
            "`return` stands in functions only",
            "to end an effect early, put the rest under `else:`",
        )
        return ()
    if s.value is None:
        if body.result is not None:
            body.error("K222", s.span, "this function returns a value: say which")
        return (core.Return(None, span=s.span),)
    value = body.expr(s.value, body.result)
    if body.result is None:
        if value is not None:
            body.error(
                "K222",
                s.value.span,
                "this function has no result",
                "declare its type: `def fun f(…) -> int:`",
            )
        return ()
    value = fit(body, value, body.result, s.value.span, "the result")
    return () if value is None else (core.Return(value, span=s.span),)


def _stop(body: Body, s: ast.Stop | ast.TryStop) -> core.Block:
    word = "stop" if isinstance(s, ast.Stop) else "trystop"
    if body.where not in _PROGRAM:
        body.error("K225", s.span, f"`{word}` has no place in {body.where.value}")
        return ()
    return (core.Stop(span=s.span) if isinstance(s, ast.Stop) else core.TryStop(span=s.span),)


def _local(body: Body, s: ast.LocalDecl) -> core.Block:
    decl = s.decl
    if body.where not in _OWN_VARIABLES:
        body.error(
            "K223",
            s.span,
            f"variables are not declared in {body.where.value}",
            f"declare `{decl.name.name}` under `local:`",
        )
        # what follows may use it
        body.declare(decl.name, None, Role.LOCAL)
        return ()
    constants = Body(body.session, Where.CONSTANT, None, body.findings)
    type_ = resolve(constants, decl.type)
    if type_ == STREAM:
        body.error("K238", decl.span, "a stream is a port of a module, not a variable")
        type_ = None
    value = None
    if decl.initial is not None:
        what = f"`{decl.name.name}`"
        value = fit(body, body.expr(decl.initial, type_), type_, decl.initial.span, what)
    known = body.lookup(decl.name.name)
    if known is not None:
        body.error("K208", decl.name.span, f"`{decl.name.name}` is {known.role.value} already")
    symbol = body.declare(decl.name, type_, Role.LOCAL)
    if symbol.variable is None or value is None:
        return ()
    place = core.Place(symbol.variable, span=decl.name.span)
    return (core.Assign(place, value, span=s.span),)
