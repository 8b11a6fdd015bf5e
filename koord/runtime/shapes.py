"""Shapes: the run-time types of a compiled program's values.

A value is Python's own, and never changes: ``int``, ``float``, ``bool``, ``str``; a tuple for a
list, a queue or an array; a named tuple for a record; for a map a ``dict`` that nobody writes to.
An atom that is not set is ``None``. So values can be shared freely, and throwing a robot's writes
away is forgetting them (decision record 0012).

:func:`to_plain` and :func:`from_plain` go from there to :data:`~koord.runtime.proposals.Plain`,
which codecs can carry, and back; whatever comes from outside passes through the second.
"""

from __future__ import annotations

from collections.abc import Mapping as MappingOf
from collections.abc import Sequence as SequenceOf
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, assert_never

from msgspec import Struct

from koord.runtime.proposals import Plain


class ShapeError(ValueError):
    """Raised for a plain value that does not have the expected shape."""


class ScalarKind(Enum):
    """The kinds of scalars."""

    INT = "int"
    FLOAT = "float"
    BOOL = "bool"
    STRING = "string"


#: What a scalar is in Python. A ``bool`` is no ``int`` here.
_PYTHON = {
    ScalarKind.INT: int,
    ScalarKind.FLOAT: float,
    ScalarKind.BOOL: bool,
    ScalarKind.STRING: str,
}


class Scalar(Struct, frozen=True):
    """The shape of numbers, Booleans and strings."""

    kind: ScalarKind


class Enumeration(Struct, frozen=True):
    """The shape of an enumeration: positions of members."""

    name: str
    members: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Record:
    """The shape of a record: a named tuple, and the shapes of its fields."""

    make: type[tuple[Any, ...]]
    fields: tuple[Shape, ...]
    #: The Python types of the fields, where all are scalars: most records are positions.
    types: tuple[type, ...] | None = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        kinds = [one.kind for one in self.fields if isinstance(one, Scalar)]
        types = tuple(_PYTHON[kind] for kind in kinds) if len(kinds) == len(self.fields) else None
        object.__setattr__(self, "types", types)


class Array(Struct, frozen=True):
    """The shape of ``T[k]``: its parts are set one by one."""

    element: Shape
    size: int


class PerRobot(Struct, frozen=True):
    """The shape of ``T[numAgents]``, and of every allread variable."""

    element: Shape


class Sequence(Struct, frozen=True):
    """The shape of a list or a queue, set as a whole."""

    element: Shape


class Mapping(Struct, frozen=True):
    """The shape of a map, set as a whole."""

    key: Shape
    value: Shape


Shape = Scalar | Enumeration | Record | Array | PerRobot | Sequence | Mapping

INT = Scalar(ScalarKind.INT)
FLOAT = Scalar(ScalarKind.FLOAT)
BOOL = Scalar(ScalarKind.BOOL)
STRING = Scalar(ScalarKind.STRING)


def blank(shape: Shape, robots: int) -> Any:
    """The unset value of a variable."""
    match shape:
        case Record(make=make, fields=fields):
            return tuple.__new__(make, [blank(field, robots) for field in fields])
        case Array(element=element, size=size):
            return (blank(element, robots),) * size
        case PerRobot(element=element):
            return (blank(element, robots),) * robots
        case _:
            return None


def begun(value: Any, shape: Shape, robots: int) -> Any:
    """The value before a write to a part: unset, if nothing was stored in it yet."""
    return blank(shape, robots) if value is None else value


def default(shape: Shape, robots: int) -> Any:
    """Some value of a shape: the result of a function that returns nothing."""
    match shape:
        case Scalar(kind=kind):
            return _PYTHON[kind]()
        case Enumeration():
            return 0
        case Record(make=make, fields=fields):
            return tuple.__new__(make, [default(field, robots) for field in fields])
        case Array(element=element, size=size):
            return (default(element, robots),) * size
        case PerRobot(element=element):
            return (default(element, robots),) * robots
        case Sequence():
            return ()
        case Mapping():
            return {}
    assert_never(shape)


