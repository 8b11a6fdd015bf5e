"""Events and `init:`."""

from __future__ import annotations

from koord.syntax import ast, core
from koord.syntax.diagnostics import Note
from koord.syntax.elaboration.body import BodyScope, Elaboration, Where
from koord.syntax.elaboration.cautions import lost_updates, never_enabled
from koord.syntax.elaboration.coercion import fit
from koord.syntax.elaboration.symbols import AgentScope
from koord.syntax.types import BOOL


def name_events(session: Elaboration, scope: AgentScope, events: list[ast.Event]) -> None:
    """Give the events their positions."""
    for position, event in enumerate(events):
        name = event.name.name
        if name in scope.events and name != "?":
            first = events[scope.events[name]].name
            session.findings.error(
                "K208",
                event.name.span,
                f"there are two events named `{name}`",
                "choose another name",
                (Note(first.span, "first declared here"),),
            )
        scope.events.setdefault(name, position)


def event(session: Elaboration, scope: AgentScope, section: ast.Event) -> core.Event:
    """An event. Its lock classes are still numbers of atomic blocks."""
    body = BodyScope(session, Where.GUARD, scope, session.findings)
    guard: core.Expr = core.Const(True, BOOL, span=section.name.span)
    if section.pre is not None:
        found = fit(body, body.expr(section.pre, BOOL), BOOL, section.pre.span, "a guard")
        if found is not None:
            guard = found
            never_enabled(session, section, guard)
    body.where = Where.EFFECT
    guarded = frozenset(body.shared_reads)
    body.shared_reads.clear()
    effect = body.block(section.eff)
    lost_updates(body, guarded, effect)
    return core.Event(
        section.name.name,
        section.urgent,
        guard,
        effect,
        body.bound,
        frozenset(),
        span=section.span,
    )


def initialisation(
    session: Elaboration, scope: AgentScope, sections: list[ast.Init]
) -> tuple[core.Block, int]:
    """What robots do at the start, and how many bound slots it needs."""
    body = BodyScope(session, Where.INIT, scope, session.findings)
    statements: list[core.Stmt] = []
    for section in sections:
        statements.extend(body.block(section.body))
    return tuple(statements), body.bound
