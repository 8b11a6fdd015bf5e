"""Execution of statements. The rules of chapter 3, each cited where it stands."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TypeVar, assert_never

from koord.semantics.configurations import Configuration, Store, Written
from koord.semantics.domain import Domain, NumberTooLongError
from koord.semantics.expressions import condition, evaluate, variables_in
from koord.semantics.locations import AtIndex, AtKey, Location, descend, marked, part_of, write
from koord.semantics.machine import Machine, Memory
from koord.semantics.oracle import Oracle
from koord.semantics.places import located
from koord.semantics.quantifiers import integers, listable
from koord.semantics.storage import Cell, Many, Storage, Tree, held, in_room, stored, unset
from koord.semantics.values import (
    Family,
    Rec,
    Seq,
    Table,
    Value,
    default,
    equal,
    inside,
    lookup,
    merge_known,
    put_at,
    scalar,
    sequence,
    table,
    without,
)
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home
from koord.syntax.faults import FaultKind
from koord.syntax.system import System
from koord.syntax.types import BOOL, INT, MapType, QueueType

V = TypeVar("V")


def run(m: Machine[V], block: core.Block) -> None:
    """Run statements in order, until one leaves the block. [S-SEQ]"""
    position = 0
    while position < len(block):
        left = m.either(m.memory.broke, m.memory.returned)
        known = m.d.known(left)
        if known is True:
            return
        if known is False:
            execute(m, block[position])
            position += 1
            continue
        # Some paths have left. The others go on together, up to where more of them may leave.
        end = [position]
        m.branch(left, _nothing, partial(_go_on, m, block, end))
        position = end[0]


def _go_on(m: Machine[V], block: core.Block, position: list[int]) -> None:
    """Run the statements from a position on, and note where the path left the block."""
    broke, returned = m.memory.broke, m.memory.returned
    while position[0] < len(block) and m.memory.broke is broke and m.memory.returned is returned:
        execute(m, block[position[0]])
        position[0] += 1


def _nothing() -> None:
    """Do nothing: the empty else branch."""


def execute(m: Machine[V], s: core.Stmt) -> None:
    """Execute one statement."""
    m.system.budget.spend()
    try:
        match s:
            case core.Assign():
                assign(m, s.place, evaluate(m, s.value))
            case core.If():
                # [S-IF]
                m.branch(
                    condition(m, s.condition),
                    lambda: run(m, s.then),
                    lambda: run(m, s.otherwise),
                )
            case core.ForRange():
                for_range(m, s)
            case core.ForEach():
                for_each(m, s)
            case core.Break():
                m.memory.broke = m.truth(True)
            case core.Return():
                # [S-RETURN]
                m.memory.result = held(m.d, evaluate(m, s.value)) if s.value is not None else None
                m.memory.returned = m.truth(True)
            case core.Atomic():
                atomic(m, s)
            case core.Stop():
                m.memory.stop = m.truth(True)
            case core.TryStop():
                m.memory.trystop = m.truth(True)
            case core.Output():
                # [OUTPUT]
                values = tuple(evaluate(m, v) for v in s.values)
                types = tuple(v.type for v in s.values)
                if not m.faulted:
                    m.output.append((m.guard, Written(s.stream, values, types)))
            case core.Append():
                append(m, s)
            case core.Remove():
                remove(m, s)
            case core.Pop():
                pop(m, s)
            case _:
                assert_never(s)
    except NumberTooLongError as error:
        names = (s.place.variable.name,) if isinstance(s, core.Assign) else variables_in(s)
        raise error.about(names, s.span) from None


# --- assignment ---------------------------------------------------------------------------------


def assign(m: Machine[V], place: core.Place, value: Value[V]) -> None:
    """Write a place. [LOCAL-ASSIGN] [SHARED-ASSIGN] [ALLREAD] [ACTUATE]"""
    variable = place.variable
    locations = [located(m, step) for step in place.steps]
    if variable.home is Home.BOUND:
        _assign_bound(m, place, locations, value)
        return
    storages = _storages(m, variable.home)
    storage = storages[variable.slot]
    fresh = _fresh(m, place, storage, locations, value)
    changed, legal = write(m.d, storage, locations, fresh)
    _check_write(m, place, storage, locations, legal)
    storages[variable.slot] = _in_room(changed, variable, locations)
    _mark(m, variable, storage, locations)


def _storages(m: Machine[V], home: Home) -> list[Storage[V]]:
    match home:
        case Home.LOCAL:
            return m.memory.locals
        case Home.PORT:
            return m.memory.after if m.in_environment else m.memory.ports
        case Home.ALLREAD:
            return m.memory.allread
        case Home.ALLWRITE:
            return m.memory.allwrite
        case Home.BOUND:
            raise AssertionError("bound variables are values")


def _fresh(
    m: Machine[V],
    place: core.Place,
    storage: Storage[V],
    locations: Sequence[Location[V]],
    value: Value[V],
) -> Storage[V]:
    """The value as storage of the written part: a bare cell where that part lies in an atom."""
    part = storage
    for location in locations:
        if not isinstance(part, Tree):
            return Cell(m.truth(True), value)
        assert not isinstance(location, AtKey)
        if isinstance(part, Many):
            assert isinstance(location, AtIndex)
            part = part.at(location.index)
            continue
        if not part.parts:
            return Cell(m.truth(True), value)
        # All elements of an array have one shape.
        part = part.parts[0 if isinstance(location, AtIndex) else location.position]
    return stored(m.d, place.type, value, m.system.size)


def _check_write(
    m: Machine[V],
    place: core.Place,
    storage: Storage[V],
    locations: Sequence[Location[V]],
    legal: V,
) -> None:
    """Log a fault for the first step of a place that cannot be written. [S-ASSIGN]"""
    if m.d.known(legal) is True:
        return
    part: Storage[V] | Value[V] | None = storage
    for position, (step, location) in enumerate(zip(place.steps, locations, strict=True)):
        if isinstance(part, Tree):
            part, there = descend(m.d, part, location)
            m.fault_unless(there, FaultKind.INDEX, step.span)
        else:
            if isinstance(part, Cell):
                m.fault_unless(part.is_set, FaultKind.UNSET, place.span, place.variable.name)
                part = part.value
            assert part is not None
            is_key = isinstance(location, AtKey)
            if is_key and position + 1 == len(locations):
                return
            part, there = part_of(m.d, part, location)
            kind = FaultKind.KEY if is_key else FaultKind.INDEX
            m.fault_unless(there, kind, step.span)
        if part is None:
            return


def _assign_bound(
    m: Machine[V], place: core.Place, locations: Sequence[Location[V]], value: Value[V]
) -> None:
    """Write a variable of a function or loop, or a part of one.

    Parameters and loop variables are held whole, in a cell; locals of functions start unset.
    """
    variable = place.variable
    storage = m.memory.bound[variable.slot]
    if storage is None:
        storage = unset(m.d, variable.type, m.system.size)
    if isinstance(storage, Cell) and not locations:
        m.memory.bound[variable.slot] = held(m.d, value)
        return
    fresh = _fresh(m, place, storage, locations, value)
    changed, legal = write(m.d, storage, locations, fresh)
    _check_write(m, place, storage, locations, legal)
    m.memory.bound[variable.slot] = _in_room(changed, variable, locations)


def _in_room(
    changed: Storage[V], variable: core.Variable, locations: Sequence[Location[V]]
) -> Storage[V]:
    """Bound a variable's maps after a write: one at a key may add room that is not needed."""
    if any(isinstance(location, AtKey) for location in locations):
        return in_room(changed, variable.type)
    return changed


