"""The parser: lines to blocks by their indentation, then ``parse``.

Lines indented like a block belong to it; deeper-indented lines are the body of the part that the
line before them ends with, or go on with a body that began on that line. Mistakes of indentation
are told and mended here, so that the parser sees a tree in any case.
"""

from __future__ import annotations

from itertools import pairwise

from msgspec import Struct, field

from koord.syntax import ast
from koord.syntax.collector import uncollected
from koord.syntax.diagnostics import Diagnostic
from koord.syntax.parsing.lines import Line, LinePart, language_lines
from koord.syntax.parsing.reader import LineReader
from koord.syntax.parsing.report import ErrorLog
from koord.syntax.parsing.sections import sections
from koord.syntax.parsing.tokens import TokenText, shown, tokenise, words
from koord.syntax.source import Source

#: Blocks may stand inside each other so deep.
MAX_BLOCKS = 64

#: First words of parts that want a body. If their colon is missing, the deeper lines below are
#: their body nevertheless.
_OPENERS = words(
    """agent allread allwrite assume atomic contract def eff elif else ensures enum environment
    eventually for if init invariant local pre requires sensors actuators urgent using"""
)

#: First words of lines that stand no deeper than the head of a block of statements.
_OUTER = words(
    """AGENT ALLREAD ALLWRITE ASSUME DEF EFF ELIF ELSE ENUM EVENTUALLY INIT INVARIANT LOCAL PARAM
    PRE URGENT USING"""
)


class _Level(Struct):
    """An open block."""

    column: int
    head: LinePart  #: whose body it is
    depth: int
    #: Columns of lines that were told to be wrongly indented and belong here.
    mistaken: set[int] = field(default_factory=set)
    #: Whether the block began on the line of its head, with one `if`: an `else` that is not below
    #: that may still be meant.
    inline: bool = False


def lay_out(text: TokenText, report: ErrorLog) -> list[LinePart]:
    """Lay lines out as blocks: return the parts at the left margin, with their bodies."""
    layout = _Layout(report, tabs=text.tabs)
    for line in language_lines(text.lines, report):
        layout.place(line)
    return layout.root.body


class _Layout:
    __slots__ = ("levels", "previous", "report", "root", "tabs", "too_deep")

    def __init__(self, report: ErrorLog, *, tabs: bool) -> None:
        self.report = report
        #: Whether tabs were told of: then nobody knows what the indentation was meant to be.
        self.tabs = tabs
        self.root = LinePart([])
        self.levels = [_Level(0, self.root, 0)]
        self.previous: Line | None = None
        self.too_deep = False

    def place(self, line: Line) -> None:
        """Put a line into the body it belongs to."""
        level = self._level(line)
        if level.depth + len(line.chain) - 1 > MAX_BLOCKS:
            if not self.too_deep:
                self.report.error(
                    "K108",
                    line.roots[0].span,
                    f"blocks stand inside each other more than {MAX_BLOCKS} deep",
                    "make a function of the inner ones",
                )
            self.too_deep = True
            level.head.told = "K108"
            for part in line.chain[:-1]:
                part.body = []
        else:
            level.head.body.extend(line.roots)
        self.previous = line

    def _level(self, line: Line) -> _Level:
        column = line.indent
        top = self.levels[-1]
        if column > top.column and column not in top.mistaken:
            found = self._continued(line)
            if found:
                self._open(column, *found)
                return self.levels[-1]
            self._mistake(
                "K110",
                line,
                "this line is indented deeper than the one before it, which opens no block",
                _cure(top.column),
            )
            top.mistaken.add(column)
        while top.column > column and column not in top.mistaken:
            outer = self.levels[-2]
            if outer.column < column and column not in outer.mistaken:
                if _goes_on_with_if(top, line):
                    top.column, top.inline = column, False
                    break
                self._mistake(
                    "K111",
                    line,
                    "the indentation of this line is that of no open block",
                    f"{_cure(outer.column)}, or with {top.column}",
                )
                if _is_statement(line.roots[0]):
                    top.mistaken.add(column)
                    break
                outer.mistaken.add(column)
            self.levels.pop()
            top = outer
        return top

    def _open(self, column: int, head: LinePart, deeper: int) -> None:
        """Open the body of a part, and those around it that began on the same line."""
        assert self.previous is not None
        top = self.levels[-1]
        chain = self.previous.chain
        one_if = sum(part.first in ("IF", "ELIF") for part in chain[:deeper]) == 1
        for depth, (outer, inner) in enumerate(pairwise(chain[:deeper]), 1):
            begin = inner.tokens[0].column - 1 if inner.tokens else 0
            if self.levels[-1].column < begin < column:
                self.levels.append(_Level(begin, outer, top.depth + depth, inline=one_if))
        self.levels.append(_Level(column, head, top.depth + deeper))

    def _mistake(self, code: str, line: Line, message: str, cure: str) -> None:
        if not self.tabs:
            part = line.roots[0]
            place = part.tokens[0].span if part.tokens else part.span
            self.report.error(code, place, message, cure)

    def _continued(self, line: Line) -> tuple[LinePart, int] | None:
        """The part whose body a deeper-indented line goes on with, if the line before has one.

        With it, how many blocks deeper it is than the line before.
        """
        chain = self.previous.chain if self.previous else []
        if not chain:
            return None
        last = chain[-1]
        if last.colon or _opens(last, alone=len(chain) == 1 and self.levels[-1].depth == 0):
            return last, len(chain)
        # the part that opens a body on the line, and the column where that body begins
        opened = [
            (outer, inner, inner.tokens[0].column - 1 if inner.tokens else line.indent)
            for outer, inner in pairwise(chain)
        ]
        first = line.roots[0].first
        # `pre` and `eff` go on with an event, and nothing else does.
        goes_on = first in ("PRE", "EFF")
        opened = [c for c in opened if (c[1].first in ("PRE", "EFF")) == goes_on] or opened
        if first in ("ELSE", "ELIF"):
            ifs = [c for c in opened if c[1].first in ("IF", "ELIF")]
            if not ifs and chain[0].first in ("IF", "ELIF"):
                return None
            opened = ifs or opened[:1]
        elif opened and line.indent > opened[-1][2]:
            opened = opened[-1:]
        opened = [c for c in opened if c[2] == line.indent] or opened
        if len(opened) > 1:
            outer, inner = (_head(part) for part in (opened[0][0], opened[-1][0]))
            self._mistake(
                "K112",
                line,
                f"this line may belong to {outer} or to {inner} of the line before it",
                f"begin the body of {inner} on a line of its own",
            )
        if not opened:
            return None
        return opened[0][0], chain.index(opened[0][0]) + 1


