"""Values and storage as JSON, by their types. [TRACE]

int                 123, or "0x7f…" from 2⁵³ on, where other readers of JSON would round
float, exact        "3/4", "-2"            float, double    0.75, "inf", "-inf", "nan"
enumeration         "idle"                 record           {"x": …, "y": …}
array, list, queue  […]                    map              [[key, value], …]
an unset atom       {"#unset": null}
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from fractions import Fraction
from typing import TypeAlias, assert_never

from msgspec import Struct

from koord.semantics.domain import LONGEST_NUMBER_BITS, Constant
from koord.semantics.storage import Cell, Storage, Tree
from koord.semantics.values import (
    Rec,
    Seq,
    Table,
    Value,
    default,
)
from koord.syntax.literals import ParamValue
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
    SetType,
    StreamType,
    StringType,
    Type,
    part_types,
    show,
)
from koord.traces.json_reader import JsonNode, shortened
from koord.traces.trace import Numbers

Json: TypeAlias = "int | float | str | bool | list[Json] | dict[str, Json] | None"

UNSET: Json = {"#unset": None}

#: Integers from here on are written in hexadecimal: JSON's readers may take numbers for doubles.
_LARGE = 2**53

#: No value that a command line can give is nested deeper.
_DEEPEST_PARAM = 20

_INTEGER = rf"-?(0x[0-9a-f]{{1,{LONGEST_NUMBER_BITS // 4 + 1}}}|[0-9]{{1,4000}})\Z"
_NOT_FINITE = {"inf": math.inf, "-inf": -math.inf, "nan": math.nan}


# --- numbers ------------------------------------------------------------------------------------


def encode_int(value: int) -> Json:
    return value if -_LARGE < value < _LARGE else hex(value)


def decode_int(node: JsonNode) -> int:
    if isinstance(node.value, str):
        return _integer(node, node.value)
    return node.integer()


def encode_fraction(value: int | Fraction) -> str:
    """An exact number as a string: ``3/4``, ``-2``."""
    top, bottom = value.numerator, value.denominator
    return _digits(top) if bottom == 1 else f"{_digits(top)}/{_digits(bottom)}"


def decode_fraction(node: JsonNode) -> Fraction:
    text = node.text()
    top, slash, bottom = text.partition("/")
    numerator = _integer(node, top)
    denominator = _integer(node, bottom) if slash else 1
    if denominator <= 0:
        raise node.refuse(f"{shortened(text)!r} is no exact number: it divides by zero or less")
    return Fraction(numerator, denominator)


def _digits(value: int) -> str:
    return str(value) if -_LARGE < value < _LARGE else hex(value)


def _integer(node: JsonNode, text: str) -> int:
    if not re.match(_INTEGER, text):
        raise node.refuse(f'{shortened(text)!r} is no exact number: write "3/4", "-2" or "0x1f"')
    return int(text, 16) if "x" in text else int(text)


def _encode_double(value: float) -> Json:
    if math.isfinite(value):
        return value
    return "nan" if math.isnan(value) else ("inf" if value > 0 else "-inf")


def _decode_double(node: JsonNode) -> float:
    value = node.value
    if isinstance(value, str) and value in _NOT_FINITE:
        return _NOT_FINITE[value]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise node.refuse('there should be a number here, or "inf", "-inf", "nan"')
    try:
        return float(value)
    except OverflowError:
        raise node.refuse("the number is larger than any double") from None


# --- values -------------------------------------------------------------------------------------


class Form(Struct, frozen=True):
    """A JSON form of values. In each form records are objects, and sequences arrays.

    ``scalar`` and ``table`` say what else there is: that of a scalar, and that of a map's entries.
    ``unset`` stands for atoms that are not set.
    """

    scalar: Callable[[Constant, Type], Json]
    table: Callable[[MapType, list[tuple[Json, Json]]], Json]
    unset: Json

    def value(self, value: Value[Constant], type_: Type) -> Json:
        """Encode a value of a type."""
        match value:
            case Rec(fields=parts):
                assert isinstance(type_, RecordType)
                pairs_of = zip(type_.fields, parts, strict=True)
                return {name: self.value(part, t) for (name, t), part in pairs_of}
            case Seq(items=items):
                assert isinstance(type_, SequenceType)
                return [self.value(item, type_.element) for item in items]
            case Table(entries=entries):
                assert isinstance(type_, MapType)
                key, held = type_.key, type_.value
                pairs = [(self.value(k, key), self.value(v, held)) for k, v in entries]
                return self.table(type_, pairs)
            case _:
                return self.scalar(value, type_)

    def storage(self, storage: Storage[Constant], type_: Type) -> Json:
        """Encode storage of a type like a value, with marks for atoms that are not set."""
        if isinstance(storage, Cell):
            return self.value(storage.value, type_) if storage.is_set else self.unset
        types = part_types(type_, len(storage.parts))
        parts = [self.storage(part, t) for part, t in zip(storage.parts, types, strict=True)]
        if isinstance(type_, RecordType):
            return {name: part for (name, _), part in zip(type_.fields, parts, strict=True)}
        return list(parts)


def _encode_scalar(value: Constant, type_: Type) -> Json:
    if isinstance(type_, EnumType):
        assert isinstance(value, int)
        return type_.members[value]
    if isinstance(type_, FloatType):
        assert not isinstance(value, str)
        return _encode_double(value) if isinstance(value, float) else encode_fraction(value)
    if isinstance(value, int) and not isinstance(value, bool):
        return encode_int(value)
    assert not isinstance(value, Fraction)
    return value


def _entries(type_: MapType, pairs: list[tuple[Json, Json]]) -> Json:
    return [key if isinstance(type_, SetType) else [key, held] for key, held in pairs]


#: The form of traces.
_OF_TRACES = Form(_encode_scalar, _entries, UNSET)

encode_value = _OF_TRACES.value
encode_storage = _OF_TRACES.storage


def decode_value(node: JsonNode, type_: Type, robots: int, numbers: Numbers) -> Value[Constant]:
    """Decode a value of a type from a part of a document. Raises FormError."""
    match type_:
        case IntType():
            return decode_int(node)
        case FloatType():
            exact = numbers is Numbers.EXACT
            return decode_fraction(node) if exact else _decode_double(node)
        case BoolType():
            return node.boolean()
        case StringType() | StreamType() | OpaqueType():
            return node.text()
        case EnumType(members=members):
            name = node.text()
            if name not in members:
                raise node.refuse(f"{shortened(name)!r} is no member of {show(type_)}", "K914")
            return members.index(name)
        case RecordType(fields=fields):
            parts = node.fields([name for name, _ in fields])
            return Rec(tuple(decode_value(parts[n], t, robots, numbers) for n, t in fields))
        case ArrayType(element=element, size=size):
            items = node.items(robots if size is Robots.ALL else size)
            return _sequence(items, element, robots, numbers)
        case GrowingType(element=element):
            return _sequence(node.items(), element, robots, numbers)
        case MapType():
            return _decode_map(node, type_, robots, numbers)
    assert_never(type_)


def _sequence(
    items: Iterable[JsonNode], element: Type, robots: int, numbers: Numbers
) -> Seq[Constant]:
    decoded = tuple(decode_value(item, element, robots, numbers) for item in items)
    return Seq(len(decoded), decoded)


def _decode_map(node: JsonNode, type_: MapType, robots: int, numbers: Numbers) -> Table[Constant]:
    entries: dict[Value[Constant], Value[Constant]] = {}
    for item in node.items():
        key_part, value_part = (item, None) if isinstance(type_, SetType) else item.items(2)
        key = decode_value(key_part, type_.key, robots, numbers)
        if key in entries:
            raise key_part.refuse("the map has this key already")
        entries[key] = (
            0 if value_part is None else decode_value(value_part, type_.value, robots, numbers)
        )
    return Table(len(entries), tuple(entries.items()))


# --- params --------------------------------------------------------------------------------------


def encode_param(value: ParamValue) -> Json:
    """Encode the value of a param, whose type is not known here."""
    match value:
        case bool() | str():
            return value
        case int():
            return {"int": encode_fraction(value)}
        case Fraction():
            return {"float": encode_fraction(value)}
        case tuple():
            return list(map(encode_param, value))
    assert_never(value)


def decode_param(node: JsonNode, depth: int = 0) -> ParamValue:
    """Decode the value of a param. Raises FormError."""
    value = node.value
    if isinstance(value, bool | str):
        return value
    if isinstance(value, list):
        if depth == _DEEPEST_PARAM:
            raise node.refuse("the value is nested too deeply")
        return tuple(decode_param(item, depth + 1) for item in node.items())
    parts = dict(node.entries())
    if len(parts) != 1 or not parts.keys() <= {"int", "float"}:
        raise node.refuse('there should be {"int": "3"} or {"float": "3/4"} here')
    ((kind, part),) = parts.items()
    number = decode_fraction(part)
    if kind == "float":
        return number
    if number.denominator != 1:
        raise part.refuse("this is no integer")
    return number.numerator


# --- storage ------------------------------------------------------------------------------------


def decode_storage(node: JsonNode, type_: Type, robots: int, numbers: Numbers) -> Storage[Constant]:
    """Decode storage of a type from a part of a document. Raises FormError."""
    match type_:
        case RecordType(fields=fields):
            parts = node.fields([name for name, _ in fields])
            return Tree(tuple(decode_storage(parts[n], t, robots, numbers) for n, t in fields))
        case ArrayType(element=element, size=size):
            items = node.items(robots if size is Robots.ALL else size)
            return Tree(tuple(decode_storage(i, element, robots, numbers) for i in items))
        case _:
            if node.value == UNSET:
                return Cell(False, default(numbers.domain, type_, robots))
            return Cell(True, decode_value(node, type_, robots, numbers))
