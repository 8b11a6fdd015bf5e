"""Writes: which places may be written where. [LOCAL-ASSIGN], [SHARED-ASSIGN], [ALLREAD],
[ACTUATE]
"""

from __future__ import annotations

from collections.abc import Callable
from typing import assert_never

from koord.syntax import ast, core
from koord.syntax.diagnostics import Note
from koord.syntax.elaboration.body import BodyScope, SharedWrite, Where
from koord.syntax.elaboration.calls import METHODS, as_call, counted, element_written
from koord.syntax.elaboration.coercion import POISON, fit
from koord.syntax.elaboration.literals import field_position
from koord.syntax.elaboration.names import Meaning
from koord.syntax.elaboration.phrases import a, did_you_mean
from koord.syntax.elaboration.places import find_module, is_unknown, meaning
from koord.syntax.elaboration.recorder import HOLE, OwnName
from koord.syntax.elaboration.symbols import ParamSymbol, PortSymbol, Role, StreamSymbol
from koord.syntax.types import BOOL, INT, PRESENT, GrowingType, MapType, RecordType, SetType, Type


def target(body: BodyScope, e: ast.Expr) -> core.Place | None:
    """Elaborate a write's place; None if it may not be written, which is reported."""
    root = _root(e)
    if root is None:
        _only_places(body, e)
        return None
    if body.where is Where.FUNCTION and body.lookup(root.name) is None:
        _impure(body, e, root)
        return None
    if _is_stream(body, e, root):
        return None
    if _is_constant(body, e, root):
        return None
    if isinstance(e, ast.Name) and e.name == HOLE:
        from koord.syntax.elaboration.candidates import fill

        fill(body, None, is_statement=True)
    if isinstance(e, ast.Name) and is_unknown(body, e.name):
        if not body.session.partial:
            from koord.syntax.elaboration.unknown_names import unknown

            unknown(body, e, is_written=True)
        return None
    read_before = set(body.shared_reads)
    found = meaning(body, e)
    if found is None:
        return None
    if not isinstance(found, core.Place):
        _only_places(body, e)
        return None
    if found.variable.home is core.Home.ALLWRITE and found.variable.slot not in read_before:
        body.shared_reads.discard(found.variable.slot)
        if found.is_below_key:
            body.shared_reads.add(found.variable.slot)  # the entry's other parts are written, too
    return found if _allowed(body, e, root, found) else None


def _root(e: ast.Expr) -> ast.Name | None:
    while isinstance(e, ast.Attribute | ast.Index):
        e = e.base
    return e if isinstance(e, ast.Name) else None


def _only_places(body: BodyScope, e: ast.Expr) -> None:
    if not isinstance(e, ast.Call | ast.MethodCall):
        body.error(
            "K213", e.span, "this cannot be written to", "variables, their parts, and ports can"
        )
        return
    body.expr(e)
    body.error("K213", e.span, "the answer of a call cannot be written to")


def _impure(body: BodyScope, e: ast.Expr, root: ast.Name) -> None:
    body.error(
        "K224",
        e.span,
        f"a function writes its own variables only, not `{root.name}`",
        "return a value, and let the event write it",
    )


def _is_stream(body: BodyScope, e: ast.Expr, root: ast.Name) -> bool:
    found = None
    if isinstance(e, ast.Attribute) and e.base is root:
        module = find_module(body, root.name)
        found = module.ports.get(e.name.name) if module else None
    elif e is root and body.agent is not None and root.name not in body.agent.variables:
        found = next(iter(body.agent.ports.get(root.name, [])), None)
    if isinstance(found, StreamSymbol):
        body.error(
            "K238",
            e.span,
            f"`{found.stream}` is a stream",
            f"write to it with `{found.stream} << …`",
        )
        return True
    return False


def _is_constant(body: BodyScope, e: ast.Expr, root: ast.Name) -> bool:
    if body.lookup(root.name) is not None:
        return False
    known = body.session.shared.get(root.name)
    if isinstance(known, ParamSymbol):
        body.note(root.span, known)
        note = Note(known.declared.span, f"`{root.name}` is declared here")
        body.findings.error(
            "K213",
            e.span,
            f"`{root.name}` is a constant of the run",
            "declare it under `local:` or `allwrite:` if the program writes it",
            (note,),
        )
        body.session.mark_used(known.declared)
        return True
    return False


