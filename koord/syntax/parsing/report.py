"""Error log: the errors, and the old forms, that are found while a text is read."""

from __future__ import annotations

from koord.syntax.diagnostics import Diagnostic, Edit, Note, Severity
from koord.syntax.source import Span

#: More errors than this in one file help nobody.
MAX_ERRORS = 100


class ErrorLog:
    """The errors found so far in one file; of two at the same place only the first is kept."""

    __slots__ = ("_places", "damaged", "diagnostics")

    def __init__(self) -> None:
        self.diagnostics: list[Diagnostic] = []
        #: Lines with something that is not a token: what the parser says of them is not to be
        #: trusted.
        self.damaged: set[int] = set()
        self._places: set[tuple[int, int]] = set()

    def error(
        self,
        code: str,
        span: Span,
        message: str,
        hint: str | None = None,
        notes: tuple[Note, ...] = (),
    ) -> None:
        """Record an error, unless there are too many or there is one at this place already."""
        place = (span.line, span.column)
        if self.full or place in self._places:
            return
        self._places.add(place)
        if len(self.diagnostics) == MAX_ERRORS - 1:
            last = f"this is error number {MAX_ERRORS}: what comes after it is not shown"
            notes = (*notes, Note(span, last))
        self.diagnostics.append(Diagnostic(code, Severity.ERROR, span, message, hint, notes))

    def old(self, span: Span, message: str, hint: str, edits: tuple[Edit, ...]) -> None:
        """Warn of an old form; ``edits`` make today's of it. [OLD-FORM]"""
        if not self.full:
            self.diagnostics.append(
                Diagnostic("K407", Severity.WARNING, span, message, hint, edits=edits)
            )

    @property
    def full(self) -> bool:
        """True if the log takes no more errors."""
        return len(self.diagnostics) >= MAX_ERRORS

    def in_order(self) -> tuple[Diagnostic, ...]:
        """The errors in the order of the text."""
        return tuple(sorted(self.diagnostics, key=lambda d: (d.span.line, d.span.column)))
