"""The domain of bits: the semantics over literals and bit vectors.

A scalar is one of Python's own constants where it is known. Elsewhere a Boolean is a literal of an
and-inverter graph; integers, enumeration members, strings (by number) and rationals are vectors of
literals with a range; opaque values are choices of tokens. All is exact but for numbers of which
infinitely many values are possible: these are *loose*, and comparisons with them are open.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import NamedTuple, TypeAlias

from koord.semantics.domain import Constant, binary_of_numbers, unary_of_numbers
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.types import (
    BoolType,
    EnumType,
    FloatType,
    IntType,
    OpaqueType,
    StreamType,
    StringType,
    Type,
)
from koord.verify.engines.bits import numbers
from koord.verify.engines.bits.graph import FALSE, TRUE, Graph
from koord.verify.engines.bits.numbers import Number
from koord.verify.engines.bits.opaque import EQUALS, Known, OpaqueChoice, Opaques


class Bit(NamedTuple):
    """A Boolean that is not constant."""

    literal: int


Bits: TypeAlias = "Constant | Bit | Number | OpaqueChoice"

#: The least and the greatest value of an integer, as far as known.
Range: TypeAlias = "tuple[int | None, int | None]"


class BitDomain:
    """The number domain over the literals of one graph.

    ``ranges`` are those of unknown integers, by name, where something is known of them beforehand;
    ``required`` holds of all values that were made fresh; ``looser`` are the names of those that
    have infinitely many values.
    """

    def __init__(self, ranges: dict[str, Range] | None = None) -> None:
        self.graph = Graph()
        self.ranges: dict[str, Range] = {} if ranges is None else ranges
        self.required: list[int] = []
        self.looser: dict[str, None] = {}
        self.asked: dict[int, tuple[str, Range]] = {}
        self._open: dict[tuple[Bits, Bits, bool], int] = {}
        self._sides: dict[Number, tuple[int, Number, Number]] = {}
        self._elements: set[Number] = set()
        self._deep = 0  #: so many choices, one in the other, are being compared
        self._loose_names: dict[int, str] = {}
        self._strings: dict[str, int] = {}
        self.opaques = Opaques(self.graph)

    # --- the five methods of a domain -----------------------------------------------------------

    def const(self, value: Constant, type_: Type) -> Bits:
        if isinstance(type_, FloatType):
            return Fraction(value)
        if isinstance(type_, OpaqueType):
            token = self.opaques.term(str(value), (), type_.name)
            return OpaqueChoice(type_.name, ((token, TRUE),))
        return value

    def known(self, value: Bits) -> Constant | None:
        return None if isinstance(value, tuple) else value

    def unary(self, op: UnaryOp, operand: Bits) -> Bits:
        if not isinstance(operand, tuple):
            return unary_of_numbers(op, operand, exact=True)
        if isinstance(operand, Bit):
            assert op is UnaryOp.NOT
            return Bit(operand.literal ^ 1)
        assert isinstance(operand, Number)
        match op:
            case UnaryOp.NEG:
                return self._settled(numbers.negated(self.graph, operand))
            case UnaryOp.ABS:
                if operand.low >= 0 and operand.loose == FALSE:
                    return operand
                minus = numbers.negated(self.graph, operand)
                size = numbers.chosen(self.graph, operand.literals[-1], minus, operand)
                low = 0 if operand.low <= 0 <= operand.high else min(map(abs, operand[1:3]))
                high = max(operand.high, -operand.low)
                made = numbers.fitted(size.literals, low, high, operand.scale, operand.loose)
                return self._settled(made)
            case UnaryOp.WIDEN:
                return operand._replace(scale=1)
        raise AssertionError(op)

    def binary(self, op: BinaryOp, left: Bits, right: Bits) -> Bits:
        if not isinstance(left, tuple) and not isinstance(right, tuple):
            return binary_of_numbers(op, left, right)
        match op:
            case BinaryOp.AND:
                return boolean(self.graph.both(literal(left), literal(right)))
            case BinaryOp.OR:
                return boolean(self.graph.either(literal(left), literal(right)))
            case BinaryOp.IMPLIES:
                return boolean(self.graph.either(literal(left) ^ 1, literal(right)))
            case BinaryOp.EQ:
                return boolean(self._equal(left, right))
            case BinaryOp.NE:
                return boolean(self._equal(left, right) ^ 1)
        a, b = self.number(left), self.number(right)
        match op:
            case BinaryOp.LE:
                return boolean(self._at_most(a, b))
            case BinaryOp.LT:
                return boolean(self._at_most(b, a) ^ 1)
            case BinaryOp.MIN:
                return self._extreme(a, b, self._at_most(a, b), min)
            case BinaryOp.MAX:
                return self._extreme(a, b, self._at_most(b, a), max)
            case _:
                return self._settled(self._calculated(op, a, b))

    def ite(self, condition: Bits, then: Bits, other: Bits) -> Bits:
        if not isinstance(condition, Bit):
            return then if condition else other
        if then is other:
            return then
        g, when = self.graph, condition.literal
        if isinstance(then, Bit | bool) or isinstance(other, Bit | bool):
            return boolean(g.choose(when, literal(then), literal(other)))
        if isinstance(then, OpaqueChoice):
            assert isinstance(other, OpaqueChoice)
            return then if then == other else self.opaques.chosen(when, then, other)
        a, b = self.number(then), self.number(other)
        if a == b:
            return then
        made = numbers.chosen(g, when, a, b)
        if made.loose == TRUE:  # too wide
            made = self._another(made)
        if made.loose != FALSE:
            self._remember(made, when, a, b)
        return numbers.settled(made)

    def _remember(self, made: Number, when: int, then: Number, other: Number) -> None:
        """Record the two sides of a choice, which existed before it.

        The graph may find that a choice is a number which others were chosen from already. That one
        stays what it was: else comparing it would lead back to it.
        """
        if made not in self._sides and made not in self._elements:
            self._elements.update(side for side in (then, other) if side not in self._sides)
            if made not in self._elements:
                self._sides[made] = (when, then, other)

    # --- what is left open ----------------------------------------------------------------------

    def fresh(self, name: str, type_: Type) -> Bits:
        """A fresh value of a scalar type."""
        match type_:
            case BoolType():
                return Bit(self.graph.input(name))
            case EnumType(members=members):
                return self.between(name, 0, len(members) - 1)
            case OpaqueType(name=sort):
                return self.opaques.fresh(sort, name)
            case IntType():
                low, high = self.ranges.get(name, (None, None))
                if low is not None and high is not None and numbers.is_kept(low, high):
                    return self.between(name, low, high)
                return self._any(name, 0)
            case FloatType():
                return self._any(name, 1)
            case StringType() | StreamType():
                return self._any(name, 0)
            case _:
                raise AssertionError(f"{type_} is no scalar type")

    def between(self, name: str, low: int, high: int) -> Bits:
        """A fresh integer of a range."""
        if high < low:
            high = low
        if high == low:
            return low
        number = self.vector(name, low, high, 0)
        self.required += self.in_range(number)
        return number

    def vector(self, name: str, low: int, high: int, scale: int) -> Number:
        """A fresh vector with as many inputs as a range needs, however wide that is."""
        size = numbers.width(low, high)
        unsigned = low >= 0 or high < 0
        made = [self.graph.input(f"{name}.{k}") for k in range(size - unsigned)]
        return numbers.exactly((*made, FALSE) if unsigned else tuple(made), low, high, scale, FALSE)

    def in_range(self, number: Number) -> list[int]:
        """The literals that say that a vector is in its range, which operators assume."""
        size = 1 << len(number.literals)
        wide = number._replace(low=-size, high=size, scale=0)
        low, high = numbers.lifted(number.low), numbers.lifted(number.high)
        g = self.graph
        return [numbers.at_most(g, low, wide), numbers.at_most(g, wide, high)]

    def _any(self, name: str, scale: int) -> Bits:
        """A fresh loose number, different from all others."""
        self.looser.setdefault(name)
        return Number((FALSE,), 0, 0, scale, self._mark(name))

    def _mark(self, name: str) -> int:
        """A literal that always holds, and distinguishes one loose number from others."""
        node = self.graph.input(f"{name} is any")
        self._loose_names[node >> 1] = name
        self.required.append(node)
        return node

    def is_inexact(self) -> bool:
        """Return whether any number was made that is not represented exactly."""
        return bool(self._loose_names)

    def is_wild(self, number: Number) -> bool:
        """Return whether nothing is ever known of a number."""
        if number.loose < 2:
            return number.loose == TRUE
        node = number.loose >> 1
        if not number.loose & 1:
            return node in self._loose_names
        parts = self.graph.left[node] ^ 1, self.graph.right[node] ^ 1
        return any(not part & 1 and part >> 1 in self._loose_names for part in parts)

    def wild(self, name: str, scale: int) -> Number:
        """A number of which nothing is known."""
        return Number((FALSE,), 0, 0, scale, self._mark(name))

    def applied(self, name: str, arguments: Sequence[Bits], result: Type) -> Bits:
        """Apply an uninterpreted function for which :meth:`is_relation` holds."""
        given = [a if isinstance(a, OpaqueChoice) else self._listed(a) for a in arguments]
        if isinstance(result, OpaqueType):
            return self.opaques.applied(name, given, result.name)
        assert isinstance(result, BoolType)
        return boolean(self.opaques.related(name, given))

    def is_relation(self, arguments: Sequence[Bits], result: Type) -> bool:
        """Return whether a function is decided by cases: it is on opaque values or a few."""
        plain = all(not isinstance(a, Number) or _is_one_of_few(a) for a in arguments)
        return plain and isinstance(result, OpaqueType | BoolType)

    def _listed(self, value: Bits) -> OpaqueChoice:
        """A scalar as a choice of constants."""
        match value:
            case Bit(literal=here):
                return OpaqueChoice("", ((Known(True), here), (Known(False), here ^ 1)))
            case Number(low=low, high=high, scale=scale):
                parts = []
                for k in range(low, high + 1):
                    known = Fraction(k, scale) if scale else k
                    here = numbers.equal(self.graph, value, numbers.lifted(known))
                    parts.append((Known(known), here))
                return OpaqueChoice("", tuple(parts))
            case _:
                assert not isinstance(value, OpaqueChoice)
                return OpaqueChoice("", ((Known(value), TRUE),))

    def for_all(self, variables: Sequence[Bits], body: Bits) -> Bits:
        """Universal quantification of a Boolean: a fresh bit where it depends on the variables."""
        if not isinstance(body, Bit):
            return body
        return Bit(self.graph.input("for all"))

    def learned(self, constraint: int) -> dict[str, Range]:
        """The ranges of unknown integers, by name, that a constraint implies."""
        found: dict[str, Range] = {}
        for part in self.graph.conjuncts(constraint):
            for name, bounds in self._said(part, DEEP).items():
                found[name] = _meet(found[name], bounds) if name in found else bounds
        return found

    def _said(self, part: int, deep: int) -> dict[str, Range]:
        """The ranges that a literal implies which is no conjunction; of a disjunction, the join."""
        g = self.graph
        if part in self.asked:
            return dict([self.asked[part]])
        if not deep or not part & 1 or part < 2 or g.is_input(part >> 1):
            return {}
        sides = g.left[part >> 1] ^ 1, g.right[part >> 1] ^ 1
        one = self._said(sides[0], deep - 1)
        if not one:
            return {}
        other = self._said(sides[1], deep - 1)
        return {name: _join(one[name], other[name]) for name in one.keys() & other.keys()}

    # --- numbers --------------------------------------------------------------------------------

    def number(self, value: Bits) -> Number:
        """A number, enumeration member or string as a vector."""
        if isinstance(value, Number):
            return value
        if isinstance(value, str):
            return numbers.lifted(self._strings.setdefault(value, len(self._strings)))
        assert isinstance(value, int | Fraction), value
        return numbers.lifted(value)

    def text_of(self, number: int) -> str:
        """The string with a number in the table; a made-up one for an unknown number."""
        for text, its_number in self._strings.items():
            if its_number == number:
                return text
        return f"string{number}"

    def _calculated(self, op: BinaryOp, a: Number, b: Number) -> Number:
        g = self.graph
        match op:
            case BinaryOp.ADD:
                return numbers.added(g, a, b)
            case BinaryOp.SUB:
                return numbers.added(g, a, numbers.negated(g, b))
            case BinaryOp.MUL:
                return numbers.multiplied(g, a, b)
            case BinaryOp.DIV if a.scale or b.scale:
                return self._quotient(a, b)
            case BinaryOp.DIV:
                return numbers.divided(g, a, b, lambda x, y: x // y)
            case BinaryOp.MOD:
                return numbers.divided(g, a, b, lambda x, y: x % y)
        raise AssertionError(op)

    def _quotient(self, a: Number, b: Number) -> Number:
        """Divide rationals: exact for a constant divisor."""
        divisor = numbers.settled(b)
        if isinstance(divisor, Number):
            return numbers.anything(1)
        if not divisor:
            return numbers.lifted(Fraction(0))
        return numbers.multiplied(self.graph, a, numbers.lifted(1 / Fraction(divisor)))

    def _settled(self, number: Number) -> Bits:
        """A computed number as a scalar."""
        return numbers.settled(self._another(number))

    def _another(self, number: Number) -> Number:
        """A computed number: where it is loose, it is different from all before."""
        if number.loose == FALSE:
            return number
        if self.is_wild(number):
            return self.wild("calculated", number.scale)
        return number._replace(loose=self.graph.both(number.loose, self._mark("calculated")))

    def _extreme(self, a: Number, b: Number, first: int, pick: Callable[[int, int], int]) -> Bits:
        """The minimum or maximum: its range is narrower than that of a choice."""
        g = self.graph
        a, b = numbers.aligned(g, a, b)
        low, high = pick(a.low, b.low), pick(a.high, b.high)
        size = numbers.width(low, high)
        pairs = zip(numbers.resized(a, size), numbers.resized(b, size), strict=True)
        literals = tuple(g.choose(first, x, y) for x, y in pairs)
        loose = g.either(a.loose, b.loose)
        made = numbers.fitted(literals, low, high, max(a.scale, b.scale), loose)
        return self._settled(made)

    # --- comparisons ----------------------------------------------------------------------------

    def _equal(self, left: Bits, right: Bits) -> int:
        g = self.graph
        if isinstance(left, Bit | bool) or isinstance(right, Bit | bool):
            return g.differ(literal(left), literal(right)) ^ 1
        if isinstance(left, OpaqueChoice):
            assert isinstance(right, OpaqueChoice)
            return self.opaques.related(EQUALS, (left, right))
        a, b = self.number(left), self.number(right)
        if a == b:
            return TRUE
        return self._loosened(a, b, numbers.equal(g, a, b), order=False)

    def _at_most(self, a: Number, b: Number) -> int:
        if a == b:
            return TRUE
        return self._loosened(a, b, numbers.at_most(self.graph, a, b), order=True)

    def _loosened(self, a: Number, b: Number, exact: int, *, order: bool) -> int:
        """A comparison that is unconstrained where one of the numbers is loose."""
        loose = self.graph.either(a.loose, b.loose)
        if loose == FALSE:
            return exact
        if not order and b < a:
            a, b = b, a
        key = (a, b, order)
        if key in self._open:
            return self._open[key]
        self._open[key] = self._compared(a, b, exact, loose, order=order)
        return self._open[key]

    def _compared(self, a: Number, b: Number, exact: int, loose: int, *, order: bool) -> int:
        """A new comparison. Of a choice it is a choice of comparisons."""
        g = self.graph
        for number, is_left in ((a, True), (b, False)):
            if number in self._sides and self._deep < MOST_CHOICES:
                when, then, other = self._sides[number]
                one, two = ((then, b), (other, b)) if is_left else ((a, then), (a, other))
                compare = self._at_most if order else self._equal
                self._deep += 1
                chosen = g.choose(when, compare(*one), compare(*two))
                self._deep -= 1
                return chosen
        verdict = g.input("comparison")
        if loose != TRUE:
            self._note(a, b, verdict, order=order)
        # A loose literal that always holds need not be asked.
        if self.is_wild(a) or self.is_wild(b):
            return verdict
        return self.graph.choose(loose, verdict, exact)

    def _note(self, a: Number, b: Number, verdict: int, *, order: bool) -> None:
        """Remember the ranges that a comparison of an unknown number implies."""
        name = self._loose_names.get(a.loose >> 1)
        if name is not None and b.loose == FALSE and b.scale == 0:
            self.asked[verdict] = (name, (None if order else b.low, b.high))
            if order:  # not a <= b
                self.asked[verdict ^ 1] = (name, (b.low + 1, None))
        name = self._loose_names.get(b.loose >> 1)
        if name is not None and a.loose == FALSE and a.scale == 0:
            self.asked[verdict] = (name, (a.low, None if order else a.high))
            if order:
                self.asked[verdict ^ 1] = (name, (None, a.high - 1))


def _meet(a: Range, b: Range) -> Range:
    low = b[0] if a[0] is None else a[0] if b[0] is None else max(a[0], b[0])
    high = b[1] if a[1] is None else a[1] if b[1] is None else min(a[1], b[1])
    return low, high


def _join(a: Range, b: Range) -> Range:
    low = None if a[0] is None or b[0] is None else min(a[0], b[0])
    high = None if a[1] is None or b[1] is None else max(a[1], b[1])
    return low, high


def _is_one_of_few(number: Number) -> bool:
    return number.loose == FALSE and number.high - number.low < FEW


#: Disjunctions of so many parts are looked into for ranges, on each side.
DEEP = 12

#: So many arguments of a function are told apart.
FEW = 16


def boolean(value: int) -> Bits:
    """A literal as a scalar."""
    return value == TRUE if value < 2 else Bit(value)


def literal(value: Bits) -> int:
    """A Boolean scalar as a literal."""
    if isinstance(value, Bit):
        return value.literal
    assert isinstance(value, bool), value
    return TRUE if value else FALSE


#: Of more choices, one in the other, a comparison is left open.
MOST_CHOICES = 100
