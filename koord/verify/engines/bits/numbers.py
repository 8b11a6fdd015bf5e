"""Integers and rationals as vectors of literals, exactly: the width grows with the range.

A number is in two's complement, least significant literal first, with the least and the greatest
value that it may have. Where ``loose`` holds it is any number at all, and the vector says nothing:
so numbers that have infinitely many values are kept soundly, if not exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from math import lcm
from typing import NamedTuple

from koord.verify.engines.bits.graph import FALSE, TRUE, Graph

#: A number of more literals is not worth its while: it becomes loose.
WIDEST = 48

#: Functions of numbers with at most so many values are written down value by value.
TABLE = 256


class Number(NamedTuple):
    """A number that is not constant. ``scale`` is 0 for an integer, else the divisor.

    ``low`` and ``high`` are those of the vector, before it is divided.
    """

    literals: tuple[int, ...]
    low: int
    high: int
    scale: int = 0
    loose: int = FALSE


Constant = int | Fraction


def width(low: int, high: int) -> int:
    """The number of literals that hold all values of a range, the sign included."""
    return max(high.bit_length(), (~low).bit_length() if low < 0 else 0) + 1


def is_kept(low: int, high: int) -> bool:
    """Return whether a range is narrow enough to be represented exactly."""
    return width(low, high) <= WIDEST


def anything(scale: int) -> Number:
    """A number of which nothing is known."""
    return Number((FALSE,), 0, 0, scale, TRUE)


def lifted(value: Constant | Number) -> Number:
    """A number, constant or not, as a vector."""
    if isinstance(value, Number):
        return value
    if isinstance(value, Fraction):
        return _constant(value.numerator, value.denominator)
    return _constant(int(value), 0)


def _constant(value: int, scale: int) -> Number:
    literals = tuple((value >> k) & 1 for k in range(width(value, value)))
    return Number(literals, value, value, scale)


def settled(number: Number) -> Number | Constant:
    """The number, as a Python number if it is constant."""
    if number.loose == FALSE and number.low == number.high:
        return Fraction(number.low, number.scale) if number.scale else number.low
    return number


def fitted(literals: tuple[int, ...], low: int, high: int, scale: int, loose: int) -> Number:
    """A number of these literals, cut to the width of its range; loose where that is too wide.

    What is any number is none that was there before: whoever keeps it has to give it a mark.
    """
    if not is_kept(low, high):
        return anything(scale)
    return exactly(literals, low, high, scale, loose)


def exactly(literals: tuple[int, ...], low: int, high: int, scale: int, loose: int) -> Number:
    """A number of these literals, however wide its range is."""
    size = width(low, high)
    cut = literals[:size] if len(literals) >= size else extended(literals, size)
    if low >= 0:
        cut = (*cut[:-1], FALSE)
    elif high < 0:
        cut = (*cut[:-1], TRUE)
    return Number(cut, low, high, scale, loose)


def extended(literals: tuple[int, ...], size: int) -> tuple[int, ...]:
    """The same vector with more copies of its sign."""
    return literals + (literals[-1],) * (size - len(literals))


def aligned(g: Graph, a: Number, b: Number) -> tuple[Number, Number]:
    """Bring both numbers to one scale."""
    if a.scale == b.scale or (a.scale <= 1 and b.scale <= 1):
        return a, b
    scale = lcm(a.scale or 1, b.scale or 1)
    return rescaled(g, a, scale), rescaled(g, b, scale)


def rescaled(g: Graph, a: Number, scale: int) -> Number:
    """The same number with a multiple of its scale, exactly, as comparisons require."""
    factor = scale // (a.scale or 1)
    if factor == 1:
        return a._replace(scale=scale)
    return _product(g, a, _constant(factor, 0))._replace(scale=scale)


# --- arithmetic -----------------------------------------------------------------------------------


def added(g: Graph, a: Number, b: Number) -> Number:
    a, b = aligned(g, a, b)
    low, high = a.low + b.low, a.high + b.high
    size = width(low, high)
    if size > WIDEST:
        return anything(a.scale)
    literals = _sum(g, extended(a.literals, size), extended(b.literals, size), FALSE)
    return fitted(literals, low, high, a.scale, g.either(a.loose, b.loose))


def negated(g: Graph, a: Number) -> Number:
    low, high = -a.high, -a.low
    size = max(width(low, high), len(a.literals))
    flipped = tuple(x ^ 1 for x in extended(a.literals, size))
    literals = _sum(g, flipped, (FALSE,) * size, TRUE)
    return fitted(literals, low, high, a.scale, a.loose)


def _sum(g: Graph, a: tuple[int, ...], b: tuple[int, ...], carry: int) -> tuple[int, ...]:
    """The sum of vectors of one width, modulo two to that width."""
    found = []
    for x, y in zip(a, b, strict=False):
        half = g.differ(x, y)
        found.append(g.differ(half, carry))
        carry = g.either(g.both(x, y), g.both(half, carry))
    return tuple(found)


def multiplied(g: Graph, a: Number, b: Number) -> Number:
    if not is_kept(*_corners(a, b)):
        return anything(_scale_of_product(a, b))
    return _product(g, a, b)


def _corners(a: Number, b: Number) -> tuple[int, int]:
    """The least and the greatest product of two ranges."""
    corners = [x * y for x in (a.low, a.high) for y in (b.low, b.high)]
    return min(corners), max(corners)


def _scale_of_product(a: Number, b: Number) -> int:
    """The scale of a product: 0 for integers, else the product of the scales."""
    return a.scale * b.scale if a.scale and b.scale else a.scale or b.scale


def _product(g: Graph, a: Number, b: Number) -> Number:
    """The product, however wide its range is."""
    low, high = _corners(a, b)
    scale, size = _scale_of_product(a, b), width(low, high)
    loose = g.either(a.loose, b.loose)
    if len(b.literals) > len(a.literals):
        a, b = b, a
    left = extended(a.literals, size) if len(a.literals) < size else a.literals[:size]
    total: tuple[int, ...] = (FALSE,) * size
    for k, bit in enumerate(b.literals):
        if k >= size or bit == FALSE:
            continue
        shifted = (FALSE,) * k + left[: size - k]
        part = tuple(g.both(bit, x) for x in shifted)
        if k + 1 == len(b.literals):  # the sign has negative weight
            total = _sum(g, total, tuple(x ^ 1 for x in part), TRUE)
        else:
            total = _sum(g, total, part, FALSE)
    return exactly(total, low, high, scale, loose)


def divided(g: Graph, a: Number, b: Number, made: Callable[[int, int], int]) -> Number:
    """An operation on integers that is zero for a zero divisor, tabulated value by value."""
    loose = g.either(a.loose, b.loose)
    if b.high - b.low >= TABLE or a.high - a.low >= TABLE * 4:
        return anything(0)
    result: Number = _constant(0, 0)
    for divisor in range(b.low, b.high + 1):
        if divisor:
            here = equal(g, b, _constant(divisor, 0))
            if here != FALSE:
                by = _tabulated(g, a, lambda x, d=divisor: made(x, d))  # type: ignore[misc]
                result = chosen(g, here, by, result)
    return result._replace(loose=g.either(loose, result.loose))


def _tabulated(g: Graph, a: Number, function: Callable[[int], int]) -> Number:
    """Tabulate a function of an integer, by halves of its range."""

    def between(low: int, high: int) -> Number:
        if low == high:
            return _constant(function(low), 0)
        middle = (low + high) // 2
        below, above = between(low, middle), between(middle + 1, high)
        if below == above:
            return below
        return chosen(g, at_most(g, a, _constant(middle, 0)), below, above)

    return between(a.low, a.high)


# --- comparison and choice ------------------------------------------------------------------------


def equal(g: Graph, a: Number, b: Number) -> int:
    """The literal that two vectors are equal numbers."""
    a, b = aligned(g, a, b)
    if a.high < b.low or b.high < a.low:
        return FALSE
    if a.low == a.high:
        a, b = b, a
    size = max(len(a.literals), len(b.literals))
    if b.low == b.high and a.high - a.low < TABLE:
        return _is(g, extended(a.literals, size), (a.low, a.high), b.low)
    pairs = zip(extended(a.literals, size), extended(b.literals, size), strict=True)
    return g.all_of(g.differ(x, y) ^ 1 for x, y in pairs)


def _is(g: Graph, literals: tuple[int, ...], within: tuple[int, int], value: int) -> int:
    """The literal that a vector has a value: as few of its bits as tell it from all others.

    Of a number from -1 on the sign says whether it is -1. Invariants speak of fewer bits then.
    """
    low, high = within
    others = [value ^ x for x in range(low, high + 1) if x != value]  # the bits that differ
    kept = (1 << len(literals)) - 1
    for k in range(len(literals)):  # the sign comes last, and is kept if it tells them apart
        fewer = kept & ~(1 << k)
        if all(x & fewer for x in others):
            kept = fewer
    return g.all_of(x ^ ((value >> k) & 1) ^ 1 for k, x in enumerate(literals) if (kept >> k) & 1)


def at_most(g: Graph, a: Number, b: Number) -> int:
    """The literal that the vector ``a`` is at most ``b``."""
    a, b = aligned(g, a, b)
    if a.high <= b.low:
        return TRUE
    if a.low > b.high:
        return FALSE
    size = max(len(a.literals), len(b.literals))
    left, right = extended(a.literals, size), extended(b.literals, size)
    holds = TRUE
    for x, y in zip(left[:-1], right[:-1], strict=True):
        holds = g.choose(g.differ(x, y), y, holds)
    # Of the signs the set one is the smaller number.
    return g.choose(g.differ(left[-1], right[-1]), left[-1], holds)


def chosen(g: Graph, condition: int, then: Number, other: Number) -> Number:
    """If-then-else of two numbers."""
    then, other = aligned(g, then, other)
    low, high = min(then.low, other.low), max(then.high, other.high)
    if then.loose == TRUE:
        low, high = other.low, other.high
    elif other.loose == TRUE:
        low, high = then.low, then.high
    size = width(low, high)
    a, b = _sized(then.literals, size), _sized(other.literals, size)
    literals = tuple(g.choose(condition, x, y) for x, y in zip(a, b, strict=True))
    loose = g.choose(condition, then.loose, other.loose)
    return fitted(literals, low, high, max(then.scale, other.scale), loose)


def _sized(literals: tuple[int, ...], size: int) -> tuple[int, ...]:
    return literals[:size] if len(literals) > size else extended(literals, size)


def resized(number: Number, size: int) -> tuple[int, ...]:
    """The literals of a number, extended or cut to a width."""
    return _sized(number.literals, size)
