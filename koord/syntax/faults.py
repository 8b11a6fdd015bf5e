"""Kinds of faults: errors of a program at run time. [FAULT]

The rules say when it does, and compiled programs find it out by themselves. Robots load this, so it
imports nothing.
"""

from __future__ import annotations

from enum import Enum


class FaultKind(Enum):
    """The kinds of faults, in the words of messages and traces."""

    INDEX = "index out of range"
    DIVISION = "division by zero"
    UNSET = "read of an unset value"
    KEY = "missing map key"
    EMPTY = "empty list"
    PRECONDITION = "precondition not met"
    CHOICE = "empty range to choose from"
