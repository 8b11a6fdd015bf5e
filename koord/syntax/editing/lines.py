"""What of a line is code, and what is a string or a comment, while the line is being written."""

from __future__ import annotations

import re

_TEXT = re.compile(r'"(?:[^"\\]|\\.)*("?)|#|//')


def code_of(line: str) -> str:
    """A line without its comment, and with blanks for its strings; places stay.

    >>> code_of('x = "a # b" # c')
    'x =         '
    """
    made, end = [], 0
    for text in _TEXT.finditer(line):
        made.append(line[end : text.start()])
        if not text[0].startswith('"'):
            return "".join(made)
        made.append(" " * len(text[0]))
        end = text.end()
    return "".join(made) + line[end:]


def ends_in_text(line: str) -> bool:
    """Whether the end of a line's beginning is within a comment or a string."""
    last = None
    for last in _TEXT.finditer(line):
        if not last[0].startswith('"'):
            return True
    return last is not None and not last[1]
