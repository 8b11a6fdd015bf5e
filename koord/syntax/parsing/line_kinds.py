"""The kinds of lines."""

from __future__ import annotations

from enum import Enum


class LineKind(Enum):
    """The kinds of lines and parts of lines: the start symbols of the grammar."""

    EXPRESSION = "expression"
    GOAL = "goal"
    DECLARATION = "declaration"
    SIGNATURE = "signature"
    MEMBERS = "members"
    STATEMENT = "statement"
    LOOP = "loop"
