"""What occurs in a program's text: its constants, its choices, its outputs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass

from koord.semantics.domain import Constant
from koord.syntax import core
from koord.syntax.source import Span
from koord.syntax.types import Type, show


def nodes(part: object) -> Iterator[core.Node]:
    """A part of a program and all nodes below it, outermost first."""
    if isinstance(part, tuple):
        for item in part:
            yield from nodes(item)
    elif is_dataclass(part) and not isinstance(part, Span | type):
        if isinstance(part, core.Node):
            yield part
        for field in fields(part):
            if field.name not in ("type", "span"):
                yield from nodes(getattr(part, field.name))


def variables(part: object) -> frozenset[core.Variable]:
    """The variables that a part of a program reads or writes."""
    return frozenset(node.variable for node in nodes(part) if isinstance(node, core.Place))


def constants(program: core.Program) -> dict[Type, tuple[Constant, ...]]:
    """The constants in the text, by type, each once, in the order of the text."""
    found: dict[Type, dict[Constant, None]] = {}
    for node in nodes(program):
        if isinstance(node, core.Const):
            found.setdefault(node.type, {})[node.value] = None
    return {type_: tuple(values) for type_, values in found.items()}


def choice_types(program: core.Program) -> dict[int, Type]:
    """The type of each ``choose``, by the number of its site."""
    return {node.site: node.type for node in nodes(program) if isinstance(node, core.Choose)}


def output_types(program: core.Program) -> dict[str, Type]:
    """The types of what the program writes to streams, by name."""
    outputs = (node for node in nodes(program) if isinstance(node, core.Output))
    return {show(value.type): value.type for node in outputs for value in node.values}
