"""Everything that stands below a place in a core program."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass

from koord.syntax.types import ArrayType, ListType, MapType, QueueType, RecordType

#: Types are dataclasses too, but no part of the program text.
_TYPES = (RecordType, ArrayType, ListType, QueueType, MapType)


def nodes(node: object) -> Iterator[object]:
    """A node (or a tuple of them), then everything below it, in the order of the text."""
    if isinstance(node, tuple):
        for part in node:
            yield from nodes(part)
    elif is_dataclass(node) and not isinstance(node, _TYPES):
        yield node
        for field in fields(node):
            if field.name != "span":
                yield from nodes(getattr(node, field.name))
