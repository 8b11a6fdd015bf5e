"""What comparisons with constants leave is never fewer values than those that meet them."""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations, product

import pytest

from koord.syntax.analysis.bounds import Bounds
from koord.syntax.core import BinaryOp

OPS = (BinaryOp.EQ, BinaryOp.NE, BinaryOp.LT, BinaryOp.LE)
VALUES = [Fraction(k, 2) for k in range(-1, 6)]
SAID = list(product(OPS, (0, 1, 2), (False, True)))


def holds(op: BinaryOp, x: Fraction, value: int, turned: bool) -> bool:
    left, right = (Fraction(value), x) if turned else (x, Fraction(value))
    match op:
        case BinaryOp.EQ:
            return left == right
        case BinaryOp.NE:
            return left != right
        case BinaryOp.LT:
            return left < right
        case _:
            return left <= right


def allows(bounds: Bounds, x: Fraction) -> bool:
    return not bounds.meet(Bounds.compared(BinaryOp.EQ, x)).is_empty()


@pytest.mark.parametrize("whole", [False, True])
def test_two_comparisons_leave_what_meets_both(whole: bool) -> None:
    for one, other in combinations(SAID, 2):
        bounds = [Bounds.compared(op, v, turned=t, whole=whole) for op, v, t in (one, other)]
        both, either = bounds[0].meet(bounds[1]), bounds[0].join(bounds[1])
        for x in VALUES:
            if whole and x.denominator != 1:
                continue
            first, second = holds(one[0], x, *one[1:]), holds(other[0], x, *other[1:])
            assert allows(both, x) == (first and second), (one, other, x)
            assert allows(either, x) or not (first or second), (one, other, x)
        if both.is_empty():
            assert not any(allows(both, x) for x in VALUES)


def test_contradictions_are_plain() -> None:
    less, more = Bounds.compared(BinaryOp.LT, 1), Bounds.compared(BinaryOp.LE, 1, turned=True)
    assert less.meet(more).is_empty()
    assert not Bounds.compared(BinaryOp.LE, 1).meet(more).is_empty()
    between = Bounds.compared(BinaryOp.LT, 0, turned=True, whole=True)
    assert between.meet(Bounds.compared(BinaryOp.LT, 1, whole=True)).is_empty()
