"""Maps have room for no more entries than there are keys. [E-MAP]

Where nobody knows whether a map has a key, a write at it makes room for one entry more, and a loop
over the map takes a turn for each. Keys are distinct, so of a type with few values only the first
few entries count, and what lies behind them can be left out. Of values that are known nothing is.
"""

from __future__ import annotations

from functools import cache
from math import prod
from typing import TypeVar

from koord.semantics.storage import Cell, Many, Storage, Tree
from koord.semantics.values import Rec, Seq, Table, Value
from koord.syntax.types import (
    ArrayType,
    BoolType,
    EnumType,
    MapType,
    RecordType,
    SequenceType,
    Type,
    within,
)

V = TypeVar("V")


def in_room(storage: Storage[V], type_: Type) -> Storage[V]:
    """The same storage, its maps without room that nothing needs."""
    if not _has_few_keys(type_) or isinstance(storage, Many):
        return storage
    if isinstance(storage, Cell):
        return Cell(storage.is_set, _value(storage.value, type_))
    if isinstance(type_, RecordType):
        pairs = zip(storage.parts, type_.fields, strict=True)
        return Tree(tuple(in_room(part, field) for part, (_, field) in pairs))
    assert isinstance(type_, ArrayType)
    return Tree(tuple(in_room(part, type_.element) for part in storage.parts))


def _value(value: Value[V], type_: Type) -> Value[V]:
    match type_:
        case RecordType(fields=fields) if isinstance(value, Rec):
            pairs = zip(value.fields, fields, strict=True)
            return Rec(tuple(_value(part, field) for part, (_, field) in pairs))
        case SequenceType(element=element) if type(value) is Seq:
            return Seq(value.length, tuple(_value(item, element) for item in value.items))
        case MapType(key=key, value=held) if isinstance(value, Table):
            entries = value.entries[: how_many(key)]
            return Table(value.length, tuple((k, _value(v, held)) for k, v in entries))
        case _:
            return value


@cache
def _has_few_keys(type_: Type) -> bool:
    """Whether there is a map in a type of whose keys are few values."""
    return any(isinstance(t, MapType) and how_many(t.key) is not None for t in within(type_))


def how_many(type_: Type) -> int | None:
    """How many values a type has, where these can be counted."""
    match type_:
        case BoolType():
            return 2
        case EnumType(members=members):
            return len(members)
        case RecordType(fields=fields):
            counts = [how_many(field) for _, field in fields]
            known = [count for count in counts if count is not None]
            return prod(known) if len(known) == len(counts) else None
        case _:
            return None
