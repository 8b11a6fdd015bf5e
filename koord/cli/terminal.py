"""Terminal output: widths, colours, and escaping of control characters."""

from __future__ import annotations

import os
import unicodedata
from collections.abc import Mapping
from enum import Enum
from typing import TextIO

from msgspec import Struct

from koord.syntax.source import visible as visible

#: The width of lines that go to no terminal, where nobody can say how wide it is.
WIDTH_OF_FILES = 100

#: Narrower terminals than this are written to as if they were this wide.
LEAST_WIDTH = 40


class Paint(Enum):
    """Styles of text, as the parameters of an SGR escape sequence."""

    BOLD = "1"
    ERROR = "1;31"
    WARNING = "1;33"
    NOTE = "1;36"
    GUTTER = "34"
    ADDED = "32"
    REMOVED = "31"


class Style(Struct, frozen=True):
    """The layout of output: its width in cells, and whether it is coloured."""

    width: int = WIDTH_OF_FILES
    colour: bool = False

    def paint(self, text: str, paint: Paint) -> str:
        return f"\x1b[{paint.value}m{text}\x1b[0m" if self.colour and text else text


#: The style of what goes to a file or a pipe.
PLAIN = Style()


def is_debugging() -> bool:
    """Return whether to show tracebacks, for developers of koord."""
    return os.environ.get("KOORD_DEBUG", "") not in ("", "0")


def style_of(stream: TextIO | None, environment: Mapping[str, str] | None = None) -> Style:
    """The style that fits a stream: colour only on a terminal, and never with ``NO_COLOR``."""
    environment = os.environ if environment is None else environment
    if not is_terminal(stream, environment):
        return PLAIN
    colour = not environment.get("NO_COLOR")
    return Style(max(LEAST_WIDTH, _columns(stream, environment)), colour)


def is_terminal(stream: TextIO | None, environment: Mapping[str, str] | None = None) -> bool:
    """Return whether a stream is a terminal that understands escape sequences."""
    environment = os.environ if environment is None else environment
    if stream is None or environment.get("TERM") == "dumb":
        return False
    try:
        return stream.isatty()
    except ValueError:  # closed
        return False


def cells(text: str) -> int:
    """The number of terminal cells that a visible text takes."""
    if text.isascii():
        return len(text)
    return sum(map(_cells_of_character, text))


def _cells_of_character(character: str) -> int:
    if unicodedata.category(character) in ("Mn", "Me"):
        return 0
    return 2 if unicodedata.east_asian_width(character) in ("W", "F") else 1


def _columns(stream: TextIO | None, environment: Mapping[str, str]) -> int:
    wanted = environment.get("COLUMNS", "")
    if wanted.isdecimal() and 0 < len(wanted) < 6:
        return int(wanted)
    try:
        return os.get_terminal_size(stream.fileno() if stream else 1).columns or 80
    except (OSError, ValueError):
        return 80
