"""Reports: what a deployed robot tells of its run, to be judged. [RECORDING]"""

from __future__ import annotations

from hashlib import blake2b
from typing import TypeAlias

from msgspec import Struct

from koord.runtime.encoding import encode
from koord.runtime.proposals import Decision, EventFault
from koord.semantics.configurations import Robot, Written
from koord.semantics.domain import Constant
from koord.semantics.recordings import Answer, Reading, Start
from koord.syntax.diagnostics import Diagnostic

#: The length of the digest of a decision.
DIGEST_BYTES = 16


class Began(Struct, frozen=True):
    """Report: the start of an arbitrary variable."""

    start: Start


class Undeclared(Struct, frozen=True):
    """Report: the start of a shared variable is a fault. [INIT]"""


class TurnAnswers(Struct, frozen=True):
    """Report: an answer in a round's turn; INIT's round is -1."""

    round: int
    answer: Answer


class Sensed(Struct, frozen=True):
    """Report: a sensor's reading at the end of a round."""

    round: int
    reading: Reading


class Stood(Struct, frozen=True):
    """Report: the robot's state when a round began."""

    round: int
    robot: Robot[Constant]


class Stumbled(Struct, frozen=True):
    """Report: the robot's environment model faulted at the end of a round."""

    round: int
    fault: EventFault


class Acted(Struct, frozen=True):
    """Report: a decision that the robot acted on, as :func:`shortened`."""

    decision: Decision


class Kept(Struct, frozen=True):
    """Report: the robot was admitted in a round, with its output."""

    round: int
    written: tuple[Written[Constant], ...]


class Coordinated(Struct, frozen=True):
    """Report: the robot decided a round as coordinator, at a time of this machine's clock."""

    round: int
    at_s: float


class GaveUp(Struct, frozen=True):
    """Report: the robot's host found no values that the program allows, or too large ones."""

    why: tuple[Diagnostic, ...]  #: nothing, if values became too large


class Left(Struct, frozen=True):
    """Report: the robot stopped in good order before a round, and tells nothing more."""

    round: int


class Missed(Struct, frozen=True):
    """Report: so many reports before this one could not be written."""

    reports: int


Told: TypeAlias = (
    Began
    | Undeclared
    | TurnAnswers
    | Sensed
    | Stood
    | Stumbled
    | Acted
    | Kept
    | Coordinated
    | GaveUp
    | Left
    | Missed
)


def round_of(told: Told) -> int | None:
    """The round that a report is about; None if it is about none."""
    if isinstance(told, Acted):
        return told.decision.round
    if isinstance(told, Began | Undeclared | GaveUp | Missed):
        return None
    return told.round


def shortened(decision: Decision) -> Decision:
    """A decision without its writes, which its digest stands for: that of all that was decided."""
    digest = blake2b(encode(decision), digest_size=DIGEST_BYTES).digest()
    return Decision(decision.round, decision.ran, decision.skipped, (), digest, decision.fault)
