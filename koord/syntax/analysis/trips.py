"""How often loops go round: between which numbers their bounds lie, and how long lists are."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct

from koord.syntax import core
from koord.syntax.types import ArrayType, Robots

#: From and up to which number a counter goes, both included.
Range = tuple[int, int]

Key = tuple[core.Home, int, str]


class Ranges(Struct, frozen=True):
    """The bounds of loops, given the lengths that lists start with and the number of robots."""

    lengths: Mapping[Key, int]
    robots: int

    def trips(
        self,
        variable: core.Variable,
        low: core.Expr,
        high: core.Expr,
        counters: Mapping[int, Range],
    ) -> tuple[int, dict[int, Range]]:
        """How often a loop goes round at most, and the counters inside. Once, if nobody knows."""
        first, last = self.range(low, counters), self.range(high, counters)
        if first is None or last is None:
            return 1, {slot: r for slot, r in counters.items() if slot != variable.slot}
        count = max(0, last[1] - first[0])
        return count, {**counters, variable.slot: (first[0], max(first[0], last[1] - 1))}

    def range(self, e: core.Expr, counters: Mapping[int, Range]) -> Range | None:
        """Between which numbers the bound of a loop lies, as far as its form tells."""
        match e:
            case core.Const(value=int() as value):
                return (value, value)
            case core.Pid():
                return (0, self.robots - 1)
            case core.NumAgents():
                return (self.robots, self.robots)
            case core.Builtin(op=core.ListOp.LENGTH, arguments=(over,)):
                # Whatever is added to it counts, where nobody knows how long a list is, too.
                return (0, self.length(over) or 1)
            case core.Read(place=core.Place(variable=variable, steps=())):
                return counters.get(variable.slot) if variable.home is core.Home.BOUND else None
            case core.Unary(op=op, operand=operand):
                return _unary(op, self.range(operand, counters))
            case core.Binary(op=op, left=left, right=right):
                return _binary(op, self.range(left, counters), self.range(right, counters))
            case _:
                return None

    def length(self, over: core.Expr) -> int | None:
        """The length of an array, or of a list when the program starts."""
        if isinstance(over.type, ArrayType):
            return self.robots if over.type.size is Robots.ALL else over.type.size
        match over:
            case core.MakeList(items=items):
                return len(items)
            case core.MakeMap(entries=entries):
                return len(entries)
            case core.Read(place=core.Place(variable=variable, steps=steps)):
                whole = () if variable.home is not core.Home.ALLREAD else steps[:1]
                return self.lengths.get(_key(variable)) if steps == whole else None
            case _:
                return None


def _key(variable: core.Variable) -> Key:
    """What stands for a variable: hashing it would hash its type, part by part."""
    return (variable.home, variable.slot, variable.name)


def starting_lengths(program: core.Program) -> dict[Key, int]:
    """The lengths of lists as they are declared, or as the assumptions fix them."""
    shared = (*program.allread, *program.allwrite)
    own = [d for agent in program.agents for d in agent.locals]
    ports = [port.declaration for agent in program.agents for port in agent.ports]
    found: dict[Key, int] = {}
    for declaration in (*shared, *own, *ports):
        length = declaration.length
        match declaration.initial:
            case core.MakeList(items=items):
                length = len(items)
            case core.MakeMap(entries=entries):
                length = len(entries)
        if length is not None:
            key = _key(declaration.variable)
            found[key] = max(length, found.get(key, 0))
    return found


def _unary(op: core.UnaryOp, operand: Range | None) -> Range | None:
    if operand is None:
        return None
    low, high = operand
    match op:
        case core.UnaryOp.NEG:
            return (-high, -low)
        case core.UnaryOp.ABS:
            least = 0 if low <= 0 <= high else min(abs(low), abs(high))
            return (least, max(abs(low), abs(high)))
        case _:
            return None


def _binary(op: core.BinaryOp, left: Range | None, right: Range | None) -> Range | None:
    if left is None or right is None:
        return None
    match op:
        case core.BinaryOp.ADD:
            return (left[0] + right[0], left[1] + right[1])
        case core.BinaryOp.SUB:
            return (left[0] - right[1], left[1] - right[0])
        case core.BinaryOp.MUL:
            corners = [a * b for a in left for b in right]
            return (min(corners), max(corners))
        case core.BinaryOp.MIN:
            return (min(left[0], right[0]), min(left[1], right[1]))
        case core.BinaryOp.MAX:
            return (max(left[0], right[0]), max(left[1], right[1]))
        case core.BinaryOp.DIV | core.BinaryOp.MOD:
            # Neither is farther from zero than the dividend, or the divisor.
            far = max(map(abs, (*left, *right)))
            return (-far, far)
        case _:
            return None
