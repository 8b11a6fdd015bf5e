"""From lines to blocks: which line belongs to which body.

A line is cut at the colons that open blocks into *parts*, each the body of the part before it:
``else: atomic:`` is a part ``else`` whose body is a part ``atomic``. More-indented lines go on with a
body that the line opened; lines indented like a block belong to that block. Mistakes of indentation
are told and mended here, so that the parser sees a tree in any case.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from koord.syntax.report import Report
from koord.syntax.source import Span
from koord.syntax.tokens import TextLine, Token

#: Blocks and brackets may stand inside each other so deep.
MAX_BLOCKS = 64
MAX_BRACKETS = 100

_OPENING = {"LPAR": "RPAR", "LSQB": "RSQB", "LBRACE": "RBRACE"}
_CLOSING = frozenset(_OPENING.values())
_QUANTIFIERS = frozenset(["FORALL", "EXISTS"])

#: First words of parts that want a body: if their colon is missing, the deeper lines below are
#: their body nevertheless.
_OPENERS = frozenset(
    """AGENT ALLREAD ALLWRITE ASSUME ATOMIC DEF EFF ELIF ELSE ENUM EVENTUALLY FOR IF INIT INVARIANT
    LOCAL PRE URGENT USING""".split()
)


@dataclass(slots=True)
class Part:
    """A piece of a line up to a colon that opens a block, or up to the end of the line."""

    tokens: list[Token]
    colon: Token | None
    body: list[Part] = field(default_factory=list)
    #: Something wrong in it was told already.
    broken: bool = False

    @property
    def end(self) -> Token:
        """A token for the place behind the part: its colon, or nothing at the end of the line."""
        if self.colon:
            return self.colon
        last = self.tokens[-1]
        column = last.end_column
        return Token("END", "", last.file, last.line, column, column + 1)

    @property
    def span(self) -> Span:
        """From the first token to the last, or the colon if there is nothing else."""
        if self.tokens:
            return self.tokens[0].span.to(self.tokens[-1].span)
        return self.end.span


@dataclass(slots=True)
class _Level:
    column: int
    body: list[Part]


@dataclass(slots=True)
class _Line:
    indent: int
    parts: list[Part]


def lay_out(lines: list[TextLine], report: Report) -> list[Part]:
    """The parts at the left margin, with their bodies."""
    root: list[Part] = []
    levels = [_Level(0, root)]
    previous: _Line | None = None
    for line in _logical(lines, report):
        level = _level_for(line, previous, levels, report)
        level.body.append(line.parts[0])
        previous = line
    return root


def _level_for(
    line: _Line, previous: _Line | None, levels: list[_Level], report: Report
) -> _Level:
    column = line.indent
    top = levels[-1]
    if column == top.column:
        return top
    if column > top.column:
        body = _continued(line, previous) if previous else None
        if body is None:
            first = line.parts[0].tokens[0]
            report.error(
                "K110",
                first.span,
                "this line is indented deeper than the one before it, which opens no block",
                f"indent it with {top.column} spaces, not {column}"
                if top.column
                else "begin it at the left margin",
            )
            body = top.body
        levels.append(_Level(column, body))
        return levels[-1]
    popped = top
    while levels[-1].column > column:
        popped = levels.pop()
    top = levels[-1]
    if top.column < column:
        first = line.parts[0].tokens[0]
        report.error(
            "K111",
            first.span,
            "the indentation of this line is that of no open block",
            f"indent it with {top.column} or {popped.column} spaces",
        )
        nearest = popped if popped.column - column < column - top.column else top
        levels.append(_Level(column, nearest.body))
    return levels[-1]


def _continued(line: _Line, previous: _Line) -> list[Part] | None:
    last = previous.parts[-1]
    if last.colon or not last.tokens or last.tokens[0].type in _OPENERS:
        return last.body
    if len(previous.parts) == 1:
        return None
    body = previous.parts[0].body
    for part in previous.parts[:-1]:
        if part.body[0].tokens[0].column - 1 <= line.indent:
            body = part.body
    return body


def _logical(lines: list[TextLine], report: Report) -> list[_Line]:
    result: list[_Line] = []
    tokens: list[Token] = []
    depth = 0
    indent = 0
    for line in lines:
        if not depth:
            tokens = []
            indent = line.indent
        for token in line.tokens:
            kind = token.type
            if kind in _OPENING:
                depth += 1
            elif kind in _CLOSING:
                depth -= 1
        tokens.extend(line.tokens)
        if not depth:
            result.append(_Line(indent, _parts(tokens)))
    return result


def _parts(tokens: list[Token]) -> list[Part]:
    parts: list[Part] = []
    depth = 0
    pending = 0
    start = 0
    for position, token in enumerate(tokens):
        kind = token.type
        if kind == "COLON":
            if depth:
                continue
            if pending:
                pending -= 1
                continue
            parts.append(Part(tokens[start:position], token))
            start = position + 1
        elif kind in _OPENING:
            depth += 1
        elif kind in _CLOSING:
            depth -= 1
        elif kind in _QUANTIFIERS and not depth:
            pending += 1
    if start < len(tokens):
        parts.append(Part(tokens[start:], None))
    for outer, inner in zip(parts, parts[1:], strict=False):
        outer.body.append(inner)
    return parts
