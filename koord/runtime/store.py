"""The agreed store of shared variables: the same at every robot. [REFRESH]

A store changes by decisions only. What a robot writes in its own turn it sees at once, but in its
own copy, which is forgotten.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from hashlib import blake2b
from operator import is_not
from typing import Any

from msgspec import Struct

from koord.runtime.proposals import INIT_ROUND, Plain, Write
from koord.runtime.shapes import (
    Array,
    Enumeration,
    PerRobot,
    Record,
    Scalar,
    Sequence,
    Shape,
    ShapeError,
    blank,
    element_of,
    from_plain,
    to_plain,
)
from koord.runtime.shapes import Mapping as MapShape

#: Bytes of a digest: enough that two stores with one digest are one store.
DIGEST_BYTES = 16


def is_digested(round_: int, robots: int) -> bool:
    """Return whether a decision of so many robots has the store's digest: now and then it has."""
    return round_ != INIT_ROUND and round_ % (1 + robots // 16) == 0


class Shared(Struct, frozen=True):
    """A shared variable: the attribute that holds it, and its shape."""

    name: str
    shape: Shape

    @property
    def is_allread(self) -> bool:
        """True if each robot writes its own entry only."""
        return isinstance(self.shape, PerRobot)


class Layout(Struct, frozen=True):
    """The shared variables of a program in the order that :class:`Write` counts them."""

    variables: tuple[Shared, ...]


class AgreedStore:
    """The agreed store. ``values`` is for reading; :meth:`apply` alone changes it."""

    __slots__ = ("_digest", "_digested", "_texts", "layout", "robots", "values")

    def __init__(self, layout: Layout, robots: int) -> None:
        self.layout = layout
        self.robots = robots
        self.values: dict[str, Any] = {v.name: blank(v.shape, robots) for v in layout.variables}
        #: What was digested last, variable by variable, and how it is written. Values never change
        #: (decision record 0012): what is the same object is not written again.
        self._digested: list[Any] = []
        self._texts: list[str] = []
        self._digest = b""

    def declare(self, values: Mapping[str, Any]) -> None:
        """Set the variables to their values before any robot's INIT. [INIT]"""
        for variable in self.layout.variables:
            if variable.name in values:
                self.values[variable.name] = values[variable.name]

    def apply(self, writes: Collection[Write]) -> dict[str, Any]:
        """Apply writes in order; return the new values of the written variables.

        A location that is no more (of a list that became shorter) is lost (decision record 0007).
        Raises ShapeError if a write is none of this program's; then the store is as before.
        [SHARED-ASSIGN] [LOCATION]
        """
        changed: dict[str, Any] = {}
        if not writes:  # of most rounds of a fleet that waits
            return changed
        variables, robots = self.layout.variables, self.robots
        #: Arrays and lists that elements are being put into, not yet made tuples again.
        unpacked: dict[str, list[Any]] = {}
        for write in writes:
            if not 0 <= write.variable < len(variables):
                raise ShapeError(f"there is no shared variable {write.variable}")
            variable = variables[write.variable]
            name, shape = variable.name, variable.shape
            if not write.path:
                unpacked.pop(name, None)
                changed[name] = from_plain(shape, write.value, robots)
                continue
            if isinstance(shape, Array | PerRobot | Sequence):
                items = unpacked.get(name)
                if items is None:
                    held = changed[name] if name in changed else self.values[name]
                    if held is None:
                        continue
                    items = unpacked[name] = list(held)
                first = _index(write.path[0])
                if first >= len(items):
                    continue
                if len(write.path) == 1:
                    items[first] = from_plain(shape.element, write.value, robots)
                else:
                    items[first] = _put(
                        shape.element, items[first], write.path[1:], write.value, robots
                    )
            else:
                held = changed[name] if name in changed else self.values[name]
                changed[name] = _put(shape, held, write.path, write.value, robots)
        for name, items in unpacked.items():
            changed[name] = tuple(items)
        self.values.update(changed)
        return changed

    def digest(self) -> bytes:
        """A hash of all values: robots that agree on it agree on the store."""
        variables = self.layout.variables
        values = [self.values[v.name] for v in variables]
        known, texts = self._digested, self._texts
        if not self._digest:
            texts = [repr(to_plain(v.shape, one)) for v, one in zip(variables, values, strict=True)]
        elif not any(map(is_not, values, known)):
            return self._digest
        else:
            texts = [
                text if one is before else repr(to_plain(v.shape, one))
                for v, one, before, text in zip(variables, values, known, texts, strict=True)
            ]
        whole = f"({texts[0]},)" if len(texts) == 1 else f"({', '.join(texts)})"
        self._digested, self._texts = values, texts
        self._digest = blake2b(whole.encode(), digest_size=DIGEST_BYTES).digest()
        return self._digest

    def digest_after(self, writes: Collection[Write]) -> bytes:
        """The digest after writes, which are not applied. Raises ShapeError as :meth:`apply`."""
        after = AgreedStore(self.layout, self.robots)
        after.values = dict(self.values)
        after._digested, after._texts, after._digest = self._digested, self._texts, self._digest
        after.apply(writes)
        return after.digest()

    def snapshot(self) -> tuple[Plain, ...]:
        """The whole store as plain data, variable by variable."""
        return tuple(to_plain(v.shape, self.values[v.name]) for v in self.layout.variables)

    def restore(self, snapshot: Any) -> None:
        """Restore a snapshot. Raises ShapeError if it is none of this program's."""
        variables = self.layout.variables
        if not isinstance(snapshot, tuple | list) or len(snapshot) != len(variables):
            raise ShapeError(f"a store of this program has {len(variables)} variables")
        self.values = {
            variable.name: from_plain(variable.shape, plain, self.robots, unset=True)
            for variable, plain in zip(variables, snapshot, strict=True)
        }


def _put(shape: Shape, held: Any, path: tuple[Plain, ...], new: Plain, robots: int) -> Any:
    """The value of a place after a write below it; unchanged if the location no longer exists."""
    if not path:
        return from_plain(shape, new, robots)
    rest = path[1:]
    match shape:
        case Record(fields=fields):
            position = _index(path[0])
            if position >= len(fields):
                raise ShapeError(f"a record has no field {position}")
            parts = list(held)
            parts[position] = _put(fields[position], parts[position], rest, new, robots)
            return tuple.__new__(shape.make, parts)
        case Array() | PerRobot() | Sequence():
            position = _index(path[0])
            if held is None or position >= len(held):
                return held
            part = _put(element_of(shape), held[position], rest, new, robots)
            return (*held[:position], part, *held[position + 1 :])
        case MapShape(key=key, value=value):
            if rest:
                raise ShapeError("a path ends at its first key")
            at = from_plain(key, path[0], robots)
            return held if held is None else {**held, at: from_plain(value, new, robots)}
        case Scalar() | Enumeration():
            raise ShapeError("a path leads into a scalar")


def _index(step: Plain) -> int:
    if type(step) is not int or step < 0:
        raise ShapeError(f"{step!r} is no index")
    return step
