"""The shared state of an elaboration, and the context of an expression or statement."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from msgspec import Struct, field

from koord.syntax import ast, core
from koord.syntax.diagnostics import Edit
from koord.syntax.elaboration.findings import DiagnosticLog
from koord.syntax.elaboration.recorder import Meaning, Recorder
from koord.syntax.elaboration.settings import Settings
from koord.syntax.elaboration.symbols import (
    RESERVED,
    AgentScope,
    BoundSymbol,
    FunctionTable,
    MemberSymbol,
    ModuleScope,
    Named,
    PortNamed,
    RecordInfo,
    Role,
)
from koord.syntax.elaboration.where import Where as Where
from koord.syntax.source import NOWHERE, Span
from koord.syntax.types import INT, Type


class Confusion(Struct, frozen=True):
    """An ``allread`` variable used as if each robot's entry were a list of its values."""

    variable: core.Variable
    span: Span
    stored: bool


class AtomicBlock(Struct, frozen=True):
    """An atomic block, with the allwrite variables that it writes. One per block of the text."""

    number: int
    writes: dict[int, core.Variable] = field(default_factory=dict)


class MissingFunction(Struct):
    """A function that a program calls and nobody declares, as its first call has it."""

    name: ast.Ident
    parameters: tuple[Type, ...]
    result: Type
    is_fixed: bool  #: statements of properties speak of its answer
    near: str | None = None  #: a hint at a function whose name begins with this one's
    places: list[Span] = field(default_factory=list)


class Counter(Struct):
    """A counter: it returns 0, 1, 2, …"""

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


Expression = Callable[["BodyScope", ast.Expr, "Type | None"], "core.Expr | None"]
Block = Callable[["BodyScope", ast.Block], core.Block]


class Elaboration(Struct):
    """The state of one elaboration: names declared so far, findings, counters.

    ``partial`` is set for a file of properties on its own: names that it does not declare belong to
    a program that is not there, and are no mistakes.
    """

    settings: Settings
    findings: DiagnosticLog
    expression: Expression
    block: Block
    functions: FunctionTable
    types: Types = field(default_factory=Types)
    shared: dict[str, Named] = field(default_factory=dict)
    agents: list[AgentScope] = field(default_factory=list)
    partial: bool = False
    whole: Span = NOWHERE  #: of the program
    parameters: tuple[core.Parameter, ...] = ()
    sites: Counter = field(default_factory=Counter)
    used: set[int] = field(default_factory=set)
    loop_variables: set[str] = field(default_factory=set)
    #: Calls in properties, contracts and summaries.
    logical_calls: list[tuple[str, Span]] = field(default_factory=list)
    #: Names that are declared twice.
    ambiguous: set[str] = field(default_factory=set)
    #: Names that mean nothing, by where that is told, and their first places.
    unknown: dict[tuple[DiagnosticLog, str], Span] = field(default_factory=dict)
    #: Functions that nobody declares, and whose names are like no other's.
    missing: dict[str, MissingFunction] = field(default_factory=dict)
    confusions: list[Confusion] = field(default_factory=list)
    atomic_blocks: dict[int, AtomicBlock] = field(default_factory=dict)
    #: Who is told what names mean, if an editor asks.
    recorder: Recorder | None = None
    #: The library's modules, which a program can use without declaring their ports.
    library_ports: dict[str, frozenset[str]] = field(default_factory=dict)

    def added(self, section: str) -> Edit:
        """The edit that adds a section at the end of the program."""
        line, column = self.whole.end_line, self.whole.end_column
        end = Span(self.whole.file, line, column, line, column)
        return Edit(end, f"{chr(10) * (column > 1)}\n{section}")

    @property
    def single(self) -> bool:
        """True if there is only one kind of robot."""
        return len(self.agents) == 1

    def modules(self) -> Iterable[ModuleScope]:
        """All modules in use, of any kind of robot."""
        for agent in self.agents:
            yield from agent.modules.values()

    def mark_used(self, declared: ast.Ident) -> None:
        """Mark the variable declared there as used."""
        self.used.add(id(declared))

    def member(self, name: str) -> list[MemberSymbol]:
        """The members of enumerations with a name."""
        return self.types.members.get(name, [])

    def ports(self, agent: AgentScope, name: str) -> list[PortNamed]:
        """The ports with a name in the modules that the kind of robot uses."""
        return agent.ports.get(name, [])


#: Expressions and blocks stand inside each other at most so deep.
MAX_DEPTH = 120


CONTRACT = frozenset({Where.REQUIRES, Where.ENSURES})
SUMMARIES = frozenset({Where.SUMMARY, Where.SUMMARY_REQUIRES})
CLOSED = frozenset({Where.PROPERTY, Where.ASSUMPTION})
#: Where quantifiers may stand.
LOGICAL = CONTRACT | SUMMARIES | CLOSED
#: Where variables of the program may be read.
SEES_VARIABLES = CLOSED | {Where.GUARD, Where.EFFECT, Where.INIT}
SEES_PORTS = SEES_VARIABLES | CONTRACT | {Where.ENVIRONMENT}
#: Where a robot's own id is known.
SEES_PID = SEES_PORTS | {Where.INITIAL}


