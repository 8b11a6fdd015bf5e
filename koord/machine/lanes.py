"""Doubles side by side: the same arithmetic on as many numbers as a register holds.

Each operation is that of IEEE 754 on each lane by itself, rounded once. Nothing is fused and
nothing reordered, so that how many lanes there are is no matter of what comes out, and what NumPy
computes by the same operations in the same order is equal to the last bit. The sign of a NaN is
left open.
"""

from __future__ import annotations

from llvmlite import ir

from koord.machine.code import F64, I32, Code, Ir
from koord.machine.processor import abilities

DOUBLE_BYTES = 8


def widest() -> int:
    """The doubles that a register of this processor holds."""
    known = abilities()
    if not known:  # not told here: LLVM asks the processor itself
        import llvmlite.binding as llvm

        known = frozenset(name for name, has in llvm.get_host_cpu_features().items() if has)
    if "avx512f" in known:
        return 8
    return 4 if "avx" in known else 2


class Lanes:
    """Values of ``width`` doubles in the body of a function; one is a plain number."""

    def __init__(self, code: Code, width: int) -> None:
        self.code = code
        self.width = width
        self.type = F64 if width == 1 else ir.VectorType(F64, width)
        self.bytes = DOUBLE_BYTES * width

    def constant(self, number: float) -> Lane:
        """A number in all lanes."""
        value = float(number)
        return Lane(
            self, ir.Constant(self.type, value if self.width == 1 else [value] * self.width)
        )

    def spread(self, number: Ir) -> Lane:
        """A double in all lanes."""
        if self.width == 1:
            return Lane(self, number)
        nothing = ir.Constant(self.type, ir.Undefined)
        first = self.code.b.insert_element(nothing, number, ir.Constant(I32, 0))
        zeros = ir.Constant(ir.VectorType(I32, self.width), [0] * self.width)
        return Lane(self, self.code.b.shuffle_vector(first, nothing, zeros))

    def get(self, block: Ir, offset: Ir | int) -> Lane:
        """Load doubles that lie one after the other."""
        return Lane(self, self.code.get(block, offset, self.type))

    def put(self, block: Ir, offset: Ir | int, value: Lane) -> None:
        """Store doubles one after the other."""
        self.code.put(block, offset, value.ir)


class Lane:
    """A double in each lane. Plain numbers stand for themselves in all lanes."""

    __slots__ = ("ir", "lanes")

    def __init__(self, lanes: Lanes, value: Ir) -> None:
        self.lanes = lanes
        self.ir = value

    def __add__(self, other: Number) -> Lane:
        return self._both("fadd", self, other)

    def __radd__(self, other: float) -> Lane:
        return self._both("fadd", other, self)

    def __sub__(self, other: Number) -> Lane:
        return self._both("fsub", self, other)

    def __rsub__(self, other: float) -> Lane:
        return self._both("fsub", other, self)

    def __mul__(self, other: Number) -> Lane:
        return self._both("fmul", self, other)

    def __rmul__(self, other: float) -> Lane:
        return self._both("fmul", other, self)

    def __truediv__(self, other: Number) -> Lane:
        return self._both("fdiv", self, other)

    def __rtruediv__(self, other: float) -> Lane:
        return self._both("fdiv", other, self)

    def __neg__(self) -> Lane:
        return Lane(self.lanes, self.lanes.code.b.fneg(self.ir))

    def sqrt(self) -> Lane:
        """The square root, rounded once."""
        return self._called("sqrt", self)

    def signed_as(self, other: Lane) -> Lane:
        """A number with the size of this one and the sign of another, as ``np.copysign``."""
        return self._called("copysign", self, other)

    def at_most(self, bound: Number) -> Lane:
        """The lesser of this and a bound that is no NaN, as ``np.minimum``: a NaN stays one.

        Of zeros it is this one.
        """
        return self._chosen("<", bound)

    def at_least(self, bound: Number) -> Lane:
        """The greater of this and a bound that is no NaN, as ``np.maximum``: a NaN stays one.

        Of zeros it is this one.
        """
        return self._chosen(">", bound)

    def lesser(self, other: Number) -> Lane:
        """The lesser of two, as ``np.minimum``: a NaN stays one; of zeros it is the other."""
        end = self._lifted(other)
        return self.where(self.lanes.code.b.fcmp_unordered("<", self.ir, end.ir), end)

    def greater(self, other: Number) -> Lane:
        """The greater of two, as ``np.maximum``: a NaN stays one; of zeros it is the other."""
        end = self._lifted(other)
        return self.where(self.lanes.code.b.fcmp_unordered(">", self.ir, end.ir), end)

    def is_below(self, other: Number) -> Ir:
        """Whether this is less, as a mask; a NaN is not."""
        return self.lanes.code.b.fcmp_ordered("<", self.ir, self._lifted(other).ir)

    def is_at_most(self, other: Number) -> Ir:
        """Whether this is less or equal, as a mask; a NaN is not."""
        return self.lanes.code.b.fcmp_ordered("<=", self.ir, self._lifted(other).ir)

    def where(self, mask: Ir, other: Number) -> Lane:
        """What is this one where a mask says so, and elsewhere another."""
        chosen = self.lanes.code.b.select(mask, self.ir, self._lifted(other).ir)
        return Lane(self.lanes, chosen)

    def _chosen(self, relation: str, bound: Number) -> Lane:
        end = self._lifted(bound)
        beyond = self.lanes.code.b.fcmp_ordered(relation, end.ir, self.ir)
        return end.where(beyond, self)

    def _both(self, operation: str, one: Number, other: Number) -> Lane:
        left, right = self._lifted(one), self._lifted(other)
        return Lane(self.lanes, getattr(self.lanes.code.b, operation)(left.ir, right.ir))

    def _called(self, name: str, *arguments: Lane) -> Lane:
        given = [argument.ir for argument in arguments]
        width = self.lanes.width
        mangled = f"llvm.{name}.f64" if width == 1 else f"llvm.{name}.v{width}f64"
        return Lane(self.lanes, self.lanes.code.known(mangled, self.lanes.type, given))

    def _lifted(self, number: Number) -> Lane:
        return number if isinstance(number, Lane) else self.lanes.constant(number)


#: What stands beside a lane in an operation.
Number = Lane | float
