"""Elaboration of calls, and of built-in functions whose types depend on their arguments."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, reduce

from koord.syntax import ast, core
from koord.syntax.analysis.folding import folded
from koord.syntax.diagnostics import Edit
from koord.syntax.elaboration.body import (
    CLOSED,
    LOGICAL,
    SEES_VARIABLES,
    BodyScope,
    MissingFunction,
    Where,
)
from koord.syntax.elaboration.coercion import POISON, fit, widened
from koord.syntax.elaboration.function_calls import call, candidates, is_named
from koord.syntax.elaboration.library import library_names
from koord.syntax.elaboration.literals import construct, keys_of, list_of
from koord.syntax.elaboration.phrases import a, did_you_mean, listed, mathematics, otherwise
from koord.syntax.elaboration.quantifiers import ran
from koord.syntax.elaboration.recorder import HOLE, OwnName
from koord.syntax.elaboration.resolve_types import element_of, is_numeric
from koord.syntax.elaboration.symbols import RecordInfo, VariableSymbol
from koord.syntax.source import NOWHERE, Span
from koord.syntax.types import BOOL, FLOAT, INT, POS, ArrayType, ListType, MapType, Robots, Type

Builtin = Callable[[BodyScope, ast.Call, Type | None], core.Expr | None]


def counted(body: BodyScope, e: ast.Call, count: int) -> bool:
    """Check the number of arguments."""
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


def _only(body: BodyScope, e: ast.Call, expected: Type | None = None) -> core.Expr | None:
    """Elaborate the only argument."""
    return body.expr(e.arguments[0].value, expected) if counted(body, e, 1) else None


def _no_list(body: BodyScope, e: ast.Expr, name: str, given: Type, of: str = "a list") -> None:
    body.error("K229", e.span, f"`{name}` wants {of}, not {a(given)}")


def _length(body: BodyScope, e: ast.Call, expected: Type | None) -> core.Expr | None:
    read_before = set(body.shared_reads)
    value = _only(body, e)
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
    if not counted(body, e, 2):
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
    """Elaborate ``keys(m)``: the keys of a map, or the elements of a set, as a list. [E-LIST]"""
    value = _only(body, e)
    if value is None:
        return None
    if not isinstance(value.type, MapType):
        _no_list(body, e.arguments[0].value, "keys", value.type, "a map or a set")
        return None
    return keys_of(value)


def _over_truths(op: core.ListOp) -> Builtin:
    def builtin(body: BodyScope, e: ast.Call, expected: Type | None) -> core.Expr | None:
        value = _only(body, e, ListType(BOOL))
        if value is None:
            return None
        if element_of(value.type) != BOOL:
            _no_list(body, e.arguments[0].value, op.value, value.type, "a list of truth values")
            return None
        return core.Builtin(op, (value,), BOOL, span=e.span)

    return builtin


def _numbers(body: BodyScope, e: ast.Call) -> list[core.Expr] | None:
    """Elaborate arguments that are all of one number type."""
    values = [body.expr(argument.value) for argument in e.arguments]
    found = [value for value in values if value is not None]
    if len(found) < len(values):
        return None
    for value in found:
        if not is_numeric(value.type):
            _no_list(body, e, e.function.name, value.type, "numbers")
            return None
    if any(value.type == FLOAT for value in found):
        return list(map(widened, found))
    return found


def _pair(e: ast.Call, op: core.BinaryOp, left: core.Expr, right: core.Expr) -> core.Expr:
    return folded(core.Binary(op, left, right, left.type, span=e.span))


def _clamp(body: BodyScope, e: ast.Call, expected: Type | None) -> core.Expr | None:
    """Elaborate ``clamp(x, low, high)`` as ``max(low, min(x, high))``. [E-ARITH]"""
    found = _numbers(body, e) if counted(body, e, 3) else None
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
    value = _only(body, e)
    if value is None:
        return None
    if not is_numeric(value.type):
        _no_list(body, e.arguments[0].value, "abs", value.type, "a number")
        return None
    return folded(core.Unary(core.UnaryOp.ABS, value, value.type, span=e.span))


def _float(body: BodyScope, e: ast.Call, expected: Type | None) -> core.Expr | None:
    if not counted(body, e, 1):
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


#: Ways that a planner was called by the name of the port that says which it is. [OLD-PLANNER]
PLANNER = "planner"
#: The port that says where a robot is.
PLACE = "psn"

#: Who leaves out more letters at the end of a name means another function.
_SLIP = 3

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
    """Elaborate a call by its name: the program's function, a record, a built-in, the library's."""
    name = e.function.name
    session = body.session
    if _is_bare(e):
        return _position(body, e)
    if name in session.functions.own and not body.library:
        return call(body, e, candidates(body, name))
    if name in session.types.records:
        return construct(body, e, session.types.records[name])
    if name in ("pos", "Point"):
        return construct(body, e, _POS)
    special = _SPECIAL.get(name)
    if special is not None:
        body.note(e.function.span, OwnName(name))
        return special(body, e)
    if name in CHANGES:
        return _change(body, e, name)
    if name == PLANNER and body.agent is not None:
        for module in body.agent.modules:
            found = _planned(body, e, module, e.function.span)
            if found is not None:
                return function_call(body, found, expected)
    if name in BUILTINS:
        body.note(e.function.span, OwnName(name))
        if is_named(body, e):
            return None
        return BUILTINS[name](body, e, expected)
    known = candidates(body, name)
    if known:
        return call(body, _of_positions(body, e, expected), known)
    element = element_read(body, e)
    if element is not None:
        return body.expr(element, expected)
    return _unknown(body, e, expected)


def element_read(body: BodyScope, e: ast.Call) -> ast.Index | None:
    """The element ``x[i]`` that ``get(x, i)`` is; None for another call. [OLD-ELEMENT]"""
    if e.function.name != "get" or len(e.arguments) != 2 or not _on_one_line(e):
        return None
    x, i = (argument.value for argument in e.arguments)
    edits = (*_indexed(e, x, i), _cut(e.span, i.span.end_column, e.span.end_column, "]"))
    body.findings.old("get", e.span, "`get(x, i)` is written `x[i]`", "index the list", *edits)
    return ast.Index(x, i, span=e.span)


def element_written(body: BodyScope, e: ast.Call) -> ast.Assign | None:
    """The assignment ``x[i] = v`` that ``put(x, i, v)`` is; None for another call. [OLD-ELEMENT]"""
    if e.function.name != "put" or len(e.arguments) != 3 or not _on_one_line(e):
        return None
    x, i, v = (argument.value for argument in e.arguments)
    edits = (
        *_indexed(e, x, i),
        _cut(e.span, i.span.end_column, v.span.column, "] = "),
        _cut(e.span, v.span.end_column, e.span.end_column),
    )
    was = "`put(x, i, v)` is written `x[i] = v`"
    body.findings.old("put", e.span, was, "assign to the element", *edits)
    return ast.Assign(ast.Index(x, i, span=e.span), v, span=e.span)


def _on_one_line(e: ast.Call) -> bool:
    """Return whether edits of a call leave its comments alone, and its arguments are not named."""
    return e.span.line == e.span.end_line and all(one.name is None for one in e.arguments)


def _indexed(e: ast.Call, x: ast.Expr, i: ast.Expr) -> tuple[Edit, Edit]:
    """The edits that make ``x[i`` of ``f(x, i``."""
    opened = _cut(e.span, e.span.column, x.span.column)
    return opened, _cut(e.span, x.span.end_column, i.span.column, "[")


def _cut(line: Span, begin: int, end: int, text: str = "") -> Edit:
    """The edit of columns of a line."""
    return Edit(Span(line.file, line.line, begin, line.line, end), text)


def _of_positions(body: BodyScope, e: ast.Call, expected: Type | None) -> ast.Call:
    """Elaborate ``getNeighbors(i)`` where positions are wanted. [OLD-NEIGHBOURS]

    It means the neighbours' entries of the one ``allread`` array of positions.
    """
    if e.function.name != "getNeighbors" or len(e.arguments) != 1 or expected != ListType(POS):
        return e
    if body.library or body.where not in SEES_VARIABLES:
        return e
    places = [
        name
        for name, symbol in body.session.shared.items()
        if isinstance(symbol, VariableSymbol)
        and symbol.variable.home is core.Home.ALLREAD
        and symbol.variable.type == ArrayType(POS, Robots.ALL)
    ]
    if not places:
        return e
    shown = f"`getNeighbors(…, {places[0]})`"
    if len(places) > 1:
        message = f"the positions of neighbours may be those in {listed(places)}"
        body.error("K210", e.span, message, f"write {shown}")
    else:
        end = e.span.end_column - 1
        before = Span(e.span.file, e.span.end_line, end, e.span.end_line, end)
        body.findings.old(
            "getNeighbors",
            e.span,
            f"the positions of neighbours are those in `{places[0]}`",
            f"write {shown}",
            Edit(before, f", {places[0]}"),
        )
    place = ast.Name(places[0], span=e.span)
    return ast.Call(e.function, (*e.arguments, ast.Argument(None, place, span=e.span)), span=e.span)


def _is_bare(e: ast.Call) -> bool:
    """Return whether a call is ``(x, y, z)``: its name takes no room in the text."""
    span = e.function.span
    return span.column == span.end_column and span != NOWHERE


def _position(body: BodyScope, e: ast.Call) -> core.Expr | None:
    """Elaborate ``(x, y, z)``. [OLD-POSITION]"""
    if len(e.arguments) == len(POS.fields):
        was, edit = "a position is written `pos(x, y, z)`", Edit(e.function.span, "pos")
        body.findings.old("pos", e.span, was, "write `pos` before `(`", edit)
    return construct(body, e, _POS)


#: Where statements may change lists.
_CHANGING = frozenset({Where.EFFECT, Where.INIT, Where.ENVIRONMENT, Where.FUNCTION})


def method_call(body: BodyScope, e: ast.MethodCall, expected: Type | None) -> core.Expr | None:
    """Elaborate ``x.f(a)`` as ``f(x, a)``, for the operations on lists."""
    if e.method.name in METHODS:
        return function_call(body, as_call(e), expected)
    if e.method.name == PLANNER and isinstance(e.receiver, ast.Name):
        found = _planned(body, e, e.receiver.name, e.receiver.span)
        if found is not None:
            return function_call(body, found, expected)
    for value in (e.receiver, *(argument.value for argument in e.arguments)):
        body.expr(value, POISON)
    body.error(
        "K202",
        e.method.span,
        f"there is no operation `{e.method.name}`",
        did_you_mean(e.method.name, METHODS) or _as_function(body, e),
    )
    return None


def _planned(
    body: BodyScope, e: ast.Call | ast.MethodCall, module: str, name: Span
) -> ast.Call | None:
    """Elaborate ``M.planner(goal, …)`` as ``findPath(M.psn, goal, …)``. [OLD-PLANNER]

    None if there is no module of that name that says where the robot is.
    """
    used = None if body.agent is None else body.agent.modules.get(module)
    if used is None or PLACE not in used.ports or len(e.arguments) not in (1, 2):
        return None
    called = Span(e.span.file, name.line, name.column, _opening(e).line, _opening(e).column)
    here = f"{module}.{PLACE}"
    body.findings.old(
        PLANNER,
        e.span,
        f"the planner of `{module}` is asked by `findPath`, from where the robot is",
        f"write `findPath({here}, …)`",
        Edit(called, f"findPath({here}, "),
    )
    base = ast.Name(module, span=name)
    place = ast.Attribute(base, ast.Ident(PLACE, span=name), span=name)
    start = ast.Argument(None, place, span=name)
    return ast.Call(ast.Ident("findPath", span=name), (start, *e.arguments), span=e.span)


def _opening(e: ast.Call | ast.MethodCall) -> Span:
    """The place where the first argument of a call begins."""
    return e.arguments[0].span


def _as_function(body: BodyScope, e: ast.MethodCall) -> str:
    """The hint for `x.f(a)` where there is no operation `f`."""
    name = e.method.name
    if name in _functions(body):
        return f"call the function as `{name}({'…, …' if e.arguments else '…'})`"
    return (
        f"lists have {listed(sorted(METHODS - {'assign', 'len'}))}; functions are called as `f(x)`"
    )


def _functions(body: BodyScope) -> list[str]:
    """The names of functions that can be called in an expression."""
    session = body.session
    drawn = ["choose"] if body.where in CLOSED | {Where.ENVIRONMENT, Where.INIT} else []
    own = [*session.functions.own, *session.types.records, "pos"]
    return [*own, *library_names(), *BUILTINS, *drawn]


def as_call(e: ast.MethodCall) -> ast.Call:
    """The function call that a method call stands for."""
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


def _unknown(body: BodyScope, e: ast.Call, expected: Type | None) -> core.Expr | None:
    values = [body.expr(argument.value, POISON) for argument in e.arguments]
    if body.session.partial:
        return None
    name = e.function.name
    if name == HOLE:
        from koord.syntax.elaboration.candidates import fill

        fill(body, expected, is_statement=body.where in _CHANGING)
    known = _functions(body) + (list(CHANGES) if body.where in _CHANGING else [])
    hint, near = otherwise(name) or mathematics(name), did_you_mean(name, known)
    if hint is None and near is not None and not _is_another(near, name):
        hint = near
    if hint is not None:
        if not body.is_told("K202", f"{name}()", e.function.span):
            body.error("K202", e.function.span, f"there is no function `{name}`", hint)
        return None
    body.findings.errors += 1  # told when all are known
    missing = body.session.missing.get(name)
    if missing is None:
        types = tuple(INT if value is None else value.type for value in values)
        result = FLOAT if expected is None or expected == POISON else expected
        missing = MissingFunction(e.function, types, result, is_fixed=False, near=near)
        body.session.missing[name] = missing
    missing.is_fixed |= body.where in LOGICAL
    if e.function.span not in missing.places:
        missing.places.append(e.function.span)
    return None


def _is_another(near: str, name: str) -> bool:
    """Return whether a name is too short for a slip of the pen: a function with more to its name.

    ``near`` is the hint with the known name.
    """
    known = near.split("`")[1]
    return len(known) - len(name) > _SLIP and known.lower().startswith(name.lower())


def _choose(body: BodyScope, e: ast.Call) -> core.Expr | None:
    """Elaborate ``choose(low, high)``. [ENV-TRANS]"""
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
        low, high = widened(low), widened(high)
    lower = fit(body, low, type_, e.arguments[0].span, "the lower bound")
    upper = fit(body, high, type_, e.arguments[1].span, "the upper bound")
    if lower is None or upper is None:
        return None
    return core.Choose(lower, upper, type_, body.fresh_site(), span=e.span)


_SPECIAL: dict[str, Callable[[BodyScope, ast.Call], core.Expr | None]] = {
    "choose": _choose,
    "ran": ran,
}
