"""Places of the protocol, which count from 0 in units of an encoding, and those of koord."""

from __future__ import annotations

from collections.abc import Sequence

from lsprotocol import types

from koord.api.editing import Edit, Source, Span


def width(text: str, encoding: types.PositionEncodingKind | str) -> int:
    """The length of a text in the units of an encoding."""
    if text.isascii():
        return len(text)
    match encoding:
        case types.PositionEncodingKind.Utf8:
            return len(text.encode("utf-8", "surrogatepass"))
        case types.PositionEncodingKind.Utf32:
            return len(text)
        case _:
            return len(text) + sum(ord(character) > 0xFFFF for character in text)


def characters(line: str, units: int, encoding: types.PositionEncodingKind | str) -> int:
    """How many characters of a line so many units are; all of them at most."""
    if line.isascii():
        return min(units, len(line))
    for number, character in enumerate(line):
        units -= width(character, encoding)
        if units < 0:
            return number
    return len(line)


class Places:
    """The places of one text, in an encoding."""

    def __init__(
        self,
        source: Source,
        encoding: types.PositionEncodingKind | str,
        uri: str = "",
        others: Sequence[tuple[Source, str]] = (),
    ) -> None:
        self.source = source
        self.encoding = encoding
        self.uri = uri
        self._others = others  #: files of the same program, and their addresses

    def of(self, file: str) -> Places | None:
        """The places of another file of the program; None if there is no such file."""
        if file == self.source.name:
            return self
        for source, uri in self._others:
            if source.name == file:
                return Places(source, self.encoding, uri)
        return None

    def location(self, span: Span) -> types.Location | None:
        """A place of any file of the program."""
        there = self.of(span.file)
        return None if there is None else types.Location(there.uri, there.range(span))

    def line_and_column(self, position: types.Position) -> tuple[int, int]:
        """The line and column of a position; the end of the line if it is behind that."""
        text = self.source.line_text(position.line + 1)
        return position.line + 1, characters(text, position.character, self.encoding) + 1

    def position(self, line: int, column: int) -> types.Position:
        """The position of a line and column; the whole file's is the beginning."""
        text = self.source.line_text(line)[: max(0, column - 1)]
        return types.Position(max(0, line - 1), width(text, self.encoding))

    def range(self, span: Span) -> types.Range:
        """The range of a span."""
        start = self.position(span.line, span.column)
        end = self.position(span.end_line, span.end_column)
        return types.Range(start, max(start, end, key=lambda at: (at.line, at.character)))

    def text_edit(self, edit: Edit) -> types.TextEdit:
        """An edit."""
        return types.TextEdit(self.range(edit.span), edit.text)

    @property
    def everything(self) -> types.Range:
        """The range of the whole text."""
        lines = self.source.text.split("\n")
        return types.Range(
            types.Position(0, 0), types.Position(len(lines) - 1, width(lines[-1], self.encoding))
        )
