"""Values of programs as JSON with names: records by their fields, enumerations by their members."""

from __future__ import annotations

import math
from typing import Any, assert_never

from koord.runtime.shapes import (
    Array,
    Enumeration,
    Mapping,
    PerRobot,
    Record,
    Scalar,
    Sequence,
    Shape,
)

#: Lengths to a tenth of a millimetre.
_DIGITS = 4


def named(shape: Shape, plain: Any) -> Any:
    """A plain value as JSON that can be read without the program."""
    if plain is None:
        return None
    match shape:
        case Scalar():
            return rounded(plain) if isinstance(plain, float) else plain
        case Enumeration(members=members):
            return members[plain]
        case Record(make=make, fields=fields):
            names: tuple[str, ...] = getattr(make, "_fields", ())
            return {n: named(f, p) for n, f, p in zip(names, fields, plain, strict=True)}
        case Array(element=element) | PerRobot(element=element) | Sequence(element=element):
            return [named(element, item) for item in plain]
        case Mapping(key=key, value=value):
            return [{"key": named(key, k), "value": named(value, v)} for k, v in plain]
    assert_never(shape)


def rounded(number: float) -> float | str:
    """A number without digits that nobody looks at; what is none has no JSON, and becomes text."""
    return round(number, _DIGITS) if math.isfinite(number) else str(number)
