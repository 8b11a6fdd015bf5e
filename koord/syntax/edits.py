"""Edits of a text: made all together, so that each names its place in the text as it was."""

from __future__ import annotations

from collections.abc import Iterable

from koord.syntax.diagnostics import Edit
from koord.syntax.source import Source


def edited(source: Source, edits: Iterable[Edit]) -> str:
    """The text with its edits made; of two that overlap only the first is. [OLD-FORM]"""
    pieces: list[str] = []
    done = 0
    places = {(source.offset(e.span.line, e.span.column), _end(source, e), e.text) for e in edits}
    for start, end, text in sorted(places):
        if start >= done:
            pieces += (source.text[done:start], text)
            done = end
    return "".join([*pieces, source.text[done:]])


def _end(source: Source, edit: Edit) -> int:
    return source.offset(edit.span.end_line, edit.span.end_column)
