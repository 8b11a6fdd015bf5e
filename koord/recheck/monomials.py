"""Products of unknowns as unknowns: what follows then follows of products too. [T-EVERY-N]

A polynomial is the sum of its monomials, each an unknown of its own: a question becomes linear, and
``n * (n - 1)`` and ``n * n - n`` are the same. Products make such a question true as well, so a
question that cannot be satisfied could not be satisfied before.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

from msgspec import Struct, field

from koord.recheck.terms import INT, Term
from koord.recheck.values import Values

#: A polynomial: coefficients by the ids of the factors, with repetitions, in order.
Polynomial = dict[tuple[int, ...], Fraction]

#: A product that has more monomials is left as it is.
_MOST = 64


class Monomials(Struct):
    """Unknowns for the products of unknowns in closed statements."""

    v: Values
    _unknowns: dict[tuple[int, ...], Term] = field(default_factory=dict)
    _factors: dict[int, Term] = field(default_factory=dict)
    _known: dict[int, Term] = field(default_factory=dict)

    def linear(self, term: Term) -> Term:
        """The statement with an unknown for each product of unknowns."""
        return self.v.t.rebuilt(term, self._known, self._instead)

    def _instead(self, node: Term) -> Term | None:
        # What depends on the variable of a quantifier is no single unknown.
        if node.head != "*" or self.v.t.free(node):
            return None
        polynomial = self._polynomial(node)
        return None if len(polynomial) > _MOST else self._sum(polynomial, node.sort)

    def _polynomial(self, term: Term) -> Polynomial:
        match term.head, term.args:
            case _ if term.value is not None:
                return {(): Fraction(term.value)} if term.value else {}
            case "+", args:
                return _total([self._polynomial(a) for a in args])
            case "-", [a]:
                return _product({(): Fraction(-1)}, self._polynomial(a))
            case "-", [a, b]:
                negated = _product({(): Fraction(-1)}, self._polynomial(b))
                return _total([self._polynomial(a), negated])
            case "*", [a, b]:
                return _product(self._polynomial(a), self._polynomial(b))
            case _:
                factor = self.linear(term)
                self._factors[id(factor)] = factor
                return {(id(factor),): Fraction(1)}

    def _sum(self, polynomial: Polynomial, sort: str) -> Term:
        t = self.v.t
        total = self._number(Fraction(0), sort)
        for factors, coefficient in polynomial.items():
            scale = self._number(coefficient, sort)
            part = t.times(scale, self._unknown(factors, sort)) if factors else scale
            total = t.plus(total, part)
        return total

    def _unknown(self, factors: tuple[int, ...], sort: str) -> Term:
        """The unknown that stands for a product of factors."""
        if len(factors) == 1:
            return self._factors[factors[0]]
        if factors not in self._unknowns:
            self._unknowns[factors] = self.v.symbol("a product", sort)
        return self._unknowns[factors]

    def _number(self, value: Fraction, sort: str) -> Term:
        return self.v.t.integer(int(value)) if sort == INT else self.v.t.real(value)


def _total(parts: Sequence[Polynomial]) -> Polynomial:
    made: Polynomial = {}
    for part in parts:
        for factors, coefficient in part.items():
            made[factors] = made.get(factors, Fraction(0)) + coefficient
    return {factors: c for factors, c in made.items() if c}


def _product(one: Polynomial, other: Polynomial) -> Polynomial:
    return _total(
        [{tuple(sorted((*a, *b))): x * y for b, y in other.items()} for a, x in one.items()]
    )
