"""Races: the winner where several robots write one location in a round. [T-COMMIT]"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeAlias

from koord.semantics.domain import conjunction, disjunction
from koord.semantics.locations import Mask, joined
from koord.semantics.storage import Cell, Storage, Tree
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, UnaryOp
from koord.syntax.types import BOOL
from koord.syntax.walk import statements, written
from koord.verify.encoding.terms import Term, Terms

Before: TypeAlias = "dict[tuple[int, int], Term]"
Write: TypeAlias = "tuple[int, Storage[Term], Mask[Term]]"


def racy_variables(program: core.Program) -> frozenset[int]:
    """The allwrite slots that two robots may write in a round: those written outside of ``atomic``.

    Atomic blocks that write a common variable are of one lock class, so those exclude each other.
    """
    return frozenset(place.variable.slot for place in racy_places(program))


def racy_places(program: core.Program) -> Iterator[core.Place]:
    """The allwrite places that events write outside of ``atomic``."""
    for agent in program.agents:
        for event in agent.events:
            for statement in statements(event.effect, atomic=False):
                for place in written(statement):
                    if place.variable.home is Home.ALLWRITE:
                        yield place


def winning(
    d: Terms, target: Storage[Term], writes: Sequence[Write], before: Before
) -> Storage[Term]:
    """A flat variable after all writes: each location has the last writer's value."""
    original = target
    robots = sorted({robot for robot, _, _ in writes})
    flags = {
        robot: _flags(d, target, [mask for who, _, mask in writes if who == robot])
        for robot in robots
    }
    for robot, source, mask in writes:
        own = _flags(d, target, [mask])
        kept = []
        for location, flag in enumerate(own):
            later = [
                conjunction(d, [flags[other][location], precedes(d, robot, other, before)])
                for other in robots
                if other != robot
            ]
            beaten = disjunction(d, later)
            kept.append(d.binary(BinaryOp.AND, flag, d.unary(UnaryOp.NOT, beaten)))
        target = joined(d, target, source, _mask(d, target, iter(kept)))
    return set_where_written(d, original, target, [mask for _, _, mask in writes])


def set_where_written(
    d: Terms, before: Storage[Term], after: Storage[Term], masks: Sequence[Mask[Term]]
) -> Storage[Term]:
    """``after`` with its atoms set if they were before or any robot wrote them.

    Who wins decides values only. Said like this it is simpler, and plain where all robots write:
    then nobody need ask later whether the variable is set.
    """
    flags = iter(_flags(d, before, masks))

    def settled(old: Storage[Term], new: Storage[Term]) -> Storage[Term]:
        if isinstance(new, Tree):
            assert isinstance(old, Tree)
            return Tree(tuple(settled(a, b) for a, b in zip(old.parts, new.parts, strict=True)))
        assert isinstance(old, Cell)
        return Cell(d.binary(BinaryOp.OR, old.is_set, next(flags)), new.value)

    return settled(before, after)


def precedes(d: Terms, first: int, second: int, before: Before) -> Term:
    """The condition that one robot's turn precedes another's; ``before`` holds the pairs i < j."""
    if first < second:
        return before[first, second]
    return d.unary(UnaryOp.NOT, before[second, first])


def _flags(d: Terms, storage: Storage[Term], masks: Sequence[Mask[Term] | None]) -> list[Term]:
    """For each atom, in order, the condition that one of the masks covers it."""
    never = d.const(False, BOOL)
    if not isinstance(storage, Tree):
        return [disjunction(d, [mask.whole if mask is not None else never for mask in masks])]
    whole = disjunction(d, [mask.whole if mask is not None else never for mask in masks])
    flags: list[Term] = []
    for position, part in enumerate(storage.parts):
        below = [
            mask.parts[position] if mask is not None and position < len(mask.parts) else None
            for mask in masks
        ]
        flags += [d.binary(BinaryOp.OR, whole, flag) for flag in _flags(d, part, below)]
    return flags


def _mask(d: Terms, storage: Storage[Term], flags: Iterator[Term]) -> Mask[Term]:
    """Build the mask of the atoms from their flags."""
    if not isinstance(storage, Tree):
        return Mask(next(flags))
    return Mask(d.const(False, BOOL), tuple(_mask(d, part, flags) for part in storage.parts))
