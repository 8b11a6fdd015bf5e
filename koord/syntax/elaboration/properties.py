"""Elaboration of assumptions and properties: closed statements about configurations."""

from __future__ import annotations

from collections.abc import Iterable
from typing import assert_never

from koord.syntax import ast, core
from koord.syntax.diagnostics import Note
from koord.syntax.elaboration.body import BodyScope, Elaboration, Where
from koord.syntax.elaboration.coercion import fit
from koord.syntax.elaboration.sections import Stated
from koord.syntax.elaboration.symbols import AgentScope
from koord.syntax.types import BOOL


def closed(body: BodyScope, e: ast.Expr, what: str) -> core.Expr | None:
    """Close a statement: if it reads ``pid``, it is quantified over every robot."""
    made = fit(body, body.expr(e, BOOL), BOOL, e.span, what)
    if made is None or body.closing is None:
        return made
    domain = core.RobotRange(_kind(body))
    return core.Quantified(core.QuantifierKind.FORALL, body.closing, domain, made, span=e.span)


def _kind(body: BodyScope) -> int | None:
    """The kind of the robots that an unqualified local belongs to; None if there is but one."""
    return body.agent.index if body.agent is not None and not body.session.single else None


def scope_of(session: Elaboration, kind: int | None) -> AgentScope | None:
    """The robots that an unqualified local belongs to: those of one kind, or all."""
    if session.single:
        return session.agents[0]
    return None if kind is None else session.agents[kind]


def assumption(
    session: Elaboration, section: ast.Assume, number: int, kind: int | None
) -> core.Assumption | None:
    """Elaborate an assumption about the configuration after INIT."""
    body = BodyScope(session, Where.ASSUMPTION, scope_of(session, kind), session.findings)
    condition = closed(body, section.condition, "an assumption")
    if condition is None:
        return None
    name = section.name.name if section.name is not None else f"assume_{number}"
    return core.Assumption(name, condition, body.bound, span=section.span)


def property_(
    session: Elaboration, section: Stated, name: str, kind: int | None
) -> core.Property | None:
    """Elaborate a property to check, or a fairness expectation."""
    body = BodyScope(session, Where.PROPERTY, scope_of(session, kind), session.findings)
    match section:
        case ast.Invariant(at_round=at_round, condition=condition):
            made = closed(body, condition, "an invariant")
            sort = core.PropertyKind.AT_ROUND if at_round else core.PropertyKind.INVARIANT
        case ast.Eventually():
            return _eventually(body, section, name)
        case ast.LeadsTo():
            return _leads_to(body, section, name)
        case _:
            assert_never(section)
    if made is None:
        return None
    return core.Property(name, sort, made, body.bound, span=section.span)


def _eventually(body: BodyScope, section: ast.Eventually, name: str) -> core.Property | None:
    goal = fit(
        body, body.expr(section.goal, BOOL), BOOL, section.goal.span, "what eventually holds"
    )
    if goal is None:
        return None
    each = _each(body)
    kind = core.PropertyKind.EVENTUALLY
    return core.Property(name, kind, goal, body.bound, each=each, span=section.span)


def _each(body: BodyScope) -> core.Each | None:
    """The robots that a liveness statement is about, one by one, if it reads ``pid``."""
    return None if body.closing is None else core.Each(body.closing, _kind(body))


def _leads_to(body: BodyScope, section: ast.LeadsTo, name: str) -> core.Property | None:
    trigger = fit(body, body.expr(section.trigger, BOOL), BOOL, section.trigger.span, "a trigger")
    goal = fit(body, body.expr(section.goal, BOOL), BOOL, section.goal.span, "a goal")
    if trigger is None or goal is None:
        return None
    kind = core.PropertyKind.LEADS_TO
    return core.Property(name, kind, goal, body.bound, trigger, _each(body), span=section.span)


_WORDS: dict[type[Stated], str] = {
    ast.Invariant: "invariant",
    ast.Eventually: "eventually",
    ast.LeadsTo: "eventually",
}


def names(session: Elaboration, sections: Iterable[Stated]) -> list[str]:
    """The names of the properties; those without one are numbered by their order."""
    result: list[str] = []
    first: dict[str, ast.Ident] = {}
    counts: dict[str, int] = {}
    for section in sections:
        word = _WORDS[type(section)]
        counts[word] = counts.get(word, 0) + 1
        if section.name is None:
            result.append(f"{word}_{counts[word]}")
            continue
        name = section.name.name
        if name in first and name != "?":
            session.findings.error(
                "K208",
                section.name.span,
                f"there are two properties named `{name}`",
                "choose another name",
                (Note(first[name].span, "first declared here"),),
            )
        first.setdefault(name, section.name)
        result.append(name)
    return result
