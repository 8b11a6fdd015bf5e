"""Elaboration of records: ``Task(loc = p, assigned = false)``, ``pos(1, 2, 0)``."""

from __future__ import annotations

from koord.syntax import ast, core
from koord.syntax.elaboration.body import BodyScope, Where
from koord.syntax.elaboration.coercion import POISON, fit
from koord.syntax.elaboration.phrases import choice, did_you_mean, listed
from koord.syntax.elaboration.symbols import RecordInfo
from koord.syntax.types import RecordType, Type


def construct(body: BodyScope, e: ast.Call, record: RecordInfo) -> core.Expr | None:
    """Elaborate a record of the type, with named or positional fields."""
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
