"""What is wrong with a user's input, as values. The command line prints them; nothing else does."""

from __future__ import annotations

from enum import Enum

from msgspec import Struct

from koord.syntax.source import Span, whole_file


class Severity(Enum):
    """Whether a diagnostic stops the work."""

    ERROR = "error"
    WARNING = "warning"


class Note(Struct, frozen=True):
    """A second place that helps to understand a diagnostic ("first declared here")."""

    span: Span
    message: str


class Diagnostic(Struct, frozen=True):
    """One thing wrong at one place, with its cure where one is known.

    ``code`` is stable (``K204``) and has a long story in :mod:`koord.syntax.catalogue`.
    """

    code: str
    severity: Severity
    span: Span
    message: str
    hint: str | None = None
    notes: tuple[Note, ...] = ()


class KoordError(Exception):
    """The input cannot be worked with; carries every diagnostic that says why."""

    def __init__(self, diagnostics: tuple[Diagnostic, ...]) -> None:
        super().__init__("; ".join(f"{d.span}: {d.code} {d.message}" for d in diagnostics))
        self.diagnostics = diagnostics

    def __reduce__(self) -> tuple[object, ...]:
        """As it comes from another process: an exception is made of what it says otherwise."""
        return type(self), (self.diagnostics,)


def refusal(code: str, place: Span | str, message: str, hint: str | None = None) -> KoordError:
    """The one thing wrong with an input; ``place`` is its name if it is the input as a whole."""
    span = whole_file(place) if isinstance(place, str) else place
    return KoordError((Diagnostic(code, Severity.ERROR, span, message, hint),))
