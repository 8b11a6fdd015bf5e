"""Functions whose types depend on their arguments: lengths, membership, extremes, list making."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, reduce

from koord.syntax import ast, core
from koord.syntax.analysis.folding import folded
from koord.syntax.elaboration.body import BodyScope
from koord.syntax.elaboration.coercion import POISON, fit, widened
from koord.syntax.elaboration.literals import keys_of, list_of
from koord.syntax.elaboration.phrases import a
from koord.syntax.elaboration.resolve_types import element_of, is_numeric
from koord.syntax.types import BOOL, FLOAT, INT, ArrayType, ListType, MapType, Type

Builtin = Callable[[BodyScope, ast.Call, Type | None], core.Expr | None]


def _counted(body: BodyScope, e: ast.Call, count: int) -> bool:
    if len(e.arguments) == count:
        return True
    for argument in e.arguments:
        body.expr(argument.value, POISON)
    plural = "" if count == 1 else "s"
    body.error(
        "K217",
        e.span,
        f"`{e.function.name}` takes {count} argument{plural}, not {len(e.arguments)}",
    )
    return False


def _no_list(body: BodyScope, e: ast.Expr, name: str, given: Type, of: str = "a list") -> None:
    body.error("K229", e.span, f"`{name}` wants {of}, not {a(given)}")


def _length(body: BodyScope, e: ast.Call, expected: Type | None) -> core.Expr | None:
    if not _counted(body, e, 1):
        return None
    read_before = set(body.shared_reads)
    value = body.expr(e.arguments[0].value)
    if value is None:
        return None
    if element_of(value.type) is None and not isinstance(value.type, MapType):
        _no_list(body, e.arguments[0].value, e.function.name, value.type, "a list, a map or a set")
        return None
    if isinstance(value.type, ArrayType) and isinstance(value, core.Read) and _fixed(value.place):
        # the size of an array is no matter of its elements, which may be unset
        body.shared_reads = read_before
        if isinstance(value.type.size, int):
            return core.Const(value.type.size, INT, span=e.span)
        return core.NumAgents(INT, span=e.span)
    return core.Builtin(core.ListOp.LENGTH, (value,), INT, span=e.span)


def _fixed(place: core.Place) -> bool:
    return all(isinstance(step, core.FieldStep) for step in place.steps)


def _contains(body: BodyScope, e: ast.Call, expected: Type | None) -> core.Expr | None:
    if not _counted(body, e, 2):
        return None
    where, what = (argument.value for argument in e.arguments)
    sequence = body.expr(where)
    if sequence is None:
        body.expr(what, POISON)
        return None
    wanted = sequence.type.key if isinstance(sequence.type, MapType) else element_of(sequence.type)
    if wanted is None:
        body.expr(what, POISON)
        _no_list(body, where, "contains", sequence.type, "a list or a map")
        return None
    value = fit(body, body.expr(what, wanted), wanted, what.span, "what `contains` looks for")
    if value is None:
        return None
    return core.Builtin(core.ListOp.CONTAINS, (sequence, value), BOOL, span=e.span)


def _keys(body: BodyScope, e: ast.Call, expected: Type | None) -> core.Expr | None:
    """``keys(m)``: the keys of a map, or the elements of a set, as a list. [E-LIST]"""
    value = body.expr(e.arguments[0].value) if _counted(body, e, 1) else None
    if value is None:
        return None
    if not isinstance(value.type, MapType):
        _no_list(body, e.arguments[0].value, "keys", value.type, "a map or a set")
        return None
    return keys_of(value)


def _over_truths(op: core.ListOp) -> Builtin:
    def builtin(body: BodyScope, e: ast.Call, expected: Type | None) -> core.Expr | None:
        if not _counted(body, e, 1):
            return None
        value = body.expr(e.arguments[0].value, ListType(BOOL))
        if value is None:
            return None
        if element_of(value.type) != BOOL:
            _no_list(body, e.arguments[0].value, op.value, value.type, "a list of truth values")
            return None
        return core.Builtin(op, (value,), BOOL, span=e.span)

    return builtin


def _numbers(body: BodyScope, e: ast.Call) -> list[core.Expr] | None:
    """The arguments, all of one number type."""
    found: list[core.Expr] = []
    for value in [body.expr(argument.value) for argument in e.arguments]:
        if value is None:
            return None
        found.append(value)
    for value in found:
        if not is_numeric(value.type):
            _no_list(body, e, e.function.name, value.type, "numbers")
            return None
    if any(value.type == FLOAT for value in found):
        return [widened(value) if value.type == INT else value for value in found]
    return found


def _pair(e: ast.Call, op: core.BinaryOp, left: core.Expr, right: core.Expr) -> core.Expr:
    return folded(core.Binary(op, left, right, left.type, span=e.span))


def _clamp(body: BodyScope, e: ast.Call, expected: Type | None) -> core.Expr | None:
    """``clamp(x, low, high)`` is ``max(low, min(x, high))``. [E-ARITH]"""
    found = _numbers(body, e) if _counted(body, e, 3) else None
    if found is None:
        return None
    x, low, high = found
    return _pair(e, core.BinaryOp.MAX, low, _pair(e, core.BinaryOp.MIN, x, high))


def _extreme(op: core.ListOp, pair: core.BinaryOp) -> Builtin:
    def builtin(body: BodyScope, e: ast.Call, expected: Type | None) -> core.Expr | None:
        if len(e.arguments) == 1:
            return of_list(body, e)
        if not e.arguments:
            body.error("K217", e.span, f"`{op.value}` takes a list or at least 2 numbers")
            return None
        found = _numbers(body, e)
        return None if found is None else reduce(partial(_pair, e, pair), found)

    def of_list(body: BodyScope, e: ast.Call) -> core.Expr | None:
        value = body.expr(e.arguments[0].value)
        if value is None:
            return None
        element = element_of(value.type)
        if element is None or not is_numeric(element):
            _no_list(body, e.arguments[0].value, op.value, value.type, "a list of numbers")
            return None
        return core.Builtin(op, (value,), element, span=e.span)

    return builtin


def _abs(body: BodyScope, e: ast.Call, expected: Type | None) -> core.Expr | None:
    if not _counted(body, e, 1):
        return None
    value = body.expr(e.arguments[0].value)
    if value is None:
        return None
    if not is_numeric(value.type):
        _no_list(body, e.arguments[0].value, "abs", value.type, "a number")
        return None
    return folded(core.Unary(core.UnaryOp.ABS, value, value.type, span=e.span))


def _float(body: BodyScope, e: ast.Call, expected: Type | None) -> core.Expr | None:
    if not _counted(body, e, 1):
        return None
    value = e.arguments[0].value
    return fit(body, body.expr(value), FLOAT, value.span, "the argument of `float`")


def _to_list(body: BodyScope, e: ast.Call, expected: Type | None) -> core.Expr | None:
    return list_of(body, tuple(argument.value for argument in e.arguments), expected, e.span)


BUILTINS: dict[str, Builtin] = {
    "length": _length,
    "len": _length,
    "contains": _contains,
    "any": _over_truths(core.ListOp.ANY),
    "all": _over_truths(core.ListOp.ALL),
    "min": _extreme(core.ListOp.MIN, core.BinaryOp.MIN),
    "max": _extreme(core.ListOp.MAX, core.BinaryOp.MAX),
    "clamp": _clamp,
    "abs": _abs,
    "float": _float,
    "keys": _keys,
    "toList": _to_list,
}
