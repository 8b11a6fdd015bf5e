"""What should be possible if verdicts are to say something: events run, suppositions come true.

A wish is written as the claim that it *never* comes true, so that engines can be asked about it: a
violation is a run on which it does, and a proof means that it never will.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import TypeAlias

from koord.semantics.configurations import System
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, PropertyKind, QuantifierKind, UnaryOp
from koord.syntax.source import Span
from koord.syntax.types import BOOL, INT
from koord.verify.claims import Claim, ClaimKind


class Aim(Enum):
    """What is wished for."""

    EVENT = "event"  #: that it runs, in a round that ends
    SUPPOSITION = "supposition"  #: that what a property supposes is true of some configuration


@dataclass(frozen=True, slots=True)
class Wish:
    """One wish. ``subject`` is the event, or the invariant that supposes something."""

    aim: Aim
    subject: str
    never: Claim
    span: Span


#: Aim, subject, the condition that denies it, how many bound slots that needs, and its place.
_Stated: TypeAlias = "tuple[Aim, str, core.Expr, int, Span]"


def wishes_of(system: System) -> list[Wish]:
    """All that should be possible in a system, in the order of the text."""
    stated = [*_events(system), *_suppositions(system.program)]
    return [
        Wish(aim, subject, _never(f"never {number}", condition, bound), span)
        for number, (aim, subject, condition, bound, span) in enumerate(stated)
    ]


def _never(name: str, condition: core.Expr, bound: int) -> Claim:
    stated = core.Property(name, PropertyKind.AT_ROUND, condition, bound)
    return Claim(name, ClaimKind.PROPERTY, stated)


def _events(system: System) -> Iterator[_Stated]:
    agents = system.program.agents
    for kind in sorted(set(system.kinds)):
        for position, event in enumerate(agents[kind].events):
            robot = core.Variable(Home.BOUND, 0, "i", INT)
            ran = core.Ran(((kind, position),), core.Read(core.Place(robot)))
            denied = core.Unary(UnaryOp.NOT, ran, BOOL)
            domain = core.RobotRange(kind)
            body = core.Quantified(QuantifierKind.FORALL, robot, domain, denied)
            yield Aim.EVENT, event.name, body, 1, event.span


def _suppositions(program: core.Program) -> Iterator[_Stated]:
    for stated in program.properties:
        if stated.kind in (PropertyKind.INVARIANT, PropertyKind.AT_ROUND):
            for condition, span in _denied(stated.condition):
                yield Aim.SUPPOSITION, stated.name, condition, stated.bound, span
        elif stated.trigger is not None:
            never: core.Expr = core.Unary(UnaryOp.NOT, stated.trigger, BOOL)
            if stated.each is not None:
                robots = core.RobotRange(stated.each.agent)
                every = QuantifierKind.FORALL
                never = core.Quantified(every, stated.each.variable, robots, never)
            yield Aim.SUPPOSITION, stated.name, never, stated.bound, stated.trigger.span


def supposes(condition: core.Expr) -> bool:
    """Whether a statement says what follows from something that is to come true."""
    return next(_denied(condition), None) is not None


def _denied(e: core.Expr) -> Iterator[tuple[core.Expr, Span]]:
    """For each implication that a statement is made of: that what it supposes never holds."""
    match e:
        case core.Quantified(quantifier=QuantifierKind.FORALL, body=body):
            for inner, span in _denied(body):
                yield core.Quantified(e.quantifier, e.variable, e.domain, inner), span
        case core.Binary(op=BinaryOp.AND, left=left, right=right):
            yield from _denied(left)
            yield from _denied(right)
        case core.Binary(op=BinaryOp.IMPLIES, left=left, right=right):
            nested = list(_denied(right))
            for inner, span in nested:
                yield core.Binary(BinaryOp.IMPLIES, left, inner, BOOL), span
            if not nested:
                yield core.Unary(UnaryOp.NOT, left, BOOL), left.span
        case _:
            return
