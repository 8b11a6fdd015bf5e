"""Liveness statements: responses, and the lock requests and ``ran`` reads that fairness is about.

:mod:`koord.traces.lassos` says of one run whether it is fair, and whether it breaks a statement.
"""

from __future__ import annotations

from msgspec import Struct

from koord.syntax import core
from koord.syntax.core import Home, PropertyKind, QuantifierKind
from koord.syntax.system import System
from koord.syntax.types import INT
from koord.syntax.walk import nodes

LIVENESS = frozenset({PropertyKind.EVENTUALLY, PropertyKind.LEADS_TO})


class Response(Struct, frozen=True):
    """A response property: a state with the trigger is followed by one with the goal.
    Trigger and goal are closed expressions, evaluated after INIT and after each round.

    A trigger that is None is the start of the run. ``robot`` is the one that is meant, if the
    statement is about each by itself. [PROP-EVENTUALLY] [PROP-LEADS-TO]
    """

    name: str
    robot: int | None
    trigger: core.Property | None
    goal: core.Property

    @property
    def statements(self) -> tuple[core.Property, ...]:
        return (self.goal,) if self.trigger is None else (self.trigger, self.goal)


def responses(system: System, stated: core.Property) -> tuple[Response, ...]:
    """The responses that a liveness property or an expectation states, one per robot."""
    who: list[int | None] = [None]
    if stated.each is not None:
        kind = stated.each.agent
        who = [i for i, k in enumerate(system.kinds) if kind in (None, k)]
    return tuple(
        Response(
            stated.name,
            robot,
            None if stated.trigger is None else _closed(stated, stated.trigger, robot),
            _closed(stated, stated.condition, robot),
        )
        for robot in who
    )


def expected(system: System) -> tuple[Response, ...]:
    """The responses that fair runs are assumed to satisfy. [FAIR-ASSUME]"""
    return tuple(r for e in system.program.expectations for r in responses(system, e))


def locks_of(system: System) -> tuple[tuple[int, int], ...]:
    """Pairs of a robot and a lock class that one of its events may ask for. [FAIR-LOCK]"""
    return tuple(
        (robot, k)
        for robot in range(system.robots)
        for k in sorted({k for e in system.agent(robot).events for k in e.lock_classes})
    )


def reads_ran(system: System, stated: core.Property) -> bool:
    """Return whether the property, or an expectation it assumes, reads which events ran."""
    statements = (stated, *system.program.expectations)
    return any(isinstance(node, core.Ran) for node in nodes(statements))


def _closed(stated: core.Property, condition: core.Expr, robot: int | None) -> core.Property:
    if stated.each is not None:
        assert robot is not None
        assert stated.each.variable.home is Home.BOUND
        only = core.IntRange(core.Const(robot, INT), core.Const(robot + 1, INT))
        condition = core.Quantified(
            QuantifierKind.FORALL, stated.each.variable, only, condition, span=condition.span
        )
    return core.Property(
        stated.name, PropertyKind.AT_ROUND, condition, stated.bound, span=condition.span
    )
