"""The difference of two texts of one file, as lines for a terminal."""

from __future__ import annotations

from collections.abc import Iterator
from difflib import unified_diff

from koord.cli.terminal import Paint, Style

_NO_LINE_END = "\n\\ No newline at end of file"


def difference(name: str, old: str, new: str, what: str, style: Style) -> Iterator[str]:
    """The lines of a unified diff; ``what`` says behind the name what the new text is."""
    for line in unified_diff(_lines(old), _lines(new), name, f"{name} ({what})", lineterm=""):
        match line[:1]:
            case "+":
                yield style.paint(line, Paint.ADDED)
            case "-":
                yield style.paint(line, Paint.REMOVED)
            case _:
                yield line


def _lines(text: str) -> list[str]:
    lines = text.split("\n")
    if lines[-1] == "":
        lines.pop()
    else:
        lines[-1] += _NO_LINE_END
    return lines
