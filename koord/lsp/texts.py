"""Texts of open documents: the changes that editors send, made as the protocol says.

Lines end with a line feed, a carriage return, or both, and with nothing else: whoever also ends
them where Python does would make changes in other places than the editor.
"""

from __future__ import annotations

import re

from lsprotocol import types

from koord.lsp.places import characters

_LINE_END = re.compile(r"\r\n|\n|\r")


def changed(
    text: str,
    change: types.TextDocumentContentChangeEvent,
    encoding: types.PositionEncodingKind | str,
) -> str:
    """The text after a change; places behind its end, or behind that of a line, mean the end."""
    if isinstance(change, types.TextDocumentContentChangeWholeDocument):
        return change.text
    start = offset(text, change.range.start, encoding)
    end = max(start, offset(text, change.range.end, encoding))
    return text[:start] + change.text + text[end:]


def offset(text: str, position: types.Position, encoding: types.PositionEncodingKind | str) -> int:
    """The number of the character at a position."""
    start = 0
    for _ in range(position.line):
        found = _LINE_END.search(text, start)
        if found is None:
            return len(text)
        start = found.end()
    found = _LINE_END.search(text, start)
    line = text[start : len(text) if found is None else found.start()]
    return start + characters(line, position.character, encoding)
