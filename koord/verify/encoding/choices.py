"""The choices of robots in a round, who wins which race, and the store after it. [T-COMMIT]"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import TypeAlias

from koord.semantics.configurations import Configuration, Store
from koord.semantics.domain import conjunction, disjunction
from koord.semantics.locations import Mask, joined, restricted
from koord.semantics.properties import overlap
from koord.semantics.storage import Cell, Storage, Tree, in_room, merge_storage
from koord.semantics.turns import guard_of
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, UnaryOp
from koord.syntax.system import Status, System
from koord.syntax.types import BOOL, INT, EnumType, is_flat
from koord.syntax.walk import statements, written
from koord.verify.encoding.moments import Before, EventOption
from koord.verify.encoding.symbols import SymbolicInputs
from koord.verify.encoding.terms import Term, Terms

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
    """A flat variable after all writes: each location has the last writer's value.

    Robots' writes are put in one after the other, and each stands over those of robots before it in
    number if it comes later than they do. So what robots that all write find is written over.
    """
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
                if other < robot
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


def free_to_skip(
    d: Terms, system: System, start: Configuration[Term], inputs: SymbolicInputs
) -> list[Term]:
    """For each robot, the condition that it may skip while no lock class is taken. [SKIP]"""
    free: list[Term] = []
    for i, state in enumerate(start.robots):
        urgent = [event for event in system.agent(i).events if event.urgent]
        obliged = [guard_of(d, system, i, state, e, inputs)[0] for e in urgent]
        running = differs(d, state.status, Status.STOPPED)
        waits = d.binary(BinaryOp.AND, running, disjunction(d, obliged))
        free.append(d.unary(UnaryOp.NOT, waits))
    return free


def who_acts(d: Terms, system: System, options: list[EventOption]) -> list[Term]:
    """For each robot, the condition that it runs an event."""
    return [
        disjunction(d, [o.chosen for o in options if o.robot == i]) for i in range(system.robots)
    ]


def one_event_each(d: Terms, system: System, options: list[EventOption]) -> list[Term]:
    """The constraints that each robot runs at most one event in a round."""
    constraints: list[Term] = []
    for i in range(system.robots):
        mine = [o.chosen for o in options if o.robot == i]
        constraints += _at_most_one(d, mine)
    return constraints


def one_winner_each(d: Terms, system: System, options: list[EventOption]) -> list[Term]:
    """The constraints that at most one robot enters each lock class; losers skip.
    [ATOMIC] [T-ONE-WINNER]
    """
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
    """An arbitrary order of the robots: each has a rank, and of two with equal ranks the later pid.

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
    """The constraints that skipping robots have no urgent event with free classes. [SKIP]
    [T-ONE-WINNER]

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


#: For each event (kind, position), the allwrite slots that it updates outside of ``atomic``.
Updates: TypeAlias = "Mapping[tuple[int, int], frozenset[int]]"


def committed(
    d: Terms,
    system: System,
    store: Store[Term],
    options: list[EventOption],
    before: Before,
    racy: set[int],
) -> Store[Term]:
    """The store after all robots' writes. [SHARED-ASSIGN] [T-COMMIT]"""
    program = system.program
    allread = list(store.allread)
    for slot in range(len(allread)):
        for o in options:
            mask = restricted(d, o.turned.allread.get(slot), o.chosen)
            source = o.turned.robot.copy.allread[slot]
            allread[slot] = joined(d, allread[slot], source, mask)
    allwrite = list(store.allwrite)
    for slot, declaration in enumerate(program.allwrite):
        writes = [
            (o.robot, o.turned.robot.copy.allwrite[slot], mask)
            for o in options
            if (mask := restricted(d, o.turned.allwrite.get(slot), o.chosen)) is not None
        ]
        if slot not in racy:
            for _, source, mask in writes:
                allwrite[slot] = joined(d, allwrite[slot], source, mask)
        elif is_flat(declaration.variable.type):
            allwrite[slot] = winning(d, allwrite[slot], writes, before)
        else:
            allwrite[slot] = _in_order(d, system, allwrite[slot], writes, before)
    return Store(_in_room(program.allread, allread), _in_room(program.allwrite, allwrite))


def _in_room(
    declared: Iterable[core.Declaration], stored: Iterable[Storage[Term]]
) -> tuple[Storage[Term], ...]:
    return tuple(in_room(s, e.variable.type) for e, s in zip(declared, stored, strict=True))


def _in_order(
    d: Terms,
    system: System,
    target: Storage[Term],
    writes: list[Write],
    before: Before,
) -> Storage[Term]:
    """Apply writes in the order of the robots' ranks: for lists and maps with races."""
    robots, original = system.robots, target
    places = [_place_of(d, system, i, before) for i in range(robots)]
    for place in range(robots):
        current = target
        for robot in sorted({robot for robot, _, _ in writes}):
            here = d.binary(BinaryOp.EQ, places[robot], d.const(place, INT))
            changed = current
            for writer, source, mask in writes:
                if writer == robot:
                    changed = joined(d, changed, source, mask)
            target = (
                merge_storage(d, here, changed, target)
                if d.known(here) is None
                else (changed if d.known(here) else target)
            )
    return set_where_written(d, original, target, [mask for _, _, mask in writes])


def _place_of(d: Terms, system: System, robot: int, before: Before) -> Term:
    """The rank of a robot: the number of robots before it."""
    count: Term = d.const(0, INT)
    for other in range(system.robots):
        if other != robot:
            earlier = precedes(d, other, robot, before)
            count = d.binary(BinaryOp.ADD, count, d.ite(earlier, d.const(1, INT), d.const(0, INT)))
    return count


def lost_updates(
    d: Terms, system: System, updates: Updates, options: list[EventOption]
) -> list[tuple[Term, str]]:
    """The conditions that a robot's update of an allwrite variable meets another write.
    [LOST-UPDATE]
    """
    found = []
    for mine in options:
        for slot in sorted(updates.get((system.kinds[mine.robot], mine.position), ())):
            name = system.program.allwrite[slot].variable.name
            for other in options:
                theirs, own = other.turned.allwrite.get(slot), mine.turned.allwrite.get(slot)
                if other.robot == mine.robot or theirs is None or own is None:
                    continue
                met = conjunction(d, [mine.chosen, other.chosen, overlap(d, own, theirs)])
                if d.known(met) is not False:
                    found.append((met, name))
    return found
