"""Values: scalars of a domain, and the records, lists and maps made of them. [VALUE]

The shape of a value is always concrete; only its scalars belong to a domain. A list that a domain
knows only in part has a ``length`` scalar and as many ``items`` as it may have at most: items from
``length`` on are there for no reason but the shape and have no meaning. Over numbers the two agree.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Generic, NoReturn, TypeAlias, TypeVar

from msgspec import Struct

from koord.semantics.domain import Constant, Domain, conjunction, disjunction
from koord.semantics.every_number import Crowd, NotFiniteError, Size
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.source import NOWHERE
from koord.syntax.types import (
    INT,
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    GrowingType,
    IntType,
    MapType,
    OpaqueType,
    RecordType,
    Robots,
    StreamType,
    StringType,
    Type,
)

V = TypeVar("V")
T = TypeVar("T")


#: Lists and maps whose length a domain does not know have room for so many elements at most.
MOST_ROOM = 500


class Rec(Struct, Generic[V], frozen=True):
    """A record: its fields in the order of its type."""

    fields: tuple[Value[V], ...]


class Seq(Struct, Generic[V], frozen=True):
    """An array, list or queue."""

    length: V
    items: tuple[Value[V], ...]


class Unlisted(tuple[Any, ...]):
    """The parts of an array over the robots of a crowd, which cannot be listed."""

    __slots__ = ()

    def __iter__(self) -> NoReturn:
        raise NotFiniteError(NOWHERE, "an array over all robots is needed element by element")

    def __len__(self) -> NoReturn:
        self.__iter__()

    def __getitem__(self, index: object) -> NoReturn:
        self.__iter__()


UNLISTED = Unlisted()


class Family(Seq[V], Generic[V], frozen=True):
    """An array over the robots of a crowd, as a function of the index."""

    crowd: Crowd[V]
    at: Callable[[V], Value[V]]

    def every(self, body: Callable[[Value[V]], V]) -> V:
        """Return the condition that a Boolean holds of every element."""
        return self.crowd.every(self.crowd.first, self.length, lambda index: body(self.at(index)))


def family_of(crowd: Crowd[V], at: Callable[[V], Value[V]]) -> Family[V]:
    """An array over the robots of a crowd, from an element as a function of the index."""
    return Family(crowd.count, UNLISTED, crowd, at)


class Table(Struct, Generic[V], frozen=True):
    """A map: entries with distinct keys, in order of insertion."""

    length: V
    entries: tuple[tuple[Value[V], Value[V]], ...]


Value: TypeAlias = "V | Rec[V] | Seq[V] | Table[V]"


def scalar(value: Value[V]) -> V:
    """Narrow a value to the scalar that its type says it is."""
    assert not isinstance(value, Rec | Seq | Table), value
    return value


def record(value: Value[V]) -> Rec[V]:
    """Narrow a value to the record that its type says it is."""
    assert isinstance(value, Rec), value
    return value


def sequence(value: Value[V]) -> Seq[V]:
    """Narrow a value to the array, list or queue that its type says it is."""
    assert isinstance(value, Seq), value
    return value


def table(value: Value[V]) -> Table[V]:
    """Narrow a value to the map that its type says it is."""
    assert isinstance(value, Table), value
    return value


def listed(d: Domain[V], items: Sequence[Value[V]]) -> Seq[V]:
    """A list of exactly these items."""
    return Seq(d.const(len(items), INT), tuple(items))


def default(d: Domain[V], type_: Type, robots: Size[V]) -> Value[V]:
    """Some value of a type: the result of total operations where they fault."""
    match type_:
        case IntType() | FloatType() | EnumType():
            return d.const(0, type_)
        case BoolType():
            return d.const(False, type_)
        case StringType() | StreamType():
            return d.const("", type_)
        case OpaqueType(name=name):
            return d.const(f"{name}!0", type_)
        case RecordType(fields=fields):
            return Rec(tuple(default(d, field, robots) for _, field in fields))
        case ArrayType(element=element, size=size):
            count = robots if size is Robots.ALL else size
            some = default(d, element, robots)
            if not isinstance(count, int):
                return family_of(count, lambda index: some)
            return listed(d, [some] * count)
        case GrowingType():
            return listed(d, [])
        case MapType():
            return Table(d.const(0, INT), ())


def map_scalars(value: Value[V], type_: Type, of: Callable[[V, Type], Value[V]]) -> Value[V]:
    """Map the scalars of a value, each with its type; lengths stay as they are."""
    match value:
        case Rec(fields=fields):
            parts = zip(fields, type_.parts, strict=True)
            return Rec(tuple(map_scalars(part, t, of) for part, t in parts))
        case Seq(length=length, items=items):
            (element,) = type_.parts
            return Seq(length, tuple(map_scalars(item, element, of) for item in items))
        case Table(length=length, entries=entries):
            k, v = type_.parts
            pairs = ((map_scalars(a, k, of), map_scalars(b, v, of)) for a, b in entries)
            return Table(length, tuple(pairs))
        case _:
            return of(value, type_)


def map_atoms(value: Value[Any], of: Callable[[Any], Value[Any]]) -> Value[Any]:
    """The value with something else for each scalar, whatever its type; lengths stay."""
    match value:
        case Rec(fields=fields):
            return Rec(tuple(map_atoms(part, of) for part in fields))
        case Seq(length=length, items=items):
            return Seq(length, tuple(map_atoms(item, of) for item in items))
        case Table(length=length, entries=entries):
            pairs = ((map_atoms(key, of), map_atoms(held, of)) for key, held in entries)
            return Table(length, tuple(pairs))
        case _:
            return of(value)


def merge(d: Domain[V], condition: V, then: Value[V], other: Value[V]) -> Value[V]:
    """Merge two values of one type: ``then`` where the condition holds, ``other`` elsewhere."""
    if then is other:
        return then
    if isinstance(then, Rec):
        pairs = zip(then.fields, record(other).fields, strict=True)
        return Rec(tuple(merge(d, condition, a, b) for a, b in pairs))
    if isinstance(then, Family):
        return _merged_family(d, condition, then, other)
    if isinstance(then, Seq):
        other = sequence(other)
        return Seq(
            d.ite(condition, then.length, other.length),
            _zipped(d, condition, then.items, other.items),
        )
    if isinstance(then, Table):
        other = table(other)
        keys = _zipped(d, condition, [k for k, _ in then.entries], [k for k, _ in other.entries])
        values = _zipped(d, condition, [v for _, v in then.entries], [v for _, v in other.entries])
        length = d.ite(condition, then.length, other.length)
        return Table(length, tuple(zip(keys, values, strict=True)))
    return d.ite(condition, scalar(then), scalar(other))


def _merged_family(d: Domain[V], condition: V, then: Family[V], other: Value[V]) -> Value[V]:
    if not isinstance(other, Family):
        raise NotFiniteError(NOWHERE, "an array over all robots stands where a list may stand too")
    second: Family[V] = other
    return family_of(then.crowd, lambda i: merge(d, condition, then.at(i), second.at(i)))


def _zipped(
    d: Domain[V], condition: V, then: Sequence[Value[V]], other: Sequence[Value[V]]
) -> tuple[Value[V], ...]:
    """Merge item by item; an item that only one side has is taken as it is."""
    shared = min(len(then), len(other))
    merged = [merge(d, condition, a, b) for a, b in zip(then[:shared], other[:shared], strict=True)]
    return (*merged, *then[shared:], *other[shared:])


def equal(d: Domain[V], left: Value[V], right: Value[V]) -> V:
    """Return the condition that two values of one type are equal. [E-EQUAL]"""
    parts: list[V]
    if isinstance(left, Rec):
        pairs = zip(left.fields, record(right).fields, strict=True)
        parts = [equal(d, a, b) for a, b in pairs]
        return conjunction(d, parts)
    if isinstance(left, Family) and isinstance(right, Family):
        one: Family[V] = left
        two: Family[V] = right
        crowd = one.crowd
        return crowd.every(crowd.first, crowd.count, lambda i: equal(d, one.at(i), two.at(i)))
    if isinstance(left, Seq):
        right = sequence(right)
        parts = [d.binary(BinaryOp.EQ, left.length, right.length)]
        for position, (a, b) in enumerate(zip(left.items, right.items, strict=False)):
            beyond = d.unary(UnaryOp.NOT, inside(d, position, left.length))
            parts.append(disjunction(d, [beyond, equal(d, a, b)]))
        return conjunction(d, parts)
    if isinstance(left, Table):
        right = table(right)
        parts = [d.binary(BinaryOp.EQ, left.length, right.length)]
        for position, (key, value) in enumerate(left.entries):
            beyond = d.unary(UnaryOp.NOT, inside(d, position, left.length))
            found, there = lookup(d, right, key)
            same = equal(d, value, there) if there is not None else d.const(False, BoolType())
            parts.append(disjunction(d, [beyond, conjunction(d, [found, same])]))
        return conjunction(d, parts)
    return d.binary(BinaryOp.EQ, scalar(left), scalar(right))


def identical(old: Value[Constant], new: Value[Constant]) -> bool:
    """Return whether two values are identical: NaN is itself, keys are in order. [CONFIG]"""
    if old == new:
        return True
    match old, new:
        case float(), float():
            return math.isnan(old) and math.isnan(new)
        case Rec(fields=a), Rec(fields=b):
            return all(map(identical, a, b))
        case Seq(items=a), Seq(items=b):
            return len(a) == len(b) and all(map(identical, a, b))
        case Table(entries=a), Table(entries=b):
            return len(a) == len(b) and all(
                identical(k, m) and identical(v, w) for (k, v), (m, w) in zip(a, b, strict=True)
            )
        case _:
            return False


def inside(d: Domain[V], position: int, length: V) -> V:
    """Return the condition that a list of a length has an item at the position."""
    return d.binary(BinaryOp.LT, d.const(position, INT), length)


def in_range(d: Domain[V], index: V, length: V) -> V:
    """Return the condition that an index lies in ``[0, length)``."""
    low = d.binary(BinaryOp.LE, d.const(0, INT), index)
    return conjunction(d, [low, d.binary(BinaryOp.LT, index, length)])


def pick(
    d: Domain[V], index: V, items: Sequence[T], merged: Callable[[Domain[V], V, T, T], T]
) -> T | None:
    """The item at an index; any item where the index is out of range; None if there is none."""
    if not items:
        return None
    known = d.known(index)
    if known is not None:
        assert isinstance(known, int)
        return items[known] if 0 <= known < len(items) else items[0]
    chosen = items[-1]
    for position in range(len(items) - 2, -1, -1):
        here = d.binary(BinaryOp.EQ, index, d.const(position, INT))
        chosen = merged(d, here, items[position], chosen)
    return chosen


def lookup(d: Domain[V], entries: Table[V], key: Value[V]) -> tuple[V, Value[V] | None]:
    """Return the condition that a map has a key, and its value there, None for an empty map."""
    found = d.const(False, BoolType())
    chosen: Value[V] | None = None
    for position in range(len(entries.entries) - 1, -1, -1):
        its_key, value = entries.entries[position]
        here = conjunction(d, [inside(d, position, entries.length), equal(d, its_key, key)])
        if d.known(here) is False:
            continue
        found = disjunction(d, [here, found])
        chosen = value if chosen is None else merge_known(d, here, value, chosen)
    return found, chosen


def merge_known(d: Domain[V], condition: V, then: Value[V], other: Value[V]) -> Value[V]:
    """Merge values; one side alone where the domain knows the condition."""
    known = d.known(condition)
    if known is None:
        return merge(d, condition, then, other)
    return then if known else other


def insert(d: Domain[V], entries: Table[V], key: Value[V], value: Value[V]) -> Table[V]:
    """Return the map with ``key`` bound to ``value``; a new key comes last."""
    found, _ = lookup(d, entries, key)
    replaced = []
    for position, (its_key, its_value) in enumerate(entries.entries):
        here = conjunction(d, [inside(d, position, entries.length), equal(d, its_key, key)])
        replaced.append((its_key, merge_known(d, here, value, its_value)))
    if d.known(found) is True:
        return Table(entries.length, tuple(replaced))
    grown = d.binary(BinaryOp.ADD, entries.length, d.const(1, INT))
    length = d.ite(found, entries.length, grown)
    placed = put_at(d, entries.length, [v for _, v in replaced], value)
    keys = put_at(d, entries.length, [k for k, _ in replaced], key)
    # Where the key was found, position ``length`` holds nothing that counts.
    return Table(length, tuple(zip(keys, placed, strict=True)))


def put_at(
    d: Domain[V], position: V, items: Sequence[Value[V]], value: Value[V]
) -> tuple[Value[V], ...]:
    """Return the items with ``value`` at a position in ``[0, len(items)]``, growing by at most one.

    Raises NotFiniteError where nobody knows the position, and it may be one of too many: a loop
    that appends for each element of the same list doubles what there is room for on every trip.
    """
    known = d.known(position)
    if known is not None:
        assert isinstance(known, int)
        return (*items[:known], value, *items[known + 1 :])
    if len(items) >= MOST_ROOM:
        raise NotFiniteError(NOWHERE, f"a list or map may have more than {MOST_ROOM:,} elements")
    placed = []
    for k in range(len(items)):
        here = d.binary(BinaryOp.EQ, position, d.const(k, INT))
        placed.append(merge_known(d, here, value, items[k]))
    return (*placed, value)


def without(d: Domain[V], position: V, items: Sequence[Value[V]]) -> tuple[Value[V], ...]:
    """Return the items without the one at a position; later ones move up."""
    known = d.known(position)
    if known is not None:
        assert isinstance(known, int)
        return (*items[:known], *items[known + 1 :])
    kept = []
    for k in range(len(items) - 1):
        before = d.binary(BinaryOp.LT, d.const(k, INT), position)
        kept.append(merge_known(d, before, items[k], items[k + 1]))
    return (*kept, *items[-1:])
