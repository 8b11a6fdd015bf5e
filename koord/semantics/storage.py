"""Storage of variables: trees of atoms that are set or unset. [ATOM]

A scalar, a list, a map or an opaque value is one *atom*, a ``Cell``; records and fixed arrays are
trees of atoms.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Generic, TypeAlias, TypeVar

from msgspec import Struct

from koord.semantics.domain import Domain, conjunction
from koord.semantics.every_number import Crowd, NotFiniteError, Size
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
    listed,
    merge,
    record,
    sequence,
)
from koord.syntax.core import BinaryOp
from koord.syntax.source import NOWHERE
from koord.syntax.types import (
    BOOL,
    ArrayType,
    MapType,
    RecordType,
    Robots,
    SequenceType,
    Type,
    how_many,
    within,
)

V = TypeVar("V")


class Cell(Struct, Generic[V], frozen=True):
    """A leaf of storage: one atom. Where it is not set, ``value`` is any value of its type."""

    is_set: V
    value: Value[V]


class Tree(Struct, Generic[V], frozen=True):
    """A node of storage: the fields of a record or the elements of a fixed array."""

    parts: tuple[Storage[V], ...]


class Many(Tree[V], Generic[V], frozen=True):
    """A node of storage for an array over the robots of a crowd, its elements not listed."""

    crowd: Crowd[V]
    at: Callable[[V], Storage[V]]


def many_of(crowd: Crowd[V], at: Callable[[V], Storage[V]]) -> Many[V]:
    """Storage of an array over the robots of a crowd, from its element at an index."""
    return Many(UNLISTED, crowd, at)


Storage: TypeAlias = "Cell[V] | Tree[V]"


# --- making -------------------------------------------------------------------------------------


def unset(d: Domain[V], type_: Type, robots: Size[V]) -> Storage[V]:
    """Storage of a type with all atoms unset."""
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
    """Storage of a type set to a value. A fixed array takes what fits; the rest is unset."""
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
    """A value in a cell of its own, as for bound variables."""
    return Cell(d.const(True, BOOL), value)


# --- reading ------------------------------------------------------------------------------------


def contents(d: Domain[V], storage: Storage[V], type_: Type) -> tuple[Value[V], V]:
    """Return the value held, and the condition that every atom of it is set. [LOOKUP]"""
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


def remembering(at: Callable[[V], Storage[V]]) -> Callable[[V], Storage[V]]:
    """A function that remembers its last argument and result.

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
    """Return the storage, its atoms set only where the condition holds."""
    if isinstance(storage, Cell):
        return Cell(d.binary(BinaryOp.AND, storage.is_set, condition), storage.value)
    if isinstance(storage, Many):
        at = storage.at
        return many_of(storage.crowd, lambda i: set_only_if(d, at(i), condition))
    return Tree(tuple(set_only_if(d, part, condition) for part in storage.parts))


# --- merging ------------------------------------------------------------------------------------


def merge_storage(d: Domain[V], condition: V, then: Storage[V], other: Storage[V]) -> Storage[V]:
    """Merge storage of one shape: ``then`` where the condition holds, ``other`` elsewhere."""
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
    """Merge storage; one side alone where the domain knows the condition."""
    known = d.known(condition)
    if known is None:
        return merge_storage(d, condition, then, other)
    return then if known else other


def same_storage(d: Domain[V], left: Storage[V], right: Storage[V]) -> V:
    """Return the condition that two storages of one shape have equal atoms set to equal values."""
    if isinstance(left, Cell):
        assert isinstance(right, Cell)
        same_flag = d.binary(BinaryOp.EQ, left.is_set, right.is_set)
        same_value = equal(d, left.value, right.value)
        return conjunction(d, [same_flag, d.binary(BinaryOp.IMPLIES, left.is_set, same_value)])
    assert isinstance(right, Tree)
    pairs = zip(left.parts, right.parts, strict=True)
    return conjunction(d, [same_storage(d, a, b) for a, b in pairs])


# --- room ---------------------------------------------------------------------------------------


def in_room(storage: Storage[V], type_: Type) -> Storage[V]:
    """Return the storage with room in its maps for no more entries than there are keys. [E-MAP]

    Where nobody knows whether a map has a key, a write at it makes room for one entry more, and a
    loop over the map takes a turn for each. Keys are distinct, so of a type with few values only
    the first few entries count. Of values that are known nothing is left out.
    """
    if not _has_few_keys(type_) or isinstance(storage, Many):
        return storage
    if isinstance(storage, Cell):
        return Cell(storage.is_set, _value_in_room(storage.value, type_))
    if isinstance(type_, RecordType):
        pairs = zip(storage.parts, type_.fields, strict=True)
        return Tree(tuple(in_room(part, field) for part, (_, field) in pairs))
    assert isinstance(type_, ArrayType)
    return Tree(tuple(in_room(part, type_.element) for part in storage.parts))


def _value_in_room(value: Value[V], type_: Type) -> Value[V]:
    match type_:
        case RecordType(fields=fields) if isinstance(value, Rec):
            pairs = zip(value.fields, fields, strict=True)
            return Rec(tuple(_value_in_room(part, field) for part, (_, field) in pairs))
        case SequenceType(element=element) if type(value) is Seq:
            return Seq(value.length, tuple(_value_in_room(item, element) for item in value.items))
        case MapType(key=key, value=held) if isinstance(value, Table):
            entries = value.entries[: how_many(key)]
            return Table(value.length, tuple((k, _value_in_room(v, held)) for k, v in entries))
        case _:
            return value


@cache
def _has_few_keys(type_: Type) -> bool:
    """Return whether a type contains a map whose key type has few values."""
    return any(isinstance(t, MapType) and how_many(t.key) is not None for t in within(type_))
