"""Z3 terms as scalars: constants stay Python's own, and what is simplified stays the same.

That terms compute what the exact domain does is in tests/agreement. [DOMAIN]
"""

from __future__ import annotations

from fractions import Fraction
from itertools import product

import pytest
import z3

from koord.semantics.domain import Constant, binary_of_numbers, unary_of_numbers
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.types import BOOL, FLOAT, INT, STRING, OpaqueType
from koord.verify.encoding import terms
from koord.verify.encoding.terms import Term, Terms

CONNECTIVES = (BinaryOp.AND, BinaryOp.OR, BinaryOp.IMPLIES, BinaryOp.EQ, BinaryOp.NE)


def same(left: Term, right: Term, d: Terms) -> bool:
    solver = z3.Solver(ctx=d.context)
    solver.add(d.boolean(left) != d.boolean(right))
    return bool(solver.check() == z3.unsat)


def test_constants_never_become_terms() -> None:
    d = Terms()
    for left, right in product((-7, 0, 3), repeat=2):
        for op in (BinaryOp.ADD, BinaryOp.DIV, BinaryOp.MOD, BinaryOp.LE, BinaryOp.MIN):
            found = d.binary(op, left, right)
            assert not isinstance(found, z3.ExprRef)
            assert found == binary_of_numbers(op, left, right)
    assert d.unary(UnaryOp.WIDEN, 3) == Fraction(3)
    assert d.known(3) == 3
    assert d.known(d.fresh("x", INT)) is None
    assert d.ite(True, 1, 2) == 1
    assert d.ite(d.fresh("c", BOOL), 5, 5) == 5


@pytest.mark.parametrize("op", CONNECTIVES)
def test_connectives_with_constants_vanish_and_mean_the_same(op: BinaryOp) -> None:
    d = Terms()
    b = d.fresh("b", BOOL)
    for constant in (True, False):
        for left, right in ((b, constant), (constant, b)):
            found = d.binary(op, left, right)
            plain = {
                BinaryOp.AND: z3.And,
                BinaryOp.OR: z3.Or,
                BinaryOp.IMPLIES: z3.Implies,
                BinaryOp.EQ: lambda x, y: x == y,
                BinaryOp.NE: lambda x, y: x != y,
            }[op]
            meant = plain(d.boolean(left), d.boolean(right))
            assert same(found, meant, d), (op, left, right)


def test_choices_with_constants_mean_the_same() -> None:
    d = Terms()
    c, b = d.fresh("c", BOOL), d.fresh("b", BOOL)
    for then, other in product((True, False, b), repeat=2):
        meant = z3.If(c, d.boolean(then), d.boolean(other))
        assert same(d.ite(c, then, other), meant, d), (then, other)


NUMBERS = (-7, -2, -1, 0, 1, 2, 7)


@pytest.mark.parametrize("op", [BinaryOp.DIV, BinaryOp.MOD])
@pytest.mark.parametrize("known", ["left", "right", "neither"])
def test_division_rounds_down_for_every_sign(op: BinaryOp, known: str) -> None:
    """[E-ARITH]: whichever side is a constant; zero for a zero divisor."""
    d = Terms()
    for left, right in product(NUMBERS, repeat=2):
        x, y = d.fresh("x", INT), d.fresh("y", INT)
        a: Term = left if known == "left" else x
        b: Term = right if known == "right" else y
        found = d.binary(op, a, b)
        assert isinstance(found, z3.ExprRef)
        solver = z3.Solver(ctx=d.context)
        solver.add(x == left, y == right, found != binary_of_numbers(op, left, right))
        assert solver.check() == z3.unsat, (left, right)


def test_division_of_floats_is_exact() -> None:
    """[E-ARITH]"""
    d = Terms()
    x = d.fresh("x", FLOAT)
    for right in (Fraction(1, 3), Fraction(-2)):
        found = d.binary(BinaryOp.DIV, x, right)
        assert isinstance(found, z3.ExprRef)
        solver = z3.Solver(ctx=d.context)
        solver.add(x == 1, found * d.lifted(right, d.sort(FLOAT)) != 1)
        assert solver.check() == z3.unsat
    zero = d.binary(BinaryOp.DIV, x, Fraction(0))
    assert same(d.binary(BinaryOp.EQ, zero, Fraction(0)), True, d)


