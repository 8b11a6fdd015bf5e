"""Rendering of values for people, in one line."""

from __future__ import annotations

import math
from fractions import Fraction

from koord.semantics.domain import Constant
from koord.semantics.recordings import Recording
from koord.semantics.storage import Cell, Storage
from koord.semantics.values import Rec, Seq, Table, Value
from koord.syntax.types import (
    POS,
    BoolType,
    EnumType,
    MapType,
    RecordType,
    SequenceType,
    SetType,
    StringType,
    Type,
    part_types,
)

UNSET = "unset"

#: Stands in front of numbers that are shown with fewer digits than they have.
ROUNDED = "≈"

#: Exact numbers with so many decimals are shown as decimals; others are rounded to fewer.
_DECIMALS = 6
_ROUNDED = 4

#: Numbers with so small a denominator that is none of a decimal are shown as fractions.
_SMALL_DENOMINATOR = 12

_LONGEST_INTEGER = 30


def show_value(value: Value[Constant], type_: Type) -> str:
    """Render a value of a type, as a program would write it."""
    match value:
        case Rec(fields=parts):
            assert isinstance(type_, RecordType)
            pairs = zip(type_.fields, parts, strict=True)
            if type_ == POS:
                return f"({', '.join(show_value(part, t) for (_, t), part in pairs)})"
            shown = ", ".join(f"{name} = {show_value(part, t)}" for (name, t), part in pairs)
            return f"{type_.name}({shown})"
        case Seq(items=items):
            assert isinstance(type_, SequenceType)
            return f"[{', '.join(show_value(item, type_.element) for item in items)}]"
        case Table(entries=entries):
            assert isinstance(type_, MapType)
            if isinstance(type_, SetType):
                return f"{{{', '.join(show_value(k, type_.key) for k, _ in entries)}}}"
            shown = ", ".join(
                f"{show_value(k, type_.key)}: {show_value(v, type_.value)}" for k, v in entries
            )
            return f"{{{shown}}}"
        case _:
            return _show_scalar(value, type_)


def show_storage(storage: Storage[Constant], type_: Type) -> str:
    """Render the storage of a variable; parts that are not set are shown as ``unset``."""
    if isinstance(storage, Cell):
        return show_value(storage.value, type_) if storage.is_set else UNSET
    types = part_types(type_, len(storage.parts))
    parts = [show_storage(part, t) for part, t in zip(storage.parts, types, strict=True)]
    if not isinstance(type_, RecordType):
        return f"[{', '.join(parts)}]"
    if all(part == UNSET for part in parts):
        return UNSET
    if type_ == POS:
        return f"({', '.join(parts)})"
    shown = ", ".join(f"{n} = {part}" for (n, _), part in zip(type_.fields, parts, strict=True))
    return f"{type_.name}({shown})"


def show_output(values: tuple[Value[Constant], ...], types: tuple[Type, ...]) -> str:
    """Render an output as ``<<`` prints it: strings without quotes, values concatenated."""
    pairs = zip(values, types, strict=True)
    return "".join(
        value if isinstance(value, str) else show_value(value, type_) for value, type_ in pairs
    )


def _show_scalar(value: Constant, type_: Type) -> str:
    if isinstance(type_, EnumType):
        assert isinstance(value, int)
        return type_.members[value]
    if isinstance(type_, BoolType):
        return "true" if value else "false"
    match value:
        case str():
            return f'"{value}"' if isinstance(type_, StringType) else value
        case Fraction():
            return show_fraction(value)
        case float():
            return _show_double(value)
        case _:
            return _show_int(value)


def _show_int(value: int) -> str:
    if value.bit_length() <= 3 * _LONGEST_INTEGER:
        return str(value)
    digits = int((value.bit_length() - 1) * math.log10(2))
    return f"{'-' if value < 0 else ''}(about {digits + 1} digits)"


def show_fraction(value: Fraction) -> str:
    """Print an exact number: exactly where that is short, else rounded.

    As a decimal where that is exact and short, as ``1/3`` where that is short, and otherwise
    rounded, which ``≈`` says.
    """
    if value.denominator == 1:
        return _show_int(value.numerator)
    scaled = value * 10**_DECIMALS
    if scaled.denominator == 1:
        return _decimal(scaled.numerator, _DECIMALS)
    if value.denominator <= _SMALL_DENOMINATOR:
        return f"{_show_int(value.numerator)}/{value.denominator}"
    if abs(value) >= 10**_LONGEST_INTEGER:
        return f"{ROUNDED}{_show_int(round(value))}"
    if abs(value) * 10**_ROUNDED >= 10:
        return f"{ROUNDED}{_decimal(round(value * 10**_ROUNDED), _ROUNDED)}"
    try:
        return f"{ROUNDED}{float(value):.3g}"
    except OverflowError:
        return f"{ROUNDED}0"


def _decimal(scaled: int, places: int) -> str:
    """Convert an integer times ``10**-places`` to a decimal."""
    sign, whole = ("-" if scaled < 0 else ""), abs(scaled)
    digits = f"{whole % 10**places:0{places}d}".rstrip("0")
    return f"{sign}{whole // 10**places}{'.' if digits else ''}{digits}"


def _show_double(value: float) -> str:
    if not math.isfinite(value):
        return "nan" if math.isnan(value) else ("inf" if value > 0 else "-inf")
    if value == int(value) and abs(value) < 1e15:
        return str(int(value))
    exact = repr(value)
    return exact if len(exact) <= 9 else f"{ROUNDED}{value:.6g}"


def repeats(recording: Recording) -> str:
    """Describe the rounds of a lasso that repeat; rounds count from 1."""
    assert recording.loop is not None
    first, last = recording.loop + 1, len(recording.rounds)
    which = f"round {first} repeats" if first == last else f"rounds {first} to {last} repeat"
    return f"{which} for ever"
