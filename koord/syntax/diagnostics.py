"""Diagnostics of user input, as values. The command line prints them; nothing else does."""

from __future__ import annotations

from enum import Enum

from msgspec import Struct

from koord.syntax.source import Span, whole_file


class Severity(Enum):
    """The severity of a diagnostic: an error stops the work."""

    ERROR = "error"
    WARNING = "warning"


class Note(Struct, frozen=True):
    """A second place that helps to understand a diagnostic ("first declared here")."""

    span: Span
    message: str


class Edit(Struct, frozen=True):
    """A replacement of the characters of ``span`` by ``text``; an empty span is an insertion."""

    span: Span
    text: str


class Diagnostic(Struct, frozen=True):
    """A diagnostic: one problem at one place, with its cure where one is known.

    ``code`` is stable (``K204``) and has a long story in :mod:`koord.syntax.catalogue`. ``edits``
    are the cure as data, to be made all together; none overlaps another.
    """

    code: str
    severity: Severity
    span: Span
    message: str
    hint: str | None = None
    notes: tuple[Note, ...] = ()
    edits: tuple[Edit, ...] = ()


class KoordError(Exception):
    """Raised where the input cannot be processed; carries every diagnostic."""

    def __init__(self, diagnostics: tuple[Diagnostic, ...]) -> None:
        super().__init__("; ".join(f"{d.span}: {d.code} {d.message}" for d in diagnostics))
        self.diagnostics = diagnostics

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle: an exception is otherwise rebuilt from its message only."""
        return type(self), (self.diagnostics,)


def refusal(code: str, place: Span | str, message: str, hint: str | None = None) -> KoordError:
    """Make the KoordError of one problem; ``place`` is a name if it is the input as a whole."""
    span = whole_file(place) if isinstance(place, str) else place
    return KoordError((Diagnostic(code, Severity.ERROR, span, message, hint),))
