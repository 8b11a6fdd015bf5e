"""Variables as columns of 64-bit words: what machine code of a program reads and writes.

A value is its *leaves*: numbers, Booleans and members of enumerations, by the fields of records and
the elements of fixed arrays. What has other parts (strings, lists, maps, arrays over robots) has no
columns, and what reads it has no machine code.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Any, TypeAlias

from msgspec import Struct, field

from koord.runtime.compile.naming import PythonNames
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    RecordType,
    Type,
)

#: Values with more leaves are left to Python.
_MOST_LEAVES = 64


class NoCodeError(Exception):
    """Raised for what machine code is not made of."""


class Leaf(Enum):
    """What the 64 bits of a leaf are."""

    INT = "int"  #: also members of enumerations
    FLOAT = "float"
    BOOL = "bool"


#: Flags of a leaf: it is known, that is, set and in 64 bits; and an event has written it.
KNOWN, WRITTEN = 1, 2

#: Makes a tuple of leaves of a value of a compiled program; ``None`` where one is not set.
Flatten: TypeAlias = Callable[[Any], tuple[Any, ...]]


def leaves(type_: Type) -> tuple[Leaf, ...]:
    """The leaves of values of a type. Raises NoCodeError if they have other parts, or too many."""
    match type_:
        case IntType() | EnumType():
            return (Leaf.INT,)
        case FloatType():
            return (Leaf.FLOAT,)
        case BoolType():
            return (Leaf.BOOL,)
        case RecordType(fields=fields):
            found = tuple(leaf for _, part in fields for leaf in leaves(part))
        case ArrayType(element=element, size=int(size)) if size <= _MOST_LEAVES:
            found = leaves(element) * size
        case _:
            raise NoCodeError("a value without leaves")
    if len(found) > _MOST_LEAVES:
        raise NoCodeError("too many leaves")
    return found


def flatten(type_: Type) -> Flatten:
    """What makes leaves of values of a type that has them."""
    match type_:
        case RecordType(fields=fields):
            parts = tuple(flatten(part) for _, part in fields)
            if all(
                isinstance(part, IntType | EnumType | FloatType | BoolType) for _, part in fields
            ):
                return tuple
        case ArrayType(element=element, size=int(size)):
            parts = (flatten(element),) * size
        case _:
            return lambda value: (value,)
    return lambda value: tuple(
        leaf for of, part in zip(parts, value, strict=True) for leaf in of(part)
    )


class Column(Struct, frozen=True, eq=False):
    """A variable's columns: of a local or a port, of each robot's entry, or of a cell for all.

    ``first`` is the row of its first leaf; ``kind`` is None for shared variables.
    """

    name: str  #: the attribute that holds it
    home: Home
    kind: int | None
    first: int
    leaves: tuple[Leaf, ...]
    flatten: Flatten
    type: Type  #: of what one robot has of it


class Layout(Struct):
    """The columns of a program: rows by robot, and cells that all robots share.

    Only what some machine code reads or writes has a column.
    """

    names: PythonNames
    columns: dict[tuple[int | None, Home, int], Column] = field(default_factory=dict)
    rows: int = 0  #: with an element for each robot
    cells: int = 0  #: of allwrite variables

    def column(self, kind: int, variable: core.Variable) -> Column:
        """The column of a variable of robots of a kind. Raises NoCodeError if it has none."""
        whose = kind if variable.home in (Home.LOCAL, Home.PORT) else None
        key = (whose, variable.home, variable.slot)
        if key not in self.columns:
            found = leaves(variable.own_type)
            shared = variable.home is Home.ALLWRITE
            self.columns[key] = Column(
                self.names.attribute(variable, whose),
                variable.home,
                whose,
                self.cells if shared else self.rows,
                found,
                flatten(variable.own_type),
                variable.own_type,
            )
            if shared:
                self.cells += len(found)
            else:
                self.rows += len(found)
        return self.columns[key]


def part_at(type_: Type, position: int) -> int:
    """Where the leaves of a record's field begin."""
    assert isinstance(type_, RecordType)
    return sum(len(leaves(part)) for _, part in type_.fields[:position])
