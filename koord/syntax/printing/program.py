"""Programs as text: one section after the other, or the statements of one by themselves.

One layout: four spaces a block, one statement a line. Comments are kept, blank lines too (one at
most in a row), and a block of one statement that stood on the line of its head stays there. Reading
the text again gives the same tree, and printing that gives the same text.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Generic, TypeVar, assert_never

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import ast
from koord.syntax.diagnostics import Diagnostic, Severity
from koord.syntax.parsing.parser import parse
from koord.syntax.printing.conditions import conjuncts
from koord.syntax.printing.expressions import print_expr, print_type
from koord.syntax.printing.statements import LineWriter, beginning, declaration, known, weave
from koord.syntax.source import Source, Span

__all__ = ["print_expr", "print_program", "print_type"]


def print_program(program: ast.Program) -> str:
    """The program in the one layout, with its comments."""
    writer = LineWriter(program.heads)
    _sections(writer, program.sections)
    return weave(writer.lines, program.comments)


def _sections(w: LineWriter, sections: Sequence[ast.Section]) -> None:
    """Write all sections; without places in a text, a blank line between longer ones."""
    long = False
    position = 0
    while position < len(sections):
        section = sections[position]
        start = len(w.lines)
        together = _assumed_together(w, sections, position)
        position += len(together) or 1
        if isinstance(section, ast.Assume) and len(together) > 1:
            _conditions(w, _head("assume", section.name), "assume", together)
        else:
            _section(w, section)
        if not known(section.span):
            before, long = long, len(w.lines) - start > 1
            w.lines[start].blank = before or long


def _assumed_together(
    w: LineWriter, sections: Sequence[ast.Section], position: int
) -> list[ast.Expr]:
    """The assumptions from a position on that stood below one ``assume:``."""
    together: list[ast.Expr] = []
    head: Span | None = None
    while position < len(sections):
        section = sections[position]
        if not isinstance(section, ast.Assume) or not known(section.span):
            break
        own = w.head("assume", [section.condition])
        if head not in (None, own):
            break
        head = own
        together.append(section.condition)
        position += 1
    return together


def _head(word: str, name: ast.Ident | None) -> str:
    return f"{word} {name.name}" if name else word


def _conditions(w: LineWriter, head: str, word: str, conditions: Sequence[ast.Expr]) -> None:
    """Write a head with a condition, or with several below it."""
    first = w.head(word, conditions)
    if len(conditions) > 1 or not _on_line(w, head, first, conditions[0]):
        with w.block(head, first):
            for condition in conditions:
                w.condition(condition)


def _conjunction(w: LineWriter, head: str, first: Span, condition: ast.Expr) -> None:
    """Write a head with a condition; if it is long, with its conjuncts below."""
    if not _on_line(w, head, first, condition):
        with w.block(head, first):
            for part in conjuncts(condition):
                w.condition(part)


def _on_line(w: LineWriter, head: str, first: Span, condition: ast.Expr) -> bool:
    """Write a condition on the line of its head; return whether there was room for it."""
    text = f"{head}: {print_expr(condition)}"
    if len(text) > w.room:
        return False
    w.line(text, first, condition.span)
    return True


def _section(w: LineWriter, section: ast.Section) -> None:
    """Write one section."""
    match section:
        case ast.VarSection(kind=kind, decls=decls):
            _declarations(w, kind.value, section.span, decls)
        case ast.ParamDecl(decl=decl):
            w.line(f"param {declaration(decl)}", section.span, section.span)
        case ast.RecordDef(name=name, fields=fields):
            _declarations(w, f"def {name.name}", section.span, fields)
        case ast.EnumDef(name=name, members=members):
            listed = ", ".join(member.name for member in members)
            w.line(f"enum {name.name}: {listed}", section.span, section.span)
        case ast.FunDef():
            _function(w, section)
        case ast.Using():
            _using(w, section)
        case ast.Init(body=body):
            w.suite("init", section.span, beginning(section.span), body)
        case ast.Event():
            _event(w, section)
        case ast.Agent(name=name, sections=inner):
            with w.block(f"agent {name.name}", section.span):
                _sections(w, inner)
        case ast.Assume() | ast.Invariant() | ast.Eventually() | ast.LeadsTo():
            _property(w, section)
        case _:
            assert_never(section)


def _declarations(w: LineWriter, head: str, first: Span, decls: Sequence[ast.VarDecl]) -> None:
    """Write a head with declarations below."""
    with w.block(head, first):
        for decl in decls:
            w.line(declaration(decl), decl.span, decl.span)


def _function(w: LineWriter, f: ast.FunDef) -> None:
    """Write a function with its body or its summary."""
    parameters = ", ".join(map(declaration, f.parameters))
    result = f" -> {print_type(f.result)}" if f.result else ""
    text = f"def fun {f.name.name}({parameters}){result}"
    last = (f.result or (f.parameters[-1] if f.parameters else f.name)).span
    if isinstance(f.body, ast.External):
        with w.block(text, f.span, last) as head:
            head.text += f" {f.body.value}"
            _summary(w, f.requires, f.ensures)
    else:
        w.suite(text, f.span, last, f.body)


def _summary(w: LineWriter, requires: Sequence[ast.Expr], ensures: Sequence[ast.Expr]) -> None:
    """Write a contract, or the summary of an external function."""
    for word, conditions in (("requires", requires), ("ensures", ensures)):
        if conditions:
            _conditions(w, word, word, conditions)


def _using(w: LineWriter, module: ast.Using) -> None:
    """Write a module with its ports, environment and contracts."""
    text = f"using {module.module.name}"
    if not (module.sensors or module.actuators or module.contracts or module.environment):
        w.line(text, module.span)
        return
    with w.block(text, module.span):
        for word, ports in (("sensors", module.sensors), ("actuators", module.actuators)):
            if ports:
                _declarations(w, word, w.head(word, ports), ports)
        if module.environment:
            head = w.head("environment", module.environment)
            w.suite("environment", head, head, module.environment)
        for contract in module.contracts:
            with w.block(f"contract {contract.name.name}", contract.span):
                _summary(w, contract.requires, contract.ensures)


def _event(w: LineWriter, event: ast.Event) -> None:
    """Write an event with its guard and effect."""
    urgent = "urgent " if event.urgent else ""
    with w.block(f"{urgent}{event.name.name}", event.span):
        if event.pre:
            _conjunction(w, "pre", w.head("pre", [event.pre]), event.pre)
        head = w.head("eff", event.eff)
        w.suite("eff", head, head, event.eff)


def _property(w: LineWriter, p: ast.Assume | ast.Invariant | ast.Eventually | ast.LeadsTo) -> None:
    """Write an invariant, assumption or other property."""
    match p:
        case ast.Assume(name=name, condition=condition):
            _conditions(w, _head("assume", name), "assume", [condition])
        case ast.Invariant(name=name, condition=condition, at_round=at_round):
            when = " at round" if at_round else ""
            _conjunction(w, f"{_head('invariant', name)}{when}", p.span, condition)
        case ast.Eventually(name=name, goal=goal):
            if not _on_line(w, _head("eventually", name), p.span, goal):
                with w.block(_head("eventually", name), p.span):
                    w.condition(goal)
        case ast.LeadsTo(name=name, assumed=assumed):
            _leads_to(w, _head("assume" if assumed else "eventually", name), p)
        case _:
            assert_never(p)


def _leads_to(w: LineWriter, head: str, p: ast.LeadsTo) -> None:
    """Write one condition that leads to another."""
    text = f"{head}: {print_expr(p.trigger)} leadsto {print_expr(p.goal)}"
    first = w.head("assume", [p]) if p.assumed else p.span
    if len(text) <= w.room:
        w.line(text, first, p.span)
        return
    with w.block(head, first):
        w.condition(p.trigger)
        w.condition(p.goal, "leadsto ")


class Formatted(Struct, frozen=True):
    """The result of formatting; with syntax errors the text is unchanged."""

    text: str
    diagnostics: tuple[Diagnostic, ...]


def format_source(source: Source) -> Formatted:
    """Format a text, unless it has syntax errors."""
    parsed = parse(source)
    errors = tuple(d for d in parsed.diagnostics if d.severity is Severity.ERROR)
    if errors:
        return Formatted(source.text, errors)
    return Formatted(print_program(parsed.program), ())


S = TypeVar("S", bound=ast.Section)


class Stated(Struct, Generic[S], frozen=True):
    """A section that states something; ``agent`` is the kind of robot in whose block it stands."""

    section: S
    agent: ast.Ident | None = None

    @property
    def whole(self) -> ast.Section:
        """The section with the block around it that it needs to keep its meaning."""
        if self.agent is None:
            return self.section
        return ast.Agent(self.agent, (self.section,), span=self.section.span)

    @property
    def text(self) -> str:
        """The section in Koord."""
        whole = self.whole
        return print_program(ast.Program((whole,), (), span=whole.span)).rstrip("\n")


def stated(sections: Sequence[ast.Section], kind: type[S]) -> tuple[Stated[S], ...]:
    """The sections of one kind in the order of the core program: those outside of blocks first."""
    outside: list[Stated[S]] = [Stated(s) for s in sections if isinstance(s, kind)]
    inside: list[Stated[S]] = [
        Stated(section, block.name)
        for block in sections
        if isinstance(block, ast.Agent)
        for section in block.sections
        if isinstance(section, kind)
    ]
    return (*outside, *inside)


def with_invariants(
    sections: Sequence[ast.Section],
    invariants: Sequence[tuple[str, Stated[ast.Invariant]]],
    *,
    of_runs: bool = False,
) -> tuple[ast.Section, ...]:
    """The sections with other invariants, under given names, in place of what they claim.

    With ``of_runs`` they keep what they say of whole runs.
    """
    left_out = ast.Invariant if of_runs else _CLAIMED
    named = [
        (replace(s.section, name=ast.Ident(name, span=s.section.span)), s.agent)
        for name, s in invariants
    ]

    def those(block: str | None) -> Iterator[ast.Section]:
        return (made for made, agent in named if (agent.name if agent else None) == block)

    def kept(of: Sequence[ast.Section], block: str | None) -> tuple[ast.Section, ...]:
        return (*(s for s in of if not isinstance(s, left_out)), *those(block))

    return tuple(
        replace(s, sections=kept(s.sections, s.name.name)) if isinstance(s, ast.Agent) else s
        for s in kept(sections, None)
    )


_CLAIMED = (ast.Invariant, ast.Eventually, ast.LeadsTo)
