"""Random values by type, for inputs that the program leaves open.

Everything hangs on the generator that is passed in. Values come from what the program's text and
the present configuration mention, more often than from nowhere: contracts, assumptions and guards
speak of such values.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from random import Random
from typing import ClassVar, TypeGuard, assert_never

from koord.semantics.domain import Constant
from koord.semantics.recordings import Concrete
from koord.semantics.storage import Cell, Storage, Tree, contents
from koord.semantics.values import Rec, Seq, Table
from koord.syntax.system import System
from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    STRING,
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
    StreamType,
    StringType,
    Type,
    part_types,
)
from koord.traces.names import constants
from koord.traces.trace import Numbers

#: Floats between two known ones lie on a grid of so many steps: exact numbers stay short.
_STEPS = 64

_LONGEST_LIST = 4


class Sampler:
    """A sampler of values of a system's types."""

    #: How many starts are drawn at most, where one has to meet assumptions; None: the usual number.
    start_tries: ClassVar[int | None] = None

    def __init__(self, system: System, numbers: Numbers, rng: Random) -> None:
        self.system = system
        self.numbers = numbers
        self.rng = rng
        self._pools = _pools(system)

    def chance(self, percent: int) -> bool:
        return self.rng.randrange(100) < percent

    def value(
        self, type_: Type, known: Sequence[Concrete] = (), length: int | None = None
    ) -> Concrete:
        """Draw a value of a type, often one of ``known``. ``length`` fixes that of a list."""
        if known and length is None and self.chance(50):
            return self.rng.choice(known)
        match type_:
            case IntType():
                return self._int(known)
            case FloatType():
                return self.real(self._float(known))
            case BoolType():
                return self.chance(50)
            case StringType() | StreamType():
                return self.rng.choice(self._pools[STRING])
            case EnumType(members=members):
                return self.rng.randrange(len(members))
            case OpaqueType(name=name):
                return f"{name}!{self.rng.randrange(4)}"
            case RecordType(fields=fields):
                return self._record(fields, known)
            case ArrayType(element=element, size=size):
                return self._list(element, self.system.robots if size is Robots.ALL else size)
            case GrowingType(element=element):
                count = self.rng.randint(0, _LONGEST_LIST) if length is None else length
                return self._list(element, count)
            case MapType(key=key, value=value):
                count = self.rng.randint(0, _LONGEST_LIST)
                entries = {self.value(key): self.value(value) for _ in range(count)}
                return Table(len(entries), tuple(entries.items()))
        assert_never(type_)

    def between(self, low: Constant, high: Constant, type_: Type) -> Constant:
        """Draw a number between two bounds, inclusive; the lower one if there is none."""
        assert not isinstance(low, str)
        assert not isinstance(high, str)
        if not low < high:
            return low
        if isinstance(type_, IntType):
            return self.rng.randint(int(low), int(high))
        if self.chance(20):
            return self.rng.choice((low, high))
        share = self.rng.randint(0, _STEPS)
        if isinstance(low, float) or isinstance(high, float):
            return min(max(low + (high - low) * (share / _STEPS), low), high)
        return low + (high - low) * Fraction(share, _STEPS)

    def real(self, value: Fraction) -> Constant:
        """Convert a rational to a float of the run's domain."""
        return self.numbers.domain.const(value, FLOAT)

    def mentioned(self, type_: Type) -> tuple[Constant, ...]:
        """The constants of a type in the program's text, and some common ones."""
        return self._pools.get(type_, ())

    def _record(self, fields: tuple[tuple[str, Type], ...], known: Sequence[Concrete]) -> Concrete:
        records = [value for value in known if isinstance(value, Rec)]
        parts = []
        for position, (_, type_) in enumerate(fields):
            parts.append(self.value(type_, [value.fields[position] for value in records]))
        return Rec(tuple(parts))

    def _list(self, element: Type, count: int) -> Concrete:
        return Seq(count, tuple(self.value(element) for _ in range(count)))

    def _int(self, known: Sequence[Concrete]) -> int:
        base = self.rng.choice(self._numbers(INT, known))
        return int(base) + (self.rng.randint(-2, 2) if self.chance(50) else 0)

    def _float(self, known: Sequence[Concrete]) -> Fraction:
        pool = self._numbers(FLOAT, known)
        base = Fraction(self.rng.choice(pool))
        if self.chance(40):
            return base
        if self.chance(40):
            return (base + Fraction(self.rng.choice(pool))) / 2
        near = (Fraction(1), Fraction(1, 10), Fraction(1, 16), self.system.delta_s)
        return base + self.rng.choice(near) * self.rng.randint(-3, 3)

    def _numbers(self, type_: Type, known: Sequence[Concrete]) -> list[int | float | Fraction]:
        """Numbers to draw from. Few are drawn of many: only these are worth making exact."""
        mentioned = [value for value in self.mentioned(type_) if not isinstance(value, str)]
        return mentioned + [value for value in known if _is_finite(value)]


def _is_finite(value: Concrete) -> TypeGuard[int | float | Fraction]:
    if isinstance(value, float):
        return value - value == 0
    return isinstance(value, int | Fraction)


def _pools(system: System) -> dict[Type, tuple[Constant, ...]]:
    """The pools of constants to draw from, by type."""
    found = constants(system.program)
    robots = system.robots
    ints = [v for v in found.get(INT, ()) if isinstance(v, int)]
    floats = [v for v in found.get(FLOAT, ()) if isinstance(v, int | Fraction)]
    spread = [*ints, -1, 0, 1, *range(2, robots + 1), 2 * robots]
    rationals = [*map(Fraction, (*floats, *ints)), Fraction(0), Fraction(1), Fraction(-1)]
    return {
        INT: tuple(dict.fromkeys(spread)),
        FLOAT: tuple(dict.fromkeys(rationals)),
        STRING: tuple(dict.fromkeys((*found.get(STRING, ()), ""))),
        BOOL: (False, True),
    }


# --- what a configuration mentions --------------------------------------------------------------


def values_held(
    numbers: Numbers, storage: Storage[Constant], type_: Type
) -> Iterator[tuple[Type, Concrete]]:
    """Every value at or below a place, with its type; of unset atoms there is none."""
    value, is_set = contents(numbers.domain, storage, type_)
    if is_set:
        yield from values_within(value, type_)
    elif isinstance(storage, Tree):
        types = part_types(type_, len(storage.parts))
        for part, t in zip(storage.parts, types, strict=True):
            yield from values_held(numbers, part, t)
    else:
        assert isinstance(storage, Cell)


def values_within(value: Concrete, type_: Type) -> Iterator[tuple[Type, Concrete]]:
    """A value and every part of it, with their types."""
    yield type_, value
    match value:
        case Rec(fields=parts):
            assert isinstance(type_, RecordType)
            for part, (_, t) in zip(parts, type_.fields, strict=True):
                yield from values_within(part, t)
        case Seq(items=items):
            assert isinstance(type_, SequenceType)
            for item in items:
                yield from values_within(item, type_.element)
        case _:
            pass
