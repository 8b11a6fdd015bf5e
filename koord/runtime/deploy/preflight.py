"""What is looked at before anything is armed, robot by robot. (P-PREFLIGHT)"""

from __future__ import annotations

from enum import Enum

from msgspec import Struct


class Finding(Enum):
    """What was found of one thing."""

    GOOD = "good"
    DOUBTFUL = "doubtful"  #: people have to know of it, and decide
    BAD = "bad"  #: nothing is armed with this
    PENDING = "pending"  #: not known yet


class Check(Struct, frozen=True):
    """One thing that was looked at."""

    name: str
    finding: Finding
    text: str
    cure: str = ""


def check(name: str, trouble: str | None, text: str) -> Check:
    """A check that is bad if there is some trouble, and else says what it found."""
    if trouble is None:
        return Check(name, Finding.GOOD, text)
    return Check(name, Finding.BAD, trouble)
