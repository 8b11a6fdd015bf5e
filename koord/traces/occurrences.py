"""What occurs in a program's text: its constants, its choices, its outputs."""

from __future__ import annotations

from koord.semantics.domain import Constant
from koord.syntax import core
from koord.syntax.types import Type, show
from koord.syntax.walk import nodes


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
