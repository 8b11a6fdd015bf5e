"""Symbols: the meanings of names."""

from __future__ import annotations

from enum import Enum

from msgspec import Struct, field

from koord.syntax import ast, core
from koord.syntax.source import Span
from koord.syntax.types import EnumType, RecordType, Type

#: Names that every program has and none may declare.
RESERVED = frozenset({"pid", "numAgents", "Nsys"})


class VariableSymbol(Struct, frozen=True):
    """A local or shared variable. ``declared`` is the declaration's name."""

    variable: core.Variable
    declared: ast.Ident
    type_span: Span


class PortSymbol(Struct, frozen=True):
    """A port of a module in use."""

    variable: core.Variable
    module: str
    direction: core.Direction
    declared: ast.Ident


class StreamSymbol(Struct, frozen=True):
    """A port that ``<<`` writes to. It holds no value and is no part of a configuration."""

    stream: str
    module: str
    declared: ast.Ident


class ParamSymbol(Struct, frozen=True):
    """A param, with its value; None if it has no valid one."""

    value: core.Expr | None
    declared: ast.Ident


class MemberSymbol(Struct, frozen=True):
    """A member of an enumeration."""

    type: EnumType
    position: int
    declared: ast.Ident


class Role(Enum):
    """The role of a bound name; the value says it in messages."""

    LOOP = "the variable of a loop"
    ELEMENT = "an element of the list that the loop goes through"
    PARAMETER = "a parameter"
    LOCAL = "a variable of the function"
    QUANTIFIED = "a quantified variable"
    RESULT = "the result of the function"


class BoundSymbol(Struct, frozen=True):
    """A name bound in a body. ``variable`` is None if its type is wrong (reported already).

    ``kind`` is the kind of robot that a quantified variable ranges over, if it is one kind.
    """

    variable: core.Variable | None
    role: Role
    declared: ast.Ident
    kind: int | None = None


class Poisoned(Struct, frozen=True):
    """A name whose declaration is wrong, which was reported: using it is no further error."""

    declared: ast.Ident


class Pending(Struct, frozen=True):
    """A name whose declaration is not elaborated yet, so that other declarations cannot use it."""

    declared: ast.Ident
    is_param: bool


Named = VariableSymbol | ParamSymbol | MemberSymbol | Poisoned | Pending
PortNamed = PortSymbol | StreamSymbol | Poisoned


class ModuleScope(Struct):
    """A module in use: its ports by every name that they go by."""

    name: str
    declared: ast.Ident
    ports: dict[str, PortNamed] = field(default_factory=dict)


class AgentScope(Struct):
    """The names that only one kind of robot has."""

    index: int
    name: str
    variables: dict[str, Named] = field(default_factory=dict)
    modules: dict[str, ModuleScope] = field(default_factory=dict)
    ports: dict[str, list[PortNamed]] = field(default_factory=dict)
    slots: dict[int, PortSymbol] = field(default_factory=dict)
    events: dict[str, int] = field(default_factory=dict)


class RecordInfo(Struct, frozen=True):
    """A record: its type and the values of fields that a construction leaves out."""

    type: RecordType
    defaults: tuple[ast.Expr | None, ...]
    declared: ast.Ident


class Signature(Struct):
    """A function's signature. A type that is None is wrong, which was reported."""

    name: str  #: in the core program, where names are unique
    written: str
    parameters: tuple[Type | None, ...]
    parameter_names: tuple[str, ...]
    result: Type | None
    sound: bool
    definition: ast.FunDef
    library: bool

    @property
    def external(self) -> bool:
        """True if the function is known by its summary only."""
        return isinstance(self.definition.body, ast.External)


class FunctionTable(Struct):
    """Signatures by name, and the functions that the core program needs.

    A function of the library is elaborated when it is first called; ``pending`` holds those that
    still have to be.
    """

    own: dict[str, Signature] = field(default_factory=dict)
    library: dict[str, tuple[Signature, ...]] = field(default_factory=dict)
    definitions: dict[str, tuple[ast.FunDef, ...]] = field(default_factory=dict)
    pending: list[Signature] = field(default_factory=list)
    wanted: set[str] = field(default_factory=set)
    #: For each function, those that it calls.
    calls: dict[str, list[str]] = field(default_factory=dict)
    elaborated: dict[str, core.Function | core.External] = field(default_factory=dict)

    #: Where the program first asked for a function of the library.
    origins: dict[str, Span] = field(default_factory=dict)

    def want(self, signature: Signature, origin: Span) -> None:
        """Record that the core program calls the function; ``origin`` is the call's place."""
        if signature.name not in self.wanted:
            self.wanted.add(signature.name)
            self.origins[signature.name] = origin
            self.pending.append(signature)
