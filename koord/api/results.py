"""The base of results: plain data, JSON text, tables for notebooks; and argument errors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Final

from msgspec import Struct, to_builtins

from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.source import Span, is_whole_file, whole_file

if TYPE_CHECKING:
    from koord.api import forms

#: Raised when the JSON of diagnostics changes in a way that its readers must know of.
DIAGNOSTICS_VERSION: Final = 1

#: The same of what `koord migrate --json` prints.
MIGRATION_VERSION: Final = 1


class Result(Struct, frozen=True):
    """The base of the public API's results, which are immutable."""

    def to_dict(self) -> dict[str, object]:
        """The result as plain data, in the form that the command's ``--json`` prints."""
        raise NotImplementedError

    def to_json(self, *, indent: int | None = 2) -> str:
        """The same as a text; its schema is that of :func:`koord.schema`."""
        import json  # most results are read by people

        return json.dumps(self.to_dict(), indent=indent)


class ArgumentError(KoordError):
    """Raised for an argument that does not fit the program, or the other arguments."""

    def __init__(self, argument: str, message: str) -> None:
        place = whole_file(argument)
        super().__init__((Diagnostic("K905", Severity.ERROR, place, message),))
        self.argument = argument
        self.message = message

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.argument, self.message)


def html_table(heading: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table for a notebook; the text of its cells is escaped, unless it is :class:`Html`."""
    from html import escape  # no other result needs it

    def shown(cell: object) -> str:
        return cell if isinstance(cell, Html) else escape(str(cell))

    def row(tag: str, cells: Sequence[object]) -> str:
        inside = "".join(f"<{tag}>{shown(cell)}</{tag}>" for cell in cells)
        return f"<tr>{inside}</tr>"

    body = "".join(row("td", cells) for cells in rows)
    table = f"<table>{row('th', columns)}{body}</table>" if columns else ""
    return f"<p>{escape(heading)}</p>{table}"


#: Colours that are read on light and on dark pages, of what is good, bad and neither.
_GOOD, _BAD, _OPEN = "#2e8b57", "#d0403f", "#b8860b"
_COLOURS = {"holds": _GOOD, "violated": _BAD, "unknown": _OPEN}


def html_outcome(outcome: str, more: str = "") -> str:
    """An outcome for a notebook, in its colour, with more behind it."""
    from html import escape

    colour = _COLOURS.get(outcome, _OPEN)
    said = f'<b style="color: {colour}">{escape(outcome)}</b>'
    return f"{said} {escape(more)}".rstrip()


def html_details(heading: str, inside: str) -> str:
    """Something for a notebook that is shown when its heading is clicked on; ``inside`` is HTML."""
    from html import escape

    return f"<details><summary>{escape(heading)}</summary>{inside}</details>"


class Html(str):
    """A text that is HTML already, and is not escaped."""


def diagnostic_form(one: Diagnostic) -> forms.Diagnostic:
    """A diagnostic in the form that documents have it in."""
    from koord.api import forms

    def within(one: Span) -> forms.Span:
        return forms.Span(one.line, one.column, one.end_line, one.end_column)

    def span(one: Span) -> forms.Span | None:
        return None if is_whole_file(one) else within(one)

    return forms.Diagnostic(
        one.code,
        one.severity.value,
        one.message,
        one.hint,
        one.span.file,
        span(one.span),
        [forms.Note(note.message, note.span.file, span(note.span)) for note in one.notes],
        [forms.Edit(within(edit.span), edit.text) for edit in one.edits],
    )


def diagnostics_dict(diagnostics: Sequence[Diagnostic]) -> dict[str, object]:
    """Diagnostics as plain data; the schema is ``diagnostics``."""
    from koord.api import forms

    errors = sum(d.severity is Severity.ERROR for d in diagnostics)
    made = forms.Diagnostics(
        DIAGNOSTICS_VERSION,
        errors,
        len(diagnostics) - errors,
        [diagnostic_form(one) for one in diagnostics],
    )
    found: dict[str, object] = to_builtins(made)
    return found