def test_absolute_values_and_widening() -> None:
    d = Terms()
    for value in NUMBERS:
        x = d.fresh("x", INT)
        for op in (UnaryOp.ABS, UnaryOp.NEG, UnaryOp.WIDEN):
            found = d.unary(op, x)
            assert isinstance(found, z3.ExprRef)
            wanted: Constant = unary_of_numbers(op, value, exact=True)
            solver = z3.Solver(ctx=d.context)
            solver.add(x == value, found != d.lifted(wanted, found.sort()))
            assert solver.check() == z3.unsat


def test_strings_are_told_apart_by_number() -> None:
    d = Terms()
    x = d.fresh("x", STRING)
    both = z3.And(
        d.boolean(d.binary(BinaryOp.EQ, x, "go")), d.boolean(d.binary(BinaryOp.EQ, x, "stop"))
    )
    assert same(both, False, d)
    numbers = [d.lifted(text, d.sort(INT)).as_long() for text in ("go", "stop", "go")]
    assert numbers[0] == numbers[2] != numbers[1]
    assert [d.text_of(number) for number in numbers] == ["go", "stop", "go"]
    assert d.text_of(99) not in ("go", "stop")


def test_fresh_terms_are_all_different() -> None:
    d = Terms()
    names = {str(d.fresh("x", INT)) for _ in range(5)}
    assert len(names) == 5


def test_opaque_sorts_are_one_per_name() -> None:
    d = Terms()
    one, same_one, other = OpaqueType("pos"), OpaqueType("pos"), OpaqueType("pos[]")
    assert d.sort(one) == d.sort(same_one)
    assert d.sort(one) != d.sort(other)
    a, b = d.const("p!0", one), d.const("p!0", one)
    assert d.binary(BinaryOp.EQ, a, b) is True


def test_a_run_on_constants_makes_no_context(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(make: object) -> z3.Context:
        raise AssertionError("a context was made")

    monkeypatch.setattr(terms, "new_context", never)
    d = Terms()
    assert d.ite(d.binary(BinaryOp.LT, 1, 2), d.const(3, INT), 4) == 3
    assert d.is_valid(True)
    assert not d.is_valid(False)


def test_what_is_asked_for_validity_is_forgotten() -> None:
    d = Terms()
    x, y = d.fresh("x", INT), d.fresh("y", INT)
    less, more = d.binary(BinaryOp.LT, x, y), d.binary(BinaryOp.LT, y, x)
    neither = d.unary(UnaryOp.NOT, d.binary(BinaryOp.AND, less, more))
    for _ in range(2):  # were one kept, others would follow from it
        assert not d.is_valid(less)
        assert not d.is_valid(d.unary(UnaryOp.NOT, less))
        assert not d.is_valid(more)
        assert d.is_valid(neither)


def test_validity_is_asked_again_where_a_quick_look_gives_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    d = Terms()
    x = d.fresh("x", INT)
    monkeypatch.setattr(Terms, "_looked_at", lambda self, formula: z3.unknown)
    assert d.is_valid(d.binary(BinaryOp.LT, x, d.binary(BinaryOp.ADD, x, 1)))
    assert not d.is_valid(d.binary(BinaryOp.LT, x, 1))


def test_a_place_in_a_ring_takes_no_products() -> None:
    """What goes round once is told of any size of ring with hardly any work."""
    d = Terms()
    size, place = d.fresh("size", INT), d.fresh("place", INT)
    for turn in (1, -1):
        turned = d.binary(BinaryOp.ADD, place, turn)
        there = d.binary(BinaryOp.MOD, turned, size)
        assert isinstance(there, z3.ExprRef)
        solver = z3.Solver(ctx=d.context)
        solver.set("rlimit", 3_000)
        solver.add(place >= 0, place < size)
        inside = z3.And(there >= 0, there < size)
        next_one = there == place + turn
        wrapped = there == (0 if turn > 0 else size - 1)
        assert solver.check(z3.Not(z3.And(inside, z3.Or(next_one, wrapped)))) == z3.unsat
