"""Names that mean nothing, and what was probably meant."""

from __future__ import annotations

from koord.syntax import ast
from koord.syntax.elaborate.body import SEES_PID, SEES_PORTS, SEES_VARIABLES, Body, Where
from koord.syntax.elaborate.suggest import did_you_mean, otherwise
from koord.syntax.elaborate.symbols import MemberSymbol, Named, ParamSymbol, Pending
from koord.syntax.types import EnumType


def unknown(body: Body, e: ast.Name, field: str | None = None) -> None:
    """Tell that there is no such name, and what may have been meant: once for each name."""
    if body.is_told("K201", e.name, e.span):
        return
    hint = _element_hint(body, e.name, field)
    for module, ports in body.session.library_ports.items():
        if hint is None and e.name in ports:
            hint = f"`{e.name}` is a port of `{module}`: begin the program with `using {module}`"
    hint = hint or otherwise(e.name) or did_you_mean(e.name, visible(body))
    if hint is None and field is not None:
        hint = f"if `{e.name}` is a module, begin the program with `using {e.name}:`"
    body.error("K201", e.span, f"`{e.name}` is not declared", hint)


def _element_hint(body: Body, wanted: str, field: str | None) -> str | None:
    """In a loop over a list of records, a name like that of the record may mean the element."""
    for loop in reversed(body.loops):
        element = loop.element
        if loop.over is None or not isinstance(loop.over, ast.Name):
            continue
        named = getattr(element, "name", None)
        if named is None or element is None or isinstance(element, EnumType):
            continue
        fits = named.lower() == wanted.lower()
        if fits and loop.by_position:
            access = f"{loop.over.name}[{loop.variable}]"
            shown = f"{access}.{field}" if field else access
            return f"the element that the loop is at is `{shown}`"
        if fits:
            shown = f"{loop.variable}.{field}" if field else loop.variable
            return f"the element that the loop is at is `{shown}`"
    return None


def visible(body: Body) -> list[str]:
    """The names that could stand here."""
    session = body.session
    names = [name_ for frame in body.frames for name_ in frame]
    sees_variables = body.where in SEES_VARIABLES
    names += [
        name for name, found in session.shared.items() if sees_variables or _is_constant(found)
    ]
    names += session.types.members
    for agent in [body.agent] if body.agent else session.agents:
        if sees_variables:
            names += agent.variables
        if body.where in SEES_PORTS:
            names += agent.ports
            for module in agent.modules:
                names += session.library_ports.get(module, ())
    own = ["pid"] if body.where in SEES_PID else []
    of_run = ["numAgents", "delta"] if body.where is not Where.CONSTANT else []
    return [*names, *own, *of_run]


def _is_constant(found: Named) -> bool:
    """Whether a name stands for the same value everywhere."""
    return isinstance(found, ParamSymbol | MemberSymbol) or (
        isinstance(found, Pending) and found.is_param
    )
