"""Conditions that contradict each other, as far as ranges of values tell.

Each part of a conjunction that compares something with a constant narrows the values which that may
have. Where none is left, no configuration meets all parts. What is compared counts as one thing
wherever it is written alike; deeper contradictions are left to the verifier.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fractions import Fraction

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.analysis.folding import Scalar, constant
from koord.syntax.core import BinaryOp, QuantifierKind, UnaryOp
from koord.syntax.types import BOOL, INT
from koord.syntax.walk import nodes

Number = int | Fraction


class _Range(Struct, frozen=True):
    """The values that something may still have; a bound comes with whether it is left out."""

    low: tuple[Number, bool] | None = None
    high: tuple[Number, bool] | None = None
    only: Scalar | None = None
    never: frozenset[Scalar] = frozenset()

    def narrowed(self, op: BinaryOp, value: Scalar, turned: bool, whole: bool) -> _Range | None:
        """What is left if ``x op value``, or ``value op x``; None if nothing is."""
        found = self
        if op is BinaryOp.EQ:
            if self.only not in (None, value):
                return None
            found = replace(self, only=value)
        elif op is BinaryOp.NE:
            found = replace(self, never=self.never | {value})
        elif not isinstance(value, str):
            strict = op is BinaryOp.LT
            if whole and strict and Fraction(value).denominator == 1:
                value, strict = (value + 1, False) if turned else (value - 1, False)
            bound = (value, strict)
            if turned:
                found = replace(self, low=max(self.low or bound, bound))
            else:
                high = min(self.high or bound, bound, key=lambda b: (b[0], not b[1]))
                found = replace(self, high=high)
        return None if found._is_empty() else found

    def _is_empty(self) -> bool:
        if self.only is not None:
            return self.only in self.never or not self._has(self.only)
        if self.low is None or self.high is None:
            return False
        return self.low[0] >= self.high[0] and not (
            self._has(self.low[0]) and self.low[0] not in self.never
        )

    def _has(self, value: Scalar) -> bool:
        """Whether a value lies within the bounds."""
        if isinstance(value, str):
            return True
        above = self.low is None or (value, False) >= self.low
        return above and (self.high is None or value < self.high[0] or (value, False) == self.high)


def contradicting(conditions: Iterable[core.Expr]) -> core.Expr | None:
    """The first part of a conjunction that leaves no value to something; None if all may hold."""
    ranges: dict[core.Expr, _Range] = {}
    for condition in conditions:
        for part in _parts(condition):
            said = _compared(part)
            if said is None:
                continue
            what, op, value, turned = said
            left = ranges.get(what, _Range()).narrowed(op, value, turned, what.type == INT)
            if left is None:
                return part
            ranges[what] = left
    return None


def _parts(e: core.Expr) -> Iterator[core.Expr]:
    """What has to hold for a condition to hold. Of robots there is always one."""
    match e:
        case core.Binary(op=BinaryOp.AND):
            yield from _parts(e.left)
            yield from _parts(e.right)
        case core.Quantified(QuantifierKind.FORALL, domain=core.RobotRange()):
            yield from _parts(e.body)
        case _:
            yield e


def _compared(e: core.Expr) -> tuple[core.Expr, BinaryOp, Scalar, bool] | None:
    """What is compared with a constant, how, with which, and whether the constant comes first."""
    match e:
        case core.Binary(op=BinaryOp.EQ | BinaryOp.NE | BinaryOp.LT | BinaryOp.LE):
            left, right = constant(e.left), constant(e.right)
            if right is not None and left is None and _is_steady(e.left):
                return e.left, e.op, right, False
            if left is not None and right is None and _is_steady(e.right):
                return e.right, e.op, left, True
        case core.Unary(op=UnaryOp.NOT, operand=core.Read() as operand):
            return operand, BinaryOp.EQ, False, False
        case core.Read() if e.type == BOOL:
            return e, BinaryOp.EQ, True, False
        case _:
            pass
    return None


def _is_steady(e: core.Expr) -> bool:
    """Whether an expression has one value wherever it is written."""
    return not any(isinstance(node, core.Choose | core.ExternalCall) for node in nodes(e))
