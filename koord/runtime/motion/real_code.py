"""Machine code of doubles that calls the system's library of mathematics, by addresses."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import numpy as np

from koord.machine.code import BYTES, F64, I64, Code, Ir, word
from koord.machine.lanes import DOUBLE_BYTES, Lane, Lanes
from koord.runtime.motion.arrays import Ints

#: Functions of the library, in the order of their addresses.
_LIBRARY = ("sin", "cos", "atan2", "asin", "acos", "fmod", "ceil")


@cache
def library() -> Ints | None:
    """The addresses of the functions of the library, as words; None if they are not known."""
    try:
        known = ctypes.CDLL(None)
        found = [ctypes.cast(getattr(known, name), ctypes.c_void_p).value for name in _LIBRARY]
    except (AttributeError, OSError, TypeError):
        return None
    return np.array(found, np.int64)


class RealCode:
    """The body of a function of machine code that may call the functions of the library."""

    def __init__(
        self, module: Ir, name: str, blocks: int = 0, reals: int = 0, whole: int = 0
    ) -> None:
        """Begin a function of the address of the library, of blocks, and of doubles behind them.

        Or one of ``whole`` numbers alone, which says itself where the library is.
        """
        types = [I64] * whole if whole else [BYTES] * (1 + blocks) + [F64] * reals
        self.code = code = Code(module, name, types, I64)
        self.b, self.lanes = code.b, Lanes(code, 1)
        self.whole_numbers = code.arguments[:whole]
        self.library = code.arguments[0]
        self.blocks = code.arguments[1 : 1 + blocks]
        self.numbers = [Lane(self.lanes, one) for one in code.arguments[1 + blocks :]]

    def call(self, name: str, *arguments: Lane) -> Lane:
        """Call a function of the library."""
        address = self.code.get(self.library, DOUBLE_BYTES * _LIBRARY.index(name), I64)
        return Lane(self.lanes, self.code.called_real(address, [one.ir for one in arguments]))

    def number(self, number: float) -> Lane:
        return self.lanes.constant(number)

    def size(self, number: Lane) -> Lane:
        """How large a number is without its sign."""
        return number.signed_as(self.number(1.0))

    def sine_cosine(self, angle: Lane) -> tuple[Lane, Lane]:
        return self.call("sin", angle), self.call("cos", angle)

    def unwound(self, angle: Lane) -> Lane:
        """The angle from -π to π of a direction."""
        whole = self.number(2 * math.pi)
        rest = self.slot(angle)
        with self.code.only_if(self.b.not_(self.size(angle).is_below(whole))):
            self.set(rest, self.call("fmod", angle, whole))
        found = self.of(rest)
        below, above = found.is_below(-math.pi), self.number(math.pi).is_below(found)
        return (found + 2 * math.pi).where(below, (found - 2 * math.pi).where(above, found))

    # --- memory ---------------------------------------------------------------------------------

    def slot(self, number: Lane) -> Ir:
        """Memory of this call for a number."""
        found = self.code.slot(F64)
        self.set(found, number)
        return found

    def set(self, slot: Ir, number: Lane) -> None:
        self.b.store(number.ir, slot)

    def of(self, slot: Ir) -> Lane:
        return Lane(self.lanes, self.b.load(slot))

    def get(self, block: Ir, entry: int, index: Ir | None = None) -> Lane:
        """A number of a block: an entry, or one so many behind it."""
        return self.lanes.get(block, self._offset(entry, index))

    def put(self, block: Ir, entry: int, number: Lane, index: Ir | None = None) -> None:
        self.lanes.put(block, self._offset(entry, index), number)

    def _offset(self, entry: int, index: Ir | None) -> Ir | int:
        first = entry * DOUBLE_BYTES
        if index is None:
            return first
        return self.b.add(word(first), self.b.mul(index, word(DOUBLE_BYTES)))

    def whole(self, block: Ir, entry: int) -> Ir:
        return self.code.get(block, entry * DOUBLE_BYTES, I64)

    def put_whole(self, block: Ir, entry: int, number: Ir) -> None:
        self.code.put(block, entry * DOUBLE_BYTES, number)

    # --- the end --------------------------------------------------------------------------------

    @contextmanager
    def leaves(self, condition: Ir, result: Ir) -> Iterator[None]:
        """Return a result where a condition holds; what is done before is in the block."""
        with self.code.only_if(condition):
            yield
            self.b.ret(result)

    def leave(self, condition: Ir, result: int = 0) -> None:
        """Return where a condition holds."""
        with self.leaves(condition, word(result)):
            pass
