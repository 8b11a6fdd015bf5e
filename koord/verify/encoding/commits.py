"""The store after a round: everybody's writes, and which of them meet. [T-COMMIT]"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeAlias

from koord.semantics.configurations import Store
from koord.semantics.domain import conjunction
from koord.semantics.locations import joined, restricted
from koord.semantics.properties import overlap
from koord.semantics.storage import Storage, in_room, merge_storage
from koord.syntax import core
from koord.syntax.core import BinaryOp
from koord.syntax.system import System
from koord.syntax.types import INT, is_flat
from koord.verify.encoding.moments import EventOption
from koord.verify.encoding.races import Before, Write, precedes, set_where_written, winning
from koord.verify.encoding.terms import Term, Terms

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
    """The store after everybody's writes. [SHARED-ASSIGN] [T-COMMIT]"""
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
    """Writes applied one place of the order after the other: for lists and maps that race."""
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
    """How many robots come before this one."""
    count: Term = d.const(0, INT)
    for other in range(system.robots):
        if other != robot:
            earlier = precedes(d, other, robot, before)
            count = d.binary(BinaryOp.ADD, count, d.ite(earlier, d.const(1, INT), d.const(0, INT)))
    return count


def lost_updates(
    d: Terms, system: System, updates: Updates, options: list[EventOption]
) -> list[tuple[Term, str]]:
    """Where one robot's update of an allwrite variable meets another's write. [LOST-UPDATE]"""
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
