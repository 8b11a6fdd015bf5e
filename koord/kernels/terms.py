"""The domain of typed terms: what machine code is made of. [E-ARITH]

The rules of :mod:`koord.semantics` are run on it as on any other domain, so that a kernel says what
they say. A scalar is one of Python's own constants where it is known, and else a term: a Boolean,
or an integer with the range that it is in. Ranges are kept so narrow that no arithmetic on 64 bits
can overflow; where that is not possible there is no kernel.
"""

from __future__ import annotations

from typing import TypeAlias

from koord.semantics.domain import Constant, binary_of_numbers, unary_of_numbers
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.types import Type

#: Integers beyond this are left to Python.
_GREATEST = 2**62

#: So many terms are made at most: loops in loops are written out, and more take seconds to compile.
_MOST_TERMS = 60_000


class NoKernelError(Exception):
    """Raised where something has no machine code; the message says what."""


class Term:
    """A scalar that is computed: an operation on others, or a leaf.

    Leaves are cells of a state (``op`` is ``"cell"``) and choices (``"choice"``), by number.
    Integers are in ``[low, high]``; of Booleans both are None. Equal terms are one object.
    """

    __slots__ = ("args", "high", "low", "number", "op")

    def __init__(
        self,
        op: str | UnaryOp | BinaryOp,
        args: tuple[Scalar, ...],
        bounds: tuple[int, int] | None,
        number: int = 0,
    ) -> None:
        self.op = op
        self.args = args
        self.low: int | None = None if bounds is None else bounds[0]
        self.high: int | None = None if bounds is None else bounds[1]
        self.number = number

    @property
    def is_bool(self) -> bool:
        """True of Booleans, false of integers and enumeration members."""
        return self.low is None


Scalar: TypeAlias = "Constant | Term"


