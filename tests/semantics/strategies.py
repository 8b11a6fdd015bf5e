"""Hypothesis strategies for types, their values and their storage."""

from __future__ import annotations

from fractions import Fraction

from hypothesis import strategies as st

from koord.semantics.domain import Constant
from koord.semantics.recordings import Concrete
from koord.semantics.storage import Cell, Storage, Tree
from koord.semantics.values import Rec, Seq, Table, default
from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    POS,
    STRING,
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    MapType,
    QueueType,
    RecordType,
    Robots,
    Type,
    part_types,
)
from koord.traces.trace import Numbers

ROBOTS = 3

MODE = EnumType("Mode", ("idle", "pick", "drop"))

_scalars: st.SearchStrategy[Type] = st.sampled_from([INT, FLOAT, BOOL, STRING, MODE, POS])

keys: st.SearchStrategy[Type] = st.sampled_from([INT, STRING, MODE, BOOL])


def _above(below: st.SearchStrategy[Type]) -> st.SearchStrategy[Type]:
    return st.one_of(
        below.map(ListType),
        below.map(QueueType),
        st.builds(ArrayType, below, st.integers(0, 3)),
        below.map(lambda element: ArrayType(element, Robots.ALL)),
        st.builds(MapType, keys, below),
        st.lists(below, min_size=1, max_size=3).map(
            lambda parts: RecordType("R", tuple((f"f{k}", t) for k, t in enumerate(parts)))
        ),
    )


types: st.SearchStrategy[Type] = st.recursive(_scalars, _above, max_leaves=4)


def values(type_: Type, numbers: Numbers) -> st.SearchStrategy[Concrete]:
    """Every value of a type, huge numbers and odd strings included."""
    match type_:
        case IntType():
            return st.one_of(st.integers(), st.integers(-(2**20_000), 2**20_000))
        case FloatType():
            return _floats(numbers)
        case BoolType():
            return st.booleans()
        case EnumType(members=members):
            return st.integers(0, len(members) - 1)
        case RecordType(fields=fields):
            parts = st.tuples(*(values(t, numbers) for _, t in fields))
            return parts.map(Rec)
        case ArrayType(element=element, size=size):
            count = ROBOTS if size is Robots.ALL else size
            return _lists(values(element, numbers), count, count)
        case ListType(element=element) | QueueType(element=element):
            return _lists(values(element, numbers), 0, 3)
        case MapType(key=key, value=value):
            entries = st.dictionaries(values(key, numbers), values(value, numbers), max_size=3)
            return entries.map(lambda found: Table(len(found), tuple(found.items())))
        case _:
            return st.text(max_size=5)


def _floats(numbers: Numbers) -> st.SearchStrategy[Constant]:
    if numbers is Numbers.EXACT:
        return st.one_of(st.fractions(), st.builds(Fraction, st.integers(), st.just(2**70)))
    return st.floats(allow_nan=False)


def _lists(
    items: st.SearchStrategy[Concrete], least: int, most: int
) -> st.SearchStrategy[Concrete]:
    return st.lists(items, min_size=least, max_size=most).map(
        lambda found: Seq(len(found), tuple(found))
    )


def storages(type_: Type, numbers: Numbers) -> st.SearchStrategy[Storage[Constant]]:
    """Storage of a type, any atoms of it unset."""
    match type_:
        case RecordType() | ArrayType():
            count = 0
            if isinstance(type_, RecordType):
                count = len(type_.fields)
            elif isinstance(type_, ArrayType):
                count = ROBOTS if type_.size is Robots.ALL else type_.size
            parts = (storages(t, numbers) for t in part_types(type_, count))
            return st.tuples(*parts).map(Tree)
        case _:
            unset: Storage[Constant] = Cell(False, default(numbers.domain, type_, ROBOTS))
            return st.one_of(
                st.just(unset), values(type_, numbers).map(lambda value: Cell(True, value))
            )
