"""Literals of lists and maps, and records made: ``Task(loc = p)``, ``pos(1, 2, 0)``."""

from __future__ import annotations

from koord.syntax import ast, core
from koord.syntax.elaboration.body import BodyScope, Where
from koord.syntax.elaboration.coercion import POISON, fit, widened
from koord.syntax.elaboration.phrases import choice, did_you_mean, listed
from koord.syntax.elaboration.recorder import FieldSymbol, TypeSymbol
from koord.syntax.elaboration.resolve_types import element_of
from koord.syntax.elaboration.symbols import RecordInfo
from koord.syntax.source import Span
from koord.syntax.types import (
    FLOAT,
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
        values = list(map(widened, values))
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


def construct(body: BodyScope, e: ast.Call, record: RecordInfo) -> core.Expr | None:
    """Elaborate a record of the type, with named or positional fields."""
    if e.function.span.column != e.function.span.end_column:
        body.note(e.function.span, TypeSymbol(record.type.name, record.type))
    given = _placed(body, e, record)
    fields: list[core.Expr] = []
    missing: list[str] = []
    sound = given is not None
    for place, (name, wanted) in enumerate(record.type.fields):
        value = given.get(place) if given is not None else None
        if value is not None:
            fitted = field_value(body, value, name, wanted)
        elif record.defaults[place] is not None and given is not None:
            default = record.defaults[place]
            assert default is not None
            aside = BodyScope(body.session, Where.CONSTANT, None, body.findings)
            fitted = field_value(aside, default, name, wanted)
        else:
            missing.append(name)
            continue
        if fitted is None:
            sound = False
        else:
            fields.append(fitted)
    if missing and given is not None:
        fields_are = "the field" if len(missing) == 1 else "the fields"
        body.error(
            "K218",
            e.span,
            f"this `{record.type.name}` lacks {fields_are} {listed(missing)}",
            f"write `{record.type.name}({', '.join(f'{name} = …' for name in missing)})`",
        )
        return None
    if not sound:
        return None
    return core.MakeRecord(tuple(fields), record.type, span=e.span)


def field_value(body: BodyScope, value: ast.Expr, name: str, wanted: Type) -> core.Expr | None:
    """Elaborate a value for a field."""
    return fit(body, body.expr(value, wanted), wanted, value.span, f"the field `{name}`")


def _placed(body: BodyScope, e: ast.Call, record: RecordInfo) -> dict[int, ast.Expr] | None:
    """The arguments by position of their field; None if one has none."""
    placed: dict[int, ast.Expr] = {}
    sound = True
    for place, argument in enumerate(e.arguments):
        position = _position(body, argument, place, record)
        if position is None or position in placed:
            if position is not None:
                name = record.type.fields[position][0]
                body.error("K218", argument.span, f"the field `{name}` is given twice")
            body.expr(argument.value, POISON)
            sound = False
            continue
        placed[position] = argument.value
    return placed if sound else None


def _position(
    body: BodyScope, argument: ast.Argument, place: int, record: RecordInfo
) -> int | None:
    names = [name for name, _ in record.type.fields]
    if argument.name is None:
        if place < len(names):
            return place
        body.error(
            "K217",
            argument.span,
            f"a `{record.type.name}` has {len(names)} fields only: {listed(names)}",
        )
        return None
    position = field_position(record.type, argument.name)
    if position is None:
        body.error(
            "K205",
            argument.span,
            f"`{record.type.name}` has no field `{argument.name}`",
            did_you_mean(argument.name, names) or choice("its fields are", names),
        )
    else:
        body.note(argument.span.beginning(len(argument.name)), FieldSymbol(record.type, position))
    return position


#: Two names of one field of a `Task`, as published programs use them.
TASK_FIELDS = {
    "loc": "target",
    "target": "loc",
    "assignedTo": "assignId",
    "assignId": "assignedTo",
    "id": "taskId",
    "taskId": "id",
}


def field_position(record: RecordType, name: str) -> int | None:
    """The position of a field, by either of its names."""
    found = record.position(name)
    if found is None and record.name == "Task" and name in TASK_FIELDS:
        return record.position(TASK_FIELDS[name])
    return found
