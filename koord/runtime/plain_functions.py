"""The library's functions of numbers and texts, on Python's: every host answers them alike."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any


def text_of(value: Any) -> str:
    """The text of a number, a truth value or a position. [E-TEXT]"""
    match value:
        case bool():
            return "true" if value else "false"
        case tuple():
            return f"({', '.join(map(text_of, value))})"
        case _:
            return repr(value)


def _total(function: Callable[..., float]) -> Callable[..., float]:
    """The function, which is no number where Python's is undefined: of infinity."""

    def answer(*numbers: float) -> float:
        try:
            return function(*numbers)
        except ValueError:
            return math.nan

    return answer


#: Each by the name that programs call it by.
FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "sqrt": math.sqrt,
    "sin": _total(math.sin),
    "cos": _total(math.cos),
    "atan2": math.atan2,
    "joinedText": "{}{}".format,
    "textOf": text_of,
}
