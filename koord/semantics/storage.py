"""What a variable holds: atoms that are set or unset, and where a robot wrote.

A scalar, a list, a map or an opaque value is one *atom*, a ``Cell``; records and fixed arrays are
trees of atoms. [ATOM] A *mask* of the same shape says which locations a robot wrote in its turn, so
that the writes of several robots can be joined location by location. [SHARED-ASSIGN]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeAlias, TypeVar

from koord.semantics.domain import Domain, conjunction, disjunction
from koord.semantics.values import (
    Rec,
    Seq,
    Table,
    Value,
    default,
    equal,
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
from koord.syntax.types import BOOL, INT, ArrayType, RecordType, Robots, Type

V = TypeVar("V")


@dataclass(frozen=True, slots=True)
class Cell(Generic[V]):
    """One atom. Where it is not set, ``value`` is some value of its type."""

    is_set: V
    value: Value[V]


@dataclass(frozen=True, slots=True)
class Tree(Generic[V]):
    """The fields of a record or the elements of a fixed array."""

    parts: tuple[Storage[V], ...]


Storage: TypeAlias = "Cell[V] | Tree[V]"


@dataclass(frozen=True, slots=True)
class Mask(Generic[V]):
    """Which locations at or below a place were written.

    ``whole``: the place as such. ``parts``: fields or elements by position. ``keys``: keys of a
    map, each with the condition under which it was written. None where nothing was written below.
    """

    whole: V
    parts: tuple[Mask[V] | None, ...] = ()
    keys: tuple[tuple[V, Value[V]], ...] = ()


# --- steps with their index or key evaluated ----------------------------------------------------


@dataclass(frozen=True, slots=True)
class AtIndex(Generic[V]):
    index: V


@dataclass(frozen=True, slots=True)
class AtKey(Generic[V]):
    key: Value[V]


@dataclass(frozen=True, slots=True)
class AtField:
    position: int


Location: TypeAlias = "AtIndex[V] | AtKey[V] | AtField"


# --- making -------------------------------------------------------------------------------------


def unset(d: Domain[V], type_: Type, robots: int) -> Storage[V]:
    """Storage of a type that holds nothing yet."""
    match type_:
        case RecordType(fields=fields):
            return Tree(tuple(unset(d, field, robots) for _, field in fields))
        case ArrayType(element=element, size=size):
            count = robots if size is Robots.ALL else size
            return Tree((unset(d, element, robots),) * count)
        case _:
            return Cell(d.const(False, BOOL), default(d, type_, robots))


def stored(d: Domain[V], type_: Type, value: Value[V], robots: int) -> Storage[V]:
    """Storage of a type that holds a value. A fixed array takes what fits; the rest is unset."""
    match type_:
        case RecordType(fields=fields):
            pairs = zip(fields, record(value).fields, strict=True)
            return Tree(tuple(stored(d, field, part, robots) for (_, field), part in pairs))
        case ArrayType(element=element, size=size):
            count = robots if size is Robots.ALL else size
            items = sequence(value).items[:count]
            filled = [stored(d, element, item, robots) for item in items]
            return Tree((*filled, *[unset(d, element, robots)] * (count - len(filled))))
        case _:
            return Cell(d.const(True, BOOL), value)


def held(d: Domain[V], value: Value[V]) -> Cell[V]:
    """A value in a cell of its own, as bound variables are held."""
    return Cell(d.const(True, BOOL), value)


# --- reading ------------------------------------------------------------------------------------


def contents(d: Domain[V], storage: Storage[V], type_: Type) -> tuple[Value[V], V]:
    """The value held, and whether every atom of it is set. [LOOKUP]"""
    if isinstance(storage, Cell):
        return storage.value, storage.is_set
    if isinstance(type_, RecordType):
        types: Sequence[Type] = [field for _, field in type_.fields]
    else:
        assert isinstance(type_, ArrayType)
        types = [type_.element] * len(storage.parts)
    read = [contents(d, part, t) for part, t in zip(storage.parts, types, strict=True)]
    all_set = conjunction(d, [is_set for _, is_set in read])
    values = tuple(value for value, _ in read)
    return (Rec(values) if isinstance(type_, RecordType) else listed(d, values)), all_set


def descend(
    d: Domain[V], storage: Storage[V], location: Location[V]
) -> tuple[Storage[V] | None, V]:
    """The storage one step below a tree, and whether the step is legal. None: nothing is there."""
    assert isinstance(storage, Tree)
    if isinstance(location, AtField):
        return storage.parts[location.position], d.const(True, BOOL)
    assert isinstance(location, AtIndex)
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
        return pick(d, location.index, items.items), in_range(d, location.index, items.length)
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


# --- masks --------------------------------------------------------------------------------------


def marked(
    d: Domain[V],
    mask: Mask[V] | None,
    storage: Storage[V] | Value[V],
    locations: Sequence[Location[V]],
    condition: V,
) -> Mask[V]:
    """The mask with one more written place; ``storage`` is what the place lies in."""
    never = d.const(False, BOOL)
    mask = mask if mask is not None else Mask(never)
    if not locations:
        return Mask(d.binary(BinaryOp.OR, mask.whole, condition), mask.parts, mask.keys)
    first, rest = locations[0], locations[1:]
    if isinstance(first, AtKey):
        # Below a key the whole entry is one location: keys may differ in shape between robots.
        return Mask(mask.whole, mask.parts, (*mask.keys, (condition, first.key)))
    below = _parts(storage)
    parts = list(mask.parts) + [None] * (len(below) - len(mask.parts))
    for position, part in enumerate(below):
        here = _addresses(d, first, position)
        if d.known(here) is not False:
            both = d.binary(BinaryOp.AND, condition, here)
            parts[position] = marked(d, parts[position], part, rest, both)
    return Mask(mask.whole, tuple(parts), mask.keys)


def _addresses(d: Domain[V], location: AtIndex[V] | AtField, position: int) -> V:
    if isinstance(location, AtField):
        return d.const(location.position == position, BOOL)
    return d.binary(BinaryOp.EQ, location.index, d.const(position, INT))


def _parts(storage: Storage[V] | Value[V]) -> Sequence[Storage[V] | Value[V]]:
    """What lies one step below, through the wall of an atom."""
    if isinstance(storage, Cell):
        return _parts(storage.value)
    if isinstance(storage, Tree):
        return storage.parts
    if isinstance(storage, Rec):
        return storage.fields
    if isinstance(storage, Seq):
        return storage.items
    return ()


def joined(
    d: Domain[V], target: Storage[V], source: Storage[V], mask: Mask[V] | None
) -> Storage[V]:
    """``target`` with the masked locations taken from ``source``. [SHARED-ASSIGN]

    A masked location that ``target`` no longer has (an element of a list that became shorter) is
    lost (decision record 0007).
    """
    if mask is None:
        return target
    if d.known(mask.whole) is True:
        return source
    if isinstance(target, Tree):
        assert isinstance(source, Tree)
        patched: Storage[V] = target
        if mask.parts:
            triples = zip(target.parts, source.parts, mask.parts, strict=True)
            patched = Tree(tuple(joined(d, t, s, m) for t, s, m in triples))
    else:
        assert isinstance(source, Cell)
        patched = Cell(target.is_set, _joined_value(d, target.value, source.value, mask))
    return merge_storage_known(d, mask.whole, source, patched)


def _joined_value(
    d: Domain[V], target: Value[V], source: Value[V], mask: Mask[V] | None
) -> Value[V]:
    """The same for values inside an atom; ``mask.whole`` of the atom itself is handled above."""
    if mask is None:
        return target
    if isinstance(target, Seq):
        items = list(target.items)
        sources = sequence(source).items
        for position in range(min(len(items), len(sources), len(mask.parts))):
            items[position] = _part_joined(
                d, items[position], sources[position], mask.parts[position]
            )
        return Seq(target.length, tuple(items))
    if isinstance(target, Rec):
        if not mask.parts:
            return target
        triples = zip(target.fields, record(source).fields, mask.parts, strict=True)
        return Rec(tuple(_part_joined(d, t, s, m) for t, s, m in triples))
    if isinstance(target, Table):
        for condition, key in mask.keys:
            found, value = lookup(d, table(source), key)
            if value is not None:
                both = conjunction(d, [condition, found])
                target = table(merge_known(d, both, insert(d, target, key, value), target))
    return target


def _part_joined(
    d: Domain[V], target: Value[V], source: Value[V], mask: Mask[V] | None
) -> Value[V]:
    if mask is None:
        return target
    return merge_known(d, mask.whole, source, _joined_value(d, target, source, mask))


def written(d: Domain[V], mask: Mask[V] | None) -> V:
    """Whether anything at or below the place was written."""
    if mask is None:
        return d.const(False, BOOL)
    below = [written(d, part) for part in mask.parts]
    return disjunction(d, [mask.whole, *below, *(condition for condition, _ in mask.keys)])


def restricted(d: Domain[V], mask: Mask[V] | None, condition: V) -> Mask[V] | None:
    """The mask of the writes that happen only if the condition holds too."""
    if mask is None:
        return None

    def both(other: V) -> V:
        return d.binary(BinaryOp.AND, other, condition)

    return Mask(
        both(mask.whole),
        tuple(restricted(d, part, condition) for part in mask.parts),
        tuple((both(when), key) for when, key in mask.keys),
    )


def set_only_if(d: Domain[V], storage: Storage[V], condition: V) -> Storage[V]:
    """The storage, with nothing set where the condition does not hold."""
    if isinstance(storage, Cell):
        return Cell(d.binary(BinaryOp.AND, storage.is_set, condition), storage.value)
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
