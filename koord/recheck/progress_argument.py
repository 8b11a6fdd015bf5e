"""Arguments of progress: measures, lock classes, what lasts, and ways to help. [T-PROGRESS]

They are what a certificate names; that they do what they are there for is shown elsewhere.
"""

from __future__ import annotations

from enum import Enum

from msgspec import Struct

from koord.syntax import core


class Phrase(Struct, frozen=True):
    """A statement, or a number, of a robot of a kind, of the one that is meant, of both or none.

    ``robot`` and ``meant`` are the slots of their numbers; None if it is about none.
    """

    said: core.Expr
    bound: int
    robot: int | None
    meant: int | None
    kind: int | None = None


class Measure(Struct, frozen=True):
    """A measure: a statement that may only become false, or a natural number that may only fall."""

    phrase: Phrase


class LockClass(Struct, frozen=True):
    """A lock class that the robot that is meant does not enter, once what is before it settled."""

    index: int


class HelpKind(Enum):
    """The kinds of help, by the fairness that it rests on."""

    ROBOT = "robot"  #: [FAIR-ROBOT]
    EXPECTED = "expected"  #: [FAIR-ASSUME]
    AFTER_RUN = "after a run"  #: both
    TIME = "time"


class Help(Struct, frozen=True):
    """A way to help: robots of which ``state`` holds. ``falls`` is a real number that time lowers.

    ``expected`` is the assumption about whole runs that it rests on. ``unmoved``: it lasts where
    nothing that it reads changes, of any robot.
    """

    kind: HelpKind
    state: Phrase
    expected: core.Property | None = None
    falls: Phrase | None = None
    unmoved: bool = False


class First(Struct, frozen=True):
    """Robots of whom one is the first, if there are any: by a number, and then by its own."""

    state: Phrase
    number: Phrase


class ProgressArgument(Struct, frozen=True):
    """A proof of a claim about whole runs, as a certificate has it."""

    stated: core.Property
    lasting: tuple[Phrase, ...]
    order: tuple[Measure | LockClass, ...]
    help: tuple[Help, ...]
    first: tuple[First, ...] = ()
