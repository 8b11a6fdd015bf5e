"""Diagnostics as a user sees them: as text with the source line and carets, or as JSON.

    task.krd:12:9: error K204: `task` is not declared
      12 |     if task == 0:
         |        ^^^^
       = help: declare it under `local:`

The JSON is described by ``koord/api/schemas/diagnostics.schema.json``.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping
from typing import TextIO

from msgspec import Struct, field
from msgspec.structs import replace

from koord.api.results import diagnostics_dict
from koord.cli.excerpt import excerpt
from koord.cli.terminal import PLAIN, Paint, Style, style_of, visible
from koord.syntax.diagnostics import Diagnostic, KoordError, Note, Severity
from koord.syntax.source import NOWHERE, Source, Span, is_whole_file


class DiagnosticReport(Struct):
    """The diagnostics of a run, gathered file by file, and the texts they point into."""

    strict: bool = False
    diagnostics: list[Diagnostic] = field(default_factory=list)
    sources: dict[str, Source] = field(default_factory=dict)

    def add(self, diagnostics: Iterable[Diagnostic], *sources: Source) -> None:
        """Add what was found in some sources, in the order of their text; repeats are dropped."""
        self.sources.update((source.name, source) for source in sources)
        known = set(self.diagnostics)
        for diagnostic in _in_order(diagnostics):
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
    """Show what stopped a command: JSON where the answer was to go, text to standard error."""
    report = DiagnosticReport()
    report.add((), *sources)
    report.add(error.diagnostics)
    report.print(sys.stdout if as_json else sys.stderr, as_json=as_json)


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
    parts = [
        f"{count} {word}" if count == 1 else f"{count} {word}s"
        for count, word in ((errors, "error"), (warnings, "warning"))
        if count
    ]
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
    """By place in the text; files in the order of their first diagnostic."""
    found = list(diagnostics)
    files = list(dict.fromkeys(d.span.file for d in found))
    return sorted(found, key=lambda d: (files.index(d.span.file), d.span.line, d.span.column))
