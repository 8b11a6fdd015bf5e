"""Places that a body reads and writes. [LOOKUP] [LOCAL-ASSIGN] [SHARED-ASSIGN]"""

from __future__ import annotations

from collections.abc import Sequence
from typing import assert_never

from koord.recheck import all_robots, maps
from koord.recheck.body import RunningBody
from koord.recheck.sorts import Family, Value
from koord.recheck.storage import AtKey, Cell, Field, Location, Many, Storage, Write
from koord.recheck.terms import Term
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.source import Span
from koord.syntax.types import MapType, QueueType, Type


def read(body: RunningBody, place: core.Place) -> Value:
    """Read a place from the robot's own memory. [LOOKUP]"""
    storage, type_ = root(body, place), place.variable.type
    steps = list(place.steps)
    while steps and not isinstance(storage, Cell):
        step = steps.pop(0)
        location = located(body, step, type_)
        if isinstance(location, Term):
            check_index(body, location, storage, step.span)
        storage, type_ = body.s.below(storage, location, type_), step.type
    value, is_set = body.s.read(storage, type_)
    body.fault_unless(is_set, f"{place.variable.name} is read while unset", place.span)
    return part(body, value, type_, steps)


def check_index(body: RunningBody, index: Term, storage: Storage, span: Span) -> None:
    t = body.t
    if isinstance(storage, Many):
        there = all_robots.is_robot(body, index)
    else:
        assert isinstance(storage, tuple)
        size = t.integer(len(storage))
        there = t.both(t.at_most(t.integer(0), index), t.less(index, size))
    body.fault_unless(there, "index out of range", span)


def part(body: RunningBody, value: Value, type_: Type, steps: Sequence[core.Step]) -> Value:
    for step in steps:
        value = _below(body, value, located(body, step, type_), type_, step.span)
        type_ = step.type
    return value


def _below(
    body: RunningBody, value: Value, location: Location, type_: Type, span: Span | None
) -> Value:
    """The part of a value at a location; that there is one is asked where a span is given."""
    if isinstance(location, Field):
        assert isinstance(value, tuple)
        return value[location.position]
    if isinstance(location, AtKey):
        assert isinstance(value, Term)
        if span is not None:
            there = maps.has(body.v, value, location.key, location.type)
            body.fault_unless(there, "no such key", span)
        return maps.at(body.v, value, location.key, location.type)
    if span is not None:
        of_all = isinstance(value, Family)
        there = all_robots.is_robot(body, location) if of_all else body.v.inside(value, location)
        body.fault_unless(there, "index out of range", span)
    return body.v.at(value, location, type_)


def located(body: RunningBody, step: core.Step, type_: Type) -> Location:
    """Evaluate a step into a value of a type to a location."""
    match step:
        case core.FieldStep(position=position):
            return Field(position)
        case core.IndexStep(index=index):
            return body.condition(index)
        case core.KeyStep(key=key):
            assert isinstance(type_, MapType)
            return AtKey(body.value(key), type_)
    assert_never(step)


def root(body: RunningBody, place: core.Place) -> Storage:
    variable, memory = place.variable, body.memory
    match variable.home:
        case Home.BOUND:
            found = body.bound[variable.slot]
            return found if found is not None else body.s.unset(variable.type)
        case Home.ALLREAD:
            return memory.allread[variable.slot]
        case Home.ALLWRITE:
            return memory.allwrite[variable.slot]
        case Home.LOCAL | Home.PORT if memory.state is not None:
            return of_named(body, place)
        case Home.LOCAL:
            return memory.locals[variable.slot]
        case Home.PORT:
            if place.primed:
                assert memory.after is not None
                return memory.after[variable.slot]
            return memory.ports[variable.slot]
    assert_never(variable.home)


def of_named(body: RunningBody, place: core.Place) -> Storage:
    """Evaluate ``v@i``: the variable of the robot with a number. [PROP-READ]"""
    assert place.robot is not None
    number, type_ = body.condition(place.robot), place.variable.type
    found: Storage = body.s.unset(type_)
    there: list[Term] = []
    for kind, here, robot in reversed(all_robots.candidates(body, number)):
        slot = body.world.slot_of(kind, place.variable)
        if slot is not None:
            own = (robot.locals if place.variable.home is Home.LOCAL else robot.ports)[slot]
            # The last one needs no condition: there is no such robot otherwise, which is a fault.
            found = body.s.merge(here, own, found, type_) if there else own
            there.append(here)
    right = body.t.disjunction(there)
    if body.crowd is not None:
        if len(there) == len(body.world.program.agents):
            right = body.t.truth(True)
        right = body.t.both(all_robots.is_robot(body, number), right)
    body.fault_unless(right, "no such robot", place.robot.span)
    return found


