"""Intervals with exceptions: sets of values that comparisons with constants define."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from math import ceil, floor

from msgspec import Struct

from koord.syntax.core import BinaryOp

Number = int | Fraction

#: A constant of the text, or of a run on doubles.
Value = int | Fraction | bool | str | float


class Bounds(Struct, frozen=True):
    """A set of values: from ``low`` to ``high``, inclusive; only ``only`` if given; without
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
