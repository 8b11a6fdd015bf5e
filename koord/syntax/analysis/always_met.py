"""Sensors for which some reading always satisfies the contracts. [AUXILIARY]

This is read off the text, on the safe side: each promise that speaks of the reading bounds it, all
of them from the same side, or one alone says what it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

from koord.syntax import core
from koord.syntax.analysis.definedness import Sure
from koord.syntax.core import BinaryOp, Direction, Home, UnaryOp
from koord.syntax.system import System
from koord.syntax.types import FloatType, IntType
from koord.syntax.walk import nodes, reached


class _Bound(Enum):
    """The way in which a promise restricts a reading."""

    ABOVE = "it is larger than something"
    BELOW = "it is smaller than something"
    EQUAL = "it is something"


def always_met(system: System, kind: int) -> frozenset[int]:
    """The slots of sensors, of one kind of robot, with such readings. Their promises speak of no
    other reading.

    Sensors of models are none of these: what they read is worked out.
    """
    agent = system.program.agents[kind]
    modelled = {
        position
        for module in agent.modules
        if module.environment is not None
        for position in module.ports
    }
    promises = [promise for _, promise in promises_of(agent)]
    asked = [expr for contract in _contracts(agent) for expr in contract.requires]
    if not all(_is_sure(system, kind, expr) for expr in asked):
        return frozenset()
    found = set()
    for position, port in enumerate(agent.ports):
        slot = port.declaration.variable.slot
        about = [promise for promise in promises if slot in primed(promise)]
        bounds = [bound for p in about for bound in _bounds(system, kind, slot, p)]
        alike = len(set(bounds)) <= 1 and (_Bound.EQUAL not in bounds or len(bounds) == 1)
        is_open = port.direction is Direction.SENSOR and position not in modelled
        if is_open and None not in bounds and alike:
            found.add(slot)
    return frozenset(found)


def promises_of(agent: core.Agent) -> Iterator[tuple[core.Contract, core.Expr]]:
    """Yield the promises of contracts about readings, each with its contract."""
    for contract in _contracts(agent):
        yield from ((contract, promise) for promise in contract.ensures)


def primed(promise: core.Expr) -> frozenset[int]:
    """The slots of the ports that a promise reads after the turn."""
    return frozenset(
        node.variable.slot
        for node in nodes(promise)
        if isinstance(node, core.Place) and node.primed
    )


def _contracts(agent: core.Agent) -> Iterator[core.Contract]:
    for module in agent.modules:
        if module.environment is None:
            yield from module.contracts


def _bounds(system: System, kind: int, slot: int, promise: core.Expr) -> Iterator[_Bound | None]:
    """Yield the restrictions that a promise puts on a reading; None where it is not simple."""
    match promise:
        case core.Binary(op=BinaryOp.AND, left=left, right=right):
            yield from _bounds(system, kind, slot, left)
            yield from _bounds(system, kind, slot, right)
        case core.Binary(op=BinaryOp.IMPLIES, left=left, right=right):
            if primed(left) or not _is_sure(system, kind, left):
                yield None
            yield from _bounds(system, kind, slot, right)
        case core.Binary(op=op, left=left, right=right):
            for reading, other, bound in (
                (left, right, _Bound.BELOW),
                (right, left, _Bound.ABOVE),
            ):
                if _is_reading(slot, reading, op) and not primed(other):
                    sure = _is_sure(system, kind, other)
                    equal = op is BinaryOp.EQ
                    yield (_Bound.EQUAL if equal else bound) if sure else None
                    return
            yield None
        case _:
            yield None


def _is_reading(slot: int, e: core.Expr, op: BinaryOp) -> bool:
    """Return whether an expression is the reading, in a comparison that a reading can meet."""
    if op not in (BinaryOp.EQ, BinaryOp.LT, BinaryOp.LE):
        return False
    if isinstance(e, core.Unary) and e.op is UnaryOp.WIDEN and op is not BinaryOp.EQ:
        e = e.operand  # beyond each real number there is an int
    if not isinstance(e, core.Read) or not isinstance(e.type, IntType | FloatType):
        return False
    place = e.place
    return (
        place.primed
        and place.variable.home is Home.PORT
        and place.variable.slot == slot
        and not place.steps
    )


def _is_sure(system: System, kind: int, e: core.Expr) -> bool:
    """Return whether an expression surely has a value, and asks for no answer."""
    asked = (core.Choose, core.ExternalCall)
    return Sure(system, kind).of(e) and not any(
        isinstance(node, asked) for node in reached(system.program, e)
    )
