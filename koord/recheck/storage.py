"""Storage of variables: trees of atoms, each set or unset.

Configurations are made of them, and so is what a running body reads and writes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias, TypeVar, cast

from msgspec import Struct, field
from msgspec.structs import replace

from koord.recheck import maps
from koord.recheck.sorts import Family, Value
from koord.recheck.terms import Term
from koord.recheck.values import Values
from koord.syntax import core
from koord.syntax.source import Span
from koord.syntax.types import MapType, Type

T = TypeVar("T")


class OfRobot(Struct, frozen=True):
    """Something that hangs on a robot's number: see :meth:`Storages.of`."""


class Cell(OfRobot, frozen=True):
    """An atom. Where it is not set, its value is arbitrary."""

    is_set: Term
    value: Value


class Many(Struct, frozen=True):
    """Storage of an array over the robots of an open number."""

    at: Callable[[Term], Storage]


Storage: TypeAlias = "Cell | tuple[Storage, ...] | Many"


class Field(Struct, frozen=True):
    """A step to a field of a record."""

    position: int


class AtKey(OfRobot, frozen=True):
    """A step to the entry of a map."""

    key: Value
    type: MapType


#: A step of a location: a field, the index of an element, or the key of an entry.
Location: TypeAlias = "Field | Term | AtKey"


class Robot(OfRobot, frozen=True):
    """A robot's own part of a configuration. ``ran`` is its event's position, -1 for none."""

    locals: tuple[Storage, ...]
    ports: tuple[Storage, ...]
    asked: Term
    stopped: Term
    ran: Term


class Store(Struct, frozen=True):
    """The shared variables by slot."""

    allread: tuple[Storage, ...]
    allwrite: tuple[Storage, ...]


class State(Struct, frozen=True):
    """The part of a configuration that properties read."""

    robots: tuple[Robot, ...]
    store: Store


class ParameterisedState(Struct, frozen=True):
    """A configuration of any number of robots; ``robot`` gives the one of a kind with a number."""

    robot: Callable[[int, Term], Robot]
    store: Store


class Write(OfRobot, frozen=True):
    """A write to a shared variable, where ``when`` holds."""

    when: Term
    variable: core.Variable
    locations: tuple[Location, ...]
    value: Value


class Fault(OfRobot, frozen=True):
    """A fault under the condition ``when``."""

    when: Term
    what: str
    span: Span

    def of(self, when: Term) -> Fault:
        """The same fault under another condition."""
        return Fault(when, self.what, self.span)


class Memory(Struct):
    """The memory of a body: M and cp of a robot, or in a property a configuration."""

    locals: list[Storage] = field(default_factory=list)
    ports: list[Storage] = field(default_factory=list)
    allread: list[Storage] = field(default_factory=list)
    allwrite: list[Storage] = field(default_factory=list)
    after: list[Storage] | None = None  #: ports after the environment's turn, while it runs
    #: In a property: the configuration that it is about.
    state: State | ParameterisedState | None = None


class Frame(Struct):
    """The frame of a function call: whether it has returned, and its result."""

    result: Storage
    type: Type | None
    returned: Term


