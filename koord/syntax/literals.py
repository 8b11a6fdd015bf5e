"""Literals of params, as in ``--set``, in Koord, and in JSON."""

from __future__ import annotations

import re
from decimal import Decimal
from fractions import Fraction

#: A value of a ``param``; members of enumerations by name, a ``pos`` as its three coordinates.
ParamValue = int | Fraction | bool | str | tuple["ParamValue", ...]

# Patterns are compiled when they are first needed, which most of them are in few programs.
_WORD = r"[^\W\d]\w*\Z"

#: Lists in a value of a param are nested at most so deep.
DEEPEST_LIST = 20

_LIST_TOKEN = r"\s*(\[|\]|,|\"[^\"]*\"|[^\s\[\],\"]+)\s*"

#: A number that is written has so many digits at most, and so many decimal places around the point.
MOST_DIGITS, MOST_PLACES = 100, 400

_INT = rf"[+-]?[0-9]{{1,{MOST_DIGITS}}}\Z"
_DECIMAL = (
    rf"[+-]?([0-9]{{1,{MOST_DIGITS}}}(\.[0-9]{{0,{MOST_DIGITS}}})?|\.[0-9]{{1,{MOST_DIGITS}}})"
    r"([eE][+-]?[0-9]{1,3})?\Z"
)
_NUMBER = r"[+-]?(?=\.?[0-9])[0-9]*(\.[0-9]*)?([eE][+-]?[0-9]+)?\Z"

#: So many characters of a word are shown in a message.
_SHOWN = 60

#: Decimals with so many digits are written in full; Python writes no integer beyond some thousands.
_LONGEST = 30
_MOST_BITS = 10_000


class NumberOutOfRangeError(ValueError):
    """Raised for a number with too many digits, or too large or too close to 0."""


def is_number(text: str) -> bool:
    """Return whether a text is meant as a number."""
    return re.match(_NUMBER, text) is not None


def read_number(text: str) -> int | Fraction | None:
    """Parse a number exactly; None if the text is none.

    Raises NumberOutOfRangeError.
    """
    if re.match(_INT, text):
        return int(text)
    if re.match(_DECIMAL, text):
        value = Fraction(text)
        if not is_moderate(value):
            raise NumberOutOfRangeError(
                f"{shown(text)} does not lie between 1e-{MOST_PLACES} and 1e{MOST_PLACES}"
            )
        return value
    if is_number(text):
        raise NumberOutOfRangeError(
            f"{shown(text)} is too long a number: "
            f"write at most {MOST_DIGITS} digits, or 1e{MOST_PLACES} at most"
        )
    return None


def read_value(text: str) -> ParamValue:
    """Parse a value as ``--set`` has it: ``4``, ``0.5``, ``true``, ``"text"``, ``[1, 2, [3]]``.

    Raises ValueError, which says what is wrong.
    """
    tokens: list[str] = []
    position = 0
    while position < len(text):
        token = re.compile(_LIST_TOKEN).match(text, position)
        if token is None:
            raise ValueError(f"{text!r} is not a value: a quote is not closed")
        tokens.append(token[1])
        position = token.end()
    if not tokens:
        raise ValueError("there is no value behind the =")
    result, rest = _value(tokens, 0)
    if rest != len(tokens):
        raise ValueError(f"{text!r} is not one value: {tokens[rest]!r} is too much")
    return result


def _value(tokens: list[str], at: int, depth: int = 0) -> tuple[ParamValue, int]:
    if at == len(tokens):
        raise ValueError("the list is not closed")
    if tokens[at] == "[":
        if depth == DEEPEST_LIST:
            raise ValueError(f"lists are nested more than {DEEPEST_LIST} deep")
        return _list(tokens, at + 1, depth + 1)
    return _scalar(tokens[at]), at + 1


def _list(tokens: list[str], at: int, depth: int) -> tuple[ParamValue, int]:
    items: list[ParamValue] = []
    if tokens[at : at + 1] == ["]"]:
        return (), at + 1
    while True:
        item, at = _value(tokens, at, depth)
        items.append(item)
        match tokens[at : at + 1]:
            case ["]"]:
                return tuple(items), at + 1
            case [","]:
                at += 1
            case []:
                raise ValueError("the list is not closed")
            case [other]:
                raise ValueError(f"a comma is missing before {other!r}")


def _scalar(token: str) -> ParamValue:
    if token in ("true", "True", "false", "False"):
        return token in ("true", "True")
    if token.startswith('"'):
        return token[1:-1]
    amount = read_number(token)
    if amount is not None:
        return amount
    if re.match(_WORD, token):
        return token
    raise ValueError(
        f'{shown(token)} is not a value: write an int, a float, true, false, a word, "text", [1, 2]'
    )


def is_moderate(value: int | Fraction) -> bool:
    """Return whether a number is neither too large nor too close to 0."""
    limit = 10**MOST_PLACES
    size = abs(Fraction(value))
    return size == 0 or Fraction(1, limit) <= size <= limit


def shown(text: str) -> str:
    """Shorten a word for a message."""
    return repr(text if len(text) <= _SHOWN else f"{text[: _SHOWN - 1]}…")


def literal(value: ParamValue) -> str:
    """Print a value as text, exactly: ``4``, ``0.5``, ``2.0``, ``1/3``, ``true``, ``[1]``."""
    match value:
        case bool():
            return "true" if value else "false"
        case int():
            return number(Fraction(value))
        case Fraction():
            text = number(value)
            return f"{text}.0" if text.lstrip("-").isdigit() else text
        case str():
            if re.match(_WORD, value):
                return value
            import json  # few words need it

            return json.dumps(value, ensure_ascii=False)
        case tuple():
            return f"[{', '.join(map(literal, value))}]"


def number(value: Fraction) -> str:
    """Print a number exactly: as a decimal where that is exact, else as a fraction.

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
    """The number of decimals of a fraction; None if they do not end."""
    twos = (denominator & -denominator).bit_length() - 1
    rest, fives = denominator >> twos, 0
    while rest % 5 == 0:
        rest, fives = rest // 5, fives + 1
    return max(twos, fives) if rest == 1 else None


def encoded(value: ParamValue) -> object:
    """Encode a value in JSON; a fraction is ``{"fraction": "1/3"}``."""
    match value:
        case Fraction():
            return {"fraction": str(value)}
        case tuple():
            return [encoded(part) for part in value]
        case bool() | int() | str():
            return value
