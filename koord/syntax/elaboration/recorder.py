"""The recorder: what names mean and of what types expressions are, as an elaboration finds out.

Editors ask for it. It is told by the functions that resolve names, so that nothing resolves them
a second time; without a recorder nothing is told. A :data:`HOLE` in a text is a name that nothing
declares: what could stand in its place is noted.
"""

from __future__ import annotations

from enum import Enum
from typing import TypeAlias

from msgspec import Struct, field

from koord.syntax import ast, core
from koord.syntax.elaboration.symbols import (
    BoundSymbol,
    FunctionTable,
    Named,
    PortNamed,
    Signature,
)
from koord.syntax.elaboration.where import Where
from koord.syntax.source import Span
from koord.syntax.types import RecordType, Type

#: The name that stands at the cursor while completions are looked for; no program has it.
HOLE = "koord__hole__"


class FieldSymbol(Struct, frozen=True):
    """A field of a record."""

    record: RecordType
    position: int


class TypeSymbol(Struct, frozen=True):
    """A type by its name; ``type`` is None if its declaration is wrong."""

    name: str
    type: Type | None


class ModuleSymbol(Struct, frozen=True):
    """A module, where a port is qualified by it."""

    name: str


class EventSymbol(Struct, frozen=True):
    """An event, where ``ran`` names it."""

    name: str


class KindSymbol(Struct, frozen=True):
    """A kind of robot, where a quantifier names it."""

    name: str


class OwnName(Struct, frozen=True):
    """A name of the language: ``pid``, ``length``, ``append``."""

    name: str


Meaning: TypeAlias = (
    Named
    | PortNamed
    | BoundSymbol
    | Signature
    | FieldSymbol
    | TypeSymbol
    | ModuleSymbol
    | EventSymbol
    | KindSymbol
    | OwnName
)


class Candidate(Struct, frozen=True):
    """A name that could stand in a hole; ``type`` is that of a value, as far as it is known."""

    name: str
    meaning: Meaning
    type: Type | None = None


class HoleKind(Enum):
    """What a hole stands for."""

    VALUE = "value"
    STATEMENT = "statement"  #: the first word of one
    TYPE = "type"
    EVENT = "event"
    PART = "part"  #: of what stands before the dot


class Hole(Struct, frozen=True):
    """The place of a hole: what could stand there, and the type that is wanted, if one is."""

    kind: HoleKind
    candidates: tuple[Candidate, ...]
    expected: Type | None = None
    where: Where | None = None


class Recorder(Struct):
    """What was found out about the places of a text."""

    meanings: dict[Span, Meaning] = field(default_factory=dict)
    types: dict[Span, Type] = field(default_factory=dict)
    #: The classes that blocks of ``atomic`` lock, by the places of the blocks.
    locked: dict[Span, core.LockClass] = field(default_factory=dict)
    functions: FunctionTable = field(default_factory=FunctionTable)
    program: ast.Program | None = None
    hole: Hole | None = None
