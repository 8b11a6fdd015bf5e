"""Values of params as they are written: as ``--set`` and Koord read them, and as JSON has them."""

from __future__ import annotations

import json
import re
from decimal import Decimal
from fractions import Fraction

#: A value of a ``param``; members of enumerations by name, a ``pos`` as its three coordinates.
ParamValue = int | Fraction | bool | str | tuple["ParamValue", ...]

_WORD = re.compile(r"[^\W\d]\w*\Z")

#: Decimals with so many digits are written in full; Python writes no integer beyond some thousands.
_LONGEST = 30
_MOST_BITS = 10_000


def literal(value: ParamValue) -> str:
    """A value as text, exactly: ``4``, ``0.5``, ``2.0``, ``1/3``, ``true``, ``pick``, ``[1]``."""
    match value:
        case bool():
            return "true" if value else "false"
        case int():
            return number(Fraction(value))
        case Fraction():
            text = number(value)
            return f"{text}.0" if text.lstrip("-").isdigit() else text
        case str():
            return value if _WORD.match(value) else json.dumps(value, ensure_ascii=False)
        case tuple():
            return f"[{', '.join(map(literal, value))}]"


def number(value: Fraction) -> str:
    """A number exactly: as a decimal where that is exact, else as a fraction.

    Only what has thousands of digits is cut short, which ``≈`` says.
    """
    if max(value.numerator.bit_length(), value.denominator.bit_length()) > _MOST_BITS:
        return f"≈{Decimal(value.numerator) / Decimal(value.denominator):.6g}"
    places = _places(value.denominator)
    if places is None:
        return f"{value.numerator}/{value.denominator}"
    digits = str(abs(value.numerator) * 10**places // value.denominator)
    sign = "-" if value < 0 else ""
    if len(digits) <= _LONGEST and places <= _LONGEST:
        whole, part = divmod(int(digits), 10**places)
        return f"{sign}{whole}" + (f".{part:0{places}d}" if places else "")
    kept = digits.rstrip("0")
    behind = f".{kept[1:]}" if len(kept) > 1 else ""
    return f"{sign}{kept[0]}{behind}e{len(digits) - 1 - places}"


def _places(denominator: int) -> int | None:
    """How many decimals a fraction has; None if they do not end."""
    twos = (denominator & -denominator).bit_length() - 1
    rest, fives = denominator >> twos, 0
    while rest % 5 == 0:
        rest, fives = rest // 5, fives + 1
    return max(twos, fives) if rest == 1 else None


def encoded(value: ParamValue) -> object:
    """A value as JSON has it; a fraction is ``{"fraction": "1/3"}``."""
    match value:
        case Fraction():
            return {"fraction": str(value)}
        case tuple():
            return [encoded(part) for part in value]
        case bool() | int() | str():
            return value
