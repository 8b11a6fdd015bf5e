"""Source texts, and spans in them, which all later phases refer to."""

from __future__ import annotations

import unicodedata
from bisect import bisect_right
from typing import ClassVar

from msgspec import Struct, field

from koord.syntax.content import ByContent


class Span(Struct, frozen=True):
    """A half-open range of characters in one file.

    Lines and columns count from 1, as editors show them. ``end_column`` is the column just behind
    the last character.
    """

    file: str
    line: int
    column: int
    end_line: int
    end_column: int

    def to(self, other: Span) -> Span:
        """The smallest span that covers this one and ``other``, which lies behind it."""
        return Span(self.file, self.line, self.column, other.end_line, other.end_column)

    def beginning(self, length: int) -> Span:
        """Its first characters, so many, which are in one line."""
        return Span(self.file, self.line, self.column, self.line, self.column + length)

    @property
    def end(self) -> Span:
        """The empty span just behind it."""
        return Span(self.file, self.end_line, self.end_column, self.end_line, self.end_column)

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


def whole_file(name: str) -> Span:
    """The span for an error of a file as a whole: line 0, which no text has."""
    return Span(name, 0, 0, 0, 0)


def is_whole_file(span: Span) -> bool:
    """Return whether a span is one of :func:`whole_file`."""
    return span.line == 0


#: The span of what the tool itself supplies (library declarations, generated code).
NOWHERE = Span("<koord>", 1, 1, 1, 1)


class Placed(ByContent, frozen=True, kw_only=True):
    """A struct with a place in the text, which equality ignores."""

    ASIDE: ClassVar[frozenset[str]] = frozenset({"span"})

    span: Span = NOWHERE


class Source(ByContent, frozen=True):
    r"""A named text. ``text`` has ``\n`` line ends only and no byte-order mark."""

    ASIDE: ClassVar[frozenset[str]] = frozenset({"_starts"})

    name: str
    text: str
    _starts: list[int] = field(default_factory=list)

    def line_text(self, line: int) -> str:
        """Line number ``line`` (from 1) without its line end; empty behind the last line."""
        lines = self._line_starts()
        if not 1 <= line <= len(lines):
            return ""
        start = lines[line - 1]
        end = lines[line] - 1 if line < len(lines) else len(self.text)
        return self.text[start:end]

    def place(self, offset: int) -> tuple[int, int]:
        """Line and column, both from 1, of a character offset."""
        lines = self._line_starts()
        line = bisect_right(lines, offset)
        return line, offset - lines[line - 1] + 1

    def offset(self, line: int, column: int) -> int:
        """The character offset of a place, as :meth:`place` counts; the end of the text at most."""
        lines = self._line_starts()
        start = lines[line - 1] if line <= len(lines) else len(self.text)
        return min(start + column - 1, len(self.text))

    def span(self, start: int, end: int) -> Span:
        """The span of the characters ``start`` up to and excluding ``end``."""
        line, column = self.place(start)
        end_line, end_column = self.place(end)
        return Span(self.name, line, column, end_line, end_column)

    def _line_starts(self) -> list[int]:
        if not self._starts:
            self._starts.append(0)
            position = self.text.find("\n")
            while position >= 0:
                self._starts.append(position + 1)
                position = self.text.find("\n", position + 1)
        return self._starts


def normalise(text: str) -> str:
    r"""Normalise a text: no byte-order mark, ``
    `` line ends.
    """
    return text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")


# --- what comes from outside, shown ---------------------------------------------------------------

#: What a tab is shown as.
_TAB = " " * 4

#: Control and format characters, surrogates, separators of lines and paragraphs.
_ACTING = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})


def counted(count: int, word: str) -> str:
    """A number of things in words: ``1 round``, ``2 rounds``."""
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def visible(text: str) -> str:
    """Escape text from outside, such as names of files, so that it cannot act on a terminal.

    Escapes, direction marks and line ends become one visible character each, a tab four blanks.
    """
    if text.isprintable():  # so no character acts
        return text
    return "".join(map(visible_character, text))


def visible_character(character: str) -> str:
    code = ord(character)
    if character == "\t":
        return _TAB
    if code < 0x20:
        return chr(0x2400 + code)  # ␛ and its like
    if code == 0x7F:
        return "\u2421"
    if unicodedata.category(character) in _ACTING:
        return "\ufffd"
    return character
