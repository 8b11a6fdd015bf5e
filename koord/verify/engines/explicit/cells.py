"""Cells: interned contents of variables, as numbers.

Whatever one variable holds is taken apart into its *form* (which atoms are set, how long the lists
are) and the *codes* of its scalars, which are integers: a value is compared, hashed and changed in
one place without being built. Each form and each content has a number, per variable.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from typing import Any, Generic, TypeVar

from koord.semantics.domain import EXACT, Constant
from koord.semantics.storage import Cell, Storage, Tree, unset
from koord.semantics.values import Rec, Seq, Table, Value, default
from koord.syntax.types import (
    ArrayType,
    BoolType,
    EnumType,
    IntType,
    MapType,
    RecordType,
    SequenceType,
    Type,
    part_types,
)

#: Entries of a cache, beyond which it is emptied.
CACHE_LIMIT = 400_000

#: A variable whose content has more scalars is too large to be told apart from others.
MOST_SCALARS = 100_000


class TooLargeError(Exception):
    """Raised where a variable holds more than a search can handle."""


H = TypeVar("H", bound=Hashable)
V = TypeVar("V")

#: The codes of a content's scalars, in the order of the text.
Codes = tuple[int, ...]

#: What is left of a storage without its scalars: None for an unset atom, 0 for a scalar, else the
#: forms of the parts.
Form = Hashable


class Interner(Generic[H]):
    """A table of numbers for values, in order of insertion. Equal values have one number."""

    __slots__ = ("numbers", "values")

    def __init__(self) -> None:
        self.numbers: dict[H, int] = {}
        self.values: list[H] = []

    def number(self, value: H) -> int:
        """The number of a value."""
        known = self.numbers.get(value)
        if known is None:
            known = self.numbers[value] = len(self.values)
            self.values.append(value)
        return known

    def __len__(self) -> int:
        return len(self.values)


class Scalars:
    """Codes of scalars: integers, Booleans and members stand for themselves."""

    def __init__(self) -> None:
        self._others: Interner[Constant] = Interner()

    def code(self, value: Constant, type_: Type) -> int:
        if isinstance(type_, IntType | BoolType | EnumType):
            assert isinstance(value, int)
            return int(value)
        return self._others.number(value)

    def value(self, code: int, type_: Type) -> Constant:
        """The scalar that a code stands for."""
        match type_:
            case IntType() | EnumType():
                return code
            case BoolType():
                return bool(code)
            case _:
                return self._others.values[code]


class Cells:
    """The interned contents of one variable, or of one robot's entry of one."""

    def __init__(self, type_: Type, robots: int, scalars: Scalars) -> None:
        self._type = type_
        self._robots = robots
        self._scalars = scalars
        self._contents: Interner[tuple[int, Codes]] = Interner()
        self._storages: list[Storage[Constant] | None] = []
        self._forms: Interner[Form] = Interner()
        self._types: list[tuple[Type, ...]] = []
        self.forms: list[int] = []  #: the number of each content's form
        self.codes: list[Codes] = []  #: the codes of each content

    def number(self, storage: Storage[Constant]) -> int:
        """The number of a content."""
        form, scalars = self.taken_apart(storage)
        codes = [self._scalars.code(value, type_) for value, type_ in scalars]
        return self.numbered(form, tuple(codes))

    def numbered(self, form: int, codes: Codes) -> int:
        """The number of a content with a form and scalar codes."""
        number = self._contents.number((form, codes))
        if number == len(self.forms):
            self.forms.append(form)
            self.codes.append(codes)
            self._storages.append(None)
        return number

    def storage(self, number: int) -> Storage[Constant]:
        """The storage of a content's number."""
        known = self._storages[number]
        if known is None:
            form, codes = self.forms[number], self.codes[number]
            pairs = zip(codes, self._types[form], strict=True)
            known = self.built(form, [self._scalars.value(code, t) for code, t in pairs])
            self._storages[number] = known
        return known

    def types(self, form: int) -> tuple[Type, ...]:
        """The types of the scalars in a form."""
        return self._types[form]

    # --- forms ----------------------------------------------------------------------------------

    def taken_apart(self, storage: Storage[Any]) -> tuple[int, list[tuple[Any, Type]]]:
        """Split storage into the number of its form, and its scalars with their types.

        Set flags and lengths must be known; what scalars are does not matter.
        """
        scalars: list[tuple[Any, Type]] = []

        def found(value: Any, type_: Type) -> None:
            if len(scalars) == MOST_SCALARS:
                raise TooLargeError
            scalars.append((value, type_))

        form = _form(storage, self._type, found)
        number = self._forms.number(form)
        if number == len(self._types):
            self._types.append(tuple(type_ for _, type_ in scalars))
        return number, scalars

    def built(self, form: int, scalars: Sequence[V]) -> Storage[V]:
        """Build storage of a form from scalars."""
        maker: _Maker[V] = _Maker(iter(scalars), self._robots)
        return maker.storage(self._forms.values[form], self._type)

    def nothing(self) -> Storage[Constant]:
        """Unset storage of the type."""
        return unset(EXACT, self._type, self._robots)


def _form(
    storage: Storage[Any] | Value[Any], type_: Type, found: Callable[[Any, Type], None]
) -> Form:
    """The form of storage or a value; its scalars are passed to ``found``."""
    match storage:
        case Cell(is_set=is_set, value=value):
            return (_form(value, type_, found),) if is_set is True else None
        case Tree(parts=parts) | Rec(fields=parts) | Seq(items=parts):
            types = part_types(type_, len(parts))
            return tuple(_form(part, t, found) for part, t in zip(parts, types, strict=True))
        case Table(entries=entries):
            assert isinstance(type_, MapType)
            return tuple(
                (_form(key, type_.key, found), _form(value, type_.value, found))
                for key, value in entries
            )
        case _:
            found(storage, type_)
            return 0


class _Maker(Generic[V]):
    """A builder of storage from forms; ``scalars`` are consumed in order."""

    def __init__(self, scalars: Iterator[V], robots: int) -> None:
        self._scalars = scalars
        self._robots = robots

    def storage(self, form: Form, type_: Type) -> Storage[V]:
        if isinstance(type_, RecordType | ArrayType):
            assert isinstance(form, tuple)
            types = part_types(type_, len(form))
            return Tree(tuple(map(self.storage, form, types)))
        if form is None:
            # A domain's constants are Python's own in every domain that builds storages here.
            empty: Storage[Any] = Cell(False, default(EXACT, type_, self._robots))
            return empty
        assert isinstance(form, tuple)
        filled: Storage[Any] = Cell(True, self.value(form[0], type_))
        return filled

    def value(self, form: Form, type_: Type) -> Value[V]:
        match type_:
            case RecordType(fields=fields):
                assert isinstance(form, tuple)
                return Rec(tuple(self.value(f, t) for f, (_, t) in zip(form, fields, strict=True)))
            case SequenceType(element=element):
                assert isinstance(form, tuple)
                items: Seq[Any] = Seq(len(form), tuple(self.value(f, element) for f in form))
                return items
            case MapType(key=key, value=value):
                assert isinstance(form, tuple)
                pairs = tuple((self.value(k, key), self.value(v, value)) for k, v in form)
                entries: Table[Any] = Table(len(form), pairs)
                return entries
            case _:
                return next(self._scalars)
