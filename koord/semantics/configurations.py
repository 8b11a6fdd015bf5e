"""Configurations: the states of a system of robots. [CONFIG]

A configuration is immutable. ``M`` of the paper is ``locals`` and ``copy`` together: a robot's own
variables and its copy of every shared one; ``cp`` is ``ports``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from typing import Generic, TypeVar

from msgspec import Struct

from koord.semantics.storage import Storage
from koord.semantics.values import Value
from koord.syntax.faults import FaultKind
from koord.syntax.source import Span
from koord.syntax.types import Type

V = TypeVar("V")


class Turn(Enum):
    """Whose turn it is in a configuration: the program's or the environment's."""

    PROG = "prog"
    ENV = "env"


class Fault(Struct, frozen=True):
    """A fault, the robot that met it, and the place in the text."""

    kind: FaultKind
    robot: int | None
    span: Span
    detail: str = ""


class Written(Struct, Generic[V], frozen=True):
    """The values that one statement wrote to a stream: a label of a step. [OUTPUT]
    It is part of no configuration.

    ``types`` are those of the values, without which nobody could print them.
    """

    stream: str
    values: tuple[Value[V], ...]
    types: tuple[Type, ...]


class Store(Struct, Generic[V], frozen=True):
    """The shared store, by slot. An allread variable is a tree with one part per robot."""

    allread: tuple[Storage[V], ...]
    allwrite: tuple[Storage[V], ...]


#: ``Robot.ran`` of a robot that ran no event in its last program turn.
NO_EVENT = -1


class Robot(Struct, Generic[V], frozen=True):
    """The state of one robot: ``L = (M, cp, turn)``.

    ``kind`` is the position of its agent in the program; ``ran`` the position of the event of its
    last program turn, or ``NO_EVENT``.
    """

    kind: int
    locals: tuple[Storage[V], ...]
    ports: tuple[Storage[V], ...]
    copy: Store[V]
    status: V
    ran: V
    turn: Turn = Turn.PROG


class Configuration(Struct, Generic[V], frozen=True):
    """A system configuration ``c = ({L_i}, S, τ, turn)``; ``τ`` is ``round · δ``, in seconds.

    ``taken`` are the lock classes that a robot entered in this round. A configuration with a
    ``fault`` has no successors. Of a crowd no robot is listed: ``at`` says which robots a number
    may be that of, each with the condition that it is.
    """

    robots: tuple[Robot[V], ...]
    store: Store[V]
    round: int
    turn: Turn = Turn.PROG
    taken: frozenset[int] = frozenset()
    fault: Fault | None = None
    at: Callable[[V], Sequence[tuple[V, Robot[V]]]] | None = None
