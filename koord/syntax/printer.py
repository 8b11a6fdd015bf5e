"""Trees as text: ``print_program``, ``print_expr``.

One layout for everything: four spaces a block, a block on lines of its own, one statement a line.
Comments are kept, blank lines too (one at most in a row). Reading the text again gives the same
tree, and printing that gives the same text.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import assert_never

from koord.syntax import ast
from koord.syntax.printer_comments import Written, weave
from koord.syntax.printer_exprs import print_base, print_expr, print_type
from koord.syntax.source import NOWHERE, Span

__all__ = ["print_expr", "print_program", "print_type"]


def print_program(program: ast.Program) -> str:
    """The program in the one layout, with its comments."""
    printer = _Printer(program.heads)
    printer.sections(program.sections)
    return weave(printer.lines, program.comments)


class _Printer:
    __slots__ = ("_heads", "_parent", "lines")

    def __init__(self, heads: Sequence[ast.Ident]) -> None:
        self.lines: list[Written] = []
        self._parent: Written | None = None
        self._heads: dict[str, list[Span]] = {}
        for head in heads:
            self._heads.setdefault(head.name, []).append(head.span)
        for spans in self._heads.values():
            spans.sort(key=_start)

    # --- lines

    def line(self, text: str, first: Span, last: Span | None = None) -> Written:
        """Write a line for what begins like ``first`` and ends like ``last``."""
        line = first.line if _known(first) else 0
        end_line = max(line, last.end_line) if line and last and _known(last) else line
        written = Written(self._parent, text, line, end_line, first.column)
        if self._parent:
            self._parent.opens = True
        self.lines.append(written)
        return written

    @contextmanager
    def block(self, text: str, first: Span, last: Span | None = None) -> Iterator[Written]:
        """Write the head of a block, and then the lines of the block."""
        outer = self._parent
        self._parent = self.line(f"{text}:", first, last)
        yield self._parent
        self._parent = outer

    def head(self, word: str, nodes: Sequence[ast.Node]) -> Span:
        """Where the word stands that begins the block of these nodes."""
        first = nodes[0].span if nodes else NOWHERE
        spans = self._heads.get(word, [])
        position = bisect_left(spans, _start(first), key=_start)
        return spans[position - 1] if position and _known(first) else first

    # --- sections

    def sections(self, sections: Sequence[ast.Section]) -> None:
        """All sections; without places in a text, a blank line between those of several lines."""
        long = False
        for section in sections:
            start = len(self.lines)
            self.section(section)
            if not _known(section.span):
                before, long = long, len(self.lines) - start > 1
                self.lines[start].blank = before or long

    def section(self, section: ast.Section) -> None:
        """One section."""
        match section:
            case ast.VarSection(kind=kind, decls=decls):
                self.declarations(kind.value, section.span, decls)
            case ast.ParamDecl(decl=decl):
                self.line(f"param {_declaration(decl)}", section.span, section.span)
            case ast.RecordDef(name=name, fields=fields):
                self.declarations(f"def {name.name}", section.span, fields)
            case ast.EnumDef(name=name, members=members):
                listed = ", ".join(member.name for member in members)
                self.line(f"enum {name.name}: {listed}", section.span, section.span)
            case ast.FunDef():
                self.function(section)
            case ast.Using():
                self.using(section)
            case ast.Init(body=body):
                with self.block("init", section.span):
                    self.statements(body)
            case ast.Event():
                self.event(section)
            case ast.Agent(name=name, sections=inner):
                with self.block(f"agent {name.name}", section.span):
                    self.sections(inner)
            case ast.Assume() | ast.Invariant() | ast.Eventually() | ast.LeadsTo():
                self.property(section)
            case _:
                assert_never(section)

    def declarations(self, head: str, first: Span, decls: Sequence[ast.VarDecl]) -> None:
        """A head with declarations below."""
        with self.block(head, first):
            for decl in decls:
                self.line(_declaration(decl), decl.span, decl.span)

    def function(self, f: ast.FunDef) -> None:
        """A function with its body or its summary."""
        parameters = ", ".join(map(_declaration, f.parameters))
        result = f" -> {print_type(f.result)}" if f.result else ""
        text = f"def fun {f.name.name}({parameters}){result}"
        last = (f.result or f.parameters[-1] if f.parameters else f.result or f.name).span
        if isinstance(f.body, ast.External):
            with self.block(text, f.span, last) as head:
                head.text += f" {f.body.value}"
                self.summary(f.requires, f.ensures)
        else:
            with self.block(text, f.span, last):
                self.statements(f.body)

    def summary(self, requires: Sequence[ast.Expr], ensures: Sequence[ast.Expr]) -> None:
        """The lines of a contract, or of the summary of an external function."""
        for word, conditions in (("requires", requires), ("ensures", ensures)):
            before = NOWHERE
            for condition in conditions:
                first = self.head(word, [condition])
                if _start(first) < _start(before):
                    first = condition.span  # a further line below the same word
                self.line(f"{word}: {print_expr(condition)}", first, condition.span)
                before = condition.span

    def using(self, module: ast.Using) -> None:
        """A module with its ports, environment and contracts."""
        text = f"using {module.module.name}"
        if not (module.sensors or module.actuators or module.contracts or module.environment):
            self.line(text, module.span)
            return
        with self.block(text, module.span):
            for word, ports in (("sensors", module.sensors), ("actuators", module.actuators)):
                if ports:
                    self.declarations(word, self.head(word, ports), ports)
            if module.environment:
                with self.block("environment", self.head("environment", module.environment)):
                    self.statements(module.environment)
            for contract in module.contracts:
                with self.block(f"contract {contract.name.name}", contract.span):
                    self.summary(contract.requires, contract.ensures)

    def event(self, event: ast.Event) -> None:
        """An event with its guard and effect."""
        urgent = "urgent " if event.urgent else ""
        with self.block(f"{urgent}{event.name.name}", event.span):
            if event.pre:
                first = self.head("pre", [event.pre])
                self.line(f"pre: {print_expr(event.pre)}", first, event.pre.span)
            with self.block("eff", self.head("eff", event.eff)):
                self.statements(event.eff)

    def property(self, p: ast.Assume | ast.Invariant | ast.Eventually | ast.LeadsTo) -> None:
        """A statement about the program."""
        name = f" {p.name.name}" if p.name else ""
        match p:
            case ast.Assume(condition=condition):
                first = self.head("assume", [condition])
                before = self.lines[-1] if self.lines else None
                if before and first.line < before.line:
                    first = condition.span  # a further line below the same word
                self.line(f"assume{name}: {print_expr(condition)}", first, condition.span)
            case ast.Invariant(condition=condition, at_round=at_round):
                when = " at round" if at_round else ""
                text = f"invariant{name}{when}: {print_expr(condition)}"
                self.line(text, p.span, p.span)
            case ast.Eventually(goal=goal):
                self.line(f"eventually{name}: {print_expr(goal)}", p.span, p.span)
            case ast.LeadsTo(trigger=trigger, goal=goal):
                text = f"eventually{name}: {print_expr(trigger)} leadsto {print_expr(goal)}"
                self.line(text, p.span, p.span)
            case _:
                assert_never(p)

    # --- statements

    def statements(self, block: ast.Block) -> None:
        """A block; one that is empty cannot be written, and does nothing."""
        if not block:
            self.line("pass", NOWHERE)
        for statement in block:
            self.statement(statement)

    def statement(self, s: ast.Stmt) -> None:
        """One statement with the blocks in it."""
        match s:
            case ast.If(arms=arms, otherwise=otherwise):
                for number, (condition, body) in enumerate(arms):
                    word = "elif" if number else "if"
                    first = condition.span if number else s.span
                    with self.block(
                        f"{word} {print_expr(condition)}", first, condition.span
                    ) as head:
                        head.tight = bool(number)
                        self.statements(body)
                if otherwise is not None:
                    with self.block("else", self.head("else", otherwise)) as head:
                        head.tight = True
                        self.statements(otherwise)
            case ast.ForRange(variable=variable, low=low, high=high, body=body):
                text = f"for {variable.name} = {print_expr(low)}, {print_expr(high)}"
                with self.block(text, s.span, high.span):
                    self.statements(body)
            case ast.ForEach(variables=variables, sequence=sequence, body=body):
                names = ", ".join(variable.name for variable in variables)
                with self.block(f"for {names} in {print_expr(sequence)}", s.span, sequence.span):
                    self.statements(body)
            case ast.Atomic(body=body):
                with self.block("atomic", s.span):
                    self.statements(body)
            case _:
                self.line(_simple(s), s.span, s.span)


def _simple(
    s: ast.Assign
    | ast.Increment
    | ast.Break
    | ast.Return
    | ast.Stop
    | ast.TryStop
    | ast.Output
    | ast.LocalDecl
    | ast.Pass
    | ast.CallStmt,
) -> str:
    match s:
        case ast.Assign(target=target, value=value):
            return f"{print_expr(target)} = {print_expr(value)}"
        case ast.Increment(target=target, amount=amount):
            return f"{print_expr(target)}{'++' if amount > 0 else '--'}"
        case ast.Break():
            return "break"
        case ast.Return(value=value):
            return f"return {print_expr(value)}" if value else "return"
        case ast.Stop():
            return "stop"
        case ast.TryStop():
            return "trystop()"
        case ast.Output(stream=stream, values=values):
            return " << ".join([print_base(stream), *map(print_expr, values)])
        case ast.LocalDecl(decl=decl):
            return _declaration(decl)
        case ast.Pass():
            return "pass"
        case ast.CallStmt(call=call):
            return print_expr(call)
        case _:
            assert_never(s)


def _declaration(decl: ast.VarDecl) -> str:
    initial = f" = {print_expr(decl.initial)}" if decl.initial is not None else ""
    return f"{print_type(decl.type)} {decl.name.name}{initial}"


def _known(span: Span) -> bool:
    return span.file != NOWHERE.file


def _start(span: Span) -> tuple[int, int]:
    return span.line, span.column
