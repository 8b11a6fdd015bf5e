"""Suggestions of fairness expectations that exclude a lasso. [FAIR-ASSUME]

Each suggestion is a line of Koord that is read together with the program; then the judge of lassos
is asked whether the run still is fair, and the search whether any run is.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from functools import reduce

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.semantics.recordings import Recording
from koord.syntax import ast, core
from koord.syntax.elaboration import Settings
from koord.syntax.load import load
from koord.syntax.parsing.parser import parse
from koord.syntax.printing.conditions import conjuncts
from koord.syntax.printing.expressions import print_expr
from koord.syntax.printing.program import print_program
from koord.syntax.source import Source
from koord.syntax.system import System
from koord.syntax.walk import reached
from koord.traces.fairness import EventStatus, Excuses, OfEvent
from koord.traces.lassos import flaw_of
from koord.verify.engines.explicit.fair_search import lively
from koord.verify.engines.explicit.limits import FEW_EDGES, HANDFUL, Limits

#: So many suggestions are made at most, and so many tried.
MOST, TRIED = 2, 24

#: For how long it is looked, for each, whether any run meets it.
CHECKING_S = 1.0


class SourceTexts(Struct, frozen=True):
    """The texts that a program is read from."""

    source: Source
    settings: Settings
    properties: tuple[Source, ...]


class Lassoed(Struct, frozen=True):
    """A lasso that breaks a property, with its configurations and with why it is fair."""

    system: System
    recording: Recording
    ends: Sequence[Configuration[Constant]]
    why: Excuses
    stated: core.Property


def excluding(text: SourceTexts, lasso: Lassoed, until: float | None = None) -> tuple[str, ...]:
    """Suggest expectations, in Koord, that exclude the lasso, and that some fair run meets.

    Looked for up to a moment of :func:`time.monotonic`, if one is given.
    """
    found: list[str] = []
    for line in list(_candidates(text, lasso))[:TRIED]:
        if len(found) >= MOST or (until is not None and time.monotonic() >= until):
            break
        system = _under(text, lasso, line)
        if system is not None and _is_met(system, lasso.stated, until):
            found.append(line)
    return tuple(found)


def _under(text: SourceTexts, lasso: Lassoed, line: str) -> System | None:
    """The system with an expectation, or None if that does not exclude the lasso."""
    more = Source("expected.krd", line + "\n")
    program = load(text.source, text.settings, (*text.properties, more)).program
    if program is None:
        return None
    new = program.expectations[-1]
    stated = lasso.stated
    if (new.trigger, new.condition, new.each) == (stated.trigger, stated.condition, stated.each):
        return None
    if not _is_of_others(program, new):
        return None
    system = replace(lasso.system, program=program)
    flaw = flaw_of(system, lasso.recording, lasso.ends, None)
    if flaw is None or flaw.rule != "FAIR-ASSUME" or "external function" in flaw.reason:
        return None
    return system


def _is_of_others(program: core.Program, stated: core.Property) -> bool:
    """Return whether a statement is about events or ports, not the program's own variables."""
    return any(
        isinstance(node, core.Ran)
        or (isinstance(node, core.Variable) and node.home is core.Home.PORT)
        for node in reached(program, (stated.condition,))
    )


def _is_met(system: System, stated: core.Property, until: float | None) -> bool:
    """Return whether some fair run meets all expectations, as far as a short search can tell."""
    ends = time.monotonic() + CHECKING_S
    limits = Limits(states=HANDFUL, deadline_s=ends if until is None else min(ends, until))
    return not lively(system, (stated,), limits, most_edges=FEW_EDGES).is_empty


def _candidates(text: SourceTexts, lasso: Lassoed) -> Iterator[str]:
    """Yield lines to try, the likeliest first: enabled events run, then awaited ones."""
    events = _events(text)
    program = lasso.system.program
    taken = {p.name for p in (*program.properties, *program.expectations)}
    idle = list(_idle(lasso))
    for event in idle:
        if event.standing is not EventStatus.NEVER:
            for pre in events.get(event.event, ()):
                name = _unused(f"Runs{event.event}", taken)
                yield _line(name, pre, f"ran({event.event})")
    for event in idle:
        for pre in events.get(event.event, ()):
            for k, part in enumerate(pre):
                name = _unused(f"Enables{event.event}", taken)
                yield _line(name, [*pre[:k], *pre[k + 1 :]], print_expr(part))


def _idle(lasso: Lassoed) -> Iterator[OfEvent]:
    """Yield the events that some robot never runs in the loop, each once; those enabled first."""
    found: dict[str, OfEvent] = {}
    for of in lasso.why.robots:
        for event in of.events:
            known = found.get(event.event)
            if event.standing is not EventStatus.RUNS and (
                known is None or known.standing is EventStatus.NEVER
            ):
                found[event.event] = event
    yield from found.values()


def _events(text: SourceTexts) -> dict[str, list[list[ast.Expr]]]:
    """The conjuncts of the guards of events, by the event's name."""
    found: dict[str, list[list[ast.Expr]]] = {}
    sections = list(parse(text.source).program.sections)
    for section in sections:
        if isinstance(section, ast.Agent):
            sections += section.sections
        elif isinstance(section, ast.Event):
            parts = [] if section.pre is None else conjuncts(section.pre)
            found.setdefault(section.name.name, []).append(parts)
    return found


def _line(name: str, given: Sequence[ast.Expr], goal: str) -> str:
    """Print ``given leadsto goal`` as a line of Koord."""
    (made,) = parse(Source(name, f"assume {name}: true leadsto {goal}\n")).program.sections
    assert isinstance(made, ast.LeadsTo)
    if given:
        together = reduce(lambda a, b: ast.Binary(ast.BinaryOp.AND, a, b, span=a.span), given)
        made = replace(made, trigger=together)
    return print_program(ast.Program((made,), (), span=made.span)).strip()


def _unused(name: str, taken: set[str]) -> str:
    number, made = 1, name
    while made in taken:
        number += 1
        made = f"{name}{number}"
    return made
