"""Types of Koord values, after names are resolved."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from math import prod

from msgspec import Struct


class BaseType(Struct, frozen=True):
    """The base of all types: ``parts`` of records, sequences and maps."""

    @property
    def parts(self) -> tuple[Type, ...]:
        """The types that values are made of; none for scalars."""
        return ()


class ScalarType(BaseType, frozen=True):
    """The types of scalars: one atom, one constant of a domain."""


class IntType(ScalarType, frozen=True):
    """The type ``int``: ℤ."""


class FloatType(ScalarType, frozen=True):
    """The type ``float``: ℝ in the semantics and the verifier, IEEE double in the runtime."""


class BoolType(ScalarType, frozen=True):
    """The type of Booleans."""


class StringType(ScalarType, frozen=True):
    """The type of strings, which are compared for equality and written to streams."""


class StreamType(ScalarType, frozen=True):
    """The type of streams, which ``<<`` writes to."""


class EnumType(ScalarType, frozen=True):
    """The type of an enumeration; a value is the member's position."""

    name: str
    members: tuple[str, ...]


class OpaqueType(ScalarType, frozen=True):
    """The type of opaque values, which are only compared and passed to external functions.

    No program text has this type: the verifier puts it where a value merely flows from one
    external function to another (``koord.verify.reduction.abstraction``).
    """

    name: str


class RecordType(BaseType, frozen=True):
    """The type of records: named fields. ``pos`` is one, with float fields ``x y z``."""

    name: str
    fields: tuple[tuple[str, Type], ...]

    @property
    def parts(self) -> tuple[Type, ...]:
        return tuple(type_ for _, type_ in self.fields)

    def position(self, name: str) -> int | None:
        """The position of a field, or None if there is none of that name."""
        for position, (field_name, _) in enumerate(self.fields):
            if field_name == name:
                return position
        return None


class Robots(Enum):
    """The size of an array that has one element per robot."""

    ALL = "numAgents"


class SequenceType(BaseType, frozen=True):
    """The types of sequences: arrays, lists and queues."""

    element: Type

    @property
    def parts(self) -> tuple[Type, ...]:
        return (self.element,)


class ArrayType(SequenceType, frozen=True):
    """The type ``T[k]``: exactly ``size`` elements; ``Robots.ALL`` means ``numAgents``."""

    size: int | Robots


class GrowingType(SequenceType, frozen=True):
    """The types of sequences of any length; the whole is one atom."""


class ListType(GrowingType, frozen=True):
    """The type ``T[]`` or ``List<T>``. An array is accepted where a list is read."""


class QueueType(GrowingType, frozen=True):
    """The type ``Queue<T>``: a list whose ``pop`` takes the first element."""


class MapType(BaseType, frozen=True):
    """The type ``Map<K,V>``: keys in order of insertion; equal if entries are the same."""

    key: Type
    value: Type

    @property
    def parts(self) -> tuple[Type, ...]:
        return (self.key, self.value)


class SetType(MapType, frozen=True):
    """The type ``Set<T>``: a map from each element to :data:`PRESENT`, its only value."""


Type = (
    IntType
    | FloatType
    | BoolType
    | StringType
    | StreamType
    | EnumType
    | RecordType
    | ArrayType
    | ListType
    | QueueType
    | MapType
    | OpaqueType
)

INT = IntType()
FLOAT = FloatType()
BOOL = BoolType()
STRING = StringType()
STREAM = StreamType()
PRESENT = EnumType("Element", ("present",))
POS = RecordType("pos", (("x", FLOAT), ("y", FLOAT), ("z", FLOAT)))


def within(type_: Type) -> Iterator[Type]:
    """A type, and all types of which its values are made."""
    yield type_
    for part in type_.parts:
        yield from within(part)


def contains(type_: Type, kind: type[BaseType]) -> bool:
    """Return whether a type is of a kind, or contains one that is."""
    return any(isinstance(each, kind) for each in within(type_))


def is_by_robot(type_: Type) -> bool:
    """Return whether a type is that of an array with an element for each robot."""
    return isinstance(type_, ArrayType) and type_.size is Robots.ALL


def part_types(type_: Type, count: int) -> tuple[Type, ...]:
    """The types of the parts of a record, or of ``count`` elements of a sequence."""
    if isinstance(type_, RecordType):
        return type_.parts
    assert isinstance(type_, SequenceType)
    return (type_.element,) * count


def atoms(type_: Type) -> Iterator[Type]:
    """The types of the atoms of a variable: records and arrays are trees of them. [ATOM]"""
    if isinstance(type_, RecordType | ArrayType):
        for part in type_.parts:
            yield from atoms(part)
    else:
        yield type_


def how_many(type_: Type) -> int | None:
    """The number of values of a type, where they are few; None otherwise."""
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


def is_flat(type_: Type) -> bool:
    """Return whether all atoms are scalars, so that values have one shape.
    Then writes are to whole atoms.
    """
    return all(isinstance(atom, ScalarType) for atom in atoms(type_))


def show(type_: Type) -> str:
    """Print a type as a user writes it."""
    match type_:
        case IntType():
            return "int"
        case FloatType():
            return "float"
        case BoolType():
            return "bool"
        case StringType():
            return "string"
        case StreamType():
            return "stream"
        case EnumType(name=name) | RecordType(name=name) | OpaqueType(name=name):
            return name
        case ArrayType(element=element, size=Robots.ALL):
            return f"{show(element)}[numAgents]"
        case ArrayType(element=element, size=size):
            return f"{show(element)}[{size}]"
        case ListType(element=element):
            return f"{show(element)}[]"
        case QueueType(element=element):
            return f"Queue<{show(element)}>"
        case SetType(key=element):
            return f"Set<{show(element)}>"
        case MapType(key=key, value=value):
            return f"Map<{show(key)}, {show(value)}>"
