"""What the unknowns of a round may be: who runs what, who enters a lock class, who comes first."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from koord.semantics.configurations import Configuration
from koord.semantics.domain import conjunction, disjunction
from koord.semantics.turns import guard_of
from koord.syntax import core
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.system import Status, System
from koord.syntax.types import INT, EnumType
from koord.verify.encoding.moments import EventOption
from koord.verify.encoding.races import Before
from koord.verify.encoding.symbols import SymbolicInputs
from koord.verify.encoding.terms import Term, Terms


def free_to_skip(
    d: Terms, system: System, start: Configuration[Term], inputs: SymbolicInputs
) -> list[Term]:
    """Robot by robot, whether it may skip while no lock class is taken. [SKIP]"""
    free: list[Term] = []
    for i, state in enumerate(start.robots):
        urgent = [event for event in system.agent(i).events if event.urgent]
        obliged = [guard_of(d, system, i, state, e, inputs)[0] for e in urgent]
        running = differs(d, state.status, Status.STOPPED)
        waits = d.binary(BinaryOp.AND, running, disjunction(d, obliged))
        free.append(d.unary(UnaryOp.NOT, waits))
    return free


def who_acts(d: Terms, system: System, options: list[EventOption]) -> list[Term]:
    """Robot by robot, whether it runs an event."""
    return [
        disjunction(d, [o.chosen for o in options if o.robot == i]) for i in range(system.robots)
    ]


def one_event_each(d: Terms, system: System, options: list[EventOption]) -> list[Term]:
    """Each robot at most one event a round."""
    constraints: list[Term] = []
    for i in range(system.robots):
        mine = [o.chosen for o in options if o.robot == i]
        constraints += _at_most_one(d, mine)
    return constraints


def one_winner_each(d: Terms, system: System, options: list[EventOption]) -> list[Term]:
    """At most one robot enters each lock class: who loses, skips. [ATOMIC] [T-ONE-WINNER]"""
    constraints: list[Term] = []
    for lock_class in system.program.lock_classes:
        entering: dict[int, list[Term]] = {}
        for o in options:
            entered = o.turned.entered.get(lock_class.index)
            if entered is not None:
                both = d.binary(BinaryOp.AND, o.chosen, entered)
                entering.setdefault(o.robot, []).append(both)
        constraints += _at_most_one(d, [disjunction(d, x) for x in entering.values()])
    return constraints


def _at_most_one(d: Terms, conditions: Sequence[Term]) -> list[Term]:
    return [
        d.unary(UnaryOp.NOT, d.binary(BinaryOp.AND, a, b)) for a, b in combinations(conditions, 2)
    ]


def differs(d: Terms, status: Term, other: Status) -> Term:
    return d.binary(BinaryOp.NE, status, d.const(int(other), INT))


def order_of(d: Terms, robots: int, label: str) -> Before:
    """Who comes before whom: each robot has a place, and of two with the same the later pid.

    So whatever the places are, they are an order of all robots, and nothing is required of them.
    """
    # As many values as there are robots: domains with a number of bits for each need no more.
    place = EnumType("place", tuple(map(str, range(robots))))
    places = [d.fresh(f"place@{i}#{label}", place) for i in range(robots)]
    pairs = combinations(range(robots), 2)
    return {(i, j): d.binary(BinaryOp.LT, places[i], places[j]) for i, j in pairs}


def obligations(
    d: Terms,
    system: System,
    start: Configuration[Term],
    options: list[EventOption],
    inputs: SymbolicInputs,
) -> list[Term]:
    """Who skips has no urgent event whose lock classes are free. [SKIP] [T-ONE-WINNER]

    Who skips writes nothing, so it may as well come last, when all classes are taken.
    """
    constraints: list[Term] = []
    for i, state in enumerate(start.robots):
        acts = disjunction(d, [o.chosen for o in options if o.robot == i])
        running = differs(d, state.status, Status.STOPPED)
        for event in system.agent(i).events:
            if not event.urgent:
                continue
            holds, _ = guard_of(d, system, i, state, event, inputs)
            taken = _taken_by_others(d, i, event, options)
            waits = conjunction(d, [running, holds, d.unary(UnaryOp.NOT, taken)])
            constraints.append(d.binary(BinaryOp.IMPLIES, waits, acts))
    return constraints


def _taken_by_others(d: Terms, robot: int, event: core.Event, options: list[EventOption]) -> Term:
    taken = []
    for o in options:
        if o.robot != robot:
            for lock_class in event.lock_classes:
                entered = o.turned.entered.get(lock_class)
                if entered is not None:
                    taken.append(d.binary(BinaryOp.AND, o.chosen, entered))
    return disjunction(d, taken)
