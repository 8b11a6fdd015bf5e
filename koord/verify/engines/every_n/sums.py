"""Sums over all robots: terms with axioms. [T-SUM]

A sum has as many parts as there are robots, so no formula says what it is. But it is known how it
changes if one part does, and what it is where all parts are a polynomial of their number.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import partial
from itertools import pairwise
from math import lcm
from typing import TypeAlias

from msgspec import Struct, field

from koord.semantics.domain import conjunction
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.types import FLOAT
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.instantiation import Book, Names, Scheme

Part: TypeAlias = "Callable[[Term], Term]"

#: Parts are recognised as polynomials up to this degree.
MOST_DEGREE = 3

#: Of more sums nothing is said.
_MOST_SUMS = 24


class Sum(Struct, frozen=True):
    """A term for a sum: ``total`` is the sum of ``part`` over integers in ``[low, high)``.

    It is the ``form`` of sums of that number, of these ``names``.
    """

    total: Term
    low: Term
    high: Term
    part: Part
    form: int
    names: Names = ()


class Form(Struct, frozen=True):
    """Sums of one form: ``total`` is a function of canonical blanks, one for each name.

    ``frame`` is what was worked out about a part, ``part``: its blanks are the names and the index.
    """

    number: int
    total: Term
    low: Term
    high: Term
    frame: Scheme
    part: Term
    known: set[tuple[object, ...]] = field(default_factory=set)


class Sums(Struct):
    """The sums met so far. Axioms of each sum, and of each pair, go into the book.

    A sum that is asked of any robot is a function of its number; what is said of it is said of the
    names that it is asked of first.
    """

    book: Book
    _met: list[Sum] = field(default_factory=list)
    _forms: dict[tuple[object, ...], Form] = field(default_factory=dict)
    _numbered: int = 0

    def of(self, low: Term, high: Term, part: Part) -> Term:
        """The term for a sum."""
        d = self.book.unknowns.terms
        if d.open:
            return self._of_blanks(low, high, part)
        value = self.book.glimpse(part)
        total = d.fresh_like("sum", value)
        self._numbered += 1
        names = tuple(n for n in self.book.names(0) if d.is_constant(n) and d.mentions(value, [n]))
        self._meet(Sum(total, low, high, part, self._numbered, names))
        return total

    def _meet(self, made: Sum) -> None:
        """Say what is known of a sum, and of it and others over the same range."""
        d = self.book.unknowns.terms
        self._say_alone(made)
        for other in self._met:
            if d.key(other.low) != d.key(made.low) or d.key(other.high) != d.key(made.high):
                continue
            if self._keys(other.names) == self._keys(made.names):
                if not made.names:
                    self._compare(other, made)
                self._order(other, made)
                self._order(made, other)
            if other.form == made.form or not made.names:
                self._add_up(other, made)
        self._met.append(made)

    def _keys(self, names: Names) -> tuple[object, ...]:
        return tuple(self.book.unknowns.terms.key(name) for name in names)

    # --- sums of any robot ----------------------------------------------------------------------

    def _of_blanks(self, low: Term, high: Term, part: Part) -> Term:
        """The term for a sum that depends on blanks: a function of those that it mentions."""
        d, book = self.book.unknowns.terms, self.book
        frame, value = book.worked_out(1, lambda names: part(names[0]))
        terms = [value, *frame.facts, *frame.brings_up, *(t for _, ts in frame.uses for t in ts)]
        used = tuple(b for b in frame.outer if any(d.mentions(term, [b]) for term in terms))
        if frame.inner or frame.calls or any(d.mentions(end, d.open) for end in (low, high)):
            # What is too deep is not compared with anything.
            return d.fresh_like("sum", value)
        blanks = book.canonical(1 + len(used))
        said = d.put(value, list(zip((*frame.own, *used), blanks, strict=True)))
        key = len(used), d.key(low), d.key(high), d.key(said)
        if key not in self._forms:
            with d.opened(blanks[1:]), d.depending_on(None):
                total = d.fresh_like("sum", value)
            self._numbered += 1
            kept = Scheme(used, frame.own, frame.facts, frame.brings_up, uses=frame.uses)
            self._forms[key] = Form(self._numbered, total, low, high, kept, value)
            book.keep(said)
        form = self._forms[key]
        if used:
            book.call(partial(self._arrive, form), used)
        else:
            self._arrive(form, (), 0)
        return d.put(form.total, list(zip(blanks[1:], used, strict=True)))

    def _arrive(self, form: Form, names: Names, born: int) -> None:
        """Say of names what is known of a sum."""
        key = self._keys(names)
        if born > 0 or key in form.known or len(self._met) >= _MOST_SUMS:
            return
        form.known.add(key)
        d, book = self.book.unknowns.terms, self.book

        def part(index: Term) -> Term:
            return book.say(form.frame, form.part, (*names, index))

        blanks = book.canonical(1 + len(names))[1:]
        total = d.put(form.total, list(zip(blanks, names, strict=True)))
        with book.about(0):
            self._meet(Sum(total, form.low, form.high, part, form.number, names))

    # --- one sum --------------------------------------------------------------------------------

    def _say_alone(self, made: Sum) -> None:
        """Assert the value of a sum whose parts are all zero, or a polynomial of their number."""
        book, d = self.book, self.book.unknowns.terms
        zero = self._number(made, 0)
        if not made.names:
            nothing = book.every(made.low, made.high, lambda k: self._equal(made.part(k), zero))
            book.note(book.implied(nothing, self._equal(made.total, zero)))
            for polynomial in self._polynomials(made):
                self._say_polynomial(made, polynomial)
        natural = book.every(
            made.low, made.high, lambda k: d.binary(BinaryOp.LE, zero, made.part(k))
        )
        if d.known(natural) is not False:
            book.state(1, lambda names: self._one_of(made, natural, names[0]))

    def _one_of(self, made: Sum, natural: Term, index: Term) -> Term:
        """A part is at most the sum, where none is negative."""
        d, book = self.book.unknowns.terms, self.book
        inside = book.between(made.low, index, made.high)
        least = d.binary(BinaryOp.LE, made.part(index), made.total)
        return book.implied(conjunction(d, [inside, natural]), least)

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
            part = made.part(blank)
            for piece in [*d.parts_like(part)] or [part]:
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

    def _order(self, one: Sum, two: Sum) -> None:
        """Assert that a sum is at most another, if each of its parts is."""
        d, book = self.book.unknowns.terms, self.book
        if d.key(one.total) == d.key(two.total):
            return
        below = book.every(
            one.low, one.high, lambda k: d.binary(BinaryOp.LE, one.part(k), two.part(k))
        )
        book.note(book.implied(below, d.binary(BinaryOp.LE, one.total, two.total)))

    def _add_up(self, one: Sum, two: Sum) -> None:
        """Assert that two sums are together at most that of a number, if their parts are."""
        d, book = self.book.unknowns.terms, self.book
        ahead = d.binary(BinaryOp.LE, one.low, one.high)
        most = [c[0] for made in (one, two) for c in self._polynomials(made) if len(c) == 1]
        for value in dict.fromkeys(most):
            least = self._number(one, value)

            def at_most(k: Term, least: Term = least) -> Term:
                parts = d.binary(BinaryOp.ADD, one.part(k), two.part(k))
                return d.binary(BinaryOp.LE, parts, least)

            below = book.every(one.low, one.high, at_most)
            both = d.binary(BinaryOp.ADD, one.total, two.total)
            times = d.binary(
                BinaryOp.SUB,
                self._at(one, (Fraction(0), value), one.high),
                self._at(one, (Fraction(0), value), one.low),
            )
            premise = conjunction(d, [ahead, below])
            book.note(book.implied(premise, d.binary(BinaryOp.LE, both, times)))

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