def to_plain(shape: Shape, value: Any) -> Plain:
    """Convert a value to plain data. It is not copied where it is plain already."""
    if value is None:
        return None
    match shape:
        case Scalar() | Enumeration():
            return value  # type: ignore[no-any-return]
        case Record(fields=fields):
            if shape.types is not None:
                return tuple(value)
            return tuple(map(to_plain, fields, value))
        case Array(element=element) | PerRobot(element=element) | Sequence(element=element):
            if type(element) is Scalar:
                return value  # type: ignore[no-any-return]
            return tuple([to_plain(element, item) for item in value])
        case Mapping(key=key, value=held):
            return tuple([(to_plain(key, k), to_plain(held, v)) for k, v in value.items()])
    assert_never(shape)


def from_plain(shape: Shape, plain: Any, robots: int, *, unset: bool = False) -> Any:
    """Convert plain data to a value; lists are accepted for tuples, as codecs make them.

    ``unset`` says whether atoms of a variable may be missing. Raises ShapeError, and nothing else,
    whatever ``plain`` is.
    """
    if type(shape) is Record and type(plain) is tuple and tuple(map(type, plain)) == shape.types:
        return tuple.__new__(shape.make, plain)  # most of what is read and written are positions
    match shape:
        case Scalar(kind=kind):
            if type(plain) is _PYTHON[kind] or (plain is None and unset):
                return plain
            raise ShapeError(f"{_named(plain)} is no {kind.value}")
        case Enumeration(name=name, members=members):
            if plain is None and unset:
                return None
            if type(plain) is int and 0 <= plain < len(members):
                return plain
            raise ShapeError(f"{_named(plain)} is no member of {name}")
        case Record(make=make, fields=fields):
            parts = _items(plain, len(fields))
            if shape.types is not None and tuple(map(type, parts)) == shape.types:
                return tuple.__new__(make, parts)
            made = [
                from_plain(f, p, robots, unset=unset) for f, p in zip(fields, parts, strict=True)
            ]
            return tuple.__new__(make, made)
        case Array(element=element, size=size):
            items = _items(plain, size)
            return tuple([from_plain(element, item, robots, unset=unset) for item in items])
        case PerRobot(element=element):
            items = _items(plain, robots)
            return tuple([from_plain(element, item, robots, unset=unset) for item in items])
        case Sequence(element=element):
            if plain is None and unset:
                return None
            return tuple([from_plain(element, item, robots) for item in _items(plain, None)])
        case Mapping():
            return None if plain is None and unset else _map(shape, plain, robots)
    assert_never(shape)


def holds_map(shape: Shape) -> bool:
    """Return whether a shape contains maps: equal values may then differ in the order of keys."""
    match shape:
        case Mapping():
            return True
        case Record(fields=fields):
            return any(map(holds_map, fields))
        case Array(element=element) | PerRobot(element=element) | Sequence(element=element):
            return holds_map(element)
        case _:
            return False


def _map(shape: Mapping, plain: Any, robots: int) -> dict[Any, Any]:
    """Convert pairs to a map; a ``dict`` is accepted, as drivers make them."""
    pairs = plain.items() if isinstance(plain, MappingOf) else _items(plain, None)
    made: dict[Any, Any] = {}
    for pair in pairs:
        key, value = _items(pair, 2)
        read = from_plain(shape.key, key, robots)
        try:
            made[read] = from_plain(shape.value, value, robots)
        except TypeError:
            raise ShapeError("a key that holds a map") from None
    return made


def _items(plain: Any, count: int | None) -> SequenceOf[Any]:
    if type(plain) is not tuple and not isinstance(plain, tuple | list):
        raise ShapeError(f"{_named(plain)} is no sequence")
    if count is not None and len(plain) != count:
        raise ShapeError(f"there are {len(plain)} parts, not {count}")
    return plain


def _named(plain: Any) -> str:
    return f"a {type(plain).__name__}"


def element_of(shape: Shape) -> Shape:
    """The shape of an element of an array, list or queue."""
    match shape:
        case Array(element=element) | PerRobot(element=element) | Sequence(element=element):
            return element
        case _:
            raise ShapeError("an index leads into something that has no elements")
