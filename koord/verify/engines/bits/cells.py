"""Cells: the possible values of each scalar of a configuration, as bits.

A *leaf* stands for one scalar, a constant of the text or what is known of its values. Leaves have
the place of scalars in configurations, so a configuration of leaves says which states are looked
at.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import zip_longest
from math import lcm
from typing import Any, Generic, TypeAlias, TypeVar, cast

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.configurations import Configuration, Robot, Store
from koord.semantics.domain import Constant
from koord.semantics.storage import Cell, Storage, Tree
from koord.semantics.values import Rec, Seq, Table, Value
from koord.syntax import core
from koord.syntax.types import ScalarType, Type, is_flat
from koord.verify.encoding.externals import scalars
from koord.verify.encoding.unknowns import Symbolic, Unknowns
from koord.verify.engines.bits.domain import Bit, BitDomain, Bits
from koord.verify.engines.bits.graph import FALSE
from koord.verify.engines.bits.numbers import Number
from koord.verify.engines.bits.opaque import OpaqueChoice


class Fixed(Struct, frozen=True):
    """A leaf whose scalar is a constant."""

    value: Constant


class Truth(Struct, frozen=True):
    """A leaf whose scalar is a Boolean."""


class Ranged(Struct, frozen=True):
    """A leaf with numbers of a range, before division by ``scale``; where it ``strays``, any."""

    low: int
    high: int
    scale: int
    strays: bool = False


class Wild(Struct, frozen=True):
    """A leaf whose scalar is a number of which nothing is known."""

    scale: int


class OpaqueCell(Struct, frozen=True):
    """A leaf whose scalar is an opaque value."""

    sort: str


Leaf: TypeAlias = "Fixed | Truth | Ranged | Wild | OpaqueCell"

#: Of numbers with a larger denominator nothing is kept.
FINEST = 1 << 12


class Joining(Struct):
    """Joins leaves to cover all values that were seen, as in abstract interpretation.

    Ranges that keep growing go on to the next of the ``landmarks``, and never beyond the last.
    """

    d: BitDomain
    landmarks: tuple[int, ...]
    is_overtime: bool = False  #: whether ranges that grow go on to the next landmark
    forgets: bool = False  #: whether a number of which nothing was known stays one

    def joined(self, leaf: Leaf | None, value: Bits) -> Leaf:
        """The leaf that covers another leaf and one more value."""
        found = self._leaf(value)
        if leaf is None or leaf == found:
            return found
        if isinstance(leaf, OpaqueCell) or isinstance(found, OpaqueCell):
            assert leaf == found
            return leaf
        if _is_truth(leaf) or _is_truth(found):
            return Truth()
        return self._numbers(leaf, found)

    def _leaf(self, value: Bits) -> Leaf:
        match value:
            case Bit():
                return Truth()
            case OpaqueChoice(sort=sort):
                return OpaqueCell(sort)
            case Number() if self.d.is_wild(value):
                return Wild(value.scale)
            case Number(low=low, high=high, scale=scale, loose=loose):
                return Ranged(low, high, scale, loose != FALSE)
            case _:
                return Fixed(value)

    def _numbers(self, leaf: Leaf, found: Leaf) -> Leaf:
        if isinstance(leaf, Wild):
            if isinstance(found, Wild) or self.forgets:
                return leaf
            return replace(self._range(found), strays=True)
        a = self._range(leaf)
        if isinstance(found, Wild):
            return replace(a, strays=True)
        b = self._range(found)
        scale = lcm(a.scale or 1, b.scale or 1) if a.scale or b.scale else 0
        if scale > FINEST:
            return Wild(1)
        strays = a.strays or b.strays
        low, a_high = a.low * _factor(scale, a), a.high * _factor(scale, a)
        new_low, new_high = b.low * _factor(scale, b), b.high * _factor(scale, b)
        least, most = self.landmarks[0] * (scale or 1), self.landmarks[-1] * (scale or 1)
        bottom, top = min(low, new_low), max(a_high, new_high)
        if self.is_overtime:
            marks = [mark * (scale or 1) for mark in self.landmarks]
            if new_low < low:
                bottom = max((m for m in marks if m <= new_low), default=min(least, low))
            if new_high > a_high:
                top = min((m for m in marks if m >= new_high), default=max(most, a_high))
        # What lies beyond the last landmark is not kept, unless it was there at once.
        if bottom < min(least, low):
            bottom, strays = min(least, low), True
        if top > max(most, a_high):
            top, strays = max(most, a_high), True
        strays = strays or new_low < bottom or new_high > top
        return Ranged(bottom, top, scale, strays)

    def _range(self, leaf: Leaf) -> Ranged:
        if isinstance(leaf, Ranged):
            return leaf
        assert isinstance(leaf, Fixed)
        number = self.d.number(leaf.value)
        return Ranged(number.low, number.high, number.scale)


def _is_truth(leaf: Leaf) -> bool:
    return isinstance(leaf, Truth) or (isinstance(leaf, Fixed) and isinstance(leaf.value, bool))


def _factor(scale: int, leaf: Ranged) -> int:
    return scale // (leaf.scale or 1) if scale else 1


# --- configurations, two at a time ----------------------------------------------------------------

A = TypeVar("A")
B = TypeVar("B")
C = TypeVar("C")


class Pairing(Struct, Generic[A, B, C]):
    """A simultaneous walk through two configurations of one system, which builds a third.

    ``pair`` gets the path of a scalar with the scalars of both; one of them is None where a list is
    longer on one side. ``longer`` is told of lists of the second that are longer than in the first.
    """

    pair: Callable[[str, A | None, B | None], C]
    longer: Callable[[B, int], None]
    room: int  #: lists that are longer than in the first are followed so far
    names: VariableNames = field(default_factory=lambda: VariableNames((), (), (), ()))

    def configuration(self, a: Configuration[A], b: Configuration[B]) -> Configuration[C]:
        """Pair two configurations; copies are equal to the store, as they are between rounds."""
        store = Store(
            self._all(self.names.allread, "", a.store.allread, b.store.allread),
            self._all(self.names.allwrite, "", a.store.allwrite, b.store.allwrite),
        )
        robots = []
        for i, (x, y) in enumerate(zip(a.robots, b.robots, strict=True)):
            at = f"@{i}"
            robots.append(
                Robot(
                    x.kind,
                    self._all(self.names.locals[x.kind], at, x.locals, y.locals),
                    self._all(self.names.ports[x.kind], at, x.ports, y.ports),
                    store,
                    self.pair(f"status{at}", x.status, y.status),
                    self.pair(f"ran{at}", x.ran, y.ran),
                )
            )
        return Configuration(tuple(robots), store, 0)

    def _all(
        self,
        names: tuple[str, ...],
        at: str,
        a: tuple[Storage[A], ...],
        b: tuple[Storage[B], ...],
    ) -> tuple[Storage[C], ...]:
        triples = zip(names, a, b, strict=True)
        return tuple(self._storage(f"{name}{at}", x, y) for name, x, y in triples)

    def _storage(self, path: str, a: Storage[A], b: Storage[B]) -> Storage[C]:
        if isinstance(a, Cell):
            assert isinstance(b, Cell)
            is_set = self.pair(f"{path} is set", a.is_set, b.is_set)
            return Cell(is_set, self._value(path, a.value, b.value))
        assert isinstance(b, Tree)
        pairs = enumerate(zip(a.parts, b.parts, strict=True))
        return Tree(tuple(self._storage(f"{path}.{k}", x, y) for k, (x, y) in pairs))

    def _value(self, path: str, a: Value[A] | None, b: Value[B] | None) -> Value[C]:
        some = a if a is not None else b
        if isinstance(some, Rec):
            pairs = enumerate(zip_longest(_fields(a), _fields(b)))
            return Rec(tuple(self._value(f"{path}.{k}", x, y) for k, (x, y) in pairs))
        if isinstance(some, Seq | Table):
            return self._list(path, a, b)
        assert not isinstance(a, Rec | Seq | Table)
        assert not isinstance(b, Rec | Seq | Table)
        return self.pair(path, a, b)

    def _list(self, path: str, a: Value[A] | None, b: Value[B] | None) -> Value[C]:
        here, there = _items(a), _items(b)
        assert a is None or isinstance(a, Seq | Table)
        assert b is None or isinstance(b, Seq | Table)
        if b is not None and a is not None and len(there) > len(here):
            self.longer(b.length, len(here))
        length = self.pair(
            f"{path}.length", None if a is None else a.length, None if b is None else b.length
        )
        pairs = enumerate(zip_longest(here, there[: max(len(here), self.room)]))
        items = tuple(self._value(f"{path}[{k}]", x, y) for k, (x, y) in pairs)
        if isinstance(a if a is not None else b, Seq):
            return Seq(length, items)
        entries = tuple((r.fields[0], r.fields[1]) for r in items if isinstance(r, Rec))
        return Table(length, entries)


class VariableNames(Struct, frozen=True):
    """Names of variables: shared ones by slot, own ones by kind and slot."""

    allread: tuple[str, ...]
    allwrite: tuple[str, ...]
    locals: tuple[tuple[str, ...], ...]
    ports: tuple[tuple[str, ...], ...]


def _fields(value: Value[A] | None) -> tuple[Value[A], ...]:
    if value is None:
        return ()
    assert isinstance(value, Rec)
    return value.fields


def _items(value: Value[A] | None) -> tuple[Value[A], ...]:
    if value is None:
        return ()
    if isinstance(value, Table):
        return tuple(Rec(entry) for entry in value.entries)
    assert isinstance(value, Seq)
    return value.items


def as_constant(value: int, scale: int) -> Constant:
    """The constant that a vector with a value denotes."""
    return Fraction(value, scale) if scale else value


class BitUnknowns(Unknowns):
    """The fresh bits of one formula."""

    @property
    def bits(self) -> BitDomain:
        return cast(BitDomain, self.d)

    def function(
        self, external: core.External, arguments: tuple[Symbolic, ...], name: str
    ) -> Symbolic:
        """The answer of a mathematical function; across rounds equal only for few arguments."""
        result = external.result.type
        variables = (external.result, *external.parameters)
        if all(is_flat(v.type) for v in variables) and isinstance(result, ScalarType):
            flat = [scalar for argument in arguments for scalar in scalars(argument)]
            if self.bits.is_relation(cast(Any, flat), result):
                return cast(Any, self.bits.applied(external.name, cast(Any, flat), result))
        return self.alike(external, arguments, name)

    def every(self, types: Sequence[Type], body: Callable[[tuple[Symbolic, ...]], Any]) -> Any:
        """The condition that a statement holds of all values of types: unknown, a fresh bit."""
        return Bit(self.bits.graph.input("of all"))

    def chosen(self, low: Any, high: Any, type_: Type) -> Any:
        """Any number between the bounds, as far as they are known."""
        first, last = self.bits.number(low), self.bits.number(high)
        loose = first.loose or last.loose
        if loose or first.scale or last.scale:
            return low if low == high else self.bits.fresh("choose", type_)
        return self.bits.between("choose", first.low, last.high)
