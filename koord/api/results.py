"""What all results have in common: data, JSON text, a table for notebooks; and wrong arguments."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from html import escape

from msgspec import Struct

from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.source import Span, is_whole_file, whole_file

#: Raised when the JSON of diagnostics changes in a way that its readers must know of.
DIAGNOSTICS_VERSION = 1


class Result(Struct, frozen=True):
    """What a function of the public API answers: values that never change."""

    def to_dict(self) -> dict[str, object]:
        """The result as plain data, in the form that the command's ``--json`` prints."""
        raise NotImplementedError

    def to_json(self, *, indent: int | None = 2) -> str:
        """The same as a text; its schema is that of :func:`koord.schema`."""
        return json.dumps(self.to_dict(), indent=indent)


class ArgumentError(KoordError):
    """An argument of a function does not fit the program, or the other arguments."""

    def __init__(self, argument: str, message: str) -> None:
        place = whole_file(argument)
        super().__init__((Diagnostic("K905", Severity.ERROR, place, message),))
        self.argument = argument
        self.message = message

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.argument, self.message)


def html_table(heading: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table for a notebook; whatever stands in its cells is text."""

    def row(tag: str, cells: Sequence[object]) -> str:
        inside = "".join(f"<{tag}>{escape(str(cell))}</{tag}>" for cell in cells)
        return f"<tr>{inside}</tr>"

    body = "".join(row("td", cells) for cells in rows)
    table = f"<table>{row('th', columns)}{body}</table>" if columns else ""
    return f"<p>{escape(heading)}</p>{table}"


def diagnostics_dict(diagnostics: Sequence[Diagnostic]) -> dict[str, object]:
    """Diagnostics as plain data; the schema is ``diagnostics``."""
    errors = sum(d.severity is Severity.ERROR for d in diagnostics)
    return {
        "version": DIAGNOSTICS_VERSION,
        "errors": errors,
        "warnings": len(diagnostics) - errors,
        "diagnostics": [
            {
                "code": diagnostic.code,
                "severity": diagnostic.severity.value,
                "message": diagnostic.message,
                "hint": diagnostic.hint,
                **_place(diagnostic.span),
                "notes": [
                    {"message": note.message, **_place(note.span)} for note in diagnostic.notes
                ],
            }
            for diagnostic in diagnostics
        ],
    }


def _place(span: Span) -> dict[str, object]:
    if is_whole_file(span):
        return {"file": span.file, "span": None}
    place = {
        "line": span.line,
        "column": span.column,
        "end_line": span.end_line,
        "end_column": span.end_column,
    }
    return {"file": span.file, "span": place}
