"""Sums over all robots: terms with axioms. [T-SUM]

A sum has as many parts as there are robots, so no formula says what it is. But it is known how it
changes if one part does, and what it is where all parts are a polynomial of their number.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from math import lcm
from typing import TypeAlias

from msgspec import Struct, field

from koord.semantics.domain import conjunction
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.types import FLOAT
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.instantiation import Book, Names

Part: TypeAlias = "Callable[[Term], Term]"

#: Parts are recognised as polynomials up to this degree.
MOST_DEGREE = 3


class Sum(Struct, frozen=True):
    """A term for a sum: ``total`` is the sum of ``part`` over integers in ``[low, high)``."""

    total: Term
    low: Term
    high: Term
    part: Part


class Sums(Struct):
    """The sums met so far. Axioms of each sum, and of each pair, go into the book."""

    book: Book
    _met: list[Sum] = field(default_factory=list)

    def of(self, low: Term, high: Term, part: Part) -> Term:
        """The term for a sum."""
        d = self.book.unknowns.terms
        total = d.fresh_like("sum", self.book.glimpse(part))
        if d.open:
            # What depends on blanks is not compared with anything.
            return total
        made = Sum(total, low, high, part)
        self._say_alone(made)
        for other in self._met:
            if d.key(other.low) == d.key(low) and d.key(other.high) == d.key(high):
                self._compare(other, made)
        self._met.append(made)
        return total

    # --- one sum --------------------------------------------------------------------------------

    def _say_alone(self, made: Sum) -> None:
        """Assert the value of a sum whose parts are all zero, or a polynomial of their number."""
        book = self.book
        zero = self._number(made, 0)
        nothing = book.every(made.low, made.high, lambda k: self._equal(made.part(k), zero))
        book.note(book.implied(nothing, self._equal(made.total, zero)))
        for polynomial in self._polynomials(made):
            self._say_polynomial(made, polynomial)

    def _say_polynomial(self, made: Sum, polynomial: tuple[Fraction, ...]) -> None:
        """Assert that the sum is at most a polynomial's if all parts are; equal only if all are."""
        d, book = self.book.unknowns.terms, self.book
        ahead = d.binary(BinaryOp.LE, made.low, made.high)

        def value(k: Term) -> Term:
            return self._at(made, polynomial, k)

        same = book.every(made.low, made.high, lambda k: self._equal(made.part(k), value(k)))
        below = book.every(
            made.low, made.high, lambda k: d.binary(BinaryOp.LE, made.part(k), value(k))
        )
        summed = _summed(polynomial)
        both = lcm(*(c.denominator for c in summed))
        top = d.binary(
            BinaryOp.SUB,
            self._at(made, tuple(c * both for c in summed), made.high),
            self._at(made, tuple(c * both for c in summed), made.low),
        )
        total = d.binary(BinaryOp.MUL, self._number(made, both), made.total)
        reached = self._equal(total, top)
        book.note(book.implied(conjunction(d, [ahead, same]), reached))
        book.note(book.implied(conjunction(d, [ahead, below]), d.binary(BinaryOp.LE, total, top)))
        book.note(book.implied(conjunction(d, [ahead, below, reached]), same))

    def _polynomials(self, made: Sum) -> list[tuple[Fraction, ...]]:
        """The polynomials of a part's number that occur in it, by their coefficients."""
        d = self.book.unknowns.terms
        found: list[tuple[Fraction, ...]] = []

        def look(blank: Term) -> Term:
            for piece in d.parts_like(made.part(blank)):
                values = [d.with_values(piece, [(blank, n)]) for n in range(MOST_DEGREE + 1)]
                known = [d.known(value) for value in values]
                if not all(
                    isinstance(v, int | Fraction) and not isinstance(v, bool) for v in known
                ):
                    continue
                polynomial = _through([Fraction(v) for v in known if v is not None])
                if d.is_integer(made.total) and any(c.denominator != 1 for c in polynomial):
                    continue
                at = self._at(made, polynomial, blank)
                if (
                    any(polynomial)
                    and polynomial not in found
                    and d.is_valid(self._equal(piece, at))
                ):
                    found.append(polynomial)
            return True

        self.book.glimpse(look)
        return found

    # --- two sums -------------------------------------------------------------------------------

    def _compare(self, one: Sum, two: Sum) -> None:
        """Assert that sums that differ in one part differ by its difference."""
        d, book = self.book.unknowns.terms, self.book

        def says(names: Names) -> Term:
            (index,) = names

            def alike(k: Term) -> Term:
                here = d.binary(BinaryOp.EQ, k, index)
                return d.binary(BinaryOp.OR, here, self._equal(one.part(k), two.part(k)))

            elsewhere = book.every(one.low, one.high, alike)
            inside = book.between(one.low, index, one.high)
            grown = d.binary(BinaryOp.SUB, two.total, one.total)
            change = d.binary(BinaryOp.SUB, two.part(index), one.part(index))
            return book.implied(conjunction(d, [inside, elsewhere]), self._equal(grown, change))

        book.state(1, says)

    # --- formulas -------------------------------------------------------------------------------

    def _equal(self, left: Term, right: Term) -> Term:
        return self.book.unknowns.terms.binary(BinaryOp.EQ, left, right)

    def _number(self, made: Sum, value: Fraction | int) -> Term:
        d = self.book.unknowns.terms
        return int(value) if d.is_integer(made.total) else d.const(value, FLOAT)

    def _at(self, made: Sum, polynomial: tuple[Fraction, ...], index: Term) -> Term:
        """Evaluate a polynomial with integer (or float) coefficients at an integer."""
        d = self.book.unknowns.terms
        whole = d.is_integer(made.total)
        if whole and any(c.denominator != 1 for c in polynomial):
            raise AssertionError("scaled by the caller")
        x = index if whole else d.unary(UnaryOp.WIDEN, index)
        power, value = self._number(made, 1), self._number(made, 0)
        for c in polynomial:
            if c:
                term = d.binary(BinaryOp.MUL, self._number(made, c), power)
                value = d.binary(BinaryOp.ADD, value, term)
            power = d.binary(BinaryOp.MUL, power, x)
        return value


