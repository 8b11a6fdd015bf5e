"""Machine code from terms, by LLVM: values, loops, and blocks of memory. llvmlite stands here."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir

from koord.kernels.layout import Layout
from koord.kernels.terms import NoKernelError, Scalar, Term
from koord.syntax.core import BinaryOp, UnaryOp

I1, I8, I32, I64 = ir.IntType(1), ir.IntType(8), ir.IntType(32), ir.IntType(64)
BYTES = I8.as_pointer()
WORD_BYTES = 8

#: A value of LLVM; its classes are untyped.
Ir = Any


def word(number: int) -> Ir:
    """A constant of 64 bits."""
    return ir.Constant(I64, number)


def constant(type_: Ir, number: int) -> Ir:
    """A constant of some type of integers."""
    return ir.Constant(type_, number)


def new_module(name: str) -> Ir:
    """An empty module."""
    return ir.Module(name)


def words_of(module: Ir, name: str, numbers: Sequence[int]) -> Ir:
    """A block of constant words of a module. It belongs to all of its functions."""
    type_ = ir.ArrayType(I64, len(numbers))
    table = ir.GlobalVariable(module, type_, name)
    table.initializer = ir.Constant(type_, list(numbers))
    table.global_constant = True
    table.linkage = "internal"
    return table.bitcast(BYTES)


class Code:
    """The body of one function, written in order."""

    def __init__(self, module: Ir, name: str, arguments: Sequence[Ir], result: Ir) -> None:
        self.function = ir.Function(module, ir.FunctionType(result, list(arguments)), name)
        self.b = ir.IRBuilder(self.function.append_basic_block("entry"))
        self.arguments = list(self.function.args)

    def inlined(self) -> None:
        """Let the function be put where it is called."""
        self.function.linkage = "internal"
        self.function.attributes.add("alwaysinline")

    # --- control --------------------------------------------------------------------------------

    def slot(self, type_: Ir, count: int = 1) -> Ir:
        """Memory of this call."""
        with self.b.goto_entry_block():
            return self.b.alloca(type_, size=ir.Constant(I32, count))

    def block(self, size: int) -> Ir:
        """So many bytes of memory of this call."""
        words = self.slot(I64, max(1, (size + WORD_BYTES - 1) // WORD_BYTES))
        return self.b.bitcast(words, BYTES)

    @contextmanager
    def loop(self, start: Ir, end: Ir) -> Iterator[Ir]:
        """A loop over ``[start, end)``; ``end`` is looked at once."""
        counter = self.slot(I64)
        self.b.store(start, counter)
        with self.while_(lambda: self.b.icmp_signed("<", self.b.load(counter), end)):
            yield self.b.load(counter)
            self.b.store(self.b.add(self.b.load(counter), word(1)), counter)

    @contextmanager
    def while_(self, condition: Callable[[], Ir]) -> Iterator[None]:
        """A loop as long as a condition holds."""
        head = self.b.append_basic_block("head")
        body = self.b.append_basic_block("body")
        after = self.b.append_basic_block("after")
        self.b.branch(head)
        self.b.position_at_end(head)
        self.b.cbranch(condition(), body, after)
        self.b.position_at_end(body)
        yield
        self.b.branch(head)
        self.b.position_at_end(after)

    # --- memory ---------------------------------------------------------------------------------

    def at(self, block: Ir, offset: Ir | int) -> Ir:
        """The address some bytes behind a block's start."""
        by = word(offset) if isinstance(offset, int) else offset
        return self.b.gep(block, [by])

    def get(self, block: Ir, offset: Ir | int, type_: Ir) -> Ir:
        """Load a number from a block."""
        address = self.b.bitcast(self.at(block, offset), type_.as_pointer())
        return self.b.load(address, align=1)

    def put(self, block: Ir, offset: Ir | int, value: Ir) -> None:
        """Store a number in a block."""
        address = self.b.bitcast(self.at(block, offset), value.type.as_pointer())
        self.b.store(value, address, align=1)

    def copy(self, to: Ir, source: Ir, size: int) -> None:
        """Copy so many bytes, in steps that are as long as they can be."""
        done = 0
        while done < size:
            step = next(k for k in (8, 4, 2, 1) if k <= size - done)
            self.put(to, done, self.get(source, done, ir.IntType(8 * step)))
            done += step

    def words(self, block: Ir, count: int) -> list[Ir]:
        """Load so many words."""
        return [self.get(block, WORD_BYTES * k, I64) for k in range(count)]


class Cells:
    """Addresses of a layout's cells, each of ``bits`` bits."""

    def __init__(self, layout: Layout, bits: int) -> None:
        self.layout = layout
        self.bits = bits
        self.type = ir.IntType(bits)
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
            return code.b.icmp_signed("!=", held, ir.Constant(self.type, 0))
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
                return ir.Constant(I1, int(scalar))
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


#: Text of machine code that is longer takes seconds to compile: some 50,000 instructions.
_MOST_TEXT = 2_500_000


class Loaded:
    """Machine code in this process. It lives as long as this object.

    Raises NoKernelError if there is too much of it. None of LLVM's passes over its intermediate
    form is made: they took two thirds of the time and made searches no quicker (record 0082).
    """

    def __init__(self, module: Ir) -> None:
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        text = str(module)
        if len(text) > _MOST_TEXT:
            raise NoKernelError("there is too much to compile")
        parsed = llvm.parse_assembly(text)
        parsed.verify()
        machine = llvm.Target.from_default_triple().create_target_machine(
            cpu=llvm.get_host_cpu_name(), opt=1
        )
        self._engine = llvm.create_mcjit_compiler(parsed, machine)
        self._engine.finalize_object()

    def function(self, name: str, arguments: int) -> Callable[..., int]:
        """A function of 64-bit numbers and addresses with a 64-bit result."""
        address = self._engine.get_function_address(name)
        type_ = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * arguments)
        return type_(address)
