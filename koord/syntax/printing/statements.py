"""Printing of statements and blocks as lines, with comments and blank lines put back.

Each written line knows where its construct stood in the text. A comment goes to the construct it
stands beside or before; one at the end of a block stays in that block. Constructs may be written in
another order than they stood in, and take their comments along.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import assert_never

from msgspec import Struct, field

from koord.syntax import ast
from koord.syntax.ast import Comment
from koord.syntax.printing.conditions import WIDTH, rows
from koord.syntax.printing.expressions import print_base, print_expr, print_type
from koord.syntax.source import NOWHERE, Span

#: What a block is indented with.
INDENT = "    "


class OutputLine(Struct, eq=False):
    """A line that the printer writes."""

    parent: OutputLine | None
    text: str
    #: First and last line of the construct in the text, and its column; 0 if unknown.
    line: int
    end_line: int
    column: int
    #: Whether lines of a block of its own follow.
    opens: bool = False
    #: Whether it goes on with the line before it, as ``else`` does: no blank line comes between.
    tight: bool = False
    blank: bool = False
    before: list[_Placed] = field(default_factory=list)
    beside: str = ""
    #: At the end of the block that the line opens.
    closing: list[_Placed] = field(default_factory=list)


class _Placed(Struct, frozen=True):
    """A comment on a line of its own, with or without a blank line before it."""

    text: str
    blank: bool


def weave(lines: Sequence[OutputLine], comments: Sequence[Comment]) -> str:
    """Weave comments into the lines, and return the text."""
    in_order = sorted((line for line in lines if line.line), key=lambda line: line.line)
    footer = _place(in_order, comments)
    output: list[str] = []
    for text, blank in _emit(lines, footer):
        if blank and output:
            output.append("")
        output.append(text.rstrip())
    return "".join(f"{text}\n" for text in output)


def _place(lines: Sequence[OutputLine], comments: Sequence[Comment]) -> list[_Placed]:
    """Assign each comment to a line; return those that belong to none."""
    footer: list[_Placed] = []
    waiting = iter([*comments, None])
    comment = next(waiting)
    end = 0  # the last line of the text that was dealt with
    for position, line in enumerate(lines):
        following = lines[position + 1] if position + 1 < len(lines) else None
        while comment and comment.line < line.line:  # only before the first line
            line.before.append(_Placed(comment.text, comment.line > end + 1))
            end = comment.line
            comment = next(waiting)
        line.blank = line.line > end + 1
        end = max(end, line.end_line)
        owner: OutputLine | None = line
        while comment and (following is None or comment.line < following.line):
            if not comment.own_line or comment.line <= line.end_line:
                _beside(line, comment)
            else:
                owner = _owner(owner, following, comment)
                placed = _Placed(comment.text, comment.line > end + 1)
                home = owner.closing if owner else following.before if following else footer
                home.append(placed)
            end = max(end, comment.line)
            comment = next(waiting)
    while comment:
        footer.append(_Placed(comment.text, comment.line > end + 1))
        end = comment.line
        comment = next(waiting)
    return footer


def _beside(line: OutputLine, comment: Comment) -> None:
    if comment.own_line:
        line.before.append(_Placed(comment.text, False))
        return
    if line.beside:
        line.before.append(_Placed(line.beside, False))
    line.beside = comment.text


def _owner(
    line: OutputLine | None, following: OutputLine | None, comment: Comment
) -> OutputLine | None:
    """The line whose block a comment ends; None if it belongs before the following line.

    ``line`` is the line before the comment, or the owner of the comment before it.
    """
    if following and following.parent is line:
        return None
    while line and (following is None or line is not following.parent):
        if line.opens and comment.column > line.column:
            return line
        line = line.parent
    return None


def _emit(lines: Sequence[OutputLine], footer: list[_Placed]) -> Iterator[tuple[str, bool]]:
    """The lines of the output, each with whether a blank line comes before it."""
    open_: list[OutputLine] = []
    first = True  # of its block
    for line in [*lines, None]:
        while open_ and (line is None or open_[-1] is not line.parent):
            closed = open_.pop()
            indent = INDENT * (len(open_) + 1)
            for placed in closed.closing:
                yield indent + placed.text, placed.blank and not first
                first = False
            first = False
        if line is None:
            break
        indent = INDENT * len(open_)
        for placed in line.before:
            yield indent + placed.text, placed.blank and not first
            first = False
        beside = f"  {line.beside}" if line.beside else ""
        yield indent + line.text + beside, line.blank and not (first or line.tight)
        open_.append(line)
        first = True
    for placed in footer:
        yield placed.text, placed.blank


class LineWriter:
    """A collector of a program's output lines; it knows where words without a node stood."""

    __slots__ = ("_heads", "_parent", "lines")

    def __init__(self, heads: Sequence[ast.Ident]) -> None:
        self.lines: list[OutputLine] = []
        self._parent: OutputLine | None = None
        self._heads: dict[str, list[Span]] = {}
        for head in heads:
            self._heads.setdefault(head.name, []).append(head.span)
        for spans in self._heads.values():
            spans.sort(key=_start)

    # --- lines

    def line(self, text: str, first: Span, last: Span | None = None) -> OutputLine:
        """Write a line for what begins like ``first`` and ends like ``last``."""
        line = first.line if known(first) else 0
        end_line = max(line, last.end_line) if line and last and known(last) else line
        written = OutputLine(self._parent, text, line, end_line, first.column)
        if self._parent:
            self._parent.opens = True
        self.lines.append(written)
        return written

    @contextmanager
    def block(self, text: str, first: Span, last: Span | None = None) -> Iterator[OutputLine]:
        """Write the head of a block, and then the lines of the block."""
        outer = self._parent
        self._parent = self.line(f"{text}:", first, last)
        yield self._parent
        self._parent = outer

    @property
    def room(self) -> int:
        """The number of columns left at the present depth."""
        depth = 0
        parent = self._parent
        while parent:
            depth += 1
            parent = parent.parent
        return WIDTH - len(INDENT) * depth

    def condition(self, condition: ast.Expr, before: str = "") -> None:
        """Write a condition on lines of its own, the first behind ``before``."""
        for number, row in enumerate(rows(condition, self.room, before)):
            self.line(row.text, row.first, row.last).tight = number > 0

    def suite(
        self, head: str, first: Span, last: Span, body: ast.Block, *, tight: bool = False
    ) -> None:
        """Write a head and the statements below it, or on its line if the only one stood there."""
        only = body[0] if len(body) == 1 and _on_line(body[0].span, last) else None
        match only:
            case None | ast.If():  # on the line of a head it would have no place for its `else`
                with self.block(head, first, last) as opened:
                    opened.tight = tight
                    self.statements(body)
            case ast.Atomic(span=span, body=inner):
                self.suite(f"{head}: atomic", first, beginning(span), inner, tight=tight)
            case ast.ForRange() | ast.ForEach() | ast.Repeat():
                text, end = _loop(only)
                self.suite(f"{head}: {text}", first, end, only.body, tight=tight)
            case _:
                self.line(f"{head}: {_simple(only)}", first, only.span).tight = tight

    def head(self, word: str, nodes: Sequence[ast.Node]) -> Span:
        """The span of the word that begins the block of these nodes."""
        first = nodes[0].span if nodes else NOWHERE
        spans = self._heads.get(word, [])
        position = bisect_left(spans, _start(first), key=_start)
        return spans[position - 1] if position and known(first) else first

    # --- statements

    def statements(self, block: ast.Block) -> None:
        """Write a block; an empty one is written as ``pass``."""
        if not block:
            self.line("pass", NOWHERE)
        for statement in block:
            self.statement(statement)

    def statement(self, s: ast.Stmt) -> None:
        """Write one statement with the blocks in it."""
        match s:
            case ast.If(arms=arms, otherwise=otherwise):
                for number, (condition, body) in enumerate(arms):
                    head = f"{'elif' if number else 'if'} {print_expr(condition)}"
                    first = condition.span if number else s.span
                    self.suite(head, first, condition.span, body, tight=number > 0)
                if otherwise is not None:
                    first = self.head("else", otherwise)
                    self.suite("else", first, first, otherwise, tight=True)
            case ast.ForRange() | ast.ForEach() | ast.Repeat():
                text, last = _loop(s)
                self.suite(text, s.span, last, s.body)
            case ast.Atomic(body=body):
                self.suite("atomic", s.span, beginning(s.span), body)
            case _:
                self.line(_simple(s), s.span, s.span)


