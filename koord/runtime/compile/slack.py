"""Slack: claims about exact numbers, loosened for physical vehicles.

A vehicle is near to where its program has it be. So comparisons of floats that a claim hangs on
are loosened by the slack where they count for it, and tightened where they count against it::

    a ≤ b   becomes   a ≤ b + slack, or a ≤ b − slack where it is a supposition
    a = b   becomes   |a − b| ≤ slack, and stays as it is where it is a supposition

What a function answers is looked at in the same way, as far as its body shows what counts for its
answer. So with slack a claim never says more than without.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from fractions import Fraction

from msgspec import Struct, field
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, UnaryOp
from koord.syntax.types import BOOL, FLOAT, FloatType, RecordType, Type
from koord.syntax.walk import with_blocks


class Side(Enum):
    """The polarity of a Boolean expression in a claim."""

    FOR = 1
    AGAINST = -1
    BOTH = 0

    @property
    def other(self) -> Side:
        return Side(-self.value)


class Loosening(Struct):
    """The loosening of a program's claims, with the functions that it generates."""

    program: core.Program
    slack: Fraction
    functions: dict[str, core.Function] = field(default_factory=dict)

    def expression(self, e: core.Expr, side: Side = Side.FOR) -> core.Expr:
        """Loosen a Boolean expression."""
        if side is Side.BOTH or not self.slack:
            return e
        return self._loose(e, side, {})

    def _loose(self, e: core.Expr, side: Side, variables: dict[int, Side]) -> core.Expr:
        match e:
            case core.Binary(op=BinaryOp.AND | BinaryOp.OR, left=left, right=right):
                made = self._loose(left, side, variables), self._loose(right, side, variables)
                return replace(e, left=made[0], right=made[1])
            case core.Binary(op=BinaryOp.IMPLIES, left=left, right=right):
                supposed = self._loose(left, side.other, variables)
                return replace(e, left=supposed, right=self._loose(right, side, variables))
            case core.Unary(op=UnaryOp.NOT, operand=operand):
                return replace(e, operand=self._loose(operand, side.other, variables))
            case core.Quantified(body=body):
                return replace(e, body=self._loose(body, side, variables))
            case core.Binary(op=BinaryOp.LT | BinaryOp.LE, left=left) if _is_float(left.type):
                return self._order(e, side)
            case core.Binary(op=BinaryOp.EQ | BinaryOp.NE):
                return self._equality(e, side)
            case core.Call(function=name) if e.type == BOOL:
                return replace(e, function=self._function(name, side))
            case _:
                return e

    def _order(self, e: core.Binary, side: Side) -> core.Expr:
        amount = core.Const(self.slack * side.value, FLOAT)
        return replace(e, right=core.Binary(BinaryOp.ADD, e.right, amount, FLOAT))

    def _equality(self, e: core.Binary, side: Side) -> core.Expr:
        """Equality where it counts for the claim, inequality where it counts against it."""
        counts = side is Side.FOR if e.op is BinaryOp.EQ else side is Side.AGAINST
        parts = list(_floats(e.left, e.right))
        if not counts or not parts:
            return e
        near: core.Expr = self._near(*parts[0])
        for left, right in parts[1:]:
            near = core.Binary(BinaryOp.AND, near, self._near(left, right), BOOL)
        return near if e.op is BinaryOp.EQ else core.Unary(UnaryOp.NOT, near, BOOL)

    def _near(self, left: core.Expr, right: core.Expr) -> core.Expr:
        gap = core.Binary(BinaryOp.SUB, left, right, FLOAT)
        size = core.Unary(UnaryOp.ABS, gap, FLOAT)
        return core.Binary(BinaryOp.LE, size, core.Const(self.slack, FLOAT), BOOL)

    # --- functions ------------------------------------------------------------------------------

    def _function(self, name: str, side: Side) -> str:
        """The name of a loosened function, which is generated if need be."""
        loose = f"{name} {side.name.lower()}"
        if loose not in self.functions:
            function = self.program.function(name)
            variables = self._sides(function, side)
            body = self._block(function.body, side, variables)
            self.functions[loose] = replace(function, name=loose, body=body)
        return loose

    def _sides(self, function: core.Function, side: Side) -> dict[int, Side]:
        """The polarity of each Boolean variable of a function, by its reads."""
        found: dict[int, Side] = {}
        for slot, one in _reads(function.body, side):
            found[slot] = one if found.get(slot, one) is one else Side.BOTH
        return found

    def _block(self, block: core.Block, side: Side, variables: dict[int, Side]) -> core.Block:
        return tuple(self._statement(s, side, variables) for s in block)

    def _statement(self, s: core.Stmt, side: Side, variables: dict[int, Side]) -> core.Stmt:
        match s:
            case core.Return(value=value) if value is not None:
                return replace(s, value=self._loose(value, side, variables))
            case core.Assign(place=place, value=value) if value.type == BOOL:
                counts = Side.BOTH
                if place.variable.home is Home.BOUND and not place.steps:
                    counts = variables.get(place.variable.slot, Side.BOTH)
                if counts is Side.BOTH:
                    return s
                return replace(s, value=self._loose(value, counts, variables))
            case core.If(condition=condition, then=then):
                counts = _side_of_condition(then, side)
                if counts is not Side.BOTH:
                    condition = self._loose(condition, counts, variables)
                s = replace(s, condition=condition)
        return with_blocks(s, lambda block: self._block(block, side, variables))


