"""Laying programs out anew."""

from __future__ import annotations

from koord.api.programs import Text, source_of
from koord.syntax.diagnostics import KoordError
from koord.syntax.printing.program import format_source


def format(text: Text) -> str:
    r"""The text of a program, laid out as ``koord fmt`` does; comments stay.

    Raises :class:`koord.KoordError` for errors of syntax.

    >>> koord.format(koord.Source("a.krd", "local:\n int x=0\n"))
    'local:\n    int x = 0\n'
    """
    formatted = format_source(source_of(text))
    if formatted.diagnostics:
        raise KoordError(formatted.diagnostics)
    return formatted.text
