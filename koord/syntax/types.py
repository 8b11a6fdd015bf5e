"""Types of Koord values, after names are resolved."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

from msgspec import Struct


class IntType(Struct, frozen=True):
    """ℤ."""


class FloatType(Struct, frozen=True):
    """ℝ in the semantics and the verifier, IEEE double in the runtime."""


class BoolType(Struct, frozen=True):
    """Truth values."""


class StringType(Struct, frozen=True):
    """Texts: compared for equality and written to streams."""


class StreamType(Struct, frozen=True):
    """Something that ``<<`` writes to."""


class EnumType(Struct, frozen=True):
    """A finite set of named members; a value is the member's position."""

    name: str
    members: tuple[str, ...]


class RecordType(Struct, frozen=True):
    """A tuple of named fields. ``pos`` is one, with float fields ``x y z``."""

    name: str
    fields: tuple[tuple[str, Type], ...]

    def position(self, name: str) -> int | None:
        """Where the field stands, or None if there is none of that name."""
        for position, (field_name, _) in enumerate(self.fields):
            if field_name == name:
                return position
        return None


class Robots(Enum):
    """The size of an array that has one element per robot."""

    ALL = "numAgents"


class ArrayType(Struct, frozen=True):
    """``T[k]``: exactly ``size`` elements; ``Robots.ALL`` means ``numAgents`` of them."""

    element: Type
    size: int | Robots


class ListType(Struct, frozen=True):
    """``T[]`` and ``List<T>``: any number of elements. An array will do where a list is read."""

    element: Type


class QueueType(Struct, frozen=True):
    """``Queue<T>``: a list whose ``pop`` takes the first element."""

    element: Type


class MapType(Struct, frozen=True):
    """``Map<K,V>``: keys in order of insertion; equal if they hold the same entries."""

    key: Type
    value: Type


class OpaqueType(Struct, frozen=True):
    """Values that can only be compared and handed to external functions.

    No program text has this type: the verifier puts it where a value merely flows from one
    external function to another (``koord.verify.abstraction``).
    """

    name: str


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
POS = RecordType("pos", (("x", FLOAT), ("y", FLOAT), ("z", FLOAT)))


def within(type_: Type) -> Iterator[Type]:
    """A type, and all types of which its values are made."""
    yield type_
    match type_:
        case RecordType(fields=fields):
            for _, field in fields:
                yield from within(field)
        case ArrayType(element=element) | ListType(element=element) | QueueType(element=element):
            yield from within(element)
        case MapType(key=key, value=value):
            yield from within(key)
            yield from within(value)
        case _:
            return


def show(type_: Type) -> str:
    """The type as a user writes it."""
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
        case MapType(key=key, value=value):
            return f"Map<{show(key)}, {show(value)}>"
