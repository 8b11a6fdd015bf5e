"""From lines to blocks: which line belongs to which body.

Lines indented like a block belong to it; deeper-indented lines are the body of the part that the
line before them ends with, or go on with a body that began on that line. Mistakes of indentation
are told and mended here, so that the parser sees a tree in any case.
"""

from __future__ import annotations

from dataclasses import dataclass

from koord.syntax.lines import Line, Part, language_lines
from koord.syntax.report import Report
from koord.syntax.tokens import Text

#: Blocks may stand inside each other so deep.
MAX_BLOCKS = 64

#: First words of parts that want a body. If their colon is missing, the deeper lines below are
#: their body nevertheless.
_OPENERS = frozenset(
    """agent allread allwrite assume atomic contract def eff elif else ensures enum environment
    eventually for if init invariant local pre requires sensors actuators urgent using""".split()
)


@dataclass(slots=True)
class _Level:
    """An open block, or a wrong indentation that stands for one."""

    column: int
    body: list[Part]
    depth: int


def lay_out(text: Text, report: Report) -> list[Part]:
    """The parts at the left margin, with their bodies."""
    layout = _Layout(report, tabs=text.tabs)
    for line in language_lines(text.lines, report):
        layout.place(line)
    return layout.root


class _Layout:
    __slots__ = ("levels", "previous", "report", "root", "tabs", "too_deep")

    def __init__(self, report: Report, *, tabs: bool) -> None:
        self.report = report
        #: Whether tabs were told of: then nobody knows what the indentation was meant to be.
        self.tabs = tabs
        self.root: list[Part] = []
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
            for part in line.chain[:-1]:
                part.body = []
        else:
            level.body.extend(line.roots)
        self.previous = line

    def _level(self, line: Line) -> _Level:
        column = line.indent
        top = self.levels[-1]
        if column > top.column:
            found = self._continued(line)
            if found is None:
                self._mistake(
                    "K110",
                    line,
                    "this line is indented deeper than the one before it, which opens no block",
                    _cure(top.column),
                )
                self.levels.append(_Level(column, top.body, top.depth))
            else:
                self.levels.append(_Level(column, found[0], top.depth + found[1]))
            return self.levels[-1]
        popped = top
        while self.levels[-1].column > column:
            popped = self.levels.pop()
        top = self.levels[-1]
        if top.column < column:
            self._mistake(
                "K111",
                line,
                "the indentation of this line is that of no open block",
                f"{_cure(top.column)} or {popped.column}",
            )
            nearest = popped if popped.column - column < column - top.column else top
            self.levels.append(_Level(column, nearest.body, nearest.depth))
        return self.levels[-1]

    def _mistake(self, code: str, line: Line, message: str, cure: str) -> None:
        if not self.tabs:
            part = line.roots[0]
            place = part.tokens[0].span if part.tokens else part.span
            self.report.error(code, place, message, cure)

    def _continued(self, line: Line) -> tuple[list[Part], int] | None:
        """The body that a deeper-indented line goes on with, if the line before it has one.

        With it, how many blocks deeper it is than the line before.
        """
        chain = self.previous.chain if self.previous else []
        if not chain:
            return None
        last = chain[-1]
        if last.colon or _opens(last, alone=len(chain) == 1 and self.levels[-1].depth == 0):
            return last.body, len(chain)
        # the part that opens a body on the line, and the column where that body begins
        opened = [
            (outer, inner, inner.tokens[0].column - 1 if inner.tokens else line.indent)
            for outer, inner in zip(chain, chain[1:], strict=False)
        ]
        if line.roots[0].first in ("ELSE", "ELIF"):
            opened = [candidate for candidate in opened if candidate[1].first in ("IF", "ELIF")]
            opened = [c for c in opened if c[2] == line.indent] or opened
        else:
            opened = [c for c in opened if c[2] <= line.indent][-1:] or opened
        if len(opened) > 1:
            outer, inner = (f"`{part.tokens[0].text}`" for part in (opened[0][0], opened[-1][0]))
            self._mistake(
                "K112",
                line,
                f"this line may belong to {outer} or to {inner} of the line before it",
                f"begin the body of {inner} on a line of its own",
            )
        if not opened:
            return None
        return opened[0][0].body, chain.index(opened[0][0]) + 1


def _opens(part: Part, *, alone: bool) -> bool:
    """Whether a part without a colon was meant to have one; ``alone`` at the left margin."""
    if not part.tokens:
        return False
    return part.tokens[0].text in _OPENERS or (
        alone and len(part.tokens) == 1 and part.first == "NAME"
    )


def _cure(column: int) -> str:
    return f"indent it with {column} spaces" if column else "begin it at the left margin"
