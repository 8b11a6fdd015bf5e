"""Where elaboration puts what is wrong with a program."""

from __future__ import annotations

from koord.syntax.diagnostics import Diagnostic, Note, Severity
from koord.syntax.source import Span


class Findings:
    """The errors and warnings found so far; the same thing at the same place is kept once."""

    __slots__ = ("_found", "errors")

    def __init__(self) -> None:
        self._found: dict[tuple[str, Span], Diagnostic] = {}
        self.errors = 0

    def error(
        self,
        code: str,
        span: Span,
        message: str,
        hint: str | None = None,
        notes: tuple[Note, ...] = (),
    ) -> None:
        """Record an error: no core program will come out of this."""
        self.errors += 1
        self._add(Diagnostic(code, Severity.ERROR, span, message, hint, notes))

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

    def _add(self, diagnostic: Diagnostic) -> None:
        self._found.setdefault((diagnostic.code, diagnostic.span), diagnostic)

    def in_order(self) -> tuple[Diagnostic, ...]:
        """All of them, in the order of the text; files in the order of their first finding."""
        files: dict[str, int] = {}
        for diagnostic in self._found.values():
            files.setdefault(diagnostic.span.file, len(files))
        return tuple(
            sorted(
                self._found.values(),
                key=lambda d: (files[d.span.file], d.span.line, d.span.column),
            )
        )
