"""Machine code by LLVM: values, loops, and blocks of memory. llvmlite stands here."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, cast

from llvmlite import ir

if TYPE_CHECKING:
    import llvmlite.binding as llvm

I1, I8, I32, I64 = ir.IntType(1), ir.IntType(8), ir.IntType(32), ir.IntType(64)
F64 = ir.DoubleType()
BYTES = I8.as_pointer()
WORD_BYTES = 8

#: A value of LLVM; its classes are untyped.
Ir = Any


def compiler() -> str:
    """The version of what compiles."""
    import llvmlite

    return str(llvmlite.__version__)


def word(number: int) -> Ir:
    """A constant of 64 bits."""
    return ir.Constant(I64, number)


def real(number: float) -> Ir:
    """A constant double."""
    return ir.Constant(F64, number)


def constant(type_: Ir, number: int) -> Ir:
    """A constant of some type of integers."""
    return ir.Constant(type_, number)


def integers(bits: int) -> Ir:
    """The type of integers of so many bits."""
    return ir.IntType(bits)


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

    def repeated(
        self, count: Ir, values: Sequence[Ir], body: Callable[[list[Ir]], Sequence[Ir]]
    ) -> list[Ir]:
        """What values are after so many passes of a body over them. They stay in registers."""
        before = self.b.block
        head = self.b.append_basic_block("head")
        inside = self.b.append_basic_block("body")
        after = self.b.append_basic_block("after")
        self.b.branch(head)
        self.b.position_at_end(head)
        done = self.b.phi(I64)
        done.add_incoming(word(0), before)
        now = [self.b.phi(value.type) for value in values]
        for phi, value in zip(now, values, strict=True):
            phi.add_incoming(value, before)
        self.b.cbranch(self.b.icmp_signed("<", done, count), inside, after)
        self.b.position_at_end(inside)
        for phi, value in zip(now, body(list(now)), strict=True):
            phi.add_incoming(value, self.b.block)
        done.add_incoming(self.b.add(done, word(1)), self.b.block)
        self.b.branch(head)
        self.b.position_at_end(after)
        return now

    @contextmanager
    def only_if(self, condition: Ir) -> Iterator[None]:
        """What is done only where a condition holds."""
        with self.b.if_then(condition):
            yield

    def known(self, name: str, result: Ir, arguments: Sequence[Ir]) -> Ir:
        """Call a function that LLVM knows by name."""
        function = self.function.module.globals.get(name)
        if function is None:
            types = [argument.type for argument in arguments]
            function = ir.Function(self.function.module, ir.FunctionType(result, types), name)
        return self.b.call(function, arguments)

    def called(self, address: Ir, arguments: Sequence[Ir]) -> Ir:
        """Call a function of 64-bit numbers at an address; its result has 64 bits."""
        type_ = ir.FunctionType(I64, [I64] * len(arguments)).as_pointer()
        return self.b.call(self.b.inttoptr(address, type_), list(arguments))

    def called_real(self, address: Ir, arguments: Sequence[Ir]) -> Ir:
        """Call a function of doubles at an address; its result is a double."""
        type_ = ir.FunctionType(F64, [F64] * len(arguments)).as_pointer()
        return self.b.call(self.b.inttoptr(address, type_), list(arguments))

    # --- memory ---------------------------------------------------------------------------------

    def pointer(self, address: Ir) -> Ir:
        """The block at an address that is a number."""
        return self.b.inttoptr(address, BYTES)

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


#: LLVM's passes are those of this level.
_PASSES = 2

#: Text of machine code that is longer takes seconds to compile: some 50,000 instructions.
_MOST_TEXT = 2_500_000


class TooMuchCodeError(Exception):
    """There is more machine code than is worth the time of compiling it."""


class Loaded:
    """Machine code in this process. It lives as long as this object, or a function of it.

    Raises TooMuchCodeError if there is too much of it. None of LLVM's passes over its intermediate
    form is made: they took two thirds of the time and made searches no quicker (record 0082).

    What is used so little that compiling takes as long is ``hasty``: a fifth of that time, for code
    that takes up to half as long again (record 0106).
    """

    def __init__(self, module: Ir, *, hasty: bool = False) -> None:
        import llvmlite.binding as llvm

        parsed = _parsed(module)
        self._engine = llvm.create_mcjit_compiler(parsed, _target(hasty=hasty))
        self._engine.finalize_object()

    def function(self, name: str, arguments: int) -> Callable[..., int]:
        """A function of 64-bit numbers and addresses with a 64-bit result."""
        address = self._engine.get_function_address(name)
        type_ = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * arguments)
        found: Any = type_(address)
        found.engine = self._engine  # whose code it is: it is there as long as the function
        return cast("Callable[..., int]", found)


def object_of(module: Ir, *, hasty: bool = False, improved: bool = False) -> bytes:
    """The same machine code as an object that may be loaded anywhere. Raises TooMuchCodeError.

    Where it is ``improved`` by LLVM's passes, it takes three times as long to make. They keep the
    bits of what is computed: no operation is marked as one whose rounding is of no matter.
    """
    parsed = _parsed(module)
    target = _target(hasty=hasty, reloc="pic", codemodel="small")
    if improved:
        improve(parsed, target)
    return cast("bytes", target.emit_object(parsed))


def improve(parsed: llvm.ModuleRef, target: llvm.TargetMachine) -> None:
    """Run LLVM's usual passes over a module."""
    import llvmlite.binding as llvm

    builder = llvm.create_pass_builder(target, llvm.create_pipeline_tuning_options(_PASSES))
    builder.getModulePassManager().run(parsed, builder)


def _parsed(module: Ir) -> llvm.ModuleRef:
    # It takes 75 MiB of memory, and there is none of it where all code was kept.
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    text = str(module)
    if len(text) > _MOST_TEXT:
        raise TooMuchCodeError("there is too much to compile")
    parsed = llvm.parse_assembly(text)
    parsed.verify()
    return parsed


def _target(*, hasty: bool, **how: str) -> llvm.TargetMachine:
    import llvmlite.binding as llvm

    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        # What a processor has by its name may be kept from this machine.
        features=llvm.get_host_cpu_features().flatten(),
        opt=0 if hasty else 1,
        **how,
    )
