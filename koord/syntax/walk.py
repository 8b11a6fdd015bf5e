"""Everything that stands below a place in a core program."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any

from koord.syntax.types import ArrayType, ListType, MapType, QueueType, RecordType

#: Types are dataclasses too, but no part of the program text.
_TYPES = (RecordType, ArrayType, ListType, QueueType, MapType)


def nodes(node: object) -> Iterator[object]:
    """A node (or a tuple of them), then everything below it, in the order of the text."""
    if isinstance(node, tuple):
        for part in node:
            yield from nodes(part)
        return
    names = _below(type(node))
    if names is not None:
        yield node
        for name in names:
            yield from nodes(getattr(node, name))


@cache
def _below(class_: Any) -> tuple[str, ...] | None:
    """The fields of a node that hold parts of it; None for what is no node."""
    if not is_dataclass(class_) or issubclass(class_, _TYPES):
        return None
    return tuple(field.name for field in fields(class_) if field.name != "span")
