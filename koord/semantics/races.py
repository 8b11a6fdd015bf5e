"""Which writes of two robots in one round meet. [LOST-UPDATE]

A robot that computes a shared variable's new value from the old one, outside of an atomic block,
loses the other's work if another robot writes the same location in the same round.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import TypeVar

from koord.semantics.domain import Domain, conjunction, disjunction
from koord.semantics.masks import Mask, written
from koord.semantics.values import equal
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.source import Span
from koord.syntax.types import BOOL

V = TypeVar("V")


def overlap(d: Domain[V], mine: Mask[V] | None, theirs: Mask[V] | None) -> V:
    """Whether two robots wrote a common location of one variable."""
    if mine is None or theirs is None:
        return d.const(False, BOOL)
    met = [
        conjunction(d, [mine.whole, written(d, theirs)]),
        conjunction(d, [theirs.whole, written(d, mine)]),
    ]
    met += [overlap(d, a, b) for a, b in zip(mine.parts, theirs.parts, strict=False)]
    for condition, key in mine.keys:
        for other, their_key in theirs.keys:
            met.append(conjunction(d, [condition, other, equal(d, key, their_key)]))
    return disjunction(d, met)


def rewritten(program: core.Program) -> dict[tuple[int, int], frozenset[int]]:
    """For each event (agent kind, position) the allwrite slots it updates outside of ``atomic``.

    To update is to write a value that is computed from the variable's own old value in the same
    statement, or to append, remove or pop.
    """
    found = {}
    for kind, agent in enumerate(program.agents):
        for position, event in enumerate(agent.events):
            slots = frozenset(slot for slot, _ in updates(event.effect))
            if slots:
                found[kind, position] = slots
    return found


def updates(block: core.Block) -> Iterator[tuple[int, Span]]:
    """The statements outside of ``atomic`` that update allwrite variables, each with its slot."""
    for statement in block:
        match statement:
            case core.Assign(place=place, value=value):
                if place.variable.home is Home.ALLWRITE and place.variable in set(_read(value)):
                    yield place.variable.slot, statement.span
            case core.Append(place=place) | core.Remove(place=place) | core.Pop(place=place):
                if place.variable.home is Home.ALLWRITE:
                    yield place.variable.slot, statement.span
            case core.If(then=then, otherwise=otherwise):
                yield from updates(then)
                yield from updates(otherwise)
            case core.ForRange(body=body) | core.ForEach(body=body):
                yield from updates(body)
            case _:
                pass


def _read(node: object) -> Iterator[core.Variable]:
    """Every variable read in an expression."""
    if isinstance(node, core.Place):
        yield node.variable
    if isinstance(node, tuple):
        for part in node:
            yield from _read(part)
    elif is_dataclass(node) and not isinstance(node, type):
        for field in fields(node):
            yield from _read(getattr(node, field.name))
