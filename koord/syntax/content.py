"""Structs whose equality ignores some fields."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter
from typing import Any, ClassVar

from msgspec import Struct


class ByContent(Struct, frozen=True, eq=False):
    """A struct that is equal to another of its class if all fields except ``ASIDE`` are equal.

    It hashes accordingly and shows just that. Structs cannot leave a field out themselves.
    """

    ASIDE: ClassVar[frozenset[str]] = frozenset()

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if type(self) is not type(other):
            return NotImplemented
        content = _CONTENT[type(self)]
        return bool(content(self) == content(other))

    def __ne__(self, other: object) -> bool:
        # Structs have one of their own, which would not ask the method above.
        return not self == other

    def __hash__(self) -> int:
        return hash(_CONTENT[type(self)](self))

    def __repr__(self) -> str:
        shown = (f"{name}={getattr(self, name)!r}" for name in content_fields(type(self)))
        return f"{type(self).__name__}({', '.join(shown)})"


def content_fields(class_: type[ByContent]) -> tuple[str, ...]:
    """The names of the fields that count, in the order in which they are declared."""
    return tuple(name for name in class_.__struct_fields__ if name not in class_.ASIDE)


class _Contents(dict[type[ByContent], Callable[[ByContent], Any]]):
    """For each class a function that reads the fields that count, made on first use."""

    def __missing__(self, class_: type[ByContent]) -> Callable[[ByContent], Any]:
        names = content_fields(class_)
        self[class_] = found = attrgetter(*names) if names else _nothing
        return found


def _nothing(_: ByContent) -> tuple[()]:
    return ()


_CONTENT = _Contents()
