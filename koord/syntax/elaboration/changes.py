"""Calls that stand as statements: they change their first argument."""

from __future__ import annotations

from collections.abc import Callable

from koord.syntax import ast, core
from koord.syntax.elaboration.body import BodyScope
from koord.syntax.elaboration.calls import METHODS, as_call
from koord.syntax.elaboration.coercion import POISON, fit
from koord.syntax.elaboration.names import Meaning
from koord.syntax.elaboration.phrases import a, did_you_mean
from koord.syntax.elaboration.places import meaning
from koord.syntax.elaboration.records import field_position
from koord.syntax.elaboration.targets import target
from koord.syntax.types import BOOL, INT, PRESENT, GrowingType, MapType, RecordType, SetType, Type


def call_statement(body: BodyScope, s: ast.CallStmt) -> core.Block:
    """``append(x, v)``, ``x.remove(v)``, ``pop(q)``, ``assign(task, pid)``"""
    call = s.call
    if isinstance(call, ast.MethodCall):
        if call.method.name not in METHODS:
            body.expr(call)
            return ()
        call = as_call(call)
    name = call.function.name
    own = name in body.session.functions.own and not body.library
    change = None if own else _CHANGES.get(name)
    if change is not None:
        return change(body, call)
    value = body.expr(call)
    if value is not None:
        hint = did_you_mean(name, _CHANGES) if not own else None
        body.error(
            "K228",
            s.span,
            f"`{name}` only computes a value, which is lost here",
            hint or "assign the value, or leave the call out",
        )
    return ()


def _changed(
    body: BodyScope, call: ast.Call, count: int, *, reads: bool = True
) -> core.Place | None:
    """The place that is changed, if the number of arguments is right."""
    if len(call.arguments) != count:
        for argument in call.arguments:
            body.expr(argument.value, POISON)
        plural = "" if count == 1 else "s"
        body.error(
            "K217",
            call.span,
            f"`{call.function.name}` takes {count} argument{plural}, not {len(call.arguments)}",
        )
        return None
    place = target(body, call.arguments[0].value)
    if place is None:
        for argument in call.arguments[1:]:
            body.expr(argument.value, POISON)
        return None
    if reads and place.variable.home is core.Home.ALLWRITE:
        body.shared_reads.add(place.variable.slot)  # the old list is part of the new
    return place


def _growing(type_: Type) -> Type | None:
    return type_.element if isinstance(type_, GrowingType) else None


def _no_list(body: BodyScope, call: ast.Call, place: core.Place, what: str) -> core.Block:
    name, meant = call.function.name, None
    if name == "add" and isinstance(place.type, GrowingType):
        meant = "did you mean `append`?"
    elif name == "append" and isinstance(place.type, SetType):
        meant = "did you mean `add`?"
    told = f"`{name}` changes {what}, not {a(place.type)}"
    body.error("K229", call.arguments[0].span, told, meant)
    return ()


def _append(body: BodyScope, call: ast.Call) -> core.Block:
    place = _changed(body, call, 2)
    if place is None:
        return ()
    element = _growing(place.type)
    argument = call.arguments[1].value
    value = body.expr(argument, element)
    if element is None:
        return _no_list(body, call, place, "lists and queues")
    value = fit(body, value, element, argument.span, "what is appended")
    return () if value is None else (core.Append(place, value, span=call.span),)


def _add(body: BodyScope, call: ast.Call) -> core.Block:
    """``s.add(x)`` writes the entry of ``x``, which makes no use of what was there. [S-ADD]"""
    place = _changed(body, call, 2, reads=False)
    if place is None:
        return ()
    element = place.type.key if isinstance(place.type, SetType) else None
    argument = call.arguments[1].value
    value = body.expr(argument, element)
    if element is None:
        return _no_list(body, call, place, "sets")
    value = fit(body, value, element, argument.span, "what is added")
    if value is None:
        return ()
    step = core.KeyStep(value, PRESENT, span=call.span)
    return (core.Assign(place.part(step), core.Const(0, PRESENT, span=call.span), span=call.span),)


def _remove(body: BodyScope, call: ast.Call) -> core.Block:
    place = _changed(body, call, 2)
    if place is None:
        return ()
    wanted = place.type.key if isinstance(place.type, MapType) else _growing(place.type)
    argument = call.arguments[1].value
    value = body.expr(argument, wanted)
    if wanted is None:
        return _no_list(body, call, place, "lists, queues, maps and sets")
    value = fit(body, value, wanted, argument.span, "what is removed")
    return () if value is None else (core.Remove(place, value, span=call.span),)


def _pop(body: BodyScope, call: ast.Call) -> core.Block:
    place = _changed(body, call, 1)
    if place is None:
        return ()
    if _growing(place.type) is None:
        return _no_list(body, call, place, "lists and queues")
    return (core.Pop(place, None, span=call.span),)


def pop_into(body: BodyScope, s: ast.Assign) -> core.Block:
    """``v = pop(q)``"""
    assert isinstance(s.value, ast.Call | ast.MethodCall)
    call = s.value if isinstance(s.value, ast.Call) else as_call(s.value)
    into = target(body, s.target)
    place = _changed(body, call, 1)
    if place is None or into is None:
        return ()
    element = _growing(place.type)
    if element is None:
        return _no_list(body, call, place, "lists and queues")
    if element != into.type:
        body.error(
            "K204",
            s.target.span,
            f"an element of this list is {a(element)}, but this is {a(into.type)}",
        )
        return ()
    return (core.Pop(place, into, span=s.span),)


def _assign(body: BodyScope, call: ast.Call) -> core.Block:
    """``assign(task, robot)`` marks the task as the robot's."""
    place = _changed(body, call, 2)
    if place is None:
        return ()
    task, who = (argument.value for argument in call.arguments)
    robot = fit(body, body.expr(who, INT), INT, who.span, "the robot that gets the task")
    if robot is None:
        return ()
    made: list[core.Stmt] = []
    for name, value in (
        ("assigned", core.Const(True, BOOL, span=call.span)),
        ("assignedTo", robot),
    ):
        # elaborated anew for each, so that no call in an index stands twice
        whole = meaning(body, task) if made else place
        part = _task_field(whole, name, value.type)
        if part is not None:
            made.append(core.Assign(part, value, span=call.span))
    if not made:
        body.error(
            "K229",
            call.arguments[0].span,
            f"`assign` marks a task, not {a(place.type)}",
            "it sets the fields `bool assigned` and `int assignedTo`",
        )
    return tuple(made)


def _task_field(place: Meaning, name: str, wanted: Type) -> core.Place | None:
    if not isinstance(place, core.Place) or not isinstance(place.type, RecordType):
        return None
    position = field_position(place.type, name)
    if position is None or place.type.fields[position][1] != wanted:
        return None
    field, type_ = place.type.fields[position]
    step = core.FieldStep(position, field, type_, span=place.span)
    return place.part(step)


_CHANGES: dict[str, Callable[[BodyScope, ast.Call], core.Block]] = {
    "append": _append,
    "add": _add,
    "remove": _remove,
    "pop": _pop,
    "assign": _assign,
}