def _opens(part: LinePart, *, alone: bool) -> bool:
    """Return whether a part lacks the colon of a block; ``alone``: it is at the left margin."""
    if not part.tokens:
        return False
    return part.tokens[0].text in _OPENERS or (
        alone and len(part.tokens) == 1 and part.first == "NAME"
    )


def _goes_on_with_if(level: _Level, line: Line) -> bool:
    """Return whether a line is the `else` of the one `if` on the line of the level's head."""
    body = level.head.body
    if not level.inline or not body or line.roots[0].first not in ("ELSE", "ELIF"):
        return False
    return body[-1].first in ("IF", "ELIF")


def _is_statement(part: LinePart) -> bool:
    """Return whether a line can start a block of statements, whatever its indentation means."""
    return part.first not in _OUTER and not (part.first == "NAME" and part.colon)


def _head(part: LinePart) -> str:
    return f"`{shown(part.tokens[0].text)}`" if part.tokens else "`:`"


def _cure(column: int) -> str:
    return f"indent it with {column} spaces" if column else "begin it at the left margin"


#: A longer text is not read.
MAX_CHARACTERS = 1_000_000


class Parsed(Struct, frozen=True):
    """The result of parsing: the readable part of a text, and its diagnostics."""

    program: ast.Program
    diagnostics: tuple[Diagnostic, ...]


def parse(source: Source) -> Parsed:
    """Parse a program (or a file of properties).

    Never raises on any text: what cannot be read is told and left out, and the rest is there.
    """
    with uncollected():
        return _parse(source)


def _parse(source: Source) -> Parsed:
    report = ErrorLog()
    if len(source.text) > MAX_CHARACTERS:
        report.error(
            "K106",
            source.span(0, 0),
            f"this file has {len(source.text):,} characters, more than {MAX_CHARACTERS:,}",
            "is it a program? If so, take it apart",
        )
        text = TokenText([], (), tabs=False)
    else:
        text = tokenise(source, report)
    reader = LineReader(report)
    tree = sections(reader, lay_out(text, report))
    for line in text.lines:
        if line.tokens[0].line in report.damaged:
            reader.lose(LinePart(line.tokens))
    program = ast.Program(
        tree,
        text.comments,
        tuple(reader.heads),
        frozenset(reader.lost),
        span=source.span(0, len(source.text)),
    )
    return Parsed(program, report.in_order())