def _loop(s: ast.ForRange | ast.ForEach | ast.Repeat) -> tuple[str, Span]:
    """The head of a loop as text, and the place where it ends."""
    match s:
        case ast.ForRange(variable=variable, low=low, high=high):
            return f"for {variable.name} = {print_expr(low)}, {print_expr(high)}", high.span
        case ast.ForEach(variables=variables, sequence=sequence):
            names = ", ".join(variable.name for variable in variables)
            return f"for {names} in {print_expr(sequence)}", sequence.span
        case ast.Repeat(count=count):
            return f"repeat {print_expr(count)}", count.span
        case _:
            assert_never(s)


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
            return declaration(decl)
        case ast.Pass():
            return "pass"
        case ast.CallStmt(call=call):
            return print_expr(call)
        case _:
            assert_never(s)


def declaration(decl: ast.VarDecl) -> str:
    """The declaration of a variable, a port, a field or a parameter."""
    initial = f" = {print_expr(decl.initial)}" if decl.initial is not None else ""
    return f"{print_type(decl.type)} {decl.name.name}{initial}"


def known(span: Span) -> bool:
    """Return whether a span is a place in a text."""
    return span.file != NOWHERE.file


def beginning(span: Span) -> Span:
    """The place where the span begins."""
    return Span(span.file, span.line, span.column, span.line, span.column)


def _on_line(span: Span, head: Span) -> bool:
    """Return whether something begins on the line on which the head before it ends."""
    return known(span) and known(head) and span.line == head.end_line


def _start(span: Span) -> tuple[int, int]:
    return span.line, span.column
