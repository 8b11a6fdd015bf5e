"""Value bounds: the possible values of an open place, derived from statements about it.

From a statement that must hold, such as ``0 <= x and x < 4`` or ``forall i: mode@i == idle``, the
values that come into question are read off. They are tried one by one, and the rules say which of
them are legal, so it is enough that none is forgotten.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from fractions import Fraction
from functools import reduce
from itertools import product
from math import ceil, floor

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.domain import Constant
from koord.semantics.recordings import Concrete
from koord.semantics.values import Rec, Seq
from koord.syntax import core
from koord.syntax.analysis.bounds import Bounds
from koord.syntax.core import BinaryOp, ListOp, QuantifierKind, UnaryOp
from koord.syntax.types import (
    ArrayType,
    BoolType,
    EnumType,
    GrowingType,
    IntType,
    RecordType,
    Robots,
    Type,
)
from koord.syntax.walk import nodes

Location = tuple[Hashable, ...]

#: What a statement says, by location.
Found = Mapping[Location, Bounds]


#: What has no value of its own, or one that hangs on more than the text shows.
_UNKNOWN = (core.ExternalCall, core.Choose, core.Call, core.Ran, core.Stopped)


class StatementReader(Struct, frozen=True):
    """A reader of statements. ``bound`` are the values of quantified variables, by slot.

    ``is_open`` says whether a place is left open, and ``address`` where a variable stands (the
    second argument is the robot of ``v@i``). ``evaluate`` gives the value of an expression in which
    no place is open, if it has one.
    """

    kinds: tuple[int, ...]  #: of the robots
    is_open: Callable[[core.Place], bool]
    address: Callable[[core.Variable, int | None], Location]
    evaluate: Callable[[core.Expr, Mapping[int, int]], Constant | None]
    bound: Mapping[int, int] = field(default_factory=dict)

    def restrictions(self, statements: Iterable[core.Expr]) -> Found:
        """The restrictions that several statements together put on open places."""
        return _meet_all(self._of(e, positive=True) or {} for e in statements)

    def constant(self, e: core.Expr) -> Constant | None:
        """The value of an expression without open places; None if it has one."""
        for node in nodes(e):
            if isinstance(node, _UNKNOWN):
                return None
            if isinstance(node, core.Place) and self.is_open(node):
                return None
        return self.evaluate(e, self.bound)

    def locate(self, place: core.Place) -> Location | None:
        """The location of an open place, where it can be determined."""
        if not self.is_open(place):
            return None
        robot = self.constant(place.robot) if place.robot is not None else None
        path: list[Hashable] = [*self.address(place.variable, _as_int(robot))]
        for step in place.steps:
            match step:
                case core.FieldStep(position=position):
                    path.append(position)
                case core.IndexStep(index=index) if (k := self.constant(index)) is not None:
                    path.append(k)
                case _:
                    return None
        return tuple(path)

    def _of(self, e: core.Expr, *, positive: bool) -> Found | None:
        """The restrictions under which a statement is true (``positive``), or false."""
        match e:
            case core.Unary(op=UnaryOp.NOT, operand=operand):
                return self._of(operand, positive=not positive)
            case core.Binary(op=BinaryOp.AND | BinaryOp.OR | BinaryOp.IMPLIES):
                return self._connected(e, positive=positive)
            case core.Binary():
                return self._compared(e, positive=positive)
            case core.Quantified():
                return self._quantified(e, positive=positive)
            case core.Read(place=place):
                location = self.locate(place)
                if location is not None:
                    return {location: Bounds(only=frozenset({positive}))}
            case core.Builtin(op=ListOp.CONTAINS, arguments=(core.MakeList(items=items), wanted)):
                return self._one_of(items, wanted) if positive else {}
            case _:
                pass
        return {} if self.constant(e) in (positive, None) else None

    def _connected(self, e: core.Binary, *, positive: bool) -> Found | None:
        left_positive = positive if e.op is not BinaryOp.IMPLIES else not positive
        left = self._of(e.left, positive=left_positive)
        right = self._of(e.right, positive=positive)
        both = positive if e.op is BinaryOp.AND else not positive
        if both:
            return None if left is None or right is None else _meet(left, right)
        return _join([left, right])

    def _quantified(self, e: core.Quantified, *, positive: bool) -> Found | None:
        values = self._instances(e.domain)
        if values is None:
            return {}
        found = [
            replace(self, bound={**self.bound, e.variable.slot: value})._of(
                e.body, positive=positive
            )
            for value in values
        ]
        every = positive is (e.quantifier is QuantifierKind.FORALL)
        if not every:
            return _join(found)
        return None if None in found else _meet_all(x for x in found if x is not None)

    def _instances(self, domain: core.QuantifierDomain) -> Iterable[int] | None:
        match domain:
            case core.RobotRange(agent=agent):
                return [i for i, kind in enumerate(self.kinds) if agent in (None, kind)]
            case core.IntRange(low=low, high=high):
                first, end = self.constant(low), self.constant(high)
                if isinstance(first, int) and isinstance(end, int):
                    return range(first, end)
            case _:
                pass
        return None

    def _one_of(self, items: tuple[core.Expr, ...], wanted: core.Expr) -> Found | None:
        return _join([self._equal(item, wanted) for item in items])

    # --- comparisons ----------------------------------------------------------------------------

    def _compared(self, e: core.Binary, *, positive: bool) -> Found | None:
        match e.op, positive:
            case (BinaryOp.EQ, True) | (BinaryOp.NE, False):
                return self._equal(e.left, e.right)
            case BinaryOp.LE, True:
                return self._at_most(e.left, e.right)
            case BinaryOp.LT, True:
                return self._at_most(e.left, e.right, strict=True)
            case BinaryOp.LE, False:
                return self._at_most(e.right, e.left, strict=True)
            case BinaryOp.LT, False:
                return self._at_most(e.right, e.left)
            case _:
                return {}

    def _equal(self, left: core.Expr, right: core.Expr) -> Found | None:
        parts = _parts(left) or _parts(right)
        if parts is not None and isinstance(left, core.Read | core.MakeRecord | core.MakeList):
            return self._equal_parts(left, right)
        found: dict[Location, Bounds] = {}
        for one, other in ((left, right), (right, left)):
            location, value = self._open(one), self.constant(other)
            if location is not None and value is not None:
                found[location] = Bounds(only=frozenset({value}))
        return found

    def _equal_parts(self, left: core.Expr, right: core.Expr) -> Found | None:
        """Read ``place == R(a, b)`` field by field."""
        made, place = (left, right) if _parts(left) is not None else (right, left)
        items = _parts(made)
        if items is None or not isinstance(place, core.Read):
            return {}
        whole = self.locate(place.place)
        if whole is None:
            return {}
        found: dict[Location, Bounds] = {}
        for position, item in enumerate(items):
            value = self.constant(item)
            if value is not None:
                found[(*whole, position)] = Bounds(only=frozenset({value}))
        return found

    def _at_most(self, left: core.Expr, right: core.Expr, *, strict: bool = False) -> Found | None:
        found: dict[Location, Bounds] = {}
        op = BinaryOp.LT if strict else BinaryOp.LE
        for one, other, turned in ((left, right, False), (right, left, True)):
            location, limit = self._open(one), self.constant(other)
            if location is not None and isinstance(limit, int | Fraction):
                whole = isinstance(one.type, IntType)
                found[location] = Bounds.compared(op, limit, turned=turned, whole=whole)
        return found

    def _open(self, e: core.Expr) -> Location | None:
        return self.locate(e.place) if isinstance(e, core.Read) else None


def _parts(e: core.Expr) -> tuple[core.Expr, ...] | None:
    match e:
        case core.MakeRecord(fields=fields):
            return fields
        case core.MakeList(items=items):
            return items
        case _:
            return None


def _as_int(value: Constant | None) -> int | None:
    return value if isinstance(value, int) else None


def _meet(left: Found, right: Found) -> Found:
    both = dict(left)
    for location, bounds in right.items():
        both[location] = both[location].meet(bounds) if location in both else bounds
    return both


def _meet_all(found: Iterable[Found]) -> Found:
    nothing: Found = {}
    return reduce(_meet, found, nothing)


def _join(found: Iterable[Found | None]) -> Found | None:
    possible = [x for x in found if x is not None]
    if not possible:
        return None
    first, *others = possible
    return {
        location: reduce(Bounds.join, (x[location] for x in others), bounds)
        for location, bounds in first.items()
        if all(location in x for x in others)
    }


# --- values ---------------------------------------------------------------------------------------


def candidates(
    type_: Type,
    location: Location,
    found: Found,
    robots: int,
    length: int | None = None,
) -> Iterator[Concrete] | None:
    """The possible values of a type at a location; None if they are not few."""
    bounds = found.get(location, Bounds())
    match type_:
        case BoolType():
            return iter([x for x in (False, True) if bounds.only is None or x in bounds.only])
        case EnumType(members=members):
            return _numbers(bounds.meet(Bounds(0, len(members) - 1)))
        case IntType():
            return _numbers(bounds)
        case RecordType(fields=fields):
            parts = [
                candidates(field, (*location, position), found, robots)
                for position, (_, field) in enumerate(fields)
            ]
            return _products(parts, lambda x: Rec(x))
        case ArrayType(element=element, size=size):
            length = robots if size is Robots.ALL else size
        case GrowingType(element=element):
            if length is None:
                return None
        case _:
            return iter(bounds.constants()) if bounds.only is not None else None
    items = [candidates(element, (*location, k), found, robots) for k in range(length)]
    return _products(items, lambda x: Seq(len(x), x))


def _numbers(bounds: Bounds) -> Iterator[Concrete] | None:
    if bounds.only is not None:
        return iter(sorted(x for x in bounds.constants() if isinstance(x, int)))
    if bounds.low is None or bounds.high is None:
        return None
    return iter(range(ceil(bounds.low), floor(bounds.high) + 1))


def _products(
    parts: list[Iterator[Concrete] | None], made: Callable[[tuple[Concrete, ...]], Concrete]
) -> Iterator[Concrete] | None:
    if None in parts:
        return None
    return (made(x) for x in product(*(part for part in parts if part is not None)))
