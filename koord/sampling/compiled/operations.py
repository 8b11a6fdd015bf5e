"""What the code of claims and turns calls: operations that are certain, or in doubt.

Each does what the rule does that it cites, on numbers that are known and where nothing faults. In
every other case it raises :class:`InDoubt`, and whoever asked asks the reference semantics.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from typing import Any, NoReturn, TypeAlias

from msgspec import Struct

from koord.semantics import domain
from koord.semantics.domain import Constant, Domain
from koord.semantics.locations import AtField, AtIndex, AtKey, Location, Mask, marked, write
from koord.semantics.storage import Cell, Storage, Tree, contents, stored
from koord.semantics.values import Rec, Seq, Table, equal, insert, lookup
from koord.syntax.types import ArrayType, RecordType, Robots, Type


class InDoubt(Exception):  # noqa: N818 - no error, but what the quick way cannot tell
    """Raised where the reference semantics has to say what happens: a fault, mostly."""


class Unset:
    """What stands for a variable without a value. Whatever looks at it is in doubt. [LOOKUP]"""

    __slots__ = ()
    __hash__ = None  # type: ignore[assignment]

    def _refuse(self, *_: object) -> NoReturn:
        raise InDoubt

    __eq__ = __ne__ = __lt__ = __le__ = __gt__ = __ge__ = _refuse
    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = _refuse
    __truediv__ = __rtruediv__ = __floordiv__ = __rfloordiv__ = __mod__ = __rmod__ = _refuse
    __neg__ = __abs__ = __bool__ = __index__ = __int__ = __float__ = __iter__ = _refuse
    __getattr__ = _refuse


UNSET = Unset()

#: A function made from text.
Made: TypeAlias = "Callable[..., Any]"

#: So often the reference is asked after doubts, before it is asked at once.
_MOST_DOUBTS = 50


class Code(Struct, eq=False):
    """A function that is certain or in doubt; None once it was in doubt too often."""

    function: Made | None
    doubts: int = 0

    def ask(self, *arguments: Any) -> Any:
        """What the function says; None in doubt."""
        if self.function is None:
            return None
        try:
            return self.function(*arguments)
        except (InDoubt, ArithmeticError):
            self.doubts += 1
            if self.doubts > _MOST_DOUBTS:
                self.function = None
            return None


#: The mask of a variable that was written as a whole. [LOCATION]
WHOLE: Mask[Constant] = Mask(True)


def sure(value: Any) -> Any:
    """The value, which is set."""
    if value is UNSET:
        raise InDoubt
    return value


def handy(number: Any) -> Any:
    """The number, which is no longer than numbers may be. [E-ARITH]"""
    if type(number) is int:
        if number.bit_length() > domain.LONGEST_NUMBER_BITS:
            raise InDoubt
    elif type(number) is Fraction and (
        number.numerator.bit_length() > domain.LONGEST_NUMBER_BITS
        or number.denominator.bit_length() > domain.LONGEST_NUMBER_BITS
    ):
        raise InDoubt
    return number


def quotient(left: Any, right: Any) -> Any:
    """Divide: ints rounded down. By zero it is a fault. [E-ARITH]"""
    if not right:
        raise InDoubt
    if isinstance(left, int) and isinstance(right, int):
        return handy(left // right)
    return handy(left / right)


def remainder(left: Any, right: Any) -> Any:
    """The remainder, with the divisor's sign. By zero it is a fault. [E-ARITH]"""
    if not right:
        raise InDoubt
    return left % right


def absolute(number: Any) -> Any:
    """The number without its sign. [E-ARITH]"""
    return -number if number < 0 else number


def scaled(number: Any, unit: int) -> Any:
    """An exact number as how many there are of one in ``unit``; in doubt if that is not whole."""
    if number is UNSET:
        return UNSET
    whole, rest = divmod(unit, number.denominator)
    if rest:
        raise InDoubt
    return number.numerator * whole


# --- reading -------------------------------------------------------------------------------------


def held(cell: Any) -> Any:
    """What a cell holds, if it is set. [LOOKUP]"""
    return cell.value if cell.is_set is True else UNSET


def whole(d: Domain[Constant], storage: Storage[Constant], type_: Type) -> Any:
    """What storage holds, if all of it is set. [LOOKUP]"""
    value, is_set = contents(d, storage, type_)
    return value if is_set is True else UNSET


def pick(items: Sequence[Any], index: Any) -> Any:
    """The item at an index; outside of a list it is a fault. [E-SELECT]"""
    if 0 <= index < len(items):
        return items[index]
    raise InDoubt


def entry(d: Domain[Constant], table: Table[Constant], key: Any) -> Any:
    """The value at a map's key; where there is none it is a fault. [E-SELECT]"""
    found, value = lookup(d, table, key)
    if found is not True:
        raise InDoubt
    return value


def gathered(values: list[Any]) -> Seq[Constant]:
    """An array over robots from its entries, all of which are set. [LOOKUP]"""
    if any(value is UNSET for value in values):
        raise InDoubt
    return Seq(len(values), tuple(values))


def pick_with(items: Sequence[Any], index: Any, own: int, value: Any) -> Any:
    """The item at an index, where one's own is by now another value. [LOOKUP]"""
    return value if index == own else pick(items, index)


def gathered_with(values: list[Any], own: int, value: Any) -> Seq[Constant]:
    """An array over robots, where one's own entry is by now another value. [LOOKUP]"""
    return gathered([*values[:own], value, *values[own + 1 :]])


def pairs(value: Seq[Constant] | Table[Constant]) -> Iterator[tuple[Any, Any]]:
    """The indices and items of a list, or the entries of a map. [S-FOREACH]"""
    return iter(value.entries) if isinstance(value, Table) else enumerate(value.items)


