"""What may be written where. [LOCAL-ASSIGN], [SHARED-ASSIGN], [ALLREAD], [ACTUATE]"""

from __future__ import annotations

from typing import assert_never

from koord.syntax import ast, core
from koord.syntax.diagnostics import Note
from koord.syntax.elaboration.body import BodyScope, SharedWrite, Where
from koord.syntax.elaboration.places import find_module, is_unknown, meaning
from koord.syntax.elaboration.symbols import ParamSymbol, PortSymbol, Role, StreamSymbol
from koord.syntax.elaboration.unknown_names import unknown


def target(body: BodyScope, e: ast.Expr) -> core.Place | None:
    """The place that a statement writes; None if it may not be written, which is told."""
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
    if isinstance(e, ast.Name) and is_unknown(body, e.name):
        if not body.session.partial:
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
    """The index that stands directly behind the variable's name."""
    while isinstance(e, ast.Attribute | ast.Index):
        if isinstance(e.base, ast.Name):
            return e.index if isinstance(e, ast.Index) else None
        e = e.base
    return None


def _is_own(e: ast.Expr) -> bool:
    index = _first_index(e)
    return isinstance(index, ast.Name) and index.name == "pid"


def _own_entry(body: BodyScope, e: ast.Expr, root: ast.Name, place: core.Place) -> bool:
    """[ALLREAD]: only ``x[pid] = …``."""
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
