"""Calls in expressions: what the name of the call means, and the operations on lists."""

from __future__ import annotations

from collections.abc import Callable

from koord.syntax import ast, core
from koord.syntax.elaboration.body import CLOSED, BodyScope, Where
from koord.syntax.elaboration.builtins import BUILTINS
from koord.syntax.elaboration.coercion import POISON, fit, widened
from koord.syntax.elaboration.function_calls import call, candidates, is_named
from koord.syntax.elaboration.library import library_names
from koord.syntax.elaboration.phrases import did_you_mean, listed, mathematics, otherwise
from koord.syntax.elaboration.quantifiers import ran
from koord.syntax.elaboration.records import construct
from koord.syntax.elaboration.symbols import RecordInfo
from koord.syntax.types import FLOAT, INT, POS, Type

#: Changes of a list, which are statements.
CHANGES = {
    "add": "s.add(x)",
    "append": "x.append(v)",
    "remove": "x.remove(v)",
    "pop": "v = pop(x)",
    "assign": "assign(task, pid)",
}

#: Operations that may be written behind their list: ``x.length()``.
METHODS = frozenset({"length", "len", "contains", "any", "all", "min", "max", "keys", *CHANGES})

_POS = RecordInfo(POS, (None, None, None), ast.Ident("pos"))


def function_call(body: BodyScope, e: ast.Call, expected: Type | None) -> core.Expr | None:
    """A call by its name: the program's function, a record, a built-in, the library's."""
    name = e.function.name
    session = body.session
    if name in session.functions.own and not body.library:
        return call(body, e, candidates(body, name))
    if name in session.types.records:
        return construct(body, e, session.types.records[name])
    if name in ("pos", "Point"):
        return construct(body, e, _POS)
    special = _SPECIAL.get(name)
    if special is not None:
        return special(body, e)
    if name in CHANGES:
        return _change(body, e, name)
    if name in BUILTINS:
        if is_named(body, e):
            return None
        return BUILTINS[name](body, e, expected)
    known = candidates(body, name)
    if known:
        return call(body, e, known)
    return _unknown(body, e)


#: Where statements may change lists.
_CHANGING = frozenset({Where.EFFECT, Where.INIT, Where.ENVIRONMENT, Where.FUNCTION})


def method_call(body: BodyScope, e: ast.MethodCall, expected: Type | None) -> core.Expr | None:
    """``x.f(a)`` is ``f(x, a)`` for the operations on lists."""
    if e.method.name in METHODS:
        return function_call(body, as_call(e), expected)
    for value in (e.receiver, *(argument.value for argument in e.arguments)):
        body.expr(value, POISON)
    body.error(
        "K202",
        e.method.span,
        f"there is no operation `{e.method.name}`",
        did_you_mean(e.method.name, METHODS) or _as_function(body, e),
    )
    return None


def _as_function(body: BodyScope, e: ast.MethodCall) -> str:
    """The hint for `x.f(a)` where there is no operation `f`."""
    name = e.method.name
    if name in _functions(body):
        return f"call the function as `{name}({'…, …' if e.arguments else '…'})`"
    return (
        f"lists have {listed(sorted(METHODS - {'assign', 'len'}))}; functions are called as `f(x)`"
    )


def _functions(body: BodyScope) -> list[str]:
    """What can be called in an expression."""
    session = body.session
    drawn = ["choose"] if body.where in CLOSED | {Where.ENVIRONMENT, Where.INIT} else []
    own = [*session.functions.own, *session.types.records, "pos"]
    return [*own, *library_names(), *BUILTINS, *drawn]


def as_call(e: ast.MethodCall) -> ast.Call:
    """The call that a method call means."""
    receiver = ast.Argument(None, e.receiver, span=e.receiver.span)
    return ast.Call(e.method, (receiver, *e.arguments), span=e.span)


def _change(body: BodyScope, e: ast.Call, name: str) -> core.Expr | None:
    for argument in e.arguments:
        body.expr(argument.value, POISON)
    body.error(
        "K228",
        e.span,
        f"`{name}` changes its first argument: it stands as a statement of its own",
        f"write `{CHANGES[name]}` on its own line",
    )
    return None


def _unknown(body: BodyScope, e: ast.Call) -> core.Expr | None:
    for argument in e.arguments:
        body.expr(argument.value, POISON)
    if body.session.partial:
        return None
    name = e.function.name
    if body.is_told("K202", f"{name}()", e.function.span):
        return None
    known = _functions(body) + (list(CHANGES) if body.where in _CHANGING else [])
    hint = otherwise(name) or mathematics(name) or did_you_mean(name, known)
    hint = hint or f"declare it: `def fun {name}(…) -> …:`"
    body.error("K202", e.function.span, f"there is no function `{name}`", hint)
    return None


def _choose(body: BodyScope, e: ast.Call) -> core.Expr | None:
    """``choose(low, high)``, [ENV-TRANS]."""
    if body.where in CLOSED:
        body.error(
            "K308",
            e.span,
            "in a property, `choose` stands in `… == choose(low, high)`",
            "or compare with the bounds",
        )
        return None
    if body.where not in (Where.ENVIRONMENT, Where.INIT):
        body.error(
            "K219",
            e.span,
            "`choose` stands in `environment:`, `init:` and properties only",
            "a program's own choices come from its events: write one event per choice",
        )
        return None
    if len(e.arguments) != 2:
        body.error("K217", e.span, f"`choose` takes 2 arguments, not {len(e.arguments)}")
        return None
    low, high = (body.expr(argument.value) for argument in e.arguments)
    if low is None or high is None:
        return None
    type_: Type = INT if low.type == INT and high.type == INT else FLOAT
    if type_ == FLOAT:
        low = widened(low) if low.type == INT else low
        high = widened(high) if high.type == INT else high
    lower = fit(body, low, type_, e.arguments[0].span, "the lower bound")
    upper = fit(body, high, type_, e.arguments[1].span, "the upper bound")
    if lower is None or upper is None:
        return None
    return core.Choose(lower, upper, type_, body.fresh_site(), span=e.span)


_SPECIAL: dict[str, Callable[[BodyScope, ast.Call], core.Expr | None]] = {
    "choose": _choose,
    "ran": ran,
}