def _allowed(body: BodyScope, e: ast.Expr, root: ast.Name, place: core.Place) -> bool:
    match place.variable.home:
        case core.Home.LOCAL:
            return True
        case core.Home.ALLWRITE:
            body.writes.append(SharedWrite(place.variable, _is_own(e), body.atomic, e.span))
            if body.atomic is not None:
                body.atomic.writes[place.variable.slot] = place.variable
            return True
        case core.Home.ALLREAD:
            return _own_entry(body, e, root, place)
        case core.Home.PORT:
            return _port(body, e, place)
        case core.Home.BOUND:
            return _bound(body, e, root)
        case _:
            assert_never(place.variable.home)


def _first_index(e: ast.Expr) -> ast.Expr | None:
    """The index directly behind the variable's name."""
    while isinstance(e, ast.Attribute | ast.Index):
        if isinstance(e.base, ast.Name):
            return e.index if isinstance(e, ast.Index) else None
        e = e.base
    return None


def _is_own(e: ast.Expr) -> bool:
    index = _first_index(e)
    return isinstance(index, ast.Name) and index.name == "pid"


def _own_entry(body: BodyScope, e: ast.Expr, root: ast.Name, place: core.Place) -> bool:
    """Return whether an allread variable is written as ``x[pid] = …``, else report. [ALLREAD]"""
    if _is_own(e):
        return True
    if _first_index(e) is None:
        message = f"`{root.name}` has one entry per robot, and a robot writes its own only"
    else:
        message = f"a robot writes its own entry of the `allread` variable `{root.name}` only"
    body.error(
        "K212",
        e.span,
        message,
        f"write `{root.name}[pid]`; what robots write of each other belongs under `allwrite:`",
    )
    return False


def _port(body: BodyScope, e: ast.Expr, place: core.Place) -> bool:
    symbol = body.agent.slots.get(place.variable.slot) if body.agent is not None else None
    assert isinstance(symbol, PortSymbol)
    if body.where is Where.ENVIRONMENT:
        if symbol.module == body.module:
            return True
        body.error(
            "K239",
            e.span,
            f"the environment of `{body.module}` writes its own ports only, not one of "
            f"`{symbol.module}`",
        )
        return False
    if symbol.direction is core.Direction.SENSOR:
        body.findings.error(
            "K213",
            e.span,
            f"`{symbol.module}.{symbol.variable.name}` is a sensor: programs read it only",
            "what a program writes is declared under `actuators:`",
            (Note(symbol.declared.span, "declared here"),)
            if symbol.declared.span.file == e.span.file
            else (),
        )
        return False
    return True


def _bound(body: BodyScope, e: ast.Expr, root: ast.Name) -> bool:
    symbol = body.lookup(root.name)
    if symbol is None or symbol.role is Role.LOCAL:
        return True
    if symbol.role is Role.ELEMENT:
        loop = body.loops[-1]
        over = loop.over.name if isinstance(loop.over, ast.Name) else "list"
        hint = f"to change the list, loop with `for k = 0, length({over}):` and write `{over}[k]`"
        body.error("K213", e.span, f"`{root.name}` is a copy of an element of the list", hint)
    else:
        hint = "copy it to a variable of its own"
        body.error("K213", e.span, f"`{root.name}` is {symbol.role.value}: it is not written", hint)
    return False


def place_shown(place: core.Place, e: ast.Expr) -> str:
    """The place as the text has it, for messages."""
    root = _root(e)
    shown = root.name if root is not None else place.variable.name
    if e is root:
        return f"`{shown}`"
    if isinstance(e, ast.Attribute):
        return f"`{e.name.name}`"
    return f"an element of `{shown}`"


def call_statement(body: BodyScope, s: ast.CallStmt) -> core.Block:
    """Elaborate ``append(x, v)``, ``x.remove(v)``, ``pop(q)``, ``assign(task, pid)``."""
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
        body.note(call.function.span, OwnName(name))
        return change(body, call)
    stored = None if own else element_written(body, call)
    if stored is not None:
        return body.block((stored,))
    value = body.expr(call, BOOL)
    if own and isinstance(value, core.ExternalCall):
        # what it answers is not looked at [S-CALL]
        answer = core.Place(body.slot("answer", value.type), span=s.span)
        return (core.Assign(answer, value, span=s.span),)
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
    """Elaborate the place that is changed, if the number of arguments is right."""
    if not counted(body, call, count):
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
    """Elaborate ``s.add(x)``: it writes the entry of ``x``. [S-ADD]"""
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
    """Elaborate ``v = pop(q)``."""
    assert isinstance(s.value, ast.Call | ast.MethodCall)
    call = s.value if isinstance(s.value, ast.Call) else as_call(s.value)
    body.note(call.function.span, OwnName("pop"))
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
    """Elaborate ``assign(task, robot)``, which marks the task as the robot's."""
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
