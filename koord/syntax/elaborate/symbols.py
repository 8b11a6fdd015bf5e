"""What a name can mean."""

from __future__ import annotations

from enum import Enum

from msgspec import Struct, field

from koord.syntax import ast, core
from koord.syntax.source import Span
from koord.syntax.types import EnumType, RecordType

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
    """A constant of the run, with its value; None if it has none that is right."""

    value: core.Expr | None
    declared: ast.Ident


class MemberSymbol(Struct, frozen=True):
    """A member of an enumeration."""

    type: EnumType
    position: int
    declared: ast.Ident


class Role(Enum):
    """What a bound name is; the value says it in messages."""

    LOOP = "the variable of a loop"
    ELEMENT = "an element of the list that the loop goes through"
    PARAMETER = "a parameter"
    LOCAL = "a variable of the function"
    QUANTIFIED = "a quantified variable"
    RESULT = "the result of the function"


class BoundSymbol(Struct, frozen=True):
    """A name bound in a body. ``variable`` is None if its type is wrong (told already).

    ``kind`` is the kind of robot that a quantified variable ranges over, if it is one kind.
    """

    variable: core.Variable | None
    role: Role
    declared: ast.Ident
    kind: int | None = None


class Poisoned(Struct, frozen=True):
    """A name whose declaration is wrong, which was told: using it is no further error."""

    declared: ast.Ident


class Pending(Struct, frozen=True):
    """A name whose declaration is still to be read: it has no meaning in other declarations yet."""

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
