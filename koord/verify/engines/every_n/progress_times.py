"""Parts of proofs of progress that speak of time: what a robot waits for comes about. [T-PROGRESS]

A guard that compares reals (how long ago something was, and how long one has to wait) is made true
by rounds that pass, if the difference falls in each of them by more than nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import TypeGuard

from koord.syntax import core
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.types import BOOL, FLOAT
from koord.verify.engines.every_n.progress_parts import (
    READ_ROBOT,
    ROBOT,
    Help,
    HelpKind,
    Measure,
    Phrase,
    Words,
    is_certain,
    is_negation,
    range_of,
    said_of,
    shared_states,
)


def waits_of(program: core.Program) -> Iterator[Help]:
    """Yield that a robot waits, where nothing else is in the way of an event."""
    for kind, agent in enumerate(program.agents):
        for event in agent.events:
            if not is_certain(program, event.guard):
                continue
            parts = list(conjuncts(said_of(event.guard, ROBOT)))
            for part in parts:
                if _compares_reals(part):
                    state = core.Binary(BinaryOp.LT, part.right, part.left, BOOL)
                    for other in parts:
                        if other != part:
                            state = core.Binary(BinaryOp.AND, other, state, BOOL)
                    left = core.Binary(BinaryOp.SUB, part.left, part.right, FLOAT)
                    where = range_of(program, kind)
                    yield Help(HelpKind.TIME, Phrase(state), where, falls=Phrase(left))


def times_of(program: core.Program) -> Iterator[Measure]:
    """Yield that a robot still waits, and that it does not, by comparisons in guards."""
    for kind, agent in enumerate(program.agents):
        for event in agent.events:
            if not is_certain(program, event.guard):
                continue
            for part in conjuncts(said_of(event.guard, ROBOT)):
                if _compares_reals(part):
                    waits = core.Binary(BinaryOp.LT, part.right, part.left, BOOL)
                    yield Measure(Phrase(waits), range_of(program, kind))
                    over = core.Unary(UnaryOp.NOT, waits, BOOL)
                    yield Measure(Phrase(over), range_of(program, kind))


def conditional(program: core.Program) -> Iterator[Measure]:
    """Yield states of robots while a shared variable is in a state, where robots wait for time.

    There they do one thing before something is written and another after, so that a state settles
    in one way as long as it is not, and in another from then on.
    """
    if not any(times_of(program)):
        return
    for kind in range(len(program.agents)):
        states = [s for s in Words(program, kind).states(READ_ROBOT) if not is_negation(s)]
        for shared, state in product(shared_states(program), states):
            for when, what in product(_both(shared), _both(state)):
                both = core.Binary(BinaryOp.AND, when, what, BOOL)
                yield Measure(Phrase(both), range_of(program, kind))


def _both(state: core.Expr) -> tuple[core.Expr, core.Expr]:
    return state, core.Unary(UnaryOp.NOT, state, BOOL)


def _compares_reals(part: core.Expr) -> TypeGuard[core.Binary]:
    return (
        isinstance(part, core.Binary)
        and part.op in (BinaryOp.LE, BinaryOp.LT)
        and part.left.type == FLOAT
    )


def conjuncts(said: core.Expr) -> Iterator[core.Expr]:
    """Yield the parts of a conjunction: it holds where each of them does. [PROP-FAULT]"""
    if isinstance(said, core.Binary) and said.op is BinaryOp.AND:
        yield from conjuncts(said.left)
        yield from conjuncts(said.right)
    else:
        yield said