# --- polynomials, by coefficients from the constant on ------------------------------------------


def _through(values: list[Fraction]) -> tuple[Fraction, ...]:
    """The polynomial through values at 0, 1, 2, … (Newton)."""
    total: tuple[Fraction, ...] = (Fraction(0),)
    differences = list(values)
    for k in range(len(values)):
        total = _plus(total, tuple(differences[0] * c for c in _choose(k)))
        differences = [b - a for a, b in pairwise(differences)]
    while len(total) > 1 and not total[-1]:
        total = total[:-1]
    return total


def _summed(polynomial: tuple[Fraction, ...]) -> tuple[Fraction, ...]:
    """The polynomial whose value at n is the sum of another's at 0 … n-1."""
    values = [Fraction(0)]
    for k in range(len(polynomial) + 1):
        at = sum((c * k**power for power, c in enumerate(polynomial)), Fraction(0))
        values.append(values[-1] + at)
    return _through(values)


def _choose(k: int) -> tuple[Fraction, ...]:
    """The polynomial x (x-1) … (x-k+1) / k!."""
    made: tuple[Fraction, ...] = (Fraction(1),)
    for root in range(k):
        shifted = (Fraction(0), *made)
        made = _plus(shifted, tuple(-root * c for c in made))
        made = tuple(c / (root + 1) for c in made)
    return made


def _plus(left: tuple[Fraction, ...], right: tuple[Fraction, ...]) -> tuple[Fraction, ...]:
    size = max(len(left), len(right))
    return tuple(
        (left[k] if k < len(left) else Fraction(0)) + (right[k] if k < len(right) else Fraction(0))
        for k in range(size)
    )
