"""Findings: the errors and warnings of an elaboration."""

from __future__ import annotations

from msgspec.structs import replace

from koord.syntax.diagnostics import Diagnostic, Edit, Note, Severity
from koord.syntax.source import Span

#: Of the other places of a mistake so many are named.
_MOST_LINES = 5


class DiagnosticLog:
    """The errors and warnings found so far; duplicates at one place are kept once."""

    __slots__ = ("_again", "_edits", "_found", "_old", "errors")

    def __init__(self) -> None:
        self._found: dict[tuple[str, Span], Diagnostic] = {}
        self._again: dict[tuple[str, Span], list[Span]] = {}
        self._edits: dict[tuple[str, Span], dict[Span, Edit]] = {}
        self._old: dict[tuple[str, str], Span] = {}
        self.errors = 0

    def error(
        self,
        code: str,
        span: Span,
        message: str,
        hint: str | None = None,
        notes: tuple[Note, ...] = (),
        edits: tuple[Edit, ...] = (),
    ) -> None:
        """Record an error: elaboration will yield no core program."""
        self.errors += 1
        self._add(Diagnostic(code, Severity.ERROR, span, message, hint, notes, edits))

    def warning(
        self,
        code: str,
        span: Span,
        message: str,
        hint: str | None = None,
        notes: tuple[Note, ...] = (),
    ) -> None:
        """Record a warning."""
        self._add(Diagnostic(code, Severity.WARNING, span, message, hint, notes))

    def old(self, form: str, span: Span, message: str, hint: str, *edits: Edit) -> None:
        """Warn of an old form, once in a file: other places add their edits. [OLD-FORM]

        ``form`` is what makes places alike, ``edits`` what makes today's form of this place.
        """
        first = self._old.setdefault((form, span.file), span)
        key = ("K407", first)
        if first == span:
            self._add(Diagnostic("K407", Severity.WARNING, span, message, hint))
        else:
            self._again.setdefault(key, []).append(span)
        self._edits.setdefault(key, {}).update((edit.span, edit) for edit in edits)

    def again(self, code: str, first: Span, place: Span) -> None:
        """Record that the problem of a first place occurs in another."""
        self.errors += 1
        self._again.setdefault((code, first), []).append(place)

    def _add(self, diagnostic: Diagnostic) -> None:
        self._found.setdefault((diagnostic.code, diagnostic.span), diagnostic)

    def in_order(self) -> tuple[Diagnostic, ...]:
        """The findings in the order of the text; files in the order of their first finding."""
        files: dict[str, int] = {}
        for diagnostic in self._found.values():
            files.setdefault(diagnostic.span.file, len(files))
        return tuple(
            sorted(
                (self._with_others(*found) for found in self._found.items()),
                key=lambda d: (files[d.span.file], d.span.line, d.span.column),
            )
        )

    def _with_others(self, key: tuple[str, Span], found: Diagnostic) -> Diagnostic:
        """A finding that lists the other lines with the same problem."""
        first = key[1]
        edits = sorted(self._edits.get(key, {}).values(), key=_start)
        if edits:
            found = replace(found, edits=tuple(edits))
        lines = dict.fromkeys(
            place.line if place.file == first.file else f"{place.file}:{place.line}"
            for place in self._again.get(key, ())
            if (place.file, place.line) != (first.file, first.line)
        )
        if not lines:
            return found
        shown = [str(line) for line in list(lines)[:_MOST_LINES]]
        more = f" and {len(lines) - len(shown)} more" if len(lines) > len(shown) else ""
        plural = "s" if len(lines) > 1 else ""
        story = f"{found.message}; it stands in line{plural} {', '.join(shown)}{more} as well"
        return replace(found, message=story)


def _start(edit: Edit) -> tuple[int, int]:
    return edit.span.line, edit.span.column
