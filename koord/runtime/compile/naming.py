"""Python names and types for the parts of a program.

Names stay as they are wherever Python lets them. Whoever runs compiled programs asks here, too,
which attribute holds which variable.
"""

from __future__ import annotations

import builtins
import keyword
import re
from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import PurePath

from koord.runtime import robot
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.source import Span
from koord.syntax.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    GrowingType,
    IntType,
    MapType,
    OpaqueType,
    RecordType,
    Robots,
    SequenceType,
    StreamType,
    StringType,
    Type,
)
from koord.syntax.walk import nodes

_KEYWORDS = frozenset(keyword.kwlist) | {"self", "type", "match", "case"}

#: What compiled modules import or may use of Python.
_OF_MODULES = frozenset(dir(builtins)) | frozenset(robot.__all__) | {"Any", "NamedTuple"}

#: Attributes of every robot.
_OF_ROBOTS = frozenset(dir(robot.Robot))

#: Attributes of every named tuple, and of every class.
_OF_RECORDS = frozenset(dir(tuple)) | {"_make", "_replace", "_asdict", "_fields"}


class PythonNames:
    """The Python names of a program's parts, all distinct."""

    def __init__(self, program: core.Program) -> None:
        self.program = program
        self.file = _file(program)
        stem = _camel(PurePath(program.name).stem) or "Program"
        types = dict.fromkeys(_named_types(program))
        taken = set(_KEYWORDS | _OF_MODULES)
        self.types: dict[RecordType | EnumType, str] = {
            type_: _fresh(_camel_first(type_.name), taken) for type_ in types
        }
        self.fleet = _fresh(stem if stem not in taken else f"{stem}Robot", taken)
        #: The class of each kind of robot; a program with one kind has no class above it.
        self.kinds = [
            self.fleet if len(program.agents) == 1 else _fresh(_camel_first(agent.name), taken)
            for agent in program.agents
        ]
        self.module_functions = {f.name: _fresh(f.name, taken) for f in program.functions}
        self.of_module = frozenset(taken)

        shared = set(_KEYWORDS | _OF_ROBOTS)
        self.shared: dict[tuple[Home, int], str] = {
            (entry.variable.home, entry.variable.slot): _fresh(entry.variable.name, shared)
            for entry in (*program.allread, *program.allwrite)
        }
        self.externals = {f.name: _fresh(f.name, shared) for f in program.externals}
        self.methods = {f.name: _fresh(f.name, shared) for f in program.functions}
        self.own: list[dict[tuple[Home, int], str]] = []
        self.events: list[list[tuple[str, str]]] = []
        for agent in program.agents:
            of_kind = set(shared)
            self.own.append(dict(_own_names(agent, of_kind)))
            self.events.append([_event_names(event.name, of_kind) for event in agent.events])

    def attribute(self, variable: core.Variable, agent: int | None) -> str:
        """The attribute that holds a variable of some kind of robot."""
        place = (variable.home, variable.slot)
        if place in self.shared:
            return self.shared[place]
        assert agent is not None, variable
        return self.own[agent][place]

    def local(self, name: str, taken: set[str]) -> str:
        """A fresh name for a local variable of a method."""
        return _fresh(name, taken)

    def locals_taken(self) -> set[str]:
        """The names that local variables must not have."""
        return set(_KEYWORDS | _OF_MODULES | self.of_module | {"key", "trail", "place", "delta"})

    @staticmethod
    def field(name: str) -> str:
        """The name of a record's field."""
        taken = set(_KEYWORDS | _OF_RECORDS)
        return _fresh(name, taken)

    @staticmethod
    def member(name: str) -> str:
        """The name of an enumeration's member."""
        taken = set(_KEYWORDS | {"NAMES"})
        return _fresh(name, taken)


def _file(program: core.Program) -> str:
    """The file that the program stands in."""
    agents = program.agents
    return next((e.span.file for agent in agents for e in agent.events), program.name)


def _own_names(agent: core.Agent, taken: set[str]) -> Iterator[tuple[tuple[Home, int], str]]:
    for entry in agent.locals:
        yield (Home.LOCAL, entry.variable.slot), _fresh(entry.variable.name, taken)
    for port in agent.ports:
        variable = port.declaration.variable
        yield (Home.PORT, variable.slot), _fresh(f"{port.module}_{port.shown}", taken)


def _event_names(name: str, taken: set[str]) -> tuple[str, str]:
    """The methods of an event: its effect, and its guard."""
    effect = _fresh(name if name not in taken else f"{name}_event", taken)
    return effect, _fresh(f"{effect}_enabled", taken)


def _fresh(name: str, taken: set[str]) -> str:
    """A fresh name, equal or similar to the given one, that Python allows."""
    found = re.sub(r"\W", "_", name, flags=re.ASCII).lstrip("_") or "x"
    if found[0].isdigit():
        found = f"x{found}"
    while found in taken:
        found += "_"
    taken.add(found)
    return found


