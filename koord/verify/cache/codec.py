"""Structs as plain data and back: what is kept of verdicts, in memory and in files.

The classes are those below and no others, so that no file makes anything else of itself.
Places in the text are not written: whatever comes back is of another text.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from fractions import Fraction
from types import ModuleType
from typing import Any, TypeAlias

from msgspec import Struct

from koord.semantics import configurations, oracle, recordings, values
from koord.syntax import core, types
from koord.verify import claims, engine_names, obstacles, verdicts

#: What JSON can say.
Plain: TypeAlias = Any

_CLASS, _ENUM, _FRACTION = "struct", "enum", "fraction"


class CodecError(Exception):
    """Raised for data that are no kept structs."""


def plain(value: object) -> Plain:
    """A value as plain data. Raises CodecError if it has a part that is never kept."""
    match value:
        case Enum():
            return {_ENUM: [_name(type(value)), value.name]}
        case None | bool() | int() | str() | float():
            return value
        case Fraction():
            return {_FRACTION: [str(value.numerator), str(value.denominator)]}
        case tuple():
            return [plain(each) for each in value]
        case Struct():
            fields = {name: plain(getattr(value, name)) for name in _fields(type(value))}
            return {_CLASS: _name(type(value)), **fields}
        case _:
            raise CodecError(f"{type(value).__name__} is never kept")


def revived(data: Plain) -> Any:
    """The value of plain data. Raises CodecError if they are of none."""
    try:
        return _revived(data)
    except (TypeError, ValueError, KeyError, ZeroDivisionError, RecursionError) as error:
        raise CodecError(str(error)) from error


def _revived(data: Plain) -> Any:
    match data:
        case list():
            return tuple(_revived(each) for each in data)
        case {"enum": [class_, name], **others} if not others:
            return _CLASSES[class_][name]
        case {"fraction": [above, below], **others} if not others:
            return Fraction(int(above), int(below))
        case {"struct": name, **fields}:
            class_ = _CLASSES[name]
            if set(fields) != set(_fields(class_)):
                raise CodecError(f"these are not the fields of {name}")
            return class_(**{str(key): _revived(each) for key, each in fields.items()})
        case dict():
            raise CodecError("this is no kept struct")
        case _:
            return data


def _name(class_: type) -> str:
    name = f"{class_.__module__.rpartition('.')[2]}.{class_.__qualname__}"
    if _CLASSES.get(name) is not class_:
        raise CodecError(f"{name} is never kept")
    return name


def _fields(class_: type[Struct]) -> tuple[str, ...]:
    return tuple(name for name in class_.__struct_fields__ if name != "span")


_MODULES = (
    core,
    types,
    values,
    recordings,
    oracle,
    configurations,
    verdicts,
    claims,
    engine_names,
    obstacles,
)


def _classes(modules: tuple[ModuleType, ...]) -> Iterator[type]:
    for module in modules:
        for found in vars(module).values():
            own = isinstance(found, type) and found.__module__ == module.__name__
            if own and issubclass(found, Struct | Enum):
                yield found


_CLASSES: dict[str, Any] = {
    f"{class_.__module__.rpartition('.')[2]}.{class_.__qualname__}": class_
    for class_ in _classes(_MODULES)
}
