"""The steps of the proof as data."""

from __future__ import annotations

from enum import Enum

from msgspec import Struct


class Answer(Enum):
    """What Z3 says of one step of the proof."""

    PROVED = "proved"
    REFUTED = "refuted"
    UNKNOWN = "unknown"


class Step(Struct, frozen=True):
    """A step of the proof: that an action keeps a statement; or, without one, that it follows.

    ``counterexample`` is a small structure in which it does not, a fact a line.
    """

    action: str
    rule: str
    statement: str
    answer: Answer
    seconds: float
    counterexample: tuple[str, ...] = ()
