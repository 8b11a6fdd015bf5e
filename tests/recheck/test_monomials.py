"""Products of unknowns as unknowns of their own."""

from __future__ import annotations

from koord.recheck.monomials import Monomials
from koord.recheck.terms import INT, Term, Terms
from koord.recheck.values import Values


def _values() -> Values:
    return Values(Terms(), None, frozenset())


def _unknowns(v: Values) -> tuple[Term, Term]:
    return v.symbol("n", INT), v.symbol("m", INT)


def test_a_polynomial_is_the_same_however_it_is_written() -> None:
    v = _values()
    t, (n, m) = v.t, _unknowns(v)
    linear = Monomials(v).linear
    one = t.integer(1)
    expanded = t.times(n, t.minus(n, one))
    assert linear(expanded) is linear(t.times(t.minus(n, one), n))
    assert linear(t.times(n, m)) is linear(t.times(m, n))
    assert linear(t.times(n, m)) is not linear(t.times(n, n))
    assert linear(t.times(t.plus(n, one), m)) is not linear(t.times(n, m))


def test_what_depends_on_a_quantifier_stays() -> None:
    v = _values()
    t, (n, _) = v.t, _unknowns(v)
    index = t.bound(0)
    said = t.for_all([index], t.equal(t.times(index, n), t.integer(0)))
    assert Monomials(v).linear(said) is said


def test_what_is_linear_stays() -> None:
    v = _values()
    t, (n, m) = v.t, _unknowns(v)
    said = t.less(t.plus(n, t.times(t.integer(2), m)), t.integer(7))
    assert Monomials(v).linear(said) is said
