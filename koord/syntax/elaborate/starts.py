"""How variables start: with a value, with nothing, or with anything that the assumptions allow."""

from __future__ import annotations

from collections.abc import Iterable

from msgspec.structs import replace

from koord.syntax import ast, core
from koord.syntax.elaborate.assumed import Assumed, key
from koord.syntax.elaborate.body import Body
from koord.syntax.elaborate.coercion import fit
from koord.syntax.elaborate.settings import Settings
from koord.syntax.elaborate.world_tasks import tasks
from koord.syntax.types import (
    Type,
)


def initial_value(
    body: Body, decl: ast.VarDecl, type_: Type, start: core.Start
) -> core.Expr | core.Start:
    """The initial value of a declaration, or ``start`` if it has none."""
    if decl.initial is None:
        return start
    value = body.expr(decl.initial, type_)
    what = f"the initial value of `{decl.name.name}`"
    fitted = fit(body, value, type_, decl.initial.span, what)
    return start if fitted is None else fitted


def agent(agent: core.Agent, kind: int, known: Assumed) -> core.Agent:
    """The agent with the starts of its locals and ports settled."""
    ports = settle([port.declaration for port in agent.ports], kind, known, Settings())
    return replace(
        agent,
        locals=settle(agent.locals, kind, known, Settings()),
        ports=tuple(
            replace(port, declaration=declaration)
            for port, declaration in zip(agent.ports, ports, strict=True)
        ),
    )


def settle(
    declarations: Iterable[core.Declaration], kind: int | None, known: Assumed, settings: Settings
) -> tuple[core.Declaration, ...]:
    """The declarations with their starts."""
    result = []
    for declaration in declarations:
        variable = declaration.variable
        found = key(variable, kind)
        start, length = declaration.initial, None
        if start is core.Start.UNSET:
            start = tasks(variable, settings) or start
        if start is core.Start.UNSET and found in known.read:
            start = core.Start.ARBITRARY
        if start is core.Start.ARBITRARY:
            length = known.lengths.get(found)
        result.append(replace(declaration, initial=start, length=length))
    return tuple(result)