def loosened(program: core.Program, slack: Fraction) -> core.Program:
    """The program with slack in its assumptions and contracts, which are taken for granted."""
    loosening = Loosening(program, slack)

    def contract(one: core.Contract) -> core.Contract:
        return replace(one, ensures=tuple(map(loosening.expression, one.ensures)))

    agents = tuple(
        replace(
            agent,
            modules=tuple(
                replace(module, contracts=tuple(map(contract, module.contracts)))
                for module in agent.modules
            ),
        )
        for agent in program.agents
    )
    assumptions = tuple(
        replace(one, condition=loosening.expression(one.condition)) for one in program.assumptions
    )
    functions = (*program.functions, *loosening.functions.values())
    return replace(program, agents=agents, assumptions=assumptions, functions=functions)


def _side_of_condition(then: core.Block, side: Side) -> Side:
    """The polarity of a condition, by the answer where it is true."""
    match then:
        case (core.Return(value=core.Const(value=True)),):
            return side
        case (core.Return(value=core.Const(value=False)),):
            return side.other
        case _:
            return Side.BOTH


def _reads(block: core.Block, side: Side) -> Iterator[tuple[int, Side]]:
    """Yield the Boolean variables that are read in a block, with each read's polarity."""
    for s in block:
        match s:
            case core.Return(value=value) if value is not None:
                yield from _reads_in(value, side)
            case core.If(condition=condition, then=then, otherwise=otherwise):
                yield from _reads_in(condition, _side_of_condition(then, side))
                yield from _reads((*then, *otherwise), side)
            case core.ForRange(body=body) | core.ForEach(body=body) | core.Atomic(body=body):
                yield from _reads(body, side)
            case core.Assign(value=value):
                yield from _reads_in(value, Side.BOTH)
            case _:
                pass


def _reads_in(e: core.Expr, side: Side) -> Iterator[tuple[int, Side]]:
    match e:
        case core.Read(place=core.Place(variable=variable, steps=())):
            if variable.home is Home.BOUND and variable.type == BOOL:
                yield variable.slot, side
        case core.Binary(op=BinaryOp.AND | BinaryOp.OR, left=left, right=right):
            yield from (*_reads_in(left, side), *_reads_in(right, side))
        case core.Binary(op=BinaryOp.IMPLIES, left=left, right=right):
            yield from (*_reads_in(left, side.other), *_reads_in(right, side))
        case core.Unary(op=UnaryOp.NOT, operand=operand):
            yield from _reads_in(operand, side.other)
        case core.Binary(left=left, right=right):
            yield from (*_reads_in(left, Side.BOTH), *_reads_in(right, Side.BOTH))
        case core.Quantified(body=body):
            yield from _reads_in(body, side)
        case core.Call(arguments=arguments) | core.ExternalCall(arguments=arguments):
            for argument in arguments:
                yield from _reads_in(argument, Side.BOTH)
        case _:
            pass


def _is_float(type_: Type) -> bool:
    return isinstance(type_, FloatType)


def _floats(left: core.Expr, right: core.Expr) -> Iterator[tuple[core.Expr, core.Expr]]:
    """Yield pairs of floats in two values of one type; none if they contain anything else."""
    match left.type:
        case FloatType():
            yield left, right
        case RecordType(fields=fields) if all(_is_float(type_) for _, type_ in fields):
            for position, (name, type_) in enumerate(fields):
                step = core.FieldStep(position, name, type_)
                yield core.Select(left, step), core.Select(right, step)
        case _:
            pass