class Storages(Struct, frozen=True):
    """Operations on storage: read, write, merge."""

    v: Values

    def unset(self, type_: Type) -> Storage:
        if self.v.is_family(type_):
            element = self.unset(self.v.element(type_))
            return Many(lambda index: element)
        parts = self.v.parts(type_)
        if parts is not None:
            return tuple(self.unset(part) for _, part in parts)
        return Cell(self.v.t.truth(False), self.v.default(type_))

    def stored(self, value: Value, type_: Type) -> Storage:
        """A value as storage, every atom set; a list literal may set a part of an array only."""
        if isinstance(value, Family) and self.v.is_family(type_):
            below, family = self.v.element(type_), value
            return Many(lambda index: self.stored(family.at(index), below))
        parts = self.v.parts(type_)
        if parts is None:
            return Cell(self.v.t.truth(True), value)
        assert isinstance(value, tuple)
        return tuple(
            self.stored(value[k], part) if k < len(value) else self.unset(part)
            for k, (_, part) in enumerate(parts)
        )

    def anything(self, name: str, type_: Type, like: Storage) -> Storage:
        """An arbitrary storage, with every atom set that is surely set in ``like``."""
        if isinstance(like, Many):
            element = self.v.element(type_)
            return self.many(lambda index: self.anything(f"{name}[]", element, like.at(index)))
        if isinstance(like, Cell):
            is_set = like.is_set
            if is_set.value is not True:
                is_set = self.v.symbol(f"{name} is set", "Bool")
            known = isinstance(like.value, tuple) and self.v.parts(type_) is None
            length = len(like.value) if known and isinstance(like.value, tuple) else None
            return Cell(is_set, self.v.fresh(name, type_, length))
        parts = self.v.parts(type_)
        assert parts is not None
        return tuple(
            self.anything(name + label, part, below)
            for below, (label, part) in zip(like, parts, strict=True)
        )

    def loosened(self, storage: Storage, type_: Type) -> Storage:
        """The same storage, with lists of known length as lists of any length."""
        if isinstance(storage, Many):
            element = self.v.element(type_)
            return Many(lambda index: self.loosened(storage.at(index), element))
        if isinstance(storage, Cell):
            if self.v.parts(type_) is None and isinstance(storage.value, tuple):
                return Cell(storage.is_set, self.v.pack(storage.value, type_))
            return storage
        return tuple(
            self.loosened(below, part)
            for below, part in zip(storage, self.v.inner(type_), strict=True)
        )

    def read(self, storage: Storage, type_: Type) -> tuple[Value, Term]:
        """The value of storage, and the condition that every atom of it is set."""
        if isinstance(storage, Many):
            element = self.v.element(type_)
            whole = self.v.every(lambda index: self.read(storage.at(index), element)[1])
            return Family(lambda index: self.read(storage.at(index), element)[0]), whole
        if isinstance(storage, Cell):
            return storage.value, storage.is_set
        below = [self.read(s, part) for s, part in zip(storage, self.v.inner(type_), strict=True)]
        return tuple(value for value, _ in below), self.v.t.conjunction(s for _, s in below)

    def below(
        self, storage: tuple[Storage, ...] | Many, location: Location, type_: Type
    ) -> Storage:
        """A part of a tree; any part if it does not exist."""
        if isinstance(storage, Many):
            assert isinstance(location, Term)
            return storage.at(location)
        if isinstance(location, Field):
            return storage[location.position]
        assert isinstance(location, Term)  # a map is an atom: no key leads through a tree
        if location.value is not None:
            k = int(location.value)
            if 0 <= k < len(storage):
                return storage[k]
            return self.unset(self.v.element(type_))
        found = storage[-1]
        for k in range(len(storage) - 2, -1, -1):
            here = self.v.t.equal(location, self.v.t.integer(k))
            found = self.merge(here, storage[k], found, self.v.element(type_))
        return found

    def merge(self, condition: Term, a: Storage, b: Storage, type_: Type) -> Storage:
        """If-then-else: ``a`` where the condition holds, else ``b``."""
        if condition.value is not None:
            return a if condition.value else b
        if a is b:
            return a
        if isinstance(a, Many):
            assert isinstance(b, Many)
            element, other = self.v.element(type_), b
            return Many(lambda k: self.merge(condition, a.at(k), other.at(k), element))
        if isinstance(a, Cell):
            assert isinstance(b, Cell)
            is_set = self.v.t.ite(condition, a.is_set, b.is_set)
            return Cell(is_set, self.v.merge(condition, a.value, b.value, type_))
        assert isinstance(b, tuple)
        return tuple(
            self.merge(condition, x, y, part)
            for x, y, part in zip(a, b, self.v.inner(type_), strict=True)
        )

    def merge_robots(self, condition: Term, a: Robot, b: Robot, agent: core.Agent) -> Robot:
        """If-then-else: the robot ``a`` of a kind where the condition holds, else ``b``."""
        t = self.v.t
        locals_ = zip(agent.locals, a.locals, b.locals, strict=True)
        ports = zip(agent.ports, a.ports, b.ports, strict=True)
        return Robot(
            tuple(self.merge(condition, x, y, d.variable.type) for d, x, y in locals_),
            tuple(self.merge(condition, x, y, p.declaration.variable.type) for p, x, y in ports),
            t.ite(condition, a.asked, b.asked),
            t.ite(condition, a.stopped, b.stopped),
            t.ite(condition, a.ran, b.ran),
        )

    def put(
        self,
        storage: Storage,
        type_: Type,
        locations: Sequence[Location],
        new: Value,
        guard: Term,
    ) -> Storage:
        """Replace a part of storage where the guard holds. A missing part is not written."""
        if guard.value is False:
            return storage
        if isinstance(storage, Cell) and locations:
            value = self._put_value(storage.value, type_, locations, new)
            there = self.v.t.both(guard, storage.is_set)
            return Cell(storage.is_set, self.v.merge(there, value, storage.value, type_))
        if not locations:
            return self.merge(guard, self.stored(new, type_), storage, type_)
        first, rest = locations[0], locations[1:]
        if isinstance(storage, Many):
            assert isinstance(first, Term)
            return self._put_in(storage, self.v.element(type_), first, rest, new, guard)
        assert isinstance(storage, tuple)
        changed = []
        for k, (below, part) in enumerate(zip(storage, self.v.inner(type_), strict=True)):
            if isinstance(first, Field):
                here = self.v.t.truth(k == first.position)
            else:
                assert isinstance(first, Term)
                here = self.v.t.equal(first, self.v.t.integer(k))
            changed.append(self.put(below, part, rest, new, self.v.t.both(guard, here)))
        return tuple(changed)

    def _put_in(
        self,
        storage: Many,
        type_: Type,
        index: Term,
        locations: Sequence[Location],
        new: Value,
        guard: Term,
    ) -> Many:
        t = self.v.t

        def at(k: Term) -> Storage:
            here = t.both(guard, t.equal(index, k))
            return self.put(storage.at(k), type_, locations, new, here)

        return Many(at)

    def many(self, element: Callable[[Term], Storage]) -> Many:
        """Storage from one element, computed for a variable number."""
        with self.v.scoped((*self.v.scope, blank := self.v.t.blank())):
            one = element(blank)
        return Many(lambda index: self.of(one, blank, index))

    def of(self, known: T, old: Term, new: Term) -> T:
        """Substitute a term for a variable in storage, or in all facts about a robot."""

        def put(part: Any) -> Any:
            match part:
                case Term() | Family():
                    return self.v.put(part, old, new)
                case Many(at=at):
                    return Many(lambda index: put(at(index)))
                case tuple():
                    return tuple(map(put, part))
                case dict():
                    return {key: put(value) for key, value in part.items()}
                case OfRobot():
                    fields = {name: put(getattr(part, name)) for name in part.__struct_fields__}
                    return replace(part, **fields)
                case _:
                    return part

        return cast("T", put(known))

    def same(self, a: Storage, b: Storage, type_: Type) -> Term:
        """The condition that two variables have equal storage."""
        if a is b:
            return self.v.t.truth(True)
        if isinstance(a, Cell):
            assert isinstance(b, Cell)
            alike = self.v.t.equal(a.is_set, b.is_set)
            return self.v.t.both(alike, self.v.equal(a.value, b.value, type_))
        if isinstance(a, Many):
            assert isinstance(b, Many)
            element, other = self.v.element(type_), b
            return self.v.every(lambda k: self.same(a.at(k), other.at(k), element))
        assert isinstance(b, tuple)
        return self.v.t.conjunction(
            self.same(x, y, part) for x, y, part in zip(a, b, self.v.inner(type_), strict=True)
        )

    def _put_value(
        self, value: Value, type_: Type, locations: Sequence[Location], new: Value
    ) -> Value:
        if not locations:
            return new
        first, rest = locations[0], locations[1:]
        if isinstance(first, Field):
            assert isinstance(value, tuple)
            k = first.position
            inner = self._put_value(value[k], self.v.inner(type_)[k], rest, new)
            return (*value[:k], inner, *value[k + 1 :])
        if isinstance(first, AtKey):
            assert isinstance(type_, MapType)
            assert isinstance(value, Term)
            if not rest:
                return maps.with_entry(self.v, value, first.key, new, type_)
            entry = maps.at(self.v, value, first.key, type_)
            entry = self._put_value(entry, type_.value, rest, new)
            there = maps.has(self.v, value, first.key, type_)
            changed = maps.with_entry(self.v, value, first.key, entry, type_)
            return self.v.merge(there, changed, value, type_)
        old = self.v.at(value, first, type_)
        inner = self._put_value(old, self.v.element(type_), rest, new)
        return self.v.with_element(value, first, inner, type_)
