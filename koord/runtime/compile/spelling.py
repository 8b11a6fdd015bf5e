"""Types as Python writes them: annotations, shapes, constants."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction

from koord.runtime.compile.naming import PythonNames
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


class NumberTooLargeError(KoordError):
    """A program has a float that is no double."""

    def __init__(self, span: Span) -> None:
        message = "a number of this program is larger than any double, which robots calculate with"
        hint = (
            "numbers up to 1.7e308 have doubles: take another unit, or another value of the param"
        )
        super().__init__((Diagnostic("K925", Severity.ERROR, span, message, hint),))


class NotCompilableError(Exception):
    """A program has something in it that no text has: only the verifier makes opaque types."""


def annotation(names: PythonNames, type_: Type) -> str:
    """The type as an annotation."""
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
    """The type as an expression that makes its shape."""
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
    """What the shape of a class of that name is called."""
    return f"{name.upper()}_"


def is_tree(type_: Type) -> bool:
    """Whether a variable of a type is a tree of atoms. [ATOM]"""
    return isinstance(type_, RecordType | ArrayType)


def constant(
    names: PythonNames, value: int | Fraction | bool | str, type_: Type, span: Span
) -> str:
    """A constant of the text. Raises NumberTooLargeError."""
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
