"""Number domains: what the semantics is written over.

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
    """Exact numbers may grow without end: work on them stops before the machine does.

    ``names`` are the variables in question, as far as they are known.
    """

    def __init__(self, names: tuple[str, ...] = (), place: Span | None = None) -> None:
        self.names = names
        whose = f"an exact number in {', '.join(names)}" if names else "an exact number"
        message = f"{whose} has grown to more than {LONGEST_NUMBER_BITS} bits"
        hint = "take fewer rounds; a run can use --numbers double"
        place = place or Span("koord", 0, 0, 0, 0)
        super().__init__((Diagnostic("K923", Severity.ERROR, place, message, hint),))

    def about(self, names: tuple[str, ...], place: Span) -> NumberTooLongError:
        """The same with the variables and the place, unless these are known."""
        return self if self.names else NumberTooLongError(names, place)


class Domain(Protocol[V]):
    """Scalars of all types: integers, floats, Booleans, strings, enumeration members, opaques."""

    def const(self, value: Constant, type_: Type) -> V:
        """The scalar that a constant of the text means."""
        ...

    def known(self, value: V) -> Constant | None:
        """The constant that this scalar is, or None where it stands for several."""
        ...

    def unary(self, op: UnaryOp, operand: V) -> V:
        """Apply an operator, totally."""
        ...

    def binary(self, op: BinaryOp, left: V, right: V) -> V:
        """Apply an operator, totally: division by zero gives some value. [E-ARITH]"""
        ...

    def ite(self, condition: V, then: V, other: V) -> V:
        """``then`` where the condition holds, ``other`` elsewhere."""
        ...


def conjunction(d: Domain[V], parts: Sequence[V]) -> V:
    """All of them hold."""
    result = d.const(True, BOOL)
    for part in parts:
        result = d.binary(BinaryOp.AND, result, part)
    return result


def disjunction(d: Domain[V], parts: Sequence[V]) -> V:
    """One of them holds."""
    result = d.const(False, BOOL)
    for part in parts:
        result = d.binary(BinaryOp.OR, result, part)
    return result


class Exact:
    """``int`` is ℤ, ``float`` is ℚ: the reference. Scalars are Python's own."""

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
    """``float`` is an IEEE double, as in the runtime: for refinement checks by equality."""

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
    """An operator on Python's numbers; ``float`` is ℚ if ``exact``, a double otherwise."""
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
    """The nearest double; what is too large for one is infinite, as in IEEE arithmetic."""
    try:
        return float(number)
    except OverflowError:
        return math.inf if number > 0 else -math.inf


def binary_of_numbers(op: BinaryOp, left: Constant, right: Constant) -> Constant:
    """An operator on Python's numbers, total: division by zero gives zero. [E-ARITH]"""
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
    """The number, unless it is too long to go on with. Raises NumberTooLongError."""
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
    """Of ints rounded down; of floats as it is; zero for a zero divisor. [E-ARITH]"""
    if not right:
        return left - left
    if isinstance(left, int) and isinstance(right, int):
        return left // right
    return left / right
