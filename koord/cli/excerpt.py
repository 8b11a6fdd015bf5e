"""The lines of a source that a diagnostic points at, with carets under the place."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec import Struct

from koord.cli.terminal import Paint, Style, cells, visible
from koord.syntax.source import Source, Span

#: What stands for the part of a line that was cut away.
CUT = "..."


class Stretch(Struct, frozen=True):
    """A part of one line to be marked: columns from 1, the end excluded."""

    line: int
    column: int
    end_column: int


def place(sources: Iterable[Source], span: Span, style: Style) -> Iterator[str]:
    """A place in the text of one of the sources, with the line."""
    yield f"  {visible(span.file)}:{span.line}:{span.column}"
    for source in sources:
        if source.name == span.file:
            yield from excerpt(source, span, style, Paint.ERROR)


def excerpt(source: Source, span: Span, style: Style, paint: Paint) -> Iterator[str]:
    """The lines of output that show ``span`` in its source; none if it lies outside the text.

    A span over several lines shows its first and its last one.
    """
    stretches = list(_stretches(source, span))
    gutter = max((len(str(s.line)) for s in stretches), default=0) + 2
    edge = style.paint("|", Paint.GUTTER)
    last = None
    for stretch in stretches:
        if last is not None and stretch.line > last + 1:
            yield style.paint("...".rjust(gutter), Paint.GUTTER)
        text, before, marked = _cut(source.line_text(stretch.line), stretch, style.width - gutter)
        number = style.paint(str(stretch.line).rjust(gutter), Paint.GUTTER)
        yield f"{number} {edge} {text}".rstrip()
        yield f"{' ' * gutter} {edge} {' ' * before}{style.paint('^' * marked, paint)}"
        last = stretch.line


def _stretches(source: Source, span: Span) -> Iterator[Stretch]:
    first = source.line_text(span.line)
    if span.line < 1 or (not first and not _has_line(source, span.line)):
        return
    end_line, end_column = span.end_line, span.end_column
    if end_line > span.line and end_column <= 1:  # up to a line's start: the line before ends it
        end_line -= 1
        end_column = len(source.line_text(end_line)) + 1
    if end_line <= span.line:
        yield Stretch(span.line, span.column, max(span.column + 1, end_column))
        return
    yield Stretch(span.line, span.column, max(span.column + 1, len(first) + 1))
    last = source.line_text(end_line)
    indent = len(last) - len(last.lstrip())
    if indent + 1 < end_column:
        yield Stretch(end_line, indent + 1, end_column)


def _has_line(source: Source, line: int) -> bool:
    return line <= source.place(len(source.text))[0]


def _cut(line: str, stretch: Stretch, room: int) -> tuple[str, int, int]:
    """The visible part of a line in ``room`` cells, the cells before the mark, and the mark's.

    Only characters near the mark are looked at: a line may be a megabyte long, and have a
    thousand diagnostics.
    """
    room -= 3  # " | "
    start = min(stretch.column - 1, len(line))
    end = max(stretch.end_column - 1, start)
    left, right = 0, len(line)
    if len(line) > room or cells(visible(line)) > room:
        room -= 2 * len(CUT)
        context = room - min(cells(visible(line[start : min(end, start + room)])), room // 2)
        left = _walk_back(line, start, context // 2)
        right = _walk_on(line, left, room)
    head = CUT if left > 0 else ""
    tail = CUT if right < len(line) else ""
    before = len(head) + cells(visible(line[left:start]))
    marked = cells(visible(line[start : min(end, right)]))
    return f"{head}{visible(line[left:right])}{tail}", before, max(1, marked)


def _walk_back(line: str, start: int, room: int) -> int:
    """The first position from which the text up to ``start`` takes at most ``room`` cells."""
    position = start
    while position > 0 and room > 0:
        room -= max(1, cells(visible(line[position - 1])))
        position -= 1
    return position


def _walk_on(line: str, left: int, room: int) -> int:
    """The last position up to which the text from ``left`` takes at most ``room`` cells."""
    position = left
    while position < len(line):
        room -= cells(visible(line[position]))
        if room < 0:
            break
        position += 1
    return position
