"""Diagnostics as text, with the line of the source and carets under the place, or as JSON.

    task.krd:12:9: error K204: `task` is not declared
      12 |     if task == 0:
         |        ^^^^
       = help: declare it under `local:`

The JSON is described by ``koord/api/schemas/diagnostics.schema.json``.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, TextIO

from msgspec import Struct, field
from msgspec.structs import replace

from koord.api.results import diagnostics_dict
from koord.cli.terminal import PLAIN, Paint, Style, cells, style_of, visible
from koord.syntax.diagnostics import Diagnostic, KoordError, Note, Severity
from koord.syntax.source import NOWHERE, Source, Span, counted, is_whole_file

if TYPE_CHECKING:
    from koord.verify.obstacles import Failure

#: The flags for the arguments of the public API that messages name.
_FLAGS = {
    "cluster": "--cluster",
    "config": "--ssh-config",
    "delta_s": "--delta",
    "engine": "--engine",
    "form": "--export",
    "identity": "--identity",
    "koord": "--koord",
    "level": "--level",
    "live": "--live",
    "numbers": "--numbers",
    "params": "--set",
    "preflight": "--preflight",
    "processes": "--processes",
    "program": "--program",
    "properties": "--with",
    "record": "--record",
    "reload": "--reload",
    "ask": "--ask",
    "resume": "--resume",
    "rests_on": "--rests-on",
    "robots": "--robots",
    "runs": "--runs",
    "site": "--site",
    "splitting": "--splitting",
    "trace": "--trace",
    "user": "--user",
}
_ARGUMENT = rf"`({'|'.join(_FLAGS)})=(?:'(\w+)')?`"

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


def in_flags(message: str) -> str:
    """Replace the public API's arguments in a message by flags: `live=`."""
    return re.sub(
        _ARGUMENT,
        lambda found: f"`{_FLAGS[found[1]]}{f' {found[2]}' if found[2] else ''}`",
        message,
    )


def _for_terminal(diagnostic: Diagnostic) -> Diagnostic:
    """A diagnostic of the public API, in the words of the command line."""
    span, hint = diagnostic.span, diagnostic.hint
    if span != NOWHERE and span.file.startswith("<"):
        span = replace(span, file=_FLAGS.get(span.file[1:-1], span.file))
    return replace(
        diagnostic,
        span=span,
        message=in_flags(diagnostic.message),
        hint=None if hint is None else in_flags(hint),
    )


class DiagnosticReport(Struct):
    """The diagnostics of a command, gathered file by file, and the texts they point into."""

    strict: bool = False
    diagnostics: list[Diagnostic] = field(default_factory=list)
    sources: dict[str, Source] = field(default_factory=dict)

    def add(self, diagnostics: Iterable[Diagnostic], *sources: Source) -> None:
        """Add what was found in some sources, in the order of their text; repeats are dropped."""
        self.sources.update((source.name, source) for source in sources)
        known = set(self.diagnostics)
        for diagnostic in map(_for_terminal, _in_order(diagnostics)):
            if self.strict:
                diagnostic = replace(diagnostic, severity=Severity.ERROR)
            if diagnostic not in known:
                known.add(diagnostic)
                self.diagnostics.append(diagnostic)

    @property
    def errors(self) -> int:
        return sum(d.severity is Severity.ERROR for d in self.diagnostics)

    @property
    def warnings(self) -> int:
        return len(self.diagnostics) - self.errors

    def print(self, stream: TextIO | None, *, as_json: bool) -> None:
        """Write everything, with a summary line if there is anything."""
        if stream is None:
            return
        if as_json:
            import json

            json.dump(diagnostics_dict(self.diagnostics), stream, indent=2, ensure_ascii=False)
            stream.write("\n")
            return
        style = style_of(stream)
        for diagnostic in self.diagnostics:
            stream.write("\n".join(render(diagnostic, self.sources, style)) + "\n")
        if self.diagnostics:
            stream.write(summary(self.errors, self.warnings) + "\n")


def report_error(error: KoordError, *, as_json: bool, sources: Iterable[Source] = ()) -> None:
    """Show the error that stopped a command: JSON on standard output, text on standard error."""
    report = DiagnosticReport()
    report.add((), *sources)
    report.add(error.diagnostics)
    report.print(sys.stdout if as_json else sys.stderr, as_json=as_json)


def complain(failure: Failure) -> None:
    """Say on standard error what of a result could not be made, by a mistake of koord's."""
    print(f"koord: {failure}; a mistake in koord, the verdicts stand", file=sys.stderr)


def render(
    diagnostic: Diagnostic, sources: Mapping[str, Source], style: Style = PLAIN
) -> Iterator[str]:
    """The lines of output for one diagnostic."""
    severity = diagnostic.severity.value
    paint = Paint.ERROR if diagnostic.severity is Severity.ERROR else Paint.WARNING
    kind = style.paint(f"{severity} {diagnostic.code}", paint)
    first, *more = diagnostic.message.splitlines() or [""]
    # What is about no file and no flag is said by the program itself.
    place = "koord" if diagnostic.span == NOWHERE else _place_text(diagnostic.span)
    yield f"{style.paint(place, Paint.BOLD)}: {kind}: {style.paint(visible(first), Paint.BOLD)}"
    for line in more:
        yield f"    {visible(line)}"
    yield from _excerpt(diagnostic.span, sources, style, paint)
    for note in diagnostic.notes:
        yield from _render_note(note, sources, style)
    if diagnostic.hint is not None:
        yield from _render_hint(diagnostic.hint, style)


def summary(errors: int, warnings: int) -> str:
    """``2 errors, 1 warning``; what there is none of is left out."""
    found = ((errors, "error"), (warnings, "warning"))
    parts = [counted(count, word) for count, word in found if count]
    return ", ".join(parts) or "no errors"


def _render_note(note: Note, sources: Mapping[str, Source], style: Style) -> Iterator[str]:
    kind = style.paint("note", Paint.NOTE)
    yield f"{_place_text(note.span)}: {kind}: {visible(note.message)}"
    yield from _excerpt(note.span, sources, style, Paint.NOTE)


def _render_hint(hint: str, style: Style) -> Iterator[str]:
    first, *more = hint.splitlines() or [""]
    yield f"  {style.paint('= help', Paint.NOTE)}: {visible(first)}"
    for line in more:
        yield f"          {visible(line)}"


def _excerpt(
    span: Span, sources: Mapping[str, Source], style: Style, paint: Paint
) -> Iterator[str]:
    source = sources.get(span.file)
    if source is not None:
        yield from excerpt(source, span, style, paint)


def _place_text(span: Span) -> str:
    name = visible(span.file)
    return name if is_whole_file(span) else f"{name}:{span.line}:{span.column}"


def _in_order(diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Sort by place in the text; files in the order of their first diagnostic."""
    found = list(diagnostics)
    files = list(dict.fromkeys(d.span.file for d in found))
    return sorted(found, key=lambda d: (files.index(d.span.file), d.span.line, d.span.column))