class TermDomain:
    """The number domain over terms. Equal terms are made once."""

    def __init__(self) -> None:
        self._made: dict[tuple[object, ...], Term] = {}

    # --- leaves ---------------------------------------------------------------------------------

    def cell(self, number: int, bounds: tuple[int, int] | None) -> Term:
        """What a cell of the state holds; ``bounds`` is None for Booleans."""
        return self._term("cell", (), bounds, number)

    def choice(self, number: int, count: int) -> Term:
        """A number below ``count`` that the caller of the kernel chooses."""
        return self._term("choice", (), (0, count - 1), number)

    def _term(
        self,
        op: str | UnaryOp | BinaryOp,
        args: tuple[Scalar, ...],
        bounds: tuple[int, int] | None,
        number: int = 0,
    ) -> Term:
        if bounds is not None and not -_GREATEST <= bounds[0] <= bounds[1] <= _GREATEST:
            raise NoKernelError("an integer may need more than 62 bits")
        key = (op, *[id(a) if isinstance(a, Term) else (type(a), a) for a in args], bounds, number)
        made = self._made.get(key)
        if made is None:
            if len(self._made) >= _MOST_TERMS:
                raise NoKernelError(f"there are more than {_MOST_TERMS} terms to compile")
            made = self._made[key] = Term(op, args, bounds, number)
        return made

    # --- the five methods of a domain -----------------------------------------------------------

    def const(self, value: Constant, type_: Type) -> Scalar:
        return value

    def known(self, value: Scalar) -> Constant | None:
        return None if isinstance(value, Term) else value

    def unary(self, op: UnaryOp, operand: Scalar) -> Scalar:
        if not isinstance(operand, Term):
            return unary_of_numbers(op, operand, exact=True)
        if op is UnaryOp.NOT:
            return operand.args[0] if operand.op is op else self._term(op, (operand,), None)
        if op is UnaryOp.WIDEN:
            raise NoKernelError("a float is computed")
        low, high = _range(operand)
        if op is UnaryOp.NEG:
            return self._term(op, (operand,), (-high, -low))
        least = 0 if low <= 0 <= high else min(abs(low), abs(high))
        return self._term(op, (operand,), (least, max(abs(low), abs(high))))

    def binary(self, op: BinaryOp, left: Scalar, right: Scalar) -> Scalar:
        if not isinstance(left, Term) and not isinstance(right, Term):
            return binary_of_numbers(op, left, right)
        match op:
            case BinaryOp.AND | BinaryOp.OR:
                return self._connected(op, left, right)
            case BinaryOp.IMPLIES:
                return self._connected(BinaryOp.OR, self.unary(UnaryOp.NOT, left), right)
            case BinaryOp.EQ:
                return self._equal(left, right)
            case BinaryOp.NE:
                return self.unary(UnaryOp.NOT, self._equal(left, right))
            case BinaryOp.LT | BinaryOp.LE:
                return self._ordered(op, left, right)
            case BinaryOp.MIN | BinaryOp.MAX:
                first = self.binary(BinaryOp.LE, left, right)
                low = op is BinaryOp.MIN
                return self.ite(first, left if low else right, right if low else left)
            case _:
                return self._term(op, (left, right), _calculated(op, _range(left), _range(right)))

    def ite(self, condition: Scalar, then: Scalar, other: Scalar) -> Scalar:
        if not isinstance(condition, Term):
            return then if condition else other
        if then is other or (_is_constant(then, other) and then == other):
            return then
        if _is_bool(then) or _is_bool(other):
            if then is True:
                return self.binary(BinaryOp.OR, condition, other)
            if then is False:
                return self.binary(BinaryOp.AND, self.unary(UnaryOp.NOT, condition), other)
            if other is True:
                return self.binary(BinaryOp.IMPLIES, condition, then)
            if other is False:
                return self.binary(BinaryOp.AND, condition, then)
            return self._term("ite", (condition, then, other), None)
        a, b = _range(then), _range(other)
        bounds = (min(a[0], b[0]), max(a[1], b[1]))
        return self._term("ite", (condition, then, other), bounds)

    # --- comparisons ----------------------------------------------------------------------------

    def _connected(self, op: BinaryOp, left: Scalar, right: Scalar) -> Scalar:
        absorbing = op is BinaryOp.OR
        if left is absorbing or right is absorbing:
            return absorbing
        if not isinstance(left, Term):
            return right
        if not isinstance(right, Term) or left is right:
            return left
        return self._term(op, (left, right), None)

    def _equal(self, left: Scalar, right: Scalar) -> Scalar:
        if left is right:
            return True
        if _is_bool(left) or _is_bool(right):
            if not isinstance(left, Term):
                left, right = right, left
            if not isinstance(right, Term):
                return left if right else self.unary(UnaryOp.NOT, left)
            return self._term(BinaryOp.EQ, (left, right), None)
        a, b = _range(left), _range(right)
        if a[1] < b[0] or b[1] < a[0]:
            return False
        return self._term(BinaryOp.EQ, (left, right), None)

    def _ordered(self, op: BinaryOp, left: Scalar, right: Scalar) -> Scalar:
        a, b = _range(left), _range(right)
        strict = op is BinaryOp.LT
        if a[1] < b[0] or (not strict and a[1] == b[0]):
            return True
        if a[0] > b[1] or (strict and a[0] == b[1]):
            return False
        return self._term(op, (left, right), None)


def _is_constant(*scalars: Scalar) -> bool:
    return not any(isinstance(scalar, Term) for scalar in scalars)


def _is_bool(scalar: Scalar) -> bool:
    return scalar.is_bool if isinstance(scalar, Term) else isinstance(scalar, bool)


def _range(scalar: Scalar) -> tuple[int, int]:
    """The least and the greatest value of an integer."""
    if isinstance(scalar, Term):
        assert scalar.low is not None
        assert scalar.high is not None
        return scalar.low, scalar.high
    if not isinstance(scalar, int):
        raise NoKernelError(f"a {type(scalar).__name__} is computed")
    return scalar, scalar


def _calculated(op: BinaryOp, a: tuple[int, int], b: tuple[int, int]) -> tuple[int, int]:
    """The range of a sum, a difference, a product, a quotient, or a remainder."""
    match op:
        case BinaryOp.ADD:
            return a[0] + b[0], a[1] + b[1]
        case BinaryOp.SUB:
            return a[0] - b[1], a[1] - b[0]
        case BinaryOp.MUL:
            corners = [x * y for x in a for y in b]
            return min(corners), max(corners)
        case BinaryOp.DIV:
            most = max(abs(a[0]), abs(a[1])) + 1
            return -most, most
        case BinaryOp.MOD:
            return min(b[0], 0), max(b[1], 0)
    raise AssertionError(op)
