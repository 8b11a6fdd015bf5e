"""Lazy evaluation that records the values it depends on.

A domain whose scalars are constants, or *places*: the scalar at a position of some variable, whose
value is looked at only when the evaluation has to know it. What it looked at, in order, decides
what it looks at next and how it ends; so outcomes are kept in a tree of decisions, and the next
evaluation that finds the same values there need not be made. Since the rules of the semantics never
look into a scalar (:mod:`domain`), the rules need not know of any of this.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Generic, NamedTuple, TypeVar

from koord.semantics.domain import EXACT, Constant
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.types import Type
from koord.verify.engines.explicit.cells import Codes

R = TypeVar("R")


class PlaceOf(NamedTuple):
    """A scalar by its place: the position in a variable; ``type`` is the scalar's."""

    variable: int
    position: int
    type: Type


Lazy = Constant | PlaceOf


class LazyDomain:
    """The number domain of lazy evaluation. ``look`` gives the value at a place, once each."""

    def __init__(self, look: Callable[[PlaceOf], Constant]) -> None:
        self._look = look
        self._seen: dict[PlaceOf, Constant] = {}

    @property
    def seen(self) -> Sequence[PlaceOf]:
        """The places whose values were read, in order."""
        return tuple(self._seen)

    def const(self, value: Constant, type_: Type) -> Lazy:
        return EXACT.const(value, type_)

    def known(self, value: Lazy) -> Constant:
        if not isinstance(value, PlaceOf):
            return value
        if value not in self._seen:
            self._seen[value] = self._look(value)
        return self._seen[value]

    def unary(self, op: UnaryOp, operand: Lazy) -> Lazy:
        return EXACT.unary(op, self.known(operand))

    def binary(self, op: BinaryOp, left: Lazy, right: Lazy) -> Lazy:
        # Where one side decides, the other is not looked at.
        if op is BinaryOp.AND and (left is False or right is False):
            return False
        if op is BinaryOp.OR and (left is True or right is True):
            return True
        return EXACT.binary(op, self.known(left), self.known(right))

    def ite(self, condition: Lazy, then: Lazy, other: Lazy) -> Lazy:
        return then if self.known(condition) else other


class _Fork(Generic[R]):
    """A decision on the value at a place, with a subtree for each value."""

    __slots__ = ("branches", "position", "variable")

    def __init__(self, place: PlaceOf) -> None:
        self.variable, self.position = place.variable, place.position
        self.branches: dict[int, _Fork[R] | _Leaf[R]] = {}


class _Leaf(Generic[R]):
    """The outcome at the end of a path of decisions."""

    __slots__ = ("outcome",)

    def __init__(self, outcome: R) -> None:
        self.outcome = outcome


class Decisions(Generic[R]):
    """A decision tree of an evaluation's outcomes, by the values that it read.

    ``root`` tells apart what is not read: forms of variables, and anything else with a number.
    """

    def __init__(self) -> None:
        self._roots: dict[Hashable, _Fork[R] | _Leaf[R]] = {}
        self.size = 0

    def find(self, root: Hashable, codes: Sequence[Codes]) -> R | None:
        """The outcome for variables with those codes, if it is known."""
        node = self._roots.get(root)
        while type(node) is _Fork:
            node = node.branches.get(codes[node.variable][node.position])
        return node.outcome if node is not None else None  # type: ignore[union-attr]

    def keep(
        self, root: Hashable, codes: Sequence[Codes], seen: Sequence[PlaceOf], outcome: R
    ) -> None:
        """Record an outcome, and the values that were read for it."""
        leaf: _Leaf[R] = _Leaf(outcome)
        self.size += 1
        if not seen:
            self._roots[root] = leaf
            return
        first = self._roots.get(root)
        if first is None:
            first = self._roots[root] = _Fork(seen[0])
        node = first
        for place, following in zip(seen, [*seen[1:], None], strict=True):
            assert isinstance(node, _Fork)
            assert (node.variable, node.position) == place[:2]
            code = codes[place.variable][place.position]
            if following is None:
                node.branches[code] = leaf
            else:
                node = node.branches.setdefault(code, _Fork(following))
