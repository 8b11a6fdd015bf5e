"""Which locations of a variable a robot wrote in its turn. [LOCATION] [SHARED-ASSIGN]

A *mask* has the shape of the storage it is about, so that the writes of several robots can be
joined location by location.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Generic, TypeVar

from msgspec import Struct

from koord.semantics.domain import Domain, conjunction, disjunction
from koord.semantics.storage import (
    AtField,
    AtIndex,
    AtKey,
    Cell,
    Location,
    Many,
    Storage,
    Tree,
    merge_storage_known,
)
from koord.semantics.values import (
    Rec,
    Seq,
    Table,
    Value,
    insert,
    lookup,
    merge_known,
    record,
    sequence,
    table,
)
from koord.syntax.core import BinaryOp
from koord.syntax.types import BOOL, INT

V = TypeVar("V")


class Mask(Struct, Generic[V], frozen=True):
    """Which locations at or below a place were written.

    ``whole``: the place as such. ``parts``: fields or elements by position. ``keys``: keys of a
    map, each with the condition under which it was written. None where nothing was written below.
    """

    whole: V
    parts: tuple[Mask[V] | None, ...] = ()
    keys: tuple[tuple[V, Value[V]], ...] = ()


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
        return _own_entry_marked(d, mask, storage, first, rest, condition)
    below = _parts(storage)
    parts = list(mask.parts) + [None] * (len(below) - len(mask.parts))
    for position, here in _addressed(d, first, len(below)):
        both = d.binary(BinaryOp.AND, condition, here)
        parts[position] = marked(d, parts[position], below[position], rest, both)
    return Mask(mask.whole, tuple(parts), mask.keys)


def _own_entry_marked(
    d: Domain[V],
    mask: Mask[V],
    many: Many[V],
    first: Location[V],
    rest: Sequence[Location[V]],
    condition: V,
) -> Mask[V]:
    """Of a crowd's array a robot writes one entry, its own: a mask of one part. [ALLREAD]"""
    assert isinstance(first, AtIndex)
    own = mask.parts[0] if mask.parts else None
    part = marked(d, own, many.at(first.index), rest, condition)
    return Mask(mask.whole, (part,), mask.keys)


def _addressed(d: Domain[V], location: AtIndex[V] | AtField, count: int) -> Iterator[tuple[int, V]]:
    """Which of so many parts a step may mean, each with the condition that it does."""
    where = location.position if isinstance(location, AtField) else d.known(location.index)
    if isinstance(where, int):
        if 0 <= where < count:
            yield where, d.const(True, BOOL)
        return
    assert isinstance(location, AtIndex)
    for position in range(count):
        yield position, d.binary(BinaryOp.EQ, location.index, d.const(position, INT))


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
            # Of many elements a robot writes few.
            parts = tuple(t if m is None else joined(d, t, s, m) for t, s, m in triples)
            patched = Tree(parts)
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
