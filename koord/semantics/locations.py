"""Locations and masks: which parts of the storage a write changes. [LOCATION]

A *mask* has the shape of the storage it is about, so that the writes of several robots can be
joined location by location. [SHARED-ASSIGN]
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Generic, TypeAlias, TypeVar

from msgspec import Struct

from koord.semantics.domain import Domain, conjunction, disjunction
from koord.semantics.storage import (
    Cell,
    Many,
    Storage,
    Tree,
    many_of,
    merge_storage,
    merge_storage_known,
    remembering,
)
from koord.semantics.values import (
    Family,
    Rec,
    Seq,
    Table,
    Value,
    family_of,
    in_range,
    insert,
    lookup,
    merge,
    merge_known,
    pick,
    record,
    sequence,
    table,
)
from koord.syntax.core import BinaryOp
from koord.syntax.types import BOOL, INT

V = TypeVar("V")
T = TypeVar("T")


class AtIndex(Struct, Generic[V], frozen=True):
    """A step into an array or list, its index evaluated."""

    index: V


class AtKey(Struct, Generic[V], frozen=True):
    """A step into a map, its key evaluated."""

    key: Value[V]


class AtField(Struct, frozen=True):
    """A step into a record, by the field's position."""

    position: int


Location: TypeAlias = "AtIndex[V] | AtKey[V] | AtField"


# --- one step below -------------------------------------------------------------------------------


def descend(
    d: Domain[V], storage: Storage[V], location: Location[V]
) -> tuple[Storage[V] | None, V]:
    """Return the storage one step below a tree, or None, and whether the step is legal."""
    assert isinstance(storage, Tree)
    if isinstance(location, AtField):
        return storage.parts[location.position], d.const(True, BOOL)
    assert isinstance(location, AtIndex)
    if isinstance(storage, Many):
        return storage.at(location.index), in_range(d, location.index, storage.crowd.count)
    legal = in_range(d, location.index, d.const(len(storage.parts), INT))
    return pick(d, location.index, storage.parts, merge_storage), legal


def part_of(d: Domain[V], value: Value[V], location: Location[V]) -> tuple[Value[V] | None, V]:
    """Return the part of a value one step below it, and whether the step is legal."""
    if isinstance(location, AtField):
        return record(value).fields[location.position], d.const(True, BOOL)
    if isinstance(location, AtIndex):
        items = sequence(value)
        legal = in_range(d, location.index, items.length)
        if isinstance(items, Family):
            return items.at(location.index), legal
        return pick(d, location.index, items.items, merge), legal
    found, there = lookup(d, table(value), location.key)
    return there, found


# --- writing ------------------------------------------------------------------------------------


def write(
    d: Domain[V],
    storage: Storage[V],
    locations: Sequence[Location[V]],
    fresh: Storage[V],
) -> tuple[Storage[V], V]:
    """Return the storage with ``fresh`` at a place below it, and whether it exists. [LOCATION]

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
    """Write to an element of an array over a crowd; see :func:`write`."""
    part, below = write(d, many.at(index), rest, fresh)

    def at(i: V) -> Storage[V]:
        here = d.binary(BinaryOp.EQ, i, index)
        return merge_storage_known(d, here, part, many.at(i))

    legal = in_range(d, index, many.crowd.count)
    return many_of(many.crowd, remembering(at)), conjunction(d, [legal, below])


def _write_inside(
    d: Domain[V], value: Value[V], locations: Sequence[Location[V]], fresh: Value[V]
) -> tuple[Value[V], V]:
    """Write to a part of the value in an atom; see :func:`write`."""
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


def _replaced(parts: tuple[T, ...], position: int, part: T) -> tuple[T, ...]:
    return (*parts[:position], part, *parts[position + 1 :])


# --- what was written -----------------------------------------------------------------------------


class Mask(Struct, Generic[V], frozen=True):
    """The set of locations at or below a place that were written, each with its condition.

    ``whole``: the place as such. ``parts``: fields or elements by position. ``keys``: keys of a
    map, each with the condition under which it was written. ``elements``: those of an array over a
    crowd, each with its index. None where nothing was written below.
    """

    whole: V
    parts: tuple[Mask[V] | None, ...] = ()
    keys: tuple[tuple[V, Value[V]], ...] = ()
    elements: tuple[tuple[V, Mask[V] | None], ...] = ()


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
    if isinstance(storage, Many):
        assert isinstance(first, AtIndex)
        return _element_marked(d, mask, storage, first.index, rest, condition)
    below = _parts(storage)
    parts = list(mask.parts) + [None] * (len(below) - len(mask.parts))
    for position, here in _addressed(d, first, len(below)):
        both = d.binary(BinaryOp.AND, condition, here)
        parts[position] = marked(d, parts[position], below[position], rest, both)
    return Mask(mask.whole, tuple(parts), mask.keys)


def _element_marked(
    d: Domain[V],
    mask: Mask[V],
    many: Many[V],
    index: V,
    rest: Sequence[Location[V]],
    condition: V,
) -> Mask[V]:
    """The mask with one more written place in an element of a crowd's array."""
    part = marked(d, None, many.at(index), rest, condition)
    return Mask(mask.whole, elements=(*mask.elements, (index, part)))


def _addressed(d: Domain[V], location: AtIndex[V] | AtField, count: int) -> Iterator[tuple[int, V]]:
    """Yield the parts, of ``count``, that a step may address, each with its condition."""
    where = location.position if isinstance(location, AtField) else d.known(location.index)
    if isinstance(where, int):
        if 0 <= where < count:
            yield where, d.const(True, BOOL)
        return
    assert isinstance(location, AtIndex)
    for position in range(count):
        yield position, d.binary(BinaryOp.EQ, location.index, d.const(position, INT))


def _parts(storage: Storage[V] | Value[V]) -> Sequence[Storage[V] | Value[V]]:
    """The parts one step below storage or a value; those of a cell are its value's."""
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
    """Return ``target`` with the masked locations taken from ``source``. [SHARED-ASSIGN]

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
        if isinstance(target, Many):
            patched = _joined_elements(d, target, source, mask)
        elif mask.parts:
            triples = zip(target.parts, source.parts, mask.parts, strict=True)
            # Of many elements a robot writes few.
            parts = tuple(t if m is None else joined(d, t, s, m) for t, s, m in triples)
            patched = Tree(parts)
    else:
        assert isinstance(source, Cell)
        patched = Cell(target.is_set, _joined_value(d, target.value, source.value, mask))
    return merge_storage_known(d, mask.whole, source, patched)


def _joined_elements(
    d: Domain[V], target: Many[V], source: Storage[V], mask: Mask[V]
) -> Storage[V]:
    """An array over a crowd with its written elements taken from another; see :func:`joined`."""
    assert isinstance(source, Many)
    if not mask.elements:
        return target

    def at(i: V) -> Storage[V]:
        part = target.at(i)
        for index, below in mask.elements:
            here = d.binary(BinaryOp.EQ, i, index)
            part = joined(d, part, source.at(i), restricted(d, below, here))
        return part

    return many_of(target.crowd, remembering(at))


def _joined_value(
    d: Domain[V], target: Value[V], source: Value[V], mask: Mask[V] | None
) -> Value[V]:
    """Join values inside an atom; :func:`joined` handles ``mask.whole`` of the atom itself."""
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
    """Return the condition that anything at or below the place was written."""
    if mask is None:
        return d.const(False, BOOL)
    below = [written(d, part) for part in mask.parts]
    below += [written(d, part) for _, part in mask.elements]
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
        tuple((index, restricted(d, part, condition)) for index, part in mask.elements),
    )
