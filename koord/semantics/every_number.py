"""Robots of which nobody knows how many there are. [T-EVERY-N]

A domain that stands for systems of every size cannot list the robots. What the rules ask of all
robots at once (a quantifier, a loop, the least element of an array) they then ask of a ``Crowd``;
everything else they ask of one robot at a time, as ever. Only ``koord.verify`` has crowds.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeAlias, TypeVar

from koord.syntax.core import BinaryOp
from koord.syntax.source import NOWHERE, Span

V = TypeVar("V")


class NotFiniteError(Exception):
    """A loop or quantifier has no bound that the domain knows: the caller must say *unknown*."""

    def __init__(self, span: Span, what: str) -> None:
        super().__init__(what if span == NOWHERE else f"{span}: {what}")
        self.span = span
        self.what = what


class Crowd(Protocol[V]):
    """All robots, seen from one of them."""

    @property
    def first(self) -> V:
        """The least ``pid``, 0."""
        ...

    @property
    def count(self) -> V:
        """``numAgents``."""
        ...

    def pid(self, robot: int) -> V:
        """The number of the robot that sits in a seat of :attr:`System.kinds`."""
        ...

    def is_of(self, index: V, kind: int) -> V:
        """Whether a number from 0 to ``count - 1`` is that of a robot of a kind."""
        ...

    def assume(self, fact: V) -> None:
        """Note something that holds of the functions of a run, whoever asks."""
        ...

    def every(self, low: V, high: V, body: Callable[[V], V]) -> V:
        """Whether a Boolean holds of every integer from ``low`` up to and excluding ``high``."""
        ...

    def extreme(self, op: BinaryOp, low: V, high: V, body: Callable[[V], V]) -> V:
        """The least or greatest value (``MIN``, ``MAX``) that a number takes on such a range."""
        ...

    def loop(self, m: Any, low: V, high: V, body: Callable[[Any, V], None], span: Span) -> None:
        """What a loop over such a range does to a ``Machine[V]``. [S-FOR]"""
        ...


Size: TypeAlias = "int | Crowd[V]"
