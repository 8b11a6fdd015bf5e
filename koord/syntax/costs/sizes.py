"""How many parts a value of a type has, and how deep they lie."""

from __future__ import annotations

from msgspec import Struct, field

from koord.syntax.types import (
    ArrayType,
    RecordType,
    Robots,
    Type,
)


class Size(Struct, frozen=True):
    """``parts`` counts scalars, and a list as if it had one element; ``depth`` counts types."""

    parts: int
    depth: int


_SCALAR = Size(1, 1)


class Sizes(Struct):
    """Sizes of types for a number of robots.

    They are remembered by identity: records may share their parts so often that whoever walks
    through all of them (as hashing does) comes to no end.
    """

    robots: int
    _known: dict[int, tuple[Type, Size]] = field(default_factory=dict)

    def of(self, type_: Type) -> Size:
        """The size of a type; of types that are made of each other, whatever their depth."""
        waiting = [type_]
        while waiting:
            current = waiting[-1]
            missing = [part for part in current.parts if id(part) not in self._known]
            if missing:
                waiting += missing
                continue
            waiting.pop()
            self._known[id(current)] = (current, self._size(current))
        return self._known[id(type_)][1]

    def _size(self, type_: Type) -> Size:
        below = [self._known[id(part)][1] for part in type_.parts]
        if not below:
            return Size(1, 1) if isinstance(type_, RecordType) else _SCALAR
        parts = sum(size.parts for size in below)
        if isinstance(type_, ArrayType):
            parts *= self.robots if type_.size is Robots.ALL else type_.size
        return Size(max(1, parts), 1 + max(size.depth for size in below))
