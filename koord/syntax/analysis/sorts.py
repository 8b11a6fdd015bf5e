"""Which integers of a program are robots and which are numbers. [SYMMETRY]

Every integer that a program stores or computes gets a *sort*. A sort is one of robots if ``pid``
flows into it, if it indexes an array over robots, or if it is compared with one that is; sorts flow
together through assignments, comparisons, arguments and indices (by unification, as types are
inferred). A sort is one of numbers if it is calculated with, ordered, or chosen.
"""

from __future__ import annotations

from msgspec import Struct, field

from koord.syntax.types import ArrayType, GrowingType, IntType, MapType, RecordType, Robots, Type


class Sort(Struct, eq=False):
    """One sort, or what another one has been unified with.

    ``number`` says why its values cannot be robots, and ``constants`` are those of the text that
    are among its values.
    """

    is_robot: bool = False
    number: str = ""
    constants: set[int] = field(default_factory=set)
    _same: Sort | None = None

    def root(self) -> Sort:
        """The sort that this one has become."""
        sort = self
        while sort._same is not None:
            sort = sort._same
        return sort

    def unify(self, other: Sort) -> None:
        """From now on, both are one."""
        a, b = self.root(), other.root()
        if a is b:
            return
        b._same = a
        a.is_robot |= b.is_robot
        a.number = a.number or b.number
        a.constants |= b.constants

    def be_robot(self) -> None:
        self.root().is_robot = True

    def be_number(self, reason: str) -> None:
        root = self.root()
        root.number = root.number or reason


class Scalar(Struct, frozen=True, eq=False):
    """The sort of an integer; None for scalars that are no integers."""

    sort: Sort | None


class Fields(Struct, frozen=True, eq=False):
    """The sorts of a record."""

    parts: tuple[Shape, ...]


class Items(Struct, frozen=True, eq=False):
    """The sorts of a list or array: of its indices, and of its elements.

    ``is_over_robots`` says whether it has one element for each robot, always.
    """

    index: Sort
    element: Shape
    is_over_robots: bool


class Entries(Struct, frozen=True, eq=False):
    """The sorts of a map."""

    key: Shape
    value: Shape


Shape = Scalar | Fields | Items | Entries


def shape(type_: Type) -> Shape:
    """Fresh sorts for a type."""
    match type_:
        case IntType():
            return Scalar(Sort())
        case RecordType(fields=fields):
            return Fields(tuple(shape(part) for _, part in fields))
        case ArrayType(element=element, size=size):
            return Items(Sort(), shape(element), size is Robots.ALL)
        case GrowingType(element=element):
            return Items(Sort(), shape(element), False)
        case MapType(key=key, value=value):
            return Entries(shape(key), shape(value))
        case _:
            return Scalar(None)


def unify(left: Shape, right: Shape) -> None:
    """Make two shapes of one type the same. An array may meet a list."""
    match left, right:
        case Scalar(sort=a), Scalar(sort=b):
            if a is not None and b is not None:
                a.unify(b)
        case Fields(parts=first), Fields(parts=second):
            for one, other in zip(first, second, strict=True):
                unify(one, other)
        case Items(), Items():
            left.index.unify(right.index)
            unify(left.element, right.element)
        case Entries(), Entries():
            unify(left.key, right.key)
            unify(left.value, right.value)
        case _:
            raise AssertionError((left, right))


def has_robots(of: Shape) -> bool:
    """Whether a value of that shape changes when robots are renamed."""
    match of:
        case Scalar(sort=sort):
            return sort is not None and sort.root().is_robot
        case Fields(parts=parts):
            return any(has_robots(part) for part in parts)
        case Items(index=index, element=element):
            return index.root().is_robot or has_robots(element)
        case Entries(key=key, value=value):
            return has_robots(key) or has_robots(value)
