"""The instance that a text states: ``param int numAgents`` and ``param float delta``."""

from __future__ import annotations

from fractions import Fraction
from itertools import islice

from koord.syntax import ast, core
from koord.syntax.core import LEAST_DELTA_S, MOST_DELTA_S, MOST_ROBOTS
from koord.syntax.elaboration.body import Elaboration
from koord.syntax.elaboration.params import declared_value
from koord.syntax.elaboration.phrases import a
from koord.syntax.elaboration.sections import ARGUMENTS, AgentSections, Sections
from koord.syntax.elaboration.variables import declared_twice
from koord.syntax.source import Span
from koord.syntax.types import FLOAT, INT, show


def instance(session: Elaboration, sections: Sections) -> core.Instance:
    """The instance, as far as the program states it. Errors in it are reported."""
    delta_s = _delta(session, sections)
    total = _robots(session, sections.common)
    counts = [_robots(session, kind) or 0 for kind in sections.kinds]
    stated = [kind for kind in sections.kinds if _of_robots(kind)]
    if not stated:
        return core.Instance(core.round_robin(total or 0, max(1, len(counts))), delta_s)
    _check_kinds(session, sections, stated)
    if not 0 < sum(counts) <= MOST_ROBOTS:
        story = f"there must be 1 to {MOST_ROBOTS} robots together, not {sum(counts)}"
        cure = "change how many there are of a kind"
        _wrong(session, _of_robots(stated[0])[0].span, story, cure)
    kinds_of = (at for at, count in enumerate(counts) for _ in range(count))
    return core.Instance(tuple(islice(kinds_of, MOST_ROBOTS)), delta_s)


def _check_kinds(session: Elaboration, sections: Sections, stated: list[AgentSections]) -> None:
    """Check that numbers are stated for every kind of robot or none, and not for all besides."""
    for decl in _of_robots(sections.common)[:1]:
        _wrong(
            session,
            decl.span,
            "the number of robots is stated for all kinds together, and for one by itself",
            "state it in each `agent` block, and leave this line out",
        )
    for kind in sections.kinds:
        if kind not in stated and kind.declared is not None:
            _wrong(
                session,
                kind.declared.span,
                f"how many robots are of kind {kind.name} is not stated; of other kinds it is",
                "state it in this block too: `param int numAgents = 1`",
            )


def _of_robots(kind: AgentSections) -> list[ast.VarDecl]:
    return [decl for decl in kind.of_run if decl.name.name != "delta"]


def _of_delta(kind: AgentSections) -> list[ast.VarDecl]:
    return [decl for decl in kind.of_run if decl.name.name == "delta"]


def _robots(session: Elaboration, kind: AgentSections) -> int | None:
    """The number of robots, or of this kind; None if that is not stated, or wrong."""
    decl = _only(session, _of_robots(kind))
    if decl is None:
        return None
    value = _value(session, decl)
    if value is None:
        return None
    least = 1 if kind.declared is None else 0
    if value.denominator != 1 or not least <= value <= MOST_ROBOTS:
        _wrong(
            session,
            decl.span,
            f"`{decl.name.name}` must be from {least} to {MOST_ROBOTS}, not {value}",
            f"write such a number, or leave the line out and use `{ARGUMENTS[decl.name.name]}`",
        )
        return None
    return int(value)


def _delta(session: Elaboration, sections: Sections) -> Fraction | None:
    """The length of a round in seconds; None if it is not stated, or wrong."""
    for kind in sections.kinds:
        for decl in _of_delta(kind):
            _wrong(
                session,
                decl.span,
                "a round is as long for all kinds of robot",
                "state `delta` at the left margin, outside of `agent` blocks",
            )
    stated = _only(session, _of_delta(sections.common))
    value = None if stated is None else _value(session, stated)
    if stated is not None and value is not None and value <= 0:
        _wrong(session, stated.span, "a round is longer than 0 seconds", "write `0.1`")
        return None
    if stated is not None and value is not None and not LEAST_DELTA_S <= value <= MOST_DELTA_S:
        _wrong(session, stated.span, "a round takes from 1e-9 to 1e5 seconds", "write `0.1`")
        return None
    return value


def _only(session: Elaboration, found: list[ast.VarDecl]) -> ast.VarDecl | None:
    for decl in found[1:]:
        declared_twice(session, decl.name, found[0].name)
    return found[0] if found else None


def _value(session: Elaboration, decl: ast.VarDecl) -> Fraction | None:
    wanted = FLOAT if decl.name.name == "delta" else INT
    if decl.initial is None:
        cure = f"state it here, or leave the line out and use `{ARGUMENTS[decl.name.name]}`"
        _wrong(session, decl.span, f"`{decl.name.name}` has no value", cure)
        return None
    found = declared_value(session, decl, decl.initial)
    if found is None:
        return None
    if not isinstance(found, core.Const) or found.type not in (INT, wanted):
        cure = f"write `param {show(wanted)} {decl.name.name} = …`"
        _wrong(session, decl.type.span, f"`{decl.name.name}` is {a(wanted)}", cure)
        return None
    return Fraction(found.value)


def _wrong(session: Elaboration, span: Span, message: str, hint: str) -> None:
    session.findings.error("K250", span, message, hint)
