"""Places: reads of variables and of their parts. [LOOKUP] [E-SELECT] [PROP-READ]"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar, assert_never

from koord.semantics.configurations import Robot
from koord.semantics.domain import disjunction
from koord.semantics.locations import AtField, AtIndex, AtKey, Location, descend, part_of
from koord.semantics.machine import Machine
from koord.semantics.storage import Cell, Storage, Tree, contents, merge_storage
from koord.semantics.values import (
    Value,
    default,
    scalar,
)
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, slot_in
from koord.syntax.faults import FaultKind
from koord.syntax.system import Status
from koord.syntax.types import INT

V = TypeVar("V")


def read(m: Machine[V], place: core.Place) -> Value[V]:
    """Read the value at a place; an unset one is a fault. [LOOKUP]"""
    storage = root(m, place)
    type_ = place.variable.type
    steps = list(place.steps)
    while steps and isinstance(storage, Tree):
        step = steps.pop(0)
        below, legal = descend(m.d, storage, located(m, step))
        m.fault_unless(legal, FaultKind.INDEX, step.span)
        type_ = step.type
        if below is None:
            return default(m.d, place.type, m.system.size)
        storage = below
    value, is_set = contents(m.d, storage, type_)
    m.fault_unless(is_set, FaultKind.UNSET, place.span, place.variable.name)
    return parts(m, value, tuple(steps))


def parts(m: Machine[V], value: Value[V], steps: tuple[core.Step, ...]) -> Value[V]:
    """Select a part of a value, some steps below it. [E-SELECT]"""
    for step in steps:
        location = located(m, step)
        below, legal = part_of(m.d, value, location)
        kind = FaultKind.KEY if isinstance(location, AtKey) else FaultKind.INDEX
        m.fault_unless(legal, kind, step.span)
        value = below if below is not None else default(m.d, step.type, m.system.size)
    return value


def located(m: Machine[V], step: core.Step) -> Location[V]:
    """Evaluate the index or key of a step."""
    match step:
        case core.FieldStep():
            return AtField(step.position)
        case core.IndexStep():
            return AtIndex(scalar(m.value(step.index)))
        case core.KeyStep():
            return AtKey(m.value(step.key))
    assert_never(step)


def select(m: Machine[V], e: core.Select) -> Value[V]:
    """Select a part of a computed value. [E-SELECT]"""
    return parts(m, m.value(e.base), (e.step,))


# --- whose variable -----------------------------------------------------------------------------


def root(m: Machine[V], place: core.Place) -> Storage[V]:
    """The storage of a place's variable: from ``M`` in a turn, from the view in a property."""
    variable = place.variable
    if variable.home is Home.BOUND:
        cell = m.memory.bound[variable.slot]
        if cell is None:
            return Cell(m.truth(False), default(m.d, variable.type, m.system.size))
        return cell
    if m.view is not None:
        return viewed(m, place)
    match variable.home:
        case Home.LOCAL:
            return m.memory.locals[variable.slot]
        case Home.PORT:
            return (m.memory.after if place.primed else m.memory.ports)[variable.slot]
        case Home.ALLREAD:
            return m.memory.allread[variable.slot]
        case Home.ALLWRITE:
            return m.memory.allwrite[variable.slot]


def viewed(m: Machine[V], place: core.Place) -> Storage[V]:
    """The storage of a variable in the configuration that a property is about. [PROP-READ]"""
    assert m.view is not None
    variable = place.variable
    if variable.home is Home.ALLREAD:
        return m.view.store.allread[variable.slot]
    if variable.home is Home.ALLWRITE:
        return m.view.store.allwrite[variable.slot]
    assert place.robot is not None
    index = scalar(m.value(place.robot))
    known = m.d.known(index)
    if isinstance(known, int) and 0 <= known < len(m.view.robots):
        storage = _of_robot(m, variable, m.view.robots[known])
        if storage is not None:
            return storage
    return at_robot(m, place, index)


def at_robot(m: Machine[V], place: core.Place, index: V) -> Storage[V]:
    """The storage of ``v`` at the robot that ``v@i`` names; a fault if there is no such robot."""
    assert m.view is not None
    assert place.robot is not None
    found = [
        (here, storage)
        for here, robot in those_at(m, index)
        if (storage := _of_robot(m, place.variable, robot)) is not None
    ]
    there = disjunction(m.d, [here for here, _ in found])
    m.fault_unless(there, FaultKind.INDEX, place.robot.span)
    if not found:
        return Cell(m.truth(False), default(m.d, place.variable.type, m.system.size))
    *others, (_, chosen) = found
    for here, storage in others:
        if m.d.known(here) is None:
            chosen = merge_storage(m.d, here, storage, chosen)
    return chosen


def those_at(m: Machine[V], index: V) -> Sequence[tuple[V, Robot[V]]]:
    """The robots that a number may name, each with the condition that it does. [PROP-READ]"""
    assert m.view is not None
    if m.view.at is not None:
        return m.view.at(index)
    numbered = enumerate(m.view.robots)
    return [(m.d.binary(BinaryOp.EQ, index, m.d.const(n, INT)), robot) for n, robot in numbered]


def _of_robot(m: Machine[V], variable: core.Variable, robot: Robot[V]) -> Storage[V] | None:
    """The storage of a local or port of a robot; None for kinds without that variable."""
    slot = slot_in(m.system.program.agents[robot.kind], variable)
    storages = robot.locals if variable.home is Home.LOCAL else robot.ports
    return storages[slot] if slot is not None else None


# --- what became of a turn ------------------------------------------------------------------------


def ran(m: Machine[V], e: core.Ran) -> Value[V]:
    """Return the condition that a robot's last program turn ran one of these events. [PROP-RAN]"""
    assert m.view is not None
    index = scalar(m.value(e.robot))
    holds = []
    for here, robot in those_at(m, index):
        for kind, position in e.events:
            if kind == robot.kind:
                did = m.d.binary(BinaryOp.EQ, robot.ran, m.d.const(position, INT))
                holds.append(m.both(here, did))
    return disjunction(m.d, holds)


def stopped(m: Machine[V], e: core.Stopped) -> Value[V]:
    """Return the condition that the robot has stopped. [PROP-STOPPED]"""
    assert m.view is not None
    index = scalar(m.value(e.robot))
    holds = []
    for here, robot in those_at(m, index):
        done = m.d.binary(BinaryOp.EQ, robot.status, m.d.const(int(Status.STOPPED), INT))
        holds.append(m.both(here, done))
    return disjunction(m.d, holds)
