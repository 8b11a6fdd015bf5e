"""Robots without a bound on their number, for domains of systems of every size. [T-EVERY-N]

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
    """Raised where a loop or quantifier has no bound that the domain knows.

    The caller must answer *unknown*.
    """

    def __init__(self, span: Span, what: str) -> None:
        super().__init__(what if span == NOWHERE else f"{span}: {what}")
        self.span = span
        self.what = what


class Crowd(Protocol[V]):
    """All robots of a system of unknown size, seen from one of them."""

    @property
    def first(self) -> V:
        """The least ``pid``, 0."""
        ...

    @property
    def count(self) -> V:
        """``numAgents``."""
        ...

    def pid(self, robot: int) -> V:
        """The ``pid`` of the robot at a position of :attr:`System.kinds`."""
        ...

    def is_of(self, index: V, kind: int) -> V:
        """Return the condition that a ``pid``, below ``count``, is that of a robot of a kind."""
        ...

    def assume(self, fact: V) -> None:
        """Assume a fact about the uninterpreted functions of a run, for every later query."""
        ...

    def every(self, low: V, high: V, body: Callable[[V], V]) -> V:
        """Return the condition that a Boolean holds of every integer in ``[low, high)``."""
        ...

    def is_never(self, low: V, index: V, high: V, condition: V) -> bool:
        """Return whether a condition is seen not to hold if an index is in ``[low, high)``."""
        ...

    def extreme(self, op: BinaryOp, low: V, high: V, body: Callable[[V], V]) -> V:
        """The least or greatest value (``MIN``, ``MAX``) of a number on ``[low, high)``."""
        ...

    def loop(self, m: Any, low: V, high: V, body: Callable[[Any, V], None], span: Span) -> None:
        """Run a loop over integers ``[low, high)`` on a ``Machine[V]``, in place. [S-FOR]"""
        ...


Size: TypeAlias = "int | Crowd[V]"
