"""Number domains: the operations on scalars that the semantics is generic in.

The rules of :mod:`koord.semantics` never look into a scalar; they combine scalars with the five
methods here. Exact rationals and doubles are in this file, Z3 terms in ``koord.verify``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Protocol, TypeVar, assert_never

from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.source import Span
from koord.syntax.types import BOOL, FloatType, Type

V = TypeVar("V")

Constant = int | Fraction | float | bool | str

#: Python would take minutes to reduce a fraction of numbers much longer than this.
LONGEST_NUMBER_BITS = 100_000


class NumberTooLongError(KoordError):
    """Raised where an exact number has grown too long to compute with.

    ``names`` are the variables in question, as far as they are known.
    """

    def __init__(self, names: tuple[str, ...] = (), place: Span | None = None) -> None:
        self.names = names
        whose = f"an exact number in {', '.join(names)}" if names else "an exact number"
        message = f"{whose} has grown to more than {LONGEST_NUMBER_BITS} bits"
        hint = "take fewer rounds; a run can use `numbers='double'`"
        place = place or Span("koord", 0, 0, 0, 0)
        super().__init__((Diagnostic("K923", Severity.ERROR, place, message, hint),))

    def about(self, names: tuple[str, ...], place: Span) -> NumberTooLongError:
        """The same error with the variables and the place added, unless it has them already."""
        return self if self.names else NumberTooLongError(names, place)


class Domain(Protocol[V]):
    """The operations on scalars of all types, from integers to enumeration members and opaques."""

    def const(self, value: Constant, type_: Type) -> V:
        """The scalar that stands for a constant of the program."""
        ...

    def known(self, value: V) -> Constant | None:
        """The constant that a scalar is equal to, or None where it is symbolic."""
        ...

    def unary(self, op: UnaryOp, operand: V) -> V:
        """Apply an operator, totally."""
        ...

    def binary(self, op: BinaryOp, left: V, right: V) -> V:
        """Apply an operator, totally: division by zero gives some value. [E-ARITH]"""
        ...

    def ite(self, condition: V, then: V, other: V) -> V:
        """If-then-else: ``then`` where the condition holds, ``other`` elsewhere."""
        ...


def conjunction(d: Domain[V], parts: Sequence[V]) -> V:
    """The conjunction of conditions; true for none."""
    result = d.const(True, BOOL)
    for part in parts:
        result = d.binary(BinaryOp.AND, result, part)
    return result


def disjunction(d: Domain[V], parts: Sequence[V]) -> V:
    """The disjunction of conditions; false for none."""
    result = d.const(False, BOOL)
    for part in parts:
        result = d.binary(BinaryOp.OR, result, part)
    return result


class Exact:
    """The reference domain: ``int`` is ℤ, ``float`` is ℚ. Scalars are Python's own numbers."""

    def const(self, value: Constant, type_: Type) -> Constant:
        return Fraction(value) if isinstance(type_, FloatType) else value

    def known(self, value: Constant) -> Constant | None:
        return value

    def unary(self, op: UnaryOp, operand: Constant) -> Constant:
        return unary_of_numbers(op, operand, exact=True)

    def binary(self, op: BinaryOp, left: Constant, right: Constant) -> Constant:
        return binary_of_numbers(op, left, right)

    def ite(self, condition: Constant, then: Constant, other: Constant) -> Constant:
        return then if condition else other


class Doubles:
    """The domain in which ``float`` is an IEEE double, as at run time: for equality with a run."""

    def const(self, value: Constant, type_: Type) -> Constant:
        return float(value) if isinstance(type_, FloatType) else value

    def known(self, value: Constant) -> Constant | None:
        return value

    def unary(self, op: UnaryOp, operand: Constant) -> Constant:
        return unary_of_numbers(op, operand, exact=False)

    def binary(self, op: BinaryOp, left: Constant, right: Constant) -> Constant:
        return binary_of_numbers(op, left, right)

    def ite(self, condition: Constant, then: Constant, other: Constant) -> Constant:
        return then if condition else other


EXACT = Exact()
DOUBLES = Doubles()


def unary_of_numbers(op: UnaryOp, operand: Constant, *, exact: bool) -> Constant:
    """Apply a unary operator to Python numbers; ``float`` is ℚ if ``exact``, a double otherwise."""
    if op is UnaryOp.NOT:
        return not operand
    assert not isinstance(operand, str)
    match op:
        case UnaryOp.NEG:
            return -operand
        case UnaryOp.ABS:
            return -operand if operand < 0 else operand
        case UnaryOp.WIDEN:
            return Fraction(operand) if exact else _double(operand)
    assert_never(op)


def _double(number: int | Fraction | float) -> float:
    """Round to the nearest double; what is too large for one is infinite, as in IEEE arithmetic."""
    try:
        return float(number)
    except OverflowError:
        return math.inf if number > 0 else -math.inf


def binary_of_numbers(op: BinaryOp, left: Constant, right: Constant) -> Constant:
    """Apply a binary operator to Python numbers, totally: division by zero gives zero. [E-ARITH]"""
    match op:
        case BinaryOp.EQ:
            return left == right
        case BinaryOp.NE:
            return left != right
        case BinaryOp.AND:
            return bool(left and right)
        case BinaryOp.OR:
            return bool(left or right)
        case BinaryOp.IMPLIES:
            return bool(not left or right)
    assert not isinstance(left, str)
    assert not isinstance(right, str)
    match op:
        case BinaryOp.ADD:
            return _handy(left + right)
        case BinaryOp.SUB:
            return _handy(left - right)
        case BinaryOp.MUL:
            return _handy(left * right)
        case BinaryOp.DIV:
            return _handy(_quotient(left, right))
        case BinaryOp.MOD:
            return left % right if right else 0
        case BinaryOp.LT:
            return left < right
        case BinaryOp.LE:
            return left <= right
        case BinaryOp.MIN:
            return min(left, right)
        case BinaryOp.MAX:
            return max(left, right)
    assert_never(op)


def _handy(number: int | Fraction | float) -> Constant:
    """Return the number. Raises NumberTooLongError if it is too long to compute with."""
    if isinstance(number, int):
        bits = number.bit_length()
    elif isinstance(number, Fraction):
        bits = max(number.numerator.bit_length(), number.denominator.bit_length())
    else:
        return number
    if bits > LONGEST_NUMBER_BITS:
        raise NumberTooLongError
    return number


def _quotient(
    left: int | Fraction | float, right: int | Fraction | float
) -> int | Fraction | float:
    """Divide: ints rounded down, others as they are; zero for a zero divisor. [E-ARITH]"""
    if not right:
        return left - left
    if isinstance(left, int) and isinstance(right, int):
        return left // right
    return left / right
