"""What a variable holds: atoms that are set or unset. [ATOM]

A scalar, a list, a map or an opaque value is one *atom*, a ``Cell``; records and fixed arrays are
trees of atoms.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Generic, TypeAlias, TypeVar

from msgspec import Struct

from koord.semantics.domain import Domain, conjunction
from koord.semantics.parameterised import Crowd, NotFiniteError, Size
from koord.semantics.values import (
    UNLISTED,
    Family,
    Rec,
    Seq,
    Table,
    Value,
    default,
    equal,
    family_of,
    in_range,
    insert,
    listed,
    lookup,
    merge,
    merge_known,
    pick,
    record,
    sequence,
    table,
)
from koord.syntax.core import BinaryOp
from koord.syntax.source import NOWHERE
from koord.syntax.types import BOOL, INT, ArrayType, RecordType, Robots, Type

V = TypeVar("V")


class Cell(Struct, Generic[V], frozen=True):
    """One atom. Where it is not set, ``value`` is some value of its type."""

    is_set: V
    value: Value[V]


class Tree(Struct, Generic[V], frozen=True):
    """The fields of a record or the elements of a fixed array."""

    parts: tuple[Storage[V], ...]


class Many(Tree[V], Generic[V], frozen=True):
    """The elements of an array over the robots of a crowd, none of them listed."""

    crowd: Crowd[V]
    at: Callable[[V], Storage[V]]


def many_of(crowd: Crowd[V], at: Callable[[V], Storage[V]]) -> Many[V]:
    """The storage of an array over the robots of a crowd with such elements."""
    return Many(UNLISTED, crowd, at)


Storage: TypeAlias = "Cell[V] | Tree[V]"


# --- steps with their index or key evaluated ----------------------------------------------------


class AtIndex(Struct, Generic[V], frozen=True):
    index: V


class AtKey(Struct, Generic[V], frozen=True):
    key: Value[V]


class AtField(Struct, frozen=True):
    position: int


Location: TypeAlias = "AtIndex[V] | AtKey[V] | AtField"


# --- making -------------------------------------------------------------------------------------


def unset(d: Domain[V], type_: Type, robots: Size[V]) -> Storage[V]:
    """Storage of a type that holds nothing yet."""
    match type_:
        case RecordType(fields=fields):
            return Tree(tuple(unset(d, field, robots) for _, field in fields))
        case ArrayType(element=element, size=size):
            count = robots if size is Robots.ALL else size
            nothing = unset(d, element, robots)
            if not isinstance(count, int):
                return many_of(count, lambda index: nothing)
            return Tree((nothing,) * count)
        case _:
            return Cell(d.const(False, BOOL), default(d, type_, robots))


def stored(d: Domain[V], type_: Type, value: Value[V], robots: Size[V]) -> Storage[V]:
    """Storage of a type that holds a value. A fixed array takes what fits; the rest is unset."""
    match type_:
        case RecordType(fields=fields):
            pairs = zip(fields, record(value).fields, strict=True)
            return Tree(tuple(stored(d, field, part, robots) for (_, field), part in pairs))
        case ArrayType(element=element, size=size):
            count = robots if size is Robots.ALL else size
            if not isinstance(count, int):
                return _stored_family(d, element, value, robots)
            items = sequence(value).items[:count]
            filled = [stored(d, element, item, robots) for item in items]
            return Tree((*filled, *[unset(d, element, robots)] * (count - len(filled))))
        case _:
            return Cell(d.const(True, BOOL), value)


def _stored_family(d: Domain[V], element: Type, value: Value[V], robots: Size[V]) -> Storage[V]:
    if not isinstance(value, Family):
        raise NotFiniteError(NOWHERE, "a list is stored in an array over all robots")
    family: Family[V] = value
    return many_of(family.crowd, lambda i: stored(d, element, family.at(i), robots))


def held(d: Domain[V], value: Value[V]) -> Cell[V]:
    """A value in a cell of its own, as bound variables are held."""
    return Cell(d.const(True, BOOL), value)


# --- reading ------------------------------------------------------------------------------------


def contents(d: Domain[V], storage: Storage[V], type_: Type) -> tuple[Value[V], V]:
    """The value held, and whether every atom of it is set. [LOOKUP]"""
    if isinstance(storage, Cell):
        return storage.value, storage.is_set
    if isinstance(storage, Many):
        return _family_contents(d, storage, type_)
    if isinstance(type_, RecordType):
        types: Sequence[Type] = [field for _, field in type_.fields]
    else:
        assert isinstance(type_, ArrayType)
        types = [type_.element] * len(storage.parts)
    read = [contents(d, part, t) for part, t in zip(storage.parts, types, strict=True)]
    all_set = conjunction(d, [is_set for _, is_set in read])
    values = tuple(value for value, _ in read)
    return (Rec(values) if isinstance(type_, RecordType) else listed(d, values)), all_set


def _family_contents(d: Domain[V], many: Many[V], type_: Type) -> tuple[Value[V], V]:
    assert isinstance(type_, ArrayType)
    element, crowd = type_.element, many.crowd
    value = family_of(crowd, lambda i: contents(d, many.at(i), element)[0])
    all_set = crowd.every(crowd.first, crowd.count, lambda i: contents(d, many.at(i), element)[1])
    return value, all_set


def descend(
    d: Domain[V], storage: Storage[V], location: Location[V]
) -> tuple[Storage[V] | None, V]:
    """The storage one step below a tree, and whether the step is legal. None: nothing is there."""
    assert isinstance(storage, Tree)
    if isinstance(location, AtField):
        return storage.parts[location.position], d.const(True, BOOL)
    assert isinstance(location, AtIndex)
    if isinstance(storage, Many):
        return storage.at(location.index), in_range(d, location.index, storage.crowd.count)
    legal = in_range(d, location.index, d.const(len(storage.parts), INT))
    return _pick_storage(d, location.index, storage.parts), legal


def _pick_storage(d: Domain[V], index: V, parts: Sequence[Storage[V]]) -> Storage[V] | None:
    known = d.known(index)
    if known is not None:
        assert isinstance(known, int)
        if 0 <= known < len(parts):
            return parts[known]
        return parts[0] if parts else None
    if not parts:
        return None
    chosen = parts[-1]
    for position in range(len(parts) - 2, -1, -1):
        here = d.binary(BinaryOp.EQ, index, d.const(position, INT))
        chosen = merge_storage(d, here, parts[position], chosen)
    return chosen


def part_of(d: Domain[V], value: Value[V], location: Location[V]) -> tuple[Value[V] | None, V]:
    """The part of a value one step below it, and whether the step is legal."""
    if isinstance(location, AtField):
        return record(value).fields[location.position], d.const(True, BOOL)
    if isinstance(location, AtIndex):
        items = sequence(value)
        legal = in_range(d, location.index, items.length)
        if isinstance(items, Family):
            return items.at(location.index), legal
        return pick(d, location.index, items.items), legal
    found, there = lookup(d, table(value), location.key)
    return there, found


# --- writing ------------------------------------------------------------------------------------


def write(
    d: Domain[V],
    storage: Storage[V],
    locations: Sequence[Location[V]],
    fresh: Storage[V],
) -> tuple[Storage[V], V]:
    """The storage with ``fresh`` at a place below it, and whether the place exists. [LOCATION]

    ``fresh`` is the storage of the written part where that part is a tree or an atom, and a set
    cell with the part's new value where the part lies inside an atom.
    """
    if not locations:
        return fresh, d.const(True, BOOL)
    first, rest = locations[0], locations[1:]
    if isinstance(storage, Cell):
        assert isinstance(fresh, Cell)
        value, legal = _write_inside(d, storage.value, locations, fresh.value)
        # A key may be put into a map only once the map itself is set, as with a list's element.
        return Cell(storage.is_set, value), conjunction(d, [storage.is_set, legal])
    if isinstance(first, AtField):
        part, legal = write(d, storage.parts[first.position], rest, fresh)
        return Tree(_replaced(storage.parts, first.position, part)), legal
    assert isinstance(first, AtIndex)
    return _write_element(d, storage, first.index, rest, fresh)


def _write_element(
    d: Domain[V], storage: Tree[V], index: V, rest: Sequence[Location[V]], fresh: Storage[V]
) -> tuple[Storage[V], V]:
    if isinstance(storage, Many):
        return _write_robots(d, storage, index, rest, fresh)
    legal = in_range(d, index, d.const(len(storage.parts), INT))
    known = d.known(index)
    if known is not None:
        assert isinstance(known, int)
        if not 0 <= known < len(storage.parts):
            return storage, legal
        part, below = write(d, storage.parts[known], rest, fresh)
        return Tree(_replaced(storage.parts, known, part)), below
    parts = []
    for position, part in enumerate(storage.parts):
        here = d.binary(BinaryOp.EQ, index, d.const(position, INT))
        changed, below = write(d, part, rest, fresh)
        parts.append(merge_storage(d, here, changed, part))
        legal = conjunction(d, [legal, d.binary(BinaryOp.IMPLIES, here, below)])
    return Tree(tuple(parts)), legal


def _write_robots(
    d: Domain[V], many: Many[V], index: V, rest: Sequence[Location[V]], fresh: Storage[V]
) -> tuple[Storage[V], V]:
    """The same where the elements are those of a crowd."""
    part, below = write(d, many.at(index), rest, fresh)

    def at(i: V) -> Storage[V]:
        here = d.binary(BinaryOp.EQ, i, index)
        return merge_storage_known(d, here, part, many.at(i))

    legal = in_range(d, index, many.crowd.count)
    return many_of(many.crowd, remembering(at)), conjunction(d, [legal, below])


def _write_inside(
    d: Domain[V], value: Value[V], locations: Sequence[Location[V]], fresh: Value[V]
) -> tuple[Value[V], V]:
    """The same inside the value of an atom."""
    if not locations:
        return fresh, d.const(True, BOOL)
    first, rest = locations[0], locations[1:]
    if isinstance(first, AtField):
        fields = record(value).fields
        part, legal = _write_inside(d, fields[first.position], rest, fresh)
        return Rec(_replaced(fields, first.position, part)), legal
    if isinstance(first, AtKey):
        return _write_key(d, table(value), first.key, rest, fresh)
    items = sequence(value)
    legal = in_range(d, first.index, items.length)
    if isinstance(items, Family):
        return _write_family(d, items, first.index, rest, fresh)
    known = d.known(first.index)
    if known is not None and known not in range(len(items.items)):
        return value, legal
    changed = []
    for position, item in enumerate(items.items):
        here = d.binary(BinaryOp.EQ, first.index, d.const(position, INT))
        if d.known(here) is False:
            changed.append(item)
            continue
        part, below = _write_inside(d, item, rest, fresh)
        changed.append(merge_known(d, here, part, item))
        legal = conjunction(d, [legal, d.binary(BinaryOp.IMPLIES, here, below)])
    return Seq(items.length, tuple(changed)), legal


def _write_family(
    d: Domain[V], family: Family[V], index: V, rest: Sequence[Location[V]], fresh: Value[V]
) -> tuple[Value[V], V]:
    part, below = _write_inside(d, family.at(index), rest, fresh)

    def at(i: V) -> Value[V]:
        return merge_known(d, d.binary(BinaryOp.EQ, i, index), part, family.at(i))

    legal = in_range(d, index, family.length)
    return family_of(family.crowd, at), conjunction(d, [legal, below])


def _write_key(
    d: Domain[V], entries: Table[V], key: Value[V], rest: Sequence[Location[V]], fresh: Value[V]
) -> tuple[Value[V], V]:
    if not rest:
        return insert(d, entries, key, fresh), d.const(True, BOOL)
    found, there = lookup(d, entries, key)
    if there is None:
        return entries, d.const(False, BOOL)
    part, below = _write_inside(d, there, rest, fresh)
    return insert(d, entries, key, part), conjunction(d, [found, below])


T = TypeVar("T")


def _replaced(parts: tuple[T, ...], position: int, part: T) -> tuple[T, ...]:
    return (*parts[:position], part, *parts[position + 1 :])


def remembering(at: Callable[[V], Storage[V]]) -> Callable[[V], Storage[V]]:
    """The same, but what was asked last is not worked out again.

    Two sides of a branch have most in common, and each asks for it: without this a chain of
    branches would cost twice as much with each of them.
    """
    last: list[tuple[V, Storage[V]]] = []

    def remembered(index: V) -> Storage[V]:
        if not last or last[0][0] is not index:
            last[:] = [(index, at(index))]
        return last[0][1]

    return remembered


def set_only_if(d: Domain[V], storage: Storage[V], condition: V) -> Storage[V]:
    """The storage, with nothing set where the condition does not hold."""
    if isinstance(storage, Cell):
        return Cell(d.binary(BinaryOp.AND, storage.is_set, condition), storage.value)
    if isinstance(storage, Many):
        at = storage.at
        return many_of(storage.crowd, lambda i: set_only_if(d, at(i), condition))
    return Tree(tuple(set_only_if(d, part, condition) for part in storage.parts))


# --- merging ------------------------------------------------------------------------------------


def merge_storage(d: Domain[V], condition: V, then: Storage[V], other: Storage[V]) -> Storage[V]:
    """``then`` where the condition holds, ``other`` elsewhere; both of one shape."""
    if then is other:
        return then
    if isinstance(then, Cell):
        assert isinstance(other, Cell)
        is_set = d.ite(condition, then.is_set, other.is_set)
        return Cell(is_set, merge(d, condition, then.value, other.value))
    assert isinstance(other, Tree)
    if isinstance(then, Many) and isinstance(other, Many):
        first, second = then.at, other.at
        return many_of(
            then.crowd, remembering(lambda i: merge_storage(d, condition, first(i), second(i)))
        )
    pairs = zip(then.parts, other.parts, strict=True)
    return Tree(tuple(merge_storage(d, condition, a, b) for a, b in pairs))


def merge_storage_known(
    d: Domain[V], condition: V, then: Storage[V], other: Storage[V]
) -> Storage[V]:
    """:func:`merge_storage`, or one side alone where the domain knows which."""
    known = d.known(condition)
    if known is None:
        return merge_storage(d, condition, then, other)
    return then if known else other


def same_storage(d: Domain[V], left: Storage[V], right: Storage[V]) -> V:
    """Whether two storages of one shape hold the same: same atoms set, with equal values."""
    if isinstance(left, Cell):
        assert isinstance(right, Cell)
        same_flag = d.binary(BinaryOp.EQ, left.is_set, right.is_set)
        same_value = equal(d, left.value, right.value)
        return conjunction(d, [same_flag, d.binary(BinaryOp.IMPLIES, left.is_set, same_value)])
    assert isinstance(right, Tree)
    pairs = zip(left.parts, right.parts, strict=True)
    return conjunction(d, [same_storage(d, a, b) for a, b in pairs])
