"""A text in the one layout: what ``koord fmt`` does."""

from __future__ import annotations

from msgspec import Struct

from koord.syntax.diagnostics import Diagnostic
from koord.syntax.parser import parse
from koord.syntax.printer import print_program
from koord.syntax.source import Source


class Formatted(Struct, frozen=True):
    """A text in the one layout; with errors of syntax it is the text as it was."""

    text: str
    diagnostics: tuple[Diagnostic, ...]


def format_source(source: Source) -> Formatted:
    """Lay a text out anew, unless it has errors of syntax."""
    parsed = parse(source)
    if parsed.diagnostics:
        return Formatted(source.text, parsed.diagnostics)
    return Formatted(print_program(parsed.program), ())
