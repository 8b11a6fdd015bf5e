"""Names of the parts of a system in traces and tables."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.domain import Constant
from koord.syntax import core
from koord.syntax.system import System
from koord.syntax.types import ArrayType, Type, show
from koord.syntax.walk import nodes


class Named(Struct, frozen=True):
    """A variable under its name, with the type of one robot's part of it."""

    name: str
    slot: int
    type: Type
    older: str = ""  #: another name, which older traces have


class KindNames(Struct, frozen=True):
    """The names of one kind of robot. Ports bear that of their module: ``Motion.psn``."""

    locals: tuple[Named, ...]
    ports: tuple[Named, ...]
    events: tuple[str, ...]


class Names:
    """The names of all variables, choices and outputs of a system."""

    def __init__(self, system: System) -> None:
        program = system.program
        self.system = system
        self.kinds = tuple(map(_kind, program.agents))
        self.allread = _named(program.allread)  #: typed as the whole array
        self.allwrite = _named(program.allwrite)

    def of(self, robot: int) -> KindNames:
        return self.kinds[self.system.kinds[robot]]

    @cached_property
    def choices(self) -> dict[int, Type]:
        """The type of each ``choose`` by its site."""
        return choice_types(self.system.program)

    @cached_property
    def outputs(self) -> dict[str, Type]:
        """The types of what the program writes, by name."""
        return output_types(self.system.program)

    @cached_property
    def externals(self) -> dict[str, core.External]:
        return {function.name: function for function in self.system.program.externals}


def element_type(named: Named) -> Type:
    """The type of a robot's own entry of an allread variable."""
    assert isinstance(named.type, ArrayType)
    return named.type.element


def _kind(agent: core.Agent) -> KindNames:
    ports = [port.declaration for port in agent.ports]
    kept = distinct(f"{port.module}.{port.declaration.variable.name}" for port in agent.ports)
    named = _named(ports, [port.label for port in agent.ports])
    return KindNames(
        _named(agent.locals),
        tuple(replace(one, older=name) for one, name in zip(named, kept, strict=True)),
        tuple(distinct(event.name for event in agent.events)),
    )


def _named(
    declarations: Iterable[core.Declaration], labels: Iterable[str] | None = None
) -> tuple[Named, ...]:
    variables = [entry.variable for entry in declarations]
    names = distinct(labels if labels is not None else (v.name for v in variables))
    return tuple(Named(n, v.slot, v.type) for n, v in zip(names, variables, strict=True))


def distinct(names: Iterable[str]) -> list[str]:
    """Make names distinct: elaboration may bring in a second ``i``."""
    found: dict[str, None] = {}
    for name in names:
        candidate, count = name, 1
        while candidate in found:
            count += 1
            candidate = f"{name}#{count}"
        found[candidate] = None
    return list(found)


# --- what occurs in a program's text --------------------------------------------------------------


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