class RobotScope(Struct):
    """The scope of ``… @ i``; ``kind`` if all robots it can name are of one kind."""

    expr: core.Expr
    kind: int | None
    used: bool = False


class SharedWrite(Struct, frozen=True):
    """A write of a shared variable; ``block`` is the atomic block around it."""

    variable: core.Variable
    own: bool  #: the location belongs to the robot: ``x[pid]``
    block: AtomicBlock | None
    span: Span


class LoopScope(Struct, frozen=True):
    """A loop around a statement: ``over`` is the list whose positions or elements it visits."""

    variable: str
    over: ast.Expr | None
    element: Type | None
    by_position: bool


class BodyScope(Struct):
    """The scope of one body: its names, its slots, and what it was seen to do."""

    session: Elaboration
    where: Where
    agent: AgentScope | None
    findings: DiagnosticLog
    module: str | None = None
    frames: list[dict[str, BoundSymbol]] = field(default_factory=lambda: [{}])
    bound: int = 0
    depth: int = 0
    overflowed: bool = False
    robot: RobotScope | None = None
    primed: bool = False
    #: The quantified variable that stands for ``pid`` in a property, once one is needed.
    closing: core.Variable | None = None
    result: Type | None = None
    #: The types of what is returned, where that is to be found out; None for one that is wrong.
    returned: list[Type | None] | None = None
    loops: list[LoopScope] = field(default_factory=list)
    #: The variables of loops over numbers: nothing else writes them.
    counters: set[core.Variable] = field(default_factory=set)
    breakable: int = 0
    atomic: AtomicBlock | None = None
    writes: list[SharedWrite] = field(default_factory=list)
    shared_reads: set[int] = field(default_factory=set)
    calls: list[str] = field(default_factory=list)
    #: Whether the function is the library's: its calls mean the library's functions.
    library: bool = False
    #: For the library's functions: where the program asks for them.
    origin: Span | None = None

    def expr(self, e: ast.Expr, expected: Type | None = None) -> core.Expr | None:
        """Elaborate an expression; None if it is wrong, which is reported."""
        with self.deeper(e) as allowed:
            made = self.session.expression(self, e, expected) if allowed else None
        recorder = self.session.recorder
        if recorder is not None and made is not None:
            recorder.types[e.span] = made.type
        return made

    @contextmanager
    def deeper(self, e: ast.Expr) -> Iterator[bool]:
        """Go one level deeper; return whether that is allowed."""
        allowed = self.depth < MAX_DEPTH
        if not allowed and not self.overflowed:
            self.overflowed = True
            self.error(
                "K231",
                e.span,
                f"this is nested more than {MAX_DEPTH} deep",
                "give a part of it a name of its own",
            )
        self.depth += 1
        try:
            yield allowed
        finally:
            self.depth -= 1

    def block(self, statements: ast.Block) -> core.Block:
        """Elaborate statements, with a frame of names of their own."""
        with self.frame():
            return self.session.block(self, statements)

    def error(self, code: str, span: Span, message: str, hint: str | None = None) -> None:
        """Record an error."""
        self.findings.error(code, span, message, hint)

    def note(self, span: Span, meaning: Meaning) -> None:
        """Tell an editor what the name at a place means."""
        recorder = self.session.recorder
        if recorder is not None:
            recorder.meanings[span] = meaning

    def is_told(self, code: str, name: str, span: Span) -> bool:
        """Return whether a name was reported as unknown elsewhere; then this place is added."""
        first = self.session.unknown.setdefault((self.findings, name), span)
        if first == span:
            return False
        self.findings.again(code, first, span)
        return True

    def slot(self, name: str, type_: Type) -> core.Variable:
        """A fresh bound variable."""
        self.bound += 1
        return core.Variable(core.Home.BOUND, self.bound - 1, name, type_)

    def declare(
        self, name: ast.Ident, type_: Type | None, role: Role, kind: int | None = None
    ) -> BoundSymbol:
        """Bind a name in the innermost frame."""
        if name.name in RESERVED and role is not Role.QUANTIFIED:
            self.error(
                "K209",
                name.span,
                f"`{name.name}` is the language's own name, and has a meaning everywhere",
                "choose another name",
            )
        variable = self.slot(name.name, type_) if type_ is not None else None
        symbol = BoundSymbol(variable, role, name, kind)
        self.frames[-1][name.name] = symbol
        self.note(name.span, symbol)
        return symbol

    def lookup(self, name: str) -> BoundSymbol | None:
        """The symbol of a bound name, from the innermost frame outwards."""
        for frame in reversed(self.frames):
            if name in frame:
                return frame[name]
        return None

    @contextmanager
    def frame(self) -> Iterator[None]:
        """Within the context, bind names in a frame of their own."""
        self.frames.append({})
        try:
            yield
        finally:
            self.frames.pop()

    def pid(self) -> core.Variable:
        """The variable that stands for ``pid`` in a property: it is closed over all robots."""
        if self.closing is None:
            self.closing = self.slot("pid", INT)
        return self.closing

    def fresh_site(self) -> int:
        """A fresh number for a call or a choice."""
        return self.session.sites.take()
