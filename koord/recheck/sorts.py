"""Sorts of SMT-LIB for Koord's types, and values packed into single terms.

A record or an array is a tuple of its parts; a scalar is a term. A list whose length is written in
the text is a tuple of its elements as well; any other list is one term of a sort ``(Seq …)``, of
any length. So nothing here bounds the length of a list.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeAlias, assert_never

from msgspec import Struct, field

from koord.recheck.terms import BOOL, INT, REAL, Term, Terms, quoted
from koord.syntax.source import NOWHERE, Span
from koord.syntax.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    GrowingType,
    IntType,
    ListType,
    MapType,
    OpaqueType,
    RecordType,
    Robots,
    SequenceType,
    StreamType,
    StringType,
    Type,
    is_by_robot,
    show,
)


class Family(Struct, frozen=True):
    """An array over the robots of an open number, as a function of the number."""

    at: Callable[[Term], Value]


Value: TypeAlias = "Term | tuple[Value, ...] | Family"


_AS_ONE = "an array over all robots as one value is not rechecked for every number of robots"


class NotRecheckedError(Exception):
    """Raised for a construct that this checker does not support. ``span`` is its place."""

    def __init__(self, reason: str, span: Span = NOWHERE) -> None:
        super().__init__(reason)
        self.reason = reason
        self.span = span


class Sorts(Struct):
    """The declared sorts, for a number of robots; None is any number."""

    t: Terms
    robots: int | None
    #: Types of lists that are sorts of their own, of which nothing is known but equality.
    sealed: frozenset[Type] = frozenset()
    #: Declarations of sorts, functions and constants, in the order in which they are needed.
    declarations: list[str] = field(default_factory=list)
    _sorts: dict[str, str] = field(default_factory=dict)
    _functions: set[str] = field(default_factory=set)

    def is_family(self, type_: Type) -> bool:
        return is_by_robot(type_) and self.robots is None

    # --- types ----------------------------------------------------------------------------------

    def size(self, type_: ArrayType) -> int:
        """The number of elements. Raises NotRecheckedError if that is open."""
        if type_.size is not Robots.ALL:
            return type_.size
        if self.robots is None:
            raise NotRecheckedError(_AS_ONE)
        return self.robots

    def parts(self, type_: Type) -> list[tuple[str, Type]] | None:
        """Labels and types of the parts of a value, or None for scalars and lists."""
        match type_:
            case RecordType(fields=fields):
                return [(f".{name}", part) for name, part in fields]
            case ArrayType(element=element):
                return [(f"[{k}]", element) for k in range(self.size(type_))]
            case _:
                return None

    def inner(self, type_: Type) -> list[Type]:
        """The types of the parts of a record or an array."""
        parts = self.parts(type_)
        assert parts is not None
        return [part for _, part in parts]

    def sort(self, type_: Type) -> str:
        """The sort of a whole value as one term."""
        match type_:
            case IntType() | EnumType() | StringType() | StreamType():
                return INT
            case FloatType():
                return REAL
            case BoolType():
                return BOOL
            case ListType() if type_ in self.sealed:
                return self._sealed_sort(type_)
            case GrowingType(element=element):
                return f"(Seq {self.sort(element)})"
            case RecordType() | ArrayType():
                return self._product(type_)
            case MapType():
                return self._map_sort(type_)
            case OpaqueType():
                raise NotRecheckedError(f"values of type {show(type_)} are not rechecked")
        assert_never(type_)

    def _map_sort(self, type_: MapType) -> str:
        """The sort of maps of a type."""
        key, value = self.sort(type_.key), self.sort(type_.value)
        entry, whole = entry_sort(type_), quoted(f"{show(type_)}!")
        made, none, some, held, entries, count = (
            part_name(type_, part) for part in ("make", "none", "some", "value", "entries", "count")
        )
        self.declare(entry, f"(declare-datatype {entry} (({none}) ({some} ({held} {value}))))")
        fields = f"({entries} (Array {key} {entry})) ({count} {INT})"
        self.declare(whole, f"(declare-datatype {whole} (({made} {fields})))")
        return whole

    def declare(self, name: str, text: str) -> None:
        """Declare a symbol, unless it is declared."""
        if name not in self._functions:
            self._functions.add(name)
            self.declarations.append(text)

    def _sealed_sort(self, type_: ListType) -> str:
        name = quoted(f"{show(type_)}!")
        self.declare(name, f"(declare-sort {name} 0)")
        return name

    def _product(self, type_: RecordType | ArrayType) -> str:
        parts = self.parts(type_)
        assert parts is not None
        name = f"{show(type_)}!"
        if name not in self._sorts:
            sorts = [self.sort(part) for _, part in parts]
            fields = "".join(
                f" ({quoted(name + label)} {sort})"
                for (label, _), sort in zip(parts, sorts, strict=True)
            )
            symbol = quoted(name)
            maker = quoted(f"{name}make")
            self.declarations.append(f"(declare-datatype {symbol} (({maker}{fields})))")
            self._sorts[name] = symbol
        return self._sorts[name]

    def element(self, type_: Type) -> Type:
        assert isinstance(type_, SequenceType)
        return type_.element

    def function(self, name: str, arguments: list[Term], sort: str) -> Term:
        symbol = quoted(f"{name}()")
        if symbol not in self._functions:
            self._functions.add(symbol)
            sorts = " ".join(argument.sort for argument in arguments)
            self.declarations.append(f"(declare-fun {symbol} ({sorts}) {sort})")
        return self.t.op(symbol, arguments, sort)

    # --- whole values ---------------------------------------------------------------------------

    def leaves(self, value: Value, type_: Type) -> Iterator[tuple[Term, Type]]:
        """The scalars and lists of a value, each as one term, with their types."""
        parts = None if isinstance(value, Family) else self.parts(type_)
        if parts is None:
            yield self.pack(value, type_), type_
            return
        assert isinstance(value, tuple)
        for part, (_, part_type) in zip(value, parts, strict=True):
            yield from self.leaves(part, part_type)

    def pack(self, value: Value, type_: Type) -> Term:
        """Pack a value into one term."""
        if isinstance(value, Term):
            return value
        if isinstance(value, Family):
            raise NotRecheckedError(_AS_ONE)
        sort = self.sort(type_)
        if type_ in self.sealed:
            element = self.element(type_)
            flat = [term for item in value for term, _ in self.leaves(item, element)]
            return self.function(f"{show(type_)} of {len(value)}", flat, sort)
        if isinstance(type_, GrowingType):
            units = [
                self.t.op("seq.unit", [self.pack(item, type_.element)], sort) for item in value
            ]
            if not units:
                return self.t.op(f"(as seq.empty {sort})", (), sort)
            return units[0] if len(units) == 1 else self.t.op("seq.++", units, sort)
        packed = [self.pack(v, part) for v, part in zip(value, self.inner(type_), strict=True)]
        return self.t.op(quoted(f"{show(type_)}!make"), packed, sort)

    def unpack(self, term: Term, type_: Type) -> Value:
        """Unpack a term into a tree; lists stay terms."""
        parts = self.parts(type_)
        if parts is None:
            return term
        if term.head == quoted(f"{show(type_)}!make"):
            inside = term.args
        else:
            self.sort(type_)
            inside = tuple(
                self.t.op(quoted(f"{show(type_)}!{label}"), [term], self.sort(part))
                for label, part in parts
            )
        return tuple(self.unpack(a, part) for a, (_, part) in zip(inside, parts, strict=True))


def entry_sort(type_: MapType) -> str:
    """The sort of a map's optional value."""
    return quoted(f"{show(type_)} entry!")


def part_name(type_: MapType, part: str) -> str:
    """The symbol of a constructor or selector of a sort of maps."""
    return quoted(f"{show(type_)}!{part}")
