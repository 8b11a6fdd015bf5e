"""Work estimates of bodies: statements counted as often as loops and calls repeat them.

A *step* is a statement, an operator, or a part of a value that is read or written. Both branches
of an ``if`` count, as the verifier takes both. A list counts with the length that is known when the
program starts; nobody knows how it grows, so what loops over it takes may be more.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import assert_never

from msgspec import Struct, field

from koord.syntax import core
from koord.syntax.source import Span
from koord.syntax.types import ArrayType, RecordType, Robots, Type
from koord.syntax.walk import children

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
        """The most trips of a loop (1 if unknown), and the ranges of counters inside."""
        first, last = self.range(low, counters), self.range(high, counters)
        if first is None or last is None:
            return 1, {slot: r for slot, r in counters.items() if slot != variable.slot}
        count = max(0, last[1] - first[0])
        return count, {**counters, variable.slot: (first[0], max(first[0], last[1] - 1))}

    def range(self, e: core.Expr, counters: Mapping[int, Range]) -> Range | None:
        """The range of a loop bound, as far as its form tells."""
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
    """A key for a variable: hashing the variable would hash its type, part by part."""
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


#: Steps of one event, or of one statement about a configuration.
MOST_STEPS = 10_000_000

#: Expressions, blocks and calls stand inside each other at most so deep, calls followed; a loop and
#: a quantifier count twice.
MOST_DEEP = 160

#: Places of a program that are looked at before it counts as too large to be looked through.
MOST_NODES = 4_000_000


class TooLargeError(Exception):
    """Raised where a program has more places than can be searched."""


class Work(Struct, frozen=True):
    """The work of a body: ``steps``, and the nesting depth ``deep`` of its parts and calls."""

    steps: int
    deep: int

    @property
    def is_too_much(self) -> bool:
        return self.steps > MOST_STEPS or self.deep > MOST_DEEP


#: Ranges of the loop variables around a place, by slot.
Counters = Mapping[int, Range]

_NO_COUNTERS: Counters = {}

_ONE = Work(1, 1)


class WorkEstimate:
    """The work of a program's bodies, for robots of these kinds. Each function is estimated once.

    ``bound`` are the variables inside of bodies that were met on the way.
    """

    def __init__(self, program: core.Program, kinds: tuple[int, ...], sizes: TypeSizes) -> None:
        self.program = program
        self.kinds = kinds
        self.sizes = sizes
        self.functions: dict[str, Work] = {}
        self.externals: dict[str, Work] = {}
        self.bound: dict[int, tuple[core.Variable, Span]] = {}
        self._culprit: Span | None = None
        self._nodes = 0
        self._ranges = Ranges(starting_lengths(self.program), len(self.kinds))
        # In a summary, external functions are asked without their own summaries.
        self.externals = {external.name: _ONE for external in self.program.externals}
        self._work_out_functions()
        self.externals = {
            external.name: self.all((*external.requires, *external.ensures))
            for external in self.program.externals
        }
        self._work_out_functions()

    def _work_out_functions(self) -> None:
        """Estimate functions in the order of their calls, so that no chain of calls is followed."""
        for function in self.program.functions:
            self.functions[function.name] = self.block(function.body)

    # --- bodies ---------------------------------------------------------------------------------

    def body(self, parts: tuple[core.Expr, ...], block: core.Block) -> tuple[Work, Span | None]:
        """The work of expressions and a block that are evaluated as one."""
        self._culprit = None
        before, behind = self.all(parts), self.block(block)
        work = Work(before.steps + behind.steps, max(before.deep, behind.deep))
        return work, self._culprit

    def all(self, parts: Iterable[core.Node], counters: Counters = _NO_COUNTERS) -> Work:
        """The work of several parts of a program under one step."""
        return self._beside(*[self.of(part, counters) for part in parts])

    def block(self, block: core.Block, counters: Counters = _NO_COUNTERS) -> Work:
        """The work of statements in order."""
        work = self.all(block, counters)
        return Work(work.steps - 1, work.deep - 1)

    def of(self, node: core.Node, counters: Counters) -> Work:
        """The work of a statement, expression, place or step, with all parts."""
        match node:
            case core.FieldStep():
                return _ONE
            case core.IndexStep(index=index) | core.KeyStep(key=index):
                return self.of(index, counters)
        self._count()
        match node:
            case core.Read(place=place):
                return self.of(place, counters)
            case core.Place():
                return self._place(node, counters)
            case core.Call(function=name, arguments=items):
                called = self._beside(self.all(items, counters), self.functions[name])
                return self._noted(node, called)
            case core.ExternalCall(function=name, arguments=items):
                called = self._beside(self.all(items, counters), self.externals[name])
                return self._noted(node, called)
            case core.Quantified():
                return self._quantified(node, counters)
            case core.Ran(robot=robot) | core.Stopped(robot=robot):
                return self._often(node, len(self.kinds), self.of(robot, counters), _ONE)
            case core.ForRange(variable=variable, low=low, high=high, body=body):
                count, inner = self._trips(node, variable, low, high, counters)
                bounds = self.all((low, high), counters)
                return self._often(node, count, bounds, self.block(body, inner))
            case core.ForEach(sequence=sequence, key=key, body=body):
                count = self._length(node, sequence)
                inner = dict(counters)
                if key is not None:
                    inner[key.slot] = (0, max(0, count - 1))
                over = self.of(sequence, counters)
                return self._often(node, count, over, self.block(body, inner))
            case _:
                return self.all(children(node), counters)

    def _place(self, place: core.Place, counters: Counters) -> Work:
        """The work of a place that is read or written: one step for each part."""
        if place.variable.home is core.Home.BOUND:
            self.bound.setdefault(id(place.variable), (place.variable, place.span))
        parts = self.sizes.of(place.type).parts
        below = [*place.steps, *([] if place.robot is None else [place.robot])]
        work = self.all(below, counters)
        return Work(work.steps - 1 + parts, work.deep)

    def _quantified(self, e: core.Quantified, counters: Counters) -> Work:
        match e.domain:
            case core.RobotRange(agent=agent):
                count = sum(agent is None or kind == agent for kind in self.kinds)
                inner = {**counters, e.variable.slot: (0, len(self.kinds) - 1)}
                return self._often(e, count, _ONE, self.of(e.body, inner))
            case core.IntRange(low=low, high=high):
                count, inner = self._trips(e, e.variable, low, high, counters)
                bounds = self.all((low, high), counters)
                return self._often(e, count, bounds, self.of(e.body, inner))
            case core.Elements(sequence=sequence):
                count = self._length(e, sequence)
                over = self.of(sequence, counters)
                return self._often(e, count, over, self.of(e.body, counters))
            case core.AllValues():
                return self._beside(self.of(e.body, counters))
        assert_never(e.domain)

    def _trips(
        self,
        node: core.Node,
        variable: core.Variable,
        low: core.Expr,
        high: core.Expr,
        counters: Counters,
    ) -> tuple[int, dict[int, Range]]:
        """The most trips of a loop that counts (1 if unknown), and the counters inside."""
        return self._ranges.trips(variable, low, high, counters)

    def _length(self, node: core.Node, sequence: core.Expr) -> int:
        """The trips of a loop over a sequence (1 if unknown)."""
        return self._ranges.length(sequence) or 1

    # --- sums -----------------------------------------------------------------------------------

    def _beside(self, *parts: Work) -> Work:
        return Work(
            1 + sum(part.steps for part in parts),
            1 + max((part.deep for part in parts), default=0),
        )

    def _often(self, node: core.Node, count: int, once: Work, body: Work) -> Work:
        steps = 1 + once.steps + count * (1 + body.steps)
        # A loop takes the room of two other statements on the stack of whoever evaluates it.
        return self._noted(node, Work(steps, 2 + max(once.deep, body.deep)))

    def _noted(self, node: core.Node, work: Work) -> Work:
        """Record the innermost place at which a body becomes too large."""
        if self._culprit is None and work.is_too_much:
            self._culprit = node.span
        return work

    def _count(self) -> None:
        self._nodes += 1
        if self._nodes > MOST_NODES:
            raise TooLargeError


class Size(Struct, frozen=True):
    """The size of a type: ``parts`` counts scalars (one element of a list), ``depth`` types."""

    parts: int
    depth: int


_SCALAR = Size(1, 1)


class TypeSizes(Struct):
    """Sizes of types for a number of robots.

    They are remembered by identity: records may share their parts so often that whoever walks
    through all of them (as hashing does) comes to no end.
    """

    robots: int
    _known: dict[int, tuple[Type, Size]] = field(default_factory=dict)

    def of(self, type_: Type) -> Size:
        """The size of a type, whatever its depth."""
        waiting = [type_]
        while waiting:
            current = waiting[-1]
            missing = [part for part in current.parts if id(part) not in self._known]
            if missing:
                waiting += missing
                continue
            waiting.pop()
            self._known[id(current)] = (current, self._size(current))
        return self._known[id(type_)][1]

    def _size(self, type_: Type) -> Size:
        below = [self._known[id(part)][1] for part in type_.parts]
        if not below:
            return Size(1, 1) if isinstance(type_, RecordType) else _SCALAR
        parts = sum(size.parts for size in below)
        if isinstance(type_, ArrayType):
            parts *= self.robots if type_.size is Robots.ALL else type_.size
        return Size(max(1, parts), 1 + max(size.depth for size in below))