def has(d: Domain[Constant], value: Seq[Constant] | Table[Constant], wanted: Any) -> bool:
    """Return whether a list has an element, or a map a key. [E-LIST]"""
    items = [key for key, _ in value.entries] if isinstance(value, Table) else value.items
    return any(equal(d, item, wanted) is True for item in items)


def extreme(of: Any, items: Sequence[Any]) -> Any:
    """The least or greatest of some numbers; of none it is a fault. [E-LIST]"""
    if not items:
        raise InDoubt
    best = items[0]
    for item in items[1:]:
        best = of(best, item)
    return best


def keys(table: Table[Constant]) -> Seq[Constant]:
    """A map's keys, as a list. [E-LIST]"""
    return Seq(table.length, tuple(key for key, _ in table.entries))


def mapped(d: Domain[Constant], pairs: Sequence[tuple[Any, Any]]) -> Table[Constant]:
    """A map of entries: of two with one key the later counts. [E-MAP]"""
    made: Table[Constant] = Table(0, ())
    for key, value in pairs:
        made = insert(d, made, key, value)
    return made


# --- writing -------------------------------------------------------------------------------------


def at_index(index: Any) -> AtIndex[Constant]:
    return AtIndex(sure(index))


def at_key(key: Any) -> AtKey[Constant]:
    return AtKey(sure(key))


def at_field(position: int) -> AtField:
    return AtField(position)


def fitted(value: Any, type_: Type, robots: int) -> Any:
    """The value of a record or an array whose arrays have as many items as they have room for.
    [ATOM]
    """
    match type_:
        case RecordType(fields=fields):
            for part, (_, its) in zip(value.fields, fields, strict=True):
                fitted(part, its, robots)
        case ArrayType(element=element, size=size):
            if len(value.items) != (robots if size is Robots.ALL else size):
                raise InDoubt
            for item in value.items:
                fitted(item, element, robots)
        case _:
            pass
    return value


#: More parts of lists are left to the rules, which know how many there may be.
_MOST_LISTED = 1_000


def check_length(value: Any) -> None:
    """Leave lists with many parts to the rules; lists in them count as well."""
    waiting, count = [value], 0
    while waiting:
        match waiting.pop():
            case Rec(fields=fields):
                waiting += fields
            case Seq(items=items):
                count += len(items)
                waiting += items if count <= _MOST_LISTED else ()
            case Table(entries=entries):
                count += 2 * len(entries)
                waiting += (
                    (part for pair in entries for part in pair) if count <= _MOST_LISTED else ()
                )
            case _:
                continue
        if count > _MOST_LISTED:
            raise InDoubt


def put(
    d: Domain[Constant],
    storage: Storage[Constant],
    locations: Sequence[Location[Constant]],
    fresh: Storage[Constant],
) -> Storage[Constant]:
    """The storage with something at a place below it. [LOCATION]"""
    changed, legal = write(d, storage, locations, fresh)
    if legal is not True:
        raise InDoubt
    return changed


def put_in_array(storage: Tree[Constant], index: Any, value: Any) -> Tree[Constant]:
    """The storage of an array of atoms with a value at an index. [LOCATION]"""
    parts = storage.parts
    if not 0 <= index < len(parts):
        raise InDoubt
    return Tree((*parts[:index], Cell(True, value), *parts[index + 1 :]))


def put_inside(
    d: Domain[Constant], value: Any, locations: Sequence[Location[Constant]], part: Any
) -> Any:
    """The value of an atom with something at a place inside it. [LOCATION]"""
    changed = put(d, Cell(True, sure(value)), locations, Cell(True, part))
    assert isinstance(changed, Cell)
    return changed.value


def mark(
    d: Domain[Constant],
    masks: dict[int, Mask[Constant]],
    slot: int,
    storage: Storage[Constant],
    locations: Sequence[Location[Constant]],
) -> None:
    """Note that a place of a shared variable was written. [LOCATION]"""
    masks[slot] = marked(d, masks.get(slot), storage, locations, True)


def appended(value: Any, items: Seq[Constant]) -> Seq[Constant]:
    """The list with one more item. [S-APPEND]"""
    return Seq(len(items.items) + 1, (*items.items, value))


def removed(d: Domain[Constant], wanted: Any, value: Any) -> Any:
    """The list without the first equal item, or the map without the key; UNSET if it has none.
    [S-REMOVE]
    """
    parts = value.entries if isinstance(value, Table) else value.items
    for position, part in enumerate(parts):
        key = part[0] if isinstance(value, Table) else part
        if equal(d, key, wanted) is True:
            rest = (*parts[:position], *parts[position + 1 :])
            return Table(len(rest), rest) if isinstance(value, Table) else Seq(len(rest), rest)
    return UNSET


def popped(items: Seq[Constant], position: int) -> tuple[Any, Seq[Constant]]:
    """The first (0) or last (-1) item of a list and the others; of none it is a fault. [S-POP]"""
    parts = items.items
    if not parts:
        raise InDoubt
    rest = parts[1:] if position == 0 else parts[:-1]
    return parts[position], Seq(len(rest), rest)


NAMES = {
    one.__name__: one
    for one in (
        *(InDoubt, sure, handy, quotient, remainder, absolute, scaled, held, whole, pick, entry),
        *(pick_with, gathered, gathered_with, pairs, has, extreme, keys, mapped),
        *(at_index, at_key, at_field, put, put_in_array, put_inside, mark),
        *(fitted, check_length, appended, removed, popped),
        *(equal, stored, Rec, Seq, Cell, Tree, Fraction),
    )
} | {"UNSET": UNSET, "WHOLE": WHOLE}
"""The names that code is made with."""
