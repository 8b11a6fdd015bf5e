"""Elaboration of literals of lists, maps and sets."""

from __future__ import annotations

from koord.syntax import ast, core
from koord.syntax.elaboration.body import BodyScope
from koord.syntax.elaboration.coercion import POISON, fit, widened
from koord.syntax.elaboration.resolve_types import element_of
from koord.syntax.source import Span
from koord.syntax.types import (
    FLOAT,
    INT,
    PRESENT,
    ArrayType,
    ListType,
    MapType,
    QueueType,
    RecordType,
    Robots,
    SetType,
    Type,
)


def collection(body: BodyScope, e: ast.Collection, expected: Type | None) -> core.Expr | None:
    """Elaborate a list, map or set literal."""
    match e:
        case ast.ListLit(items=items):
            return list_of(body, items, expected, e.span)
        case ast.MapLit():
            return map_of(body, e, expected)
        case ast.SetLit():
            return set_of(body, e, expected)


def list_of(
    body: BodyScope, items: tuple[ast.Expr, ...], expected: Type | None, span: Span
) -> core.Expr | None:
    """Elaborate a list literal, of the type that its place wants if that is a list."""
    element = element_of(expected) if expected is not None else None
    if element is None or expected is None:
        return _inferred(body, items, expected, span)
    values = [
        fit(body, body.expr(item, element), element, item.span, "an element of this list")
        for item in items
    ]
    found = [value for value in values if value is not None]
    if len(found) < len(values):
        return None
    if isinstance(expected, ArrayType):
        return _array(body, found, expected, span)
    made = expected if isinstance(expected, QueueType) else ListType(element)
    return core.MakeList(tuple(found), made, span=span)


def _array(
    body: BodyScope, items: list[core.Expr], expected: ArrayType, span: Span
) -> core.Expr | None:
    if expected.size is Robots.ALL:
        body.error(
            "K204",
            span,
            "an array with one element per robot cannot be written as a list",
            "how many robots there are is not known here: assign the elements one by one",
        )
        return None
    if expected.size != len(items):
        body.error("K204", span, f"this has {len(items)} elements, not {expected.size}")
        return None
    return core.MakeList(tuple(items), expected, span=span)


def _inferred(
    body: BodyScope, items: tuple[ast.Expr, ...], expected: Type | None, span: Span
) -> core.Expr | None:
    if expected == POISON:
        for item in items:
            body.expr(item, expected)
        return None
    if not items:
        body.error(
            "K230",
            span,
            "nothing here says what this empty list holds",
            "assign it to a variable, whose type says it",
        )
        return None
    hint = expected if isinstance(expected, RecordType) else None
    values: list[core.Expr] = []
    wanted: Type | None = hint
    for item in items:
        value = body.expr(item, wanted)
        if value is None:
            return None
        wanted = wanted or value.type
        values.append(value)
    if any(value.type == FLOAT for value in values):
        values = [widened(value) if value.type == INT else value for value in values]
    element = values[0].type
    fitted = [
        fit(body, value, element, item.span, "an element of this list")
        for value, item in zip(values, items, strict=True)
    ]
    if any(value is None for value in fitted):
        return None
    return core.MakeList(tuple(values), ListType(element), span=span)


def set_of(body: BodyScope, e: ast.SetLit, expected: Type | None) -> core.Expr | None:
    """Elaborate a set literal: a map in which each element is present."""
    element = expected.key if isinstance(expected, SetType) else None
    made = list_of(body, e.items, None if element is None else ListType(element), e.span)
    if made is None:
        return None
    assert isinstance(made, core.MakeList)
    assert isinstance(made.type, ListType)
    present = core.Const(0, PRESENT, span=e.span)
    entries = tuple((item, present) for item in made.items)
    return core.MakeMap(entries, SetType(made.type.element, PRESENT), span=e.span)


def keys_of(of: core.Expr) -> core.Expr:
    """The keys of a map, or the elements of a set, as a list. [E-LIST]"""
    assert isinstance(of.type, MapType)
    return core.Builtin(core.ListOp.KEYS, (of,), ListType(of.type.key), span=of.span)


def gone_through(body: BodyScope, e: ast.Expr) -> core.Expr | None:
    """Elaborate the collection of a loop or quantifier: a list, array or map, or a set's keys."""
    of = body.expr(e)
    return keys_of(of) if of is not None and isinstance(of.type, SetType) else of


def map_of(body: BodyScope, e: ast.MapLit, expected: Type | None) -> core.Expr | None:
    """Elaborate a map literal."""
    if expected == POISON:
        return None
    wanted = expected if isinstance(expected, MapType) else _entry_types(body, e)
    if wanted is None:
        return None
    entries: list[tuple[core.Expr, core.Expr]] = []
    for key, value in e.entries:
        made_key = fit(body, body.expr(key, wanted.key), wanted.key, key.span, "a key of this map")
        made = fit(
            body, body.expr(value, wanted.value), wanted.value, value.span, "a value of this map"
        )
        if made_key is not None and made is not None:
            entries.append((made_key, made))
    if len(entries) < len(e.entries):
        return None
    return core.MakeMap(tuple(entries), wanted, span=e.span)


def _entry_types(body: BodyScope, e: ast.MapLit) -> MapType | None:
    """The types of the first entry."""
    if not e.entries:
        body.error(
            "K230",
            e.span,
            "nothing here says what this empty map holds",
            "assign it to a variable, whose type says it",
        )
        return None
    key, value = (body.expr(part) for part in e.entries[0])
    if key is None or value is None:
        return None
    return MapType(key.type, value.type)
