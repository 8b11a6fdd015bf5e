"""Operations of compiled programs on values, where Python's operators do not suffice.

Each checks what the rules want checked, in their order, and raises :class:`FaultError` with the
place in the program's text. None of them changes a value: they make new ones.
"""

from __future__ import annotations

import math
from typing import Any, NoReturn, TypeVar

from koord.runtime.proposals import EventFault
from koord.syntax.faults import FaultKind

T = TypeVar("T")
K = TypeVar("K")
N = TypeVar("N", int, float)

#: What an atom holds that is not set. Typed as anything: reading it is checked where it may happen.
UNSET: Any = None


class FaultError(Exception):
    """Raised for a fault of the program in an event. [FAULT]"""

    def __init__(self, kind: FaultKind, place: str, detail: str = "") -> None:
        super().__init__(f"{place}: {kind.value}")
        self.fault = EventFault(kind, place, detail)


# --- reading ------------------------------------------------------------------------------------


def at(items: tuple[T, ...], index: int, place: str) -> T:
    """The element at an index. Raises FaultError if there is none. [LOOKUP]"""
    if 0 <= index < len(items):
        return items[index]
    raise FaultError(FaultKind.INDEX, place)


def entry(entries: dict[K, T], key: K, place: str) -> T:
    """The value of a key. Raises FaultError if there is none. [LOOKUP]"""
    if key in entries:
        return entries[key]
    raise FaultError(FaultKind.KEY, place)


def known(value: T | None, name: str, place: str) -> T:
    """The value of an atom. Raises FaultError if it is not set. [LOOKUP] [ATOM]"""
    if value is None:
        raise FaultError(FaultKind.UNSET, place, name)
    return value


def whole(value: T, name: str, place: str) -> T:
    """A record or an array. Raises FaultError if any atom of it is not set. [LOOKUP] [ATOM]"""
    if _lacks(value):
        raise FaultError(FaultKind.UNSET, place, name)
    return value


def _lacks(value: object) -> bool:
    if not isinstance(value, tuple):
        return value is None
    return any(part is None or (isinstance(part, tuple) and _lacks(part)) for part in value)


# --- numbers ------------------------------------------------------------------------------------


def real(number: int) -> float:
    """Convert to the nearest double; what is too large for one is infinite. [E-ARITH]"""
    try:
        return float(number)
    except OverflowError:
        return math.inf if number > 0 else -math.inf


def quotient(left: int, right: int, place: str) -> int:
    """Divide and round down. Raises FaultError for a zero divisor. [E-ARITH]"""
    if right == 0:
        raise FaultError(FaultKind.DIVISION, place)
    return left // right


def ratio(left: float, right: float, place: str) -> float:
    """Divide floats. Raises FaultError for a zero divisor. [E-ARITH]"""
    if right == 0.0:
        raise FaultError(FaultKind.DIVISION, place)
    return left / right


def remainder(left: N, right: N, place: str) -> N:
    """The remainder, with the divisor's sign. Raises FaultError for a zero divisor. [E-ARITH]"""
    if right == 0:
        raise FaultError(FaultKind.DIVISION, place)
    return left % right


# --- comparing ----------------------------------------------------------------------------------


def same(left: object, right: object) -> bool:
    """Return whether values with floats in them are equal: NaN equals nothing. [E-EQUAL]"""
    if isinstance(left, tuple) and isinstance(right, tuple):
        return len(left) == len(right) and all(map(same, left, right))
    if isinstance(left, dict) and isinstance(right, dict):
        return len(left) == len(right) and all(
            key in right and same(value, right[key]) for key, value in left.items()
        )
    return left == right


def contains(items: tuple[T, ...], wanted: T) -> bool:
    """Return whether a list has an element. [E-LIST]"""
    return any(same(item, wanted) for item in items)


def has_key(entries: dict[K, Any], key: K) -> bool:
    """Return whether a map has a key. [E-LIST]"""
    return key in entries


def least(items: tuple[N, ...], place: str) -> N:
    """The least element. Raises FaultError for an empty list. [E-LIST]"""
    if not items:
        raise FaultError(FaultKind.EMPTY, place)
    return min(items)


def greatest(items: tuple[N, ...], place: str) -> N:
    """The greatest element. Raises FaultError for an empty list. [E-LIST]"""
    if not items:
        raise FaultError(FaultKind.EMPTY, place)
    return max(items)


# --- changing -----------------------------------------------------------------------------------


def put(value: T, new: Any, path: tuple[Any, ...], *places: str) -> T:
    """The value with ``new`` at the end of a path of indices, positions of fields, and keys.

    ``places`` are those of the whole and of each step, or one for all of them; there are none where
    nothing can go wrong.
    [LOCATION] [S-ASSIGN]
    """
    check(value, path, places)
    return _put(value, new, path)  # type: ignore[no-any-return]


def _put(value: Any, new: Any, path: tuple[Any, ...]) -> Any:
    if not path:
        return new
    first, rest = path[0], path[1:]
    if isinstance(value, dict):
        return {**value, first: _put(value[first], new, rest) if rest else new}
    part = _put(value[first], new, rest) if rest else new
    if type(value) is tuple:
        return (*value[:first], part, *value[first + 1 :])
    parts = list(value)
    parts[first] = part
    return tuple.__new__(type(value), parts)


def check(value: Any, path: tuple[Any, ...], places: tuple[str, ...]) -> None:
    """Raise the fault of the first step of a path that does not exist."""
    if not places:
        return
    if len(places) == 1:
        places *= len(path) + 1
    for position, step in enumerate(path):
        if value is None:
            raise FaultError(FaultKind.UNSET, places[0])
        if isinstance(value, dict):
            if position + 1 == len(path):
                return
            if step not in value:
                raise FaultError(FaultKind.KEY, places[position + 1])
        elif not 0 <= step < len(value):
            raise FaultError(FaultKind.INDEX, places[position + 1])
        value = value[step]


def without(items: tuple[T, ...], wanted: T) -> tuple[T, ...]:
    """A list without the first element equal to a value; the list itself if none is. [S-REMOVE]"""
    for position, item in enumerate(items):
        if same(item, wanted):
            return (*items[:position], *items[position + 1 :])
    return items


def without_key(entries: dict[K, T], key: K) -> dict[K, T]:
    """A map without a key; the map itself if it has none. [S-REMOVE]"""
    if key not in entries:
        return entries
    return {k: v for k, v in entries.items() if k != key}


def first_of(items: tuple[T, ...], place: str) -> tuple[T, tuple[T, ...]]:
    """Split a queue: its first element, and the others. Raises FaultError if it is empty.
    [S-POP]
    """
    if not items:
        raise FaultError(FaultKind.EMPTY, place)
    return items[0], items[1:]


def last_of(items: tuple[T, ...], place: str) -> tuple[T, tuple[T, ...]]:
    """Split a list: its last element, and the others. Raises FaultError if it is empty. [S-POP]"""
    if not items:
        raise FaultError(FaultKind.EMPTY, place)
    return items[-1], items[:-1]


def no_choice(place: str) -> NoReturn:
    """Raise the fault of an empty choice. [CHOOSE]"""
    raise FaultError(FaultKind.CHOICE, place)
