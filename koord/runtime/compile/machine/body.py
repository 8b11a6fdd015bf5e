"""The body of a turn in machine code: cells, doubt, and what a value is there.

Machine code of a turn is *sure, or in doubt* (decision record 0102): where something faults, is not
set, is no number, or has more than 64 bits, it says that it is in doubt, and nothing else of it
counts: the compiled robot makes the turn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

from msgspec import Struct

from koord.machine.code import BYTES, F64, I1, I8, I64, Code, Ir, constant, word
from koord.runtime.compile.machine.layout import (
    KNOWN,
    WRITTEN,
    Column,
    Layout,
    Leaf,
    NoCodeError,
    leaves,
)
from koord.syntax import core
from koord.syntax.types import Type, show

#: A number that is known when code is made, or computed by it.
Position: TypeAlias = int | Ir

#: A value: its leaves, as 64-bit integers, doubles and bits.
Value: TypeAlias = list[Ir]

#: So much of a program is compiled: nodes, with what they call written out, and leaves that they
#: load and store. A thousand take some 200 ms. What is left over is left to robots.
_MOST_WORK = 2_000


class Budget(Struct):
    """How much more of a program may be compiled."""

    left: int = _MOST_WORK

    def spend(self, work: int) -> None:
        """Take note of work. Raises NoCodeError if it is too much."""
        if self.left < work:
            raise NoCodeError("too long")
        self.left -= work


#: What every function of a turn is given (``STATE_WORDS``).
STATE = (BYTES, BYTES, BYTES, BYTES, I64, I64)


class Cells(Struct):
    """Where the leaves of a value lie: blocks of words and of flags, and where in both a leaf is.

    The number of the leaf may be computed.
    """

    words: Ir
    flags: Ir
    index: Callable[[Position], Ir]
    is_banked: bool = False  #: whether what is written there is what an event writes


class Frame(Struct):
    """The variables of a body or of a function that is written out, and where it returns to."""

    bound: dict[tuple[int, str], Cells]
    result: Cells | None = None
    type: Type | None = None
    after: Ir = None


class Body:
    """The body of a function for one robot, ``robot``; ``doubtful`` is where it is in doubt.

    ``block`` compiles the statements of functions that are called.
    """

    def __init__(
        self,
        code: Code,
        program: core.Program,
        layout: Layout,
        kind: int,
        state: Sequence[Ir],
        robot: Ir,
        doubtful: Ir,
        block: Callable[[Body, core.Block], None],
        budget: Budget,
    ) -> None:
        self.code, self.b = code, code.b
        self.program, self.layout, self.kind = program, layout, kind
        rows, self.row_flags, shared, self.shared_flags, self.count, delta = state
        self.rows, self.shared = self.as_words(rows), self.as_words(shared)
        self.delta = self.b.bitcast(delta, F64)
        self.robot, self.doubtful, self.block = robot, doubtful, block
        self.frame = Frame({})
        self.loops: list[Ir] = []  #: where ``break`` leads
        #: Words of what an event has asked for: locks, and to stop.
        #: The cells of what the event writes; empty in guards.
        self.banked: dict[int, Cells] = {}
        self.locks: Ir = None
        self.asked: Ir = None
        self.budget = budget
        #: Of a claim, the robots that bound variables stand for, with their kinds, by slot; None of
        #: a kind that is not known. None in turns.
        self.watched: dict[int, tuple[Ir, int | None]] | None = None

    # --- doubt ------------------------------------------------------------------------------------

    def doubt_if(self, condition: Ir) -> None:
        """Be in doubt where a condition holds."""
        sure = self.b.append_basic_block("sure")
        self.b.cbranch(condition, self.doubtful, sure)
        self.b.position_at_end(sure)

    def leave_for(self, block: Ir) -> None:
        """Go on elsewhere; what is written next is never reached."""
        self.b.branch(block)
        self.b.position_at_end(self.b.append_basic_block("unreached"))

    # --- cells ------------------------------------------------------------------------------------

    def sum(self, one: Position, other: Position) -> Position:
        """The sum of two numbers, at once if both are known."""
        if isinstance(one, int) and isinstance(other, int):
            return one + other
        if one == 0:
            return other
        return one if other == 0 else self.b.add(as_word(one), as_word(other))

    def cells_at(self, words: Ir, flags: Ir, first: int) -> Cells:
        """Cells that lie one after the other."""
        return Cells(words, flags, lambda leaf: as_word(self.sum(leaf, first)))

    def cells_of(self, column: Column, robot: Ir) -> Cells:
        """The cells of a robot in a column of rows."""
        b, first = self.b, column.first

        def index(leaf: Position) -> Ir:
            return b.add(b.mul(as_word(self.sum(leaf, first)), self.count), robot)

        return Cells(self.rows, self.row_flags, index)

    def bound(self, variable: core.Variable) -> Cells:
        """The cells of a bound variable of the open frame; none of them is set at first."""
        key = (variable.slot, show(variable.type))
        if key not in self.frame.bound:
            self.frame.bound[key] = self.local(variable.type)
        return self.frame.bound[key]

    def local(self, type_: Type, several: int = 1) -> Cells:
        """Cells of this call for some values of a type; the first is not known at first."""
        count = len(leaves(type_)) * several
        cells = self.cells_at(self.code.slot(I64, count), self.code.slot(I8, count), 0)
        with self.b.goto_entry_block():
            self.forget(cells, type_, flags=0)
        return cells

    def forget(self, cells: Cells, type_: Type, *, flags: int) -> None:
        """Let cells be zero, with the same flags."""
        for leaf in range(len(leaves(type_))):
            index = cells.index(leaf)
            self.b.store(word(0), self.b.gep(cells.words, [index]))
            self.b.store(constant(I8, flags), self.b.gep(cells.flags, [index]))

    def load(self, cells: Cells, first: Position, type_: Type) -> Value:
        """The leaves from one on. In doubt if any of them is not known. [LOOKUP] [ATOM]"""
        b, found = self.b, []
        self.budget.spend(len(leaves(type_)))
        known = constant(I8, KNOWN)
        for number, leaf in enumerate(leaves(type_)):
            index = cells.index(self.sum(first, number))
            known = b.and_(known, b.load(b.gep(cells.flags, [index])))
            found.append((leaf, b.load(b.gep(cells.words, [index]))))
        self.doubt_if(b.icmp_unsigned("!=", known, constant(I8, KNOWN)))
        return [self.from_word(leaf, bits) for leaf, bits in found]

    def store(self, cells: Cells, first: Position, type_: Type, value: Value) -> None:
        """Store leaves from one on. In doubt if a NaN is to be kept."""
        b, kinds = self.b, leaves(type_)
        assert len(kinds) == len(value)
        self.budget.spend(len(kinds))
        if cells.is_banked:
            for leaf, new in zip(kinds, value, strict=True):
                if leaf is Leaf.FLOAT:
                    self.doubt_if(b.fcmp_unordered("uno", new, new))
        for number, (leaf, new) in enumerate(zip(kinds, value, strict=True)):
            index = cells.index(self.sum(first, number))
            b.store(self.to_word(leaf, new), b.gep(cells.words, [index]))
            b.store(constant(I8, KNOWN | WRITTEN), b.gep(cells.flags, [index]))

    # --- leaves -----------------------------------------------------------------------------------

    def from_word(self, leaf: Leaf, bits: Ir) -> Ir:
        match leaf:
            case Leaf.INT:
                return bits
            case Leaf.FLOAT:
                return self.b.bitcast(bits, F64)
            case Leaf.BOOL:
                return self.b.icmp_unsigned("!=", bits, word(0))

    def to_word(self, leaf: Leaf, value: Ir) -> Ir:
        match leaf:
            case Leaf.INT:
                return value
            case Leaf.FLOAT:
                return self.b.bitcast(value, I64)
            case Leaf.BOOL:
                return self.b.zext(value, I64)

    def as_words(self, block: Ir) -> Ir:
        """A block of bytes as words."""
        return self.b.bitcast(block, I64.as_pointer())

    def bit(self, truth: bool) -> Ir:
        """A Boolean constant."""
        return constant(I1, int(truth))


def as_word(number: Position) -> Ir:
    """A number as one of 64 bits."""
    return word(number) if isinstance(number, int) else number