def _mark(
    m: Machine[V],
    variable: core.Variable,
    storage: Storage[V],
    locations: Sequence[Location[V]],
) -> None:
    """Note which locations of a shared variable were written, and on which path."""
    masks = {Home.ALLREAD: m.allread_masks, Home.ALLWRITE: m.allwrite_masks}.get(variable.home)
    if masks is not None:
        before = masks.get(variable.slot)
        masks[variable.slot] = marked(m.d, before, storage, locations, m.guard)


# --- control ------------------------------------------------------------------------------------


def for_range(m: Machine[V], s: core.ForRange) -> None:
    """Run a loop over a range: bounds are evaluated once; each trip has its condition. [S-FOR]"""

    def once(m: Machine[V], number: V) -> None:
        m.memory.bound[s.variable.slot] = held(m.d, number)
        run(m, s.body)

    if m.system.crowd is not None:
        start, end = scalar(evaluate(m, s.low)), scalar(evaluate(m, s.high))
        if not listable(m, s.low, s.high, start, end):
            m.system.crowd.loop(m, start, end, once, s.span)
            return

    def trip(number: V) -> Callable[[], None]:
        return partial(once, m, number)

    # One after the other: a million of them at once would take up much room.
    _loop(m, ((k, here, trip(number)) for k, here, number in integers(m, s.low, s.high)))