def _camel(name: str) -> str:
    return "".join(_camel_first(part) for part in re.split(r"\W|_", name) if part)


def _camel_first(name: str) -> str:
    return name[:1].upper() + name[1:]


def _named_types(program: core.Program) -> Iterator[RecordType | EnumType]:
    """The records and enumerations of a program, each after those it contains."""
    for node in nodes(_parts(program)):
        type_ = getattr(node, "type", None)
        if type_ is not None:
            yield from _within(type_)


def _parts(program: core.Program) -> tuple[object, ...]:
    """All parts that are compiled: no properties, contracts, or summaries' promises."""
    agents = tuple(
        (
            *(part for agent in program.agents for part in (agent.locals, agent.ports)),
            *(part for agent in program.agents for part in (agent.init, agent.events)),
            *(m.environment or () for agent in program.agents for m in agent.modules),
        )
    )
    externals = tuple((e.parameters, e.result, e.requires) for e in program.externals)
    return (program.allread, program.allwrite, program.functions, externals, agents)


def _within(type_: Type) -> Iterable[RecordType | EnumType]:
    for part in type_.parts:
        yield from _within(part)
    if isinstance(type_, RecordType | EnumType):
        yield type_


class NumberTooLargeError(KoordError):
    """Raised for a float in a program that is too large for a double."""

    def __init__(self, span: Span) -> None:
        message = "a number of this program is larger than any double, which robots calculate with"
        hint = (
            "numbers up to 1.7e308 have doubles: take another unit, or another value of the param"
        )
        super().__init__((Diagnostic("K925", Severity.ERROR, span, message, hint),))


class NotCompilableError(Exception):
    """Raised for a program with opaque types, which only the verifier makes."""


def annotation(names: PythonNames, type_: Type) -> str:
    """The Python annotation of a type."""
    match type_:
        case IntType() | EnumType():
            return "int"
        case FloatType():
            return "float"
        case BoolType():
            return "bool"
        case StringType() | StreamType():
            return "str"
        case RecordType():
            return names.types[type_]
        case SequenceType(element=element):
            return f"tuple[{annotation(names, element)}, ...]"
        case MapType(key=key, value=value):
            return f"dict[{annotation(names, key)}, {annotation(names, value)}]"
        case OpaqueType(name=name):
            raise NotCompilableError(name)


def shape(names: PythonNames, type_: Type) -> str:
    """The Python expression that makes the shape of a type."""
    match type_:
        case IntType():
            return "INT"
        case FloatType():
            return "FLOAT"
        case BoolType():
            return "BOOL"
        case StringType() | StreamType():
            return "STRING"
        case RecordType() | EnumType():
            return constant_name(names.types[type_])
        case ArrayType(element=element, size=Robots.ALL):
            return f"PerRobot({shape(names, element)})"
        case ArrayType(element=element, size=size):
            return f"Array({shape(names, element)}, {size})"
        case GrowingType(element=element):
            return f"ListOf({shape(names, element)})"
        case MapType(key=key, value=value):
            return f"MapOf({shape(names, key)}, {shape(names, value)})"
        case OpaqueType(name=name):
            raise NotCompilableError(name)


def tuple_of(items: Iterable[str]) -> str:
    """A tuple of items."""
    parts = list(items)
    return f"({', '.join(parts)}{',' if len(parts) == 1 else ''})"


def constant_name(name: str) -> str:
    """The name of the constant that holds a class's shape."""
    return f"{name.upper()}_"


def is_tree(type_: Type) -> bool:
    """Return whether a variable of a type is a tree of atoms. [ATOM]"""
    return isinstance(type_, RecordType | ArrayType)


def constant(
    names: PythonNames, value: int | Fraction | bool | str, type_: Type, span: Span
) -> str:
    """Compile a constant. Raises NumberTooLargeError."""
    match type_:
        case FloatType():
            try:
                return repr(float(Fraction(value)))
            except OverflowError:
                raise NumberTooLargeError(span) from None
        case EnumType(members=members):
            assert isinstance(value, int)
            return f"{names.types[type_]}.{names.member(members[value])}"
        case StringType() | StreamType():
            assert isinstance(value, str)
            return string(value)
        case _:
            return repr(value)


def string(value: str) -> str:
    """A string literal, in the quotes that formatters choose."""
    if value.count('"') > value.count("'"):
        return "'" + _escaped(value).replace("'", "\\'") + "'"
    return '"' + _escaped(value).replace('"', '\\"') + '"'


def _escaped(value: str) -> str:
    """The inside of a literal without any quote escaped."""
    return "".join(c if c in "'\"" else repr(c)[1:-1] for c in value)
