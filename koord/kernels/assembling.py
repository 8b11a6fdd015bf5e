"""Machine code from terms: the cells of a packed state, and values."""

from __future__ import annotations

from collections.abc import Sequence

from koord.kernels.layout import Layout
from koord.kernels.terms import Scalar, Term
from koord.machine.code import I1, I64, WORD_BYTES, Code, Ir, constant, integers, word
from koord.syntax.core import BinaryOp, UnaryOp


class Cells:
    """Addresses of a layout's cells, each of ``bits`` bits."""

    def __init__(self, layout: Layout, bits: int) -> None:
        self.layout = layout
        self.bits = bits
        self.type = integers(bits)
        self.size = bits // 8
        self.state_bytes = self.whole(len(layout.cells))
        self.shared_bytes = self.whole(len(layout.cells) - layout.shared_first)
        self.shared_cells = len(layout.cells) - layout.shared_first

    def whole(self, cells: int) -> int:
        """The bytes of so many cells, in whole words."""
        return max(1, -(-cells * self.size // WORD_BYTES)) * WORD_BYTES

    def read(self, code: Code, state: Ir, cell: int) -> Ir:
        """The number in a cell, of 64 bits; of Booleans one bit."""
        held = code.get(state, cell * self.size, self.type)
        if self.layout.cells[cell].is_bool:
            return code.b.icmp_signed("!=", held, constant(self.type, 0))
        return code.b.sext(held, I64) if self.bits < 64 else held

    def narrow(self, code: Code, value: Ir) -> Ir:
        """A number as a cell holds it."""
        if value.type == I1:
            return code.b.zext(value, self.type)
        return code.b.trunc(value, self.type) if self.bits < 64 else value

    def may_not_fit(self, value: Scalar) -> bool:
        """Return whether an integer may be out of a cell's range."""
        most = 1 << (self.bits - 1)
        low, high = -most, most - 1
        if isinstance(value, Term):
            if value.low is None or value.high is None:
                return False
            return value.low < low or value.high > high
        return not low <= int(value) <= high

    def fits(self, code: Code, value: Ir) -> Ir:
        """Whether an integer is in a cell's range."""
        back = code.b.sext(code.b.trunc(value, self.type), I64)
        return code.b.icmp_signed("==", back, value)


class Evaluation:
    """Terms as values in the body of one function; each is computed once."""

    def __init__(self, code: Code, cells: Cells, state: Ir, choices: Sequence[Ir]) -> None:
        self.code = code
        self.cells = cells
        self.state = state
        self.choices = choices
        self._done: dict[int, Ir] = {}

    def value(self, scalar: Scalar) -> Ir:
        """The value of a scalar: one bit, or 64."""
        if not isinstance(scalar, Term):
            if isinstance(scalar, bool):
                return constant(I1, int(scalar))
            assert isinstance(scalar, int)
            return word(scalar)
        # Not by recursion: terms of long loops are deep.
        waiting = [scalar]
        while waiting:
            term = waiting[-1]
            if id(term) in self._done:
                waiting.pop()
                continue
            missing = [a for a in term.args if isinstance(a, Term) and id(a) not in self._done]
            if missing:
                waiting += missing
                continue
            args = [self._done[id(a)] if isinstance(a, Term) else self.value(a) for a in term.args]
            self._done[id(term)] = self._made(term, args)
            waiting.pop()
        return self._done[id(scalar)]

    def _made(self, term: Term, args: list[Ir]) -> Ir:
        b = self.code.b
        match term.op:
            case "cell":
                return self.cells.read(self.code, self.state, term.number)
            case "choice":
                return self.choices[term.number]
            case "ite":
                return b.select(*args)
            case UnaryOp.NOT:
                return b.not_(*args)
            case UnaryOp.NEG:
                return b.neg(*args)
            case UnaryOp.ABS:
                return b.select(b.icmp_signed("<", args[0], word(0)), b.neg(args[0]), args[0])
            case BinaryOp.AND:
                return b.and_(*args)
            case BinaryOp.OR:
                return b.or_(*args)
            case BinaryOp.EQ:
                return b.icmp_signed("==", *args)
            case BinaryOp.LT:
                return b.icmp_signed("<", *args)
            case BinaryOp.LE:
                return b.icmp_signed("<=", *args)
            case BinaryOp.ADD:
                return b.add(*args)
            case BinaryOp.SUB:
                return b.sub(*args)
            case BinaryOp.MUL:
                return b.mul(*args)
            case BinaryOp.DIV | BinaryOp.MOD:
                return self._divided(term.op, *args)
        raise AssertionError(term.op)

    def _divided(self, op: BinaryOp, left: Ir, right: Ir) -> Ir:
        """A quotient rounded down, or its remainder; by zero something. [E-ARITH]"""
        b = self.code.b
        right = b.select(b.icmp_signed("==", right, word(0)), word(1), right)
        rest = b.srem(left, right)
        differs = b.icmp_signed("<", b.xor(rest, right), word(0))
        uneven = b.and_(b.icmp_signed("!=", rest, word(0)), differs)
        if op is BinaryOp.DIV:
            return b.sub(b.sdiv(left, right), b.zext(uneven, I64))
        return b.add(rest, b.select(uneven, right, word(0)))