def for_each(m: Machine[V], s: core.ForEach) -> None:
    """Run a loop over the elements of a value that is evaluated before the loop. [S-FOREACH]"""
    over = evaluate(m, s.sequence)
    if isinstance(over, Table):
        pairs = list(over.entries)
    elif isinstance(over, Family):
        for_each_robot(m, s, over)
        return
    else:
        items = sequence(over).items
        pairs = [(m.d.const(k, INT), item) for k, item in enumerate(items)]
    assert isinstance(over, Seq | Table)

    def trip(key: Value[V], value: Value[V]) -> Callable[[], None]:
        def body() -> None:
            if s.key is not None:
                m.memory.bound[s.key.slot] = held(m.d, key)
            m.memory.bound[s.value.slot] = held(m.d, value)
            run(m, s.body)

        return body

    length = over.length
    _loop(m, ((k, inside(m.d, k, length), trip(*pair)) for k, pair in enumerate(pairs)))


def for_each_robot(m: Machine[V], s: core.ForEach, over: Family[V]) -> None:
    """Run a loop over an array over a crowd. [S-FOREACH]"""

    def once(m: Machine[V], number: V) -> None:
        if s.key is not None:
            m.memory.bound[s.key.slot] = held(m.d, number)
        m.memory.bound[s.value.slot] = held(m.d, over.at(number))
        run(m, s.body)

    over.crowd.loop(m, over.crowd.first, over.crowd.count, once, s.span)


def _loop(m: Machine[V], trips: Iterable[tuple[int, V, Callable[[], None]]]) -> None:
    """Run trips of a loop, each with its number and condition, until one breaks. [S-BREAK]"""
    outer = m.memory.broke
    m.memory.broke = m.truth(False)
    for number, here, body in trips:
        m.system.budget.spend()
        left = m.either(m.memory.broke, m.memory.returned)
        if m.d.known(left) is True:
            break
        m.trail.append(number)
        m.branch(m.both(here, m.negated(left)), body, _nothing)
        m.trail.pop()
    m.memory.broke = outer


def atomic(m: Machine[V], s: core.Atomic) -> None:
    """Run an atomic block: note that it is entered; the round decides who may enter. [ATOMIC]"""
    entered = m.entered.get(s.lock_class, m.truth(False))
    m.entered[s.lock_class] = m.either(entered, m.guard)
    run(m, s.body)


# --- lists --------------------------------------------------------------------------------------


def _whole(m: Machine[V], place: core.Place) -> Value[V]:
    """The list or map at a place that a list operation rewrites."""
    return evaluate(m, core.Read(place, span=place.span))


