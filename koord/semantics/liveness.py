"""What is said of whole runs: the statements in them, and what fairness is about.

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
    """One thing leads to another. Both are closed, and asked after INIT and after each round.

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
    """What a liveness property, or an expectation, says: of each robot that is meant."""
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
    """What fair runs are supposed to satisfy. [FAIR-ASSUME]"""
    return tuple(r for e in system.program.expectations for r in responses(system, e))


def locks_of(system: System) -> tuple[tuple[int, int], ...]:
    """Robots and the lock classes that they may ask for. [FAIR-LOCK]"""
    return tuple(
        (robot, k)
        for robot in range(system.robots)
        for k in sorted({k for e in system.agent(robot).events for k in e.lock_classes})
    )


def reads_ran(system: System, stated: core.Property) -> bool:
    """Whether the property, or what it is asked under, reads who ran."""
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
