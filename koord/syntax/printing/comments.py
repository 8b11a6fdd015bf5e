"""Comments and blank lines put back between the lines that the printer writes.

Each written line knows where its construct stood in the text. A comment goes to the construct it
stands beside or before; one at the end of a block stays in that block. Constructs may be written in
another order than they stood in, and take their comments along.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec import Struct, field

from koord.syntax.ast import Comment

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
    """A comment on a line of its own, with a blank line before it or not."""

    text: str
    blank: bool


def weave(lines: Sequence[OutputLine], comments: Sequence[Comment]) -> str:
    """The text of the lines with the comments among them."""
    in_order = sorted((line for line in lines if line.line), key=lambda line: line.line)
    footer = _place(in_order, comments)
    output: list[str] = []
    for text, blank in _emit(lines, footer):
        if blank and output:
            output.append("")
        output.append(text.rstrip())
    return "".join(f"{text}\n" for text in output)


def _place(lines: Sequence[OutputLine], comments: Sequence[Comment]) -> list[_Placed]:
    """Give each comment to a line; the result are those that belong to none."""
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