def append(m: Machine[V], s: core.Append) -> None:
    """Append to a list. [S-APPEND]"""
    value = evaluate(m, s.value)
    items = sequence(_whole(m, s.place))
    longer = m.d.binary(BinaryOp.ADD, items.length, m.d.const(1, INT))
    assign(m, s.place, Seq(longer, put_at(m.d, items.length, items.items, value)))


def remove(m: Machine[V], s: core.Remove) -> None:
    """Remove the first equal element, or the key, if there is one. [S-REMOVE]"""
    value = evaluate(m, s.value)
    whole = _whole(m, s.place)
    if isinstance(s.place.type, MapType):
        entries = table(whole)
        found, _ = lookup(m.d, entries, value)
        keys: Sequence[Value[V]] = [key for key, _ in entries.entries]
        length = entries.length
    else:
        keys, length = sequence(whole).items, sequence(whole).length
        found = m.truth(False)
    position = length
    for k in range(len(keys) - 1, -1, -1):
        here = m.both(inside(m.d, k, length), equal(m.d, keys[k], value))
        position = m.d.ite(here, m.d.const(k, INT), position)
        found = m.either(found, here)
    known = m.d.known(found)
    if known is False:
        return
    shorter = m.d.binary(BinaryOp.SUB, length, m.d.const(1, INT))
    new_length = m.d.ite(found, shorter, length)
    if isinstance(whole, Table):
        pairs_as_records: list[Value[V]] = [Rec(pair) for pair in whole.entries]
        rest = without(m.d, position, pairs_as_records)
        pairs = tuple((r.fields[0], r.fields[1]) for r in rest if isinstance(r, Rec))
        changed: Value[V] = Table(new_length, pairs)
    else:
        changed = Seq(new_length, without(m.d, position, keys))
    m.branch(found, lambda: assign(m, s.place, changed), _nothing)


def pop(m: Machine[V], s: core.Pop) -> None:
    """Pop the first of a queue or the last of a list; a fault if it is empty. [S-POP]"""
    items = sequence(_whole(m, s.place))
    zero, one = m.d.const(0, INT), m.d.const(1, INT)
    some = m.d.binary(BinaryOp.LT, zero, items.length)
    m.fault_unless(some, FaultKind.EMPTY, s.span)
    if not items.items:
        if s.into is not None:
            assign(m, s.into, default(m.d, s.into.type, m.system.size))
        return
    last = m.d.binary(BinaryOp.SUB, items.length, one)
    position = zero if isinstance(s.place.type, QueueType) else last
    taken = items.items[0]
    for k in range(1, len(items.items)):
        here = m.d.binary(BinaryOp.EQ, position, m.d.const(k, INT))
        taken = merge_known(m.d, here, items.items[k], taken)
    shorter = m.d.binary(BinaryOp.MAX, zero, last)
    assign(m, s.place, Seq(shorter, without(m.d, position, items.items)))
    if s.into is not None:
        assign(m, s.into, taken)


# --- where bodies start ---------------------------------------------------------------------------


def machine(
    d: Domain[V],
    system: System,
    oracle: Oracle[V],
    *,
    robot: int | None = None,
    locals: tuple[Storage[V], ...] = (),
    ports: tuple[Storage[V], ...] = (),
    copy: Store[V] | None = None,
    after: tuple[Storage[V], ...] = (),
    bound: int = 0,
    view: Configuration[V] | None = None,
) -> Machine[V]:
    """A machine at the start of a body that needs ``bound`` bound slots."""
    system.budget.spend()
    never = d.const(False, BOOL)
    memory: Memory[V] = Memory(
        list(locals),
        list(ports),
        list(copy.allread) if copy is not None else [],
        list(copy.allwrite) if copy is not None else [],
        list(after),
        [None] * bound,
        never,
        never,
        never,
        never,
    )
    return Machine(d, system, robot, oracle, memory, d.const(True, BOOL), evaluate, run, view)
