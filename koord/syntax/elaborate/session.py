"""What the parts of one elaboration share."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from msgspec import Struct, field

from koord.syntax import ast, core
from koord.syntax.elaborate.findings import Findings
from koord.syntax.elaborate.settings import Settings
from koord.syntax.elaborate.symbols import (
    AgentScope,
    MemberSymbol,
    ModuleScope,
    Named,
    PortNamed,
    RecordInfo,
)
from koord.syntax.source import Span
from koord.syntax.types import Type

if TYPE_CHECKING:
    from koord.syntax.elaborate.body import Body
    from koord.syntax.elaborate.function_table import FunctionTable


class Confusion(Struct, frozen=True):
    """An ``allread`` variable used as if each robot's entry were a list of what it is."""

    variable: core.Variable
    span: Span
    stored: bool


class AtomicBlock(Struct, frozen=True):
    """An atomic block met: which allwrite variables it writes. One per block of the text."""

    number: int
    writes: dict[int, core.Variable] = field(default_factory=dict)


class Counter(Struct):
    """Hands out 0, 1, 2, …"""

    next: int = 0

    def take(self) -> int:
        self.next += 1
        return self.next - 1


class Types(Struct):
    """The types of a program by name, and what is known about its records and enumerations."""

    named: dict[str, Type | None] = field(default_factory=dict)
    declared: dict[str, ast.Ident] = field(default_factory=dict)
    records: dict[str, RecordInfo] = field(default_factory=dict)
    members: dict[str, list[MemberSymbol]] = field(default_factory=dict)


Expression = Callable[["Body", ast.Expr, "Type | None"], "core.Expr | None"]
Block = Callable[["Body", ast.Block], core.Block]


class Session(Struct):
    """The state of one elaboration: names declared so far, findings, counters.

    ``partial`` is set for a file of properties on its own: names that it does not declare belong to
    a program that is not there, and are no mistakes.
    """

    settings: Settings
    findings: Findings
    expression: Expression
    block: Block
    functions: FunctionTable
    types: Types = field(default_factory=Types)
    shared: dict[str, Named] = field(default_factory=dict)
    agents: list[AgentScope] = field(default_factory=list)
    partial: bool = False
    parameters: tuple[core.Parameter, ...] = ()
    sites: Counter = field(default_factory=Counter)
    used: set[int] = field(default_factory=set)
    loop_variables: set[str] = field(default_factory=set)
    #: Calls in properties, contracts and summaries.
    logical_calls: list[tuple[str, Span]] = field(default_factory=list)
    #: Names that are declared twice.
    ambiguous: set[str] = field(default_factory=set)
    #: Names that mean nothing, by where that is told, and their first places.
    unknown: dict[tuple[Findings, str], Span] = field(default_factory=dict)
    confusions: list[Confusion] = field(default_factory=list)
    atomic_blocks: dict[int, AtomicBlock] = field(default_factory=dict)
    #: The library's modules, which a program can use without declaring their ports.
    library_ports: dict[str, frozenset[str]] = field(default_factory=dict)

    @property
    def single(self) -> bool:
        """Whether there is one kind of robot."""
        return len(self.agents) == 1

    def modules(self) -> Iterable[ModuleScope]:
        """All modules in use, of any kind of robot."""
        for agent in self.agents:
            yield from agent.modules.values()

    def mark_used(self, declared: ast.Ident) -> None:
        """Note that the variable declared there is used."""
        self.used.add(id(declared))

    def member(self, name: str) -> list[MemberSymbol]:
        """The members of enumerations that have this name."""
        return self.types.members.get(name, [])

    def ports(self, agent: AgentScope, name: str) -> list[PortNamed]:
        """The ports of this name in the modules that the kind of robot uses."""
        return agent.ports.get(name, [])