def assign(body: RunningBody, place: core.Place, value: Value) -> None:
    """Write a place. [LOCAL-ASSIGN] [SHARED-ASSIGN] [ALLREAD] [ACTUATE]"""
    variable = place.variable
    types = [variable.type, *(step.type for step in place.steps)]
    locations = tuple(located(body, step, t) for step, t in zip(place.steps, types, strict=False))
    storages = held_in(body, variable.home)
    before = storages[variable.slot]
    if before is None:
        before = body.s.unset(variable.type)
    check_place(body, place, before, locations)
    after = body.s.put(before, variable.type, locations, value, body.path)
    storages[variable.slot] = after
    if variable.home in (Home.ALLREAD, Home.ALLWRITE):
        keys = [k for k, location in enumerate(locations, start=1) if isinstance(location, AtKey)]
        if keys and keys[0] < len(locations):
            # Below a key the whole entry is one location. [LOCATION]
            locations = locations[: keys[0]]
            value = entry_in(body, after, place, locations)
        body.writes.append(Write(body.path, variable, locations, value))


def held_in(body: RunningBody, home: Home) -> list[Storage] | list[Storage | None]:
    memory = body.memory
    match home:
        case Home.LOCAL:
            return memory.locals
        case Home.PORT:
            return memory.ports if memory.after is None else memory.after
        case Home.ALLREAD:
            return memory.allread
        case Home.ALLWRITE:
            return memory.allwrite
        case Home.BOUND:
            return body.bound
    assert_never(home)


def check_place(
    body: RunningBody, place: core.Place, storage: Storage, locations: Sequence[Location]
) -> None:
    """Check that a place exists for writing; the first step that fails is a fault. [S-ASSIGN]"""
    type_, value = place.variable.type, None
    for k, (step, location) in enumerate(zip(place.steps, locations, strict=True)):
        if value is None and isinstance(storage, Cell):
            what = f"{place.variable.name} is written into while unset"
            body.fault_unless(storage.is_set, what, place.span)
            value = storage.value
        if value is not None:
            is_new = isinstance(location, AtKey) and k + 1 == len(locations)
            value = _below(body, value, location, type_, None if is_new else step.span)
        else:
            assert not isinstance(storage, Cell)
            if isinstance(location, Term):
                check_index(body, location, storage, step.span)
            storage = body.s.below(storage, location, type_)
        type_ = step.type


def entry_in(
    body: RunningBody, storage: Storage, place: core.Place, locations: Sequence[Location]
) -> Value:
    """The value of storage at locations that lead to an existing entry."""
    type_, value = place.variable.type, None
    for step, location in zip(place.steps, locations, strict=False):
        if value is None and isinstance(storage, Cell):
            value = storage.value
        if value is None:
            assert not isinstance(storage, Cell)
            storage = body.s.below(storage, location, type_)
        else:
            value = _below(body, value, location, type_, None)
        type_ = step.type
    assert value is not None
    return value


def removed(body: RunningBody, s: core.Remove) -> None:
    """Remove the first equal element, if there is one, or the key. [S-REMOVE]"""
    wanted = body.value(s.value)
    whole = read(body, s.place)
    if isinstance(s.place.type, MapType):
        assert isinstance(whole, Term)
        with body.where(maps.has(body.v, whole, wanted, s.place.type)):
            assign(body, s.place, maps.without(body.v, whole, wanted, s.place.type))
        return
    position = body.v.position(whole, wanted, s.place.type)
    found = body.t.at_most(body.t.integer(0), position)
    with body.where(found):
        assign(body, s.place, body.v.without(whole, position, s.place.type))


def popped(body: RunningBody, s: core.Pop) -> None:
    """Pop the first element of a queue, or the last of a list. [S-POP]"""
    t, type_ = body.t, s.place.type
    whole = read(body, s.place)
    length = body.v.length(whole)
    body.fault_unless(t.less(t.integer(0), length), "empty list", s.span)
    last = t.minus(length, t.integer(1))
    position = t.integer(0) if isinstance(type_, QueueType) else last
    taken = body.v.at(whole, position, type_)
    assign(body, s.place, body.v.without(whole, position, type_))
    if s.into is not None:
        assign(body, s.into, taken)


def storage_of(body: RunningBody, variable: core.Variable) -> Storage:
    found = held_in(body, variable.home)[variable.slot]
    return body.s.unset(variable.type) if found is None else found


def set_storage(body: RunningBody, variable: core.Variable, storage: Storage) -> None:
    held_in(body, variable.home)[variable.slot] = storage
