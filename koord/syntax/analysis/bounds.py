"""Sets of values as comparisons with constants give them, and comparisons that contradict.

Each part of a conjunction that compares something with a constant narrows the values which that may
have. Where none is left, no configuration meets all parts. What is compared counts as one thing
wherever it is written alike; deeper contradictions are left to the verifier.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from math import ceil, floor

from msgspec import Struct

from koord.syntax import core
from koord.syntax.analysis.folding import constant
from koord.syntax.core import BinaryOp, QuantifierKind, UnaryOp
from koord.syntax.types import BOOL, INT
from koord.syntax.walk import nodes

Number = int | Fraction

#: A constant of the text, or of a run on doubles.
Value = int | Fraction | bool | str | float


class Bounds(Struct, frozen=True):
    """A set of values: an interval, perhaps restricted, with exceptions.

    The values from ``low`` to ``high``, inclusive; of those, the ``only`` ones if given, without
    ``never``.
    """

    low: Number | None = None
    high: Number | None = None
    only: frozenset[Value] | None = None
    never: frozenset[Value] = frozenset()

    @classmethod
    def compared(
        cls, op: BinaryOp, value: Value, *, turned: bool = False, whole: bool = False
    ) -> Bounds:
        """The set of x with ``x op value``, or ``value op x`` if ``turned``; ``whole``:
        integers.
        """
        if op is BinaryOp.EQ:
            return cls(only=frozenset({value}))
        if op is BinaryOp.NE:
            return cls(never=frozenset({value}))
        if op not in (BinaryOp.LT, BinaryOp.LE) or isinstance(value, str | float):
            return cls()
        left_out = frozenset({value}) if op is BinaryOp.LT and not whole else frozenset[Value]()
        if turned:
            low = floor(value) + 1 if whole and op is BinaryOp.LT else value
            return cls(low=low, never=left_out)
        high = ceil(value) - 1 if whole and op is BinaryOp.LT else value
        return cls(high=high, never=left_out)

    def meet(self, other: Bounds) -> Bounds:
        """The intersection of two sets."""
        only = self.only if other.only is None else other.only
        if self.only is not None and other.only is not None:
            only = self.only & other.only
        return Bounds(
            _choose(max, self.low, other.low),
            _choose(min, self.high, other.high),
            only,
            self.never | other.never,
        )

    def join(self, other: Bounds) -> Bounds:
        """A superset of the union of two sets."""
        if self.only is not None and other.only is not None:
            return Bounds(only=frozenset({*self.constants(), *other.constants()}))
        lows, highs = (self._low(), other._low()), (self._high(), other._high())
        return Bounds(
            None if None in lows else min(x for x in lows if x is not None),
            None if None in highs else max(x for x in highs if x is not None),
        )

    def constants(self) -> list[Value]:
        """The ``only`` values that lie in the range."""
        return [x for x in self.only or () if x not in self.never and self._has(x)]

    def is_empty(self) -> bool:
        """Return whether the set is surely empty."""
        if self.only is not None:
            return not self.constants()
        if self.low is None or self.high is None:
            return False
        return self.low > self.high or (self.low == self.high and self.low in self.never)

    def _has(self, x: Value) -> bool:
        if isinstance(x, str):
            return True
        return (self.low is None or self.low <= x) and (self.high is None or x <= self.high)

    def _low(self) -> Number | None:
        numbers = [x for x in self.only or () if not isinstance(x, str | float)]
        return min(numbers) if numbers else self.low

    def _high(self) -> Number | None:
        numbers = [x for x in self.only or () if not isinstance(x, str | float)]
        return max(numbers) if numbers else self.high


def _choose(
    better: Callable[[Number, Number], Number], a: Number | None, b: Number | None
) -> Number | None:
    if a is None or b is None:
        return b if a is None else a
    return better(a, b)


def contradicting(conditions: Iterable[core.Expr]) -> core.Expr | None:
    """The first conjunct that leaves a term no value; None if all may hold together."""
    left: dict[core.Expr, Bounds] = {}
    for condition in conditions:
        for part in _parts(condition):
            said = _compared(part)
            if said is None:
                continue
            what, bounds = said
            left[what] = left.get(what, Bounds()).meet(bounds)
            if left[what].is_empty():
                return part
    return None


def _parts(e: core.Expr) -> Iterator[core.Expr]:
    """Yield the conjuncts of a condition; a quantifier over robots counts as its body."""
    match e:
        case core.Binary(op=BinaryOp.AND):
            yield from _parts(e.left)
            yield from _parts(e.right)
        case core.Quantified(QuantifierKind.FORALL, domain=core.RobotRange()):
            yield from _parts(e.body)
        case _:
            yield e


def _compared(e: core.Expr) -> tuple[core.Expr, Bounds] | None:
    """The term that a condition compares with a constant, and the values that it allows."""
    match e:
        case core.Binary(op=BinaryOp.EQ | BinaryOp.NE | BinaryOp.LT | BinaryOp.LE as op):
            for what, other, turned in ((e.left, e.right, False), (e.right, e.left, True)):
                value = constant(other)
                if value is not None and constant(what) is None and _is_steady(what):
                    return what, Bounds.compared(op, value, turned=turned, whole=what.type == INT)
        case core.Unary(op=UnaryOp.NOT, operand=core.Read() as operand):
            return operand, Bounds(only=frozenset({False}))
        case core.Read() if e.type == BOOL:
            return e, Bounds(only=frozenset({True}))
        case _:
            pass
    return None


def _is_steady(e: core.Expr) -> bool:
    """Return whether an expression has the same value wherever it is written."""
    return not any(isinstance(node, core.Choose | core.ExternalCall) for node in nodes(e))
