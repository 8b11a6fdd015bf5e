"""Parts of proofs of progress that speak of time: what a robot waits for comes about. [T-PROGRESS]

A guard that compares reals (how long ago something was, and how long one has to wait) is made true
by rounds that pass, if the difference falls in each of them by more than nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import TypeGuard

from koord.syntax import core
from koord.syntax.core import BinaryOp
from koord.syntax.types import BOOL, FLOAT
from koord.syntax.walk import chained
from koord.verify.engines.every_n.progress_parts import (
    READ_ROBOT,
    ROBOT,
    Help,
    HelpKind,
    Measure,
    Phrase,
    Words,
    both_ways,
    changes,
    is_certain,
    range_of,
    said_of,
    shared_states,
)


def waits_of(program: core.Program) -> Iterator[Help]:
    """Yield that a robot waits, where nothing else is in the way of an event."""
    for kind, parts, part in _awaited(program):
        state = _still_waits(part)
        for other in parts:
            if other != part:
                state = core.Binary(BinaryOp.AND, other, state, BOOL)
        left = core.Binary(BinaryOp.SUB, part.left, part.right, FLOAT)
        where = range_of(program, kind)
        yield Help(HelpKind.TIME, Phrase(state), where, falls=Phrase(left))


def times_of(program: core.Program) -> Iterator[Measure]:
    """Yield that a robot still waits, and that it does not, by comparisons in guards."""
    for kind, _, part in _awaited(program):
        yield from changes([_still_waits(part)], range_of(program, kind))


def conditional(program: core.Program) -> Iterator[Measure]:
    """Yield states of robots while a shared variable is in a state, where robots wait for time.

    There they do one thing before something is written and another after, so that a state settles
    in one way as long as it is not, and in another from then on.
    """
    if not any(_awaited(program)):
        return
    for kind in range(len(program.agents)):
        states = Words(program, kind).plain_states(READ_ROBOT)
        for shared, state in product(shared_states(program), states):
            for when, what in product(both_ways(shared), both_ways(state)):
                both = core.Binary(BinaryOp.AND, when, what, BOOL)
                yield Measure(Phrase(both), range_of(program, kind))


def _awaited(program: core.Program) -> Iterator[tuple[int, list[core.Expr], core.Binary]]:
    """Yield comparisons of reals in guards, with the kind of robot and all parts of the guard."""
    for kind, agent in enumerate(program.agents):
        for event in agent.events:
            if is_certain(program, event.guard):
                parts = list(chained(said_of(event.guard, ROBOT), BinaryOp.AND))
                yield from ((kind, parts, part) for part in parts if _compares_reals(part))


def _still_waits(part: core.Binary) -> core.Binary:
    """The condition that a comparison does not hold yet."""
    return core.Binary(BinaryOp.LT, part.right, part.left, BOOL)


def _compares_reals(part: core.Expr) -> TypeGuard[core.Binary]:
    return (
        isinstance(part, core.Binary)
        and part.op in (BinaryOp.LE, BinaryOp.LT)
        and part.left.type == FLOAT
    )
